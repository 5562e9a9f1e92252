//! The driven path on the map.

use super::svg::{self, Anchor, px};
use super::{COLOURS, Stroke};
use crate::metrics::Course;
use crate::text::{self, escape};
use senda_geom::{Curve, Pose2, Vec2, trig};
use senda_world::{Marking, World};

/// A driven path in the world.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Track {
    /// Name in the legend.
    pub name: String,
    /// Positions in the world (m).
    pub points: Vec<Vec2>,
    /// For each position, whether it counted as inside the corridor; the rest is drawn in the alarm colour. Empty: all.
    pub inside: Vec<bool>,
    /// Colour number, modulo [`COLOURS`].
    pub colour: usize,
    /// How it is drawn.
    pub stroke: Stroke,
}

/// How much a map shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MapStyle {
    /// Everything: scale bar, start, per cent of lap, legend.
    #[default]
    Full,
    /// A thumbnail: lines and tracks only.
    Mini,
}

/// A world from above, true to scale, with driven paths.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Accessible name of the figure.
    pub name: String,
    /// Painted lines: points (m) and width (m).
    lines: Vec<(Vec<Vec2>, f64)>,
    /// Middles of the road and of streets beside it.
    roads: Vec<Vec<Vec2>>,
    half_width_m: f64,
    start: Pose2,
    /// Poses at 25, 50, 75 % with the number.
    marks: Vec<(u32, Pose2)>,
    /// Driven paths, the last on top.
    pub tracks: Vec<Track>,
    /// Length and width of the vehicle whose marker an interactive page moves (m).
    pub vehicle_m: Option<[f64; 2]>,
    /// What to show.
    pub style: MapStyle,
    /// Shows only this part of the world, enlarged: lower left and upper right corner (m).
    pub window: Option<[Vec2; 2]>,
    /// Width of the picture (px); the height follows from the world.
    pub width_px: f64,
    /// Largest height (px).
    pub max_height_px: f64,
}

impl Map {
    /// The map of a world.
    pub fn of_world(world: &World) -> Self {
        let mut map = Self::of_course(&Course::of(world, None));
        map.name = format!("Map of {}", world.name);
        let surface_m = world.warehouse.as_ref().map(|warehouse| warehouse.street_width_m);
        if let Some(warehouse) = &world.warehouse {
            map.half_width_m = 0.5 * warehouse.street_width_m;
            let streets = warehouse.streets.iter().map(|street| middle(&street.path));
            map.roads.extend(streets);
        }
        for layer in world.layers() {
            // Streets are drawn already.
            let paint = layer.markings.iter();
            for marking in paint.filter(|marking| Some(marking.width_m) != surface_m) {
                map.draw_marking(layer.path, marking);
            }
        }
        map
    }

    fn draw_marking(&mut self, path: &Curve, marking: &Marking) {
        let length_m = path.length_m();
        // Fine enough for the tightest curve and for dashes, and bounded for the longest road.
        let spacing_m = (length_m / 2000.0).max(0.005);
        let mut piece: Vec<Vec2> = Vec::new();
        let steps = (length_m / spacing_m).ceil().max(1.0) as usize;
        for i in 0..=steps {
            let station_m = length_m * i as f64 / steps as f64;
            if marking.covers(station_m) {
                let pose = path.pose_at(station_m.min(length_m * (1.0 - 1e-12)));
                piece.push(pose.position() + pose.left() * marking.offset_m);
            } else if piece.len() > 1 {
                self.lines.push((std::mem::take(&mut piece), marking.width_m));
            } else {
                piece.clear();
            }
        }
        if piece.len() > 1 {
            self.lines.push((piece, marking.width_m));
        }
    }

    /// The map of a course whose painted lines are unknown: its path and corridor.
    pub fn of_course(course: &Course) -> Self {
        let path = course.path;
        let length_m = path.length_m();
        let at_percent = |percent: u32| {
            let part = f64::from(percent) / 100.0 * length_m;
            let station_m = if path.is_closed() {
                course.start_station_m + part
            } else {
                part
            };
            (percent, path.pose_at(station_m))
        };
        Self {
            name: "Map".into(),
            lines: Vec::new(),
            roads: vec![middle(path)],
            half_width_m: course.corridor_half_width_m,
            start: path.pose_at(course.start_station_m),
            marks: [25, 50, 75].map(at_percent).to_vec(),
            tracks: Vec::new(),
            vehicle_m: None,
            style: MapStyle::Full,
            window: None,
            width_px: 560.0,
            max_height_px: 440.0,
        }
    }

    /// The map as an `<svg>` element.
    pub fn svg(&self) -> String {
        let full = self.style == MapStyle::Full;
        let (low, high) = self.bounds();
        let size = (high - low).max(Vec2::splat(1e-3));
        let (edge, legend_px) = if full { (16.0, 30.0) } else { (3.0, 0.0) };
        let room = Vec2::new(
            self.width_px - 2.0 * edge,
            self.max_height_px - 2.0 * edge - legend_px,
        );
        let scale = (room.x / size.x).min(room.y / size.y);
        let height_px = (scale * size.y + 2.0 * edge + legend_px).max(if full { 110.0 } else { 20.0 });
        // Centred in what the aspect ratio leaves over.
        let left = 0.5 * (self.width_px - scale * size.x);
        let bottom = 0.5 * (height_px - legend_px + scale * size.y);
        let to_px = |p: Vec2| [left + scale * (p.x - low.x), bottom - scale * (p.y - low.y)];
        let path = |points: &[Vec2]| {
            let pixels: Vec<[f64; 2]> = points.iter().map(|p| to_px(*p)).collect();
            svg::path_data(&pixels)
        };

        let mut out = svg::open(self.width_px, height_px, &self.name, "");
        if self.window.is_some() {
            // What lies outside of the window must not run into the legend.
            let (width, height) = (px(self.width_px), px(height_px - legend_px));
            out += &format!("<svg width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">");
        }
        for road in &self.roads {
            out += &format!(
                "<path class=\"sp-road\" style=\"stroke-width:{}\" d=\"{}\"/>",
                px((2.0 * self.half_width_m * scale).max(1.0)),
                path(road)
            );
        }
        for road in self.roads.iter().filter(|_| self.lines.is_empty()) {
            out += &format!(
                "<path class=\"sp-road-line\" style=\"stroke-width:1\" d=\"{}\"/>",
                path(road)
            );
        }
        for (points, width_m) in &self.lines {
            let stroke_px = px((width_m * scale).max(if full { 1.0 } else { 0.7 }));
            out += &format!(
                "<path class=\"sp-road-line\" style=\"stroke-width:{stroke_px}\" d=\"{}\"/>",
                path(points)
            );
        }
        if full {
            out += &self.signposts(&to_px, scale);
        }
        for track in &self.tracks {
            out += &drawn(track, &path);
        }
        if self.window.is_some() {
            out += "</svg>";
        }
        if full {
            out += &self.legend(height_px, scale);
        }
        if let (true, Some([length_m, width_m])) = (full, self.vehicle_m) {
            // In metres inside, so that a page moves it by the pose alone. Drawn at 10 px at least.
            let grow = (10.0 / (scale * length_m.max(1e-3))).max(1.0);
            out += &format!(
                "<g transform=\"matrix({scale} 0 0 {} {} {})\"><g class=\"sp-vehicle\" visibility=\"hidden\"><path d=\"{}\"/></g></g>",
                -scale,
                left - scale * low.x,
                bottom + scale * low.y,
                arrow(length_m * grow, width_m * grow)
            );
        }
        out + "</svg>"
    }

    /// The road with its corridor, and as much of the tracks as lies within half the world's size around it.
    fn bounds(&self) -> (Vec2, Vec2) {
        if let Some([low, high]) = self.window {
            return (low, high);
        }
        let first = self.roads[0][0];
        let (mut low, mut high) = (first, first);
        for point in self.roads.iter().flatten() {
            (low, high) = (low.min(*point), high.max(*point));
        }
        let half = Vec2::splat(self.half_width_m.max(0.0));
        (low, high) = (low - half, high + half);
        let reach = 0.5 * (high - low).max_element();
        let (least, most) = (low - Vec2::splat(reach), high + Vec2::splat(reach));
        for point in self
            .tracks
            .iter()
            .flat_map(|track| &track.points)
            .filter(|p| p.is_finite())
        {
            let point = point.clamp(least, most);
            (low, high) = (low.min(point), high.max(point));
        }
        (low, high)
    }

    /// Start line with driving direction, and 25, 50, 75 % of the lap.
    fn signposts(&self, to_px: &impl Fn(Vec2) -> [f64; 2], scale: f64) -> String {
        let mut out = String::new();
        let across = self.half_width_m.max(8.0 / scale);
        let at = |pose: &Pose2, ahead_m: f64, left_m: f64| to_px(pose.transform(Vec2::new(ahead_m, left_m)));
        for (percent, pose) in &self.marks {
            let (a, b) = (at(pose, 0.0, across), at(pose, 0.0, -across));
            out += &svg::line("sp-rule", a[0], a[1], b[0], b[1]);
            let label = at(pose, 0.0, -across - 13.0 / scale);
            out += &svg::text(
                label[0],
                label[1] + 3.0,
                Anchor::Middle,
                "sp-small",
                &format!("{percent} %"),
            );
        }
        let (a, b) = (at(&self.start, 0.0, across), at(&self.start, 0.0, -across));
        out += &format!(
            "<path style=\"stroke:var(--ink);stroke-width:2;fill:none\" d=\"M{} {}L{} {}\"/>",
            px(a[0]),
            px(a[1]),
            px(b[0]),
            px(b[1])
        );
        // An arrow beside the start line, outside the corridor so that no track hides it.
        let beside = -across - 6.0 / scale;
        let points = [(0.0, 0.0), (14.0, 0.0), (9.0, 4.0), (14.0, 0.0), (9.0, -4.0)]
            .map(|(ahead, left)| at(&self.start, ahead / scale, beside + left / scale));
        let data: Vec<String> = points
            .iter()
            .map(|p| format!("{} {}", px(p[0]), px(p[1])))
            .collect();
        out += &format!(
            "<path style=\"stroke:var(--ink);stroke-width:1.5;fill:none\" d=\"M{}L{}M{}L{}L{}\"/>",
            data[0], data[1], data[2], data[3], data[4]
        );
        out
    }

    /// Names of the tracks and the scale bar along the lower edge.
    fn legend(&self, height_px: f64, scale: f64) -> String {
        let y = height_px - 9.0;
        let mut out = String::new();
        let mut x = 16.0;
        for track in self.tracks.iter().filter(|track| !track.name.is_empty()) {
            let dash = if track.stroke == Stroke::Dashed {
                " sp-dash"
            } else {
                ""
            };
            out += &format!(
                "<path class=\"sp-line{dash} sp-c{}\" d=\"M{} {}h14\"/>",
                track.colour % COLOURS,
                px(x),
                px(y - 4.0)
            );
            out += &svg::text(x + 19.0, y, Anchor::Start, "", &track.name);
            x += svg::text_width(&track.name) + 36.0;
        }
        if self.tracks.iter().any(|track| track.inside.contains(&false)) {
            out += &format!(
                "<path class=\"sp-line sp-alarm\" d=\"M{} {}h14\"/>",
                px(x),
                px(y - 4.0)
            );
            out += &svg::text(x + 19.0, y, Anchor::Start, "", "outside the corridor");
        }
        // The round length nearest below 110 px.
        let mut length_m = trig::pow(10.0, trig::log10(110.0 / scale).floor());
        for factor in [5.0, 2.0] {
            if length_m * factor * scale <= 110.0 {
                length_m *= factor;
                break;
            }
        }
        let (right, width) = (self.width_px - 16.0, length_m * scale);
        out += &format!(
            "<path style=\"stroke:var(--ink-2);stroke-width:1.5;fill:none\" d=\"M{} {}v4H{}v-4\"/>",
            px(right - width),
            px(y - 4.0),
            px(right)
        );
        let label = if length_m < 1.0 {
            format!("{} cm", text::short(100.0 * length_m))
        } else {
            format!("{} m", text::short(length_m))
        };
        out + &svg::text(right - 0.5 * width, y - 8.0, Anchor::Middle, "sp-small", &label)
    }
}

/// The middle of a road, as finely as a map shows it.
fn middle(path: &Curve) -> Vec<Vec2> {
    path.polyline((path.length_m() / 2000.0).max(0.005))
}

/// A vehicle from above in its own frame (m): nose along x.
fn arrow(length_m: f64, width_m: f64) -> String {
    let (nose, tail, side) = (0.62 * length_m, -0.38 * length_m, 0.5 * width_m);
    format!(
        "M{nose:.4} 0L{:.4} {side:.4}L{tail:.4} {side:.4}L{tail:.4} {:.4}L{:.4} {:.4}Z",
        0.5 * nose,
        -side,
        0.5 * nose,
        -side
    )
}

/// A track, its parts outside the corridor in the alarm colour.
fn drawn(track: &Track, path: &impl Fn(&[Vec2]) -> String) -> String {
    let stroke = match track.stroke {
        Stroke::Dashed => "sp-line sp-dash",
        Stroke::Thin => "sp-line sp-thin",
        Stroke::Line | Stroke::Dots => "sp-line",
    };
    let name = escape(&track.name);
    let mut out = format!(
        "<path class=\"{stroke} sp-c{}\" d=\"{}\"><title>{name}</title></path>",
        track.colour % COLOURS,
        path(&track.points)
    );
    let gap = Vec2::NAN;
    let outside: Vec<Vec2> = track
        .points
        .iter()
        .enumerate()
        .map(|(i, point)| {
            if track.inside.get(i).copied().unwrap_or(true) {
                gap
            } else {
                *point
            }
        })
        .collect();
    if outside.iter().any(|p| p.is_finite()) {
        out += &format!(
            "<path class=\"{stroke} sp-alarm\" style=\"stroke-width:2.4\" d=\"{}\"/>",
            path(&outside)
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_geom::Segment;

    #[test]
    fn a_track_far_away_does_not_shrink_the_world_to_nothing() {
        let path = Curve::from_segments(
            Pose2::default(),
            &[Segment::arc(0.5, 2.0 * std::f64::consts::PI)],
            0.01,
            true,
        )
        .unwrap();
        let course = Course {
            path: &path,
            corridor_half_width_m: 0.15,
            start_station_m: 0.0,
            laps: None,
            open_end_m: 0.0,
        };
        let mut map = Map::of_course(&course);
        map.tracks = vec![Track {
            name: "<driver>".into(),
            points: vec![Vec2::ZERO, Vec2::new(1e9, 1e9), Vec2::NAN],
            inside: vec![true, false, false],
            ..Track::default()
        }];
        map.vehicle_m = Some([0.2, 0.1]);
        let svg = map.svg();
        let (low, high) = map.bounds();
        assert!((high - low).max_element() < 3.0);
        assert!(
            svg.contains("&lt;driver&gt;") && svg.contains("outside the corridor") && !svg.contains("NaN")
        );
        map.style = MapStyle::Mini;
        assert!(map.svg().len() < svg.len());
    }
}
