//! Light as the camera gets it: vignetting and exposure as gains, reflections on glossy floor as added light, on a
//! grid of one node every eight pixels.

use super::backdrop::Mirror;
use super::kernel::{GAIN_ONE, GLOW_ONE, GROUP, Kernel, LightNode, Surface, middle};
use senda_geom::{Camera, Pose2, Vec2, trig};

/// Reflectance of a polished dielectric seen from straight above (refractive index 1.5).
const HEAD_ON: f64 = 0.04;

/// Spread of mirror images by the roughness of polish (rad). A guess: linoleum shows soft-edged lamps.
const ROUGHNESS_RAD: f64 = 0.03;

/// A lamp above the floor, as floors mirror it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MirroredLamp {
    /// Place on the floor plane (m).
    pub position: Vec2,
    /// Height above the floor (m).
    pub height_m: f64,
    /// Radius of the luminous disc (m).
    pub radius_m: f64,
    /// Radiance relative to a white floor in full light, R, G, B.
    pub radiance: [f64; 3],
}

/// The grid of a camera with everything that does not change from frame to frame.
#[derive(Debug, Clone)]
pub(super) struct LightGrid {
    columns: usize,
    nodes: Vec<Node>,
    surfaces: Vec<Surface>,
    /// Light that arrives from the mirrored direction, R, G, B, 0.
    mirrored: Vec<[f32; 4]>,
    /// Squared spread of mirror images, at least as wide as the grid can show.
    spread_squared: f32,
    /// Gains and reflected light of the present frame, row by row.
    lights: Vec<LightNode>,
    /// Whether there is reflected light.
    pub(super) glows: bool,
    /// The gain of `lights`, where nothing is reflected: they stay as they are while it does.
    matt_gain: Option<[f64; 3]>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    /// Floor point (vehicle frame, m).
    floor: [f32; 2],
    /// Unit direction of the mirrored ray; upwards.
    mirrored: [f32; 3],
    /// Azimuth in cells of the mirror, and its row there.
    column: f32,
    row: (usize, f32),
}

impl LightGrid {
    pub(super) fn new(camera: &Camera, vignetting: f64, pitch_rad: f64) -> Self {
        let columns = (camera.width_px as usize).div_ceil(GROUP) + 1;
        let rows = (camera.height_px as usize).div_ceil(GROUP) + 1;
        let turn = camera.mounting.vehicle_from_camera();
        let centre = Vec2::new(f64::from(camera.width_px), f64::from(camera.height_px)) * 0.5;
        let mut nodes = Vec::with_capacity(columns * rows);
        let mut surfaces = Vec::with_capacity(columns * rows);
        for j in 0..rows {
            for i in 0..columns {
                let pixel = Vec2::new((i * GROUP) as f64, (j * GROUP) as f64);
                let ray = turn * camera.lens.ray(pixel);
                // Above the horizon there is no floor; the last value below it keeps the cells in between right.
                let fall = (-ray.z).max(0.02);
                let reach = camera.mounting.z_m / fall;
                let flat = (1.0 - fall).clamp(0.0, 1.0);
                let azimuth = trig::atan2(ray.y, ray.x);
                let from_centre = (pixel - centre).length() / centre.length();
                // Falls with the fourth power of the cosine in thin lenses; a square in the radius is its first term.
                let vignette = (1.0 - vignetting * from_centre * from_centre).max(0.0);
                nodes.push(Node {
                    floor: [
                        (camera.mounting.x_m + reach * ray.x) as f32,
                        (camera.mounting.y_m + reach * ray.y) as f32,
                    ],
                    mirrored: [ray.x as f32, ray.y as f32, fall as f32],
                    column: Mirror::column(azimuth),
                    row: Mirror::row(trig::asin(fall.min(1.0))),
                });
                surfaces.push(Surface {
                    fresnel: (HEAD_ON + (1.0 - HEAD_ON) * flat * flat * flat * flat * flat) as f32,
                    vignette: vignette.sqrt() as f32,
                });
            }
        }
        let spread = ROUGHNESS_RAD.max(0.7 * GROUP as f64 * pitch_rad);
        Self {
            columns,
            lights: vec![[0; 8]; nodes.len()],
            mirrored: vec![[0.0; 4]; nodes.len()],
            glows: false,
            matt_gain: None,
            nodes,
            surfaces,
            spread_squared: (spread * spread) as f32,
        }
    }

    /// The nodes above and below row `v` of the image, and how far (Q15) it lies between them.
    pub(super) fn around(&self, v: usize) -> (&[LightNode], &[LightNode], i16) {
        let from = v / GROUP * self.columns;
        let (above, below) = self.lights[from..from + 2 * self.columns].split_at(self.columns);
        (above, below, middle(v % GROUP))
    }

    /// Exposes: `gain` is the factor on light for R, G, B. Without a mirror nothing is reflected.
    pub(super) fn expose(
        &mut self,
        kernel: Kernel,
        gain: [f64; 3],
        world_from_vehicle: Pose2,
        lamps: &[MirroredLamp],
        mirror: Option<&Mirror>,
    ) {
        let matt_gain = mirror.is_none().then_some(gain);
        if matt_gain.is_some() && matt_gain == self.matt_gain {
            return;
        }
        self.matt_gain = matt_gain;
        let encoded = gain.map(|value| value.max(0.0).sqrt());
        let gain = four(encoded.map(|value| (value * GAIN_ONE) as f32));
        let glow = four(encoded.map(|value| (value * 255.0 * GLOW_ONE) as f32));
        self.glows = mirror.is_some();
        if let Some(mirror) = mirror {
            let turned = Mirror::column(world_from_vehicle.heading_rad);
            for (out, node) in self.mirrored.iter_mut().zip(&self.nodes) {
                *out = mirror.light(node.column + turned, node.row);
            }
            let vehicle_from_world = world_from_vehicle.inverse();
            for lamp in &lamps[..lamps.len().min(MOST_LAMPS)] {
                let at = vehicle_from_world.transform(lamp.position);
                let lamp = Lamp {
                    at: [at.x as f32, at.y as f32, lamp.height_m as f32],
                    radius_squared: (lamp.radius_m * lamp.radius_m) as f32,
                    radiance: four(lamp.radiance.map(|value| value as f32)),
                };
                for (light, node) in self.mirrored.iter_mut().zip(&self.nodes) {
                    let shine = lamp.shine(node, self.spread_squared);
                    for c in 0..4 {
                        light[c] += lamp.radiance[c] * shine;
                    }
                }
            }
        } else {
            self.mirrored.fill([0.0; 4]);
        }
        kernel.expose(&self.surfaces, &self.mirrored, gain, glow, &mut self.lights);
    }
}

/// More lamps than this do not shine in the floor.
const MOST_LAMPS: usize = 8;

/// Three channels and 0: all four are worked on at once.
fn four([r, g, b]: [f32; 3]) -> [f32; 4] {
    [r, g, b, 0.0]
}

#[derive(Debug, Clone, Copy, Default)]
struct Lamp {
    at: [f32; 3],
    radius_squared: f32,
    radiance: [f32; 4],
}

impl Lamp {
    /// Part of the lamp's radiance that a node's mirrored ray meets: a soft disc around the mirror image.
    fn shine(&self, node: &Node, spread_squared: f32) -> f32 {
        let to = [self.at[0] - node.floor[0], self.at[1] - node.floor[1], self.at[2]];
        let [x, y, z] = node.mirrored;
        let along = to[0] * x + to[1] * y + to[2] * z;
        if along <= 0.0 {
            return 0.0;
        }
        let along_squared = along * along;
        let aside = to[0] * to[0] + to[1] * to[1] + to[2] * to[2] - along_squared;
        let wide = self.radius_squared + spread_squared * along_squared;
        let ratio = aside / wide;
        self.radius_squared / (wide * (1.0 + ratio * ratio))
    }
}
