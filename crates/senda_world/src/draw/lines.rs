//! Markings as lines on the floor.

use crate::marking::Marking;
use senda_geom::{Curve, Vec2};

/// Points along a marking stand at most this far apart (m): 0.01 mm of sagitta at 0.3 m radius.
const SPACING_M: f64 = 0.005;

/// The middle of a marking's painted parts (m): one run of points for each dash, or one in all. Points stand no nearer
/// than `finest_m`.
pub(super) fn marking_lines(path: &Curve, marking: &Marking, finest_m: f64) -> Vec<Vec<Vec2>> {
    let (from_m, to_m) = marking.span_m.unwrap_or((0.0, path.length_m()));
    let mut runs = Vec::new();
    match marking.dash {
        None => runs.push((from_m, to_m)),
        Some(dash) => {
            let period_m = dash.length_m + dash.gap_m;
            let mut number = ((from_m - dash.phase_m) / period_m).floor();
            loop {
                let begin_m = dash.phase_m + number * period_m;
                if begin_m >= to_m || runs.len() > 1_000_000 {
                    break;
                }
                let (low_m, high_m) = (begin_m.max(from_m), (begin_m + dash.length_m).min(to_m));
                if high_m > low_m {
                    runs.push((low_m, high_m));
                }
                number += 1.0;
            }
        }
    }
    let spacing_m = SPACING_M.max(path.length_m() / 20_000.0).max(finest_m);
    runs.into_iter()
        .map(|(low_m, high_m)| {
            let steps = ((high_m - low_m) / spacing_m).ceil().max(1.0) as usize;
            (0..=steps)
                .map(|i| {
                    let station_m = low_m + (high_m - low_m) * i as f64 / steps as f64;
                    let pose = path.pose_at(station_m);
                    pose.position() + pose.left() * marking.offset_m
                })
                .collect()
        })
        .collect()
}
