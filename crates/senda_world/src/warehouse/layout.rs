//! Made-up warehouses: a ring whose one side has junctions, and a street with a depot behind each of them.
//!
//! ```text
//!        ┌──── last depot ────┐
//!        │                    │
//!   area ├───── depot ────────┤      driven clockwise (mirrored: counter-clockwise)
//!        │                    │
//!   area ├───── depot ────────┤
//!        │                    │
//!        └────── start ───────┘
//! ```

use super::{Place, PlaceKind, Street, Warehouse};
use crate::colour::Colour;
use crate::floor::Floor;
use crate::landscape::Landscape;
use crate::light::{Light, LightChange};
use crate::marking::Marking;
use crate::path::{PathShape, PathSpec, Piece};
use crate::pictures::LightProgram;
use crate::random::Dice;
use crate::texture::Texture;
use crate::thing::{Thing, ThingShape};
use crate::world::{Backdrop, World};
use senda_geom::{Curve, Pose2};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// Document D: streets 20 cm wide, inner radius 20 cm, so their middle turns with 30 cm.
const STREET_M: f64 = 0.2;
const RADIUS_M: f64 = 0.3;
/// Between a junction's two ends lie both its corners.
const JUNCTION_M: f64 = 2.0 * RADIUS_M;
/// Crossings are as deep as this (guess), and area crossings end this far before the junction (guess).
const CROSSING_M: f64 = 0.08;
const BEFORE_JUNCTION_M: f64 = 0.02;
/// From the vehicle's origin to the crossing where it stops (m): the floor that its camera still sees.
const STOP_M: f64 = 0.26;
const LINE_M: f64 = 0.02;
const LINE_GREEN: Colour = Colour::new(20, 150, 70);
const QUARTER_M: f64 = RADIUS_M * FRAC_PI_2;

/// Measures of a warehouse. The default is document D's test track: 220 x 320 cm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WarehouseLayout {
    /// Numbers (0 ..= 9) of the depots in the order in which they come; the last one has no sign. 2 to 8 of them.
    pub depots: Vec<u8>,
    /// Driven counter-clockwise, turns to the left.
    pub mirrored: bool,
    /// Straight pieces before, between and behind the junctions (m), 0.4 in document D.
    pub straight_m: f64,
    /// Straight part of the streets across and of the sides of the start and the last depot (m); 1.4 gives the document's
    /// 220 cm. At least 1.2.
    pub across_m: f64,
    /// Areas (0 is the first) that have a light, with its program.
    pub lights: Vec<(usize, LightProgramSpec)>,
    /// Place of each area's sign, ahead of the vehicle that stands at the crossing and to the side of the turn (m); the last
    /// one counts for all further areas. Lights stand on the other side.
    pub signs_m: Vec<[f64; 2]>,
    /// Place of the lights, as `signs_m` but to the side away from the turn.
    pub light_m: [f64; 2],
    /// What the package's code says.
    pub package: String,
}

/// [`LightProgram`] as plain data.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightProgramSpec {
    /// How long it is green (s).
    pub green_s: f64,
    /// How long it is red (s).
    pub red_s: f64,
    /// Where in its cycle it begins (s).
    pub offset_s: f64,
}

impl Default for WarehouseLayout {
    fn default() -> Self {
        let program = LightProgramSpec {
            green_s: 6.0,
            red_s: 7.0,
            offset_s: 0.0,
        };
        Self {
            depots: vec![0, 1, 2],
            mirrored: false,
            straight_m: 0.4,
            across_m: 1.4,
            lights: vec![(0, program)],
            signs_m: vec![[0.34, 0.23]],
            light_m: [0.50, 0.20],
            package: "I0".to_owned(),
        }
    }
}

impl WarehouseLayout {
    /// A layout from a seed: mirrored or not, longer or not, lights and signs moved. `any` also draws three to six depots
    /// in any order; otherwise there are three, 0 and 1 behind the junctions in either order, as document D's signs allow.
    pub fn random(seed: u64, any: bool) -> Self {
        let mut dice = Dice::new(seed);
        Self::draw(&mut dice, any)
    }

    fn draw(dice: &mut Dice, any: bool) -> Self {
        let mut depots: Vec<u8> = if any {
            (0..3 + dice.below(4) as u8).collect()
        } else {
            vec![0, 1]
        };
        for last in (1..depots.len()).rev() {
            depots.swap(last, dice.below(last + 1));
        }
        if !any {
            depots.push(2);
        }
        let areas = depots.len() - 1;
        let mut lights = Vec::new();
        for area in 0..areas {
            // The first area has one in document D; further ones may.
            if area == 0 || (any && dice.chance(0.3)) {
                let green_s = dice.between([4.0, 9.0]);
                let red_s = dice.between([3.0, 9.0]);
                let offset_s = dice.between([0.0, green_s + red_s]);
                lights.push((
                    area,
                    LightProgramSpec {
                        green_s,
                        red_s,
                        offset_s,
                    },
                ));
            }
        }
        let mirrored = dice.chance(0.5);
        let straight_m = if dice.chance(0.5) {
            0.4
        } else {
            dice.between([0.4, 0.8])
        };
        let across_m = if dice.chance(0.5) {
            1.4
        } else {
            dice.between([1.2, 2.0])
        };
        let signs_m = (0..areas)
            .map(|_| [dice.between([0.30, 0.44]), dice.between([0.19, 0.26])])
            .collect();
        let light_m = [dice.between([0.42, 0.60]), dice.between([0.18, 0.26])];
        let number = dice.below(depots.len());
        Self {
            package: format!("I{}", depots[number]),
            depots,
            mirrored,
            straight_m,
            across_m,
            lights,
            signs_m,
            light_m,
        }
    }

    fn signs(&self, area: usize) -> [f64; 2] {
        let last = self.signs_m.last().copied().unwrap_or([0.34, 0.23]);
        self.signs_m.get(area).copied().unwrap_or(last)
    }
}

impl World {
    /// A warehouse of a layout: streets, crossings, boards, signs and lights on a plain floor in even light.
    pub fn warehouse(name: &str, layout: &WarehouseLayout) -> Self {
        let build = Build::new(layout);
        let path_spec = build.ring();
        let path = path_spec.curve().expect("pieces with lengths make a curve");
        let streets: Vec<Street> = (0..build.junctions).map(|i| build.street(&path, i)).collect();
        let mut places = vec![Place {
            kind: PlaceKind::Start,
            street: None,
            crossing_m: build.across_m / 2.0,
            crossing_depth_m: CROSSING_M,
        }];
        for (area, &depot) in layout.depots[..build.junctions].iter().enumerate() {
            let light = layout.lights.iter().any(|(at, _)| *at == area);
            places.push(Place {
                kind: PlaceKind::Area {
                    depot,
                    light: light.then(|| format!("light {}", area + 1)),
                },
                street: None,
                crossing_m: build.junction_m(area) - BEFORE_JUNCTION_M - CROSSING_M / 2.0,
                crossing_depth_m: CROSSING_M,
            });
            places.push(Place {
                kind: PlaceKind::Depot { number: depot },
                street: Some(area),
                crossing_m: QUARTER_M + build.across_m / 2.0,
                crossing_depth_m: CROSSING_M,
            });
        }
        places.push(Place {
            kind: PlaceKind::Depot {
                number: layout.depots[build.junctions],
            },
            street: None,
            crossing_m: build.across_m * 1.5 + 2.0 * QUARTER_M + build.side_m(),
            crossing_depth_m: CROSSING_M,
        });
        let warehouse = Warehouse {
            street_width_m: STREET_M,
            street_colour: Colour::new(74, 76, 80),
            streets,
            places,
        };
        let things = build.things(layout, &path, &warehouse);
        Self {
            name: name.to_owned(),
            description: format!(
                "Warehouse of document D with {} depots{}",
                layout.depots.len(),
                if layout.mirrored { ", mirrored" } else { "" }
            ),
            start_station_m: build.across_m / 2.0 - CROSSING_M / 2.0 - STOP_M,
            markings: build.ring_lines(&path),
            path,
            path_spec,
            lane_width_m: None,
            corridor_half_width_m: STREET_M / 2.0,
            floor: Floor::of_kind(crate::floor::FloorKind::Plain),
            light: Light::default(),
            things,
            backdrop: Backdrop::default(),
            margin_m: 0.5,
            texel_m: 0.0,
            landscape: Landscape::default(),
            warehouse: Some(warehouse),
        }
    }

    /// A made-up warehouse: [`WarehouseLayout::random`] with floor, light and its change along the ring drawn as well.
    pub fn random_warehouse(seed: u64, any: bool) -> Self {
        let mut dice = Dice::new(seed);
        let layout = WarehouseLayout::draw(&mut dice, any);
        let mut world = Self::warehouse(&format!("warehouse-{seed}"), &layout);
        // Floors and lights of a hall: carpets and coloured spots are not among them.
        const FLOORS: [&str; 6] = ["plain", "dark", "speckled", "wood", "tiles", "glossy"];
        const LIGHTS: [&str; 6] = ["even", "daylight", "lamp", "dim", "bright", "shadows"];
        world.floor = Floor::preset(FLOORS[dice.below(FLOORS.len())]).unwrap_or(world.floor);
        let (low, high) = world.bounds();
        world.light = Light::preset(LIGHTS[dice.below(LIGHTS.len())], low, high).unwrap_or(world.light);
        if dice.chance(0.5) {
            let shift = dice.part();
            let mut changes: Vec<LightChange> = (0..3)
                .map(|i| LightChange {
                    lap_part: (f64::from(i) / 3.0 + shift).rem_euclid(1.0),
                    level: dice.between([0.55, 1.25]),
                })
                .collect();
            changes.sort_by(|a, b| a.lap_part.total_cmp(&b.lap_part));
            world.light.along_lap = changes;
        }
        world
    }
}

/// A layout while it is built. Unmirrored: the start's side along x, the areas' side along y.
struct Build {
    junctions: usize,
    straight_m: f64,
    across_m: f64,
    /// 1 turns right, -1 left (mirrored).
    turn: f64,
}

impl Build {
    fn new(layout: &WarehouseLayout) -> Self {
        Self {
            junctions: layout.depots.len().saturating_sub(1),
            straight_m: layout.straight_m,
            across_m: layout.across_m,
            turn: if layout.mirrored { -1.0 } else { 1.0 },
        }
    }

    /// The straight part of the side with the areas.
    fn side_m(&self) -> f64 {
        self.straight_m + self.junctions as f64 * (JUNCTION_M + self.straight_m)
    }

    /// From the side's beginning to a junction.
    fn along_m(&self, junction: usize) -> f64 {
        self.straight_m + junction as f64 * (JUNCTION_M + self.straight_m)
    }

    /// Station of a junction on the ring.
    fn junction_m(&self, junction: usize) -> f64 {
        self.across_m + QUARTER_M + self.along_m(junction)
    }

    fn corner(&self) -> Piece {
        Piece::Arc {
            radius_m: RADIUS_M,
            turn_rad: -self.turn * FRAC_PI_2,
        }
    }

    fn ring(&self) -> PathSpec {
        let straight = |length_m: f64| Piece::Straight { length_m };
        let (across, side) = (straight(self.across_m), straight(self.side_m()));
        let corner = self.corner();
        PathSpec {
            shape: PathShape::Pieces {
                start: Pose2::new(RADIUS_M + self.across_m, 0.0, PI),
                pieces: vec![across, corner, side, corner, across, corner, side, corner],
            },
            closed: true,
            reversed: false,
        }
    }

    fn street(&self, ring: &Curve, junction: usize) -> Street {
        let across = Piece::Straight {
            length_m: self.across_m,
        };
        let path_spec = PathSpec {
            shape: PathShape::Pieces {
                start: ring.pose_at(self.junction_m(junction)),
                pieces: vec![self.corner(), across, self.corner()],
            },
            closed: false,
            reversed: false,
        };
        Street {
            name: format!("street {}", junction + 1),
            path: path_spec.curve().expect("pieces with lengths make a curve"),
            path_spec,
            markings: vec![Marking::solid(0.0, LINE_M, LINE_GREEN)],
        }
    }

    /// The ring's line, with gaps where junctions are.
    fn ring_lines(&self, ring: &Curve) -> Vec<Marking> {
        let back_m = self.across_m * 2.0 + QUARTER_M * 3.0 + self.side_m();
        let mut gaps: Vec<f64> = (0..self.junctions).map(|i| self.junction_m(i)).collect();
        gaps.extend(
            (0..self.junctions)
                .rev()
                .map(|i| back_m + self.side_m() - self.along_m(i) - JUNCTION_M),
        );
        let mut from_m = 0.0;
        let mut lines = Vec::new();
        for begin_m in gaps.into_iter().chain([ring.length_m()]) {
            lines.push(Marking {
                span_m: Some((from_m, begin_m.min(ring.length_m()))),
                ..Marking::solid(0.0, LINE_M, LINE_GREEN)
            });
            from_m = begin_m + JUNCTION_M;
        }
        lines
    }

    /// Boards, signs and lights.
    fn things(&self, layout: &WarehouseLayout, ring: &Curve, warehouse: &Warehouse) -> Vec<Thing> {
        let mut things = Vec::new();
        for place in &warehouse.places {
            let edge = warehouse.edge_of(ring, place);
            match &place.kind {
                PlaceKind::Start => {
                    let stop = edge.compose(Pose2::new(-STOP_M, 0.0, 0.0));
                    let package = beside(stop, 0.50, -self.turn * 0.17);
                    things.push(code("package", &layout.package, package, stop));
                    things.push(code(
                        "P",
                        "P",
                        beside(edge, 0.04, self.turn * 0.2),
                        ahead_of(edge),
                    ));
                }
                PlaceKind::Depot { number } => {
                    let text = format!("F{number}");
                    things.push(code(
                        &text,
                        &text,
                        beside(edge, 0.04, self.turn * 0.2),
                        ahead_of(edge),
                    ));
                }
                PlaceKind::Area { .. } => {}
            }
        }
        for (area, &depot) in layout.depots[..self.junctions].iter().enumerate() {
            let crossing_m = self.junction_m(area) - BEFORE_JUNCTION_M - CROSSING_M;
            let stop = ring.pose_at(crossing_m - STOP_M);
            let [ahead_m, aside_m] = layout.signs(area);
            things.push(Thing {
                name: format!("sign {depot}"),
                shape: ThingShape::Board { width_m: 0.1 },
                pose: facing(beside(stop, ahead_m, -self.turn * aside_m), stop),
                bottom_m: 0.05,
                height_m: 0.1,
                texture: Texture::sign(depot),
                back: Colour::new(150, 150, 150),
            });
            for (_, program) in layout.lights.iter().filter(|(at, _)| *at == area) {
                let [ahead_m, aside_m] = layout.light_m;
                things.push(Thing {
                    name: format!("light {}", area + 1),
                    shape: ThingShape::Board { width_m: 0.05 },
                    pose: facing(beside(stop, ahead_m, self.turn * aside_m), stop),
                    bottom_m: 0.06,
                    height_m: 0.12,
                    texture: Texture::light(LightProgram {
                        green_s: program.green_s,
                        red_s: program.red_s,
                        offset_s: program.offset_s,
                    }),
                    back: Colour::new(70, 70, 72),
                });
            }
        }
        things
    }
}

/// Ahead and to the left of a pose (m).
fn beside(pose: Pose2, ahead_m: f64, left_m: f64) -> Pose2 {
    pose.compose(Pose2::new(ahead_m, left_m, 0.0))
}

/// From where a code beside a crossing is read.
fn ahead_of(edge: Pose2) -> Pose2 {
    beside(edge, -0.7, 0.0)
}

/// The same place, turned to face another.
fn facing(at: Pose2, towards: Pose2) -> Pose2 {
    let away = towards.position() - at.position();
    Pose2::new(at.x_m, at.y_m, senda_geom::trig::atan2(away.y, away.x))
}

/// A board of 14 cm with a code.
fn code(name: &str, text: &str, at: Pose2, towards: Pose2) -> Thing {
    Thing {
        name: name.to_owned(),
        shape: ThingShape::Board { width_m: 0.14 },
        pose: facing(at, towards),
        bottom_m: 0.03,
        height_m: 0.14,
        texture: Texture::qr(text).unwrap_or(Texture::Plain {
            colour: Colour::new(244, 244, 240),
        }),
        back: Colour::new(196, 164, 120),
    }
}
