"""The steps of the line extraction (C3 to C5 in SPEC) in OpenCV, timed over a folder of PNG frames.

    python line_extraction.py FOLDER NARROW WIDE

Frames alternate between dark and light lines. NARROW and WIDE are the widths of the two horizontal filters in the
middle row: OpenCV has no filter whose width grows with the row, so it gets the cheaper fixed one. One thread. Prints one line
of JSON with the best and the median time per frame of each step over the rounds (microseconds).
"""

import json
import pathlib
import statistics
import sys
import time

import cv2
import numpy as np

cv2.setNumThreads(1)
ROUNDS = 200


def main():
    folder, narrow, wide = pathlib.Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    frames = [cv2.imread(str(path)) for path in sorted(folder.glob("*.png"))]
    height, width = frames[0].shape[:2]
    sigma = 2.0 * width / 320.0
    narrow_element = np.ones((1, narrow | 1), np.uint8)
    wide_element = np.ones((1, wide | 1), np.uint8)

    def luminance(i, frame):
        return cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)

    def blur(i, grey):
        return cv2.GaussianBlur(grey, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)

    def residue(i, grey):
        if i % 2 == 0:
            first = cv2.morphologyEx(grey, cv2.MORPH_CLOSE, narrow_element)
            return cv2.subtract(cv2.morphologyEx(grey, cv2.MORPH_CLOSE, wide_element), first)
        first = cv2.morphologyEx(grey, cv2.MORPH_OPEN, narrow_element)
        return cv2.subtract(first, cv2.morphologyEx(grey, cv2.MORPH_OPEN, wide_element))

    def threshold(i, grey):
        limit = 1.5 * cv2.mean(grey)[0] + cv2.minMaxLoc(grey)[1] / 15.0
        return cv2.threshold(grey, limit, 255, cv2.THRESH_BINARY)[1]

    def components(i, binary):
        count, labels, stats, centroids = cv2.connectedComponentsWithStats(binary, connectivity=8)
        found = 0
        for label in range(1, count):
            left, top, box_width, box_height, area = map(int, stats[label])
            if area * 750 <= width * height:
                continue
            box = labels[top : top + box_height, left : left + box_width]
            moments = cv2.moments((box == label).astype(np.uint8), binaryImage=True)
            u, v, uv = (moments[key] / area for key in ("mu20", "mu02", "mu11"))
            radius = np.hypot((u - v) / 2.0, uv)
            ellipticity = np.sqrt(((u + v) / 2.0 + radius) / max((u + v) / 2.0 - radius, 1e-9))
            score = (7 * box_width * box_height + area) * 76800 / (width * height) + 150 * ellipticity
            found += score > 25000 and ellipticity > 1.7
        return found

    times, lines = {}, 0
    steps = [luminance, blur, residue, blur, threshold, components]
    names = ["luminance", "blur", "residue_fixed_width", "residue_blur", "threshold", "components"]
    inputs = frames
    for name, step in zip(names, steps):
        measure(times, name, inputs, step)
        inputs = [step(i, value) for i, value in enumerate(inputs)]
    lines = sum(inputs)

    def whole(i, value, steps=steps):
        for step in steps:
            value = step(i, value)
        return value

    measure(times, "total_rgb", frames, whole)
    greys = [luminance(0, frame) for frame in frames]
    measure(times, "total_gray", greys, lambda i, value: whole(i, value, steps[1:]))
    print(
        json.dumps(
            {"who": f"opencv {cv2.__version__}", "width": width, "height": height, "frames": len(frames), "lines": int(lines), **times}
        )
    )


def measure(times, name, inputs, step):
    rounds = [[] for _ in inputs]
    for _ in range(ROUNDS):
        for i, value in enumerate(inputs):
            begin = time.perf_counter()
            step(i, value)
            rounds[i].append((time.perf_counter() - begin) * 1e6)
    times[name + "_us"] = round(statistics.mean(min(frame) for frame in rounds), 1)
    times[name + "_median_us"] = round(statistics.mean(statistics.median(frame) for frame in rounds), 1)


main()
