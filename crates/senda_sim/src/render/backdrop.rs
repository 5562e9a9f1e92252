//! What lies above the horizon: a plain room with windows, or hills under the sky; far away.

use super::kernel::STEPS_PER_TEXEL;
use super::texture::MipTexture;
use senda_core::threads::both;
use senda_geom::{angle, trig};
use std::f64::consts::PI;
use std::sync::OnceLock;

/// A panorama of the room and the same in coarse cells with its true brightness, for reflections on the floor.
///
/// The room is far away compared to the drive: it turns with the heading and does not move otherwise.
#[derive(Debug, Clone)]
pub struct Backdrop {
    room: Room,
    /// Drawn when a camera first looks above the horizon.
    panorama: OnceLock<MipTexture>,
    mirror: OnceLock<Mirror>,
}

/// The room in coarse cells with its true brightness.
#[derive(Debug, Clone)]
pub(super) struct Mirror(Vec<[f32; 4]>);

/// How the room looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Colour of the walls (linear, 0..=1 a channel).
    pub wall: [f64; 3],
    /// Colour of the ceiling (linear).
    pub ceiling: [f64; 3],
    /// Where windows are (rad in the world), on the wall that this heading meets.
    pub window_rad: f64,
    /// Light of the windows, relative to a white floor in full light; 0: no windows.
    pub window: f64,
    /// Colour of the light (linear, 0..=1 a channel).
    pub light: [f64; 3],
    /// Colour of hills (linear): then `wall` is the sky at the horizon, `ceiling` the sky above, and there is no room.
    pub hills: Option<[f64; 3]>,
}

/// Half the sides of the room (m). A guess: a lecture hall.
const HALF_LENGTH_M: f64 = 6.0;
const HALF_WIDTH_M: f64 = 4.5;
/// Ceiling above the camera (m).
const CEILING_M: f64 = 2.8;
/// Texels around the panorama.
const TEXELS_PER_TURN: usize = 512;
/// Texels kept beyond two turns at both ends, and below the horizon.
const MARGIN: usize = 24;
const BELOW: usize = 4;
/// Cells of the mirror map around and from the horizon up.
const MIRROR_COLUMNS: usize = 128;
const MIRROR_ROWS: usize = 32;

impl Backdrop {
    /// Texels a radian: soft, as an out-of-focus background is.
    pub(super) const TEXELS_PER_RAD: f64 = TEXELS_PER_TURN as f64 / (2.0 * PI);

    /// Takes a room; draws nothing yet.
    pub fn new(room: Room) -> Self {
        Self {
            room,
            panorama: OnceLock::new(),
            mirror: OnceLock::new(),
        }
    }

    pub(super) fn panorama(&self) -> &MipTexture {
        self.panorama.get_or_init(|| panorama(&Lit::new(&self.room)))
    }

    pub(super) fn mirror(&self) -> &Mirror {
        self.mirror.get_or_init(|| Mirror::new(&Lit::new(&self.room)))
    }

    /// Where a look at azimuth and elevation 0 in the vehicle frame lands, for a heading and a small turn from it.
    pub(super) fn origin(heading_rad: f64, turned_rad: f64) -> [f32; 2] {
        let heading = angle::wrap(heading_rad);
        // In 0..2π: with azimuths of -π..π, inside the two turns that are drawn.
        let heading = if heading < 0.0 {
            heading + 2.0 * PI
        } else {
            heading
        };
        let column = (heading + turned_rad + PI) * Self::TEXELS_PER_RAD + MARGIN as f64;
        [
            (column * STEPS_PER_TEXEL + MipTexture::ORIGIN) as f32,
            (BELOW as f64 * STEPS_PER_TEXEL + MipTexture::ORIGIN) as f32,
        ]
    }
}

/// Two turns of the room, so that any heading and any camera's azimuth together stay inside.
fn panorama(room: &Lit) -> MipTexture {
    /// Samples a texel, across and up: the sills of windows rise slowly, so that up matters more.
    const ACROSS: usize = 2;
    const UP: usize = 4;
    let rows = (PI / 2.0 * Backdrop::TEXELS_PER_RAD).ceil() as usize + BELOW;
    let columns = 2 * TEXELS_PER_TURN + 2 * MARGIN;
    let directions: Vec<(f64, f64)> = (0..ACROSS * TEXELS_PER_TURN)
        .map(|i| trig::sincos((i as f64 + 0.5) / ACROSS as f64 / Backdrop::TEXELS_PER_RAD - PI))
        .collect();
    let byte = |value: f64| (255.0 * value.min(1.0).sqrt()).round() as u8;
    let mut texels = vec![[0; 4]; columns * rows];
    let draw = |part: &mut [[u8; 4]], first: usize| {
        let mut turn = Vec::with_capacity(TEXELS_PER_TURN);
        for (j, row) in part.chunks_exact_mut(columns).enumerate() {
            let slopes: [f64; UP] = std::array::from_fn(|k| {
                let row = (first + j) as f64 + (k as f64 + 0.5) / UP as f64 - BELOW as f64;
                trig::tan((row / Backdrop::TEXELS_PER_RAD).min(1.55))
            });
            turn.clear();
            turn.extend(directions.chunks_exact(ACROSS).map(|directions| {
                let mut light = [0.0; 3];
                for slope in slopes {
                    for (sin, cos) in directions {
                        let sample = room.radiance(*cos, *sin, slope);
                        light = [0, 1, 2].map(|c| light[c] + sample[c].min(1.0) / (ACROSS * UP) as f64);
                    }
                }
                [byte(light[0]), byte(light[1]), byte(light[2]), 0]
            }));
            for (i, texel) in row.iter_mut().enumerate() {
                *texel = turn[(i + TEXELS_PER_TURN - MARGIN) % TEXELS_PER_TURN];
            }
        }
    };
    // Rows near the horizon are dearer: walls, windows, hills.
    let middle = 2 * rows / 5;
    let (low, high) = texels.split_at_mut(columns * middle);
    both(columns * rows, || draw(low, 0), || draw(high, middle));
    let outside = texels[0];
    MipTexture::new(columns, rows, &texels, outside)
}

impl Mirror {
    fn new(room: &Lit) -> Self {
        /// Samples a cell, across and up.
        const SAMPLES: usize = 3;
        let part = |k: usize| (k as f64 + 0.5) / SAMPLES as f64 - 0.5;
        let directions: Vec<(f64, f64)> = (0..SAMPLES * (MIRROR_COLUMNS + 1))
            .map(|i| {
                let column = (i / SAMPLES) as f64 + part(i % SAMPLES);
                trig::sincos(column / MIRROR_COLUMNS as f64 * 2.0 * PI)
            })
            .collect();
        let mut cells = Vec::with_capacity((MIRROR_COLUMNS + 1) * MIRROR_ROWS);
        for j in 0..MIRROR_ROWS {
            let slopes: [f64; SAMPLES] = std::array::from_fn(|k| {
                let elevation = (j as f64 + part(k)) / (MIRROR_ROWS - 1) as f64 * PI / 2.0;
                trig::tan(elevation.clamp(0.0, 1.55))
            });
            cells.extend(directions.chunks_exact(SAMPLES).map(|directions| {
                let mut sum = [0.0; 3];
                for slope in slopes {
                    for (sin, cos) in directions {
                        let light = room.radiance(*cos, *sin, slope);
                        sum = [0, 1, 2].map(|c| sum[c] + light[c] / (SAMPLES * SAMPLES) as f64);
                    }
                }
                let [r, g, b] = sum.map(|value| value as f32);
                [r, g, b, 0.0]
            }));
        }
        Self(cells)
    }

    /// The row for an elevation (rad), as index and part towards the next.
    pub(super) fn row(elevation_rad: f64) -> (usize, f32) {
        let row = (elevation_rad / (PI / 2.0)).clamp(0.0, 1.0) * (MIRROR_ROWS - 1) as f64;
        let below = (row as usize).min(MIRROR_ROWS - 2);
        (below, (row - below as f64) as f32)
    }

    /// An azimuth (rad, any number of turns) in cells, 0 to less than a turn.
    pub(super) fn column(azimuth_rad: f64) -> f32 {
        let turn = 2.0 * PI;
        (azimuth_rad.rem_euclid(turn) / turn * MIRROR_COLUMNS as f64) as f32
    }

    /// Light (R, G, B, 0) from a direction: the sum of two [`Mirror::column`]s and a row from [`Mirror::row`].
    #[inline]
    pub(super) fn light(&self, column: f32, (row, part): (usize, f32)) -> [f32; 4] {
        const TURN: f32 = MIRROR_COLUMNS as f32;
        let column = if column >= TURN { column - TURN } else { column };
        let column = column.clamp(0.0, TURN - 0.001);
        let left = column as usize;
        let across = column - left as f32;
        let at = row * (MIRROR_COLUMNS + 1) + left;
        let below = &self.0[at..at + 2];
        let above = &self.0[at + MIRROR_COLUMNS + 1..][..2];
        let mut light = [0.0; 4];
        for c in 0..4 {
            let low = below[0][c] + (below[1][c] - below[0][c]) * across;
            let high = above[0][c] + (above[1][c] - above[0][c]) * across;
            light[c] = low + (high - low) * part;
        }
        light
    }
}

/// A room with the direction of its windows worked out.
struct Lit<'a> {
    room: &'a Room,
    window_cos: f64,
    window_sin: f64,
    /// Whether the windows are in one of the walls across x.
    across_x: bool,
}

impl<'a> Lit<'a> {
    fn new(room: &'a Room) -> Self {
        let (window_sin, window_cos) = trig::sincos(room.window_rad);
        Self {
            room,
            window_cos,
            window_sin,
            across_x: HALF_LENGTH_M * window_sin.abs() < HALF_WIDTH_M * window_cos.abs(),
        }
    }

    /// Light from the direction with cosine and sine of the azimuth and the slope (tangent of the elevation), relative
    /// to a white floor in full light, linear.
    fn radiance(&self, cos: f64, sin: f64, slope: f64) -> [f64; 3] {
        if let Some(hills) = self.room.hills {
            return open_land(self.room, hills, cos, sin, slope);
        }
        let (to_x, to_y) = (
            HALF_LENGTH_M / cos.abs().max(1e-9),
            HALF_WIDTH_M / sin.abs().max(1e-9),
        );
        let distance = to_x.min(to_y);
        let height = slope * distance;
        // How much light arrives: more beside the windows' wall's opposite, less in corners.
        let to_window = cos * self.window_cos + sin * self.window_sin;
        let facing = 0.5 - 0.5 * to_window;
        let room = self.room;
        let tint = |colour: [f64; 3], level: f64| [0, 1, 2].map(|c| colour[c] * room.light[c] * level);
        if height > CEILING_M {
            // Ceiling: paler, darker far from the windows.
            let reach = CEILING_M / slope;
            return tint(room.ceiling, 0.95 - 0.03 * reach + 0.15 * facing);
        }
        // Place along the wall (m), from its middle.
        let (along, half) = if to_x < to_y {
            (distance * sin, HALF_WIDTH_M)
        } else {
            (distance * cos, HALF_LENGTH_M)
        };
        let corner = ((half - along.abs()) / 0.8).clamp(0.0, 1.0);
        let level = (0.42 + 0.3 * facing + 0.1 * height / CEILING_M) * (0.75 + 0.25 * corner);
        if height < 0.09 {
            return tint([0.2, 0.18, 0.16], level); // Skirting board.
        }
        let on_window_wall = (to_x < to_y) == self.across_x && to_window > 0.0;
        if on_window_wall && room.window > 0.0 && (0.9..2.3).contains(&height) && along.abs() < half - 0.6 {
            let pane = (along + 20.0).rem_euclid(1.6);
            if (0.12..1.48).contains(&pane) && (pane - 0.8).abs() > 0.03 {
                // Sky above, something green and dark outside below.
                let sky = ((height - 1.1) / 0.5).clamp(0.25, 1.0);
                return [0.92, 0.97, 1.0].map(|c| c * room.window * sky);
            }
            if (0.04..1.56).contains(&pane) {
                return tint([0.85, 0.85, 0.83], level * 1.1); // Frame.
            }
        }
        if !on_window_wall && (0.0..2.05).contains(&height) && ((along - 1.4).abs() < 0.47) {
            return tint([0.42, 0.3, 0.2], level); // Door.
        }
        tint(room.wall, level)
    }
}

/// Light from open land: sky, clouds low above the horizon, and two rows of hills, the farther one hazy.
fn open_land(room: &Room, hills: [f64; 3], cos: f64, sin: f64, slope: f64) -> [f64; 3] {
    let mix = |a: [f64; 3], b: [f64; 3], part: f64| [0, 1, 2].map(|c| a[c] + (b[c] - a[c]) * part);
    let (far, near) = (
        0.055
            + 0.030
                * wave(
                    cos,
                    sin,
                    &[(3, 0.4, 0.2), (5, 0.5, 1.0), (11, 0.25, 4.0), (23, 0.12, 2.2)],
                ),
        0.018
            + 0.030
                * wave(
                    cos,
                    sin,
                    &[(2, 0.7, 3.1), (7, 0.4, 0.7), (13, 0.2, 5.0), (29, 0.12, 1.3)],
                ),
    );
    if slope < near {
        // Meadows and woods alternate.
        let shade = 0.85 + 0.25 * wave(cos, sin, &[(17, 0.6, 0.3), (41, 0.4, 2.0)]);
        return hills.map(|c| c * shade);
    }
    if slope < far {
        return mix(hills, room.wall, 0.5);
    }
    let sky = mix(room.wall, room.ceiling, slope / (slope + 0.25));
    let cloud =
        wave(cos, sin, &[(4, 0.5, 2.0), (9, 0.4, 5.0), (21, 0.3, 1.0)]) - ((slope - 0.32) / 0.12).abs() - 0.1;
    mix(sky, [1.0; 3], cloud.clamp(0.0, 0.5))
}

/// A sum of waves around the horizon (waves a turn, strength, phase in rad), each from -1 to 1, by powers of the
/// direction as a complex number: no angles, no functions that differ between machines.
fn wave(cos: f64, sin: f64, waves: &[(u32, f64, f64)]) -> f64 {
    let mut sum = 0.0;
    let (mut power, mut x, mut y) = (0, 1.0, 0.0);
    for &(turns, strength, phase_rad) in waves {
        while power < turns {
            (x, y) = (x * cos - y * sin, x * sin + y * cos);
            power += 1;
        }
        let (phase_sin, phase_cos) = trig::sincos(phase_rad);
        sum += strength * (x * phase_cos - y * phase_sin);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_where_the_light_comes_from_and_mirror_brighter_than_walls() {
        let room = Room {
            wall: [0.6, 0.58, 0.55],
            ceiling: [0.8; 3],
            window_rad: 0.0,
            window: 4.0,
            light: [1.0; 3],
            hills: None,
        };
        let mirror = Mirror::new(&Lit::new(&room));
        let row = Mirror::row(0.26);
        let brightest = |from: usize, to: usize| {
            (from..to)
                .map(|column| mirror.light(column as f32, row)[1])
                .fold(0.0, f32::max)
        };
        assert!(brightest(0, 10) > 2.0 && brightest(54, 74) < 1.0);
        // The map is the same a turn on, and has no seam.
        assert_eq!(mirror.light(3.5, row), mirror.light(131.5, row));
        assert!((Mirror::column(-0.1) - Mirror::column(2.0 * PI - 0.1)).abs() < 1e-4);
        let (before, after) = (mirror.light(127.99, row), mirror.light(128.01, row));
        assert!((before[1] - after[1]).abs() < 0.05);
    }
}
