//! Axes: ranges and round ticks.

use crate::text;
use senda_geom::trig;

/// One axis of a plot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Axis {
    /// What it shows: `lane error`.
    pub label: String,
    /// Unit of the values as given: `cm`, `°`, `s`; empty for a pure number.
    pub unit: String,
    /// Fixed range instead of that of the values.
    pub range: Option<[f64; 2]>,
    /// Values that the range must hold, such as 0.
    pub include: Vec<f64>,
}

impl Axis {
    /// An axis with label and unit that fits its values.
    pub fn new(label: &str, unit: &str) -> Self {
        Self {
            label: label.into(),
            unit: unit.into(),
            ..Self::default()
        }
    }

    /// With a fixed range.
    pub fn ranged(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }

    /// With a value that must be in the range.
    pub fn including(mut self, value: f64) -> Self {
        self.include.push(value);
        self
    }

    /// Label and unit as written at the axis: `lane error (cm)`.
    pub fn name(&self) -> String {
        if self.unit.is_empty() {
            self.label.clone()
        } else {
            format!("{} ({})", self.label, self.unit)
        }
    }

    /// The range for `values`: fixed, or the values' own; `round` widens it to ticks.
    pub(super) fn fit(&self, values: impl Iterator<Item = f64>, round: bool) -> [f64; 2] {
        if let Some([low, high]) = self.range
            && low.is_finite()
            && high.is_finite()
            && low < high
        {
            return [low, high];
        }
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values
            .chain(self.include.iter().copied())
            .filter(|v| v.is_finite())
        {
            let value = value.clamp(-1e12, 1e12);
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            return [0.0, 1.0];
        }
        // Values that hardly differ would magnify rounding errors to mountains.
        let least = (1e-6 * low.abs().max(high.abs())).max(1e-9);
        if high - low < least {
            let half = (0.1 * low.abs())
                .max(0.5 * least)
                .max(if low == 0.0 { 1.0 } else { 0.0 });
            (low, high) = (low - half, high + half);
        }
        if round {
            let step = step(low, high, 5);
            (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
        }
        [low, high]
    }
}

/// The round step (1, 2 or 5 times a power of ten) that divides a range into about `count` parts.
fn step(low: f64, high: f64, count: usize) -> f64 {
    let raw = (high - low) / count.max(1) as f64;
    let power = trig::pow(10.0, trig::log10(raw).floor());
    let part = raw / power;
    power
        * if part < 1.5 {
            1.0
        } else if part < 3.5 {
            2.0
        } else if part < 7.5 {
            5.0
        } else {
            10.0
        }
}

/// Round values inside a range, about `count` of them, with their labels. Empty unless `low < high`, both finite.
pub fn ticks(low: f64, high: f64, count: usize) -> Vec<(f64, String)> {
    if !(low < high && low.is_finite() && high.is_finite()) {
        return Vec::new();
    }
    let step = step(low, high, count);
    let digits = (-trig::log10(step).floor()).clamp(0.0, 12.0) as usize;
    let (first, last) = ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor());
    if !(last - first).is_finite() || last - first > 1000.0 {
        return Vec::new();
    }
    (0..=(last - first) as usize)
        .map(|i| (first + i as f64) * step)
        .map(|value| (value, text::fixed(value, digits)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ticks_are_round() {
        let labels = |low, high| ticks(low, high, 5).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels(0.0, 100.0), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(labels(-0.05, 0.05), ["−0.04", "−0.02", "0.00", "0.02", "0.04"]);
        assert!(labels(1.0, 1.0).is_empty() && labels(f64::NAN, 1.0).is_empty());
    }

    #[test]
    fn constant_values_get_a_range() {
        let axis = Axis::new("d", "cm");
        assert_eq!(axis.fit([0.0, 0.0].into_iter(), true), [-1.0, 1.0]);
        let [low, high] = axis.fit([5.0].into_iter(), true);
        assert!(low < 5.0 && 5.0 < high);
        assert_eq!(axis.fit([f64::NAN].into_iter(), true), [0.0, 1.0]);
    }

    proptest! {
        #[test]
        fn ranges_hold_their_values_and_have_few_ticks(a in -1e9..1e9f64, b in -1e9..1e9f64, scale in -9..9i32) {
            let scale = trig::pow(10.0, f64::from(scale));
            let values = [a * scale, b * scale];
            let [low, high] = Axis::default().fit(values.into_iter(), true);
            prop_assert!(low < high);
            for value in values {
                let value = value.clamp(-1e12, 1e12);
                prop_assert!(low <= value + 1e-9 * value.abs() && value <= high + 1e-9 * value.abs());
            }
            let count = ticks(low, high, 5).len();
            prop_assert!((2..=12).contains(&count), "{count} {low} {high}");
        }
    }
}
