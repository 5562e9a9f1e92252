//! How a scene in one picture lies over the same scene in another: has the camera moved since? (A6 in SPEC.)
//!
//! ```
//! use senda_core::{Channels, Image};
//! use senda_vision::alignment::{Verdict, align};
//! // Nothing but one colour: no way to tell.
//! let wall = Image::new(160, 120, Channels::Gray);
//! assert_eq!(align(&wall, &wall).unwrap().verdict(), Verdict::Unclear);
//! ```
//!
//! Corners of both pictures (Harris and Stephens 1988) are compared by the correlation of their surroundings, which does
//! not mind other light; then the shift, turn and scale that most of them agree on is taken, so that what was moved in the room,
//! shadows and wrong matches do not count.
//!
//! What is far away stays in its place when a camera is raised or pushed aside; only the floor near the vehicle shows that. So half of
//! the corners are taken from the lower half of the picture, and a camera counts as unmoved only if they agree too.

use crate::luminance::luminance;
use senda_core::edges::{Gradients, sobel};
use senda_core::{Channels, Image};
use senda_geom::{Vec2, trig};
use std::ops::Range;

/// Pictures are compared at this width at most (px): finer detail does not say more about the camera.
const WORK_WIDTH_PX: usize = 320;
/// Half the side of a corner's surroundings (px): 17x17, enough to be told from its neighbours.
const HALF_PATCH: usize = 8;
/// Corners taken from each half of a picture, upper and lower, the strongest first.
const CORNERS: usize = 200;
/// Corners stand at least this far apart (px).
const CORNER_DISTANCE_PX: usize = 4;
/// Corners weaker than this part of the strongest of their half are noise.
const CORNER_PART: f64 = 0.003;
/// A match is looked for within this part of the width: a camera that was knocked harder is seen without a program.
const REACH_PART: f64 = 0.2;
/// Correlation of surroundings from which two corners may be the same.
const LEAST_CORRELATION: f64 = 0.75;
/// Correlation that a match must be better by for each pixel that it lies farther off: where a pattern repeats itself, the nearest of
/// equals is meant (guess: small against what noise does to a correlation).
const FARTHER_PER_PX: f64 = 0.001;
/// Matches of each half that take part, the best first: their pairs are all tried.
const MATCHES: usize = 60;
/// Matches agree that are this close to the common movement (px at the working width).
const AGREE_PX: f64 = 1.5;
/// Fewer agreeing matches than this are chance.
const LEAST_AGREEING: usize = 10;
/// The part of all matches that must agree on a movement.
const LEAST_AGREEING_PART: f64 = 0.3;
/// The part that must agree that there is none: without a clear majority the others may be what has moved. Measured in simulated
/// rooms with patterned floors: 81 to 100 % where the camera stood still under another light; 24 to 67 % where it was raised by
/// 2 to 6 cm or pushed by 4 to 8.
const CLEAR_MAJORITY: f64 = 0.75;
/// Matches in the lower half without which nothing is known of height and place (guess).
const LEAST_NEAR: usize = 5;
/// Limits of "the same pose": part of the width, radians, part of the scale (guess: about half a degree of a usual camera,
/// below the tolerance with which such cameras are mounted).
const SAME: (f64, f64, f64) = (0.01, 0.0087, 0.01);

/// Where the reference picture's scene lies in today's picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// How far what was in the middle of the reference has moved (px of today's picture; right, down).
    pub offset_px: [f64; 2],
    /// How far the scene is turned, clockwise in the picture (rad).
    pub rotation_rad: f64,
    /// How much larger it is.
    pub scale: f64,
    /// Corners that were found again.
    pub matches: usize,
    /// Those among them that agree on this movement.
    pub agreeing: usize,
    /// Of the corners that were found again, those in the lower half of the reference: near the vehicle.
    pub near_matches: usize,
    /// Those among them that agree on this movement.
    pub near_agreeing: usize,
    /// Width of today's picture (px).
    width_px: usize,
}

/// What an [`Alignment`] means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The camera looks as it did.
    Same,
    /// It has moved.
    Moved,
    /// The pictures do not show enough of the same things.
    Unclear,
}

impl Alignment {
    /// Whether the camera has moved: by more than 1 % of the picture's width, half a degree or 1 % of scale. That it has not is
    /// only said where a clear majority says so, near the vehicle too.
    pub fn verdict(&self) -> Verdict {
        let is_part = |part: f64, count: usize, of: usize| count as f64 >= part * of as f64;
        let enough =
            self.agreeing >= LEAST_AGREEING && is_part(LEAST_AGREEING_PART, self.agreeing, self.matches);
        let is_clear = is_part(CLEAR_MAJORITY, self.agreeing, self.matches)
            && self.near_agreeing >= LEAST_NEAR
            && is_part(CLEAR_MAJORITY, self.near_agreeing, self.near_matches);
        let (offset_part, rotation_rad, scale_part) = SAME;
        let [right, down] = self.offset_px;
        if !enough {
            Verdict::Unclear
        } else if Vec2::new(right, down).length() <= offset_part * self.width_px as f64
            && self.rotation_rad.abs() <= rotation_rad
            && (self.scale - 1.0).abs() <= scale_part
        {
            if is_clear { Verdict::Same } else { Verdict::Unclear }
        } else {
            Verdict::Moved
        }
    }
}

/// Compares today's picture with a reference picture of the same scene. Sizes may differ, shapes not: `None` where one is
/// empty or they have different shapes (by more than 2 %).
pub fn align(reference: &Image, today: &Image) -> Option<Alignment> {
    if reference.is_empty() || today.is_empty() {
        return None;
    }
    let shape = |image: &Image| image.width() as f64 / image.height() as f64;
    if (shape(reference) / shape(today) - 1.0).abs() > 0.02 {
        return None;
    }
    let width = today.width().min(WORK_WIDTH_PX);
    let height = (today.height() * width / today.width()).max(1);
    let matches = matches(
        &Grey::of(reference, width, height),
        &Grey::of(today, width, height),
    );
    let (movement, agreeing) = agreement(&matches);
    let near = || {
        matches
            .iter()
            .filter(|found| found.reference.y >= 0.5 * height as f64)
    };
    let middle = Vec2::new(width as f64, height as f64) * 0.5;
    let offset = (movement.of(middle) - middle) * (today.width() as f64 / width as f64);
    Some(Alignment {
        offset_px: [offset.x, offset.y],
        rotation_rad: trig::atan2(movement.factor.y, movement.factor.x),
        scale: movement.factor.length(),
        matches: matches.len(),
        agreeing,
        near_matches: near().count(),
        near_agreeing: near().filter(|found| movement.agrees(found)).count(),
        width_px: today.width(),
    })
}

/// One corner in both pictures.
#[derive(Debug, Clone, Copy)]
struct Match {
    reference: Vec2,
    today: Vec2,
    correlation: f64,
}

/// Turn, scale and shift: points are complex numbers, `factor · point + shift`.
#[derive(Debug, Clone, Copy)]
struct Movement {
    factor: Vec2,
    shift: Vec2,
}

fn product(a: Vec2, b: Vec2) -> Vec2 {
    Vec2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
}

/// a · conjugate(b)
fn against(a: Vec2, b: Vec2) -> Vec2 {
    product(a, Vec2::new(b.x, -b.y))
}

impl Movement {
    const NONE: Self = Self {
        factor: Vec2::new(1.0, 0.0),
        shift: Vec2::ZERO,
    };

    fn of(&self, point: Vec2) -> Vec2 {
        product(self.factor, point) + self.shift
    }

    /// The least-squares movement; `None` where the points lie in one place.
    fn fit<'a>(matches: impl Iterator<Item = &'a Match> + Clone) -> Option<Self> {
        let count = matches.clone().count() as f64;
        let (mut from, mut to) = (Vec2::ZERO, Vec2::ZERO);
        for found in matches.clone() {
            from += found.reference;
            to += found.today;
        }
        let (from, to) = (from / count.max(1.0), to / count.max(1.0));
        let (mut cross, mut spread) = (Vec2::ZERO, 0.0);
        for found in matches {
            let arm = found.reference - from;
            cross += against(found.today - to, arm);
            spread += arm.length_squared();
        }
        if !(spread > 1e-9) {
            return None;
        }
        let factor = cross / spread;
        Some(Self {
            factor,
            shift: to - product(factor, from),
        })
    }

    fn agrees(&self, found: &Match) -> bool {
        (self.of(found.reference) - found.today).length_squared() < AGREE_PX * AGREE_PX
    }
}

/// The movement that most matches agree on, and how many they are: every pair of matches proposes one.
fn agreement(matches: &[Match]) -> (Movement, usize) {
    let mut best = (Movement::NONE, 0);
    for (number, first) in matches.iter().enumerate() {
        for second in &matches[number + 1..] {
            // Neighbours say nothing about turn and scale.
            if (first.reference - second.reference).length_squared() < 400.0 {
                continue;
            }
            let Some(movement) = Movement::fit([*first, *second].iter()) else {
                continue;
            };
            if !(0.7..1.4).contains(&movement.factor.length()) {
                continue;
            }
            let agreeing = matches.iter().filter(|found| movement.agrees(found)).count();
            if agreeing > best.1 {
                best = (movement, agreeing);
            }
        }
    }
    for _ in 0..3 {
        let agreeing = matches.iter().filter(|found| best.0.agrees(found));
        if let Some(movement) = Movement::fit(agreeing) {
            let count = matches.iter().filter(|found| movement.agrees(found)).count();
            best = (movement, count);
        }
    }
    best
}

/// Corners of the reference with their best partners today, the best first. A match counts only if it is best both ways.
fn matches(reference: &Grey, today: &Grey) -> Vec<Match> {
    let (from, to) = (reference.corners(), today.corners());
    let reach = REACH_PART * reference.width as f64;
    let correlations: Vec<Vec<f64>> = from
        .iter()
        .map(|a| {
            let patch = reference.patch(*a);
            to.iter()
                .map(|b| {
                    let way = Vec2::new(a.0 as f64 - b.0 as f64, a.1 as f64 - b.1 as f64);
                    if way.length_squared() > reach * reach {
                        return -1.0;
                    }
                    correlation(&patch, &today.patch(*b)) - FARTHER_PER_PX * way.length()
                })
                .collect()
        })
        .collect();
    let mut found = Vec::new();
    for (a, row) in correlations.iter().enumerate() {
        let Some((b, best)) = largest(row.iter().copied()) else {
            continue;
        };
        let back = largest(correlations.iter().map(|row| row[b]));
        if best < LEAST_CORRELATION || back.map(|(index, _)| index) != Some(a) {
            continue;
        }
        found.push(Match {
            reference: Vec2::new(from[a].0 as f64, from[a].1 as f64),
            today: today.refined(to[b], &reference.patch(from[a])),
            correlation: best,
        });
    }
    found.sort_by(|a, b| b.correlation.total_cmp(&a.correlation));
    let (mut far, mut near): (Vec<Match>, Vec<Match>) = found
        .into_iter()
        .partition(|found| found.reference.y < 0.5 * reference.height as f64);
    far.truncate(MATCHES);
    near.truncate(MATCHES);
    far.append(&mut near);
    far
}

/// Index and value of the first largest.
fn largest(values: impl Iterator<Item = f64>) -> Option<(usize, f64)> {
    values.enumerate().fold(None, |best, (index, value)| match best {
        Some((_, most)) if most >= value => best,
        _ => Some((index, value)),
    })
}

type Patch = [f64; (2 * HALF_PATCH + 1) * (2 * HALF_PATCH + 1)];

/// Of patches without mean and with length 1.
fn correlation(a: &Patch, b: &Patch) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A grey picture of the working size.
struct Grey {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl Grey {
    /// Each pixel is the mean of those it covers.
    fn of(image: &Image, width: usize, height: usize) -> Self {
        let mut fine = vec![0; image.width() * image.height()];
        match image.channels() {
            Channels::Gray => fine.copy_from_slice(image.pixels()),
            Channels::Rgb => luminance(image.pixels(), &mut fine),
        }
        let covered = |place: usize, of: usize, fine: usize| {
            let begin = place * fine / of;
            begin..((place + 1) * fine / of).max(begin + 1)
        };
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let (rows, columns) = (
                    covered(y, height, image.height()),
                    covered(x, width, image.width()),
                );
                let count = rows.len() * columns.len();
                let sum: usize = rows
                    .flat_map(|row| &fine[row * image.width()..][columns.clone()])
                    .map(|pixel| usize::from(*pixel))
                    .sum();
                pixels.push((sum / count) as u8);
            }
        }
        Self {
            width,
            height,
            pixels,
        }
    }

    /// The strongest corners of both halves, column and row, away from the border.
    fn corners(&self) -> Vec<(usize, usize)> {
        let margin = HALF_PATCH + 2;
        if self.width <= 2 * margin || self.height <= 2 * margin {
            return Vec::new();
        }
        let mut gradients = Gradients::default();
        sobel(&self.pixels, self.width, &mut gradients);
        let strength = |x: usize, y: usize| -> f64 {
            let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
            for row in y - 2..=y + 2 {
                for column in x - 2..=x + 2 {
                    let du = f64::from(gradients.du[row * self.width + column]);
                    let dv = f64::from(gradients.dv[row * self.width + column]);
                    xx += du * du;
                    yy += dv * dv;
                    xy += du * dv;
                }
            }
            xx * yy - xy * xy - 0.05 * (xx + yy) * (xx + yy)
        };
        let mut strengths = vec![0.0; self.width * self.height];
        for y in margin..self.height - margin {
            for x in margin..self.width - margin {
                strengths[y * self.width + x] = strength(x, y);
            }
        }
        let mut taken = vec![false; strengths.len()];
        let middle = self.height / 2 * self.width;
        let mut corners = self.strongest(&strengths, 0..middle, &mut taken);
        corners.extend(self.strongest(&strengths, middle..strengths.len(), &mut taken));
        corners
    }

    /// The strongest corners of some places. What is too near to one that is taken is marked.
    fn strongest(&self, strengths: &[f64], places: Range<usize>, taken: &mut [bool]) -> Vec<(usize, usize)> {
        let strongest = strengths[places.clone()].iter().copied().fold(0.0, f64::max);
        let mut order: Vec<usize> = places
            .filter(|place| strengths[*place] > CORNER_PART * strongest)
            .collect();
        order.sort_by(|a, b| strengths[*b].total_cmp(&strengths[*a]).then(a.cmp(b)));
        let mut corners = Vec::new();
        for place in order {
            let (x, y) = (place % self.width, place / self.width);
            if taken[place] {
                continue;
            }
            corners.push((x, y));
            if corners.len() == CORNERS {
                break;
            }
            for row in y.saturating_sub(CORNER_DISTANCE_PX)..=(y + CORNER_DISTANCE_PX).min(self.height - 1) {
                let first = x.saturating_sub(CORNER_DISTANCE_PX);
                let last = (x + CORNER_DISTANCE_PX).min(self.width - 1);
                taken[row * self.width + first..=row * self.width + last].fill(true);
            }
        }
        corners
    }

    /// A corner's surroundings, without their mean and with length 1. The corner keeps its distance from the border.
    fn patch(&self, (x, y): (usize, usize)) -> Patch {
        let side = 2 * HALF_PATCH + 1;
        let mut patch = [0.0; (2 * HALF_PATCH + 1) * (2 * HALF_PATCH + 1)];
        for (row, target) in patch.chunks_exact_mut(side).enumerate() {
            let from = (y + row - HALF_PATCH) * self.width + x - HALF_PATCH;
            for (value, pixel) in target.iter_mut().zip(&self.pixels[from..from + side]) {
                *value = f64::from(*pixel);
            }
        }
        let mean = patch.iter().sum::<f64>() / patch.len() as f64;
        patch.iter_mut().for_each(|value| *value -= mean);
        let length = patch.iter().map(|value| value * value).sum::<f64>().sqrt();
        patch.iter_mut().for_each(|value| *value /= length.max(1e-9));
        patch
    }

    /// Where around a corner its surroundings fit a patch best, between pixels: the top of a parabola each way.
    fn refined(&self, (x, y): (usize, usize), patch: &Patch) -> Vec2 {
        let at = |x: usize, y: usize| correlation(patch, &self.patch((x, y)));
        // A corner found a pixel beside its place is put right first.
        let (mut x, mut y) = (x, y);
        let mut best = at(x, y);
        for (nx, ny) in [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)] {
            let value = at(nx, ny);
            if value > best {
                (best, x, y) = (value, nx, ny);
            }
        }
        let top = |before: f64, after: f64| {
            let bend = before - 2.0 * best + after;
            if bend < -1e-9 {
                (0.5 * (before - after) / bend).clamp(-0.5, 0.5)
            } else {
                0.0
            }
        };
        Vec2::new(
            x as f64 + top(at(x - 1, y), at(x + 1, y)),
            y as f64 + top(at(x, y - 1), at(x, y + 1)),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room full of patches, seen through a turn (rad), a scale and a shift (px), under other light; 200x150.
    fn room(turn_rad: f64, scale: f64, shift: Vec2, brightness: f64) -> Image {
        let (sin, cos) = trig::sincos(turn_rad);
        let mut image = Image::new(200, 150, Channels::Gray);
        let middle = Vec2::new(100.0, 75.0);
        for v in 0..150 {
            for u in 0..200 {
                let arm = (Vec2::new(u as f64, v as f64) - middle - shift) / scale;
                let place = middle + Vec2::new(cos * arm.x + sin * arm.y, cos * arm.y - sin * arm.x);
                image.row_mut(v)[u] = (brightness * tile(place)).clamp(0.0, 255.0) as u8;
            }
        }
        image
    }

    /// Tiles of 11 px with grey values of their own, their edges soft.
    fn tile(place: Vec2) -> f64 {
        let grey = |x: i64, y: i64| {
            let mixed = (x * 7919 + y * 104_729).wrapping_mul(2_654_435_761) >> 7;
            40.0 + (mixed & 127) as f64
        };
        let (x, y) = (place.x / 11.0 + 50.0, place.y / 11.0 + 50.0);
        let (left, above) = (x.floor(), y.floor());
        // Steep but smooth between tiles.
        let soft = |part: f64| ((part - 0.5) * 5.0 + 0.5).clamp(0.0, 1.0);
        let (right_part, below_part) = (soft(x - left), soft(y - above));
        let (i, j) = (left as i64, above as i64);
        let row = |j: i64| grey(i, j) * (1.0 - right_part) + grey(i + 1, j) * right_part;
        row(j) * (1.0 - below_part) + row(j + 1) * below_part
    }

    #[test]
    fn the_same_view_under_other_light_is_the_same_pose() {
        let found = align(&room(0.0, 1.0, Vec2::ZERO, 1.0), &room(0.0, 1.0, Vec2::ZERO, 0.7)).unwrap();
        assert_eq!(found.verdict(), Verdict::Same, "{found:?}");
    }

    #[test]
    fn right_down_and_clockwise_are_positive_and_measured_to_a_fraction_of_a_pixel() {
        let moved = room(0.03, 1.04, Vec2::new(6.0, -3.5), 0.9);
        let found = align(&room(0.0, 1.0, Vec2::ZERO, 1.0), &moved).unwrap();
        assert_eq!(found.verdict(), Verdict::Moved, "{found:?}");
        assert!((found.offset_px[0] - 6.0).abs() < 0.4, "{found:?}");
        assert!((found.offset_px[1] + 3.5).abs() < 0.4, "{found:?}");
        assert!((found.rotation_rad - 0.03).abs() < 0.004, "{found:?}");
        assert!((found.scale - 1.04).abs() < 0.005, "{found:?}");
    }

    #[test]
    fn what_stands_elsewhere_in_the_room_does_not_count() {
        let mut moved = room(0.0, 1.0, Vec2::new(5.0, 0.0), 1.0);
        // A third of the picture shows something else.
        let other = room(0.4, 1.3, Vec2::new(-40.0, 17.0), 1.0);
        for v in 0..150 {
            moved.row_mut(v)[..66].copy_from_slice(&other.row(v)[..66]);
        }
        let found = align(&room(0.0, 1.0, Vec2::ZERO, 1.0), &moved).unwrap();
        assert_eq!(found.verdict(), Verdict::Moved, "{found:?}");
        assert!((found.offset_px[0] - 5.0).abs() < 0.3, "{found:?}");
        assert!(found.offset_px[1].abs() < 0.3, "{found:?}");
    }

    /// A tiled floor before a tiled wall 6 m ahead, seen by a camera at a height (m), pushed to the left (m), tilted down (°).
    fn hall(height_m: f64, left_m: f64, tilt_deg: f64, brightness: f64) -> Image {
        const FOCAL_PX: f64 = 150.0;
        const WALL_M: f64 = 6.0;
        let (sin, cos) = trig::sincos(tilt_deg.to_radians());
        let mut image = Image::new(200, 150, Channels::Gray);
        for v in 0..150 {
            for u in 0..200 {
                let right = (u as f64 - 99.5) / FOCAL_PX;
                let below = (v as f64 - 74.5) / FOCAL_PX;
                let (down, ahead) = (below * cos + sin, cos - below * sin);
                let to_floor = if down > 1e-9 {
                    height_m / down
                } else {
                    f64::INFINITY
                };
                let place = if to_floor * ahead < WALL_M {
                    // Tiles of 5 cm.
                    Vec2::new(right * to_floor - left_m, to_floor * ahead) * (11.0 / 0.05)
                } else {
                    // Tiles of 60 cm.
                    let far = WALL_M / ahead;
                    Vec2::new(right * far - left_m, height_m - down * far - 7.0) * (11.0 / 0.6)
                };
                image.row_mut(v)[u] = (brightness * tile(place)).clamp(0.0, 255.0) as u8;
            }
        }
        image
    }

    /// The wall hardly moves when the camera is raised or pushed aside, and a third of the corners on it were enough for "as in the
    /// reference".
    #[test]
    fn a_camera_that_was_raised_or_pushed_aside_is_never_as_in_the_reference() {
        let reference = hall(0.2, 0.0, 5.0, 1.0);
        let compare = |today: &Image| align(&reference, today).unwrap();
        let same = compare(&hall(0.2, 0.0, 5.0, 0.7));
        assert_eq!(same.verdict(), Verdict::Same, "{same:?}");
        for (height_m, left_m) in [(0.24, 0.0), (0.26, 0.0), (0.16, 0.0), (0.2, 0.03), (0.2, -0.06)] {
            let found = compare(&hall(height_m, left_m, 5.0, 1.0));
            assert_ne!(found.verdict(), Verdict::Same, "{height_m} {left_m}: {found:?}");
        }
        for tilt_deg in [2.0, 8.0] {
            let found = compare(&hall(0.2, 0.0, tilt_deg, 1.0));
            assert_eq!(found.verdict(), Verdict::Moved, "{tilt_deg}: {found:?}");
        }
    }

    /// With corners on the wall alone nobody knows how high the camera is.
    #[test]
    fn a_bare_floor_is_no_verdict() {
        let bare = |height_m: f64| {
            let mut image = hall(height_m, 0.0, 0.0, 1.0);
            for v in 60..150 {
                image.row_mut(v).fill(128);
            }
            image
        };
        let found = align(&bare(0.2), &bare(0.2)).unwrap();
        assert!(found.agreeing >= LEAST_AGREEING, "{found:?}");
        assert_eq!(found.verdict(), Verdict::Unclear, "{found:?}");
    }

    #[test]
    fn another_scene_is_no_verdict_and_another_shape_no_comparison() {
        let noise = |seed: u64| {
            let mut state = seed;
            let pixels = (0..200 * 150)
                .map(|_| {
                    state = state
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1_442_695_040_888_963_407);
                    (state >> 56) as u8
                })
                .collect();
            Image::from_pixels(200, 150, Channels::Gray, pixels).unwrap()
        };
        let found = align(&noise(1), &noise(2)).unwrap();
        assert_eq!(found.verdict(), Verdict::Unclear, "{found:?}");
        assert!(align(&noise(1), &Image::new(100, 100, Channels::Gray)).is_none());
        assert!(align(&noise(1), &Image::default()).is_none());
        let tiny = Image::new(4, 3, Channels::Rgb);
        assert_eq!(align(&tiny, &tiny).unwrap().verdict(), Verdict::Unclear);
    }
}
