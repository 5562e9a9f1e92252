//! Reading `.cfg` files.

use super::{Darknet, DarknetError};
use crate::detection::{DetectionSpec, Head};
use crate::network::{Network, Shape};
use std::fmt::Write;

/// Limits that keep a hostile file from asking for all memory (guesses, far above any darknet file).
const MOST_SECTIONS: usize = 1_000;
const LARGEST: usize = 4_096;

/// A section: its name, line, and keys with their lines.
struct Section<'a> {
    name: &'a str,
    line: usize,
    keys: Vec<(&'a str, &'a str, usize)>,
}

struct Reader<'a> {
    file: &'a str,
    warnings: Vec<String>,
}

impl Reader<'_> {
    fn problem(&self, line: usize, expected: impl Into<String>, found: impl Into<String>) -> DarknetError {
        DarknetError::Cfg {
            file: self.file.to_owned(),
            line,
            expected: expected.into(),
            found: found.into(),
        }
    }

    fn sections<'a>(&self, text: &'a str) -> Result<Vec<Section<'a>>, DarknetError> {
        let mut sections: Vec<Section> = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let (number, line) = (number + 1, line.trim());
            if line.is_empty() || line.starts_with(['#', ';']) {
                continue;
            }
            if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
                sections.push(Section {
                    name: name.trim(),
                    line: number,
                    keys: Vec::new(),
                });
                continue;
            }
            let Some((key, value)) = line.split_once('=') else {
                return Err(self.problem(number, "[section] or key=value", format!("{line:?}")));
            };
            let Some(section) = sections.last_mut() else {
                return Err(self.problem(number, "[net] before any key", format!("{line:?}")));
            };
            // Remarks behind a value are usual, though darknet itself does not know them.
            let value = value.split('#').next().unwrap_or_default().trim();
            section.keys.push((key.trim(), value, number));
        }
        if sections.len() > MOST_SECTIONS {
            let found = sections.len().to_string();
            return Err(self.problem(1, format!("at most {MOST_SECTIONS} sections"), found));
        }
        Ok(sections)
    }

    fn text<'a>(&self, section: &Section<'a>, key: &str) -> Option<(&'a str, usize)> {
        let found = section.keys.iter().rev().find(|(name, ..)| *name == key);
        found.map(|(_, value, line)| (*value, *line))
    }

    fn whole(
        &self,
        section: &Section,
        key: &str,
        low: usize,
        high: usize,
        default: Option<usize>,
    ) -> Result<usize, DarknetError> {
        let expected = || format!("{key}=N with N from {low} to {high}");
        match (self.text(section, key), default) {
            (Some((value, line)), _) => match value.parse() {
                Ok(number) if (low..=high).contains(&number) => Ok(number),
                _ => Err(self.problem(line, expected(), format!("{value:?}"))),
            },
            (None, Some(default)) => Ok(default),
            (None, None) => {
                Err(self.problem(section.line, expected(), format!("[{}] without it", section.name)))
            }
        }
    }

    fn numbers<T: std::str::FromStr>(&self, section: &Section, key: &str) -> Result<Vec<T>, DarknetError> {
        let Some((value, line)) = self.text(section, key) else {
            let found = format!("[{}] without it", section.name);
            return Err(self.problem(section.line, format!("{key}=a list of numbers"), found));
        };
        value
            .split(',')
            .map(str::trim)
            .filter(|word| !word.is_empty())
            .map(|word| {
                word.parse()
                    .map_err(|_| self.problem(line, format!("{key}=a list of numbers"), format!("{word:?}")))
            })
            .collect()
    }

    /// Absolute numbers of layers: negative ones count from the section itself.
    fn layers(&self, section: &Section, key: &str, own: usize) -> Result<Vec<usize>, DarknetError> {
        let line = self.text(section, key).map_or(section.line, |(_, line)| line);
        let numbers: Vec<i64> = self.numbers(section, key)?;
        if numbers.is_empty() || numbers.len() > 64 {
            return Err(self.problem(line, "1 to 64 layers", numbers.len().to_string()));
        }
        numbers
            .into_iter()
            .map(|number| {
                let index = if number < 0 { own as i64 + number } else { number };
                usize::try_from(index)
                    .ok()
                    .filter(|index| *index < own)
                    .ok_or_else(|| {
                        let expected =
                            format!("an earlier layer: -{own} to -1 or 0 to {}", own.saturating_sub(1));
                        self.problem(line, expected, number.to_string())
                    })
            })
            .collect()
    }

    /// Keys that change the result and are unknown must not be passed over; the others are told.
    fn check_keys(
        &mut self,
        section: &Section,
        known: &[&str],
        harmless: &[(&str, &str)],
    ) -> Result<(), DarknetError> {
        for (key, value, line) in &section.keys {
            if known.contains(key) {
                continue;
            }
            match harmless.iter().find(|(name, _)| name == key) {
                Some((_, only)) if only.is_empty() || only == value => {}
                Some((_, only)) => {
                    return Err(self.problem(
                        *line,
                        format!("{key}={only}"),
                        format!("{value:?}, which this program lacks"),
                    ));
                }
                None => {
                    let text = format!(
                        "{}:{line}: key {key:?} of [{}] is not known and left out",
                        self.file, section.name
                    );
                    self.warnings.push(text);
                }
            }
        }
        Ok(())
    }
}

/// A layer's name in the network file and the shape of what it gives.
#[derive(Clone)]
struct Node {
    name: String,
    shape: Shape,
}

const KNOWN: &str = "convolutional, maxpool, avgpool, upsample, route, shortcut, dropout or yolo";

impl Darknet {
    /// Reads a `.cfg` file's text; `file` is for messages. Training keys of `[net]` are passed over, unknown ones of layers are
    /// warned of, and what changes the result and is not known here is refused.
    ///
    /// # Errors
    /// Anything that is no such network, at its line.
    pub fn parse(file: &str, text: &str) -> Result<Self, DarknetError> {
        let reader = Reader {
            file,
            warnings: Vec::new(),
        };
        let sections = reader.sections(text)?;
        let Some((net, layers)) = sections.split_first() else {
            return Err(reader.problem(1, "[net]", "nothing"));
        };
        if !["net", "network"].contains(&net.name) {
            return Err(reader.problem(net.line, "[net] first", format!("[{}]", net.name)));
        }
        let input = Shape {
            channels: reader.whole(net, "channels", 1, LARGEST, Some(3))?,
            height: reader.whole(net, "height", 1, LARGEST, None)?,
            width: reader.whole(net, "width", 1, LARGEST, None)?,
        };
        let stem = std::path::Path::new(file).file_stem();
        let name = stem.map_or("darknet".into(), |stem| stem.to_string_lossy().into_owned());
        let mut out = String::new();
        // Writing to a String cannot fail; the results are dropped throughout.
        let _ = writeln!(
            out,
            "name = {}\n[input]\nheight = {}\nwidth = {}\nchannels = {}",
            crate::text::quoted(&name),
            input.height,
            input.width,
            input.channels
        );
        let mut builder = Builder {
            reader,
            input,
            out,
            nodes: Vec::new(),
            heads: Vec::new(),
            classes: None,
        };
        for section in layers {
            builder.section(section)?;
        }
        builder.finish(file, net.line)
    }
}

struct Builder<'a> {
    reader: Reader<'a>,
    input: Shape,
    out: String,
    nodes: Vec<Node>,
    heads: Vec<(Head, String)>,
    classes: Option<usize>,
}

impl Builder<'_> {
    fn before(&self) -> Node {
        self.nodes.last().cloned().unwrap_or(Node {
            name: "input".to_owned(),
            shape: self.input,
        })
    }

    fn layer(&mut self, name: &str, kind: &str, from: &str, more: &str) {
        let _ = write!(
            self.out,
            "\n[[layer]]\nname = \"{name}\"\nkind = \"{kind}\"\nfrom = \"{from}\"\n{more}"
        );
    }

    fn window(
        &self,
        section: &Section,
        shape: Shape,
        size: usize,
        stride: usize,
        padding: usize,
    ) -> Result<Shape, DarknetError> {
        let along = |length: usize| (length + padding).checked_sub(size).map(|left| left / stride + 1);
        match (along(shape.height), along(shape.width)) {
            (Some(height), Some(width)) => Ok(Shape {
                height,
                width,
                ..shape
            }),
            _ => {
                let found = format!("size={size} on {shape}");
                Err(self
                    .reader
                    .problem(section.line, "a window that fits into its input", found))
            }
        }
    }

    fn section(&mut self, section: &Section) -> Result<(), DarknetError> {
        let own = self.nodes.len();
        let before = self.before();
        let name = format!("{}_{own}", section.name);
        let node = match section.name {
            "convolutional" | "conv" => self.convolution(section, &name, &before)?,
            "maxpool" | "max" => {
                self.reader
                    .check_keys(section, &["size", "stride", "padding"], &[])?;
                let stride = self.reader.whole(section, "stride", 1, 64, Some(1))?;
                let size = self.reader.whole(section, "size", 1, 64, Some(stride))?;
                let padding = self
                    .reader
                    .whole(section, "padding", 0, 2 * size - 2, Some(size - 1))?;
                let shape = self.window(section, before.shape, size, stride, padding)?;
                // Darknet pads by `padding` in all, half of it (rounded down) above and left. What no window reaches is left out.
                let reach = |length: usize, output: usize| {
                    ((output - 1) * stride + size).saturating_sub(length + padding / 2)
                };
                let top = padding / 2;
                let (bottom, right) = (
                    reach(before.shape.height, shape.height),
                    reach(before.shape.width, shape.width),
                );
                let more = format!(
                    "size = {size}\nstride = {stride}\npadding = [{top}, {top}, {bottom}, {right}]\n"
                );
                self.layer(&name, "max_pool", &before.name, &more);
                Node { name, shape }
            }
            "avgpool" => {
                self.reader.check_keys(section, &[], &[])?;
                self.layer(&name, "global_average_pool", &before.name, "");
                let shape = Shape::flat(before.shape.channels);
                Node { name, shape }
            }
            "upsample" => {
                self.reader.check_keys(section, &["stride"], &[("scale", "1")])?;
                let factor = self.reader.whole(section, "stride", 1, 16, Some(2))?;
                self.layer(&name, "upsample", &before.name, &format!("factor = {factor}\n"));
                let (height, width) = (before.shape.height * factor, before.shape.width * factor);
                if height.max(width) > LARGEST {
                    let found = format!("{height}x{width}");
                    return Err(self.reader.problem(
                        section.line,
                        format!("at most {LARGEST} rows and columns"),
                        found,
                    ));
                }
                let shape = Shape {
                    height,
                    width,
                    ..before.shape
                };
                Node { name, shape }
            }
            "dropout" => {
                self.reader.check_keys(section, &["probability"], &[])?;
                let (rate, line) = self
                    .reader
                    .text(section, "probability")
                    .unwrap_or(("0.5", section.line));
                let good = rate.parse().is_ok_and(|rate: f32| (0.0..=0.99).contains(&rate));
                if !good {
                    return Err(self
                        .reader
                        .problem(line, "probability from 0 to 0.99", format!("{rate:?}")));
                }
                let rate: f32 = rate.parse().unwrap_or_default();
                self.layer(&name, "dropout", &before.name, &format!("rate = {rate:?}\n"));
                Node { name, ..before }
            }
            "route" => self.route(section, &name, own)?,
            "shortcut" => self.shortcut(section, &name, own, &before)?,
            "yolo" => self.yolo(section, &name, &before)?,
            other => {
                let found = format!("[{other}], which this program lacks");
                return Err(self.reader.problem(section.line, KNOWN, found));
            }
        };
        self.nodes.push(node);
        Ok(())
    }

    fn activation(&self, section: &Section) -> Result<&'static str, DarknetError> {
        let (word, line) = self
            .reader
            .text(section, "activation")
            .unwrap_or(("logistic", section.line));
        Ok(match word {
            "linear" => "activation = \"linear\"\n",
            "leaky" => "activation = \"leaky_relu\"\nslope = 0.1\n",
            "relu" => "activation = \"relu\"\n",
            "relu6" => "activation = \"relu6\"\n",
            "elu" => "activation = \"elu\"\n",
            "logistic" => "activation = \"sigmoid\"\n",
            "tanh" => "activation = \"tanh\"\n",
            other => {
                let expected = "activation=linear, leaky, relu, relu6, elu, logistic or tanh";
                return Err(self.reader.problem(line, expected, format!("{other:?}")));
            }
        })
    }

    fn convolution(&mut self, section: &Section, name: &str, before: &Node) -> Result<Node, DarknetError> {
        let known = [
            "filters",
            "size",
            "stride",
            "pad",
            "padding",
            "activation",
            "batch_normalize",
        ];
        let harmless = [
            ("groups", "1"),
            ("dilation", "1"),
            ("binary", "0"),
            ("xnor", "0"),
            ("flipped", "0"),
        ];
        self.reader.check_keys(section, &known, &harmless)?;
        let filters = self.reader.whole(section, "filters", 1, LARGEST, Some(1))?;
        let size = self.reader.whole(section, "size", 1, 64, Some(1))?;
        let stride = self.reader.whole(section, "stride", 1, 64, Some(1))?;
        let mut padding = self.reader.whole(section, "padding", 0, size - 1, Some(0))?;
        if self.reader.whole(section, "pad", 0, 1, Some(0))? == 1 {
            padding = size / 2;
        }
        let normalises = self.reader.whole(section, "batch_normalize", 0, 1, Some(0))? == 1;
        let activation = self.activation(section)?;
        let shape = Shape {
            channels: filters,
            ..self.window(section, before.shape, size, stride, 2 * padding)?
        };
        let more = format!("filters = {filters}\nkernel = {size}\nstride = {stride}\npadding = {padding}\n");
        if normalises {
            self.layer(
                name,
                "convolution",
                &before.name,
                &format!("{more}bias = false\n"),
            );
            let norm = format!("{name}_norm");
            // Darknet keeps 0.99 of its rolling statistics and adds this to the variance.
            let more = format!("epsilon = 1e-5\nmomentum = 0.99\n{activation}");
            self.layer(&norm, "batch_norm", name, &more);
            return Ok(Node { name: norm, shape });
        }
        self.layer(name, "convolution", &before.name, &format!("{more}{activation}"));
        Ok(Node {
            name: name.to_owned(),
            shape,
        })
    }

    fn route(&mut self, section: &Section, name: &str, own: usize) -> Result<Node, DarknetError> {
        self.reader
            .check_keys(section, &["layers"], &[("groups", "1"), ("group_id", "0")])?;
        let from = self.reader.layers(section, "layers", own)?;
        let nodes: Vec<Node> = from.iter().map(|index| self.nodes[*index].clone()).collect();
        let [first, rest @ ..] = &nodes[..] else {
            return Err(self.reader.problem(section.line, "layers=…", "none"));
        };
        if rest.is_empty() {
            return Ok(first.clone());
        }
        let differs =
            |node: &&Node| (node.shape.height, node.shape.width) != (first.shape.height, first.shape.width);
        if let Some(other) = rest.iter().find(differs) {
            let found = format!("{} and {}", first.shape, other.shape);
            return Err(self
                .reader
                .problem(section.line, "layers of equal height and width", found));
        }
        let names: Vec<String> = nodes.iter().map(|node| format!("\"{}\"", node.name)).collect();
        let _ = write!(
            self.out,
            "\n[[layer]]\nname = \"{name}\"\nkind = \"concatenate\"\nfrom = [{}]\n",
            names.join(", ")
        );
        let channels = nodes.iter().map(|node| node.shape.channels).sum();
        Ok(Node {
            name: name.to_owned(),
            shape: Shape {
                channels,
                ..first.shape
            },
        })
    }

    fn shortcut(
        &mut self,
        section: &Section,
        name: &str,
        own: usize,
        before: &Node,
    ) -> Result<Node, DarknetError> {
        self.reader.check_keys(section, &["from", "activation"], &[])?;
        let from = self.reader.layers(section, "from", own)?;
        let [other] = from[..] else {
            return Err(self
                .reader
                .problem(section.line, "from=one layer", from.len().to_string()));
        };
        let other = self.nodes[other].clone();
        if other.shape != before.shape {
            let found = format!("{} and {}", before.shape, other.shape);
            return Err(self.reader.problem(section.line, "layers of equal shape", found));
        }
        let activation = self.activation(section)?;
        let _ = write!(
            self.out,
            "\n[[layer]]\nname = \"{name}\"\nkind = \"add\"\nfrom = [\"{}\", \"{}\"]\n{activation}",
            before.name, other.name
        );
        Ok(Node {
            name: name.to_owned(),
            ..other
        })
    }

    fn yolo(&mut self, section: &Section, name: &str, before: &Node) -> Result<Node, DarknetError> {
        let training = ["jitter", "ignore_thresh", "truth_thresh", "random", "max"].map(|key| (key, ""));
        let mut harmless = training.to_vec();
        harmless.push(("scale_x_y", "1"));
        self.reader
            .check_keys(section, &["mask", "anchors", "classes", "num"], &harmless)?;
        let classes = self.reader.whole(section, "classes", 1, LARGEST, None)?;
        let first = *self.classes.get_or_insert(classes);
        if classes != first {
            let found = classes.to_string();
            return Err(self.reader.problem(
                section.line,
                format!("classes={first} as in the first [yolo]"),
                found,
            ));
        }
        let sizes: Vec<f32> = self.reader.numbers(section, "anchors")?;
        let line = self
            .reader
            .text(section, "anchors")
            .map_or(section.line, |(_, line)| line);
        let good = sizes.iter().all(|size| (0.01..=1e5).contains(size));
        if !good || sizes.is_empty() || !sizes.len().is_multiple_of(2) || sizes.len() > 128 {
            let found = format!("{} numbers", sizes.len());
            return Err(self
                .reader
                .problem(line, "1 to 64 pairs of width and height above 0", found));
        }
        let all: Vec<[f32; 2]> = sizes.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
        if self.reader.whole(section, "num", 1, 64, Some(all.len()))? != all.len() {
            return Err(self.reader.problem(
                section.line,
                format!("num={}, as there are anchors", all.len()),
                "another number",
            ));
        }
        let mask: Vec<usize> = match self.reader.text(section, "mask") {
            Some(_) => self.reader.numbers(section, "mask")?,
            None => (0..all.len()).collect(),
        };
        let anchors: Option<Vec<[f32; 2]>> = mask.iter().map(|index| all.get(*index).copied()).collect();
        let Some(anchors) = anchors.filter(|anchors| !anchors.is_empty() && anchors.len() <= 64) else {
            let found = format!("{mask:?}");
            return Err(self.reader.problem(
                section.line,
                format!("mask=numbers from 0 to {}", all.len() - 1),
                found,
            ));
        };
        let channels = anchors.len() * (classes + 5);
        if before.shape.channels != channels {
            return Err(self.reader.problem(
                section.line,
                format!(
                    "{channels} channels before it ({} anchors of {classes} classes and 5 values): filters={channels}",
                    anchors.len()
                ),
                before.shape.channels.to_string(),
            ));
        }
        self.layer(name, "flatten", &before.name, "");
        let head = Head {
            height: before.shape.height,
            width: before.shape.width,
            anchors_px: anchors,
        };
        self.heads.push((head, name.to_owned()));
        // A later route may go back to what came before the head.
        Ok(before.clone())
    }

    fn finish(mut self, file: &str, line: usize) -> Result<Darknet, DarknetError> {
        if self.heads.is_empty() {
            return Err(self.reader.problem(line, "at least one [yolo]", "none"));
        }
        if self.heads.len() > 1 {
            let names: Vec<String> = self.heads.iter().map(|(_, name)| format!("\"{name}\"")).collect();
            let _ = write!(
                self.out,
                "\n[[layer]]\nname = \"heads\"\nkind = \"concatenate\"\nfrom = [{}]\n",
                names.join(", ")
            );
        }
        let network = Network::parse(file, &self.out).map_err(|error| {
            self.reader.problem(
                line,
                "a network whose layers fit and are all used",
                error.to_string(),
            )
        })?;
        let classes = (0..self.classes.unwrap_or(0))
            .map(|class| class.to_string())
            .collect();
        Ok(Darknet {
            detection: DetectionSpec {
                classes,
                heads: self.heads.into_iter().map(|(head, _)| head).collect(),
            },
            network,
            warnings: self.reader.warnings,
        })
    }
}
