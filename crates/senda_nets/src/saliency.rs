//! What a network looks at: VisualBackProp (Bojarski et al. 2016, "VisualBackProp: visualizing CNNs for autonomous driving").

use crate::inference::Inference;
use crate::input::InputSpec;
use crate::model::Model;
use crate::network::{Activation, Kind, Layer, Network, Shape};
use crate::preparer::Eye;
use senda_core::{Channels, Image};

/// Finds the parts of a frame that a network's answer rests on.
///
/// From the last layer with a picture back to the input: the channels of each layer with an activation are averaged, multiplied
/// with the mask so far, and spread over the layer's input by a transposed convolution of ones with the layer's own kernel, stride
/// and padding. The mask is stretched to 0..1 only at the end. Where a network splits, the first of a layer's inputs is followed.
///
/// Of convolutional LSTMs, and of activations that mean something below zero, the amounts are averaged; of all others what is above
/// zero, which is what a ReLU passes on.
#[derive(Debug, Clone)]
pub struct Saliency {
    steps: Vec<Step>,
    mask: Vec<f32>,
    spare: Vec<f32>,
}

/// One layer on the way back.
#[derive(Debug, Clone)]
struct Step {
    layer: usize,
    /// How its channels are averaged; `None`: it only passes on.
    mean: Option<Mean>,
    spread: Spread,
    input: Shape,
    output: Shape,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Mean {
    AboveZero,
    Amounts,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Spread {
    /// The input has the output's size.
    Same,
    /// Windows of `kernel` at every `stride`, the first one this far above and left of the input.
    Windows {
        kernel: [usize; 2],
        stride: [usize; 2],
        before: [usize; 2],
    },
    /// Rows and columns were repeated.
    Repeated(usize),
}

impl Step {
    fn of(index: usize, layer: &Layer) -> Self {
        let input = layer.inputs[0];
        let spread = match layer.kind {
            Kind::Convolution {
                kernel,
                stride,
                padding,
                ..
            }
            | Kind::DepthwiseConvolution {
                kernel,
                stride,
                padding,
                ..
            }
            | Kind::ConvolutionalLstm {
                kernel,
                stride,
                padding,
                ..
            } => windows(kernel, stride, padding.amounts(input, kernel, stride)),
            Kind::MaxPool {
                size,
                stride,
                padding,
            }
            | Kind::AveragePool {
                size,
                stride,
                padding,
            } => windows(size, stride, padding.amounts(input, size, stride)),
            Kind::Upsample { factor } => Spread::Repeated(factor),
            _ => Spread::Same,
        };
        let mean = match (&layer.kind, layer.activation) {
            (Kind::ConvolutionalLstm { .. }, _) | (_, Activation::Tanh) => Some(Mean::Amounts),
            (_, Activation::Linear) => None,
            _ => Some(Mean::AboveZero),
        };
        Self {
            layer: index,
            mean,
            spread,
            input,
            output: layer.output,
        }
    }
}

fn windows(kernel: [usize; 2], stride: [usize; 2], [top, left, ..]: [usize; 4]) -> Spread {
    Spread::Windows {
        kernel,
        stride,
        before: [top, left],
    }
}

impl Saliency {
    /// For a network; `None` where no layer's output is a picture.
    pub fn new(network: &Network) -> Option<Self> {
        let layers = network.layers();
        let mut steps = Vec::new();
        let mut node = layers.len();
        while let Some(index) = node.checked_sub(1) {
            let layer = &layers[index];
            if layer.output.plane() > 1 {
                steps.push(Step::of(index, layer));
            }
            node = layer.from[0];
        }
        if !steps.iter().any(|step| step.mean.is_some()) {
            return None;
        }
        let largest = steps
            .iter()
            .map(|step| step.input.plane().max(step.output.plane()))
            .max()?;
        Some(Self {
            steps,
            mask: vec![0.0; largest],
            spare: vec![0.0; largest],
        })
    }

    /// The mask for the input of the last [`Inference::run`], row by row in the input's size, 0..1. All 0 where no layer answered
    /// anything. `inference` runs the network that this was made for, one input at a time. Allocates nothing.
    pub fn of(&mut self, inference: &Inference) -> &[f32] {
        let mut len = 0;
        for (number, step) in self.steps.iter().enumerate() {
            let plane = step.output.plane();
            if number == 0 {
                self.mask[..plane].fill(1.0);
            }
            if let Some(mean) = step.mean {
                let values = &inference.activations(step.layer)[..step.output.len()];
                average(mean, values, &mut self.spare[..plane]);
                let mut most = 0.0f32;
                for (mask, value) in self.mask.iter_mut().zip(&self.spare[..plane]) {
                    *mask *= value;
                    most = most.max(*mask);
                }
                // A factor that the stretching at the end takes out again; without it small values of many layers vanish.
                if most > 0.0 {
                    self.mask[..plane].iter_mut().for_each(|mask| *mask /= most);
                }
            }
            spread(step, &self.mask, &mut self.spare);
            if step.spread != Spread::Same {
                std::mem::swap(&mut self.mask, &mut self.spare);
            }
            len = step.input.plane();
        }
        let mask = &mut self.mask[..len];
        let low = mask.iter().copied().fold(f32::INFINITY, f32::min);
        let high = mask.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        for value in &mut *mask {
            *value = if high > low {
                (*value - low) / (high - low)
            } else {
                0.0
            };
        }
        mask
    }
}

fn average(mean: Mean, values: &[f32], out: &mut [f32]) {
    let share = out.len() as f32 / values.len() as f32;
    out.fill(0.0);
    for channel in values.chunks_exact(out.len()) {
        for (sum, value) in out.iter_mut().zip(channel) {
            *sum += match mean {
                Mean::AboveZero => value.max(0.0),
                Mean::Amounts => value.abs(),
            };
        }
    }
    out.iter_mut().for_each(|sum| *sum *= share);
}

/// The transposed convolution of ones.
fn spread(step: &Step, mask: &[f32], out: &mut [f32]) {
    let (input, output) = (step.input, step.output);
    let out = &mut out[..input.plane()];
    match step.spread {
        Spread::Same => {}
        Spread::Windows {
            kernel,
            stride,
            before,
        } => {
            out.fill(0.0);
            // Rows or columns that a window covers, cut off at the picture's border.
            let covered = |at: usize, i: usize, size: usize| {
                let first = at * stride[i];
                let last = (first + kernel[i]).saturating_sub(before[i]).min(size);
                first.saturating_sub(before[i])..last
            };
            for v in 0..output.height {
                for u in 0..output.width {
                    let value = mask[v * output.width + u];
                    for y in covered(v, 0, input.height) {
                        for x in covered(u, 1, input.width) {
                            out[y * input.width + x] += value;
                        }
                    }
                }
            }
        }
        Spread::Repeated(factor) => {
            for (at, sum) in out.iter_mut().enumerate() {
                let (v, u) = (at / input.width, at % input.width);
                *sum = (0..factor * factor)
                    .map(|k| mask[(v * factor + k / factor) * output.width + u * factor + k % factor])
                    .sum();
            }
        }
    }
}

/// A model that shows for each frame of a run what its answer rests on. Allocates only when the size of the frames changes.
#[derive(Debug, Clone)]
pub struct Gaze {
    spec: InputSpec,
    eye: Eye,
    inference: Inference,
    saliency: Saliency,
}

impl Gaze {
    /// Of a model; `None` where no layer's output is a picture.
    pub fn new(model: &Model) -> Option<Self> {
        Some(Self {
            saliency: Saliency::new(&model.network)?,
            spec: model.input.clone(),
            eye: Eye::new(&model.input),
            inference: model.inference(),
        })
    }

    /// How frames are prepared.
    pub fn spec(&self) -> &InputSpec {
        &self.spec
    }

    /// The mask for the next frame of the run; see [`Saliency::of`].
    ///
    /// # Panics
    /// When the frame has no pixels.
    pub fn look(&mut self, frame: &Image) -> &[f32] {
        self.inference.run(self.eye.see(frame));
        self.saliency.of(&self.inference)
    }

    /// The mask for the last frame again.
    pub fn mask(&self) -> &[f32] {
        &self.saliency.mask[..self.spec.width * self.spec.height]
    }

    /// What the network answered to the last frame.
    pub fn answers(&self) -> &[f32] {
        let last = self.inference.network().layers().len() - 1;
        self.inference.activations(last)
    }

    /// Frames are missing: stacked frames begin anew.
    pub fn skip(&mut self) {
        self.eye.forget();
    }

    /// A run begins: nothing is remembered.
    pub fn forget(&mut self) {
        self.eye.forget();
        self.inference.reset_state();
    }
}

/// How much of the frame's own picture is left where the mask is 1.
const LEFT_OF_PICTURE: f32 = 0.25;
/// How much light is left of what was cut off.
const LEFT_OF_CUT_OFF: f32 = 0.45;

/// The colour of a mask's value: black, red, yellow.
pub fn heat(value: f32) -> [u8; 3] {
    let part = |low: f32, high: f32| ((value - low) / (high - low)).clamp(0.0, 1.0);
    [part(0.0, 0.5), 0.9 * part(0.35, 1.0), 0.2 * part(0.6, 1.0)].map(|light| (255.0 * light).round() as u8)
}

/// A mask over the frame that it belongs to: red to yellow where the network looks, darker what it was not shown.
///
/// # Panics
/// When the mask has another size than the input.
pub fn overlay(mask: &[f32], spec: &InputSpec, frame: &Image) -> Image {
    assert_eq!(mask.len(), spec.width * spec.height, "a mask of another size");
    let mut out = Image::new(frame.width(), frame.height(), Channels::Rgb);
    let along = |at: usize, size: usize, cut: [f64; 2], count: usize| {
        let part = ((at as f64 + 0.5) / size as f64 - cut[0]) / (1.0 - cut[0] - cut[1]);
        (0.0..1.0).contains(&part).then(|| {
            let place = (part * count as f64 - 0.5).clamp(0.0, (count - 1) as f64);
            let first = (place as usize).min(count.saturating_sub(2));
            (first, (first + 1).min(count - 1), (place - first as f64) as f32)
        })
    };
    let crop = spec.crop;
    let channels = frame.channels().count();
    for v in 0..frame.height() {
        let rows = along(v, frame.height(), [crop.top, crop.bottom], spec.height);
        let row = frame.row(v);
        for u in 0..frame.width() {
            let own = &row[u * channels..(u + 1) * channels];
            let own = |channel: usize| f32::from(own[channel.min(channels - 1)]);
            let columns = along(u, frame.width(), [crop.left, crop.right], spec.width);
            let to = &mut out.row_mut(v)[3 * u..3 * u + 3];
            let (Some((top, bottom, down)), Some((left, right, across))) = (rows, columns) else {
                for (channel, to) in to.iter_mut().enumerate() {
                    *to = (own(channel) * LEFT_OF_CUT_OFF) as u8;
                }
                continue;
            };
            let at = |y: usize, x: usize| mask[y * spec.width + x];
            let upper = at(top, left) * (1.0 - across) + at(top, right) * across;
            let lower = at(bottom, left) * (1.0 - across) + at(bottom, right) * across;
            let value = upper * (1.0 - down) + lower * down;
            for (channel, (to, heat)) in to.iter_mut().zip(heat(value)).enumerate() {
                let kept = 1.0 - value * (1.0 - LEFT_OF_PICTURE);
                *to = (own(channel) * kept + f32::from(heat) * value).round().min(255.0) as u8;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::Weights;

    fn network(layers: &str, size: [usize; 2]) -> Network {
        let [height, width] = size;
        let mut text = format!("[input]\nheight = {height}\nwidth = {width}\nchannels = 1\n");
        for layer in layers.split(';') {
            text += "[[layer]]\n";
            text += &layer.replace(',', "\n");
            text += "\n";
        }
        Network::parse("test.toml", &text).unwrap()
    }

    fn mask(network: &Network, weights: &Weights, input: &[f32]) -> Vec<f32> {
        let mut inference = Inference::new(network, weights, 1);
        inference.run(input);
        Saliency::new(network).unwrap().of(&inference).to_vec()
    }

    /// Worked out by hand: one kernel of ones, one bright pixel.
    #[test]
    fn one_layer_spreads_its_answer_over_what_each_window_saw() {
        let network = network(
            "kind = \"convolution\",filters = 1,kernel = 2,bias = false,activation = \"relu\";kind = \"flatten\";kind = \"dense\",units = 1",
            [1, 5].map(|n| n + 1),
        );
        let mut weights = Weights::random(&network, 1);
        weights.values.fill(1.0);
        let mut input = vec![0.0; 12];
        input[2] = 1.0;
        // Windows 1 and 2 of the single row of five see the pixel; each covers two columns and both rows.
        let row = [0.0, 0.5, 1.0, 0.5, 0.0, 0.0];
        assert_eq!(mask(&network, &weights, &input), [row, row].concat());
    }

    #[test]
    fn two_layers_and_a_pool_agree_with_the_plain_formula() {
        let network = network(
            "kind = \"convolution\",filters = 3,kernel = 3,activation = \"relu\";kind = \"max_pool\",size = 2;kind = \"convolution\",filters = 2,kernel = 3,stride = 2,padding = \"same\",activation = \"relu\";kind = \"flatten\";kind = \"dense\",units = 1",
            [13, 17],
        );
        let weights = Weights::random(&network, 5);
        let input: Vec<f32> = (0..13 * 17)
            .map(|i| ((i * 37 % 101) as f32 - 40.0) / 50.0)
            .collect();
        let mut inference = Inference::new(&network, &weights, 1);
        inference.run(&input);
        let found = Saliency::new(&network).unwrap().of(&inference).to_vec();

        // 11x15, pooled to 5x7, then 3x4 with a row and a column of zeros around.
        let mean = |layer: usize, channels: usize, plane: usize| -> Vec<f64> {
            let values = inference.activations(layer);
            (0..plane)
                .map(|i| {
                    (0..channels)
                        .map(|c| f64::from(values[c * plane + i].max(0.0)))
                        .sum::<f64>()
                })
                .collect()
        };
        let transposed =
            |mask: &[f64], from: [usize; 2], to: [usize; 2], kernel: usize, stride: usize, pad: i64| {
                let mut out = vec![0.0; to[0] * to[1]];
                for (i, value) in mask.iter().enumerate() {
                    let (v, u) = (
                        (i / from[1] * stride) as i64 - pad,
                        (i % from[1] * stride) as i64 - pad,
                    );
                    for y in v..v + kernel as i64 {
                        for x in u..u + kernel as i64 {
                            if y >= 0 && x >= 0 && y < to[0] as i64 && x < to[1] as i64 {
                                out[y as usize * to[1] + x as usize] += value;
                            }
                        }
                    }
                }
                out
            };
        let deep = transposed(&mean(2, 2, 12), [3, 4], [5, 7], 3, 2, 1);
        let pooled = transposed(&deep, [5, 7], [11, 15], 2, 2, 0);
        let product: Vec<f64> = mean(0, 3, 165).iter().zip(&pooled).map(|(a, b)| a * b).collect();
        let whole = transposed(&product, [11, 15], [13, 17], 3, 1, 0);
        let (low, high) = whole.iter().fold((f64::INFINITY, 0.0f64), |(low, high), v| {
            (low.min(*v), high.max(*v))
        });
        assert!(high > low);
        for (found, whole) in found.iter().zip(&whole) {
            assert!((f64::from(*found) - (whole - low) / (high - low)).abs() < 1e-4);
        }
    }

    #[test]
    fn every_ready_network_that_drives_can_be_looked_into() {
        for name in [
            "pilotnet",
            "tinypilotnet",
            "deeperlstm-tinypilotnet",
            "early-lstm-tinypilotnet",
            "lane-small",
        ] {
            let network = Network::named(name).unwrap();
            let input: Vec<f32> = (0..network.input().len())
                .map(|i| (i % 13) as f32 / 13.0)
                .collect();
            let mask = mask(&network, &Weights::random(&network, 2), &input);
            assert_eq!(mask.len(), network.input().plane(), "{name}");
            let most = mask.iter().copied().fold(0.0, f32::max);
            assert!(
                most == 1.0 && mask.iter().all(|v| (0.0..=1.0).contains(v)),
                "{name}"
            );
        }
    }

    #[test]
    fn a_network_without_pictures_has_no_mask_and_a_blind_one_an_empty_one() {
        let flat = network("kind = \"flatten\";kind = \"dense\",units = 1", [4, 4]);
        assert!(Saliency::new(&flat).is_none());
        let blind = Network::named("tinypilotnet").unwrap();
        let mut weights = Weights::random(&blind, 1);
        weights.values.fill(0.0);
        assert!(mask(&blind, &weights, &vec![0.5; 512]).iter().all(|v| *v == 0.0));
    }

    #[test]
    fn an_overlay_lies_where_the_crop_was() {
        let spec = InputSpec {
            crop: crate::Crop {
                top: 0.5,
                ..crate::Crop::default()
            },
            ..InputSpec::of(Shape {
                channels: 1,
                height: 2,
                width: 2,
            })
        };
        let frame = Image::from_pixels(8, 8, Channels::Gray, vec![100; 64]).unwrap();
        let out = overlay(&[0.0, 0.0, 1.0, 0.0], &spec, &frame);
        assert_eq!(out.row(0)[..3], [45; 3]);
        assert_eq!(out.row(7)[..3], [255, 230 + 25, 51 + 25]);
        assert_eq!(out.row(7)[21..], [100; 3]);
    }
}
