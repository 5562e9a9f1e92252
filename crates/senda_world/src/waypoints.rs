//! A road along the way points of somebody else's simulator: a table of x and y in metres, one lap.

use crate::error::{Warning, WorldError};
use crate::path::{FAR_M, PathShape, PathSpec};
use crate::reader::Source;
use crate::world::{World, stem};
use senda_geom::Vec2;

/// Points nearer than this to the one before are repeats (m).
const REPEAT_M: f64 = 1e-6;
/// A road lap is at least this long (m): shorter ones were written in another unit.
const SHORTEST_M: f64 = 80.0;
/// And at most this long (m).
const LONGEST_M: f64 = 20_000.0;
/// More points than this are no way points (a lap every centimetre).
const MOST_POINTS: usize = 100_000;

impl World {
    /// A closed road lap through way points, driven in their order: `text` holds one point a line, `x,y` (also `;`, blanks
    /// or tabs between), with or without a header, lengths times `scale` in metres. `seed` draws what lies beside the road.
    ///
    /// Errors name the line: what is no number, fewer than four points, a lap that crosses itself, and lengths that say
    /// that the unit is wrong. Repeated points are left out with a warning.
    pub fn from_waypoints(
        source_name: &str,
        text: &str,
        scale: f64,
        seed: u64,
    ) -> Result<(Self, Vec<Warning>), WorldError> {
        let source = Source::new(source_name, text);
        let (points, mut warnings) = read_points(&source, scale)?;
        check_length(&source, &points)?;
        check_crossings(&source, &points)?;
        let spec = PathSpec {
            shape: PathShape::Points(points.iter().map(|point| point.at).collect()),
            closed: true,
            reversed: false,
        };
        let mut world = Self::road_along(stem_of(source_name), spec, seed).map_err(|error| {
            source.problem(
                0..0,
                "points",
                "way points that a smooth curve can follow",
                error.to_string(),
                "",
            )
        })?;
        world.description = format!("Road along the way points of {}", file_name(source_name));
        let area = crate::random::signed_area_m2(&world.path.polyline(2.0));
        if area < 0.0 {
            warnings.push(source.warning(
                0,
                "points",
                "the lap runs clockwise; reverse it where anticlockwise is expected",
            ));
        }
        let radius_m = crate::smallest_radius_m(&world.path);
        if radius_m < 6.5 {
            warnings.push(source.warning(
                0,
                "points",
                format!("the tightest curve has a radius of {radius_m:.1} m: tighter than a car can turn"),
            ));
        }
        Ok((world, warnings))
    }
}

/// A point and where it is written.
struct Point {
    at: Vec2,
    /// Byte at which its line begins.
    from: usize,
    line: usize,
}

fn read_points(source: &Source, scale: f64) -> Result<(Vec<Point>, Vec<Warning>), WorldError> {
    let mut points: Vec<Point> = Vec::new();
    let mut warnings = Vec::new();
    let mut from = 0;
    for (index, line) in source.text().split('\n').enumerate() {
        let begin = from;
        from += line.len() + 1;
        let text = line.trim().trim_start_matches('\u{feff}');
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let fields: Vec<&str> = text
            .split([',', ';', '\t', ' '])
            .map(str::trim)
            .filter(|field| !field.is_empty())
            .collect();
        let numbers: Option<Vec<f64>> = fields.iter().map(|field| field.parse().ok()).collect();
        let problem = |expected: &str, found: String, help: &str| {
            let span = begin..begin + line.len();
            source.problem(span, format!("line {}", index + 1), expected, found, help)
        };
        let Some(numbers) = numbers else {
            // The first line may name the columns.
            let is_header = points.is_empty() && fields.iter().all(|field| field.parse::<f64>().is_err());
            if is_header && warnings.is_empty() {
                continue;
            }
            return Err(problem(
                "two numbers x,y",
                format!("{text:?}"),
                "one point a line",
            ));
        };
        let [x, y] = numbers[..] else {
            return Err(problem(
                "two numbers x,y",
                format!("{} numbers", numbers.len()),
                "one point a line; decimal points, not commas",
            ));
        };
        let at = Vec2::new(x, y) * scale;
        if !(at.x.abs() <= FAR_M && at.y.abs() <= FAR_M) {
            return Err(problem(
                &format!("metres from -{FAR_M} to {FAR_M}"),
                format!("{x}, {y}"),
                "give --scale if the unit is not the metre",
            ));
        }
        let repeats = points
            .last()
            .is_some_and(|last| (last.at - at).length() < REPEAT_M);
        if repeats {
            warnings.push(source.warning(begin, "points", "repeats the point before it and is left out"));
            continue;
        }
        if points.len() == MOST_POINTS {
            return Err(problem(
                &format!("at most {MOST_POINTS} points"),
                "more".into(),
                "",
            ));
        }
        points.push(Point {
            at,
            from: begin,
            line: index + 1,
        });
    }
    while points.len() > 1 && (points[0].at - points[points.len() - 1].at).length() < REPEAT_M {
        let last = points.pop().map_or(0, |point| point.from);
        warnings.push(source.warning(
            last,
            "points",
            "repeats the first point and is left out: a lap closes by itself",
        ));
    }
    if points.len() < 4 {
        return Err(source.problem(
            0..source.text().len().min(1),
            "points",
            "at least four different points",
            format!("{}", points.len()),
            "a lap needs points all around it",
        ));
    }
    Ok((points, warnings))
}

/// Lengths that no road has: the file is in kilometres, millimetres or degrees.
fn check_length(source: &Source, points: &[Point]) -> Result<(), WorldError> {
    let length_m: f64 = edges(points).map(|(a, b)| (b.at - a.at).length()).sum();
    let (expected, help) = if length_m < SHORTEST_M {
        (
            format!("a lap of at least {SHORTEST_M} m"),
            "are these kilometres, or degrees of latitude and longitude? Give --scale (1000 for kilometres), or project degrees first",
        )
    } else if length_m > LONGEST_M {
        (
            format!("a lap of at most {LONGEST_M} m"),
            "are these centimetres or millimetres? Give --scale (0.01 or 0.001)",
        )
    } else {
        return Ok(());
    };
    Err(source.problem(0..0, "points", expected, format!("{length_m:.3} m"), help))
}

/// A lap that crosses itself has no inside, and no bridge of ours carries one road over another.
fn check_crossings(source: &Source, points: &[Point]) -> Result<(), WorldError> {
    let edges: Vec<(&Point, &Point)> = edges(points).collect();
    // Sorted by their left ends, only edges whose x overlap are compared.
    let low = |edge: &(&Point, &Point)| edge.0.at.x.min(edge.1.at.x);
    let high = |edge: &(&Point, &Point)| edge.0.at.x.max(edge.1.at.x);
    let mut order: Vec<usize> = (0..edges.len()).collect();
    order.sort_by(|a, b| low(&edges[*a]).total_cmp(&low(&edges[*b])).then(a.cmp(b)));
    for (rank, first) in order.iter().enumerate() {
        for second in &order[rank + 1..] {
            if low(&edges[*second]) > high(&edges[*first]) {
                break;
            }
            let apart = first.abs_diff(*second);
            let neighbours = apart <= 1 || apart == edges.len() - 1;
            if !neighbours && cross(edges[*first], edges[*second]) {
                let (a, b) = (edges[*first.min(second)].0, edges[*first.max(second)].0);
                return Err(source.problem(
                    b.from..b.from,
                    "points",
                    "a lap that does not cross itself",
                    format!("the pieces after lines {} and {} cross", a.line, b.line),
                    "check the order of the points",
                ));
            }
        }
    }
    Ok(())
}

fn edges(points: &[Point]) -> impl Iterator<Item = (&Point, &Point)> {
    points.iter().zip(points.iter().cycle().skip(1))
}

/// Whether two segments share a point.
fn cross(first: (&Point, &Point), second: (&Point, &Point)) -> bool {
    let side = |a: Vec2, b: Vec2, p: Vec2| (b - a).perp_dot(p - a);
    let (a, b, c, d) = (first.0.at, first.1.at, second.0.at, second.1.at);
    let apart = |low: f64, high: f64| low * high > 0.0;
    !(apart(side(a, b, c), side(a, b, d)) || apart(side(c, d, a), side(c, d, b)))
        && a.y.min(b.y) <= c.y.max(d.y)
        && c.y.min(d.y) <= a.y.max(b.y)
}

fn file_name(source_name: &str) -> &str {
    source_name.rsplit(['/', '\\']).next().unwrap_or(source_name)
}

/// A file name without folders and ending.
fn stem_of(source_name: &str) -> &str {
    let name = stem(source_name);
    name.rsplit_once('.').map_or(name, |(before, _)| before)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// An ellipse of 280 m x 200 m in 40 points.
    fn lap() -> Vec<String> {
        (0..40)
            .map(|i| {
                let (sin, cos) = senda_geom::trig::sincos(f64::from(i) * 0.157_079_632_7);
                format!("{:.3},{:.3}", 140.0 * cos, 100.0 * sin)
            })
            .collect()
    }

    fn read(lines: &[String]) -> Result<(World, Vec<Warning>), WorldError> {
        World::from_waypoints("data/my lap.csv", &lines.join("\n"), 1.0, 1)
    }

    #[test]
    fn a_lap_becomes_a_road_through_its_points() {
        let mut lines = vec!["x,y".to_owned()];
        lines.extend(lap());
        let (world, warnings) = read(&lines).unwrap();
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!((world.name.as_str(), world.path.is_closed()), ("my lap", true));
        assert!(
            (world.path.length_m() - 760.0).abs() < 10.0,
            "{}",
            world.path.length_m()
        );
        assert!(world.path.project(Vec2::new(140.0, 0.0)).offset_m.abs() < 1e-6);
        assert_eq!(world.lane_width_m, Some(6.0));
    }

    #[test]
    fn repeats_are_left_out_and_named() {
        let mut lines = lap();
        lines.insert(5, lines[4].clone());
        lines.push(lines[0].clone());
        let (world, warnings) = read(&lines).unwrap();
        assert!(world == read(&lap()).unwrap().0);
        let text: Vec<String> = warnings.iter().map(ToString::to_string).collect();
        assert!(
            text[0].contains("my lap.csv:6") && text[0].contains("repeats the point"),
            "{text:?}"
        );
        assert!(text[1].contains("repeats the first"), "{text:?}");
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let mut crossing = lap();
        crossing.swap(10, 30);
        let mut word = lap();
        word[7] = "12,north".into();
        let mut three = lap();
        three[3] = "1,5;2,5".into();
        for (lines, says) in [
            (crossing, "cross"),
            (word, "line 8"),
            (three, "decimal points"),
            (vec!["3,4".into()], "at least four"),
            (vec!["3,4".into(); 9], "at least four"),
            (vec![], "at least four"),
            (lap().iter().map(|l| l.replace('.', "")).collect(), "--scale"),
            (
                vec![
                    "40.001,-3.7".into(),
                    "40.002,-3.7".into(),
                    "40.002,-3.71".into(),
                    "40.001,-3.71".into(),
                ],
                "degrees",
            ),
            (vec!["nan,1".into(); 5], "metres from"),
        ] {
            let error = read(&lines).unwrap_err().to_string();
            assert!(error.contains(says), "{says}: {error}");
        }
    }

    #[test]
    fn a_scale_turns_other_units_into_metres() {
        let kilometres: Vec<String> = lap()
            .iter()
            .map(|line| {
                let (x, y) = line.split_once(',').unwrap();
                let km = |m: &str| m.parse::<f64>().unwrap() / 1000.0;
                format!("{:.6}\t{:.6}", km(x), km(y))
            })
            .collect();
        let text = kilometres.join("\r\n");
        assert!(World::from_waypoints("km.csv", &text, 1.0, 1).is_err());
        let (world, _) = World::from_waypoints("km.csv", &text, 1000.0, 1).unwrap();
        assert!((world.path.length_m() - 760.0).abs() < 10.0);
    }

    #[test]
    fn a_clockwise_lap_is_told() {
        let lines: Vec<String> = lap().into_iter().rev().collect();
        let warnings = read(&lines).unwrap().1;
        assert!(
            warnings.iter().any(|w| w.message.contains("clockwise")),
            "{warnings:?}"
        );
    }

    /// The lap of the simulator that document B used, where the data are at hand.
    #[test]
    fn the_lake_laps_way_points_become_a_road() {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../../shared/data/lake_track_waypoints.csv"
        );
        let Ok(text) = std::fs::read_to_string(path) else {
            return; // Skipped: the data are not at hand.
        };
        let (world, warnings) = World::from_waypoints("lake_track_waypoints.csv", &text, 1.0, 1).unwrap();
        assert!(warnings.is_empty(), "{warnings:?}");
        assert!(
            (world.path.length_m() - 1137.0).abs() < 15.0,
            "{}",
            world.path.length_m()
        );
        let car = crate::VehicleSpec::named("sedan").unwrap();
        assert!(world.check_vehicle(&car).is_empty());
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
        #[test]
        fn any_text_is_read_or_refused(text in "[-0-9.,; eE\n\tx]{0,200}", scale in -10.0..1000.0f64) {
            let _ = World::from_waypoints("any.csv", &text, scale, 1);
        }
    }
}
