//! Options of the lane driver on frames of a vehicle that it does not drive.

use senda_core::Body;
use senda_geom::{Camera, Vec2};
use toml::{Table, Value};

/// Of a lane's width what a vehicle needs at rest, in widths of the vehicle, and what speed adds (s at top speed). Both and the
/// two below: C8 allows the GoPiGo (14 cm, 0.4 m/s) 35 cm with lines of 2 cm, and 90 cm with lines of 5 cm were found on the real
/// frames of a Donkeycar (19 cm, 3 m/s); nothing else was fitted.
const WIDEST_PER_WIDTH: f64 = 2.0;
const WIDEST_S: f64 = 0.173;
/// The widest lane, in widths of one of its lines.
const WIDEST_PER_LINE: f64 = 18.0;
/// How far ahead a point is pursued (s at top speed).
const PURSUIT_S: f64 = 0.5;
/// Further away than where a line is this wide its place is a matter of single pixels (px; those frames, and C8's camera, which
/// sees no further than 50 cm).
const LINE_PX: f64 = 2.6;
/// A loss ends no recording (m).
const NEVER_STOP_M: f64 = 100.0;

/// What suits a vehicle by its size, its speed and its camera, under the options that somebody gave. The curve form predicts the
/// road from its own commands, which this vehicle does not obey, so each frame must speak for itself: `road`, unless another
/// form was asked for. Where in its lane a person drives is theirs: along the road from there.
pub(crate) fn options(body: &Body, given: &Table) -> Table {
    let widest_m = rounded(
        WIDEST_PER_WIDTH * body.width_m + WIDEST_S * body.speed_limit_mps,
        0.01,
    );
    let line_m = rounded(widest_m / WIDEST_PER_LINE, 0.005);
    let mut options = Table::new();
    if !given.contains_key("form") {
        options.insert("form".into(), "road".into());
        options.insert("road".into(), table("centring", 0.0).into());
    }
    let mut sight = table("line_width_m", line_m);
    if let Some(camera) = body.cameras.first() {
        sight.insert("range_m".into(), rounded(range_m(camera, line_m), 0.05).into());
    }
    options.insert("sight".into(), sight.into());
    options.insert("shape".into(), table("widest_m", widest_m).into());
    options.insert(
        "follow".into(),
        table("pursuit_m", rounded(PURSUIT_S * body.speed_limit_mps, 0.01)).into(),
    );
    options.insert("loss".into(), table("stop_after_m", NEVER_STOP_M).into());
    super::drive::merge(&mut options, given.clone());
    options
}

/// How far ahead lines of a width are seen well (m): to the upper edge of the picture, or to where they become too thin.
fn range_m(camera: &Camera, line_m: f64) -> f64 {
    let middle = 0.5 * Vec2::new(f64::from(camera.width_px), f64::from(camera.height_px));
    let [ray, beside] = [middle, middle + Vec2::X].map(|pixel| camera.lens.ray(pixel).normalize());
    let pixel_rad = ray.cross(beside).length();
    let thin_m = line_m / (LINE_PX * pixel_rad);
    camera
        .floor_from_pixel(Vec2::new(middle.x, 0.0))
        .map_or(thin_m, |top| top.x.min(thin_m))
}

/// To whole steps, at least one: as somebody would write it.
fn rounded(value: f64, step: f64) -> f64 {
    let per_m = (1.0 / step).round();
    (value * per_m).round().max(1.0) / per_m
}

fn table(key: &str, value: f64) -> Table {
    Table::from_iter([(key.to_owned(), Value::from(value))])
}

/// `form="road" sight.range_m=1.7`: as `--option` takes them.
pub(crate) fn words(options: &Table) -> String {
    let mut words = Vec::new();
    add_words(&mut words, "", options);
    words.join(" ")
}

fn add_words(words: &mut Vec<String>, before: &str, options: &Table) {
    for (key, value) in options {
        match value {
            Value::Table(inner) => add_words(words, &format!("{before}{key}."), inner),
            value => words.push(format!("{before}{key}={value}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_world::VehicleSpec;

    fn of(vehicle: &str, given: &str) -> String {
        let body = VehicleSpec::named(vehicle).unwrap().body();
        words(&options(&body, &toml::from_str(given).unwrap()))
    }

    /// The sizes of a racing car's lane were set for every vehicle: in frames of the GoPiGo no lane was found.
    #[test]
    fn sizes_follow_the_vehicle() {
        assert_eq!(
            of("donkeycar", ""),
            "form=\"road\" road.centring=0.0 sight.line_width_m=0.05 sight.range_m=1.7 shape.widest_m=0.9 \
             follow.pursuit_m=1.5 loss.stop_after_m=100.0"
        );
        assert_eq!(
            of("gopigo", ""),
            "form=\"road\" road.centring=0.0 sight.line_width_m=0.02 sight.range_m=0.5 shape.widest_m=0.35 \
             follow.pursuit_m=0.2 loss.stop_after_m=100.0"
        );
    }

    #[test]
    fn what_somebody_gives_is_kept() {
        let found = of("gopigo", "form = \"curve\"\nshape.widest_m = 0.5");
        assert!(
            found.contains("form=\"curve\"") && found.contains("shape.widest_m=0.5"),
            "{found}"
        );
        assert!(
            !found.contains("road.") && found.contains("sight.range_m=0.5"),
            "{found}"
        );
    }
}
