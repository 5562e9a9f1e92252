//! Made-up worlds: every seed another circuit, floor and light, always drivable.

use crate::colour::Colour;
use crate::floor::{FLOOR_PRESETS, Floor, FloorKind};
use crate::light::{LIGHT_PRESETS, Lamp, Light, LightChange, Shadows};
use crate::marking::{Dash, Marking};
use crate::path::{self, PathShape, PathSpec, Piece};
use crate::thing::{Texture, Thing, ThingShape};
use crate::world::{Backdrop, World};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use senda_geom::{Curve, Pose2, Vec2, angle, trig};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Limits of made-up worlds. Every field has a default; ranges are `[least, most]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Difficulty {
    /// One line or a lane of two.
    pub kind: Kind,
    /// Tightest curve of the path (m). Outranks `length_m` where both cannot be had.
    pub min_radius_m: f64,
    /// Length of the path (m).
    pub length_m: [f64; 2],
    /// Distance between the lane's lines (m).
    pub lane_width_m: [f64; 2],
    /// Width of the lines (m).
    pub line_width_m: [f64; 2],
    /// Distance that other parts of the path keep (m); 0: lane width + 0.3 m, at least 0.45 m.
    pub clearance_m: f64,
    /// Names of floors to choose from ([`FLOOR_PRESETS`]); unknown ones are passed over.
    pub floors: Vec<String>,
    /// Whether colours, scale and seed of the floor vary around its preset.
    pub vary_floor: bool,
    /// Names of lights to choose from ([`LIGHT_PRESETS`]); unknown ones are passed over.
    pub lights: Vec<String>,
    /// Whether level, direction and lamps vary around the preset.
    pub vary_light: bool,
    /// Colours of the lines to choose from; those too near to the floor's lightness are passed over.
    pub colours: Vec<Colour>,
    /// Darker or lighter than the floor.
    pub tone: Tone,
    /// Probability that lines are dashed.
    pub dashes: f64,
    /// Most wear of the paint, 0..=1.
    pub wear: f64,
    /// Most stain of the paint, 0..=1.
    pub stain: f64,
    /// Probability of added soft shadows.
    pub shadows: f64,
    /// Probability of an added lamp.
    pub lamps: f64,
    /// Probability that light changes along the lap.
    pub light_changes: f64,
    /// Most upright things beside the path.
    pub things: u32,
}

/// What there is to follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// One line.
    #[default]
    Line,
    /// A lane of two lines.
    Lane,
}

/// Lightness of the lines against the floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tone {
    /// Either.
    #[default]
    Any,
    /// Lines darker than the floor.
    Dark,
    /// Lines lighter than the floor.
    Light,
}

impl Default for Difficulty {
    /// One line as in document C: radius 0.3 m or more, any floor and light, clean paint.
    fn default() -> Self {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Self {
            kind: Kind::Line,
            min_radius_m: 0.3,
            length_m: [4.0, 9.0],
            lane_width_m: [0.22, 0.30],
            line_width_m: [0.015, 0.02],
            clearance_m: 0.0,
            floors: names(&FLOOR_PRESETS),
            vary_floor: true,
            lights: names(&LIGHT_PRESETS),
            vary_light: true,
            colours: [
                "black", "white", "pink", "blue", "red", "green", "yellow", "orange",
            ]
            .iter()
            .filter_map(|name| Colour::parse(name))
            .collect(),
            tone: Tone::Any,
            dashes: 0.0,
            wear: 0.15,
            stain: 0.15,
            shadows: 0.2,
            lamps: 0.2,
            light_changes: 0.2,
            things: 0,
        }
    }
}

impl Difficulty {
    /// A lane of two lines for the kit car of document A.
    pub fn lane() -> Self {
        Self {
            kind: Kind::Lane,
            min_radius_m: 0.45,
            length_m: [6.0, 13.0],
            ..Self::default()
        }
    }
}

/// Lines must differ from the floor by this much luminance (of 255) to be seen.
const LEAST_CONTRAST: f64 = 55.0;

/// Random numbers whose values do not depend on the version of a library.
struct Dice(ChaCha8Rng);

impl Dice {
    /// Uniform in [0, 1).
    fn part(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.part()
    }

    fn chance(&mut self, probability: f64) -> bool {
        self.part() < probability
    }

    /// Uniform in 0..count.
    fn below(&mut self, count: usize) -> usize {
        ((self.part() * count as f64) as usize).min(count.saturating_sub(1))
    }

    fn seed(&mut self) -> u64 {
        self.0.next_u64() >> 32
    }

    fn vary(&mut self, colour: Colour, by: f64) -> Colour {
        let shift = self.between([-by, by]);
        let mut channel = |value: u8| {
            let value = f64::from(value) + shift + self.between([-by * 0.4, by * 0.4]);
            value.round().clamp(8.0, 247.0) as u8
        };
        let [r, g, b] = colour.rgb;
        Colour::new(channel(r), channel(g), channel(b))
    }
}

impl World {
    /// A closed circuit made up from a seed: always valid, never overlapping itself, different for every seed and the
    /// same for the same seed and difficulty.
    pub fn random(seed: u64, difficulty: &Difficulty) -> Self {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(seed));
        let lane_width_m =
            (difficulty.kind == Kind::Lane).then(|| dice.between(difficulty.lane_width_m).max(0.02));
        let clearance_m = if difficulty.clearance_m > 0.0 {
            difficulty.clearance_m
        } else {
            (lane_width_m.unwrap_or(0.0) + 0.3).max(0.45)
        };
        // Inside a curve the inner line must not fold.
        let min_radius_m = difficulty
            .min_radius_m
            .max(lane_width_m.unwrap_or(0.0) * 0.75)
            .max(0.02);
        let (path_spec, path) = circuit(&mut dice, min_radius_m, difficulty.length_m, clearance_m);
        let floor = choose_floor(&mut dice, difficulty);
        let markings = choose_markings(&mut dice, difficulty, &floor, lane_width_m, &path);
        let mut world = World {
            name: format!("random-{seed}"),
            description: String::new(),
            lane_width_m,
            corridor_half_width_m: lane_width_m.map_or(0.15, |width_m| width_m / 2.0),
            start_station_m: 0.0,
            markings,
            floor,
            light: Light::default(),
            things: Vec::new(),
            backdrop: Backdrop {
                horizon: dice.vary(Colour::new(140, 136, 130), 50.0),
                zenith: dice.vary(Colour::new(205, 203, 200), 30.0),
            },
            margin_m: 0.8,
            path,
            path_spec,
        };
        world.light = choose_light(&mut dice, difficulty, world.bounds());
        let reach_m = world.corridor_half_width_m + 0.08;
        for _ in 0..difficulty.things {
            if dice.chance(0.7) {
                world.things.extend(choose_thing(&mut dice, &world.path, reach_m));
            }
        }
        world
    }
}

/// What kind of shape to try. It stays for several tries: if every failure drew anew, only easy shapes would get through.
struct Style {
    spline: bool,
    corners: usize,
    /// How far corners may lie inside the circle, as a part of its radius.
    roughness: f64,
    /// Probability that a straight piece becomes a chicane.
    chicanes: f64,
    /// Wanted place in the range of lengths, 0..=1.
    size: f64,
}

impl Style {
    fn draw(dice: &mut Dice) -> Self {
        Self {
            spline: dice.chance(0.25),
            corners: 3 + dice.below(8),
            roughness: dice.between([0.05, 0.8]),
            chicanes: if dice.chance(0.75) {
                dice.between([0.3, 1.0])
            } else {
                0.0
            },
            size: dice.part(),
        }
    }
}

/// A closed circuit that keeps its limits. Tries shapes until one does; a circle always does.
fn circuit(dice: &mut Dice, min_radius_m: f64, length_m: [f64; 2], clearance_m: f64) -> (PathSpec, Curve) {
    let least_m = length_m[0].max(2.0 * PI * min_radius_m * 1.02);
    let most_m = length_m[1].max(least_m);
    let mut style = Style::draw(dice);
    for attempt in 1..=400 {
        if attempt % 40 == 0 {
            style = Style::draw(dice);
        }
        // Long circuits have more room for curves: look there when shapes keep failing.
        let part = style.size + (1.0 - style.size) * f64::from(attempt % 40) / 40.0;
        let wanted_m = least_m + (most_m - least_m) * part;
        let shape = if style.spline {
            spline(dice, &style, wanted_m)
        } else {
            rounded_polygon(dice, &style, wanted_m, min_radius_m)
        };
        let Some(shape) = shape else { continue };
        let spec = PathSpec {
            shape,
            closed: true,
            reversed: dice.chance(0.5),
        };
        let Ok(curve) = spec.curve() else { continue };
        let long_enough = curve.length_m() >= least_m * 0.999 && curve.length_m() <= most_m * 1.001;
        if long_enough
            && path::smallest_radius_m(&curve) >= min_radius_m * 0.999
            && path::self_overlap(&curve, clearance_m).is_none()
        {
            return (spec, curve);
        }
    }
    let spec = PathSpec {
        shape: PathShape::Pieces {
            start: Pose2::default(),
            pieces: vec![Piece::Arc {
                radius_m: 0.5 * (least_m + most_m) / (2.0 * PI),
                turn_rad: 2.0 * PI,
            }],
        },
        closed: true,
        reversed: false,
    };
    let curve = spec.curve().expect("a circle of positive radius is a curve");
    (spec, curve)
}

/// Corners around a centre at random distances, so that no edge crosses another.
fn star(dice: &mut Dice, count: usize, roughness: f64) -> Vec<Vec2> {
    let stretch = dice.between([0.55, 1.0]);
    let turn_rad = dice.between([0.0, 2.0 * PI]);
    let tilt = Pose2::new(0.0, 0.0, dice.between([0.0, 2.0 * PI]));
    (0..count)
        .map(|i| {
            let jitter = dice.between([-0.35, 0.35]);
            let (sin, cos) = trig::sincos(turn_rad + 2.0 * PI * (i as f64 + jitter) / count as f64);
            let distance = 1.0 - roughness * dice.part();
            tilt.transform(Vec2::new(distance * cos, distance * sin * stretch))
        })
        .collect()
}

fn perimeter(points: &[Vec2]) -> f64 {
    (0..points.len())
        .map(|i| (points[(i + 1) % points.len()] - points[i]).length())
        .sum()
}

fn spline(dice: &mut Dice, style: &Style, wanted_m: f64) -> Option<PathShape> {
    let corners = star(dice, style.corners + 2, style.roughness);
    let rough = Curve::from_points(&corners, true).ok()?;
    let scale = wanted_m / rough.length_m();
    // Whole millimetres: a file that a person can read.
    let points = corners
        .iter()
        .map(|p| {
            Vec2::new(
                (p.x * scale * 1e3).round() / 1e3,
                (p.y * scale * 1e3).round() / 1e3,
            )
        })
        .collect();
    Some(PathShape::Points(points))
}

/// Straight edges joined by arcs, some with clothoids before and after them.
fn rounded_polygon(dice: &mut Dice, style: &Style, wanted_m: f64, min_radius_m: f64) -> Option<PathShape> {
    let count = style.corners;
    let unit = star(dice, count, style.roughness);
    // Rounding shortens; the caller checks what came out.
    let scale = wanted_m * dice.between([1.0, 1.25]) / perimeter(&unit);
    let corners: Vec<Vec2> = unit.iter().map(|p| *p * scale).collect();
    let edges: Vec<Vec2> = (0..count)
        .map(|i| corners[(i + 1) % count] - corners[i])
        .collect();
    let smooth = dice.chance(0.4);
    let sharpness = dice.part();
    let mut bends = Vec::with_capacity(count);
    for i in 0..count {
        let (before, after) = (edges[(i + count - 1) % count], edges[i]);
        let turn_rad = angle::difference(trig::atan2(after.y, after.x), trig::atan2(before.y, before.x));
        let room_m = 0.49 * before.length().min(after.length());
        let lead = if smooth { dice.between([0.1, 0.6]) } else { 0.0 };
        let tangent_of_one = bend_tangent_m(1.0, turn_rad, lead)?;
        let largest_m = (room_m / tangent_of_one).min(2.5);
        if largest_m < min_radius_m {
            return None;
        }
        let part = dice.part();
        let radius_m =
            min_radius_m + (largest_m - min_radius_m) * if sharpness < 0.4 { part * part } else { part };
        bends.push((turn_rad, radius_m, lead, tangent_of_one * radius_m));
    }
    let mut pieces = Vec::new();
    for i in 0..count {
        let (turn_rad, radius_m, lead, _) = bends[i];
        if i > 0 {
            let length_m = edges[i - 1].length() - bends[i - 1].3 - bends[i].3;
            if dice.chance(style.chicanes) {
                push_chicane(dice, &mut pieces, length_m, min_radius_m);
            } else {
                push_straight(&mut pieces, length_m);
            }
        }
        pieces.extend(bend(radius_m, turn_rad, lead));
    }
    let closing_m = edges[count - 1].length() - bends[count - 1].3 - bends[0].3;
    // The path begins on the straight line that leads into the first bend.
    let begin = corners[0] - edges[count - 1].normalize() * (bends[0].3 + closing_m * 0.5);
    let mut all = Vec::new();
    push_straight(&mut all, closing_m * 0.5);
    all.extend(pieces);
    push_straight(&mut all, closing_m * 0.5);
    let heading_rad = trig::atan2(edges[count - 1].y, edges[count - 1].x);
    Some(PathShape::Pieces {
        start: Pose2::new(begin.x, begin.y, heading_rad),
        pieces: all,
    })
}

fn push_straight(pieces: &mut Vec<Piece>, length_m: f64) {
    if length_m > 1e-6 {
        pieces.push(Piece::Straight { length_m });
    }
}

/// Instead of a straight piece: aside and back again, or as much of it as has room.
fn push_chicane(dice: &mut Dice, pieces: &mut Vec<Piece>, length_m: f64, min_radius_m: f64) {
    let radius_m = min_radius_m * dice.between([1.0, 1.8]);
    let side = if dice.chance(0.5) { 1.0 } else { -1.0 };
    // Four arcs of an angle a reach 4·r·sin(a) ahead.
    let sine = (length_m * dice.between([0.6, 0.98]) / (4.0 * radius_m)).min(0.92);
    if sine < 0.3 {
        push_straight(pieces, length_m);
        return;
    }
    let turn_rad = trig::asin(sine) * side;
    let spare_m = length_m - 4.0 * radius_m * sine;
    let before = dice.part();
    push_straight(pieces, spare_m * before);
    for turn_rad in [turn_rad, -2.0 * turn_rad, turn_rad] {
        pieces.push(Piece::Arc { radius_m, turn_rad });
    }
    push_straight(pieces, spare_m * (1.0 - before));
}

/// A bend: an arc, between two clothoids that make up the share `lead` of its turning.
fn bend(radius_m: f64, turn_rad: f64, lead: f64) -> Vec<Piece> {
    if lead == 0.0 {
        return vec![Piece::Arc { radius_m, turn_rad }];
    }
    let curvature = turn_rad.signum() / radius_m;
    // A clothoid from 0 to k turns by k·length/2; two of them turn by lead·turn.
    let length_m = lead * turn_rad.abs() * radius_m;
    let clothoid = |start_curvature_per_m: f64, end_curvature_per_m: f64| Piece::Clothoid {
        length_m,
        start_curvature_per_m,
        end_curvature_per_m,
    };
    vec![
        clothoid(0.0, curvature),
        Piece::Arc {
            radius_m,
            turn_rad: turn_rad * (1.0 - lead),
        },
        clothoid(curvature, 0.0),
    ]
}

/// Distance from the corner at which a bend begins (m); `None`: too little or too much turning for a corner.
fn bend_tangent_m(radius_m: f64, turn_rad: f64, lead: f64) -> Option<f64> {
    if !(0.03..2.6).contains(&turn_rad.abs()) {
        return None;
    }
    let mut pose = Pose2::default();
    for piece in bend(radius_m, turn_rad, lead) {
        let segment = piece.segment();
        pose = segment.pose_at(pose, segment.length_m);
    }
    let (sin, cos) = trig::sincos(turn_rad);
    Some(pose.x_m - pose.y_m * cos / sin)
}

fn choose_floor(dice: &mut Dice, difficulty: &Difficulty) -> Floor {
    let known: Vec<Floor> = difficulty
        .floors
        .iter()
        .filter_map(|name| Floor::preset(name).ok())
        .collect();
    let mut floor = if known.is_empty() {
        Floor::of_kind(FloorKind::Plain)
    } else {
        known[dice.below(known.len())].clone()
    };
    if difficulty.vary_floor {
        floor.seed = dice.seed();
        floor.colour = dice.vary(floor.colour, 24.0);
        floor.second_colour = dice.vary(floor.second_colour, 24.0);
        floor.scale_m *= dice.between([0.75, 1.4]);
        floor.contrast = (floor.contrast * dice.between([0.6, 1.3])).min(1.0);
        if floor.kind != FloorKind::Carpet {
            floor.gloss = (floor.gloss * dice.between([0.5, 1.4])).min(0.9);
        }
    }
    leave_room(&mut floor, difficulty.tone);
    floor
}

/// Darkens or lightens a floor on which lines of the wanted tone could not be seen.
fn leave_room(floor: &mut Floor, tone: Tone) {
    let luminance = floor.colour.luminance();
    let factor = match tone {
        Tone::Light if luminance > 165.0 => 165.0 / luminance,
        Tone::Dark if luminance < 95.0 => 95.0 / luminance.max(8.0),
        Tone::Any | Tone::Light | Tone::Dark => return,
    };
    for colour in [&mut floor.colour, &mut floor.second_colour] {
        colour.rgb = colour
            .rgb
            .map(|value| (f64::from(value) * factor).round().min(235.0) as u8);
    }
}

fn choose_markings(
    dice: &mut Dice,
    difficulty: &Difficulty,
    floor: &Floor,
    lane_width_m: Option<f64>,
    path: &Curve,
) -> Vec<Marking> {
    let ground = floor.colour.luminance();
    let fits = |colour: &Colour| {
        let above = colour.luminance() - ground;
        match difficulty.tone {
            Tone::Any => above.abs() >= LEAST_CONTRAST,
            Tone::Dark => above <= -LEAST_CONTRAST,
            Tone::Light => above >= LEAST_CONTRAST,
        }
    };
    let fitting: Vec<Colour> = difficulty
        .colours
        .iter()
        .copied()
        .filter(|colour| fits(colour))
        .collect();
    let colour = if fitting.is_empty() {
        let dark = match difficulty.tone {
            Tone::Any => ground > 128.0,
            Tone::Dark => true,
            Tone::Light => false,
        };
        if dark {
            Colour::new(14, 14, 16)
        } else {
            Colour::new(248, 248, 246)
        }
    } else {
        fitting[dice.below(fitting.len())]
    };
    let width_m = dice.between(difficulty.line_width_m).max(0.002);
    let dash = dice.chance(difficulty.dashes).then(|| {
        // A whole number of dashes around the lap.
        let period_m = dice.between([0.10, 0.24]);
        let period_m = path.length_m() / (path.length_m() / period_m).round().max(1.0);
        let painted = dice.between([0.5, 0.75]);
        Dash {
            length_m: period_m * painted,
            gap_m: period_m * (1.0 - painted),
            phase_m: 0.0,
        }
    });
    let marking = Marking {
        offset_m: 0.0,
        width_m,
        colour,
        dash,
        span_m: None,
        wear: difficulty.wear * dice.part(),
        stain: difficulty.stain * dice.part(),
        gloss: dice.between([0.05, 0.4]),
    };
    match lane_width_m {
        None => vec![marking],
        Some(lane_width_m) => [0.5, -0.5]
            .into_iter()
            .map(|side| Marking {
                offset_m: side * lane_width_m,
                ..marking.clone()
            })
            .collect(),
    }
}

fn choose_light(dice: &mut Dice, difficulty: &Difficulty, (low, high): (Vec2, Vec2)) -> Light {
    let known: Vec<Light> = difficulty
        .lights
        .iter()
        .filter_map(|name| Light::preset(name, low, high).ok())
        .collect();
    let mut light = if known.is_empty() {
        Light::default()
    } else {
        known[dice.below(known.len())].clone()
    };
    if difficulty.vary_light {
        light.level *= dice.between([0.7, 1.3]);
        light.direction_rad = dice.between([-PI, PI]);
        light.elevation_rad = (light.elevation_rad * dice.between([0.8, 1.2])).clamp(0.15, 1.5);
        light.gradient = (light.gradient * dice.between([0.5, 1.4])).min(0.8);
        for lamp in &mut light.lamps {
            lamp.x_m += dice.between([-0.4, 0.4]);
            lamp.y_m += dice.between([-0.4, 0.4]);
            lamp.height_m *= dice.between([0.8, 1.3]);
        }
        if let Some(shadows) = &mut light.shadows {
            shadows.seed = dice.seed();
        }
    }
    if light.shadows.is_none() && dice.chance(difficulty.shadows) {
        light.shadows = Some(Shadows {
            strength: dice.between([0.15, 0.5]),
            scale_m: dice.between([0.25, 1.0]),
            softness: dice.between([0.2, 1.0]),
            seed: dice.seed(),
        });
    }
    if dice.chance(difficulty.lamps) {
        light.lamps.push(Lamp {
            x_m: dice.between([low.x, high.x]),
            y_m: dice.between([low.y, high.y]),
            height_m: dice.between([1.2, 2.5]),
            radius_m: dice.between([0.05, 0.2]),
            strength: dice.between([0.2, 0.8]),
            colour: Colour::new(255, 236, 208),
        });
    }
    if light.along_lap.is_empty() && dice.chance(difficulty.light_changes) {
        light.along_lap = (0..3)
            .map(|i| LightChange {
                lap_part: f64::from(i) / 3.0,
                level: dice.between([0.5, 1.2]),
            })
            .collect();
    }
    light
}

/// A box or board beside the path; `None` where the place that came up is on another part of it.
fn choose_thing(dice: &mut Dice, path: &Curve, reach_m: f64) -> Option<Thing> {
    let at = path.pose_at(dice.part() * path.length_m());
    let side = if dice.chance(0.5) { 1.0 } else { -1.0 };
    let width_m = dice.between([0.05, 0.25]);
    let offset_m = side * (reach_m + width_m + dice.between([0.0, 0.5]));
    let place = at.position() + at.left() * offset_m;
    let heading_rad = dice.between([-PI, PI]);
    let shape = if dice.chance(0.6) {
        ThingShape::Box {
            length_m: dice.between([0.05, 0.25]),
            width_m,
        }
    } else {
        ThingShape::Board { width_m }
    };
    let height_m = dice.between([0.06, 0.4]);
    let (colour, second_colour) = (
        dice.vary(Colour::new(128, 110, 96), 90.0),
        dice.vary(Colour::new(150, 150, 150), 90.0),
    );
    let size_m = dice.between([0.02, 0.08]);
    let texture = match dice.below(3) {
        0 => Texture::Plain { colour },
        1 => Texture::Checker {
            colour,
            second_colour,
            size_m,
        },
        _ => Texture::Stripes {
            colour,
            second_colour,
            size_m,
        },
    };
    let clear = path.project(place).offset_m.abs() > reach_m + width_m * 0.8;
    clear.then(|| Thing {
        name: String::new(),
        shape,
        pose: Pose2::new(place.x, place.y, heading_rad),
        bottom_m: 0.0,
        height_m,
        texture,
        back: second_colour,
    })
}
