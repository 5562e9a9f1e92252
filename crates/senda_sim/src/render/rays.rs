//! What every pixel of a camera looks at, computed once: floor points, backdrop directions, levels of detail.

use super::backdrop::Backdrop;
use super::kernel::{Detail, GROUP, Group, Groups, LEVELS, Positions, SLOTS, STEPS_PER_TEXEL};
use senda_core::threads::both;
use senda_geom::{Camera, Vec2, Vec3, angle, trig};

/// Rays flatter than this (vertical part of the unit direction) meet the floor no nearer than 2,000 camera heights.
const FLATTEST: f64 = 5e-4;

/// How texture detail is matched to pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sharpness {
    /// One bilinear look a pixel, from the level nearest to the footprint's geometric mean: the fastest.
    Single,
    /// Up to four looks along the footprint's longer axis (anisotropic): far lines keep their width and their edges.
    #[default]
    Spread,
}

/// What a run of groups shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shows {
    Floor,
    Backdrop,
    /// The horizon passes through.
    Both,
}

/// Consecutive groups of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    pub(super) shows: Shows,
    /// Groups within the row.
    pub(super) first: usize,
    pub(super) end: usize,
    /// Index of the first group's entry among the backdrop's groups, if it shows any of it.
    pub(super) backdrop: usize,
}

/// The table of a camera.
#[derive(Debug, Clone)]
pub(super) struct RayTable {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) groups_per_row: usize,
    /// Floor points of all groups, row by row.
    pub(super) floor: Groups,
    /// Backdrop directions of the groups that show it.
    pub(super) backdrop: Groups,
    /// For those groups: how much of each pixel is floor, 0..=128.
    pub(super) floor_part: Vec<[u8; GROUP]>,
    pub(super) runs: Vec<Run>,
    /// Runs of row y: `runs[row_runs[y]..row_runs[y + 1]]`.
    pub(super) row_runs: Vec<usize>,
    /// Unit directions in the vehicle frame, `groups_per_row * 8` a row.
    pub(super) directions: Vec<[f32; 3]>,
    /// Angle between neighbouring pixels in the middle of the image (rad).
    pub(super) pitch_rad: f64,
    /// Finest size of a pixel on the floor (m).
    pub(super) finest_m: f64,
}

impl RayTable {
    pub(super) fn new(camera: &Camera, metres_per_texel: f64, levels: usize, sharpness: Sharpness) -> Self {
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let groups_per_row = width.div_ceil(GROUP);
        let columns = groups_per_row * GROUP;
        let turn = camera.mounting.vehicle_from_camera();
        let mut rays = vec![Vec3::ZERO; columns * height];
        let cast = |rows: &mut [Vec3], first: usize| {
            for (i, ray) in rows.iter_mut().enumerate() {
                let pixel = Vec2::new((i % columns) as f64 + 0.5, (first + i / columns) as f64 + 0.5);
                *ray = turn * camera.lens.ray(pixel);
            }
        };
        let middle = height / 2;
        let (upper, lower) = rays.split_at_mut(columns * middle);
        // A ray costs as much as several texels do.
        both(8 * columns * height, || cast(upper, 0), || cast(lower, middle));
        let ray = |u: usize, v: usize| rays[v * columns + u];
        let floor_of = |ray: Vec3| {
            let reach = camera.mounting.z_m / (-ray.z).max(FLATTEST);
            Vec2::new(
                camera.mounting.x_m + reach * ray.x,
                camera.mounting.y_m + reach * ray.y,
            )
        };
        let texels_per_m = 1.0 / metres_per_texel;
        let mut floor = Groups::with_capacity(groups_per_row * height);
        let (mut backdrop, mut floor_part) = (Groups::default(), Vec::new());
        let mut finest = f64::INFINITY;
        let (mut runs, mut row_runs): (Vec<Run>, Vec<usize>) = (Vec::new(), vec![0]);
        for v in 0..height {
            let row_start = runs.len();
            // Differences to the row below, except in the last.
            let below = if v + 1 < height {
                v + 1
            } else {
                v.saturating_sub(1)
            };
            for g in 0..groups_per_row {
                let u = g * GROUP;
                let points: [Vec2; GROUP] = std::array::from_fn(|k| floor_of(ray(u + k, v)) * texels_per_m);
                let across = points[4] - points[3];
                let along = floor_of(ray(u + 3, below)) * texels_per_m - points[3];
                let detail = Footprint::of(across, along, levels, sharpness);
                finest = finest.min(detail.short);
                let scale = STEPS_PER_TEXEL / f64::from(1u32 << detail.level);
                floor.push(Group {
                    at: Positions {
                        x: SLOTS.map(|k| (points[k].x * scale) as f32),
                        y: SLOTS.map(|k| (points[k].y * scale) as f32),
                    },
                    detail: Detail {
                        spread: [(detail.major.x * scale) as f32, (detail.major.y * scale) as f32],
                        level: detail.level as u8,
                        looks_log2: detail.looks_log2 as u8,
                    },
                });
                let parts: [u8; GROUP] = std::array::from_fn(|k| {
                    let here = ray(u + k, v).z;
                    let step = (ray(u + k, below).z - here)
                        .abs()
                        .max((ray(if k > 0 { u + k - 1 } else { u + 1 }, v).z - here).abs());
                    ((0.5 - here / step.max(1e-9)).clamp(0.0, 1.0) * 128.0).round() as u8
                });
                let shows = if parts.iter().all(|part| *part == 128) {
                    Shows::Floor
                } else if parts.iter().all(|part| *part == 0) {
                    Shows::Backdrop
                } else {
                    Shows::Both
                };
                let entry = floor_part.len();
                if shows != Shows::Floor {
                    backdrop.push(backdrop_group(std::array::from_fn(|k| ray(u + k, v))));
                    floor_part.push(parts);
                }
                match runs[row_start..].last_mut() {
                    Some(run) if run.shows == shows => run.end = g + 1,
                    _ => runs.push(Run {
                        shows,
                        first: g,
                        end: g + 1,
                        backdrop: entry,
                    }),
                }
            }
            row_runs.push(runs.len());
        }
        let (u, v) = (columns / 2, height / 2);
        let neighbour = ray(u.saturating_sub(1), v);
        let pitch_rad = (ray(u, v) - neighbour).length().max(1e-6);
        let directions = rays
            .iter()
            .map(|ray| [ray.x as f32, ray.y as f32, ray.z as f32])
            .collect();
        Self {
            width,
            height,
            groups_per_row,
            floor,
            backdrop,
            floor_part,
            runs,
            row_runs,
            directions,
            pitch_rad,
            finest_m: (finest * metres_per_texel).max(1e-5),
        }
    }
}

impl RayTable {
    /// The groups that look at the floor.
    pub(super) fn floor_groups(&self) -> impl Iterator<Item = (&Positions, &Detail)> {
        let rows = self.row_runs.windows(2).map(|row| &self.runs[row[0]..row[1]]);
        rows.enumerate().flat_map(move |(v, runs)| {
            let seen = runs.iter().filter(|run| run.shows != Shows::Backdrop);
            seen.flat_map(move |run| {
                let row = v * self.groups_per_row;
                self.floor.run(row + run.first..row + run.end).iter()
            })
        })
    }
}

/// Level and looks for a pixel's footprint.
struct Footprint {
    level: u32,
    looks_log2: u32,
    /// The footprint's longer axis in texels of level 0.
    major: Vec2,
    /// Length of its shorter axis.
    short: f64,
}

impl Footprint {
    /// `across` and `along` are the steps (texels) to the neighbouring pixels.
    fn of(across: Vec2, along: Vec2, levels: usize, sharpness: Sharpness) -> Self {
        // Axes of the ellipse J·Jᵀ with J = [across along].
        let (a, b) = (
            across.x * across.x + along.x * along.x,
            across.y * across.y + along.y * along.y,
        );
        let c = across.x * across.y + along.x * along.y;
        let middle = 0.5 * (a + b);
        let reach = (0.25 * (a - b) * (a - b) + c * c).sqrt();
        let (long, short) = ((middle + reach).sqrt(), (middle - reach).max(0.0).sqrt());
        let half_angle = 0.5 * trig::atan2(2.0 * c, a - b);
        let (sin, cos) = trig::sincos(half_angle);
        let ratio = long / short.max(1e-9);
        let looks_log2 = match sharpness {
            Sharpness::Single => 0,
            // Below a texel there is nothing to average.
            Sharpness::Spread if long < 1.0 || ratio < 1.5 => 0,
            Sharpness::Spread if ratio < 3.0 => 1,
            Sharpness::Spread => 2,
        };
        let size = match sharpness {
            Sharpness::Single => (long * short).sqrt().max(long / 4.0),
            Sharpness::Spread => short.max(long / f64::from(1u32 << looks_log2)),
        };
        let most = (levels - 1).min(LEVELS - 1) as u32;
        let mut level = 0;
        // The level whose texels are nearest to the footprint: its logarithm, rounded.
        while level < most && size > f64::from(1u32 << level) * std::f64::consts::SQRT_2 {
            level += 1;
        }
        Self {
            level,
            looks_log2,
            major: Vec2::new(cos, sin) * long,
            short,
        }
    }
}

/// Azimuth and elevation of eight rays, in the backdrop's texels.
fn backdrop_group(rays: [Vec3; GROUP]) -> Group {
    let first = trig::atan2(rays[0].y, rays[0].x);
    let scale = Backdrop::TEXELS_PER_RAD * STEPS_PER_TEXEL;
    Group {
        at: Positions {
            // Continuous over the seam behind the vehicle.
            x: SLOTS.map(|k| {
                let ray = rays[k];
                let azimuth = first + angle::difference(trig::atan2(ray.y, ray.x), first);
                (azimuth * scale) as f32
            }),
            y: SLOTS.map(|k| (trig::asin(rays[k].z.clamp(-1.0, 1.0)) * scale) as f32),
        },
        detail: Detail {
            spread: [0.0; 2],
            level: 0,
            looks_log2: 0,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretched_footprint_takes_more_looks_and_a_finer_level() {
        let (across, along) = (Vec2::new(0.0, -2.0), Vec2::new(-8.0, 0.0));
        let single = Footprint::of(across, along, 10, Sharpness::Single);
        let spread = Footprint::of(across, along, 10, Sharpness::Spread);
        assert_eq!((single.level, single.looks_log2), (2, 0));
        assert_eq!((spread.level, spread.looks_log2), (1, 2));
        assert!((spread.major.x.abs() - 8.0).abs() < 1e-9 && spread.major.y.abs() < 1e-6);
    }

    #[test]
    fn a_magnified_texture_uses_one_look_at_the_finest_level() {
        let detail = Footprint::of(Vec2::new(0.0, 0.2), Vec2::new(0.9, 0.0), 10, Sharpness::Spread);
        assert_eq!((detail.level, detail.looks_log2), (0, 0));
    }
}
