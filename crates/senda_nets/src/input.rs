//! What a network sees of a camera frame, as data: [`crate::Preparer`] and [`crate::Eye`] do it, for training and driving alike.

use crate::network::{Network, Shape};
use crate::preparer::Preparer;
use senda_geom::Camera;
use serde::{Deserialize, Serialize};

/// What a network sees of a camera frame. In a model file it says all that a driver needs.
///
/// The frame is cropped, shrunk by averaging areas (enlarged linearly), taken to the colour space and rounded to bytes; edges are
/// added if wanted, and the frames before it stand before it if the network is shown several. A network's input is
/// `byte * scale + offset`, channel after channel, row after row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputSpec {
    /// Width (px).
    pub width: usize,
    /// Height (px).
    pub height: usize,
    /// Colour space; its number of channels times `stack` is the network's.
    pub colour: Colour,
    /// What is cut off before.
    #[serde(default)]
    pub crop: Crop,
    /// Edges that are added to the shrunk frame (B3 in SPEC: prefix Edge).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edges: Option<Edges>,
    /// How many frames the network is shown at once, the newest last. 1: no more than the present one. At the beginning of a run
    /// and after a gap the first frame stands for those before it.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub stack: usize,
    /// Value of a byte: factor. 2/255 for -1..1.
    #[serde(default = "two_255ths")]
    pub scale: f32,
    /// Value of byte 0. -1 for -1..1.
    #[serde(default = "minus_one")]
    pub offset: f32,
    /// The camera that it was trained with; `None`: nobody knows, any camera is accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
}

fn one() -> usize {
    1
}

fn is_one(count: &usize) -> bool {
    *count == 1
}

fn two_255ths() -> f32 {
    2.0 / 255.0
}

fn minus_one() -> f32 {
    -1.0
}

/// Colour space of a network's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Colour {
    /// Red, green, blue.
    #[default]
    Rgb,
    /// Luminance (0.299, 0.587, 0.114).
    Grey,
    /// Saturation of HSV, 0..255 (B3 in SPEC).
    Saturation,
}

impl Colour {
    /// Number of channels.
    pub fn channels(self) -> usize {
        match self {
            Self::Rgb => 3,
            Self::Grey | Self::Saturation => 1,
        }
    }

    /// The word that files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Grey => "grey",
            Self::Saturation => "saturation",
        }
    }

    /// By the word that files use.
    pub fn named(word: &str) -> Option<Self> {
        [Self::Rgb, Self::Grey, Self::Saturation]
            .into_iter()
            .find(|colour| colour.name() == word)
    }
}

/// Parts of the frame (0..1 of its height or width) that are cut off.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Crop {
    /// From above.
    pub top: f64,
    /// From below.
    pub bottom: f64,
    /// From the left.
    pub left: f64,
    /// From the right.
    pub right: f64,
}

/// Edges to be added to a network's input, as document B does it: Canny's detector finds them on the saturation of the whole frame,
/// they are shrunk like the picture, and both are summed (at most 255), every channel alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Edges {
    /// Canny's lower threshold, in the units of Sobel's kernels (a step of one grey level is 4).
    pub low: u16,
    /// Canny's upper threshold.
    pub high: u16,
}

impl Default for Edges {
    /// The document does not tell; OpenCV's example has these.
    fn default() -> Self {
        Self { low: 100, high: 200 }
    }
}

/// What an experiment says about the preparation of frames; what it leaves open, the network decides.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct View {
    /// Colour space.
    pub colour: Option<Colour>,
    /// What is cut off.
    pub crop: Crop,
    /// Edges that are added.
    pub edges: Option<Edges>,
    /// Frames that the network is shown at once.
    pub stack: Option<usize>,
}

/// Frames shown at once: half a second of a fast camera is more than any driver here uses (a guess).
pub(crate) const LARGEST_STACK: usize = 16;

impl InputSpec {
    /// For a network, where an experiment leaves open what the network's file says about its input.
    ///
    /// # Errors
    /// What does not fit, in words.
    pub fn for_network(network: &Network, view: &View) -> Result<Self, String> {
        let stack = view.stack.unwrap_or(network.stack());
        let shape = network.input();
        if !(1..=LARGEST_STACK).contains(&stack) || !shape.channels.is_multiple_of(stack) {
            return Err(format!(
                "stack: expected 1 to {LARGEST_STACK} frames that share the network's {} channels, but found {stack}",
                shape.channels
            ));
        }
        let channels = shape.channels / stack;
        if let Some(colour) = view.colour.filter(|colour| colour.channels() != channels) {
            let fitting = match channels {
                1 => "grey or saturation",
                3 => "rgb",
                _ => "none",
            };
            return Err(format!(
                "colour: expected {fitting} for the {channels} channels that the network takes of a frame, but found {} with {}; leave \
                 --colour out, or change `channels` under [input] of the network's file",
                colour.name(),
                colour.channels()
            ));
        }
        let of_frame = Self::of(Shape { channels, ..shape });
        let spec = Self {
            colour: view.colour.or(network.colour()).unwrap_or(of_frame.colour),
            crop: view.crop,
            edges: view.edges,
            stack,
            ..of_frame
        };
        match spec.fault(shape) {
            Some(fault) => Err(fault),
            None => Ok(spec),
        }
    }

    /// For an input of this shape: -1..1, nothing cut off. One channel is grey, three are red, green, blue.
    pub fn of(shape: Shape) -> Self {
        Self {
            width: shape.width,
            height: shape.height,
            colour: if shape.channels == 3 {
                Colour::Rgb
            } else {
                Colour::Grey
            },
            crop: Crop::default(),
            edges: None,
            stack: 1,
            scale: two_255ths(),
            offset: minus_one(),
            camera: None,
        }
    }

    /// Number of channels of all frames that the network is shown at once.
    pub fn channels(&self) -> usize {
        self.colour.channels() * self.stack
    }

    /// Bytes of one frame.
    pub fn frame_len(&self) -> usize {
        self.colour.channels() * self.height * self.width
    }

    /// Values of one input.
    pub fn len(&self) -> usize {
        self.channels() * self.height * self.width
    }

    /// Whether there is nothing to see.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What is wrong with it, for a network with this input.
    pub fn fault(&self, shape: Shape) -> Option<String> {
        let own = [self.channels(), self.height, self.width];
        let theirs = [shape.channels, shape.height, shape.width];
        if own != theirs {
            return Some(format!(
                "expected an input of {} channels, {} rows, {} columns as the network has, but found {}, {}, {}",
                theirs[0], theirs[1], theirs[2], own[0], own[1], own[2]
            ));
        }
        let crop = self.crop;
        let parts = [crop.top, crop.bottom, crop.left, crop.right];
        if parts.iter().any(|part| !(0.0..1.0).contains(part))
            || crop.top + crop.bottom > 0.95
            || crop.left + crop.right > 0.95
        {
            return Some(format!(
                "crop: expected parts of 0 or more that leave a twentieth of the frame each way, but found top {}, bottom {}, left {}, right {}",
                crop.top, crop.bottom, crop.left, crop.right
            ));
        }
        if !(1..=LARGEST_STACK).contains(&self.stack) {
            return Some(format!(
                "stack: expected 1 to {LARGEST_STACK} frames, but found {}",
                self.stack
            ));
        }
        if let Some(Edges { low, high }) = self.edges
            && (low > high || high == 0)
        {
            return Some(format!(
                "edges: expected a lower threshold up to the upper one, which is above 0, but found {low} and {high}"
            ));
        }
        if !(self.scale.is_finite() && self.offset.is_finite() && self.scale != 0.0) {
            return Some(format!(
                "expected a finite scale other than 0 and a finite offset, but found {} and {}",
                self.scale, self.offset
            ));
        }
        None
    }

    /// Prepares frames of one size.
    ///
    /// # Panics
    /// When the size is 0.
    pub fn preparer(&self, frame_width: usize, frame_height: usize) -> Preparer {
        Preparer::new(self, frame_width, frame_height)
    }

    /// Bytes to the values that the network takes; both of the same length.
    pub fn normalise(&self, bytes: &[u8], values: &mut [f32]) {
        for (value, byte) in values.iter_mut().zip(bytes) {
            *value = f32::from(*byte) * self.scale + self.offset;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_named() {
        let shape = Shape {
            channels: 3,
            height: 66,
            width: 200,
        };
        assert_eq!(InputSpec::of(shape).fault(shape), None);
        assert!(
            InputSpec {
                colour: Colour::Grey,
                ..InputSpec::of(shape)
            }
            .fault(shape)
            .unwrap()
            .contains("3 channels")
        );
        let mut cut = InputSpec::of(shape);
        cut.crop.top = 0.96;
        let fault = cut.fault(shape).unwrap();
        assert!(
            fault.contains("found top 0.96, bottom 0, left 0, right 0"),
            "{fault}"
        );
    }

    #[test]
    fn what_an_experiment_leaves_open_the_network_says() {
        let spec = |name: &str, view: View| InputSpec::for_network(&Network::named(name).unwrap(), &view);
        let plain = spec("tinypilotnet", View::default()).unwrap();
        assert_eq!((plain.colour, plain.stack), (Colour::Saturation, 1));
        let rgb = spec("tinypilotnet-rgb", View::default()).unwrap();
        assert_eq!(rgb.colour, Colour::Rgb);
        let stacked = spec("stacked-tinypilotnet", View::default()).unwrap();
        assert_eq!(
            (stacked.colour, stacked.stack, stacked.channels()),
            (Colour::Saturation, 4, 4)
        );
        let view = View {
            colour: Some(Colour::Grey),
            edges: Some(Edges::default()),
            ..View::default()
        };
        let grey = spec("tinypilotnet", view).unwrap();
        assert_eq!((grey.colour, grey.edges), (Colour::Grey, Some(Edges::default())));
        let rgb_alone = InputSpec::for_network(&Network::named("pilotnet").unwrap(), &view).unwrap_err();
        for words in ["expected rgb", "3 channels", "grey with 1", "--colour", "[input]"] {
            assert!(rgb_alone.contains(words), "{rgb_alone}");
        }
        let stack = |stack| View {
            stack: Some(stack),
            ..View::default()
        };
        assert!(spec("tinypilotnet", stack(0)).unwrap_err().contains("stack"));
        assert!(spec("tinypilotnet", stack(2)).unwrap_err().contains("1 channels"));
        assert!(
            spec("stacked-tinypilotnet", stack(2))
                .unwrap_err()
                .contains("4 channels")
        );
        let edges = View {
            edges: Some(Edges { low: 9, high: 3 }),
            ..View::default()
        };
        assert!(spec("tinypilotnet", edges).unwrap_err().contains("9 and 3"));
    }

    /// Files of models that were written before there were edges and stacks.
    #[test]
    fn old_specifications_are_read_and_plain_ones_written_as_they_were() {
        let old = r#"{"width":32,"height":16,"colour":"saturation","crop":{"top":0.0,"bottom":0.0,"left":0.0,"right":0.0},"scale":0.007843138,"offset":-1.0}"#;
        let spec: InputSpec = serde_json::from_str(old).unwrap();
        assert_eq!((spec.edges, spec.stack), (None, 1));
        assert_eq!(serde_json::to_string(&spec).unwrap(), old);
    }
}
