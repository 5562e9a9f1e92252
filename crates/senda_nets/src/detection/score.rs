//! How good a detector is: average precision (FORMATS 5), precision and recall.

use super::Boxed;
use serde::Serialize;

/// Collects what was found and what was there, picture by picture.
#[derive(Debug, Clone)]
pub struct Scorer {
    overlap: f32,
    classes: Vec<ClassData>,
}

#[derive(Debug, Clone, Default)]
struct ClassData {
    truths: usize,
    /// Confidence of every box, and whether it matched a truth.
    found: Vec<(f32, bool)>,
}

/// A class's figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClassScore {
    /// Boxes that were there.
    pub truths: usize,
    /// Area under the envelope of precision over recall; `None` without truths.
    pub average_precision: Option<f64>,
    /// Part of the boxes found above the threshold that were right; `None` without any.
    pub precision: Option<f64>,
    /// Part of the truths that were found above the threshold; `None` without truths.
    pub recall: Option<f64>,
}

/// All classes' figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scores {
    /// Mean of the classes' average precisions.
    pub mean_average_precision: f64,
    /// In the order of the classes.
    pub classes: Vec<ClassScore>,
}

impl Scorer {
    /// For so many classes; a box counts when it overlaps a truth of its class by at least `overlap` (0.5 in FORMATS 5).
    pub fn new(classes: usize, overlap: f32) -> Self {
        Self {
            overlap,
            classes: vec![ClassData::default(); classes],
        }
    }

    /// Adds a picture. Boxes are matched greedily by confidence, each truth once.
    pub fn add(&mut self, found: &[Boxed], truths: &[Boxed]) {
        for (class, data) in self.classes.iter_mut().enumerate() {
            let truths: Vec<&Boxed> = truths.iter().filter(|truth| truth.class == class).collect();
            let mut is_taken = vec![false; truths.len()];
            data.truths += truths.len();
            let mut own: Vec<&Boxed> = found.iter().filter(|one| one.class == class).collect();
            own.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
            for one in own {
                let best = truths
                    .iter()
                    .enumerate()
                    .filter(|(index, _)| !is_taken[*index])
                    .map(|(index, truth)| (truth.rect.overlap(&one.rect), index))
                    .max_by(|a, b| a.0.total_cmp(&b.0));
                let matched = best.filter(|(overlap, _)| *overlap >= self.overlap);
                if let Some((_, index)) = matched {
                    is_taken[index] = true;
                }
                data.found.push((one.confidence, matched.is_some()));
            }
        }
    }

    /// The figures; precision and recall at `threshold`. With `points`, the envelope is sampled at so many recalls (11 or 101)
    /// instead of integrated.
    pub fn scores(&self, threshold: f32, points: Option<usize>) -> Scores {
        let classes: Vec<ClassScore> = self
            .classes
            .iter()
            .map(|data| data.score(threshold, points))
            .collect();
        let known: Vec<f64> = classes
            .iter()
            .filter_map(|class| class.average_precision)
            .collect();
        Scores {
            mean_average_precision: known.iter().sum::<f64>() / known.len().max(1) as f64,
            classes,
        }
    }
}

impl ClassData {
    fn score(&self, threshold: f32, points: Option<usize>) -> ClassScore {
        let mut found = self.found.clone();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        // Precision and recall after each box.
        let mut curve: Vec<(f64, f64)> = Vec::with_capacity(found.len());
        let mut right = 0usize;
        for (count, (_, is_right)) in found.iter().enumerate() {
            right += usize::from(*is_right);
            curve.push((
                right as f64 / self.truths.max(1) as f64,
                right as f64 / (count + 1) as f64,
            ));
        }
        for index in (1..curve.len()).rev() {
            curve[index - 1].1 = curve[index - 1].1.max(curve[index].1);
        }
        let average = match points {
            Some(points) => {
                let at = |recall: f64| {
                    curve
                        .iter()
                        .find(|(own, _)| *own >= recall - 1e-12)
                        .map_or(0.0, |point| point.1)
                };
                let last = points.max(2) - 1;
                (0..=last).map(|i| at(i as f64 / last as f64)).sum::<f64>() / (last + 1) as f64
            }
            None => {
                let mut before = 0.0;
                curve
                    .iter()
                    .map(|(recall, precision)| {
                        let step = recall - before;
                        before = *recall;
                        step * precision
                    })
                    .sum()
            }
        };
        let sure = found.iter().filter(|(confidence, _)| *confidence > threshold);
        let (all, right) = sure.fold((0usize, 0usize), |(all, right), (_, is_right)| {
            (all + 1, right + usize::from(*is_right))
        });
        let there = self.truths > 0;
        ClassScore {
            truths: self.truths,
            average_precision: there.then_some(average),
            precision: (all > 0).then(|| right as f64 / all as f64),
            recall: there.then(|| right as f64 / self.truths as f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detection::Rect;

    fn boxed(class: usize, confidence: f32, x: f32) -> Boxed {
        Boxed {
            class,
            confidence,
            rect: Rect {
                x,
                y: 0.5,
                width: 0.2,
                height: 0.2,
            },
        }
    }

    #[test]
    fn average_precision_is_the_area_under_the_envelope() {
        // Sorted by confidence: right, wrong (the truth is taken), right, wrong; one truth is never found.
        let mut scorer = Scorer::new(2, 0.5);
        scorer.add(
            &[boxed(0, 0.9, 0.3), boxed(0, 0.8, 0.31), boxed(0, 0.2, 0.9)],
            &[boxed(0, 1.0, 0.3), boxed(0, 1.0, 0.6)],
        );
        scorer.add(&[boxed(0, 0.7, 0.5)], &[boxed(0, 1.0, 0.5)]);
        let scores = scorer.scores(0.5, None);
        let expected = 1.0 / 3.0 + (2.0 / 3.0) / 3.0;
        assert!(
            (scores.mean_average_precision - expected).abs() < 1e-12,
            "{scores:?}"
        );
        assert_eq!(scores.classes[0].precision, Some(2.0 / 3.0));
        assert_eq!(scores.classes[0].recall, Some(2.0 / 3.0));
        assert_eq!(scores.classes[1].average_precision, None);
        // Eleven points: recalls 0 to 0.3 give 1, 0.4 to 0.6 give 2/3.
        let eleven = scorer.scores(0.5, Some(11)).mean_average_precision;
        assert!(
            (eleven - (4.0 + 3.0 * 2.0 / 3.0) / 11.0).abs() < 1e-12,
            "{eleven}"
        );
    }

    #[test]
    fn all_found_is_one_and_nothing_found_is_zero() {
        let mut scorer = Scorer::new(1, 0.5);
        scorer.add(&[boxed(0, 0.9, 0.3)], &[boxed(0, 1.0, 0.3)]);
        assert_eq!(scorer.scores(0.5, None).mean_average_precision, 1.0);
        let mut blind = Scorer::new(1, 0.5);
        blind.add(&[], &[boxed(0, 1.0, 0.3)]);
        let scores = blind.scores(0.5, None);
        assert_eq!(
            (scores.mean_average_precision, scores.classes[0].precision),
            (0.0, None)
        );
    }
}
