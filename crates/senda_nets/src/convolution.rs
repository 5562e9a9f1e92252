//! Convolution forward and backward, without unrolled patches: the kernels read the image through a table of offsets.

use crate::kernel::{Correlation, Level, PANEL, Position, Product, SLACK, WIDEST};
use crate::math;
use crate::network::{Padding, Shape};

/// Everything about a convolution that does not depend on weights or images.
///
/// The source is the image with its padding, each row split into as many phases as the horizontal stride (columns 0, s,
/// 2s, … then 1, s+1, …): neighbouring outputs then read neighbouring values.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    level: Level,
    input: Shape,
    pub(crate) output: Shape,
    kernel: [usize; 2],
    stride: [usize; 2],
    padding: [usize; 4],
    /// Columns of one phase.
    phase_width: usize,
    /// Values of one row of the source: all phases.
    row_pitch: usize,
    plane_pitch: usize,
    /// Whether the image itself is the source.
    is_direct: bool,
    offsets: Vec<u32>,
    largest_offset: usize,
    positions: Vec<Position>,
    backward: Option<Backward>,
}

#[derive(Debug, Clone)]
struct Backward {
    level: Level,
    /// Margins of the gradient's planes, so that every tap of every phase reads zeros outside.
    margin: [usize; 2],
    pitch: usize,
    plane: usize,
    /// Places in gradient and source for one image; see [`Correlation`].
    steps: Vec<[u32; 2]>,
    phases: Vec<Phase>,
}

/// Inputs at every `stride`-th row and column, which see the same taps.
#[derive(Debug, Clone)]
struct Phase {
    /// First row and column in the image.
    first: [usize; 2],
    size: [usize; 2],
    /// Vertical and horizontal taps of the kernel.
    taps: [Vec<usize>; 2],
    offsets: Vec<u32>,
    largest_offset: usize,
    positions: Vec<Position>,
    /// Where its packed weights begin.
    packed: usize,
}

impl Plan {
    pub(crate) fn new(
        input: Shape,
        output: Shape,
        kernel: [usize; 2],
        stride: [usize; 2],
        padding: Padding,
    ) -> Self {
        let padding = padding.amounts(input, kernel, stride);
        let (mut input, mut output) = (input, output);
        if kernel == [1, 1] && stride == [1, 1] && padding == [0; 4] {
            // Rows do not matter: one long row wastes fewer lanes.
            (input.width, input.height) = (input.plane(), 1);
            (output.width, output.height) = (output.plane(), 1);
        }
        let level = best_level(output.width);
        let [top, left, bottom, right] = padding;
        let is_direct = stride[1] == 1 && padding == [0; 4];
        let phase_width = (input.width + left + right).div_ceil(stride[1]);
        let row_pitch = phase_width * stride[1];
        let plane_pitch = (input.height + top + bottom) * row_pitch;
        let mut offsets = Vec::with_capacity(input.channels * kernel[0] * kernel[1]);
        for c in 0..input.channels {
            for y in 0..kernel[0] {
                for x in 0..kernel[1] {
                    let phase = (x % stride[1]) * phase_width + x / stride[1];
                    offsets.push((c * plane_pitch + y * row_pitch + phase) as u32);
                }
            }
        }
        Self {
            level,
            input,
            output,
            kernel,
            stride,
            padding,
            phase_width,
            row_pitch,
            plane_pitch,
            is_direct,
            largest_offset: largest(&offsets),
            offsets,
            positions: positions(
                level,
                [output.height, output.width],
                |y| y * stride[0] * row_pitch,
                output.width,
            ),
            backward: None,
        }
    }

    /// Copies the image even where it could be read in place: for images without room behind them.
    pub(crate) fn buffered(mut self) -> Self {
        self.is_direct = false;
        self
    }

    /// Adds what the backward pass needs.
    pub(crate) fn with_backward(mut self, needs_input_gradient: bool) -> Self {
        let taps = [0, 1].map(|i| self.kernel[i].div_ceil(self.stride[i]));
        let margin = taps.map(|taps| taps - 1);
        let pitch = margin[1] + self.output.width.next_multiple_of(WIDEST) + taps[1] + WIDEST;
        let plane = (margin[0] + self.output.height + taps[0]) * pitch;
        let mut steps = Vec::new();
        for y in 0..self.output.height {
            for x in (0..self.output.width).step_by(WIDEST) {
                let gradient = (y + margin[0]) * pitch + margin[1] + x;
                steps.push([gradient as u32, (y * self.stride[0] * self.row_pitch + x) as u32]);
            }
        }
        let mut backward = Backward {
            level: best_level(self.input.width.div_ceil(self.stride[1])),
            margin,
            pitch,
            plane,
            steps,
            phases: Vec::new(),
        };
        if needs_input_gradient {
            self.add_phases(&mut backward);
        }
        self.backward = Some(backward);
        self
    }

    fn add_phases(&self, backward: &mut Backward) {
        let mut packed = 0;
        // First index within a phase, first place in the image, and how many, for one direction.
        let along = |phase: usize, size: usize, before: usize, stride: usize| {
            let first = before.saturating_sub(phase).div_ceil(stride);
            let place = first * stride + phase - before;
            (first, place, size.saturating_sub(place).div_ceil(stride))
        };
        for phase_y in 0..self.stride[0] {
            for phase_x in 0..self.stride[1] {
                let (first_y, y, height) = along(phase_y, self.input.height, self.padding[0], self.stride[0]);
                let (first_x, x, width) = along(phase_x, self.input.width, self.padding[1], self.stride[1]);
                let taps_y: Vec<usize> = (phase_y..self.kernel[0]).step_by(self.stride[0]).collect();
                let taps_x: Vec<usize> = (phase_x..self.kernel[1]).step_by(self.stride[1]).collect();
                if height == 0 || width == 0 || taps_y.is_empty() || taps_x.is_empty() {
                    continue;
                }
                let mut offsets = Vec::new();
                for f in 0..self.output.channels {
                    for tap_y in 0..taps_y.len() {
                        for tap_x in 0..taps_x.len() {
                            let row = backward.margin[0] - tap_y;
                            let column = backward.margin[1] - tap_x;
                            offsets.push((f * backward.plane + row * backward.pitch + column) as u32);
                        }
                    }
                }
                let depth = offsets.len();
                let source = |row: usize| (first_y + row) * backward.pitch + first_x;
                backward.phases.push(Phase {
                    first: [y, x],
                    size: [height, width],
                    taps: [taps_y, taps_x],
                    largest_offset: largest(&offsets),
                    offsets,
                    positions: positions(backward.level, [height, width], source, width),
                    packed,
                });
                packed += self.input.channels.next_multiple_of(PANEL) * depth;
            }
        }
    }

    /// Taps of one output.
    pub(crate) fn depth(&self) -> usize {
        self.offsets.len()
    }

    /// Values of the packed weights of the forward pass.
    pub(crate) fn packed_len(&self) -> usize {
        self.output.channels.next_multiple_of(PANEL) * self.depth()
    }

    /// Values of the packed weights of the backward pass.
    pub(crate) fn packed_backward_len(&self) -> usize {
        let phases = self.backward.iter().flat_map(|backward| &backward.phases);
        phases
            .map(|phase| self.input.channels.next_multiple_of(PANEL) * phase.offsets.len())
            .sum()
    }

    /// Values of the source of one image; zero when the image itself serves.
    pub(crate) fn source_len(&self) -> usize {
        if self.is_direct {
            0
        } else {
            self.input.channels * self.plane_pitch
        }
    }

    /// Values of the padded gradient of one image.
    pub(crate) fn gradient_len(&self) -> usize {
        self.backward
            .as_ref()
            .map_or(0, |backward| self.output.channels * backward.plane)
    }

    /// Values of the largest phase of the input's gradient.
    pub(crate) fn phase_len(&self) -> usize {
        let phases = self.backward.iter().flat_map(|backward| &backward.phases);
        phases
            .map(|phase| self.input.channels * phase.size[0] * phase.size[1])
            .max()
            .unwrap_or(0)
    }

    /// Weights `[filters][taps]` into panels `[taps][8 filters]`.
    pub(crate) fn pack(&self, weights: &[f32], packed: &mut [f32]) {
        let depth = self.depth();
        for (panel, packed) in packed[..self.packed_len()]
            .chunks_exact_mut(PANEL * depth)
            .enumerate()
        {
            for r in 0..PANEL.min(self.output.channels - panel * PANEL) {
                let row = &weights[(panel * PANEL + r) * depth..][..depth];
                for (k, value) in row.iter().enumerate() {
                    packed[k * PANEL + r] = *value;
                }
            }
        }
    }

    /// Weights into panels for the gradient of the input.
    pub(crate) fn pack_backward(&self, weights: &[f32], packed: &mut [f32]) {
        let [kernel_y, kernel_x] = self.kernel;
        for phase in self.backward.iter().flat_map(|backward| &backward.phases) {
            let depth = phase.offsets.len();
            for c in 0..self.input.channels {
                let panel = phase.packed + (c / PANEL) * PANEL * depth + c % PANEL;
                let mut k = 0;
                for f in 0..self.output.channels {
                    let kernel = &weights[(f * self.input.channels + c) * kernel_y * kernel_x..];
                    for y in &phase.taps[0] {
                        for x in &phase.taps[1] {
                            packed[panel + k * PANEL] = kernel[y * kernel_x + x];
                            k += 1;
                        }
                    }
                }
            }
        }
    }

    /// Pads and splits one image. The margins of `source` are zero already and stay so.
    pub(crate) fn split(&self, image: &[f32], source: &mut [f32]) {
        let [top, left, ..] = self.padding;
        let stride = self.stride[1];
        for c in 0..self.input.channels {
            let plane = &image[c * self.input.plane()..][..self.input.plane()];
            let to = &mut source[c * self.plane_pitch..][..self.plane_pitch];
            for (y, row) in plane.chunks_exact(self.input.width).enumerate() {
                let to = &mut to[(y + top) * self.row_pitch..][..self.row_pitch];
                match stride {
                    1 => to[left..left + row.len()].copy_from_slice(row),
                    2 => {
                        let (even, odd) = to.split_at_mut(self.phase_width);
                        if left % 2 == 0 {
                            split_two(row, &mut even[left / 2..], &mut odd[left / 2..]);
                        } else {
                            split_two(row, &mut odd[left / 2..], &mut even[left / 2 + 1..]);
                        }
                    }
                    _ => {
                        for (x, value) in row.iter().enumerate() {
                            let x = x + left;
                            to[(x % stride) * self.phase_width + x / stride] = *value;
                        }
                    }
                }
            }
        }
    }

    /// What each output sees of a source, in the order of the weights: output after output, `pitch` apart.
    pub(crate) fn windows(&self, source: &[f32], taps: &mut [f32], pitch: usize) {
        for (place, to) in taps.chunks_mut(pitch).enumerate().take(self.output.plane()) {
            let (y, x) = (place / self.output.width, place % self.output.width);
            let from = &source[y * self.stride[0] * self.row_pitch + x..][..=self.largest_offset];
            for (to, offset) in to.iter_mut().zip(&self.offsets) {
                *to = from[*offset as usize];
            }
        }
    }

    /// Forward for one image; `source` is scratch of [`Plan::source_len`] with [`SLACK`], the image has that behind it
    /// too. With `add`, adds to the output (`start` must then be empty).
    pub(crate) fn forward(
        &self,
        packed: &[f32],
        start: &[f32],
        image: &[f32],
        source: &mut [f32],
        output: &mut [f32],
    ) {
        let source = if self.is_direct {
            image
        } else {
            self.split(image, source);
            source
        };
        let depth = self.depth();
        let plane = self.output.plane();
        for (panel, left) in packed[..self.packed_len()]
            .chunks_exact(PANEL * depth)
            .enumerate()
        {
            let row = panel * PANEL;
            let rows = PANEL.min(self.output.channels - row);
            Product {
                level: self.level,
                left,
                left_step: PANEL,
                rows,
                start: if start.is_empty() {
                    &[]
                } else {
                    &start[row..row + rows]
                },
                source,
                offsets: &self.offsets,
                largest_offset: self.largest_offset,
                positions: &self.positions,
                output_pitch: plane,
            }
            .run(&mut output[row * plane..]);
        }
    }

    /// The gradient of one image's output, times the activation's derivative, into planes with zero margins.
    pub(crate) fn spread(&self, gradient: &[f32], padded: &mut [f32]) {
        let Some(backward) = &self.backward else {
            return;
        };
        for f in 0..self.output.channels {
            let rows = gradient[f * self.output.plane()..][..self.output.plane()]
                .chunks_exact(self.output.width)
                .enumerate();
            for (y, row) in rows {
                let to = f * backward.plane + (y + backward.margin[0]) * backward.pitch + backward.margin[1];
                padded[to..to + row.len()].copy_from_slice(row);
            }
        }
    }

    /// Gradient of the weights from one image's source and spread gradient.
    pub(crate) fn weight_gradient(
        &self,
        padded: &[f32],
        source: &[f32],
        result: &mut [f32],
        accumulate: bool,
    ) {
        let Some(backward) = &self.backward else {
            return;
        };
        Correlation {
            level: Level::detect(),
            gradient: padded,
            gradient_pitch: backward.plane,
            rows: self.output.channels,
            source,
            offsets: &self.offsets,
            largest_offset: self.largest_offset,
            steps: &backward.steps,
        }
        .run(result, accumulate);
    }

    /// Whether the image itself is the source.
    pub(crate) fn is_direct(&self) -> bool {
        self.is_direct
    }

    /// Gradient of one image from its spread gradient; `phase_values` is scratch of [`Plan::phase_len`].
    pub(crate) fn input_gradient(
        &self,
        packed: &[f32],
        padded: &[f32],
        phase_values: &mut [f32],
        result: &mut [f32],
        accumulate: bool,
    ) {
        let Some(backward) = &self.backward else {
            return;
        };
        // Places that no window reaches keep a zero gradient.
        if !accumulate {
            result[..self.input.len()].fill(0.0);
        }
        let channels = self.input.channels;
        for phase in &backward.phases {
            let [height, width] = phase.size;
            let depth = phase.offsets.len();
            for row in (0..channels).step_by(PANEL) {
                Product {
                    level: backward.level,
                    left: &packed[phase.packed + row * depth..][..PANEL * depth],
                    left_step: PANEL,
                    rows: PANEL.min(channels - row),
                    start: &[],
                    source: padded,
                    offsets: &phase.offsets,
                    largest_offset: phase.largest_offset,
                    positions: &phase.positions,
                    output_pitch: height * width,
                }
                .run(&mut phase_values[row * height * width..]);
            }
            for c in 0..channels {
                for y in 0..height {
                    let from = &phase_values[(c * height + y) * width..][..width];
                    let row =
                        (c * self.input.height + phase.first[0] + y * self.stride[0]) * self.input.width;
                    let to = &mut result[row..row + self.input.width][phase.first[1]..];
                    if self.stride[1] == 1 {
                        math::add(from, &mut to[..width]);
                    } else {
                        for (to, from) in to.iter_mut().step_by(self.stride[1]).zip(from) {
                            *to += *from;
                        }
                    }
                }
            }
        }
    }

    /// Gradient of the biases from the output's gradient of one image.
    pub(crate) fn bias_gradient(&self, gradient: &[f32], result: &mut [f32], accumulate: bool) {
        let planes = gradient.chunks_exact(self.output.plane());
        for (plane, result) in planes.zip(&mut result[..self.output.channels]) {
            let sum = sum(plane);
            *result = if accumulate { *result + sum } else { sum };
        }
    }
}

/// Sum in sixteen fixed chains.
pub(crate) fn sum(values: &[f32]) -> f32 {
    let mut lanes = [0.0f32; WIDEST];
    let chunks = values.chunks_exact(WIDEST);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane += *value;
        }
    }
    for (lane, value) in lanes.iter_mut().zip(rest) {
        *lane += *value;
    }
    lanes.iter().sum()
}

math::vectorised! {
    /// Columns 0, 2, … and 1, 3, … of a row.
    fn split_two(row: &[f32], first: &mut [f32], second: &mut [f32]) {
        let pairs = row.chunks_exact(2);
        if let [last] = pairs.remainder() {
            first[row.len() / 2] = *last;
        }
        for ((pair, first), second) in pairs.zip(first).zip(second) {
            *first = pair[0];
            *second = pair[1];
        }
    }
}

/// The widest level that does not waste many lanes on rows of this width. All give the same bits.
pub(crate) fn best_level(width: usize) -> Level {
    let level = Level::detect();
    match level.narrower() {
        // Measured: above a tenth of waste, half the lanes are faster.
        Some(narrow)
            if 10 * width.next_multiple_of(level.lanes()) > 11 * width.next_multiple_of(narrow.lanes()) =>
        {
            narrow
        }
        _ => level,
    }
}

pub(crate) fn positions(
    level: Level,
    [height, width]: [usize; 2],
    source_row: impl Fn(usize) -> usize,
    output_pitch: usize,
) -> Vec<Position> {
    let lanes = level.lanes();
    let mut positions = Vec::with_capacity(height * width.div_ceil(lanes));
    for y in 0..height {
        for x in (0..width).step_by(lanes) {
            positions.push(Position {
                source: (source_row(y) + x) as u32,
                output: (y * output_pitch + x) as u32,
                len: lanes.min(width - x) as u32,
            });
        }
    }
    positions
}

fn largest(offsets: &[u32]) -> usize {
    offsets.iter().copied().max().unwrap_or(0) as usize
}

/// A zeroed buffer with room for wide loads behind its end.
pub(crate) fn buffer(len: usize) -> Vec<f32> {
    vec![0.0; len + SLACK]
}
