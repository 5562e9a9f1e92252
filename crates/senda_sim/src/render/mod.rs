//! Camera pictures of a floor: one textured look-up a pixel, light, reflections, blur and noise, on the CPU.
//!
//! A [`Scene`] holds what all cameras of a world share; a [`Renderer`] holds what one camera needs and draws a
//! [`Shot`] into an image. Nothing is allocated between frames, and the bytes are the same on every machine. A frame that
//! looks at floor where no frame looked before has that painted first, into memory that the scene reserved.

mod backdrop;
mod blur;
mod ground;
mod kernel;
mod light;
mod noise;
mod rays;
mod scene;
mod texture;
mod tree;
mod upright;
mod view;

pub use backdrop::{Backdrop, Room};
pub use kernel::Kernel;
pub use light::MirroredLamp;
pub use rays::Sharpness;
pub use scene::Scene;
pub use texture::MipTexture;

use blur::LensBlur;
use ground::Painted;
use kernel::{Colours, GROUP, LEVELS, Look, Looks, MOST_LOOKS_LOG2, STEPS_PER_TEXEL, Shading, Texels};
use light::LightGrid;
use noise::NoiseTile;
use rays::{RayTable, Shows};
use senda_core::{Channels, Image};
use senda_geom::{Camera, Pose2, trig};
use view::{Outline, Stand};

/// What a camera's optics do to the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Optics {
    /// Share of the light that is lost in the image's corners, 0..=1.
    pub vignetting: f64,
    /// Standard deviation of the lens's blur (px of this image).
    pub blur_px: f64,
    /// How texture detail is matched to pixels.
    pub sharpness: Sharpness,
}

impl Default for Optics {
    fn default() -> Self {
        Self {
            vignetting: 0.0,
            blur_px: 0.0,
            sharpness: Sharpness::default(),
        }
    }
}

/// One exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Pose of the vehicle in the middle of the exposure.
    pub world_from_vehicle: Pose2,
    /// When (s): what changes with time, such as a pedestrian light, shows how it is then.
    pub time_s: f64,
    /// Factor on light for R, G, B: 1 shows the painting's colours as they are.
    pub gain: [f64; 3],
    /// Motion during the exposure.
    pub motion: Motion,
    /// Noise of the sensor.
    pub noise: Noise,
}

impl Shot {
    /// From a pose at time 0, with gain 1, no motion and no noise.
    pub fn still(world_from_vehicle: Pose2) -> Self {
        Self {
            world_from_vehicle,
            time_s: 0.0,
            gain: [1.0; 3],
            motion: Motion::default(),
            noise: Noise::default(),
        }
    }
}

/// Motion of the vehicle while the shutter is open.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Forward speed (m/s).
    pub speed_mps: f64,
    /// Yaw rate (rad/s).
    pub yaw_rate_radps: f64,
    /// Time that the shutter is open (s).
    pub exposure_s: f64,
}

/// Noise of one frame, as standard deviations in steps of the 8-bit range.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Noise {
    /// Of black.
    pub dark: f64,
    /// Of white.
    pub bright: f64,
    /// Seed of this frame.
    pub seed: u64,
}

/// Draws the pictures of one camera.
#[derive(Debug, Clone)]
pub struct Renderer {
    camera: Camera,
    kernel: Kernel,
    table: RayTable,
    light: LightGrid,
    noise: NoiseTile,
    blur: LensBlur,
    metres_per_texel: f64,
    colours: Vec<Colours>,
    behind: Vec<Colours>,
    faces: Vec<upright::Ready>,
    /// What it sees of the floor.
    outlines: Vec<Outline>,
    spans: Vec<[f64; 2]>,
    /// What is known to be painted.
    painted: Option<Painted>,
}

impl Renderer {
    /// Prepares a camera for a scene: tables of what every pixel sees (about 0.2 µs a pixel and lens iteration).
    ///
    /// # Panics
    /// When the camera has no pixels or does not stand above the floor.
    pub fn new(camera: &Camera, scene: &Scene, optics: &Optics) -> Self {
        assert!(
            camera.width_px > 0 && camera.height_px > 0 && camera.mounting.z_m > 0.0,
            "a camera needs pixels and height"
        );
        let metres_per_texel = scene.metres_per_texel();
        let table = RayTable::new(
            camera,
            metres_per_texel,
            scene.ground().levels(),
            optics.sharpness,
        );
        let groups = table.groups_per_row;
        let light = LightGrid::new(camera, optics.vignetting, table.pitch_rad);
        Self {
            camera: camera.clone(),
            kernel: Kernel::fastest(),
            noise: NoiseTile::new(groups * GROUP),
            colours: vec![[0; 4 * GROUP]; groups],
            behind: vec![[0; 4 * GROUP]; groups],
            faces: Vec::with_capacity(scene.uprights().len()),
            outlines: Outline::of_groups(table.floor_groups()),
            spans: Vec::new(),
            painted: None,
            table,
            light,
            blur: LensBlur::new(optics.blur_px, groups),
            metres_per_texel,
        }
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The same renderer with another implementation of the pixel loops (the bytes stay the same).
    pub fn with_kernel(mut self, kernel: Kernel) -> Self {
        self.kernel = kernel;
        self
    }

    /// Draws one frame, R, G, B, into `image`, whose memory is reused.
    ///
    /// # Panics
    /// When the scene's texels have another size than those of the scene it was made for.
    pub fn render(&mut self, scene: &Scene, shot: &Shot, image: &mut Image) {
        assert_eq!(
            scene.metres_per_texel(),
            self.metres_per_texel,
            "a renderer is made for one size of texels"
        );
        image.reshape(self.table.width, self.table.height, Channels::Rgb);
        self.light.expose(
            self.kernel,
            shot.gain,
            shot.world_from_vehicle,
            scene.lamps(),
            scene.is_glossy().then(|| scene.backdrop().mirror()),
        );
        upright::prepare(scene.uprights(), &self.camera, shot, &self.table, &mut self.faces);
        let looks_log2 = self.looks_for(&shot.motion);
        let ground = scene.ground().seen(
            &self.outlines,
            &stand(scene, shot),
            &mut self.painted,
            &mut self.spans,
        );
        let (floor, backdrop) = (floor_looks(scene, shot), backdrop_looks(shot));
        let mut sampler = Sampler {
            kernel: self.kernel,
            table: &self.table,
            scene,
            ground: ground.texture().texels(),
            floor: &floor,
            backdrop: &backdrop,
            looks_log2,
            behind: &mut self.behind,
            faces: &self.faces,
        };
        let (kernel, light, tile) = (self.kernel, &self.light, &self.noise);
        let noise = NoiseSteps::new(&shot.noise);
        let mut rows = (0..).zip(image.pixels_mut().chunks_exact_mut(3 * self.table.width));
        let mut shade = |colours: &[Colours]| {
            let Some((v, out)) = rows.next() else { return };
            let (above, below, part) = light.around(v);
            let shading = Shading {
                above,
                below,
                part,
                glows: light.glows,
                noise: tile.row(shot.noise.seed, v),
                noise_dark: noise.dark,
                noise_fall: noise.fall,
            };
            kernel.shade(colours, &shading, out);
        };
        for v in 0..self.table.height {
            sampler.row(v, &mut self.colours);
            self.blur.push(kernel, &self.colours, &mut shade);
        }
        self.blur.flush(kernel, &mut shade);
    }

    /// Logarithm (base 2) of the looks that motion during the exposure needs: about one a pixel of smear, 8 at most.
    fn looks_for(&self, motion: &Motion) -> u32 {
        let smear_px = motion.exposure_s
            * (motion.speed_mps.abs() / self.table.finest_m
                + motion.yaw_rate_radps.abs() / self.table.pitch_rad);
        match smear_px {
            px if px < 0.75 => 0,
            px if px < 2.0 => 1,
            px if px < 6.0 => 2,
            _ => MOST_LOOKS_LOG2,
        }
    }
}

/// Noise as the pixel loops take it.
struct NoiseSteps {
    dark: i16,
    fall: i16,
}

impl NoiseSteps {
    fn new(noise: &Noise) -> Self {
        // 64 a grey level, at most 30 of them: far beyond any camera, and within 16 bits.
        let steps = |level: f64| (level.clamp(0.0, 30.0) * 64.0).round();
        let fall = (steps(noise.dark) - steps(noise.bright)) * 32_768.0 / 4080.0;
        Self {
            dark: steps(noise.dark) as i16,
            fall: fall.round() as i16,
        }
    }
}

/// Looks up colours for one frame.
struct Sampler<'a> {
    kernel: Kernel,
    table: &'a RayTable,
    scene: &'a Scene,
    ground: Texels<'a>,
    floor: &'a Looks,
    backdrop: &'a Looks,
    looks_log2: u32,
    /// Room for what is behind the floor's edge.
    behind: &'a mut [Colours],
    faces: &'a [upright::Ready],
}

impl Sampler<'_> {
    /// The colours of row `v`.
    fn row(&mut self, v: usize, row: &mut [Colours]) {
        let table = self.table;
        let floor = v * table.groups_per_row;
        for run in &table.runs[table.row_runs[v]..table.row_runs[v + 1]] {
            let groups = run.first..run.end;
            let entries = run.backdrop..run.backdrop + groups.len();
            let row = &mut row[groups.clone()];
            if run.shows != Shows::Backdrop {
                let floor = table.floor.run(floor + run.first..floor + run.end);
                self.kernel
                    .sample(self.ground, self.floor, self.looks_log2, floor, row);
            }
            if run.shows == Shows::Floor {
                continue;
            }
            let room = self.scene.backdrop().panorama().texels();
            let rays = table.backdrop.run(entries.clone());
            if run.shows == Shows::Backdrop {
                self.kernel
                    .sample(room, self.backdrop, self.looks_log2, rays, row);
                continue;
            }
            let behind = &mut self.behind[groups];
            self.kernel
                .sample(room, self.backdrop, self.looks_log2, rays, behind);
            let parts = &table.floor_part[entries];
            for ((front, behind), parts) in row.iter_mut().zip(behind).zip(parts) {
                for i in 0..4 * GROUP {
                    let (a, b) = (i32::from(front[i]), i32::from(behind[i]));
                    front[i] = (b + (((a - b) * i32::from(parts[i / 4])) >> 7)) as i16;
                }
            }
        }
        upright::draw_row(self.scene.uprights(), self.faces, table, v, row);
    }
}

/// Instants of the exposure: part of it from -0.5 to 0.5, for looks of 2^`log2`.
fn instants(log2: u32) -> impl Iterator<Item = (usize, f64, f64)> {
    let count = 1usize << log2;
    (0..count).map(move |i| {
        let part = |i: usize| (i as f64 + 0.5) / count as f64 - 0.5;
        // Footprint and exposure are crossed in different orders, so that together they cover both.
        (count - 1 + i, part(i), part((i * 5 + 3) % count))
    })
}

/// Where the vehicle is during an exposure.
fn stand(scene: &Scene, shot: &Shot) -> Stand {
    let pose = shot.world_from_vehicle;
    let (sin, cos) = trig::sincos(pose.heading_rad);
    let half_s = 0.5 * shot.motion.exposure_s.abs();
    Stand {
        at: (pose.position() - scene.origin()) / scene.metres_per_texel(),
        cos,
        sin,
        astray: half_s * shot.motion.speed_mps.abs() / scene.metres_per_texel(),
        turned: half_s * shot.motion.yaw_rate_radps.abs(),
    }
}

fn floor_looks(scene: &Scene, shot: &Shot) -> Looks {
    let mut looks: Looks = Default::default();
    let motion = &shot.motion;
    if motion.exposure_s > 0.0 {
        for log2 in 0..=MOST_LOOKS_LOG2 {
            for (index, time, part) in instants(log2) {
                let elapsed_s = time * motion.exposure_s;
                let pose =
                    shot.world_from_vehicle
                        .advance(motion.speed_mps, motion.yaw_rate_radps, elapsed_s);
                looks[index] = floor_look(scene, pose, part);
            }
        }
    } else {
        let still = floor_look(scene, shot.world_from_vehicle, 0.0);
        for log2 in 0..=MOST_LOOKS_LOG2 {
            for (index, _, part) in instants(log2) {
                looks[index] = Look {
                    part: part as f32,
                    ..still
                };
            }
        }
    }
    looks
}

fn floor_look(scene: &Scene, pose: Pose2, part: f64) -> Look {
    let (sin, cos) = trig::sincos(pose.heading_rad);
    let at = (pose.position() - scene.origin()) * (1.0 / scene.metres_per_texel()) * STEPS_PER_TEXEL;
    let mut look = Look {
        cos: cos as f32,
        sin: sin as f32,
        part: part as f32,
        origin: [[0.0; 2]; LEVELS],
    };
    for (level, origin) in look.origin.iter_mut().enumerate() {
        let shrink = 1.0 / f64::from(1u32 << level);
        *origin = [
            (at.x * shrink + MipTexture::ORIGIN) as f32,
            (at.y * shrink + MipTexture::ORIGIN) as f32,
        ];
    }
    look
}

fn backdrop_looks(shot: &Shot) -> Looks {
    let mut looks: Looks = Default::default();
    for log2 in 0..=MOST_LOOKS_LOG2 {
        for (index, time, _) in instants(log2) {
            let turned_rad = time * shot.motion.exposure_s * shot.motion.yaw_rate_radps;
            looks[index] = Look {
                cos: 1.0,
                sin: 0.0,
                part: 0.0,
                origin: [Backdrop::origin(shot.world_from_vehicle.heading_rad, turned_rad); LEVELS],
            };
        }
    }
    looks
}
