//! Floor, paint, light and things of made-up worlds.

use super::dice::Dice;
use super::{Difficulty, Tone};
use crate::colour::Colour;
use crate::floor::{Floor, FloorKind};
use crate::light::{Lamp, Light, LightChange, Shadows};
use crate::marking::{Dash, Marking};
use crate::texture::Texture;
use crate::thing::{Thing, ThingShape};
use senda_geom::{Curve, Pose2, Vec2};
use std::f64::consts::PI;

/// Lines must differ from the floor by this much luminance (of 255) to be seen.
const LEAST_CONTRAST: f64 = 55.0;

pub(super) fn choose_floor(dice: &mut Dice, difficulty: &Difficulty) -> Floor {
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

pub(super) fn choose_markings(
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
    let dash = dice
        .chance(difficulty.dashes)
        .then(|| choose_dash(dice, path, [0.10, 0.24]));
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
    let Some(lane_width_m) = lane_width_m else {
        return vec![marking];
    };
    let mut markings: Vec<Marking> = [0.5, -0.5]
        .into_iter()
        .map(|side| Marking {
            offset_m: side * lane_width_m,
            ..marking.clone()
        })
        .collect();
    // Without a roll where there is no choice: other families keep their worlds.
    if difficulty.centre > 0.0 && dice.chance(difficulty.centre) {
        let wanted = if difficulty.centre_colours.is_empty() {
            &difficulty.colours
        } else {
            &difficulty.centre_colours
        };
        let others: Vec<Colour> = wanted
            .iter()
            .copied()
            .filter(|other| fits(other) && *other != colour)
            .collect();
        markings.push(Marking {
            colour: if others.is_empty() {
                colour
            } else {
                others[dice.below(others.len())]
            },
            dash: Some(choose_dash(
                dice,
                path,
                difficulty.centre_period.map(|part| part * lane_width_m),
            )),
            ..marking
        });
    }
    markings
}

/// A whole number of dashes around the lap.
fn choose_dash(dice: &mut Dice, path: &Curve, period_m: [f64; 2]) -> Dash {
    let period_m = dice.between(period_m);
    let period_m = path.length_m() / (path.length_m() / period_m).round().max(1.0);
    let painted = dice.between([0.5, 0.75]);
    Dash {
        length_m: period_m * painted,
        gap_m: period_m * (1.0 - painted),
        phase_m: 0.0,
    }
}

pub(super) fn choose_light(dice: &mut Dice, difficulty: &Difficulty, (low, high): (Vec2, Vec2)) -> Light {
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
pub(super) fn choose_thing(dice: &mut Dice, path: &Curve, reach_m: f64) -> Option<Thing> {
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
