//! What a detector's output means (D7 in SPEC): boxes from anchors, their loss, and how good they are.

mod finder;
mod loss;
mod score;

pub use finder::Finder;
pub use loss::DetectionLoss;
pub use score::{ClassScore, Scorer, Scores};

use crate::math::{exp, sigmoid};
use crate::network::Network;
use serde::{Deserialize, Serialize};

/// How a network's output is read as boxes, as darknet's `[yolo]` does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectionSpec {
    /// Names of the classes, in order.
    pub classes: Vec<String>,
    /// The heads, in the order in which the output holds them.
    pub heads: Vec<Head>,
}

/// One grid of cells; every cell has a box for each anchor. Its part of the output is, anchor by anchor, the planes x, y,
/// width, height, objectness, and one for each class.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Head {
    /// Rows of cells.
    pub height: usize,
    /// Columns of cells.
    pub width: usize,
    /// Width and height of each anchor (px of the network's input).
    pub anchors_px: Vec<[f32; 2]>,
}

/// A box in parts of the picture: middle, width and height, from the upper left corner.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rect {
    /// Middle, to the right.
    pub x: f32,
    /// Middle, down.
    pub y: f32,
    /// Width.
    pub width: f32,
    /// Height.
    pub height: f32,
}

impl Rect {
    /// Area of what two have in common over the area that either covers, 0 ..= 1.
    pub fn overlap(&self, other: &Self) -> f32 {
        let along = |a: f32, a_size: f32, b: f32, b_size: f32| {
            ((a + 0.5 * a_size).min(b + 0.5 * b_size) - (a - 0.5 * a_size).max(b - 0.5 * b_size)).max(0.0)
        };
        let common = along(self.x, self.width, other.x, other.width)
            * along(self.y, self.height, other.y, other.height);
        let either = self.width * self.height + other.width * other.height - common;
        if either > 0.0 {
            // Rounding must not make it more than all.
            (common / either).min(1.0)
        } else {
            0.0
        }
    }
}

/// Something in a picture: a box and what it is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Boxed {
    /// Number of its class.
    pub class: usize,
    /// How sure the detector is, 0 ..= 1; 1 for what is known.
    pub confidence: f32,
    /// Where.
    pub rect: Rect,
}

/// Sizes are bounded so that no output overflows: a box of e⁸ anchors is larger than any picture.
const LARGEST_EXPONENT: f32 = 8.0;

impl Head {
    fn cells(&self) -> usize {
        self.height * self.width
    }

    /// The box that the four values of a cell and an anchor mean, in a picture of this size (px).
    fn rect(&self, values: [f32; 4], cell: usize, anchor: usize, input: [f32; 2]) -> Rect {
        let [width, height] = self.anchors_px[anchor];
        let [x, y, w, h] = values;
        Rect {
            x: ((cell % self.width) as f32 + sigmoid(x)) / self.width as f32,
            y: ((cell / self.width) as f32 + sigmoid(y)) / self.height as f32,
            width: exp(w.min(LARGEST_EXPONENT)) * width / input[0],
            height: exp(h.min(LARGEST_EXPONENT)) * height / input[1],
        }
    }
}

impl DetectionSpec {
    /// Values of an anchor in a cell.
    fn depth(&self) -> usize {
        self.classes.len() + 5
    }

    /// Values that the network must give.
    pub fn output_len(&self) -> usize {
        let anchors = self.heads.iter().map(|head| head.cells() * head.anchors_px.len());
        anchors.sum::<usize>() * self.depth()
    }

    /// What is wrong with it, for this network.
    pub fn fault(&self, network: &Network) -> Option<String> {
        if self.classes.is_empty()
            || self
                .heads
                .iter()
                .any(|head| head.anchors_px.is_empty() || head.height == 0 || head.width == 0)
        {
            return Some("expected classes and heads with cells and anchors, but found none".to_owned());
        }
        let sizes = self
            .heads
            .iter()
            .flat_map(|head| head.anchors_px.iter().flatten());
        if let Some(size) = sizes.into_iter().find(|size| !(0.01..=1e5).contains(*size)) {
            return Some(format!("expected anchors of 0.01 to 100000 px, but found {size}"));
        }
        // In wide numbers: a hostile file may name any size.
        let wide = |size: usize| size as u128;
        let own: u128 = self
            .heads
            .iter()
            .map(|head| {
                wide(head.height)
                    .saturating_mul(wide(head.width))
                    .saturating_mul(wide(head.anchors_px.len()))
            })
            .fold(0u128, u128::saturating_add)
            .saturating_mul(wide(self.depth()));
        (own != wide(network.output_len())).then(|| {
            format!(
                "expected a network with {own} outputs for these heads and classes, but found {}",
                network.output_len()
            )
        })
    }

    /// All boxes whose objectness times class is above `threshold`, for an input of this width and height (px). They
    /// replace what is in `found`.
    pub fn decode(&self, output: &[f32], input_px: [usize; 2], threshold: f32, found: &mut Vec<Boxed>) {
        found.clear();
        let input = input_px.map(|size| size as f32);
        let mut start = 0;
        for head in &self.heads {
            let cells = head.cells();
            for anchor in 0..head.anchors_px.len() {
                let planes = &output[start..start + self.depth() * cells];
                start += self.depth() * cells;
                for cell in 0..cells {
                    let objectness = sigmoid(planes[4 * cells + cell]);
                    // Not a number is nothing either.
                    if !(objectness > threshold) {
                        continue;
                    }
                    for class in 0..self.classes.len() {
                        let confidence = objectness * sigmoid(planes[(5 + class) * cells + cell]);
                        if confidence > threshold {
                            let values = [0, 1, 2, 3].map(|plane| planes[plane * cells + cell]);
                            found.push(Boxed {
                                class,
                                confidence,
                                rect: head.rect(values, cell, anchor, input),
                            });
                        }
                    }
                }
            }
        }
    }
}

/// Non-maximum suppression: of boxes of one class that overlap by more than `overlap`, the surest stays. Sorted by confidence.
pub fn suppress(found: &mut Vec<Boxed>, overlap: f32) {
    // A stable sort: equals keep the order of the cells.
    found.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
    let mut kept = 0;
    for index in 0..found.len() {
        let own = found[index];
        let is_new = found[..kept]
            .iter()
            .all(|other| other.class != own.class || other.rect.overlap(&own.rect) <= overlap);
        if is_new {
            found[kept] = own;
            kept += 1;
        }
    }
    found.truncate(kept);
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn spec() -> DetectionSpec {
        DetectionSpec {
            classes: vec!["a".into(), "b".into()],
            heads: vec![
                Head {
                    height: 2,
                    width: 3,
                    anchors_px: vec![[30.0, 20.0], [60.0, 60.0]],
                },
                Head {
                    height: 4,
                    width: 6,
                    anchors_px: vec![[10.0, 10.0]],
                },
            ],
        }
    }

    #[test]
    fn boxes_are_decoded_as_darknet_writes_them() {
        let spec = spec();
        let mut output = vec![-20.0f32; spec.output_len()];
        assert_eq!(output.len(), (2 * 6 + 24) * 7);
        // First head, second anchor, row 1, column 2: cell 5.
        let start = 7 * 6;
        for (plane, value) in [(0, 0.0), (1, 2.0), (2, 0.5), (3, -0.5), (4, 1.0), (6, 3.0)] {
            output[start + plane * 6 + 5] = value;
        }
        let mut found = Vec::new();
        spec.decode(&output, [120, 80], 0.5, &mut found);
        let [one] = found[..] else { panic!("{found:?}") };
        assert_eq!(one.class, 1);
        let logistic = |x: f64| 1.0 / (1.0 + senda_geom::trig::exp(-x));
        let near = |a: f32, b: f64| assert!((f64::from(a) - b).abs() < 1e-6, "{a} {b}");
        near(one.confidence, logistic(1.0) * logistic(3.0));
        near(one.rect.x, 2.5 / 3.0);
        near(one.rect.y, (1.0 + logistic(2.0)) / 2.0);
        near(one.rect.width, senda_geom::trig::exp(0.5) * 60.0 / 120.0);
        near(one.rect.height, senda_geom::trig::exp(-0.5) * 60.0 / 80.0);
    }

    #[test]
    fn hostile_values_give_no_hostile_boxes() {
        let spec = spec();
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
            let mut found = Vec::new();
            spec.decode(&vec![value; spec.output_len()], [120, 80], 0.1, &mut found);
            assert!(
                found
                    .iter()
                    .all(|boxed| boxed.rect.width.is_finite() && boxed.confidence <= 1.0)
            );
            suppress(&mut found, 0.5);
        }
    }

    #[test]
    fn of_boxes_on_top_of_each_other_the_surest_of_each_class_stays() {
        let boxed = |class, confidence, x| Boxed {
            class,
            confidence,
            rect: Rect {
                x,
                y: 0.5,
                width: 0.2,
                height: 0.2,
            },
        };
        let mut found = vec![
            boxed(0, 0.6, 0.5),
            boxed(0, 0.9, 0.52),
            boxed(1, 0.7, 0.5),
            boxed(0, 0.5, 0.9),
        ];
        suppress(&mut found, 0.45);
        let left: Vec<(usize, f32)> = found.iter().map(|one| (one.class, one.confidence)).collect();
        assert_eq!(left, [(0, 0.9), (1, 0.7), (0, 0.5)]);
        assert_eq!(found[0].rect.overlap(&found[0].rect), 1.0);
        assert_eq!(found[0].rect.overlap(&found[2].rect), 0.0);
    }

    #[test]
    fn a_network_that_does_not_fit_is_named() {
        let network = Network::named("tinypilotnet").unwrap();
        assert!(spec().fault(&network).unwrap().contains("252 outputs"));
        let mut huge = spec();
        huge.heads[0].height = usize::MAX;
        assert!(huge.fault(&network).is_some());
    }
}
