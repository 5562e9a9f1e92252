//! How a training ended, in figures.

use senda_learn::train::Errors;

/// Errors of the weights that were kept.
#[derive(Clone, Copy)]
pub(super) struct Judged {
    pub(super) errors: Errors,
    /// Mean squared (°²) and mean absolute (°), where somebody said what full lock is.
    pub(super) degrees: Option<[f64; 2]>,
}

impl Judged {
    pub(super) fn json(self) -> serde_json::Value {
        let mut value = serde_json::json!(self.errors);
        if let (Some([squared, absolute]), Some(table)) = (self.degrees, value.as_object_mut()) {
            table.insert("mean_squared_deg2".into(), squared.into());
            table.insert("mean_absolute_deg".into(), absolute.into());
        }
        value
    }

    /// What to say of weights that steer worse than no network at all: a training that diverged looks like a finished one otherwise.
    pub(super) fn worse_than_constant(&self, frames: &str) -> Option<String> {
        let Errors {
            mean_absolute,
            of_constant_median,
            ..
        } = self.errors;
        // Not a number is no better.
        let is_fine = mean_absolute <= of_constant_median;
        (!is_fine).then(|| {
            format!(
                "on the {frames} frames its mean error is {mean_absolute:.4}, where always answering the median has {of_constant_median:.4}: \
                 it has learned nothing to drive by; lower the learning rate, or give it more epochs or other data"
            )
        })
    }
}

impl std::fmt::Display for Judged {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let errors = self.errors;
        write!(
            f,
            "MSE {:.5}, mean error {:.4} (constant: {:.4}), correlation {:.3}",
            errors.mean_squared, errors.mean_absolute, errors.of_constant_median, errors.correlation
        )?;
        match self.degrees {
            Some([squared, absolute]) => write!(f, "; {squared:.1} deg², {absolute:.1}°"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_worse_than_the_median_is_told() {
        let told = |mean_absolute: f64| {
            let errors = Errors {
                mean_absolute,
                of_constant_median: 0.32,
                ..Errors::default()
            };
            let judged = Judged {
                errors,
                degrees: None,
            };
            judged.worse_than_constant("judging").unwrap_or_default()
        };
        assert_eq!(told(0.1) + &told(0.32), "");
        for wrong in [42.9, f64::NAN] {
            assert!(told(wrong).contains("judging frames") && told(wrong).contains("0.3200"));
        }
    }
}
