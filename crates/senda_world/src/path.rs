//! The path of a world: from pieces or from points to a curve, with its geometry checked.

use crate::error::{Warning, WorldError};
use crate::reader::Table;
use crate::writer::{self, Document};
use senda_geom::{Curve, CurveError, Pose2, Segment, Vec2, angle, trig};
use std::f64::consts::PI;

/// Distances of a world file stay below this (m): a country road, not a continent.
pub(crate) const FAR_M: f64 = 100_000.0;
/// A closed path may miss its beginning by this much (m) before it is an error.
const CLOSING_GAP_M: f64 = 0.005;
/// … and this much heading (rad).
const CLOSING_GAP_RAD: f64 = 0.02;
/// A path's samples stand this far apart (m) on circuits of a room; long roads are sampled more coarsely.
const SPACING_M: f64 = 0.005;
/// … so that a path has about this many samples at most.
const SAMPLES: f64 = 40_000.0;

/// Where the path comes from, as written in the file.
#[derive(Debug, Clone, PartialEq)]
pub struct PathSpec {
    /// Pieces or points.
    pub shape: PathShape,
    /// Whether the end joins the beginning.
    pub closed: bool,
    /// Whether it is driven against the direction in which it is written. Stations and offsets of the world
    /// always follow the driving direction.
    pub reversed: bool,
}

/// The two ways to write a path.
#[derive(Debug, Clone, PartialEq)]
pub enum PathShape {
    /// Pieces one after the other.
    Pieces {
        /// Where the first piece begins.
        start: Pose2,
        /// The pieces, at least one.
        pieces: Vec<Piece>,
    },
    /// Points (m) joined by a centripetal Catmull-Rom spline.
    Points(Vec<Vec2>),
}

/// One piece of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Piece {
    /// A straight line.
    Straight {
        /// Length (m), positive.
        length_m: f64,
    },
    /// A part of a circle.
    Arc {
        /// Radius (m), positive.
        radius_m: f64,
        /// Angle that it turns by (rad), left positive, not zero.
        turn_rad: f64,
    },
    /// Curvature that changes linearly, as roads and railways do between a straight line and an arc.
    Clothoid {
        /// Length (m), positive.
        length_m: f64,
        /// Curvature at its beginning (1/m), left positive.
        start_curvature_per_m: f64,
        /// Curvature at its end (1/m), left positive.
        end_curvature_per_m: f64,
    },
}

impl Piece {
    pub(crate) fn segment(self) -> Segment {
        match self {
            Self::Straight { length_m } => Segment::straight(length_m),
            Self::Arc { radius_m, turn_rad } => Segment::arc(radius_m, turn_rad),
            Self::Clothoid {
                length_m,
                start_curvature_per_m,
                end_curvature_per_m,
            } => Segment::clothoid(length_m, start_curvature_per_m, end_curvature_per_m),
        }
    }
}

/// The two arcs (or straight lines) that lead from one pose to another without a corner: a biarc with equal
/// tangent lengths (Bolton 1975). Empty when both poses coincide; `None` when no such pair exists.
pub fn closing_pieces(from: Pose2, to: Pose2) -> Option<Vec<Piece>> {
    let (chord, t1, t2) = (to.position() - from.position(), from.forward(), to.forward());
    if chord.length() < 1e-6 {
        return (angle::difference(to.heading_rad, from.heading_rad).abs() < 1e-6).then(Vec::new);
    }
    // |chord|² - 2d·chord·(t1+t2) - 2d²(1 - t1·t2) = 0 for the common tangent length d.
    let (sum, bend) = (chord.dot(t1 + t2), 2.0 * (1.0 - t1.dot(t2)));
    let square = chord.length_squared();
    let tangent_m = if bend > 1e-9 {
        (-sum + (sum * sum + bend * square).sqrt()) / bend
    } else if sum > 1e-9 {
        square / (2.0 * sum)
    } else {
        return None;
    };
    if !(tangent_m > 0.0 && tangent_m.is_finite()) {
        return None;
    }
    let middle = (from.position() + to.position() + (t1 - t2) * tangent_m) * 0.5;
    let first = arc_to(from, middle)?;
    let at_middle = first.segment().pose_at(from, first.segment().length_m);
    let second = arc_to(at_middle, to.position())?;
    Some(vec![first, second])
}

/// The arc or line that leaves `from` along its heading and ends at `to`.
fn arc_to(from: Pose2, to: Vec2) -> Option<Piece> {
    let local = from.inverse().transform(to);
    let chord_m = local.length();
    if chord_m < 1e-9 {
        return None;
    }
    let half_turn_rad = trig::atan2(local.y, local.x);
    if half_turn_rad.abs() < 1e-7 {
        return Some(Piece::Straight { length_m: chord_m });
    }
    if half_turn_rad.abs() > PI - 1e-3 {
        return None;
    }
    Some(Piece::Arc {
        radius_m: chord_m / (2.0 * trig::sin(half_turn_rad.abs())),
        turn_rad: 2.0 * half_turn_rad,
    })
}

impl PathSpec {
    /// The curve in driving direction.
    pub fn curve(&self) -> Result<Curve, CurveError> {
        let written = match &self.shape {
            PathShape::Pieces { start, pieces } => {
                let segments: Vec<Segment> = pieces.iter().map(|piece| piece.segment()).collect();
                let length_m: f64 = segments.iter().map(|segment| segment.length_m).sum();
                let spacing_m = SPACING_M.max(length_m / SAMPLES);
                Curve::from_segments(*start, &segments, spacing_m, self.closed)?
            }
            PathShape::Points(points) => Curve::from_points(points, self.closed)?,
        };
        Ok(if self.reversed {
            written.reversed()
        } else {
            written
        })
    }

    pub(crate) fn read(mut table: Table) -> Result<(Self, Curve, Vec<Warning>), WorldError> {
        table.only(&["closed", "reversed", "start", "pieces", "points"])?;
        let closed = table.bool("closed", false)?;
        let reversed = table.bool("reversed", false)?;
        let points = table.optional_pairs("points", -FAR_M, FAR_M)?;
        if points.is_some() && table.has("pieces") {
            return Err(table.problem("pieces", "either points or pieces", "both", "remove one"));
        }
        let mut warnings = Vec::new();
        let shape = match points {
            Some(points) => PathShape::Points(points.into_iter().map(|[x, y]| Vec2::new(x, y)).collect()),
            None => read_pieces(&mut table, closed, &mut warnings)?,
        };
        let spec = Self {
            shape,
            closed,
            reversed,
        };
        let key = if matches!(spec.shape, PathShape::Points(_)) {
            "points"
        } else {
            "pieces"
        };
        let curve = spec.curve().map_err(|error| match (&spec.shape, &error) {
            (PathShape::Points(points), CurveError::TooFewPoints) => table.problem(
                key,
                if closed {
                    "at least three distinct points, for the path is closed"
                } else {
                    "at least two distinct points"
                },
                found_points(points),
                "give where the path leads to",
            ),
            _ => table.problem(
                key,
                "a path with a length",
                error.to_string(),
                "check the coordinates",
            ),
        })?;
        if !(curve.length_m() > 0.01 && curve.length_m() < FAR_M) {
            return Err(table.problem(
                key,
                "a path longer than 0.01 m",
                format!("{:.4} m", curve.length_m()),
                "",
            ));
        }
        if closed {
            check_closing(&table, key, &spec.shape, &curve, &mut warnings)?;
        }
        table.finish()?;
        Ok((spec, curve, warnings))
    }

    pub(crate) fn write(&self, document: &mut Document, header: &str) {
        document.header(header);
        document.line("closed", self.closed);
        if self.reversed {
            document.line("reversed", true);
        }
        match &self.shape {
            PathShape::Points(points) => document.line("points", writer::pairs(points)),
            PathShape::Pieces { start, pieces } => {
                document.line("start", writer::pose(*start));
                let mut lines = String::from("[\n");
                for piece in pieces {
                    lines.push_str(&match piece {
                        Piece::Straight { length_m } => {
                            format!(
                                "  {{ kind = \"straight\", length_m = {} }},\n",
                                writer::float(*length_m)
                            )
                        }
                        Piece::Arc { radius_m, turn_rad } => format!(
                            "  {{ kind = \"arc\", radius_m = {}, turn_rad = {} }},\n",
                            writer::float(*radius_m),
                            writer::float(*turn_rad)
                        ),
                        Piece::Clothoid {
                            length_m,
                            start_curvature_per_m,
                            end_curvature_per_m,
                        } => format!(
                            "  {{ kind = \"clothoid\", length_m = {}, start_curvature_per_m = {}, \
                             end_curvature_per_m = {} }},\n",
                            writer::float(*length_m),
                            writer::float(*start_curvature_per_m),
                            writer::float(*end_curvature_per_m)
                        ),
                    });
                }
                lines.push(']');
                document.line("pieces", lines);
            }
        }
    }
}

/// How many points there are, and how many of them are places of their own.
fn found_points(points: &[Vec2]) -> String {
    let mut places: Vec<Vec2> = Vec::new();
    for point in points {
        if !places.contains(point) {
            places.push(*point);
        }
    }
    match (points.len(), places.len()) {
        (count @ 0..=1, _) => format!("{count} in all"),
        (count, 1) => format!("{count} in the same place"),
        (count, distinct) if distinct < count => format!("{count}, of which {distinct} are distinct"),
        (count, _) => format!("{count} in all"),
    }
}

fn check_closing(
    table: &Table,
    key: &str,
    shape: &PathShape,
    curve: &Curve,
    warnings: &mut Vec<Warning>,
) -> Result<(), WorldError> {
    if matches!(shape, PathShape::Points(_)) {
        return Ok(()); // a closed spline closes by construction
    }
    let (gap_m, gap_rad) = curve.closing_gap();
    if gap_m > CLOSING_GAP_M || gap_rad > CLOSING_GAP_RAD {
        return Err(table.problem(
            key,
            "a closed path to end where it begins",
            format!("a gap of {gap_m:.3} m and {:.1}°", gap_rad.to_degrees()),
            "correct the pieces, or add { kind = \"close\" } as the last one",
        ));
    }
    if gap_m > CLOSING_GAP_M / 5.0 || gap_rad > CLOSING_GAP_RAD / 5.0 {
        warnings.push(table.warning(
            key,
            format!(
                "the path misses its beginning by {:.1} mm and {:.2}°",
                gap_m * 1e3,
                gap_rad.to_degrees()
            ),
        ));
    }
    Ok(())
}

pub(crate) fn read_pose(mut table: Table) -> Result<Pose2, WorldError> {
    let pose = Pose2::new(
        table.f64("x_m", -FAR_M, FAR_M, 0.0)?,
        table.f64("y_m", -FAR_M, FAR_M, 0.0)?,
        table
            .optional_angle("heading_rad", "heading_deg", -2.0 * PI, 2.0 * PI)?
            .unwrap_or(0.0),
    );
    table.finish()?;
    Ok(pose)
}

fn read_pieces(
    table: &mut Table,
    closed: bool,
    warnings: &mut Vec<Warning>,
) -> Result<PathShape, WorldError> {
    let start = match table.optional_table("start")? {
        Some(start) => read_pose(start)?,
        None => Pose2::default(),
    };
    let items = table.tables("pieces")?;
    if items.is_empty() {
        return Err(table.missing("pieces", "at least one piece, or points"));
    }
    let count = items.len();
    let mut pieces = Vec::with_capacity(count);
    let mut pose = start;
    for (index, mut item) in items.into_iter().enumerate() {
        let kind = item.required_word("kind", &["straight", "arc", "clothoid", "close"])?;
        let added = match kind {
            "straight" => vec![Piece::Straight {
                length_m: item.required_f64("length_m", 1e-6, FAR_M)?,
            }],
            "arc" => vec![read_arc(&mut item)?],
            "clothoid" => vec![read_clothoid(&mut item)?],
            _ => {
                if index + 1 != count || !closed {
                    return Err(item.problem(
                        "kind",
                        "\"close\" only as the last piece of a closed path",
                        "it elsewhere",
                        "set closed = true and move it to the end",
                    ));
                }
                let closing = closing_pieces(pose, start).ok_or_else(|| {
                    item.problem(
                        "kind",
                        "a beginning that can be reached without a corner",
                        "none",
                        "let the piece before it end nearer to the beginning, in its direction",
                    )
                })?;
                let tightest = closing
                    .iter()
                    .filter_map(|piece| match piece {
                        Piece::Arc { radius_m, .. } => Some(*radius_m),
                        _ => None,
                    })
                    .fold(f64::INFINITY, f64::min);
                if tightest < 0.1 {
                    warnings.push(
                        item.warning("kind", format!("closing needs a curve of {tightest:.3} m radius")),
                    );
                }
                closing
            }
        };
        item.finish()?;
        for piece in added {
            let segment = piece.segment();
            pose = segment.pose_at(pose, segment.length_m);
            pieces.push(piece);
        }
    }
    Ok(PathShape::Pieces { start, pieces })
}

fn read_arc(item: &mut Table) -> Result<Piece, WorldError> {
    let radius_m = item.required_f64("radius_m", 1e-3, FAR_M)?;
    let Some(turn_rad) = item.optional_angle("turn_rad", "turn_deg", -4.0 * PI, 4.0 * PI)? else {
        return Err(item.missing("turn_deg", "an angle, left positive"));
    };
    if turn_rad.abs() * radius_m < 1e-6 {
        let key = if item.has("turn_deg") {
            "turn_deg"
        } else {
            "turn_rad"
        };
        return Err(item.problem(
            key,
            "an arc with a length",
            "a turn of 0",
            "use kind = \"straight\"",
        ));
    }
    Ok(Piece::Arc { radius_m, turn_rad })
}

fn read_clothoid(item: &mut Table) -> Result<Piece, WorldError> {
    let length_m = item.required_f64("length_m", 1e-6, FAR_M)?;
    let start_curvature_per_m = item.f64("start_curvature_per_m", -1e3, 1e3, 0.0)?;
    let end_curvature_per_m = item.f64("end_curvature_per_m", -1e3, 1e3, 0.0)?;
    let turn_rad = length_m * start_curvature_per_m.abs().max(end_curvature_per_m.abs());
    if turn_rad > 8.0 * PI {
        // Also a guard: integrating a piece takes time in proportion to its turning.
        return Err(item.problem(
            "length_m",
            "a clothoid of at most four turns",
            format!("{:.0} turns at its tighter end", turn_rad / (2.0 * PI)),
            "shorten it or lower its curvature",
        ));
    }
    Ok(Piece::Clothoid {
        length_m,
        start_curvature_per_m,
        end_curvature_per_m,
    })
}

/// Two places of a path that come closer than `clearance_m` although they are not neighbours along it: their
/// stations (m). `None`: no overlap.
pub fn self_overlap(curve: &Curve, clearance_m: f64) -> Option<(f64, f64)> {
    let spacing_m = (clearance_m / 6.0)
        .clamp(0.01, 1.0)
        .max(curve.length_m() / 20_000.0);
    let points = curve.polyline(spacing_m);
    let count = points.len();
    let step_m = curve.length_m() / (count - 1).max(1) as f64;
    // On a curve whose radius is at least half the clearance, neighbours are apart again after half a circle.
    let apart_m = 0.5 * PI * clearance_m * 1.05 + 2.0 * step_m;
    let (low, high) = points
        .iter()
        .fold((points[0], points[0]), |(l, h), p| (l.min(*p), h.max(*p)));
    let cell_m = clearance_m.max((high - low).max_element() / 500.0).max(1e-3);
    let columns = ((high.x - low.x) / cell_m) as usize + 1;
    let rows = ((high.y - low.y) / cell_m) as usize + 1;
    let cell = |p: Vec2| {
        (
            ((p.x - low.x) / cell_m) as usize,
            ((p.y - low.y) / cell_m) as usize,
        )
    };
    let mut cells: Vec<Vec<u32>> = vec![Vec::new(); columns * rows];
    for (index, point) in points.iter().enumerate() {
        let (cx, cy) = cell(*point);
        for y in cy.saturating_sub(1)..=(cy + 1).min(rows - 1) {
            for x in cx.saturating_sub(1)..=(cx + 1).min(columns - 1) {
                for other in &cells[y * columns + x] {
                    let other = *other as usize;
                    let mut along_m = (index - other) as f64 * step_m;
                    if curve.is_closed() {
                        along_m = along_m.min(curve.length_m() - along_m);
                    }
                    if along_m > apart_m && (points[other] - *point).length() < clearance_m {
                        return Some((other as f64 * step_m, index as f64 * step_m));
                    }
                }
            }
        }
        cells[cy * columns + cx].push(index as u32);
    }
    None
}

/// The smallest radius of a path (m); infinite for a straight one.
pub fn smallest_radius_m(curve: &Curve) -> f64 {
    let steps = ((curve.length_m() / 0.01) as usize).clamp(16, 40_000);
    let largest = (0..=steps)
        .map(|i| {
            curve
                .curvature_at(curve.length_m() * i as f64 / steps as f64)
                .abs()
        })
        .fold(0.0, f64::max);
    1.0 / largest
}
