//! What came out: figures by row and seed, differences with intervals and tests, verdicts on claims.

use crate::CompareError;
use crate::figure::Figure;
use crate::job::Jobs;
use crate::plan::{Claim, ClaimPart, Plan, Relation};
use crate::work::{Offline, Shop, lap, read_json};
use senda_eval::Summary;
use senda_eval::paired::{PairedTest, holm, wilcoxon_signed_rank};
use senda_eval::statistics::{Interval, mean, mean_interval, rate};
use serde::Serialize;

/// Differences that are smaller than this part of what is compared with do not matter (our choice): "does not help" means "helps
/// by less than a tenth".
pub const MATTERS: f64 = 0.1;

/// A row trained with one seed, under one condition.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    /// Seed of the training.
    pub seed: u64,
    /// Its laps, in the plan's order.
    pub laps: Vec<Summary>,
    /// Its offline error.
    pub offline: Offline,
}

/// Everything that was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Results {
    /// By row, then by condition; empty where a row does not drive under a condition.
    pub rows: Vec<Vec<Vec<Trained>>>,
}

/// A figure over training seeds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Spread {
    /// Mean over the seeds with Student's 95 % interval, without ends where there is one seed; of a rate of laps Wilson's over
    /// all laps.
    pub interval: Interval,
    /// Of each seed.
    pub seeds: Vec<f64>,
}

/// A row beside the one that it is measured against.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Beside {
    /// The row.
    pub row: String,
    /// The other one.
    pub than: String,
    /// Per cent by which the row's lane error is smaller.
    pub better_percent: f64,
    /// Wilcoxon's test over seeds and laps; none where nothing differs.
    pub test: Option<PairedTest>,
    /// Its probability, corrected for all the rows that were asked about.
    pub corrected_p: f64,
}

/// What became of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The interval lies wholly on the claimed side.
    Confirmed,
    /// It lies wholly on the other side.
    Refuted,
    /// Neither.
    Undecided,
}

impl Verdict {
    /// In a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Confirmed => "confirmed",
            Self::Refuted => "refuted",
            Self::Undecided => "undecided",
        }
    }
}

/// A part of a claim with what was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JudgedPart {
    /// In words.
    pub says: String,
    /// Relative difference of the figure, mean over seeds with Student's 95 % interval: -0.1 is a tenth less.
    pub difference: Option<Interval>,
    /// What follows.
    pub verdict: Verdict,
}

/// A claim with what was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judged {
    /// In words.
    pub says: String,
    /// Its parts.
    pub parts: Vec<JudgedPart>,
    /// Refuted as soon as one part is, confirmed when all are.
    pub verdict: Verdict,
}

impl Results {
    /// Reads the results of a whole plan.
    pub(crate) fn read(shop: &Shop) -> Result<Self, CompareError> {
        let (plan, jobs): (&Plan, &Jobs) = (shop.plan, shop.jobs);
        let mut rows = vec![vec![Vec::new(); plan.conditions.len()]; plan.rows.len()];
        for unit in &jobs.units {
            let offline: Offline = read_json(&shop.path(unit.offline))?;
            for (condition, laps) in &unit.laps {
                let laps = laps
                    .iter()
                    .map(|task| lap(&shop.path(*task)))
                    .collect::<Result<_, _>>()?;
                rows[unit.row][*condition].push(Trained {
                    seed: unit.seed,
                    laps,
                    offline: offline.clone(),
                });
            }
        }
        Ok(Self { rows })
    }

    /// A figure of a row under a condition; `None` where it has none.
    pub fn spread(&self, row: usize, condition: usize, figure: Figure) -> Option<Spread> {
        let seeds: Option<Vec<f64>> = self.rows[row][condition]
            .iter()
            .map(|trained| figure.of(&trained.laps, &trained.offline))
            .collect();
        let seeds = seeds?;
        let over_seeds = mean_interval(&seeds)?;
        let interval = if figure == Figure::Clean {
            let (hits, count) = self.clean_laps(row, condition);
            rate(hits, count).interval.scaled(100.0)
        } else {
            figure.possible(over_seeds)
        };
        Some(Spread { interval, seeds })
    }

    /// Laps without leaving the road, and how many laps there were.
    pub fn clean_laps(&self, row: usize, condition: usize) -> (u64, u64) {
        let laps = self.rows[row][condition].iter().flat_map(|trained| &trained.laps);
        laps.fold((0, 0), |(hits, count), lap| {
            (hits + u64::from(lap.completed), count + 1)
        })
    }

    /// Differences of a figure between two rows over the same seeds and laps.
    fn differences(&self, row: usize, than: usize, figure: Figure) -> Vec<f64> {
        let mut differences = Vec::new();
        for (one, other) in self.rows[row][0].iter().zip(&self.rows[than][0]) {
            for (one, other) in one.laps.iter().zip(&other.laps) {
                if let (Some(one), Some(other)) = (figure.of_lap(one), figure.of_lap(other)) {
                    differences.push(one - other);
                }
            }
        }
        differences
    }

    /// Rows beside a row, by lane error with leaving punished.
    pub fn beside(&self, plan: &Plan, rows: &[usize], than: usize) -> Vec<Beside> {
        let figure = Figure::Lane;
        let value = |row: usize| {
            self.spread(row, 0, figure)
                .map_or(f64::NAN, |spread| spread.interval.value)
        };
        let tests: Vec<Option<PairedTest>> = rows
            .iter()
            .map(|row| wilcoxon_signed_rank(&self.differences(*row, than, figure)))
            .collect();
        let corrected = holm(
            &tests
                .iter()
                .map(|test| test.map_or(1.0, |test| test.p))
                .collect::<Vec<_>>(),
        );
        rows.iter()
            .zip(tests)
            .zip(corrected)
            .map(|((row, test), corrected_p)| Beside {
                row: plan.rows[*row].identity(),
                than: plan.rows[than].identity(),
                better_percent: 100.0 * (1.0 - value(*row) / value(than)),
                test,
                corrected_p,
            })
            .collect()
    }

    /// What the measurements say about a claim.
    pub fn judge(&self, plan: &Plan, claim: &Claim) -> Judged {
        let parts: Vec<JudgedPart> = claim
            .parts
            .iter()
            .map(|part| self.judge_part(plan, part))
            .collect();
        let verdict = if parts.iter().any(|part| part.verdict == Verdict::Refuted) {
            Verdict::Refuted
        } else if parts.iter().all(|part| part.verdict == Verdict::Confirmed) {
            Verdict::Confirmed
        } else {
            Verdict::Undecided
        };
        Judged {
            says: claim.says.clone(),
            parts,
            verdict,
        }
    }

    fn judge_part(&self, plan: &Plan, part: &ClaimPart) -> JudgedPart {
        let condition = part
            .condition
            .as_ref()
            .and_then(|name| {
                plan.conditions
                    .iter()
                    .position(|condition| condition.name == *name)
            })
            .unwrap_or(0);
        let place = |identity: &String| plan.rows.iter().position(|row| row.identity() == *identity);
        let mut relative: Vec<Vec<f64>> = Vec::new();
        for (row, than) in part.rows.iter().zip(&part.than) {
            let pair = place(row).zip(place(than)).and_then(|(row, than)| {
                Some((
                    self.spread(row, condition, part.figure)?,
                    self.spread(than, condition, part.figure)?,
                ))
            });
            let Some((row, than)) = pair else { continue };
            let scale = than.interval.value.abs().max(1e-12);
            relative.push(
                row.seeds
                    .iter()
                    .zip(&than.seeds)
                    .map(|(row, than)| (row - than) / scale)
                    .collect(),
            );
        }
        let seeds = relative.iter().map(Vec::len).min().unwrap_or(0);
        let whole = relative.len() == part.rows.len();
        let by_seed: Vec<f64> = (0..seeds)
            .filter_map(|seed| mean(&relative.iter().map(|pair| pair[seed]).collect::<Vec<_>>()))
            .collect();
        let difference = mean_interval(&by_seed).filter(|_| whole);
        JudgedPart {
            says: part.says.clone(),
            difference,
            verdict: difference.map_or(Verdict::Undecided, |interval| decide(part.relation, &interval)),
        }
    }
}

/// The rule: an interval wholly on the claimed side confirms, one wholly on the other side refutes.
fn decide(relation: Relation, difference: &Interval) -> Verdict {
    let (confirmed, refuted) = match relation {
        Relation::Less => (difference.high < 0.0, difference.low > 0.0),
        Relation::More => (difference.low > 0.0, difference.high < 0.0),
        Relation::NotLess => (difference.low > -MATTERS, difference.high < -MATTERS),
    };
    match (confirmed, refuted) {
        (true, _) => Verdict::Confirmed,
        (_, true) => Verdict::Refuted,
        _ => Verdict::Undecided,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_interval_on_one_side_decides() {
        let between = |low, high| Interval {
            value: 0.5 * (low + high),
            low,
            high,
        };
        for (relation, low, high, verdict) in [
            (Relation::Less, -0.3, -0.1, Verdict::Confirmed),
            (Relation::Less, 0.1, 0.3, Verdict::Refuted),
            (Relation::Less, -0.1, 0.3, Verdict::Undecided),
            (Relation::More, 0.1, 0.3, Verdict::Confirmed),
            (Relation::More, -0.3, -0.1, Verdict::Refuted),
            (Relation::NotLess, -0.05, 0.3, Verdict::Confirmed),
            (Relation::NotLess, -0.3, -0.15, Verdict::Refuted),
            (Relation::NotLess, -0.3, 0.1, Verdict::Undecided),
            // One seed: an interval without ends.
            (
                Relation::Less,
                f64::NEG_INFINITY,
                f64::INFINITY,
                Verdict::Undecided,
            ),
        ] {
            assert_eq!(
                decide(relation, &between(low, high)),
                verdict,
                "{relation:?} {low} {high}"
            );
        }
    }
}
