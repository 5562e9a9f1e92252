//! Pictures of signs and lights with exact boxes, from the simulator.

use crate::LearnError;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use senda_core::{Body, Command, Encoded, Observation, Stamp, Truth, Vehicle, codec};
use senda_data::darknet::Label;
use senda_geom::{Camera, Pose2, Vec2, Vec3, trig};
use senda_sim::{SimOptions, Simulator, Start, fitting_texel_m, render::Scene};
use senda_world::{Colour, Face, LightProgram, Texture, Thing, ThingShape, VehicleSpec, World};
use std::f64::consts::PI;
use std::sync::Arc;

/// Document D's four classes in its order (D7), as the warehouse's detectors name them.
pub const CLASSES: [&str; 4] = ["green-light", "red-light", "sign-0", "sign-1"];

/// What is photographed.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenes {
    /// Ready vehicle or vehicle file.
    pub vehicle: String,
    /// Image size (px).
    pub image_px: [u32; 2],
    /// Seed of the first warehouse; every one takes the next.
    pub first_world: u64,
    /// Pictures.
    pub count: usize,
}

impl Default for Scenes {
    fn default() -> Self {
        Self {
            vehicle: "warehouse-cart".into(),
            image_px: [320, 240],
            first_world: 2_000_000,
            count: 2_000,
        }
    }
}

impl Scenes {
    /// The vehicle with the image size, its cameras exactly where they are meant to be: boxes are reckoned by that.
    ///
    /// # Errors
    /// When it is not found or has no camera.
    pub fn vehicle(&self) -> Result<VehicleSpec, LearnError> {
        let [width, height] = self.image_px;
        let mut spec = senda_run::scenario::find_vehicle(&self.vehicle)?.with_camera_size(width, height);
        for camera in &mut spec.cameras {
            camera.mounting_std_rad = 0.0;
        }
        if spec.cameras.is_empty() {
            return Err(LearnError::Option {
                key: "vehicle",
                expected: "one with a camera".into(),
                found: self.vehicle.clone(),
            });
        }
        Ok(spec)
    }
}

/// A picture and what is in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// `world-shot`, for file names.
    pub name: String,
    /// JPEG.
    pub picture: Encoded,
    /// Exact boxes; classes are those of [`CLASSES`].
    pub labels: Vec<Label>,
}

/// Pictures from one warehouse: painting its floor costs more than taking them.
const SHOTS: u64 = 10;
/// Frames until the exposure has settled.
const SETTLING: usize = 6;
/// Signs and lights that are put up besides the warehouse's own.
const SIGNS: usize = 5;
const LIGHTS: usize = 4;

/// Takes pictures in made-up warehouses in which signs and lights stand at random: floors, lights, distances from 0.25 to 1.1 m,
/// angles up to 55°, some while the vehicle turns. Pictures with something that nobody could label (half hidden, or almost
/// too small) are taken anew. Number and seed decide everything about a picture, so threads do not matter.
///
/// Every picture goes to `keep` as soon as its turn has come; fewer than asked for only after an interruption.
///
/// # Errors
/// Those of [`Scenes::vehicle`], and what `keep` says.
pub fn shots<E: From<LearnError>>(
    scenes: &Scenes,
    interrupted: &(dyn Fn() -> bool + Sync),
    keep: &mut dyn FnMut(Shot) -> Result<(), E>,
) -> Result<(), E> {
    let spec = scenes.vehicle()?;
    let mut left = scenes.count;
    let mut world = scenes.first_world;
    // Several at a time; a group's size is fixed so that the same pictures are taken on every machine.
    const GROUP: u64 = 4;
    while left > 0 && !interrupted() {
        let group: Vec<Vec<Shot>> = (world..world + GROUP)
            .into_par_iter()
            .map(|seed| of_world(&spec, seed))
            .collect::<Result<_, LearnError>>()?;
        world += GROUP;
        for shot in group.into_iter().flatten().take(left) {
            keep(shot)?;
            left -= 1;
        }
    }
    Ok(())
}

fn of_world(spec: &VehicleSpec, seed: u64) -> Result<Vec<Shot>, LearnError> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut world = World::random_warehouse(seed, rng.random_bool(0.5));
    let (low, high) = world.bounds();
    let mut targets = Vec::new();
    for number in 0..SIGNS + LIGHTS {
        let mut within = |low: f64, high: f64| rng.random_range(low + 0.5..high - 0.5);
        let at = Vec2::new(within(low.x, high.x), within(low.y, high.y));
        let pose = Pose2::new(at.x, at.y, rng.random_range(-PI..PI));
        targets.push(world.things.len());
        world.things.push(if number < SIGNS {
            // Mostly the two digits that count; the others shall be told from them.
            let digit = match rng.random_range(0..10) {
                0..=3 => 0,
                4..=7 => 1,
                _ => rng.random_range(2..10),
            };
            thing(pose, [0.1, 0.1], 0.05, Texture::sign(digit))
        } else {
            let program = LightProgram {
                green_s: 5.0,
                red_s: 5.0,
                offset_s: rng.random_range(0.0..10.0),
            };
            thing(pose, [0.05, 0.12], 0.06, Texture::light(program))
        });
    }
    // The warehouse's own are aimed at, too.
    targets.extend((0..world.things.len()).filter(|index| kind(&world.things[*index]).is_some()));
    let scene = Arc::new(Scene::new(&world, fitting_texel_m(spec)));
    let world = Arc::new(world);
    let mut shots = Vec::new();
    for number in 0..SHOTS {
        rng.set_stream(number + 1);
        for _ in 0..6 {
            let target = targets[rng.random_range(0..targets.len())];
            let pose = before(&world.things[target], &mut rng);
            if let Some((picture, labels)) = take(&world, &scene, spec, seed ^ number << 40, pose, &mut rng)?
            {
                shots.push(Shot {
                    name: format!("{seed}-{number}"),
                    picture,
                    labels,
                });
                break;
            }
        }
    }
    Ok(shots)
}

fn thing(pose: Pose2, [width_m, height_m]: [f64; 2], bottom_m: f64, texture: Texture) -> Thing {
    Thing {
        name: String::new(),
        shape: ThingShape::Board { width_m },
        pose,
        bottom_m,
        height_m,
        texture,
        back: Colour::new(150, 150, 150),
    }
}

/// Where a vehicle stands that sees a thing: anywhere before it, turned so that it lies somewhere in the picture.
fn before(thing: &Thing, rng: &mut ChaCha8Rng) -> Pose2 {
    let away_m = rng.random_range(0.25..1.1);
    let aside: f64 = rng.random_range(-0.95..0.95);
    let direction = thing.pose.heading_rad + aside;
    let (sin, cos) = trig::sincos(direction);
    let at = thing.pose.position() + Vec2::new(cos, sin) * away_m;
    let heading = direction + PI + rng.random_range(-0.42..0.42);
    Pose2::new(at.x, at.y, senda_geom::angle::wrap(heading))
}

/// One picture; `None` when something in it is neither clearly there nor clearly not.
fn take(
    world: &Arc<World>,
    scene: &Arc<Scene>,
    spec: &VehicleSpec,
    seed: u64,
    pose: Pose2,
    rng: &mut ChaCha8Rng,
) -> Result<Option<(Encoded, Vec<Label>)>, LearnError> {
    let place = world.path.project(pose.position());
    let along = world.path.pose_at(place.station_m);
    let options = SimOptions {
        seed,
        start: Start {
            station_m: Some(place.station_m),
            offset_m: along.inverse().transform(pose.position()).y,
            heading_rad: senda_geom::angle::wrap(pose.heading_rad - along.heading_rad),
            speed_mps: 0.0,
        },
        ..SimOptions::default()
    };
    let mut simulator = Simulator::in_scene(world.clone(), scene.clone(), spec, options)?;
    let body: Body = simulator.body().clone();
    let Some(camera) = body.cameras.first() else {
        return Ok(None);
    };
    let turning = rng.random_bool(0.4);
    let yaw_rate_radps = if turning { rng.random_range(-0.8..0.8) } else { 0.0 };
    let mut observation = Observation::default();
    let mut truths: Vec<Truth> = Vec::new();
    for _ in 0..SETTLING {
        if !simulator.observe(&mut observation)? {
            return Ok(None);
        }
        truths.extend(simulator.truth().copied());
        simulator.actuate(&Command::yaw_rate(0.0, yaw_rate_radps))?;
    }
    let Some(frame) = observation.first_frame() else {
        return Ok(None);
    };
    let Some(world_from_vehicle) = pose_at(&truths, frame.stamp) else {
        return Ok(None);
    };
    let Some(labels) = labels(world, camera, world_from_vehicle, frame.stamp.as_s()) else {
        return Ok(None);
    };
    let picture = match &frame.encoded {
        Some(encoded) => encoded.clone(),
        None => codec::encode_jpeg(&frame.image, 90).map_err(|error| LearnError::Option {
            key: "picture",
            expected: "one that can be encoded".into(),
            found: error.to_string(),
        })?,
    };
    Ok(Some((picture, labels)))
}

/// Where the vehicle was when a picture was exposed.
fn pose_at(truths: &[Truth], stamp: Stamp) -> Option<Pose2> {
    let after = truths.iter().position(|truth| truth.stamp >= stamp);
    let Some(after) = after.filter(|after| *after > 0) else {
        return truths.last().map(|truth| truth.world_from_vehicle);
    };
    let (a, b) = (&truths[after - 1], &truths[after]);
    let part = stamp.since_s(a.stamp) / b.stamp.since_s(a.stamp).max(1e-9);
    let (from, to) = (a.world_from_vehicle, b.world_from_vehicle);
    let at = from.position() + (to.position() - from.position()) * part;
    let turned = senda_geom::angle::wrap(to.heading_rad - from.heading_rad);
    Some(Pose2::new(
        at.x,
        at.y,
        senda_geom::angle::wrap(from.heading_rad + turned * part),
    ))
}

enum Kind {
    Light(LightProgram),
    Sign(u8),
}

fn kind(thing: &Thing) -> Option<Kind> {
    match &thing.texture {
        Texture::Light { program, .. } => Some(Kind::Light(*program)),
        Texture::Sign { number, .. } => Some(Kind::Sign(*number)),
        _ => None,
    }
}

/// A side of a thing is looked at along a grid of so many points each way.
const GRID: usize = 6;
/// From this part on a thing counts as seen, up to the other as hidden; between them nobody could say.
const SEEN: f64 = 0.6;
const HIDDEN: f64 = 0.12;
/// The same for heights as parts of the picture's: a sign of 10 cm at 1.5 m, and at 2.4 m.
const LARGE: f64 = 0.08;
const SMALL: f64 = 0.05;
/// The same for the cosine of the angle under which a face is seen: 66° and 82°.
const FACING: f64 = 0.4;
const ACROSS: f64 = 0.14;

/// The boxes of all signs and lights in a picture; `None` when one of them is doubtful.
fn labels(world: &World, camera: &Camera, world_from_vehicle: Pose2, time_s: f64) -> Option<Vec<Label>> {
    let faces: Vec<Vec<Face>> = world.things.iter().map(Thing::faces).collect();
    let vehicle_from_world = world_from_vehicle.inverse();
    let in_vehicle = |point: Vec3| {
        let flat = vehicle_from_world.transform(Vec2::new(point.x, point.y));
        Vec3::new(flat.x, flat.y, point.z)
    };
    let eye = camera.mounting.position();
    let eye = {
        let flat = world_from_vehicle.transform(Vec2::new(eye.x, eye.y));
        Vec3::new(flat.x, flat.y, eye.z)
    };
    let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
    let mut labels = Vec::new();
    for (index, thing) in world.things.iter().enumerate() {
        let (Some(kind), Some(face)) = (kind(thing), faces[index].first()) else {
            continue;
        };
        let middle = face.corner + face.right * (0.5 * face.width_m) + face.down * (0.5 * face.height_m);
        let cosine = face.normal.dot((eye - middle).normalize_or_zero());
        if cosine < ACROSS {
            continue;
        }
        let mut low = Vec2::splat(f64::INFINITY);
        let mut high = Vec2::splat(f64::NEG_INFINITY);
        let mut seen = 0usize;
        for i in 0..GRID * GRID {
            let part = |i: usize| i as f64 / (GRID - 1) as f64;
            let point = face.corner
                + face.right * (face.width_m * part(i % GRID))
                + face.down * (face.height_m * part(i / GRID));
            let Some(pixel) = camera.pixel_from_point(in_vehicle(point)) else {
                continue;
            };
            let inside = Vec2::new(pixel.x.clamp(0.0, width), pixel.y.clamp(0.0, height));
            low = low.min(inside);
            high = high.max(inside);
            let hidden = faces
                .iter()
                .enumerate()
                .any(|(other, faces)| other != index && faces.iter().any(|face| covers(face, eye, point)));
            seen += usize::from(inside == pixel && !hidden);
        }
        let visible = seen as f64 / (GRID * GRID) as f64;
        let tall = (high.y - low.y) / height;
        if visible <= HIDDEN || tall <= SMALL {
            continue;
        }
        if visible < SEEN || tall < LARGE || cosine < FACING {
            return None;
        }
        let class = match kind {
            Kind::Light(program) => usize::from(!program.is_green(time_s)),
            Kind::Sign(digit @ 0..=1) => 2 + usize::from(digit),
            Kind::Sign(_) => continue,
        };
        labels.push(Label {
            class,
            x: (0.5 * (low.x + high.x) / width) as f32,
            y: (0.5 * (low.y + high.y) / height) as f32,
            width: ((high.x - low.x) / width) as f32,
            height: ((high.y - low.y) / height) as f32,
        });
    }
    Some(labels)
}

/// Whether a face lies between the eye and a point.
fn covers(face: &Face, eye: Vec3, point: Vec3) -> bool {
    let along = point - eye;
    let slope = face.normal.dot(along);
    if slope.abs() < 1e-12 {
        return false;
    }
    let part = face.normal.dot(face.corner - eye) / slope;
    if !(1e-6..0.999).contains(&part) {
        return false;
    }
    let place = eye + along * part - face.corner;
    let (right, down) = (place.dot(face.right), place.dot(face.down));
    (0.0..=face.width_m).contains(&right) && (0.0..=face.height_m).contains(&down)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How far the lit lamp lies from the middle of its light's box (px across), by its colour.
    fn lamp_aside_px(shot: &Shot, label: &Label) -> Option<f64> {
        let image = shot.picture.decode().unwrap();
        let [width, height] = [image.width() as f64, image.height() as f64];
        let middle_px = f64::from(label.x) * width;
        let reach_px = f64::from(label.width) * width;
        let rows = (f64::from(label.y - 0.5 * label.height) * height) as usize
            ..(f64::from(label.y + 0.5 * label.height) * height) as usize;
        let columns = (middle_px - reach_px).max(0.0) as usize..(middle_px + reach_px).min(width) as usize;
        let (own, other) = if label.class == 0 { (1, 0) } else { (0, 1) };
        let tint = |u: usize, v: usize| {
            let pixel = &image.row(v)[3 * u..3 * u + 3];
            f64::from(pixel[own]) - f64::from(pixel[other])
        };
        let places = || rows.clone().flat_map(|v| columns.clone().map(move |u| (u, v)));
        let most = places().map(|(u, v)| tint(u, v)).fold(0.0, f64::max);
        let lit: Vec<f64> = places()
            .filter(|(u, v)| tint(*u, *v) > 0.7 * most)
            .map(|(u, _)| u as f64 + 0.5)
            .collect();
        (most > 60.0).then(|| lit.iter().sum::<f64>() / lit.len() as f64 - middle_px)
    }

    /// The camera's mounting error, 0.3° and unknown to the labels, moved boxes by up to the width of a light.
    #[test]
    fn boxes_lie_where_the_picture_shows_their_things() {
        let scenes = Scenes {
            count: 80,
            ..Scenes::default()
        };
        let mut aside_px = Vec::new();
        shots(&scenes, &|| false, &mut |shot| {
            // Of near ones the lamp's middle is not the box's, by perspective.
            let lights = shot
                .labels
                .iter()
                .filter(|label| label.class < 2 && label.width < 0.08);
            aside_px.extend(lights.filter_map(|label| lamp_aside_px(&shot, label)));
            Ok::<_, LearnError>(())
        })
        .unwrap();
        let median = |values: &mut [f64]| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let usual_px = median(&mut aside_px);
        let mut spread_px: Vec<f64> = aside_px.iter().map(|px| (px - usual_px).abs()).collect();
        assert!(spread_px.len() > 20 && usual_px.abs() < 1.0, "{aside_px:?}");
        assert!(median(&mut spread_px) < 0.75, "{spread_px:?}");
    }
}
