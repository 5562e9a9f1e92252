//! Paths on the floor with station (distance along) and offset (distance to the left).

use crate::{Pose2, Segment, Vec2, angle, spline, trig};

/// A path as finely spaced samples, open or closed. Station runs from 0 to [`Curve::length_m`].
///
/// Between samples the path is a cubic Hermite through both headings, so positions and headings are continuous.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    samples: Vec<Sample>,
    length_m: f64,
    closed: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    station_m: f64,
    position: Vec2,
    /// Unwrapped: continuous along the curve, so interpolation needs no special case.
    heading_rad: f64,
    curvature_per_m: f64,
}

/// The most evaluations that sampling a path may take: a second or so, and 100 km at 1 cm. A guess at "never meant".
const LARGEST_WORK: f64 = 1e7;

/// Where a point lies relative to a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Distance along the curve to the nearest point (m), in 0..=length.
    pub station_m: f64,
    /// Distance from the curve (m), positive to the left of its direction.
    pub offset_m: f64,
}

/// Why a curve cannot be made.
#[derive(Debug, Clone, PartialEq)]
pub enum CurveError {
    /// Fewer than two distinct points or no segment.
    TooFewPoints,
    /// A length that is zero, negative or not finite; holds the index of the piece or point.
    BadLength(usize),
    /// So long, or so tightly wound, that sampling it would take minutes or gigabytes; holds the index of the piece
    /// or point.
    TooLong(usize),
}

impl std::fmt::Display for CurveError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooFewPoints => write!(f, "expected at least two distinct points, or one piece"),
            Self::BadLength(index) => write!(
                f,
                "piece {index} has a length or coordinate that is not positive and finite"
            ),
            Self::TooLong(index) => write!(
                f,
                "piece {index} is too long or too tightly wound: expected a path of kilometres at most"
            ),
        }
    }
}

impl std::error::Error for CurveError {}

impl Curve {
    /// From analytic pieces, starting at `start`, sampled at most `spacing_m` apart.
    ///
    /// `closed` declares that the end meets the beginning; the caller checks by how much it misses
    /// ([`Curve::closing_gap`]).
    pub fn from_segments(
        start: Pose2,
        segments: &[Segment],
        spacing_m: f64,
        closed: bool,
    ) -> Result<Self, CurveError> {
        if segments.is_empty() {
            return Err(CurveError::TooFewPoints);
        }
        let mut samples = Vec::new();
        let (mut pose, mut station_m, mut work) = (start, 0.0, 0.0);
        for (index, segment) in segments.iter().enumerate() {
            if !segment.is_possible() {
                return Err(CurveError::BadLength(index));
            }
            let steps = (segment.length_m / spacing_m).ceil().max(1.0);
            work += steps * segment.effort();
            if work > LARGEST_WORK {
                return Err(CurveError::TooLong(index));
            }
            let steps = steps as usize;
            for i in 0..steps {
                let distance_m = segment.length_m * i as f64 / steps as f64;
                let at = segment.pose_at(pose, distance_m);
                samples.push(Sample {
                    station_m: station_m + distance_m,
                    position: at.position(),
                    heading_rad: at.heading_rad,
                    curvature_per_m: segment.curvature_at(distance_m),
                });
            }
            pose = segment.pose_at(pose, segment.length_m);
            station_m += segment.length_m;
        }
        let last = segments[segments.len() - 1];
        samples.push(Sample {
            station_m,
            position: pose.position(),
            heading_rad: pose.heading_rad,
            curvature_per_m: last.end_curvature_per_m,
        });
        Ok(Self {
            samples,
            length_m: station_m,
            closed,
        })
    }

    /// From points joined by a centripetal Catmull-Rom spline (Yuksel et al. 2011: no cusps, no self-crossings within
    /// a piece). Two points give a straight line. Repeated neighbours are merged; a closed curve does not repeat
    /// its first point.
    pub fn from_points(points: &[Vec2], closed: bool) -> Result<Self, CurveError> {
        let dense = spline::dense_points(points, closed)?;
        Ok(Self::from_dense(&dense, closed))
    }

    /// From points close enough together to be taken as they are; heading and curvature by finite differences.
    fn from_dense(points: &[Vec2], closed: bool) -> Self {
        let count = points.len();
        let mut stations = vec![0.0; count];
        for i in 1..count {
            stations[i] = stations[i - 1] + (points[i] - points[i - 1]).length();
        }
        let chord = |i: usize| points[i + 1] - points[i];
        let mut headings = vec![0.0; count];
        for i in 0..count {
            let tangent = if i == 0 {
                if closed {
                    chord(0).normalize() + chord(count - 2).normalize()
                } else {
                    chord(0)
                }
            } else if i == count - 1 {
                if closed {
                    chord(0).normalize() + chord(count - 2).normalize()
                } else {
                    chord(count - 2)
                }
            } else {
                chord(i - 1).normalize() + chord(i).normalize()
            };
            let heading = trig::atan2(tangent.y, tangent.x);
            headings[i] = if i == 0 {
                heading
            } else {
                headings[i - 1] + angle::difference(heading, headings[i - 1])
            };
        }
        let samples = (0..count)
            .map(|i: usize| {
                let (before, after) = (i.saturating_sub(1), (i + 1).min(count - 1));
                Sample {
                    station_m: stations[i],
                    position: points[i],
                    heading_rad: headings[i],
                    curvature_per_m: (headings[after] - headings[before])
                        / (stations[after] - stations[before]),
                }
            })
            .collect();
        Self {
            samples,
            length_m: stations[count - 1],
            closed,
        }
    }

    /// Length along the curve (m).
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Whether the end joins the beginning.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// How far the end of the samples is from the beginning: metres, and radians of heading.
    pub fn closing_gap(&self) -> (f64, f64) {
        let (first, last) = (self.samples[0], self.samples[self.samples.len() - 1]);
        (
            (last.position - first.position).length(),
            angle::difference(last.heading_rad, first.heading_rad).abs(),
        )
    }

    /// Brings a station into the curve's range: modulo the length on a closed curve, clamped on an open one.
    pub fn normalise_station(&self, station_m: f64) -> f64 {
        if self.closed {
            let wrapped = station_m.rem_euclid(self.length_m);
            if wrapped >= self.length_m { 0.0 } else { wrapped }
        } else {
            station_m.clamp(0.0, self.length_m)
        }
    }

    /// Position and heading at a station (m). Beyond the ends of an open curve: the end pose.
    pub fn pose_at(&self, station_m: f64) -> Pose2 {
        let (a, b, part) = self.bracket(station_m);
        let step = b.station_m - a.station_m;
        let (ta, tb) = (direction(a.heading_rad) * step, direction(b.heading_rad) * step);
        let (t, t2, t3) = (part, part * part, part * part * part);
        let position = a.position * (2.0 * t3 - 3.0 * t2 + 1.0)
            + ta * (t3 - 2.0 * t2 + t)
            + b.position * (3.0 * t2 - 2.0 * t3)
            + tb * (t3 - t2);
        let heading = a.heading_rad + (b.heading_rad - a.heading_rad) * part;
        Pose2::new(position.x, position.y, angle::wrap(heading))
    }

    /// Curvature at a station (1/m), left positive.
    pub fn curvature_at(&self, station_m: f64) -> f64 {
        let (a, b, part) = self.bracket(station_m);
        a.curvature_per_m + (b.curvature_per_m - a.curvature_per_m) * part
    }

    /// Radius of the tightest curve (m); none where it is straight all along.
    pub fn tightest_radius_m(&self) -> Option<f64> {
        let curvatures = self.samples.iter().map(|sample| sample.curvature_per_m.abs());
        let most = curvatures.fold(0.0, f64::max);
        (most > 1e-9).then(|| 1.0 / most)
    }

    /// The nearest place on the curve, searching all of it.
    pub fn project(&self, point: Vec2) -> Place {
        self.project_among(point, 0, self.samples.len() - 1)
    }

    /// The nearest place within `window_m` of a station where the point is expected: fast, and on a curve that
    /// crosses itself it stays on the right branch.
    pub fn project_near(&self, point: Vec2, station_m: f64, window_m: f64) -> Place {
        let (low, high) = (station_m - window_m, station_m + window_m);
        if 2.0 * window_m >= self.length_m {
            return self.project(point);
        }
        if !self.closed {
            return self.project_among(
                point,
                self.index_below(low.max(0.0)),
                self.index_above(high.min(self.length_m)),
            );
        }
        let (low, high) = (self.normalise_station(low), self.normalise_station(high));
        let last = self.samples.len() - 1;
        if low <= high {
            return self.project_among(point, self.index_below(low), self.index_above(high));
        }
        let (tail, head) = (
            self.project_among(point, self.index_below(low), last),
            self.project_among(point, 0, self.index_above(high)),
        );
        if tail.offset_m.abs() <= head.offset_m.abs() {
            tail
        } else {
            head
        }
    }

    /// Positions every `spacing_m` (at most), both ends included.
    pub fn polyline(&self, spacing_m: f64) -> Vec<Vec2> {
        let steps = (self.length_m / spacing_m).ceil().max(1.0) as usize;
        (0..=steps)
            .map(|i| {
                self.end_aware_pose(self.length_m * i as f64 / steps as f64)
                    .position()
            })
            .collect()
    }

    /// The same path driven the other way.
    pub fn reversed(&self) -> Self {
        let samples = self
            .samples
            .iter()
            .rev()
            .map(|s| Sample {
                station_m: self.length_m - s.station_m,
                position: s.position,
                heading_rad: s.heading_rad + std::f64::consts::PI,
                curvature_per_m: -s.curvature_per_m,
            })
            .collect();
        Self {
            samples,
            length_m: self.length_m,
            closed: self.closed,
        }
    }

    /// The parallel curve `offset_m` to the left. Where the offset exceeds the radius of a curve, the result folds.
    pub fn offset(&self, offset_m: f64) -> Self {
        let points: Vec<Vec2> = self
            .samples
            .iter()
            .map(|s| s.position + direction(s.heading_rad).perp() * offset_m)
            .collect();
        let mut station_m = 0.0;
        let mut samples: Vec<Sample> = Vec::with_capacity(points.len());
        for (i, (point, sample)) in points.iter().zip(&self.samples).enumerate() {
            if i > 0 {
                station_m += (*point - points[i - 1]).length();
            }
            let stretch = 1.0 - offset_m * sample.curvature_per_m;
            let curvature_per_m = if stretch.abs() > 1e-6 {
                sample.curvature_per_m / stretch
            } else {
                0.0
            };
            samples.push(Sample {
                station_m,
                position: *point,
                curvature_per_m,
                ..*sample
            });
        }
        Self {
            samples,
            length_m: station_m,
            closed: self.closed,
        }
    }

    /// Like [`Curve::pose_at`], but the full length of a closed curve is its end, not its beginning.
    fn end_aware_pose(&self, station_m: f64) -> Pose2 {
        if station_m >= self.length_m {
            let last = self.samples[self.samples.len() - 1];
            return Pose2::new(last.position.x, last.position.y, angle::wrap(last.heading_rad));
        }
        self.pose_at(station_m)
    }

    fn bracket(&self, station_m: f64) -> (Sample, Sample, f64) {
        let station_m = self.normalise_station(station_m);
        let index = self.index_below(station_m).min(self.samples.len() - 2);
        let (a, b) = (self.samples[index], self.samples[index + 1]);
        let step = b.station_m - a.station_m;
        let part = if step > 0.0 {
            ((station_m - a.station_m) / step).clamp(0.0, 1.0)
        } else {
            0.0
        };
        (a, b, part)
    }

    fn index_below(&self, station_m: f64) -> usize {
        self.samples
            .partition_point(|s| s.station_m <= station_m)
            .saturating_sub(1)
    }

    fn index_above(&self, station_m: f64) -> usize {
        self.samples
            .partition_point(|s| s.station_m < station_m)
            .min(self.samples.len() - 1)
    }

    fn project_among(&self, point: Vec2, first: usize, last: usize) -> Place {
        let mut nearest = first;
        let mut best = f64::INFINITY;
        for i in first..=last {
            let distance = (self.samples[i].position - point).length_squared();
            if distance < best {
                (best, nearest) = (distance, i);
            }
        }
        let end = self.samples.len() - 1;
        let mut station_m = self.samples[nearest].station_m;
        // Newton on (point - curve) · tangent = 0; samples are dense, so a few steps reach machine precision.
        for _ in 0..4 {
            let pose = self.end_aware_pose(station_m);
            let curvature = self.curvature_at(station_m);
            let away = point - pose.position();
            let along = away.dot(pose.forward());
            let slope = 1.0 - curvature * away.dot(pose.left());
            let step = along / slope.max(0.1);
            let lowest = self.samples[nearest.saturating_sub(1)].station_m;
            let highest = self.samples[(nearest + 1).min(end)].station_m;
            if self.closed && (nearest == 0 || nearest == end) {
                station_m = self.normalise_station(station_m + step);
            } else {
                station_m = (station_m + step).clamp(lowest, highest);
            }
        }
        let pose = self.end_aware_pose(station_m);
        let away = point - pose.position();
        let side = away.dot(pose.left());
        // Beyond the end of an open curve the distance is to the end point, with the side's sign.
        let offset_m = if side.abs() > 1e-12 {
            away.length() * side.signum()
        } else {
            away.length()
        };
        Place { station_m, offset_m }
    }
}

fn direction(heading_rad: f64) -> Vec2 {
    let (sin, cos) = trig::sincos(heading_rad);
    Vec2::new(cos, sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn circle(radius_m: f64) -> Curve {
        Curve::from_segments(Pose2::default(), &[Segment::arc(radius_m, 2.0 * PI)], 0.01, true).unwrap()
    }

    proptest! {
        #[test]
        fn projection_inverts_station_and_offset(part in 0.0..1.0f64, offset in -0.9..0.9f64) {
            let curve = circle(1.0);
            let station = part * curve.length_m();
            let pose = curve.pose_at(station);
            let place = curve.project(pose.position() + pose.left() * offset);
            let apart = (place.station_m - station).abs();
            prop_assert!(apart.min(curve.length_m() - apart) < 1e-6, "{} {}", place.station_m, station);
            prop_assert!((place.offset_m - offset).abs() < 1e-6);
            let near = curve.project_near(pose.position() + pose.left() * offset, station + 0.1, 0.5);
            prop_assert!((near.offset_m - offset).abs() < 1e-6);
        }
    }

    #[test]
    fn circle_has_constant_curvature_and_closes() {
        let curve = circle(0.5);
        assert!((curve.length_m() - PI).abs() < 1e-9);
        assert!(curve.closing_gap().0 < 1e-6 && curve.closing_gap().1 < 1e-9);
        assert!((curve.curvature_at(1.0) - 2.0).abs() < 1e-9);
        assert!((curve.pose_at(PI / 2.0).heading_rad.abs() - PI).abs() < 1e-6);
    }

    #[test]
    fn offset_and_reverse_keep_the_sides() {
        let curve = circle(1.0);
        let inner = curve.offset(0.2); // left of a left-hand circle is inside
        assert!((inner.length_m() - 2.0 * PI * 0.8).abs() < 1e-3);
        let reversed = curve.reversed();
        let point = Vec2::new(0.0, 0.3);
        assert!((curve.project(point).offset_m + reversed.project(point).offset_m).abs() < 1e-6);
    }

    #[test]
    fn spline_passes_through_its_points() {
        let points = [
            Vec2::new(0.0, 0.0),
            Vec2::new(1.0, 0.0),
            Vec2::new(1.5, 1.0),
            Vec2::new(0.0, 1.5),
        ];
        let curve = Curve::from_points(&points, true).unwrap();
        for point in points {
            assert!(curve.project(point).offset_m.abs() < 1e-3);
        }
    }

    #[test]
    fn impossible_curves_are_refused() {
        assert_eq!(
            Curve::from_points(&[Vec2::ZERO; 5], false),
            Err(CurveError::TooFewPoints)
        );
        assert_eq!(
            Curve::from_points(&[Vec2::ZERO, Vec2::NAN], false),
            Err(CurveError::BadLength(1))
        );
        let zero = Curve::from_segments(Pose2::default(), &[Segment::straight(0.0)], 0.01, false);
        assert_eq!(zero, Err(CurveError::BadLength(0)));
    }

    /// A length of 1e12 m asked for 1e14 samples, and a coordinate of 1e300 for more than memory holds: the program was
    /// killed instead of naming the piece.
    #[test]
    fn paths_beyond_reason_are_refused_before_they_take_memory() {
        let pieces = [Segment::straight(1.0), Segment::straight(1e12)];
        let long = Curve::from_segments(Pose2::default(), &pieces, 0.01, false);
        assert_eq!(long, Err(CurveError::TooLong(1)));
        let wound = Curve::from_segments(Pose2::default(), &[Segment::clothoid(1e3, 0.0, 1e9)], 0.01, false);
        assert_eq!(wound, Err(CurveError::TooLong(0)));
        for far in [1e9, 1e155, 1e300] {
            let spline = Curve::from_points(&[Vec2::ZERO, Vec2::X, Vec2::new(far, 0.0)], false);
            assert_eq!(spline, Err(CurveError::TooLong(2)), "{far}");
        }
    }

    #[test]
    fn beyond_the_end_of_an_open_curve() {
        let curve = Curve::from_points(&[Vec2::ZERO, Vec2::new(1.0, 0.0)], false).unwrap();
        let place = curve.project(Vec2::new(1.3, 0.4));
        assert!((place.station_m - 1.0).abs() < 1e-9 && (place.offset_m - 0.5).abs() < 1e-9);
    }
}
