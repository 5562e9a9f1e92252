//! Columns of numbers over a run's steps, in the units that people read, for plots and for the page's script.

use senda_core::Body;
use senda_data::Recording;
use serde_json::{Value, json};

/// One quantity over all steps of a run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    /// Key in the page's data; unique within a run.
    pub(super) key: String,
    /// Name for people.
    pub(super) name: String,
    /// Unit of `values`.
    pub(super) unit: &'static str,
    /// One value a step; `NaN` where there is none.
    pub(super) values: Vec<f64>,
}

impl Column {
    /// A column in SI with the unit in its name (`d_m`, `omega_radps`), converted for reading.
    pub(super) fn from_si(key: &str, name: &str, si_name: &str, scale: Scale, mut values: Vec<f64>) -> Self {
        let (unit, factor) = reading_unit(si_name, scale);
        for value in &mut values {
            *value *= factor;
        }
        Self {
            key: key.into(),
            name: name.into(),
            unit,
            values,
        }
    }

    /// The one value that it has wherever it has any, if there is only one.
    pub(super) fn constant(&self) -> Option<f64> {
        let mut finite = self.values.iter().copied().filter(|value| value.is_finite());
        let first = finite.next()?;
        finite.all(|value| value == first).then_some(first)
    }

    /// As the script reads it: four significant digits, `null` for no value.
    pub(super) fn json(&self) -> Value {
        json!({"name": self.name, "unit": self.unit, "values": numbers(&self.values)})
    }
}

/// Whether lengths and speeds are read in centimetres or in metres. One choice for a whole run, so that series of one
/// plot never differ in unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    /// Model vehicles: cm, cm/s.
    Model,
    /// Real cars: m, m/s.
    Car,
}

impl Scale {
    /// The scale that suits a vehicle.
    pub(super) fn of(body: &Body) -> Self {
        if body.length_m < 1.0 {
            Self::Model
        } else {
            Self::Car
        }
    }
}

/// Name of the time that the driver took for each frame.
pub(super) const FRAME_TIME: &str = "frame_time_s";

/// The unit that people read for an SI quantity and the factor to it, by the suffix of its name.
fn reading_unit(si_name: &str, scale: Scale) -> (&'static str, f64) {
    if si_name.ends_with("_per_m") {
        return ("1/m", 1.0);
    }
    let suffix = si_name.rsplit('_').next().unwrap_or("");
    let small = scale == Scale::Model;
    match suffix {
        "rad" => ("°", 180.0 / std::f64::consts::PI),
        "radps" => ("°/s", 180.0 / std::f64::consts::PI),
        "m" if small => ("cm", 100.0),
        "m" => ("m", 1.0),
        "mps" if small => ("cm/s", 100.0),
        "mps" => ("m/s", 1.0),
        // A frame takes milliseconds; what drivers count in seconds (time since a loss) takes seconds.
        "s" if si_name == FRAME_TIME => ("ms", 1000.0),
        "s" => ("s", 1.0),
        "px" => ("px", 1.0),
        "v" => ("V", 1.0),
        _ => ("", 1.0),
    }
}

/// The name of a signal without its unit: `desired_angle_rad` is `desired angle`.
pub(super) fn words(si_name: &str) -> String {
    let name = si_name.strip_suffix("_per_m").unwrap_or(si_name);
    let name = ["_radps", "_rad", "_mps", "_px", "_m", "_s", "_v"]
        .iter()
        .find_map(|suffix| name.strip_suffix(suffix))
        .filter(|rest| !rest.is_empty())
        .unwrap_or(name);
    match name {
        "omega" => "ω".into(),
        "theta" => "θ".into(),
        other => other.replace('_', " "),
    }
}

/// All signals that a driver gave in its explanations, by name in order of first appearance.
pub(super) fn of_driver(recording: &Recording) -> Vec<(String, Vec<f64>)> {
    /// A driver that invents a name for every frame must not fill the memory.
    const MOST: usize = 64;
    let count = recording.steps.len();
    let mut columns: Vec<(String, Vec<f64>)> = Vec::new();
    for (i, step) in recording.steps.iter().enumerate() {
        for signal in &step.explanation.signals {
            let place = columns.iter().position(|(name, _)| *name == signal.name);
            let place = match place {
                Some(place) => place,
                None if columns.len() < MOST => {
                    columns.push((signal.name.clone(), vec![f64::NAN; count]));
                    columns.len() - 1
                }
                None => continue,
            };
            columns[place].1[i] = signal.value;
        }
    }
    columns
}

/// Numbers as JSON with four significant digits; `null` for what is not finite.
pub(super) fn numbers(values: &[f64]) -> Value {
    Value::Array(values.iter().map(|value| number(*value, 4)).collect())
}

/// Numbers as JSON with `decimals` after the point.
pub(super) fn fixed_numbers(values: &[f64], decimals: i32) -> Value {
    let power = senda_geom::trig::pow(10.0, f64::from(decimals));
    Value::Array(
        values
            .iter()
            .map(|value| number((value * power).round() / power, 15))
            .collect(),
    )
}

fn number(value: f64, significant: usize) -> Value {
    if !value.is_finite() {
        return Value::Null;
    }
    let rounded: f64 = format!("{value:.*e}", significant - 1).parse().unwrap_or(value);
    // Whole numbers without a needless ".0".
    if rounded == rounded.trunc() && rounded.abs() < 1e15 {
        json!(rounded as i64)
    } else {
        json!(rounded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_follow_the_names() {
        let column = Column::from_si("d", "d", "d_m", Scale::Model, vec![0.1, f64::NAN]);
        assert_eq!(column.unit, "cm");
        assert_eq!(column.json()["values"], json!([10, null]));
        assert_eq!(Column::from_si("d", "d", "d_m", Scale::Car, vec![3.0]).unit, "m");
        assert_eq!(
            Column::from_si("w", "w", "omega_radps", Scale::Car, vec![1.0]).json()["values"],
            json!([57.3])
        );
        assert_eq!(
            Column::from_si("k", "k", "curvature_per_m", Scale::Car, vec![1.0]).unit,
            "1/m"
        );
        assert_eq!(Column::from_si("f", "f", "found", Scale::Car, vec![1.0]).unit, "");
        assert_eq!(
            ["desired_angle_rad", "omega_radps", "found", "curvature_per_m"].map(words),
            ["desired angle", "ω", "found", "curvature"]
        );
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            fixed_numbers(&[1.23456, f64::INFINITY, 2.0], 2),
            json!([1.23, null, 2])
        );
        assert_eq!(
            numbers(&[123_456.0, -0.000_123_46]),
            json!([123_500, -0.000_123_5])
        );
    }
}
