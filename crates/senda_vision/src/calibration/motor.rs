//! From wheel speed to motor value by a fitted line and the battery's voltage (C11 in SPEC).
//!
//! ```
//! use senda_vision::calibration::motor::MotorLine;
//! let line = MotorLine::GOPIGO;
//! // 13 cm/s with wheels of 6.5 cm, on a full battery and on a weaker one.
//! let revolutions_per_s = 0.13 / (std::f64::consts::PI * 0.065);
//! assert_eq!(line.value(revolutions_per_s, 9.277).round(), 92.0);
//! assert!(line.value(revolutions_per_s, 7.0) > line.value(revolutions_per_s, 9.277));
//! ```

use serde::{Deserialize, Serialize};

/// Motor values run from 0 to this.
pub const LARGEST_VALUE: f64 = 255.0;

/// One step of a calibration run: the wheel turned for a while at one motor value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measurement {
    /// The motor value that was set (0..255).
    pub value: f64,
    /// How fast the wheel turned (revolutions a second).
    pub revolutions_per_s: f64,
    /// Battery voltage meanwhile (V), mean of start and end.
    pub volts: f64,
}

impl Measurement {
    /// From the encoder's ticks in a stretch of time. `None` unless time and ticks a revolution are positive.
    pub fn from_ticks(
        value: f64,
        ticks: u32,
        ticks_per_revolution: u32,
        duration_s: f64,
        volts: f64,
    ) -> Option<Self> {
        (duration_s > 0.0 && ticks_per_revolution > 0).then(|| Self {
            value,
            revolutions_per_s: f64::from(ticks) / f64::from(ticks_per_revolution) / duration_s,
            volts,
        })
    }
}

/// value = `value_per_revps` · rev/s + `value_at_rest`, at `volts`; speed is proportional to voltage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorLine {
    /// Motor value for each revolution a second.
    pub value_per_revps: f64,
    /// Motor value at which the wheel just stands still.
    pub value_at_rest: f64,
    /// Voltage at which the line holds (V).
    pub volts: f64,
}

impl MotorLine {
    /// The document's GoPiGo (its eq. 22).
    pub const GOPIGO: Self = Self {
        value_per_revps: 115.7985,
        value_at_rest: 18.1987,
        volts: 9.277,
    };

    /// The least-squares line through measurements of one or several voltages: speeds are carried over to `volts` in
    /// proportion first. The document fits the run at one voltage and takes that for `volts`.
    pub fn fit(measurements: &[Measurement], volts: f64) -> Result<MotorFit, MotorFitError> {
        if !(volts.is_finite() && volts > 0.0) {
            return Err(MotorFitError::Volts { volts });
        }
        for (index, m) in measurements.iter().enumerate() {
            let good = (0.0..=LARGEST_VALUE).contains(&m.value)
                && (0.0..1e4).contains(&m.revolutions_per_s)
                && (0.1..1e3).contains(&m.volts);
            if !good {
                return Err(MotorFitError::Measurement {
                    index,
                    measurement: *m,
                });
            }
        }
        let speeds: Vec<f64> = measurements
            .iter()
            .map(|m| m.revolutions_per_s * volts / m.volts)
            .collect();
        let count = speeds.len() as f64;
        let mean_speed = speeds.iter().sum::<f64>() / count;
        let mean_value = measurements.iter().map(|m| m.value).sum::<f64>() / count;
        let (mut spread, mut shared) = (0.0, 0.0);
        for (speed, m) in speeds.iter().zip(measurements) {
            spread += (speed - mean_speed) * (speed - mean_speed);
            shared += (speed - mean_speed) * (m.value - mean_value);
        }
        // Also true of no measurement at all (not a number).
        if !(spread > 1e-12 * count) {
            return Err(MotorFitError::TooFew { found: speeds.len() });
        }
        let value_per_revps = shared / spread;
        if !(value_per_revps > 0.0) {
            return Err(MotorFitError::Falling { value_per_revps });
        }
        let line = Self {
            value_per_revps,
            value_at_rest: mean_value - value_per_revps * mean_speed,
            volts,
        };
        let squares: f64 = measurements
            .iter()
            .map(|m| line.unlimited(m.revolutions_per_s, m.volts) - m.value)
            .map(|error| error * error)
            .sum();
        Ok(MotorFit {
            line,
            rms_value: (squares / count).sqrt(),
            measurements: speeds.len(),
        })
    }

    fn unlimited(&self, revolutions_per_s: f64, volts: f64) -> f64 {
        self.value_per_revps * revolutions_per_s * self.volts / volts + self.value_at_rest
    }

    /// The motor value (0..255) at which the wheel turns so fast (rev/s, either direction) on a battery of so many volts. 0
    /// for a wheel that shall stand; 255 when the battery cannot give the speed, or gives no voltage.
    pub fn value(&self, revolutions_per_s: f64, volts: f64) -> f64 {
        if revolutions_per_s == 0.0 {
            return 0.0;
        }
        if !(volts > 0.0) {
            return LARGEST_VALUE;
        }
        self.unlimited(revolutions_per_s.abs(), volts)
            .clamp(0.0, LARGEST_VALUE)
    }

    /// How fast (rev/s) the wheel turns at a motor value on a battery of so many volts; 0 below the value at rest.
    pub fn revolutions_per_s(&self, value: f64, volts: f64) -> f64 {
        ((value - self.value_at_rest) / self.value_per_revps * volts / self.volts).max(0.0)
    }
}

/// A fitted line and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MotorFit {
    /// The line.
    pub line: MotorLine,
    /// Root mean square difference between the line and the values that were set.
    pub rms_value: f64,
    /// How many measurements went in.
    pub measurements: usize,
}

/// Why no line could be fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MotorFitError {
    /// The voltage to fit for is impossible.
    #[error("expected a positive voltage to fit for, but found {volts} V")]
    Volts {
        /// What was given (V).
        volts: f64,
    },
    /// A measurement is impossible.
    #[error(
        "measurement {index}: expected a value from 0 to 255, a speed from 0 rev/s and a voltage from 0.1 V, but found {measurement:?}"
    )]
    Measurement {
        /// Which one, from 0.
        index: usize,
        /// What it says.
        measurement: Measurement,
    },
    /// Too few different speeds.
    #[error(
        "expected at least two different wheel speeds, but found {found} measurements that show fewer: run the motor at several values"
    )]
    TooFew {
        /// How many measurements.
        found: usize,
    },
    /// Slower at larger values.
    #[error(
        "expected the wheel to turn faster at larger values, but it slowed down ({value_per_revps} per rev/s): check the wiring and which wheel was measured"
    )]
    Falling {
        /// The fitted slope.
        value_per_revps: f64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The document's table 9: rev/s at values 100, 110, … 250.
    const AT_9_277_V: [f64; 16] = [
        0.73, 0.82, 0.90, 0.97, 1.05, 1.12, 1.20, 1.27, 1.38, 1.47, 1.55, 1.67, 1.76, 1.84, 1.93, 2.02,
    ];
    const AT_4_394_V: [f64; 16] = [
        0.32, 0.36, 0.41, 0.46, 0.49, 0.52, 0.56, 0.61, 0.64, 0.68, 0.73, 0.79, 0.82, 0.88, 0.93, 0.97,
    ];

    fn table(speeds: &[f64], volts: f64) -> Vec<Measurement> {
        let row = |(index, speed): (usize, &f64)| Measurement {
            value: 100.0 + 10.0 * index as f64,
            revolutions_per_s: *speed,
            volts,
        };
        speeds.iter().enumerate().map(row).collect()
    }

    #[test]
    fn the_documents_coefficients() {
        let fit = MotorLine::fit(&table(&AT_9_277_V, 9.277), 9.277).unwrap();
        // The printed speeds are rounded to 0.01 rev/s: their own least-squares line is 115.6699 and 18.2673. Rounding
        // moves the coefficients by 0.21 and 0.29 (standard deviation), so the document's lie within that.
        assert!((fit.line.value_per_revps - 115.7985).abs() < 0.2, "{fit:?}");
        assert!((fit.line.value_at_rest - 18.1987).abs() < 0.2, "{fit:?}");
        assert!((fit.line.value_per_revps - 115.669_875).abs() < 1e-6, "{fit:?}");
        assert!(fit.rms_value < 2.5);
    }

    #[test]
    fn speed_is_proportional_to_voltage_in_the_documents_tables() {
        let line = MotorLine::fit(&table(&AT_9_277_V, 9.277), 9.277).unwrap().line;
        for m in table(&AT_4_394_V, 4.394) {
            let predicted = line.value(m.revolutions_per_s, m.volts);
            assert!((predicted - m.value).abs() < 7.0, "{m:?}: {predicted}");
        }
        let mut both = table(&AT_9_277_V, 9.277);
        both.extend(table(&AT_4_394_V, 4.394));
        let fit = MotorLine::fit(&both, 9.277).unwrap();
        assert!(
            (fit.line.value_per_revps - 115.8).abs() < 4.0 && fit.rms_value < 3.5,
            "{fit:?}"
        );
    }

    #[test]
    fn a_standing_wheel_gets_nothing_and_an_impossible_speed_gets_all() {
        assert_eq!(MotorLine::GOPIGO.value(0.0, 9.0), 0.0);
        assert_eq!(MotorLine::GOPIGO.value(9.0, 9.0), 255.0);
        assert_eq!(MotorLine::GOPIGO.value(1.0, 0.0), 255.0);
        assert_eq!(
            MotorLine::GOPIGO.value(-1.0, 9.0),
            MotorLine::GOPIGO.value(1.0, 9.0)
        );
        assert_eq!(MotorLine::GOPIGO.revolutions_per_s(10.0, 9.0), 0.0);
    }

    #[test]
    fn encoder_ticks_become_revolutions() {
        let m = Measurement::from_ticks(100.0, 36, 18, 4.0, 9.0).unwrap();
        assert_eq!(m.revolutions_per_s, 0.5);
        assert!(Measurement::from_ticks(100.0, 36, 0, 4.0, 9.0).is_none());
        assert!(Measurement::from_ticks(100.0, 36, 18, 0.0, 9.0).is_none());
    }

    #[test]
    fn useless_runs_are_refused() {
        let refused =
            |measurements: &[Measurement]| MotorLine::fit(measurements, 9.0).unwrap_err().to_string();
        assert!(refused(&[]).contains("0 measurements"));
        assert!(refused(&table(&[1.0, 1.0], 9.0)).contains("several values"));
        assert!(refused(&table(&[2.0, 1.0], 9.0)).contains("slowed down"));
        assert!(refused(&table(&[1.0, f64::NAN], 9.0)).contains("measurement 1"));
    }

    proptest! {
        #[test]
        fn values_and_speeds_invert(speed in 0.05..1.5f64, volts in 8.0..12.0f64) {
            let line = MotorLine::GOPIGO;
            let value = line.value(speed, volts);
            prop_assume!(value < 255.0);
            prop_assert!((line.revolutions_per_s(value, volts) - speed).abs() < 1e-9);
        }
    }
}
