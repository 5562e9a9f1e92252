//! What training a detector minimises (FORMATS 5 as darknet has it).

use super::{Boxed, DetectionSpec, Rect};
use crate::math::{exp, sigmoid};

/// The loss of darknet's `[yolo]`: every cell pushes objectness to 0 unless its box overlaps a truth by more than
/// [`DetectionLoss::ignore`]; each truth goes to the anchor of best shape, with objectness 1, errors of its box weighted by
/// `2 - width · height`, and binary cross-entropy of the classes.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectionLoss {
    spec: DetectionSpec,
    input: [f32; 2],
    /// Best overlap above which a cell without a truth is left alone; darknet's is 0.7.
    pub ignore: f32,
}

/// `ln(1 + e^-|x|)` and what it needs: binary cross-entropy of a logit without overflow.
fn cross_entropy(logit: f32, target: f32) -> f64 {
    let rest = senda_geom::trig::log(1.0 + f64::from(exp(-logit.abs())));
    f64::from(logit.max(0.0) - logit * target) + rest
}

impl DetectionLoss {
    /// For networks with an input of this width and height (px).
    pub fn new(spec: DetectionSpec, input_px: [usize; 2]) -> Self {
        Self {
            spec,
            input: input_px.map(|size| size as f32),
            ignore: 0.7,
        }
    }

    /// Loss of one picture's output; its gradient replaces what is in `gradient`.
    ///
    /// # Panics
    /// When the lengths do not fit.
    pub fn of(&self, output: &[f32], truths: &[Boxed], gradient: &mut [f32]) -> f64 {
        assert_eq!(
            (output.len(), gradient.len()),
            (self.spec.output_len(), output.len())
        );
        gradient.fill(0.0);
        let depth = self.spec.depth();
        let mut loss = 0.0;
        let mut start = 0;
        for head in &self.spec.heads {
            let cells = head.cells();
            for anchor in 0..head.anchors_px.len() {
                let planes = &output[start..start + depth * cells];
                for cell in 0..cells {
                    let values = [0, 1, 2, 3].map(|plane| planes[plane * cells + cell]);
                    let rect = head.rect(values, cell, anchor, self.input);
                    let best = truths
                        .iter()
                        .map(|truth| truth.rect.overlap(&rect))
                        .fold(0.0, f32::max);
                    if best <= self.ignore {
                        let at = 4 * cells + cell;
                        loss += cross_entropy(planes[at], 0.0);
                        gradient[start + at] = sigmoid(planes[at]);
                    }
                }
                start += depth * cells;
            }
        }
        for truth in truths {
            loss += self.one(output, truth, gradient);
        }
        loss
    }

    /// The anchor among all heads whose shape is nearest: head, anchor within it, start of its planes.
    fn nearest(&self, truth: &Rect) -> (usize, usize, usize) {
        let shape = |width: f32, height: f32| Rect {
            x: 0.0,
            y: 0.0,
            width,
            height,
        };
        let own = shape(truth.width, truth.height);
        let mut best = (-1.0, (0, 0, 0));
        let mut start = 0;
        for (number, head) in self.spec.heads.iter().enumerate() {
            for (anchor, [width, height]) in head.anchors_px.iter().enumerate() {
                let overlap = own.overlap(&shape(width / self.input[0], height / self.input[1]));
                if overlap > best.0 {
                    best = (overlap, (number, anchor, start));
                }
                start += self.spec.depth() * head.cells();
            }
        }
        best.1
    }

    fn one(&self, output: &[f32], truth: &Boxed, gradient: &mut [f32]) -> f64 {
        let (head, anchor, start) = self.nearest(&truth.rect);
        let head = &self.spec.heads[head];
        let cells = head.cells();
        let (x, y) = (
            truth.rect.x * head.width as f32,
            truth.rect.y * head.height as f32,
        );
        let column = (x.max(0.0) as usize).min(head.width - 1);
        let row = (y.max(0.0) as usize).min(head.height - 1);
        let cell = row * head.width + column;
        let at = |plane: usize| start + plane * cells + cell;
        let scale = 2.0 - (truth.rect.width * truth.rect.height).clamp(0.0, 1.0);
        let mut loss = 0.0;
        // What another box said of this cell is replaced, so its part of the loss goes too.
        if gradient[at(4)] != 0.0 {
            loss -= cross_entropy(output[at(4)], 0.0);
        }
        for (plane, target) in [(0, x - column as f32), (1, y - row as f32)] {
            let target = target.clamp(0.0, 1.0);
            loss += f64::from(scale) * cross_entropy(output[at(plane)], target);
            gradient[at(plane)] = scale * (sigmoid(output[at(plane)]) - target);
        }
        let [width, height] = head.anchors_px[anchor];
        let sizes = [
            (2, truth.rect.width * self.input[0] / width),
            (3, truth.rect.height * self.input[1] / height),
        ];
        for (plane, ratio) in sizes {
            let target = senda_geom::trig::log(f64::from(ratio.max(1e-6))) as f32;
            let error = output[at(plane)] - target;
            loss += f64::from(0.5 * scale * error * error);
            gradient[at(plane)] = scale * error;
        }
        for class in 0..=self.spec.classes.len() {
            let target = if class == 0 || class == truth.class + 1 {
                1.0
            } else {
                0.0
            };
            let place = at(4 + class);
            loss += cross_entropy(output[place], target);
            gradient[place] = sigmoid(output[place]) - target;
        }
        loss
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detection::tests::spec;

    fn truths() -> Vec<Boxed> {
        let boxed = |class, x, y, width, height| Boxed {
            class,
            confidence: 1.0,
            rect: Rect { x, y, width, height },
        };
        vec![boxed(1, 0.4, 0.7, 0.5, 0.7), boxed(0, 0.9, 0.2, 0.09, 0.1)]
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        let loss = DetectionLoss::new(spec(), [120, 80]);
        let len = spec().output_len();
        let output: Vec<f32> = (0..len).map(|i| ((i * 37 % 23) as f32 - 11.0) / 8.0).collect();
        let mut gradient = vec![0.0; len];
        loss.of(&output, &truths(), &mut gradient);
        let mut unused = vec![0.0; len];
        for i in 0..len {
            let mut moved = |step: f32| {
                let mut output = output.clone();
                output[i] += step;
                loss.of(&output, &truths(), &mut unused)
            };
            let slope = (moved(1e-2) - moved(-1e-2)) / 2e-2;
            assert!(
                (slope - f64::from(gradient[i])).abs() < 2e-3,
                "{i}: {slope} {}",
                gradient[i]
            );
        }
    }

    #[test]
    fn each_truth_goes_to_the_anchor_of_its_shape_and_descending_finds_the_boxes() {
        let loss = DetectionLoss::new(spec(), [120, 80]);
        assert_eq!(loss.nearest(&truths()[0].rect).0, 0);
        assert_eq!(loss.nearest(&truths()[1].rect).0, 1);
        let mut output = vec![0.0; spec().output_len()];
        let mut gradient = output.clone();
        for _ in 0..2000 {
            loss.of(&output, &truths(), &mut gradient);
            for (value, slope) in output.iter_mut().zip(&gradient) {
                *value -= 0.3 * slope;
            }
        }
        let mut found = Vec::new();
        spec().decode(&output, [120, 80], 0.5, &mut found);
        crate::detection::suppress(&mut found, 0.45);
        assert_eq!(found.len(), 2, "{found:?}");
        for truth in truths() {
            assert!(
                found
                    .iter()
                    .any(|one| one.class == truth.class && one.rect.overlap(&truth.rect) > 0.95)
            );
        }
    }
}
