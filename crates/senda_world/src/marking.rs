//! Lines painted along the path.

use crate::colour::{Colour, ReadColour};
use crate::error::WorldError;
use crate::path::FAR_M;
use crate::reader::Table;
use crate::writer::Document;

/// A line painted or taped at a constant offset from the path.
#[derive(Debug, Clone, PartialEq)]
pub struct Marking {
    /// Offset of its middle from the path (m), left positive in driving direction.
    pub offset_m: f64,
    /// Width (m).
    pub width_m: f64,
    /// Colour of fresh paint.
    pub colour: Colour,
    /// Dashes; `None`: a solid line.
    pub dash: Option<Dash>,
    /// Stations between which it exists (m, driving direction, from < to); `None`: all along.
    pub span_m: Option<(f64, f64)>,
    /// Share of the paint that is worn away, 0 (fresh) ..= 1 (nearly gone): scattered, more at the edges.
    pub wear: f64,
    /// How dirty it is, 0 ..= 1: blotches that pull the colour towards dirt.
    pub stain: f64,
    /// Gloss of the paint, 0 ..= 1 (fabric tape 0.1, vinyl tape 0.4).
    pub gloss: f64,
}

/// Dashes of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dash {
    /// Painted length (m).
    pub length_m: f64,
    /// Length of the gap (m).
    pub gap_m: f64,
    /// Station at which a dash begins (m).
    pub phase_m: f64,
}

impl Marking {
    /// A fresh solid line.
    pub fn solid(offset_m: f64, width_m: f64, colour: Colour) -> Self {
        Self {
            offset_m,
            width_m,
            colour,
            dash: None,
            span_m: None,
            wear: 0.0,
            stain: 0.0,
            gloss: 0.2,
        }
    }

    /// Whether there is paint at a station (m); dashes and span only.
    pub fn covers(&self, station_m: f64) -> bool {
        if let Some((from_m, to_m)) = self.span_m
            && !(from_m..=to_m).contains(&station_m)
        {
            return false;
        }
        match self.dash {
            Some(dash) => (station_m - dash.phase_m).rem_euclid(dash.length_m + dash.gap_m) < dash.length_m,
            None => true,
        }
    }

    pub(crate) fn reversed(&self, length_m: f64) -> Self {
        Self {
            offset_m: 0.0 - self.offset_m,
            span_m: self
                .span_m
                .map(|(from_m, to_m)| ((length_m - to_m).max(0.0), length_m - from_m)),
            dash: self.dash.map(|dash| Dash {
                phase_m: (length_m - dash.phase_m - dash.length_m).rem_euclid(dash.length_m + dash.gap_m),
                ..dash
            }),
            ..self.clone()
        }
    }

    /// One table may give several markings: `side = "both"`, `double_gap_m`.
    pub(crate) fn read(
        mut table: Table,
        lane_width_m: Option<f64>,
        path_length_m: f64,
    ) -> Result<Vec<Self>, WorldError> {
        table.only(&[
            "offset_m",
            "side",
            "width_m",
            "colour",
            "dash",
            "from_m",
            "to_m",
            "wear",
            "stain",
            "gloss",
            "double_gap_m",
        ])?;
        let offset_m = table.optional_f64("offset_m", -FAR_M, FAR_M)?;
        let side = table.optional_word("side", &["left", "right", "both", "middle"])?;
        if offset_m.is_some() && side.is_some() {
            return Err(table.problem("side", "either offset_m or side", "both", "remove one"));
        }
        if lane_width_m.is_none() && side.is_some_and(|side| side != "middle") {
            return Err(table.problem(
                "side",
                "side = \"middle\" in a world without a lane",
                "another side",
                "set lane_width_m, or write offset_m",
            ));
        }
        let half_m = lane_width_m.unwrap_or(0.0) / 2.0;
        let offsets_m = match (offset_m, side) {
            (Some(offset_m), _) => vec![offset_m],
            (None, Some("both")) => vec![half_m, -half_m],
            (None, Some("left")) => vec![half_m],
            (None, Some("right")) => vec![-half_m],
            (None, _) => vec![0.0],
        };
        let width_m = table.required_f64("width_m", 1e-3, 10.0)?;
        let colour = table.optional_colour("colour")?;
        let colour = colour.ok_or_else(|| table.missing("colour", "a colour such as \"white\""))?;
        let dash = match table.optional_table("dash")? {
            Some(mut dash) => {
                let read = Dash {
                    length_m: dash.required_f64("length_m", 1e-3, FAR_M)?,
                    gap_m: dash.required_f64("gap_m", 1e-3, FAR_M)?,
                    phase_m: dash.f64("phase_m", -FAR_M, FAR_M, 0.0)?,
                };
                dash.finish()?;
                Some(read)
            }
            None => None,
        };
        let from_m = table.optional_f64("from_m", 0.0, FAR_M)?;
        let to_m = table.optional_f64("to_m", 0.0, FAR_M)?;
        let span_m = match (from_m, to_m) {
            (None, None) => None,
            (from_m, to_m) => Some((
                from_m.unwrap_or(0.0),
                to_m.unwrap_or(path_length_m).min(path_length_m),
            )),
        };
        if let Some((from_m, to_m)) = span_m
            && to_m <= from_m
        {
            return Err(table.problem(
                "to_m",
                "a station after from_m, on the path",
                format!("{from_m} to {to_m}"),
                "",
            ));
        }
        let wear = table.f64("wear", 0.0, 1.0, 0.0)?;
        let stain = table.f64("stain", 0.0, 1.0, 0.0)?;
        let gloss = table.f64("gloss", 0.0, 1.0, 0.2)?;
        let double_gap_m = table.optional_f64("double_gap_m", 1e-3, 10.0)?;
        table.finish()?;
        let mut markings = Vec::new();
        for offset_m in offsets_m {
            let shifts_m = match double_gap_m {
                Some(gap_m) => vec![(gap_m + width_m) / 2.0, -(gap_m + width_m) / 2.0],
                None => vec![0.0],
            };
            for shift_m in shifts_m {
                markings.push(Self {
                    offset_m: offset_m + shift_m + 0.0,
                    width_m,
                    colour,
                    dash,
                    span_m,
                    wear,
                    stain,
                    gloss,
                });
            }
        }
        Ok(markings)
    }

    pub(crate) fn write(&self, document: &mut Document, item: &str) {
        document.item(item);
        document.number("offset_m", self.offset_m);
        document.number("width_m", self.width_m);
        document.text("colour", &self.colour.to_string());
        if let Some(dash) = self.dash {
            document.line(
                "dash",
                format!(
                    "{{ length_m = {:?}, gap_m = {:?}, phase_m = {:?} }}",
                    dash.length_m, dash.gap_m, dash.phase_m
                ),
            );
        }
        if let Some((from_m, to_m)) = self.span_m {
            document.number("from_m", from_m);
            document.number("to_m", to_m);
        }
        document.number("wear", self.wear);
        document.number("stain", self.stain);
        document.number("gloss", self.gloss);
    }
}
