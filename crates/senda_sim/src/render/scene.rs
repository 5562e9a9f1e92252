//! What all cameras of a world share: the floor with its levels, the room, lamps and upright things.

use super::backdrop::{Backdrop, Room};
use super::ground::Ground;
use super::light::MirroredLamp;
use super::upright::{self, Upright};
use senda_geom::Vec2;
use senda_world::paint::Painter;
use senda_world::{FloorPainting, World};

/// A world made ready for cameras, which may share it. Its floor is painted where one of them looks first.
#[derive(Debug)]
pub struct Scene {
    ground: Ground,
    origin: Vec2,
    metres_per_texel: f64,
    glossy: bool,
    backdrop: Backdrop,
    lamps: Vec<MirroredLamp>,
    uprights: Vec<Upright>,
}

impl Scene {
    /// A world whose floor has texels of this size (m); larger where the world is too large for the painter's budget.
    pub fn new(world: &World, metres_per_texel: f64) -> Self {
        let painter = Painter::new(world, metres_per_texel);
        let place = (painter.origin(), painter.metres_per_texel());
        let glossy = painter.may_be_glossy();
        Self::on(world, Ground::new(painter), place, glossy)
    }

    /// From a painting of the world's floor.
    pub fn of_painting(world: &World, painting: &FloorPainting) -> Self {
        let glossy = painting.outside[3] > 0 || painting.texels.iter().any(|texel| texel[3] > 0);
        let place = (painting.origin, painting.metres_per_texel);
        Self::on(world, Ground::of_painting(painting), place, glossy)
    }

    fn on(world: &World, ground: Ground, (origin, metres_per_texel): (Vec2, f64), glossy: bool) -> Self {
        let light = &world.light;
        let colour = |rgb: [u8; 3]| rgb.map(|value| linear(f64::from(value) / 255.0));
        // The painting's brightest place is 1: lamps are measured by the same scale.
        let brightest = light.ambient + light.lamps.iter().map(|lamp| lamp.strength).fold(0.0, f64::max);
        let lamps = light
            .lamps
            .iter()
            .map(|lamp| {
                // A disc of radiance L and radius r lights a white floor at distance h like L·(r/h)².
                let spread = lamp.height_m / lamp.radius_m;
                let radiance = lamp.strength / brightest.max(1e-6) * spread * spread;
                MirroredLamp {
                    position: lamp.position(),
                    height_m: lamp.height_m,
                    radius_m: lamp.radius_m,
                    radiance: colour(lamp.colour.rgb).map(|value| value * radiance),
                }
            })
            .collect();
        let room = Room {
            wall: colour(world.backdrop.horizon.rgb),
            ceiling: colour(world.backdrop.zenith.rgb),
            window_rad: light.direction_rad,
            // Uneven light comes from windows; even light from above.
            window: if light.gradient >= 0.1 {
                1.0 + 8.0 * light.gradient
            } else {
                0.0
            },
            light: colour(light.colour.rgb),
            hills: world.backdrop.hills.map(|hills| colour(hills.rgb)),
        };
        let landscape = &world.landscape;
        Self {
            ground,
            origin,
            metres_per_texel,
            glossy,
            backdrop: Backdrop::new(room),
            lamps,
            uprights: world
                .things
                .iter()
                .flat_map(|thing| thing.faces())
                .map(|face| Upright::new(&face, upright::MOST_TEXELS, light))
                .chain(
                    landscape
                        .wall_faces(&world.path)
                        .iter()
                        .map(|face| Upright::new(face, upright::WALL_TEXELS, light)),
                )
                .chain(
                    landscape
                        .trees(&world.path)
                        .iter()
                        .map(|tree| Upright::of_tree(tree, light)),
                )
                .collect(),
        }
    }

    /// Side of a texel of the floor (m).
    pub fn metres_per_texel(&self) -> f64 {
        self.metres_per_texel
    }

    /// Whether any of the floor may reflect.
    pub fn is_glossy(&self) -> bool {
        self.glossy
    }

    pub(super) fn backdrop(&self) -> &Backdrop {
        &self.backdrop
    }

    pub(super) fn ground(&self) -> &Ground {
        &self.ground
    }

    pub(super) fn origin(&self) -> Vec2 {
        self.origin
    }

    pub(super) fn lamps(&self) -> &[MirroredLamp] {
        &self.lamps
    }

    pub(super) fn uprights(&self) -> &[Upright] {
        &self.uprights
    }
}

/// Light of an encoded value 0..=1. Pictures are kept as square roots of light, close to sRGB.
fn linear(encoded: f64) -> f64 {
    encoded * encoded
}
