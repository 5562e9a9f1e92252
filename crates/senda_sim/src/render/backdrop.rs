//! What lies above the horizon: a plain room with windows, far away.

use super::kernel::STEPS_PER_TEXEL;
use super::texture::MipTexture;
use senda_geom::{angle, trig};
use std::f64::consts::PI;

/// A panorama of the room and the same in coarse cells with its true brightness, for reflections on the floor.
///
/// The room is far away compared to the drive: it turns with the heading and does not move otherwise.
#[derive(Debug, Clone)]
pub struct Backdrop {
    panorama: MipTexture,
    mirror: Vec<[f32; 3]>,
}

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
}

/// Half the sides of the room (m). A guess: a lecture hall.
const HALF_LENGTH_M: f64 = 6.0;
const HALF_WIDTH_M: f64 = 4.5;
/// Ceiling above the camera (m).
const CEILING_M: f64 = 2.8;
/// Azimuth kept beyond two turns at both ends, and elevation below the horizon (rad).
const MARGIN_RAD: f64 = 0.3;
const BELOW_RAD: f64 = 0.05;
/// Cells of the mirror map around and from the horizon up.
const MIRROR_COLUMNS: usize = 128;
const MIRROR_ROWS: usize = 32;

impl Backdrop {
    /// Texels a radian: soft, as an out-of-focus background is.
    pub(super) const TEXELS_PER_RAD: f64 = 80.0;

    /// Draws the room.
    pub fn new(room: &Room) -> Self {
        let columns = ((4.0 * PI + 2.0 * MARGIN_RAD) * Self::TEXELS_PER_RAD).ceil() as usize;
        let rows = ((PI / 2.0 + BELOW_RAD) * Self::TEXELS_PER_RAD).ceil() as usize;
        let directions: Vec<(f64, f64)> = (0..columns)
            .map(|i| trig::sincos((i as f64 + 0.5) / Self::TEXELS_PER_RAD - MARGIN_RAD - PI))
            .collect();
        let mut texels = Vec::with_capacity(columns * rows);
        for j in 0..rows {
            let slope = trig::tan(((j as f64 + 0.5) / Self::TEXELS_PER_RAD - BELOW_RAD).min(1.55));
            texels.extend(directions.iter().map(|&(sin, cos)| {
                let light = room.radiance(cos, sin, slope);
                let byte = |value: f64| (255.0 * value.min(1.0).sqrt()).round() as u8;
                [byte(light[0]), byte(light[1]), byte(light[2]), 0]
            }));
        }
        let outside = texels[0];
        let mut mirror = Vec::with_capacity((MIRROR_COLUMNS + 1) * MIRROR_ROWS);
        for j in 0..MIRROR_ROWS {
            for i in 0..=MIRROR_COLUMNS {
                // The mean over a cell, by 3 x 3 samples.
                let mut sum = [0.0; 3];
                for sample in 0..9 {
                    let (du, dv) = (
                        (sample % 3) as f64 / 3.0 - 0.333,
                        (sample / 3) as f64 / 3.0 - 0.333,
                    );
                    let (sin, cos) = trig::sincos((i as f64 + du) / MIRROR_COLUMNS as f64 * 2.0 * PI);
                    let elevation = ((j as f64 + dv) / (MIRROR_ROWS - 1) as f64 * PI / 2.0).clamp(0.0, 1.55);
                    let light = room.radiance(cos, sin, trig::tan(elevation));
                    sum = [0, 1, 2].map(|c| sum[c] + light[c] / 9.0);
                }
                mirror.push(sum.map(|value| value as f32));
            }
        }
        Self {
            panorama: MipTexture::new(columns, rows, &texels, outside),
            mirror,
        }
    }

    pub(super) fn panorama(&self) -> &MipTexture {
        &self.panorama
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
        let scale = Self::TEXELS_PER_RAD * STEPS_PER_TEXEL;
        [
            ((heading + turned_rad + MARGIN_RAD + PI) * scale + MipTexture::ORIGIN) as f32,
            (BELOW_RAD * scale + MipTexture::ORIGIN) as f32,
        ]
    }

    /// Mirror cells per radian of azimuth.
    pub(super) const MIRROR_PER_RAD: f64 = MIRROR_COLUMNS as f64 / (2.0 * PI);

    /// The row of the mirror map for an elevation (rad), as index and part towards the next.
    pub(super) fn mirror_row(elevation_rad: f64) -> (usize, f32) {
        let row = (elevation_rad / (PI / 2.0)).clamp(0.0, 1.0) * (MIRROR_ROWS - 1) as f64;
        let below = (row as usize).min(MIRROR_ROWS - 2);
        (below, (row - below as f64) as f32)
    }

    /// Light from a direction: `column` in mirror cells, any number of turns; `row` from [`Backdrop::mirror_row`].
    pub(super) fn mirrored(&self, column: f32, (row, part): (usize, f32)) -> [f32; 3] {
        let turns = (column * (1.0 / MIRROR_COLUMNS as f32)).floor();
        let column = (column - turns * MIRROR_COLUMNS as f32).clamp(0.0, MIRROR_COLUMNS as f32 - 0.001);
        let left = column as usize;
        let across = column - left as f32;
        let at = row * (MIRROR_COLUMNS + 1) + left;
        let below = &self.mirror[at..at + 2];
        let above = &self.mirror[at + MIRROR_COLUMNS + 1..][..2];
        let mut light = [0.0; 3];
        for c in 0..3 {
            let low = below[0][c] + (below[1][c] - below[0][c]) * across;
            let high = above[0][c] + (above[1][c] - above[0][c]) * across;
            light[c] = low + (high - low) * part;
        }
        light
    }
}

impl Room {
    /// Light from the direction with cosine and sine of the azimuth and the slope (tangent of the elevation), relative
    /// to a white floor in full light, linear.
    fn radiance(&self, cos: f64, sin: f64, slope: f64) -> [f64; 3] {
        let (to_x, to_y) = (
            HALF_LENGTH_M / cos.abs().max(1e-9),
            HALF_WIDTH_M / sin.abs().max(1e-9),
        );
        let distance = to_x.min(to_y);
        let height = slope * distance;
        // How much light arrives: more beside the windows' wall's opposite, less in corners.
        let (window_sin, window_cos) = trig::sincos(self.window_rad);
        let facing = 0.5 - 0.5 * (cos * window_cos + sin * window_sin);
        let tint = |colour: [f64; 3], level: f64| [0, 1, 2].map(|c| colour[c] * self.light[c] * level);
        if height > CEILING_M {
            // Ceiling: paler, darker far from the windows.
            let reach = CEILING_M / slope;
            return tint(self.ceiling, 0.95 - 0.03 * reach + 0.15 * facing);
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
        let on_window_wall = {
            let (wall_x, wall_y) = (
                HALF_LENGTH_M / window_cos.abs().max(1e-9),
                HALF_WIDTH_M / window_sin.abs().max(1e-9),
            );
            (to_x < to_y) == (wall_x < wall_y) && cos * window_cos + sin * window_sin > 0.0
        };
        if on_window_wall && self.window > 0.0 && (0.9..2.3).contains(&height) && along.abs() < half - 0.6 {
            let pane = (along + 20.0).rem_euclid(1.6);
            if (0.12..1.48).contains(&pane) && (pane - 0.8).abs() > 0.03 {
                // Sky above, something green and dark outside below.
                let sky = ((height - 1.1) / 0.5).clamp(0.25, 1.0);
                return [0.92, 0.97, 1.0].map(|c| c * self.window * sky);
            }
            if (0.04..1.56).contains(&pane) {
                return tint([0.85, 0.85, 0.83], level * 1.1); // Frame.
            }
        }
        if !on_window_wall && (0.0..2.05).contains(&height) && ((along - 1.4).abs() < 0.47) {
            return tint([0.42, 0.3, 0.2], level); // Door.
        }
        tint(self.wall, level)
    }
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
        };
        let backdrop = Backdrop::new(&room);
        let row = Backdrop::mirror_row(0.26);
        let brightest = |from: usize, to: usize| {
            (from..to)
                .map(|column| backdrop.mirrored(column as f32, row)[1])
                .fold(0.0, f32::max)
        };
        assert!(brightest(0, 10) > 2.0 && brightest(54, 74) < 1.0);
        // The map is the same a turn on.
        assert_eq!(backdrop.mirrored(3.5, row), backdrop.mirrored(131.5, row));
    }
}
