//! How far two drivers agree on the same frames: a human's recorded steering against a driver's.

use crate::statistics::{correlation, mean, median, root_mean_square};
use crate::text;
use senda_data::Recording;
use serde::{Deserialize, Serialize};

/// Agreement of two steerings, both angles of the front wheels (rad). Differences are `driver - reference`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Agreement {
    /// Frames given.
    pub frames: u64,
    /// Frames where the driver answered with a number: those compared.
    pub compared: u64,
    /// Part of the frames where the driver found what it follows (0..=1).
    pub found_rate: f64,
    /// Pearson's correlation; `None` when one side never changes.
    pub correlation: Option<f64>,
    /// Part of the frames that steer to the same side, among those where the reference steers by more than `dead_band_rad`.
    pub sign_agreement: Option<f64>,
    /// Frames that steer to the same side.
    pub same_side: u64,
    /// Frames where the reference steers by more than `dead_band_rad`.
    pub sided: u64,
    /// The band around straight that counts as no side.
    pub dead_band_rad: f64,
    /// Mean absolute difference (MAE).
    pub mean_absolute_error_rad: Option<f64>,
    /// Root mean square difference (RMSE, B6 in SPEC).
    pub root_mean_square_error_rad: Option<f64>,
    /// Median absolute difference: what an ordinary frame shows.
    pub median_absolute_error_rad: Option<f64>,
    /// Mean difference: a camera mounted askew or a steering trim.
    pub offset_rad: Option<f64>,
    /// Mean absolute difference after the offset is taken out.
    pub compensated_error_rad: Option<f64>,
    /// Mean absolute difference of a driver that always answers with the reference's median: the figure to beat.
    pub constant_error_rad: Option<f64>,
}

/// Compares frame by frame. `driver[i]` is `None` where the driver did not find what it follows; such frames lower the
/// found rate and count in no error. Pairs with a number that is not finite are left out.
pub fn agreement(reference: &[f64], driver: &[Option<f64>], dead_band_rad: f64) -> Agreement {
    let frames = reference.len().min(driver.len());
    let pairs: Vec<(f64, f64)> = reference
        .iter()
        .zip(driver)
        .filter_map(|(reference, driver)| Some((*reference, (*driver)?)))
        .filter(|(reference, driver)| reference.is_finite() && driver.is_finite())
        .collect();
    let differences: Vec<f64> = pairs
        .iter()
        .map(|(reference, driver)| driver - reference)
        .collect();
    let absolute = |values: &[f64], around: f64| -> Vec<f64> {
        values.iter().map(|value| (value - around).abs()).collect()
    };
    let sided: Vec<f64> = pairs
        .iter()
        .filter(|(reference, _)| reference.abs() > dead_band_rad)
        .map(|(reference, driver)| if reference * driver > 0.0 { 1.0 } else { 0.0 })
        .collect();
    let offset = mean(&differences);
    let references: Vec<f64> = pairs.iter().map(|pair| pair.0).collect();
    Agreement {
        frames: frames as u64,
        compared: pairs.len() as u64,
        found_rate: if frames == 0 {
            0.0
        } else {
            pairs.len() as f64 / frames as f64
        },
        correlation: correlation(&pairs),
        sign_agreement: mean(&sided),
        same_side: sided.iter().filter(|same| **same > 0.0).count() as u64,
        sided: sided.len() as u64,
        dead_band_rad,
        mean_absolute_error_rad: mean(&absolute(&differences, 0.0)),
        root_mean_square_error_rad: root_mean_square(&differences),
        median_absolute_error_rad: median(&absolute(&differences, 0.0)),
        offset_rad: offset,
        compensated_error_rad: offset.and_then(|offset| mean(&absolute(&differences, offset))),
        constant_error_rad: median(&references).and_then(|middle| mean(&absolute(&references, middle))),
    }
}

/// A human who steers by less than this steers straight on (rad): 1°. A guess; the trim of a model car is of that order.
pub const STRAIGHT_RAD: f64 = std::f64::consts::PI / 180.0;

/// Steering as the angle of the front wheels (rad, left positive): recorded, and a driver's on the same frames. `None`
/// where the driver says with the signal `found` that it found nothing.
pub fn steerings(recorded: &Recording, driven: &Recording) -> (Vec<f64>, Vec<Option<f64>>) {
    let steering = |recording: &Recording, i: usize| {
        let (body, command) = (&recording.header.body, &recording.steps[i].command);
        body.steering_of(command.turn, body.speed_of(command))
    };
    let count = recorded.steps.len().min(driven.steps.len());
    let reference = (0..count).map(|i| steering(recorded, i)).collect();
    let answers = (0..count).map(|i| {
        let signals = &driven.steps[i].explanation.signals;
        let lost = signals
            .iter()
            .any(|signal| signal.name == "found" && (signal.value <= 0.0 || signal.value.is_nan()));
        (!lost).then(|| steering(driven, i))
    });
    (reference, answers.collect())
}

/// How a driver's steering agrees with the recorded one, frame by frame (rad, see [`steerings`]).
pub fn of_recordings(recorded: &Recording, driven: &Recording) -> Agreement {
    let (reference, answers) = steerings(recorded, driven);
    agreement(&reference, &answers, STRAIGHT_RAD)
}

impl Agreement {
    /// The figures as label and value for people.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let number = |value: Option<f64>| value.map_or("unknown".into(), |v| text::fixed(v, 3));
        let angle = |value: Option<f64>| value.map_or("unknown".into(), text::angle_both);
        vec![
            (
                "found",
                format!(
                    "{} of {} frames ({})",
                    self.compared,
                    self.frames,
                    text::percent(self.found_rate)
                ),
            ),
            ("correlation", number(self.correlation)),
            (
                "same side",
                match self.sign_agreement {
                    Some(part) => format!(
                        "{} of {} frames ({})",
                        self.same_side,
                        self.sided,
                        text::percent(part)
                    ),
                    None => "unknown".into(),
                },
            ),
            ("mean absolute error", angle(self.mean_absolute_error_rad)),
            ("root mean square error", angle(self.root_mean_square_error_rad)),
            ("median absolute error", angle(self.median_absolute_error_rad)),
            ("constant offset", angle(self.offset_rad)),
            ("error without the offset", angle(self.compensated_error_rad)),
            ("error of always the median", angle(self.constant_error_rad)),
        ]
    }

    /// An aligned table for the terminal, ending with a newline.
    pub fn to_text(&self) -> String {
        self.rows()
            .into_iter()
            .map(|(label, value)| format!("  {label:27} {value}\n"))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_offset_is_found_and_taken_out() {
        let human: Vec<f64> = (0..100).map(|i| f64::from(i % 21) / 10.0 - 1.0).collect();
        let driver: Vec<Option<f64>> = human.iter().map(|h| Some(h + 0.25)).collect();
        let found = agreement(&human, &driver, 0.05);
        let close = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 1e-12, "{a:?} {b}");
        close(found.correlation, 1.0);
        close(found.offset_rad, 0.25);
        close(found.mean_absolute_error_rad, 0.25);
        close(found.root_mean_square_error_rad, 0.25);
        close(found.median_absolute_error_rad, 0.25);
        assert!(found.compensated_error_rad.unwrap() < 1e-12);
        assert!(found.sign_agreement.unwrap() < 1.0);
    }

    #[test]
    fn frames_without_an_answer_lower_the_found_rate_only() {
        let found = agreement(
            &[0.5, -0.5, 0.5, f64::NAN],
            &[Some(0.5), None, Some(0.4), Some(0.0)],
            0.1,
        );
        assert_eq!((found.frames, found.compared, found.found_rate), (4, 2, 0.5));
        assert_eq!(found.sign_agreement, Some(1.0));
        assert!((found.mean_absolute_error_rad.unwrap() - 0.05).abs() < 1e-12);
    }

    /// Keys of angles named no unit.
    #[test]
    fn keys_of_angles_name_their_unit() {
        let value = serde_json::to_value(agreement(&[0.1], &[Some(0.2)], STRAIGHT_RAD)).unwrap();
        let without: Vec<&String> = value
            .as_object()
            .unwrap()
            .keys()
            .filter(|key| !key.ends_with("_rad"))
            .collect();
        let counts = [
            "frames",
            "compared",
            "found_rate",
            "correlation",
            "sign_agreement",
            "same_side",
            "sided",
        ];
        assert_eq!(without.len(), counts.len(), "{without:?}");
        assert!(counts.iter().all(|count| value.get(count).is_some()), "{value}");
    }

    #[test]
    fn nothing_to_compare_is_not_a_number_out_of_nothing() {
        let found = agreement(&[], &[], 0.0);
        assert_eq!(found, Agreement::default());
    }
}
