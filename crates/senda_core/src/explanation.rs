//! How a command came about: for logs, overlays and reports.

use serde::{Deserialize, Serialize};

/// A number worth plotting, with its unit in the name: `omega_radps`, `threshold`, `found`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Signal {
    /// Name with unit suffix.
    pub name: String,
    /// The value; `NaN` where there is none (a state without a line).
    #[serde(with = "maybe_nan")]
    pub value: f64,
}

/// Something to draw over a camera's picture, in that picture's pixels (pixel centres at +0.5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Shape {
    /// Joined points.
    Polyline {
        /// u, v of each point (px).
        points: Vec<[f32; 2]>,
        /// CSS colour.
        color: String,
        /// Whether the last point joins the first.
        closed: bool,
    },
    /// A circle.
    Circle {
        /// Centre (px).
        centre: [f32; 2],
        /// Radius (px).
        radius_px: f32,
        /// CSS colour.
        color: String,
    },
    /// A word at a place.
    Text {
        /// Lower left corner (px).
        at: [f32; 2],
        /// The word.
        text: String,
        /// CSS colour.
        color: String,
    },
}

/// Signals, shapes and events of one step. Reused between steps: [`Explanation::clear`] keeps the memory.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Explanation {
    /// Numbers, in the order that the driver gives them.
    #[serde(default)]
    pub signals: Vec<Signal>,
    /// Shapes over the first camera's picture.
    #[serde(default)]
    pub shapes: Vec<Shape>,
    /// Things that happened in this step: `line lost`, `lane entered`.
    #[serde(default)]
    pub events: Vec<String>,
}

impl Explanation {
    /// Name of the signal that says how far a pedal is pressed (-1..1), by the driver or by the vehicle's own speed control.
    pub const PEDAL: &'static str = "pedal";

    /// The last value of a number in this step.
    pub fn signal_named(&self, name: &str) -> Option<f64> {
        let found = self.signals.iter().rfind(|signal| signal.name == name);
        found.map(|signal| signal.value)
    }

    /// Empties it.
    pub fn clear(&mut self) {
        self.signals.clear();
        self.shapes.clear();
        self.events.clear();
    }

    /// Adds a number.
    pub fn signal(&mut self, name: &str, value: f64) {
        self.signals.push(Signal {
            name: name.to_owned(),
            value,
        });
    }

    /// Adds a polyline.
    pub fn polyline(&mut self, points: impl IntoIterator<Item = [f32; 2]>, color: &str, closed: bool) {
        let points = points.into_iter().collect();
        self.shapes.push(Shape::Polyline {
            points,
            color: color.to_owned(),
            closed,
        });
    }

    /// Adds a circle.
    pub fn circle(&mut self, centre: [f32; 2], radius_px: f32, color: &str) {
        self.shapes.push(Shape::Circle {
            centre,
            radius_px,
            color: color.to_owned(),
        });
    }

    /// Adds a word.
    pub fn text(&mut self, at: [f32; 2], text: impl Into<String>, color: &str) {
        self.shapes.push(Shape::Text {
            at,
            text: text.into(),
            color: color.to_owned(),
        });
    }

    /// Adds an event.
    pub fn event(&mut self, event: impl Into<String>) {
        self.events.push(event.into());
    }
}

/// JSON has no NaN: `null` stands for it.
mod maybe_nan {
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        if value.is_finite() {
            serializer.serialize_f64(*value)
        } else {
            serializer.serialize_none()
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_number_survives_json() {
        let mut explanation = Explanation::default();
        explanation.signal("d_m", f64::NAN);
        explanation.signal("omega_radps", -0.5);
        explanation.polyline([[0.5, 1.5]], "red", false);
        explanation.event("line lost");
        let json = serde_json::to_string(&explanation).unwrap();
        let back: Explanation = serde_json::from_str(&json).unwrap();
        assert!(back.signals[0].value.is_nan() && back.signals[1].value == -0.5);
        assert_eq!(
            (back.shapes, back.events),
            (explanation.shapes, explanation.events)
        );
    }

    #[test]
    fn clearing_keeps_the_memory() {
        let mut explanation = Explanation::default();
        explanation.signal("found", 1.0);
        explanation.circle([1.0, 2.0], 3.0, "lime");
        explanation.text([1.0, 2.0], "line", "lime");
        let room = explanation.signals.capacity();
        explanation.clear();
        assert_eq!(
            (&explanation, explanation.signals.capacity()),
            (&Explanation::default(), room)
        );
    }
}
