"use strict";
(() => {
  const root = document.documentElement;
  root.classList.add("js");
  const svgNode = (name, attributes) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const key in attributes) node.setAttribute(key, attributes[key]);
    return node;
  };
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
  // A true minus sign and at most three significant digits, like the figures outside.
  const show = (value, unit) => {
    if (value === null || value === undefined) return "–";
    const size = Math.abs(value);
    const digits = size >= 100 || Number.isInteger(value) ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3;
    return value.toFixed(digits).replace("-", "\u2212") + (unit === "°" ? unit : unit ? "\u202f" + unit : "");
  };

  // One run: its player, map and plots share one cursor, the index of a recorded step.
  class Run {
    constructor(section) {
      this.section = section;
      this.ready = false;
      this.step = 0;
      this.playing = false;
    }

    // Parsing and decoding wait until the run is looked at.
    open() {
      if (this.ready) return;
      this.ready = true;
      const find = (selector) => this.section.querySelector(selector);
      this.data = JSON.parse(find("script.data").textContent);
      this.data.time = this.data.t;
      this.canvas = find("canvas");
      this.overlay = find(".overlay");
      this.event = find(".event");
      this.playButton = find(".play");
      this.scrub = find(".scrub");
      this.clock = find(".clock");
      this.rate = find(".rate select");
      this.vehicle = find(".sp-vehicle");
      this.readout = find(".readout");
      const detections = find(".detect input");
      this.gaze = find(".gaze input");
      this.images = this.data.frames.map((frame) => {
        const image = new Image();
        image.onload = () => { if (this.shown === image) this.paint(image); };
        image.src = frame.src;
        if (frame.look) {
          image.light = new Image();
          image.light.onload = image.onload;
          image.light.src = frame.look;
        }
        return image;
      });
      this.last = this.data.t.length - 1;
      this.scrub.max = Math.max(this.last, 1);
      this.scrub.addEventListener("input", () => this.seek(+this.scrub.value));
      this.playButton.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
      for (const button of this.section.querySelectorAll(".step")) {
        button.addEventListener("click", () => this.turn(+button.dataset.step));
      }
      if (detections) {
        detections.addEventListener("change", () => {
          this.overlay.style.display = detections.checked ? "" : "none";
        });
      }
      if (this.gaze) this.gaze.addEventListener("change", () => this.shown && this.paint(this.shown));
      for (const button of this.section.querySelectorAll("[data-seek]")) {
        button.addEventListener("click", () => this.seek(+button.dataset.seek));
      }
      this.rows = this.data.readout.map(([key, label]) => {
        const column = this.data.columns[key];
        const row = document.createElement("div");
        const name = document.createElement("dt");
        const value = document.createElement("dd");
        name.textContent = label;
        row.append(name, value);
        this.readout.append(row);
        return { column, value };
      });
      this.plots = [...this.section.querySelectorAll("svg[data-x]")].map((svg) => this.plot(svg));
      // Steps of a state chart with the times in which they were the present one.
      this.steps = [...this.section.querySelectorAll(".sp-step")].map((box) => ({
        box,
        spans: box.dataset.spans.split(" ").map((span) => span.split(",").map(Number)),
      }));
      this.seek(0);
    }

    // Connects a plot: a cursor line, a dot on every series, and seeking by pointing.
    plot(svg) {
      const [left, top, right, bottom] = svg.dataset.frame.split(" ").map(Number);
      const [x0, x1, y0, y1] = svg.dataset.range.split(" ").map(Number);
      const along = this.data[svg.dataset.x];
      const group = svg.querySelector(".sp-cursor");
      const line = svgNode("line", { y1: top, y2: bottom });
      group.append(line);
      const dots = [...svg.querySelectorAll("[data-key]")].map((series) => {
        const dot = svgNode("circle", { r: 3.6, class: "sp-f" + series.dataset.colour });
        group.append(dot);
        return { dot, values: (this.data.columns[series.dataset.key] || {}).values };
      });
      const point = (event) => {
        const box = svg.getBoundingClientRect();
        const width = svg.viewBox.baseVal.width;
        const x = ((event.clientX - box.left) / box.width) * width;
        this.seek(this.nearest(along, x0 + ((x - left) / (right - left)) * (x1 - x0)));
      };
      svg.addEventListener("pointermove", (event) => { if (!this.playing || event.buttons) point(event); });
      svg.addEventListener("pointerdown", (event) => { this.pause(); point(event); });
      return () => {
        const value = along[this.step];
        const hidden = value === null || value < x0 || value > x1;
        group.style.display = hidden ? "none" : "";
        if (hidden) return;
        const x = left + ((value - x0) / (x1 - x0)) * (right - left);
        line.setAttribute("x1", x);
        line.setAttribute("x2", x);
        for (const { dot, values } of dots) {
          const y = values ? values[this.step] : null;
          const inside = y !== null && y >= y0 && y <= y1;
          dot.style.display = inside ? "" : "none";
          if (inside) {
            dot.setAttribute("cx", x);
            dot.setAttribute("cy", bottom - ((y - y0) / (y1 - y0)) * (bottom - top));
          }
        }
      };
    }

    // The step whose value is nearest; among equally near ones (several laps) the one nearest to the cursor.
    nearest(along, value) {
      let best = this.step, least = Infinity;
      const span = this.last + 1;
      for (let i = 0; i <= this.last; i++) {
        if (along[i] === null) continue;
        const distance = Math.abs(along[i] - value);
        const cost = along === this.data.percent ? Math.max(distance, 0.4) + 0.2 * Math.abs(i - this.step) / span : distance;
        if (cost < least) { least = cost; best = i; }
      }
      return best;
    }

    seek(step) {
      this.step = clamp(Math.round(step), 0, this.last);
      const data = this.data, i = this.step;
      this.scrub.value = i;
      const percent = data.percent ? data.percent[i] : null;
      const place = percent === null ? "" : " · " + percent.toFixed(0) + " % of lap";
      this.clock.textContent = data.t[i].toFixed(2) + " s" + place;
      this.scrub.setAttribute("aria-valuetext", this.clock.textContent);
      if (this.vehicle && data.x[i] !== null) {
        this.vehicle.setAttribute("visibility", "visible");
        this.vehicle.setAttribute("transform", `translate(${data.x[i]} ${data.y[i]}) rotate(${data.heading[i]})`);
      }
      for (const { column, value } of this.rows) value.textContent = show(column.values[i], column.unit);
      for (const draw of this.plots || []) draw();
      for (const { box, spans } of this.steps || []) {
        box.classList.toggle("sp-lit", spans.some(([from, to]) => from <= data.t[i] && data.t[i] < to));
      }
      if (this.canvas) this.look();
    }

    // The newest embedded frame that is not later than the cursor.
    look() {
      const frames = this.data.frames;
      let low = 0, high = frames.length - 1;
      while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (frames[middle].step <= this.step) low = middle; else high = middle - 1;
      }
      this.frame = low;
      const image = this.images[low];
      if (image && image !== this.shown) {
        this.shown = image;
        if (image.complete && image.naturalWidth) this.paint(image);
        const width = this.overlay.viewBox.baseVal.width;
        this.overlay.replaceChildren(...frames[low].shapes.map((shape) => drawn(shape, width)));
      }
      const near = this.data.events.find(([step]) => step <= this.step && this.data.t[this.step] - this.data.t[step] < 0.8);
      this.event.classList.toggle("on", !!near);
      if (near) this.event.textContent = near[1];
    }

    paint(image) {
      const canvas = this.canvas;
      if (canvas.width !== image.naturalWidth || canvas.height !== image.naturalHeight) {
        canvas.width = image.naturalWidth;
        canvas.height = image.naturalHeight;
      }
      const context = canvas.getContext("2d");
      context.globalCompositeOperation = "source-over";
      context.drawImage(image, 0, 0);
      const light = image.light;
      if (!light || !light.naturalWidth || !this.gaze || !this.gaze.checked) return;
      const [left, top, width, height] = this.data.look_area;
      context.globalCompositeOperation = "screen";
      context.imageSmoothingEnabled = true;
      context.drawImage(light, left * canvas.width, top * canvas.height, width * canvas.width, height * canvas.height);
    }

    // Steps by frames where there are frames, else by recorded steps.
    turn(count) {
      this.pause();
      const frames = this.data.frames;
      if (!frames.length) return this.seek(this.step + count);
      this.look();
      this.seek(frames[clamp(this.frame + count, 0, frames.length - 1)].step);
    }

    play() {
      if (this.step >= this.last) this.seek(0);
      this.playing = true;
      this.playButton.textContent = "\u275a\u275a";
      this.playButton.setAttribute("aria-label", "Pause");
      let clock = this.data.t[this.step], before = null;
      const tick = (now) => {
        if (!this.playing) return;
        if (before !== null) clock += Math.min((now - before) / 1000, 0.25) * +this.rate.value;
        before = now;
        let step = this.step;
        while (step < this.last && this.data.t[step + 1] <= clock) step++;
        if (step !== this.step) this.seek(step);
        if (step >= this.last) return this.pause();
        requestAnimationFrame(tick);
      };
      requestAnimationFrame(tick);
    }

    pause() {
      this.playing = false;
      this.playButton.textContent = "\u25b6";
      this.playButton.setAttribute("aria-label", "Play");
    }
  }

  // A detection as an SVG node: ["line", colour, closed, u, v, ...], ["circle", colour, u, v, r], ["text", colour, u, v, word].
  const drawn = ([kind, colour, ...rest], width) => {
    if (kind === "line") {
      const [closed, ...numbers] = rest;
      const points = [];
      for (let i = 0; i + 1 < numbers.length; i += 2) points.push(numbers[i] + "," + numbers[i + 1]);
      return svgNode(closed ? "polygon" : "polyline", {
        points: points.join(" "), fill: "none", stroke: colour, "stroke-width": 2.2, "stroke-linejoin": "round",
      });
    }
    if (kind === "circle") {
      return svgNode("circle", { cx: rest[0], cy: rest[1], r: rest[2], fill: "none", stroke: colour, "stroke-width": 2 });
    }
    // Letters of one size whatever the camera's, moved left where they would leave the picture.
    const size = 0.042 * width, length = 0.6 * size * rest[2].length;
    const x = Math.max(Math.min(rest[0], width - length - 1), 1);
    const node = svgNode("text", { x, y: rest[1], fill: colour, "font-size": size, "stroke-width": 0.18 * size });
    node.textContent = rest[2];
    return node;
  };

  const runs = [...document.querySelectorAll("section.run")].map((section) => new Run(section));
  const tabs = [...document.querySelectorAll("[role=tab]")];
  let current = 0;
  const choose = (index, focus) => {
    if (!runs.length) return;
    runs.forEach((run, i) => {
      if (i !== index && run.playing) run.pause();
      run.section.toggleAttribute("data-hidden", i !== index);
    });
    tabs.forEach((tab, i) => {
      tab.setAttribute("aria-selected", i === index);
      tab.tabIndex = i === index ? 0 : -1;
    });
    if (focus && tabs[index]) tabs[index].focus();
    current = index;
    runs[index].open();
  };
  tabs.forEach((tab, i) => {
    tab.addEventListener("click", () => {
      choose(i);
      history.replaceState(null, "", "#show-" + runs[i].section.id);
    });
    tab.addEventListener("keydown", (event) => {
      const move = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (!move) return;
      event.preventDefault();
      event.stopPropagation();
      choose((i + move + tabs.length) % tabs.length, true);
    });
  });
  const wanted = runs.findIndex((run) => "#show-" + run.section.id === location.hash);
  choose(Math.max(wanted, 0));

  document.addEventListener("keydown", (event) => {
    const run = runs[current];
    if (!run || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.closest("input[type=range], select, summary, button") && event.key !== "[" && event.key !== "]") return;
    const many = event.shiftKey ? 10 : 1;
    const action = {
      " ": () => (run.playing ? run.pause() : run.play()),
      ArrowLeft: () => run.turn(-many),
      ArrowRight: () => run.turn(many),
      Home: () => run.seek(0),
      End: () => run.seek(run.last),
      "[": () => choose((current - 1 + runs.length) % runs.length),
      "]": () => choose((current + 1) % runs.length),
    }[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });

  document.querySelector(".theme").addEventListener("click", () => {
    const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
  });
  document.addEventListener("click", (event) => {
    const button = event.target.closest(".copy");
    if (!button) return;
    const done = () => { button.textContent = "copied"; setTimeout(() => (button.textContent = "copy"), 1500); };
    const byHand = () => {
      const area = document.createElement("textarea");
      area.value = button.dataset.copy;
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
      done();
    };
    if (navigator.clipboard) navigator.clipboard.writeText(button.dataset.copy).then(done, byHand); else byHand();
  });
})();
