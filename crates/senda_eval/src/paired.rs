//! Tests for paired values: the same seed and the same lap, driven by two.

use serde::{Deserialize, Serialize};

/// What a test of differences found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PairedTest {
    /// Pairs that differ: those that are equal say nothing and are left out.
    pub count: usize,
    /// Sum of the ranks of the positive differences.
    pub positive_ranks: f64,
    /// Probability of ranks at least as one-sided as these, either way, if there were no difference (0..=1).
    pub p: f64,
}

/// More pairs than this are not looked at exactly: the table of sums would not fit into memory.
const MOST_PAIRS: usize = 2000;

/// Wilcoxon's signed rank test (Wilcoxon 1945), two-sided and exact: the distribution of the rank sum is counted out over all
/// signs, with equal differences sharing their mean rank. `None` when no pair differs, when a difference is no number, or with
/// more than 2,000 pairs.
pub fn wilcoxon_signed_rank(differences: &[f64]) -> Option<PairedTest> {
    let mut used: Vec<f64> = differences
        .iter()
        .copied()
        .filter(|difference| *difference != 0.0)
        .collect();
    if used.is_empty() || used.len() > MOST_PAIRS || used.iter().any(|difference| !difference.is_finite()) {
        return None;
    }
    used.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
    // Twice the rank, so that mean ranks of two stay whole.
    let mut doubled = vec![0usize; used.len()];
    let mut first = 0;
    while first < used.len() {
        let mut last = first;
        while last + 1 < used.len() && used[last + 1].abs() == used[first].abs() {
            last += 1;
        }
        for rank in &mut doubled[first..=last] {
            *rank = first + last + 2;
        }
        first = last + 1;
    }
    let total: usize = doubled.iter().sum();
    let positive: usize = used
        .iter()
        .zip(&doubled)
        .filter(|(difference, _)| **difference > 0.0)
        .map(|(_, rank)| rank)
        .sum();
    // Probability of each sum when every sign is a coin.
    let mut chance = vec![0.0f64; total + 1];
    chance[0] = 1.0;
    let mut reached = 0;
    for rank in &doubled {
        reached += rank;
        for sum in (0..=reached).rev() {
            let with = if sum >= *rank { chance[sum - rank] } else { 0.0 };
            chance[sum] = 0.5 * (chance[sum] + with);
        }
    }
    let smaller = positive.min(total - positive);
    let tail: f64 = chance[..=smaller].iter().sum();
    Some(PairedTest {
        count: used.len(),
        positive_ranks: 0.5 * positive as f64,
        p: (2.0 * tail).min(1.0),
    })
}

/// Probabilities corrected for having asked several questions at once (Holm 1979), in the order given: where the corrected ones
/// stay below 5 %, the chance of even one false alarm among all is below 5 %.
pub fn holm(probabilities: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..probabilities.len()).collect();
    order.sort_by(|a, b| probabilities[*a].total_cmp(&probabilities[*b]));
    let mut corrected = vec![1.0; probabilities.len()];
    let mut least = 0.0f64;
    for (rank, index) in order.iter().enumerate() {
        let questions = (probabilities.len() - rank) as f64;
        least = least.max((questions * probabilities[*index]).min(1.0));
        corrected[*index] = least;
    }
    corrected
}

#[cfg(test)]
mod tests {
    use super::*;

    fn p_of(differences: &[f64]) -> f64 {
        wilcoxon_signed_rank(differences).unwrap().p
    }

    /// Against R's `wilcox.test(x, paired = TRUE, exact = TRUE)` and the tables in Hollander & Wolfe.
    #[test]
    fn known_values() {
        // Five pairs, all one way: the smallest p there is with five, 2 / 32.
        assert!((p_of(&[1.0, 2.0, 3.0, 4.0, 5.0]) - 0.0625).abs() < 1e-12);
        assert!((p_of(&[-1.0, -2.0, -3.0, -4.0, -5.0]) - 0.0625).abs() < 1e-12);
        // V = 40 of 45 with nine pairs (Hollander & Wolfe's depression scores): one-sided 0.0195, two-sided 0.0391.
        let depression = [0.952, -0.147, 1.022, 0.430, 0.620, 0.590, 0.490, -0.080, 0.010];
        let found = wilcoxon_signed_rank(&depression).unwrap();
        assert_eq!((found.count, found.positive_ranks), (9, 40.0));
        assert!((found.p - 0.0390625).abs() < 1e-12, "{}", found.p);
        // As good as it gets: nothing either way.
        assert!((p_of(&[1.0, -1.0]) - 1.0).abs() < 1e-12);
    }

    /// Equal sizes share a rank; the distribution over all signs is counted by hand here.
    #[test]
    fn equal_differences_share_their_rank_and_equal_pairs_are_left_out() {
        let differences = [0.0, 1.0, 1.0, -1.0, 2.0, 0.0, 3.0];
        let found = wilcoxon_signed_rank(&differences).unwrap();
        assert_eq!((found.count, found.positive_ranks), (5, 13.0));
        let ranks = [2.0, 2.0, 2.0, 4.0, 5.0];
        let as_far = (0..32u32).filter(|signs| {
            let sum: f64 = (0..5)
                .filter(|i| signs >> i & 1 == 1)
                .map(|i| ranks[i as usize])
                .sum();
            sum <= 2.0 || sum >= 13.0
        });
        assert!((found.p - as_far.count() as f64 / 32.0).abs() < 1e-12);
        assert_eq!(wilcoxon_signed_rank(&[0.0, 0.0]), None);
        assert_eq!(wilcoxon_signed_rank(&[1.0, f64::NAN]), None);
    }

    #[test]
    fn several_questions_make_each_answer_less_sure() {
        let corrected = holm(&[0.01, 0.04, 0.03, 0.005]);
        for (found, right) in corrected.iter().zip([0.03, 0.06, 0.06, 0.02]) {
            assert!((found - right).abs() < 1e-12, "{corrected:?}");
        }
        assert_eq!(holm(&[0.9, 0.8]), [1.0, 1.0]);
        assert!(holm(&[]).is_empty());
    }
}
