//! Pooling and depthwise convolution: windows that stay within a channel.

use crate::math;
use crate::network::{Padding, Shape};

/// A window moving over every channel.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    input: Shape,
    output: Shape,
    size: [usize; 2],
    stride: [usize; 2],
    padding: [usize; 4],
}

impl Window {
    pub(crate) fn new(
        input: Shape,
        output: Shape,
        size: [usize; 2],
        stride: [usize; 2],
        padding: Padding,
    ) -> Self {
        Self {
            input,
            output,
            size,
            stride,
            padding: padding.amounts(input, size, stride),
        }
    }

    /// First and one past the last place of the input along one direction (0 vertical, 1 horizontal).
    #[inline(always)]
    fn span(&self, direction: usize, index: usize, limit: usize) -> (usize, usize) {
        let start = index * self.stride[direction];
        let before = self.padding[direction];
        let end = (start + self.size[direction]).saturating_sub(before).min(limit);
        (start.saturating_sub(before).min(end), end)
    }

    /// Largest value of every window.
    pub(crate) fn max(&self, image: &[f32], result: &mut [f32]) {
        if self.size == [2, 2] && self.stride == [2, 2] && self.padding == [0; 4] {
            return self.max_of_two(image, result);
        }
        self.each(|plane, index, y, x| {
            let mut best = f32::NEG_INFINITY;
            self.places(y, x, |place| {
                let value = image[plane + place];
                // A NaN wins, as it should: a broken network must not look whole.
                best = if value > best || value.is_nan() {
                    value
                } else {
                    best
                };
            });
            result[index] = best;
        });
    }

    fn max_of_two(&self, image: &[f32], result: &mut [f32]) {
        let (width, rows) = (self.input.width, self.output.height);
        let planes = image.chunks_exact(self.input.plane()).take(self.input.channels);
        for (plane, result) in planes.zip(result.chunks_exact_mut(self.output.plane())) {
            for y in 0..rows {
                let (upper, lower) = plane[2 * y * width..][..2 * width].split_at(width);
                larger_of_four(
                    upper,
                    lower,
                    &mut result[y * self.output.width..][..self.output.width],
                );
            }
        }
    }

    /// The gradient goes to the first largest value of each window.
    pub(crate) fn max_gradient(&self, image: &[f32], gradient: &[f32], result: &mut [f32]) {
        self.each(|plane, index, y, x| {
            let mut best = None;
            self.places(y, x, |place| {
                if best.is_none_or(|best: usize| image[plane + place] > image[plane + best]) {
                    best = Some(place);
                }
            });
            if let Some(best) = best {
                result[plane + best] += gradient[index];
            }
        });
    }

    /// Mean of every window; padding is not counted.
    pub(crate) fn average(&self, image: &[f32], result: &mut [f32]) {
        self.each(|plane, index, y, x| {
            let (mut sum, mut count) = (0.0, 0u32);
            self.places(y, x, |place| {
                sum += image[plane + place];
                count += 1;
            });
            result[index] = sum / count.max(1) as f32;
        });
    }

    pub(crate) fn average_gradient(&self, gradient: &[f32], result: &mut [f32]) {
        self.each(|plane, index, y, x| {
            let mut count = 0u32;
            self.places(y, x, |_| count += 1);
            let share = gradient[index] / count.max(1) as f32;
            self.places(y, x, |place| result[plane + place] += share);
        });
    }

    #[inline(always)]
    fn each(&self, mut visit: impl FnMut(usize, usize, usize, usize)) {
        let mut index = 0;
        for c in 0..self.input.channels {
            for y in 0..self.output.height {
                for x in 0..self.output.width {
                    visit(c * self.input.plane(), index, y, x);
                    index += 1;
                }
            }
        }
    }

    #[inline(always)]
    fn places(&self, y: usize, x: usize, mut visit: impl FnMut(usize)) {
        let (top, bottom) = self.span(0, y, self.input.height);
        let (left, right) = self.span(1, x, self.input.width);
        for row in top..bottom {
            for column in left..right {
                visit(row * self.input.width + column);
            }
        }
    }

    /// Columns of one phase of a padded row; see [`Window::split`].
    fn phase_width(&self) -> usize {
        (self.input.width + self.padding[1] + self.padding[3]).div_ceil(self.stride[1])
    }

    fn row_pitch(&self) -> usize {
        self.phase_width() * self.stride[1]
    }

    /// Values of one padded channel.
    pub(crate) fn source_len(&self) -> usize {
        (self.input.height + self.padding[0] + self.padding[2]) * self.row_pitch()
    }

    /// One channel with its padding, each row split by horizontal stride; margins of `source` are zero and stay so.
    fn split(&self, plane: &[f32], source: &mut [f32]) {
        let (pitch, phase, stride) = (self.row_pitch(), self.phase_width(), self.stride[1]);
        for (y, row) in plane.chunks_exact(self.input.width).enumerate() {
            let to = &mut source[(y + self.padding[0]) * pitch..][..pitch];
            if stride == 1 {
                to[self.padding[1]..][..row.len()].copy_from_slice(row);
                continue;
            }
            // Columns of one phase are `stride` apart in the image.
            for first in 0..stride.min(row.len()) {
                let x = first + self.padding[1];
                let to = &mut to[(x % stride) * phase + x / stride..];
                for (to, value) in to.iter_mut().zip(row[first..].iter().step_by(stride)) {
                    *to = *value;
                }
            }
        }
    }

    /// Place of a tap's first value in a padded channel, for output row `y`.
    #[inline(always)]
    fn tap(&self, y: usize, tap_y: usize, tap_x: usize) -> usize {
        (y * self.stride[0] + tap_y) * self.row_pitch()
            + (tap_x % self.stride[1]) * self.phase_width()
            + tap_x / self.stride[1]
    }

    /// Values of scratch of a depthwise convolution: one padded channel, and its result when that is computed in one run.
    pub(crate) fn scratch_len(&self) -> usize {
        self.source_len() + self.run_len()
    }

    /// With a stride of one all rows are one run, with values between them that nobody wants: narrow rows would leave most of a
    /// register empty. Zero otherwise.
    fn run_len(&self) -> usize {
        if self.stride == [1, 1] {
            (self.output.height - 1) * self.row_pitch() + self.output.width
        } else {
            0
        }
    }

    /// Depthwise convolution; `scratch` has [`Window::scratch_len`] values.
    pub(crate) fn depthwise(
        &self,
        weights: &[f32],
        bias: &[f32],
        image: &[f32],
        scratch: &mut [f32],
        result: &mut [f32],
    ) {
        let taps = self.size[0] * self.size[1];
        let (width, pitch) = (self.output.width, self.row_pitch());
        let (source, run) = scratch.split_at_mut(self.source_len());
        let run = &mut run[..self.run_len()];
        for c in 0..self.input.channels {
            let weights = &weights[c * taps..][..taps];
            let bias = bias.get(c).copied().unwrap_or(0.0);
            let to = &mut result[c * self.output.plane()..][..self.output.plane()];
            self.split(&image[c * self.input.plane()..][..self.input.plane()], source);
            if run.is_empty() {
                for (y, row) in to.chunks_exact_mut(width).enumerate() {
                    self.row(weights, bias, source, y, row);
                }
            } else {
                self.row(weights, bias, source, 0, run);
                for (row, from) in to.chunks_exact_mut(width).zip(run.chunks(pitch)) {
                    row.copy_from_slice(&from[..width]);
                }
            }
        }
    }

    /// Neighbouring outputs from row `y` on: each begins with the bias, then its taps are added in their order.
    fn row(&self, weights: &[f32], bias: f32, source: &[f32], y: usize, to: &mut [f32]) {
        if let (Ok(weights), [3, 3]) = (weights.try_into(), self.size) {
            let sources = std::array::from_fn(|tap| &source[self.tap(y, tap / 3, tap % 3)..][..to.len()]);
            return nine_taps(weights, bias, &sources, to);
        }
        to.fill(bias);
        for (tap, weight) in weights.iter().enumerate() {
            let (tap_y, tap_x) = (tap / self.size[1], tap % self.size[1]);
            let from = &source[self.tap(y, tap_y, tap_x)..][..to.len()];
            add_scaled(*weight, from, to);
        }
    }

    /// Gradients of a depthwise convolution; `spread` is scratch like `source`.
    pub(crate) fn depthwise_gradient(
        &self,
        weights: &[f32],
        image: &[f32],
        gradient: &[f32],
        [source, spread]: [&mut [f32]; 2],
        mut weight_gradient: Option<&mut [f32]>,
        mut result: Option<&mut [f32]>,
    ) {
        let taps = self.size[0] * self.size[1];
        let width = self.output.width;
        let (pitch, phase, stride) = (self.row_pitch(), self.phase_width(), self.stride[1]);
        for c in 0..self.input.channels {
            let plane = c * self.input.plane()..(c + 1) * self.input.plane();
            self.split(&image[plane.clone()], source);
            spread[..self.source_len()].fill(0.0);
            for y in 0..self.output.height {
                let row = &gradient[c * self.output.plane() + y * width..][..width];
                for tap_y in 0..self.size[0] {
                    for tap_x in 0..self.size[1] {
                        let index = c * taps + tap_y * self.size[1] + tap_x;
                        let at = self.tap(y, tap_y, tap_x);
                        if let Some(weight_gradient) = &mut weight_gradient {
                            let products = row.iter().zip(&source[at..at + width]);
                            weight_gradient[index] += products.map(|(g, x)| g * x).sum::<f32>();
                        }
                        add_scaled(weights[index], row, &mut spread[at..at + width]);
                    }
                }
            }
            if let Some(result) = &mut result {
                for (y, row) in result[plane].chunks_exact_mut(self.input.width).enumerate() {
                    let from = &spread[(y + self.padding[0]) * pitch..][..pitch];
                    for (x, value) in row.iter_mut().enumerate() {
                        let x = x + self.padding[1];
                        *value += from[(x % stride) * phase + x / stride];
                    }
                }
            }
        }
    }
}

math::vectorised! {
    fn nine_taps(weights: &[f32; 9], bias: f32, sources: &[&[f32]; 9], to: &mut [f32]) {
        let sources = sources.map(|source| &source[..to.len()]);
        for (x, to) in to.iter_mut().enumerate() {
            let mut sum = bias;
            for tap in 0..9 {
                sum += weights[tap] * sources[tap][x];
            }
            *to = sum;
        }
    }
}

math::vectorised! {
    fn add_scaled(factor: f32, from: &[f32], to: &mut [f32]) {
        for (to, from) in to.iter_mut().zip(from) {
            *to += factor * *from;
        }
    }
}

math::vectorised! {
    fn larger_of_four(upper: &[f32], lower: &[f32], result: &mut [f32]) {
        let larger = |a: f32, b: f32| if a > b || a.is_nan() { a } else { b };
        let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        for ((upper, lower), result) in pairs.zip(result) {
            *result = larger(larger(upper[0], upper[1]), larger(lower[0], lower[1]));
        }
    }
}

/// Repeats rows and columns `factor` times.
pub(crate) fn upsample(input: Shape, factor: usize, image: &[f32], result: &mut [f32]) {
    let width = input.width * factor;
    for (row, to) in image[..input.len()]
        .chunks_exact(input.width)
        .zip(result.chunks_exact_mut(width * factor))
    {
        for to in to.chunks_exact_mut(width) {
            for (x, to) in to.iter_mut().enumerate() {
                *to = row[x / factor];
            }
        }
    }
}

/// Adds the gradients of the copies.
pub(crate) fn upsample_gradient(input: Shape, factor: usize, gradient: &[f32], result: &mut [f32]) {
    let width = input.width * factor;
    for (from, row) in gradient
        .chunks_exact(width * factor)
        .zip(result[..input.len()].chunks_exact_mut(input.width))
    {
        for from in from.chunks_exact(width) {
            for (x, value) in from.iter().enumerate() {
                row[x / factor] += *value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, tap after tap.
    fn plain(window: &Window, weights: &[f32], bias: &[f32], image: &[f32]) -> Vec<f32> {
        let mut result = Vec::new();
        window.each(|plane, _, y, x| {
            let c = plane / window.input.plane();
            let mut sum = bias[c];
            for tap_y in 0..window.size[0] {
                for tap_x in 0..window.size[1] {
                    let row = (y * window.stride[0] + tap_y).wrapping_sub(window.padding[0]);
                    let column = (x * window.stride[1] + tap_x).wrapping_sub(window.padding[1]);
                    let is_inside = row < window.input.height && column < window.input.width;
                    let value = if is_inside {
                        image[plane + row * window.input.width + column]
                    } else {
                        0.0
                    };
                    sum += weights[(c * window.size[0] + tap_y) * window.size[1] + tap_x] * value;
                }
            }
            result.push(sum);
        });
        result
    }

    #[test]
    fn depthwise_gives_the_bits_of_its_definition() {
        let value = |i: usize| ((i * 7919 + 13) % 1009) as f32 / 504.5 - 1.0;
        for (size, stride) in [(3, 1), (3, 2), (3, 3), (5, 1), (1, 1), (2, 2)] {
            for (height, width) in [(5, 7), (14, 14), (9, 33)] {
                for margin in 0..=size / 2 {
                    let shape = |height, width| Shape {
                        channels: 3,
                        height,
                        width,
                    };
                    let out = |len: usize| (len + 2 * margin - size) / stride + 1;
                    let (input, output) = (shape(height, width), shape(out(height), out(width)));
                    let window = Window::new(
                        input,
                        output,
                        [size; 2],
                        [stride; 2],
                        Padding::Explicit([margin; 4]),
                    );
                    let image: Vec<f32> = (0..input.len()).map(value).collect();
                    let weights: Vec<f32> = (0..3 * size * size).map(|i| value(i + 5)).collect();
                    let bias = [0.5, -0.25, 0.125];
                    let mut scratch = vec![0.0; window.scratch_len()];
                    let mut result = vec![f32::NAN; output.len()];
                    window.depthwise(&weights, &bias, &image, &mut scratch, &mut result);
                    let expected = plain(&window, &weights, &bias, &image);
                    let bits =
                        |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
                    assert_eq!(
                        bits(&result),
                        bits(&expected),
                        "{size} by {stride}, {height}x{width}, margin {margin}"
                    );
                }
            }
        }
    }
}
