//! Lines on the floor: fits through points, and the vehicle's state relative to them (C9 and C17 in SPEC).

use crate::{FloorMap, LineBlob};
use senda_geom::{Vec2, trig};
use std::f64::consts::{FRAC_PI_2, PI};

/// The vehicle relative to a line, both as seen along the line's direction (the way that leads away from the
/// vehicle): the document's \[d, θ\] (C9 in SPEC) in SI, with ḋ = v·sin θ.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LineState {
    /// Distance of the axle's centre from the line (m): positive when the vehicle is to the **left** of the line.
    pub d_m: f64,
    /// Heading of the vehicle against the line (rad): positive when it points to the left of the line's direction.
    pub theta_rad: f64,
    /// Curvature of the line (1/m), left positive; 0 for a straight fit.
    pub curvature_per_m: f64,
}

/// A piece of line on the floor in the vehicle frame: an arc through `point`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FloorLine {
    /// A point of the line (m), amid the points that it was fitted to.
    pub point: Vec2,
    /// Direction there (rad), 0 = the vehicle's forward, left positive; in (-π/2, π/2]: it leads away.
    pub heading_rad: f64,
    /// Curvature (1/m), left positive.
    pub curvature_per_m: f64,
    /// Standard error of the curvature (1/m), from the scatter of the points; 0 for a straight fit.
    pub curvature_error_per_m: f64,
    /// Where the fitted points begin, along the arc, relative to `point` (m, negative or 0).
    pub start_m: f64,
    /// Where they end (m, positive or 0).
    pub end_m: f64,
    /// Root mean square distance of the points (m), weighted like the fit.
    pub rms_m: f64,
}

impl FloorLine {
    /// The straight line through two points; `None` when they coincide.
    pub fn through(first: Vec2, second: Vec2) -> Option<Self> {
        let along = second - first;
        let length = along.length();
        if !(length > 1e-9 && length.is_finite()) {
            return None;
        }
        Some(Self {
            point: (first + second) / 2.0,
            heading_rad: forward(trig::atan2(along.y, along.x)),
            start_m: -length / 2.0,
            end_m: length / 2.0,
            ..Self::default()
        })
    }

    /// C9: through the blob's centroid and a second point 10 px (at 240 rows) further up along its orientation; or
    /// further down when the upper one lies beyond the horizon.
    pub fn from_blob_axis(blob: &LineBlob, map: &FloorMap) -> Option<Self> {
        let rows_px = 10.0 * map.height() as f64 / 240.0;
        let on_floor = |rows_px| {
            let [first, second] = blob.two_points(rows_px);
            Self::through(map.floor(first)?, map.floor(second)?)
        };
        on_floor(rows_px).or_else(|| on_floor(-rows_px))
    }

    /// The vehicle's \[d, θ\] relative to this line, whose arc is continued to the vehicle.
    pub fn state(&self) -> LineState {
        let (along, left) = self.local(Vec2::ZERO);
        let turn_rad = trig::atan2(self.curvature_per_m * along, 1.0 - self.curvature_per_m * left);
        LineState {
            d_m: self.offset_of(Vec2::ZERO),
            theta_rad: senda_geom::angle::wrap(-self.heading_rad - turn_rad),
            curvature_per_m: self.curvature_per_m,
        }
    }

    /// Distance of a floor point (vehicle frame, m) from the line's arc, positive to its left (m).
    pub fn offset_of(&self, point: Vec2) -> f64 {
        let (along, left) = self.local(point);
        Near::new(self.curvature_per_m, along, left).offset_m
    }

    /// The point `distance_m` along the arc from `point`.
    pub fn at(&self, distance_m: f64) -> Vec2 {
        let turn_rad = self.curvature_per_m * distance_m;
        let (sin, cos) = trig::sincos(self.heading_rad + turn_rad / 2.0);
        let half_rad = turn_rad / 2.0;
        let ratio = if half_rad.abs() < 1e-4 {
            1.0 - half_rad * half_rad / 6.0
        } else {
            trig::sin(half_rad) / half_rad
        };
        self.point + Vec2::new(cos, sin) * (distance_m * ratio)
    }

    /// Direction of the arc `distance_m` along it (rad).
    pub fn heading_at(&self, distance_m: f64) -> f64 {
        senda_geom::angle::wrap(self.heading_rad + self.curvature_per_m * distance_m)
    }

    /// The same line moved sideways by `distance_m` (left positive), still parallel: the path at half the vehicle's width
    /// beside a line, or the middle of a lane.
    pub fn shifted(&self, distance_m: f64) -> Self {
        let (sin, cos) = trig::sincos(self.heading_rad);
        let stretch = 1.0 - self.curvature_per_m * distance_m;
        // Beyond the centre of the circle there is no parallel: the tightest circle stands for it.
        let stretch = if stretch.abs() < 0.05 { 0.05 } else { stretch };
        Self {
            point: self.point + Vec2::new(-sin, cos) * distance_m,
            curvature_per_m: self.curvature_per_m / stretch,
            start_m: self.start_m * stretch.abs(),
            end_m: self.end_m * stretch.abs(),
            ..*self
        }
    }

    fn local(&self, point: Vec2) -> (f64, f64) {
        let (sin, cos) = trig::sincos(self.heading_rad);
        let to = point - self.point;
        (to.x * cos + to.y * sin, to.y * cos - to.x * sin)
    }
}

/// Brings a direction into (-π/2, π/2], by turning the line round.
fn forward(heading_rad: f64) -> f64 {
    if heading_rad > FRAC_PI_2 {
        heading_rad - PI
    } else if heading_rad <= -FRAC_PI_2 {
        heading_rad + PI
    } else {
        heading_rad
    }
}

/// The foot of a point on an arc that leaves the origin along +x with a curvature; no trigonometry, no division by
/// the curvature, so straight lines are nothing special.
#[derive(Clone, Copy)]
struct Near {
    /// Distance of the point to the left of the arc.
    offset_m: f64,
    /// x of the foot.
    x_m: f64,
    /// Cosine of the arc's heading at the foot.
    cos: f64,
}

impl Near {
    #[inline]
    fn new(curvature: f64, along: f64, left: f64) -> Self {
        let (a, b) = (curvature * along, 1.0 - curvature * left);
        // Distance to the centre times the curvature.
        let ratio = (a * a + b * b).sqrt();
        Self {
            offset_m: (2.0 * left - curvature * (along * along + left * left)) / (1.0 + ratio),
            x_m: along / ratio.max(1e-9),
            cos: b / ratio.max(1e-9),
        }
    }
}

/// Fits lines to the middle points of blobs on the floor; owns the memory that this needs.
///
/// Weighted least squares of the distances to the arc (Gauss-Newton), with Tukey's biweight against outliers
/// (Huber & Ronchetti, *Robust Statistics*, 2nd ed., 2009): a stain that melts with the line does not bend it.
/// A point weighs as much as its pixel is fine on the floor.
#[derive(Debug, Clone, Default)]
pub struct LineFitter {
    samples: Vec<Sample>,
    distances: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    point: Vec2,
    /// 1 / (metres per pixel)², relative to the mean.
    weight: f64,
    /// Weight of the last round of the robust fit, 0..=1.
    trust: f64,
}

/// Rounds of the fit. The first ones trust every point, so that the start need not be good.
const ROUNDS: usize = 8;
const TRUSTING_ROUNDS: usize = 3;
/// Tukey's tuning constant: 95 % efficiency for Gaussian errors.
const BIWEIGHT: f64 = 4.685;
/// Neighbouring rows share the blur, so their errors are not independent: the standard error counts one in five.
const INDEPENDENT_PART: f64 = 0.2;

/// How much less exact the middle is where the picture's edge cuts the line: a guess, half a pixel against the
/// tenth of a pixel that a whole run gives.
const EDGE_DOUBT: f64 = 5.0;

impl LineFitter {
    /// An empty fitter.
    pub fn new() -> Self {
        Self::default()
    }

    /// A robust straight line through the middle points of the blobs. `None` with fewer than 3 points on the floor.
    pub fn straight<'a>(
        &mut self,
        blobs: impl IntoIterator<Item = &'a LineBlob>,
        map: &FloorMap,
    ) -> Option<FloorLine> {
        self.gather(blobs, map);
        self.fit::<2>()
    }

    /// A robust arc through the middle points of the blobs; a straight line with fewer than 5 points, `None` with
    /// fewer than 3.
    pub fn arc<'a>(
        &mut self,
        blobs: impl IntoIterator<Item = &'a LineBlob>,
        map: &FloorMap,
    ) -> Option<FloorLine> {
        self.gather(blobs, map);
        if self.samples.len() < 5 {
            return self.fit::<2>();
        }
        self.fit::<3>()
    }

    /// A robust straight line through floor points (m) that all weigh the same. `None` with fewer than 3.
    pub fn straight_through(&mut self, points: impl IntoIterator<Item = Vec2>) -> Option<FloorLine> {
        self.take(points);
        self.fit::<2>()
    }

    /// A robust arc through floor points (m) that all weigh the same; a straight line with fewer than 5.
    pub fn arc_through(&mut self, points: impl IntoIterator<Item = Vec2>) -> Option<FloorLine> {
        self.take(points);
        if self.samples.len() < 5 {
            return self.fit::<2>();
        }
        self.fit::<3>()
    }

    fn take(&mut self, points: impl IntoIterator<Item = Vec2>) {
        self.samples.clear();
        self.samples.extend(
            points
                .into_iter()
                .filter(|point| point.is_finite())
                .map(|point| Sample {
                    point,
                    weight: 1.0,
                    trust: 1.0,
                }),
        );
    }

    fn gather<'a>(&mut self, blobs: impl IntoIterator<Item = &'a LineBlob>, map: &FloorMap) {
        self.samples.clear();
        for row in blobs.into_iter().flat_map(|blob| &blob.rows) {
            let doubt = if row.at_edge { EDGE_DOUBT } else { 1.0 };
            let pixel = Vec2::new(row.u, row.v);
            let (Some(point), Some(scale_m)) = (map.floor(pixel), map.metres_per_pixel(pixel)) else {
                continue;
            };
            if scale_m > 0.0 && point.is_finite() {
                self.samples.push(Sample {
                    point,
                    weight: 1.0 / (doubt * doubt * scale_m * scale_m),
                    trust: 1.0,
                });
            }
        }
        let total: f64 = self.samples.iter().map(|sample| sample.weight).sum();
        let mean = total / self.samples.len().max(1) as f64;
        for sample in &mut self.samples {
            sample.weight /= mean;
        }
    }

    /// `PARAMETERS` 2: sideways and heading; 3: and curvature.
    fn fit<const PARAMETERS: usize>(&mut self) -> Option<FloorLine> {
        if self.samples.len() < 3 {
            return None;
        }
        let mut line = self.principal_axis()?;
        let mut normal = [[0.0; 3]; 3];
        let mut squares = 0.0;
        let mut total = 0.0;
        for round in 0..ROUNDS {
            if round >= TRUSTING_ROUNDS {
                self.judge(&line);
            }
            normal = [[0.0; 3]; 3];
            let mut right = [0.0; 3];
            (squares, total) = (0.0, 0.0);
            let (sin, cos) = trig::sincos(line.heading_rad);
            for sample in &self.samples {
                let to = sample.point - line.point;
                let near = Near::new(
                    line.curvature_per_m,
                    to.x * cos + to.y * sin,
                    to.y * cos - to.x * sin,
                );
                // How the foot moves sideways with the line's offset, heading and curvature.
                let slopes = [
                    near.cos,
                    near.x_m,
                    near.x_m * near.x_m / (1.0 + near.cos).max(0.1),
                ];
                let weight = sample.weight * sample.trust;
                for i in 0..PARAMETERS {
                    right[i] += weight * slopes[i] * near.offset_m;
                    for j in 0..PARAMETERS {
                        normal[i][j] += weight * slopes[i] * slopes[j];
                    }
                }
                squares += weight * near.offset_m * near.offset_m;
                total += weight;
            }
            let step = solve::<PARAMETERS>(&normal, &right)?;
            line.point += Vec2::new(-sin, cos) * step[0];
            line.heading_rad += step[1];
            if PARAMETERS == 3 {
                line.curvature_per_m += step[2];
            }
        }
        self.finish::<PARAMETERS>(line, &normal, squares, total)
    }

    /// Straight line through the weighted mean along the direction of largest spread.
    fn principal_axis(&self) -> Option<FloorLine> {
        let total: f64 = self.samples.iter().map(|sample| sample.weight).sum();
        let mean = self
            .samples
            .iter()
            .map(|sample| sample.point * sample.weight)
            .sum::<Vec2>()
            / total;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for sample in &self.samples {
            let to = sample.point - mean;
            xx += sample.weight * to.x * to.x;
            xy += sample.weight * to.x * to.y;
            yy += sample.weight * to.y * to.y;
        }
        if !(xx + yy > 0.0 && (xx + yy).is_finite()) {
            return None;
        }
        Some(FloorLine {
            point: mean,
            heading_rad: 0.5 * trig::atan2(2.0 * xy, xx - yy),
            ..FloorLine::default()
        })
    }

    /// Sets the trust in each point from its distance, in units of the median distance.
    fn judge(&mut self, line: &FloorLine) {
        self.distances.clear();
        self.distances.extend(
            self.samples
                .iter()
                .map(|sample| line.offset_of(sample.point).abs() * sample.weight.sqrt()),
        );
        let middle = self.distances.len() / 2;
        let (_, median, _) = self.distances.select_nth_unstable_by(middle, f64::total_cmp);
        // 1.4826 turns the median into a Gaussian's standard deviation; 0.1 mm keeps perfect points from
        // refusing each other.
        let scale = BIWEIGHT * (1.4826 * *median).max(1e-4);
        for sample in &mut self.samples {
            let ratio = line.offset_of(sample.point) * sample.weight.sqrt() / scale;
            let keep = (1.0 - ratio * ratio).max(0.0);
            sample.trust = keep * keep;
        }
    }

    fn finish<const PARAMETERS: usize>(
        &self,
        mut line: FloorLine,
        normal: &[[f64; 3]; 3],
        squares: f64,
        total: f64,
    ) -> Option<FloorLine> {
        if !(line.point.is_finite() && line.heading_rad.is_finite() && line.curvature_per_m.is_finite()) {
            return None;
        }
        let heading_rad = senda_geom::angle::wrap(line.heading_rad);
        line.heading_rad = forward(heading_rad);
        if (line.heading_rad - heading_rad).abs() > 1.0 {
            // Turned round: what bent to the left now bends to the right.
            line.curvature_per_m = -line.curvature_per_m;
        }
        line.rms_m = (squares / total).sqrt();
        for sample in self.samples.iter().filter(|sample| sample.trust > 0.0) {
            let (along, left) = line.local(sample.point);
            let curvature = line.curvature_per_m;
            let station_m = if (curvature * along).abs() < 1e-3 {
                along
            } else {
                trig::atan2(curvature * along, 1.0 - curvature * left) / curvature
            };
            line.start_m = line.start_m.min(station_m);
            line.end_m = line.end_m.max(station_m);
        }
        if PARAMETERS == 3 {
            let unit = [0.0, 0.0, 1.0];
            let variance = solve::<3>(normal, &unit)?[2];
            let count = (self.samples.len() as f64 * INDEPENDENT_PART - 3.0).max(1.0);
            let scatter = squares / total * (self.samples.len() as f64 * INDEPENDENT_PART) / count;
            line.curvature_error_per_m = (variance * total * scatter
                / (self.samples.len() as f64 * INDEPENDENT_PART))
                .max(0.0)
                .sqrt();
        }
        Some(line)
    }
}

/// Cholesky solution of the first `N` symmetric equations; `None` when they do not determine the answer.
fn solve<const N: usize>(matrix: &[[f64; 3]; 3], right: &[f64; 3]) -> Option<[f64; 3]> {
    let mut lower = [[0.0; 3]; 3];
    for i in 0..N {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = matrix[i][j] - known;
            if i == j {
                // Not "rest <= …": that would let NaN pass.
                if rest.is_nan() || rest <= 1e-12 * matrix[i][i] {
                    return None;
                }
                lower[i][i] = rest.sqrt();
            } else {
                lower[i][j] = rest / lower[j][j];
            }
        }
    }
    let mut solution = *right;
    for i in 0..N {
        let known: f64 = (0..i).map(|k| lower[i][k] * solution[k]).sum();
        solution[i] = (solution[i] - known) / lower[i][i];
    }
    for i in (0..N).rev() {
        let known: f64 = (i + 1..N).map(|k| lower[k][i] * solution[k]).sum();
        solution[i] = (solution[i] - known) / lower[i][i];
    }
    Some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Points of an arc, given as the vehicle's state relative to it.
    fn arc_points(d_m: f64, theta_rad: f64, curvature: f64) -> Vec<Vec2> {
        // The arc as a line in the vehicle frame: nearest point to the left or right of the axle.
        let heading_rad = -theta_rad;
        let (sin, cos) = trig::sincos(heading_rad);
        let line = FloorLine {
            point: Vec2::new(-sin, cos) * -d_m,
            heading_rad,
            curvature_per_m: curvature,
            ..FloorLine::default()
        };
        (0..60).map(|i| line.at(0.08 + 0.006 * f64::from(i))).collect()
    }

    proptest! {
        #[test]
        fn arcs_are_recovered(d in -0.1..0.1f64, theta in -0.8..0.8f64, curvature in -3.0..3.0f64) {
            let points = arc_points(d, theta, curvature);
            let line = LineFitter::new().arc_through(points.iter().copied()).unwrap();
            let state = line.state();
            prop_assert!((state.d_m - d).abs() < 1e-5, "{state:?}");
            prop_assert!((state.theta_rad - theta).abs() < 1e-4, "{state:?}");
            prop_assert!((line.curvature_per_m - curvature).abs() < 1e-3, "{line:?}");
            prop_assert!(line.end_m - line.start_m > 0.3);
            for point in points {
                prop_assert!(line.offset_of(point).abs() < 1e-5);
            }
        }

        #[test]
        fn outliers_do_not_bend_a_line(d in -0.1..0.1f64, theta in -0.8..0.8f64, stain in 5usize..40) {
            let mut points = arc_points(d, theta, 0.0);
            // A stain beside the line pulls the middles of eight rows.
            for point in &mut points[stain..stain + 8] {
                point.y += 0.02;
            }
            for line in [
                LineFitter::new().straight_through(points.iter().copied()).unwrap(),
                LineFitter::new().arc_through(points.iter().copied()).unwrap(),
            ] {
                let state = line.state();
                prop_assert!((state.d_m - d).abs() < 1e-3, "{line:?}");
                prop_assert!((state.theta_rad - theta).abs() < 5e-3, "{line:?}");
            }
        }

        #[test]
        fn shifting_keeps_lines_parallel(curvature in -3.0..3.0f64, shift in -0.15..0.15f64, along in 0.0..0.3f64) {
            let line = FloorLine { heading_rad: 0.2, curvature_per_m: curvature, ..FloorLine::default() };
            let beside = line.shifted(shift);
            prop_assert!((line.offset_of(beside.at(along)) - shift).abs() < 1e-9);
        }
    }

    #[test]
    fn state_has_the_documents_signs() {
        // The line runs forward, 5 cm to the right of the vehicle: the vehicle is to the left of it.
        let line = FloorLine::through(Vec2::new(0.1, -0.05), Vec2::new(0.3, -0.05)).unwrap();
        let state = line.state();
        assert!((state.d_m - 0.05).abs() < 1e-12 && state.theta_rad.abs() < 1e-12);
        // The line leads to the right: the vehicle points to its left.
        let line = FloorLine::through(Vec2::new(0.1, 0.0), Vec2::new(0.3, -0.1)).unwrap();
        assert!(line.state().theta_rad > 0.4);
        // Given from far to near it is the same line.
        let turned = FloorLine::through(Vec2::new(0.3, -0.1), Vec2::new(0.1, 0.0)).unwrap();
        assert!((turned.state().theta_rad - line.state().theta_rad).abs() < 1e-12);
    }

    #[test]
    fn noise_shows_in_the_curvature_error() {
        let mut points = arc_points(0.02, 0.1, 0.0);
        for (i, point) in points.iter_mut().enumerate() {
            point.y += 0.001 * f64::from((i as i32 * 7919) % 13 - 6) / 6.0;
        }
        let line = LineFitter::new().arc_through(points).unwrap();
        assert!(
            line.curvature_error_per_m > 0.02 && line.curvature_error_per_m < 1.0,
            "{line:?}"
        );
        assert!(
            line.curvature_per_m.abs() < 3.0 * line.curvature_error_per_m,
            "{line:?}"
        );
    }

    #[test]
    fn too_few_or_equal_points_give_nothing() {
        let mut fitter = LineFitter::new();
        assert!(fitter.arc_through([Vec2::X, Vec2::Y]).is_none());
        assert!(fitter.straight_through([Vec2::X; 9]).is_none());
        assert!(fitter.straight_through([Vec2::NAN; 9]).is_none());
        assert!(FloorLine::through(Vec2::X, Vec2::X).is_none());
    }
}
