//! Junctions: the line under the vehicle turns away or ends, and straight on beyond a gap there is another (D5 in SPEC).
//!
//! The document sums pixels in two triangles of the picture and asks whether straight fits of both cross the diagonal. On the
//! floor the same question is: does a line lie on the straight continuation, apart from the one that is followed?

use super::trace::{Rings, Trace};
use senda_geom::Vec2;

/// A straight line ahead, y = intercept + slope·x in the vehicle frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FarLine {
    /// To the left at the vehicle (m).
    pub intercept_m: f64,
    /// Tangent of its direction.
    pub slope: f64,
    /// Where what is seen of it begins and ends (m ahead).
    pub span_m: [f64; 2],
}

impl FarLine {
    /// To the left at a distance ahead (m).
    pub fn left_at(&self, ahead_m: f64) -> f64 {
        self.intercept_m + self.slope * ahead_m
    }

    /// The line through a nearer point and the middle of what is seen: of a short piece far away the place is certain and
    /// the direction is not, but it continues the line on this side.
    fn through(&self, near: Vec2) -> Self {
        let middle_m = 0.5 * (self.span_m[0] + self.span_m[1]);
        let slope = (self.left_at(middle_m) - near.y) / (middle_m - near.x).max(0.1);
        Self {
            intercept_m: near.y - slope * near.x,
            slope,
            span_m: self.span_m,
        }
    }
}

/// A junction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Junction {
    /// How far ahead the followed line leaves the straight continuation, or ends (m).
    pub distance_m: f64,
    /// To which side it leaves: 1 left, -1 right, 0 it ends.
    pub side: i8,
    /// The line beyond.
    pub beyond: FarLine,
}

/// A line that is this far from the straight continuation has left it (m).
const LEFT_M: f64 = 0.04;
/// Between the followed line and the one beyond lies at least this much without either (m).
const GAP_M: f64 = 0.15;
/// The line beyond is seen for at least this long (m).
const SEEN_M: f64 = 0.10;
/// … and runs in about the same direction.
const SLOPE: f64 = 0.22;
/// The followed line leads straight ahead before a junction: tangent of its direction at most.
const STRAIGHT: f64 = 0.18;

/// The junction ahead, if there is one.
pub(super) fn find(rings: &Rings, line: &Trace) -> Option<Junction> {
    let first = *line.points.first()?;
    if first.y.abs() > 0.12 {
        return None;
    }
    // The continuation: through the line's beginning, in its direction as far as it is straight, else straight ahead.
    let near = || line.points.iter().take_while(|point| point.x < first.x + 0.14);
    let (count, sum) = near().fold((0.0, Vec2::ZERO), |(n, sum), p| (n + 1.0, sum + *p));
    let mean = sum / count;
    let (xx, xy) = near().fold((0.0, 0.0), |(xx, xy), p| {
        let d = *p - mean;
        (xx + d.x * d.x, xy + d.x * d.y)
    });
    // A short piece says little: the slope is drawn towards 0 by as much as 5 cm of line would say.
    let slope = (xy / (xx + 0.002)).clamp(-0.3, 0.3);
    // In a corner every street that the tangent meets would be one.
    if slope.abs() > STRAIGHT {
        return None;
    }
    let intercept_m = first.y - slope * first.x;
    let off = |point: &Vec2| point.y - (intercept_m + slope * point.x);
    let leaves = line.points.iter().position(|point| off(point).abs() > LEFT_M);
    let last = line.points[line.points.len() - 1];
    let (distance_m, side) = match leaves {
        Some(index) => {
            let end = off(&last);
            (line.points[index].x, if end > 0.0 { 1 } else { -1 })
        }
        None => (last.x, 0),
    };
    if distance_m > 0.8 {
        return None;
    }
    let beyond = fit_near(rings, intercept_m, slope, 0.05, distance_m + GAP_M)?;
    let straight = (beyond.slope - slope).abs() < SLOPE;
    // A line that only goes on after a crossing over it lies nearer than any junction's far side.
    let apart = beyond.span_m[0] - distance_m >= GAP_M && beyond.span_m[0] < 1.3;
    (straight && apart && beyond.span_m[1] - beyond.span_m[0] >= SEEN_M).then_some(Junction {
        distance_m,
        side,
        beyond: beyond.through(mean),
    })
}

/// Clusters within a gate (m, plus a tenth of the distance) of y = intercept + slope·x and beyond `from_m`, as a line.
pub(super) fn fit_near(
    rings: &Rings,
    intercept_m: f64,
    slope: f64,
    gate_m: f64,
    from_m: f64,
) -> Option<FarLine> {
    let mut count = 0.0;
    let (mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for cluster in rings.clusters() {
        let at = cluster.at;
        let off_m = at.y - (intercept_m + slope * at.x);
        // A line seen lengthways is narrow; one that runs across is not the one ahead.
        if at.x < from_m || off_m.abs() > gate_m + 0.04 * at.x || cluster.width_m > 0.05 + 0.03 * at.x {
            continue;
        }
        count += 1.0;
        sx += at.x;
        sy += at.y;
        sxx += at.x * at.x;
        sxy += at.x * at.y;
        (low, high) = (low.min(at.x), high.max(at.x));
    }
    if count < 3.0 {
        return None;
    }
    let spread = count * sxx - sx * sx;
    if spread < 1e-6 {
        return None;
    }
    let fitted = (count * sxy - sx * sy) / spread;
    Some(FarLine {
        intercept_m: (sy - fitted * sx) / count,
        slope: fitted,
        span_m: [low, high],
    })
}
