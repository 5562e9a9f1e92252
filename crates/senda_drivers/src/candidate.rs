//! A blob as a line candidate: its middle points on the floor, and which of its rows are believed.

use crate::follow::LineState;
use crate::sight::SightOptions;
use senda_geom::{Vec2, trig};
use senda_vision::{FloorMap, LineBlob, WidthProfile};

/// A point of a line's middle on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FloorPoint {
    /// In the vehicle frame (m).
    pub(crate) at: Vec2,
    /// How far it may be wrong sideways (m, one standard deviation, a guess from the pixel's size there).
    pub(crate) sigma_m: f64,
    /// Distance to the next point that can be expected of an unbroken line (m).
    pub(crate) step_m: f64,
}

/// How a line looks: what a piece of it must resemble.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Look {
    /// Mean residue (grey levels).
    pub(crate) strength: f64,
    /// Width across the line as a multiple of the expected width.
    pub(crate) breadth: f64,
}

impl Look {
    /// Whether a piece stands out about as much: a speck of the floor does not, and a lamp's image does more.
    pub(crate) fn is_like(self, piece: &LineBlob) -> bool {
        (0.5..2.5).contains(&(piece.residue_mean / self.strength))
    }

    /// Whether a whole line may be the one that was followed.
    pub(crate) fn stands_out(self, blob: &LineBlob) -> bool {
        blob.residue_mean > FAINT_PART * self.strength
    }
}

/// Noise and grain stand out less than this part of the line that was followed. Measured: from frame to frame a line
/// keeps 0.7 of its strength or more, in shadows too.
const FAINT_PART: f64 = 0.4;

/// A blob that may be a line, with its places on the floor.
#[derive(Debug, Clone, Default)]
pub(crate) struct Candidate {
    /// C5's score.
    pub(crate) score: f64,
    /// How it looks.
    pub(crate) look: Look,
    /// Centre of mass in the picture (px).
    pub(crate) centroid: Vec2,
    /// Its place on the floor (vehicle frame, m), where it has one.
    pub(crate) centroid_on_floor: Option<Vec2>,
    /// C9: the straight line through the centroid along the orientation.
    pub(crate) straight: Option<LineState>,
    /// Middle points on the floor from near to far.
    pub(crate) points: Vec<FloorPoint>,
    /// The same in the picture, for drawing.
    pub(crate) pixels: Vec<[f32; 2]>,
}

/// Rows used of a blob at most; the others are skipped evenly.
const ROWS_LIMIT: usize = 40;
/// A row of the blob this many times wider than the line should be is not across the line.
const ROW_TOO_WIDE: f64 = 2.5;
/// And a row this much narrower than the blob's other rows is its end, where it tapers.
const ROW_TOO_NARROW: f64 = 0.7;
/// C9's second point is this many rows up in an image of 240 rows.
const SECOND_POINT_ROWS: f64 = 10.0;

impl Candidate {
    /// An empty one with room for all rows that are used.
    pub(crate) fn roomy() -> Self {
        Self {
            points: Vec::with_capacity(ROWS_LIMIT),
            pixels: Vec::with_capacity(ROWS_LIMIT),
            ..Self::default()
        }
    }
}

/// Which rows of a blob are believed to show a line's middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Rows {
    /// Those about as wide as the blob's others.
    Whole,
    /// Those about as wide as a known line, whose breadth this is; by up to the factor.
    AsBroadAs(f64, f64),
    /// All; where the picture's side cuts them the middle is half the expected width from the side in sight.
    Cut,
}

/// Fills in a candidate from a blob.
pub(crate) fn describe(
    blob: &LineBlob,
    map: &FloorMap,
    profile: &WidthProfile,
    options: &SightOptions,
    rows: Rows,
    candidate: &mut Candidate,
) {
    candidate.score = blob.score;
    candidate.look = Look {
        strength: blob.residue_mean,
        breadth: breadth(blob, profile),
    };
    candidate.centroid = blob.centroid;
    let rows_up = SECOND_POINT_ROWS * map.height() as f64 / 240.0;
    let [first, second] = blob.two_points(rows_up);
    candidate.centroid_on_floor = map.floor(first);
    candidate.straight = straight_state(candidate.centroid_on_floor, map.floor(second));
    candidate.points.clear();
    candidate.pixels.clear();
    let every = blob.rows.len().div_ceil(ROWS_LIMIT).max(1);
    let usual = usual_width(blob, profile);
    let mut last_u = None;
    // Rows come from the top; nearer floor is further down.
    for (index, row) in blob.rows.iter().enumerate().rev().step_by(every) {
        let expected = profile.at(row.v).max(1.0);
        let believed = match rows {
            Rows::Whole => {
                !row.at_edge
                    && row.width_px <= ROW_TOO_WIDE * expected + 1.0
                    && row.width_px >= ROW_TOO_NARROW * usual * expected
            }
            Rows::AsBroadAs(breadth, factor) => {
                let across = row.width_px * upright_part(blob, index) / expected;
                !row.at_edge && across < factor * breadth && breadth < factor * across
            }
            Rows::Cut => true,
        };
        if !believed {
            continue;
        }
        let pixel = Vec2::new(row.u, row.v);
        let (Some(at), Some(beside), Some(above)) = (
            map.floor(pixel),
            map.floor(pixel + Vec2::new(1.0, 0.0)),
            map.floor(pixel - Vec2::new(0.0, 1.0)),
        ) else {
            continue;
        };
        if at.length() > options.range_m || (above - at).length() > options.row_footprint_m {
            continue;
        }
        // A blob that bends back has several runs in a row: stay on the branch that was begun.
        if last_u.is_some_and(|last: f64| (row.u - last).abs() > 3.0 * expected + 2.0 * every as f64) {
            continue;
        }
        last_u = Some(row.u);
        // Half a pixel, and what a wrong tilt of half a degree does at that distance.
        let mut sigma_m = 0.5 * (beside - at).length() + 0.01 * at.length();
        if row.at_edge {
            sigma_m += 0.3 * options.line_width_m;
        }
        let step_m = (above - at).length() * every as f64;
        candidate.points.push(FloorPoint { at, sigma_m, step_m });
        candidate.pixels.push([row.u as f32, row.v as f32]);
    }
    keep_longest_smooth_run(&mut candidate.points, &mut candidate.pixels);
}

/// A reflection that touches a line makes one blob with a kink: only the longest piece without one is kept.
fn keep_longest_smooth_run(points: &mut Vec<FloorPoint>, pixels: &mut Vec<[f32; 2]>) {
    let (mut best, mut begin) = (0..0, 0);
    while begin < points.len() {
        let run = begin + smooth_run(&points[begin..]);
        if run - begin > best.len() {
            best = begin..run;
        }
        begin = run;
    }
    points.truncate(best.end);
    points.drain(..best.start);
    pixels.truncate(best.end);
    pixels.drain(..best.start);
}

/// Number of points up to the first kink, at its sharpest place; at least 1.
fn smooth_run(points: &[FloorPoint]) -> usize {
    let mut sharpest: Option<(f64, usize)> = None;
    for index in 1..points.len() {
        let bend = bend_at(points, index);
        match sharpest {
            Some((most, at)) if bend <= most => return at,
            _ if bend > BEND_RAD => sharpest = Some((bend, index)),
            _ => {}
        }
    }
    sharpest.map_or(points.len(), |(_, at)| at)
}

/// More bend than this is a kink (rad): 40°, from the 5 cm before a point to the 5 cm after it, a radius of 7 cm.
const BEND_RAD: f64 = 0.7;

/// Change of direction at a point (rad), from some centimetres before it to some after it. A jump sideways counts as a
/// right angle; dashes leave gaps, but straight on.
fn bend_at(points: &[FloorPoint], index: usize) -> f64 {
    const REACH_M: f64 = 0.05;
    let (before, point) = (points[index - 1], points[index]);
    let reach_m = REACH_M.max(5.0 * point.sigma_m);
    let far = |other: &&FloorPoint| (other.at - point.at).length() >= reach_m;
    let from = points[..index].iter().rev().find(far).or(points.first());
    let to = points[index..].iter().find(far).or(points.last());
    let (Some(from), Some(to)) = (from, to) else {
        return 0.0;
    };
    let (back, ahead) = (before.at - from.at, to.at - point.at);
    // Too little on one of the sides to tell a direction from noise.
    let least_m = 0.6 * reach_m;
    if back.length() >= least_m && ahead.length() >= least_m {
        return back.angle_to(ahead).abs();
    }
    let step = point.at - before.at;
    let longer = if back.length() >= ahead.length() {
        back
    } else {
        ahead
    };
    let jumps = longer.try_normalize().is_some_and(|direction| {
        let aside = step.dot(direction.perp()).abs();
        aside > 0.006 + 3.0 * point.sigma_m + step.dot(direction).max(0.0)
    });
    if jumps { std::f64::consts::FRAC_PI_2 } else { 0.0 }
}

/// Mean width of the blob's rows, as a multiple of the expected width.
fn usual_width(blob: &LineBlob, profile: &WidthProfile) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for row in blob.rows.iter().filter(|row| !row.at_edge) {
        let expected = profile.at(row.v).max(1.0);
        (sum, count) = (sum + (row.width_px / expected).min(ROW_TOO_WIDE), count + 1.0);
    }
    if count > 0.0 { sum / count } else { 1.0 }
}

/// Cosine of the line's lean in the picture at one of a blob's rows: what makes of a row's width the width across.
fn upright_part(blob: &LineBlob, index: usize) -> f64 {
    const REACH: usize = 3;
    let first = &blob.rows[index.saturating_sub(REACH)];
    let last = &blob.rows[(index + REACH).min(blob.rows.len() - 1)];
    let (along, aside) = (last.v - first.v, last.u - first.u);
    if along > 0.0 {
        along / (along * along + aside * aside).sqrt()
    } else {
        1.0
    }
}

/// Mean width across a blob's whole rows, as a multiple of the expected width.
fn breadth(blob: &LineBlob, profile: &WidthProfile) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (index, row) in blob.rows.iter().enumerate().filter(|(_, row)| !row.at_edge) {
        let across = row.width_px * upright_part(blob, index) / profile.at(row.v).max(1.0);
        (sum, count) = (sum + across.min(ROW_TOO_WIDE), count + 1.0);
    }
    if count > 0.0 { sum / count } else { 1.0 }
}

/// C9: the state relative to the straight line through two floor points, directed away from the vehicle.
fn straight_state(near: Option<Vec2>, far: Option<Vec2>) -> Option<LineState> {
    let (near, far) = (near?, far?);
    let direction = (far - near).try_normalize()?;
    Some(LineState {
        d_m: direction.perp().dot(near),
        theta_rad: trig::atan2(direction.y, direction.x),
        curvature_per_m: 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blob_with_a_kink_keeps_its_longer_piece() {
        let point = |x: f64, y: f64| FloorPoint {
            at: Vec2::new(x, y),
            sigma_m: 0.002,
            step_m: 0.01,
        };
        // A line that bends gently, then a reflection that leads off sideways.
        let mut points: Vec<FloorPoint> = (0..20)
            .map(|i| 0.01 * f64::from(i))
            .map(|x| point(x, x * x))
            .collect();
        points.extend((1..6).map(|i| point(0.19, 0.04 + 0.02 * f64::from(i))));
        let mut pixels = vec![[0.0, 0.0]; points.len()];
        keep_longest_smooth_run(&mut points, &mut pixels);
        assert!(
            (18..=20).contains(&points.len()) && pixels.len() == points.len(),
            "{}",
            points.len()
        );
        keep_longest_smooth_run(&mut Vec::new(), &mut Vec::new());
    }

    #[test]
    fn a_line_on_the_left_has_positive_d_and_one_that_leans_left_positive_theta() {
        let state = straight_state(Some(Vec2::new(0.2, 0.05)), Some(Vec2::new(0.3, 0.05))).unwrap();
        assert!((state.d_m - 0.05).abs() < 1e-12 && state.theta_rad.abs() < 1e-12);
        let state = straight_state(Some(Vec2::new(0.2, 0.0)), Some(Vec2::new(0.3, 0.1))).unwrap();
        assert!((state.theta_rad - 45f64.to_radians()).abs() < 1e-12);
        // It crosses the vehicle's axis 20 cm ahead and passes to the right of the axle.
        assert!((state.d_m + 0.2 / 2f64.sqrt()).abs() < 1e-12);
    }
}
