//! Document D's test track: streets beside the path, and the places where a mission stops.

mod layout;

pub use layout::WarehouseLayout;

use crate::colour::{Colour, ReadColour};
use crate::error::{Warning, WorldError, nearest_names};
use crate::marking::Marking;
use crate::path::{FAR_M, PathSpec};
use crate::reader::Table;
use crate::thing::Thing;
use crate::writer::Document;
use senda_geom::{Curve, Place as CurvePlace, Pose2, Vec2};

/// Bars of a zebra crossing across the street (guess from document D's figure 8).
const CROSSING_BARS: usize = 5;
const CROSSING_RED: Colour = Colour::new(204, 30, 38);

/// A network of streets: the world's path is the ring that leads from the start past all areas to the last depot and
/// back; the streets lead across it.
#[derive(Debug, Clone, PartialEq)]
pub struct Warehouse {
    /// Width of the path's street and of all others (m).
    pub street_width_m: f64,
    /// Colour of the streets.
    pub street_colour: Colour,
    /// Streets beyond the path.
    pub streets: Vec<Street>,
    /// Where to stop.
    pub places: Vec<Place>,
}

/// A street that leaves the path and comes back to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Street {
    /// Its name, such as `street 1`.
    pub name: String,
    /// Its middle, in driving direction.
    pub path: Curve,
    /// How that is written.
    pub path_spec: PathSpec,
    /// Lines painted along it.
    pub markings: Vec<Marking>,
}

/// A place with a red zebra crossing.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// What it is.
    pub kind: PlaceKind,
    /// Index of its street; `None`: on the world's path.
    pub street: Option<usize>,
    /// Station of the crossing's middle on its street (m).
    pub crossing_m: f64,
    /// Extent of the crossing along the street (m).
    pub crossing_depth_m: f64,
}

/// What is done at a place.
#[derive(Debug, Clone, PartialEq)]
pub enum PlaceKind {
    /// Packages are loaded.
    Start,
    /// A sign says which depot the next turn leads to; there may be a light.
    Area {
        /// The depot that the sign names.
        depot: u8,
        /// Name of the light among the world's things.
        light: Option<String>,
    },
    /// A depot.
    Depot {
        /// Its number.
        number: u8,
    },
}

impl Place {
    /// What it is called: `start`, `area 1`, `depot 2` (areas by the depot that their sign names).
    pub fn name(&self) -> String {
        match &self.kind {
            PlaceKind::Start => "start".to_owned(),
            PlaceKind::Area { depot, .. } => format!("area {depot}"),
            PlaceKind::Depot { number } => format!("depot {number}"),
        }
    }

    /// Station at which a vehicle that comes along meets the crossing (m).
    pub fn near_edge_m(&self) -> f64 {
        self.crossing_m - self.crossing_depth_m / 2.0
    }
}

impl Warehouse {
    /// The middle of a place's street.
    pub fn street_of<'a>(&'a self, path: &'a Curve, place: &Place) -> &'a Curve {
        place
            .street
            .and_then(|index| self.streets.get(index))
            .map_or(path, |street| &street.path)
    }

    /// Where the crossing of a place begins: on the middle of its street, heading along it.
    pub fn edge_of(&self, path: &Curve, place: &Place) -> Pose2 {
        self.street_of(path, place).pose_at(place.near_edge_m())
    }

    /// The nearest street to a point: `None` for the path, and the place on it.
    pub fn nearest_street(&self, path: &Curve, point: Vec2) -> (Option<usize>, CurvePlace) {
        let mut nearest = (None, path.project(point));
        for (index, street) in self.streets.iter().enumerate() {
            let place = street.path.project(point);
            if place.offset_m.abs() < nearest.1.offset_m.abs() {
                nearest = (Some(index), place);
            }
        }
        nearest
    }

    /// The street's surface as a marking.
    pub(crate) fn surface(&self) -> Marking {
        Marking {
            gloss: 0.05,
            ..Marking::solid(0.0, self.street_width_m, self.street_colour)
        }
    }

    /// A crossing's bars: markings along its street.
    pub(crate) fn bars(&self, place: &Place) -> Vec<Marking> {
        let bar_m = self.street_width_m / (2 * CROSSING_BARS - 1) as f64;
        let half_m = place.crossing_depth_m / 2.0;
        (0..CROSSING_BARS)
            .map(|bar| Marking {
                span_m: Some((place.crossing_m - half_m, place.crossing_m + half_m)),
                ..Marking::solid(
                    (2 * bar) as f64 * bar_m - (self.street_width_m - bar_m) / 2.0,
                    bar_m,
                    CROSSING_RED,
                )
            })
            .collect()
    }

    /// For the path driven the other way round: places on it move with it, streets stay as they are.
    pub(crate) fn reversed(mut self, path_length_m: f64) -> Self {
        for place in self.places.iter_mut().filter(|place| place.street.is_none()) {
            place.crossing_m = path_length_m - place.crossing_m;
        }
        self
    }

    pub(crate) fn read(
        mut table: Table,
        path: &Curve,
        things: &[Thing],
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, WorldError> {
        let street_width_m = table.f64("street_width_m", 0.01, 100.0, 0.2)?;
        let street_colour = table.colour("street_colour", Colour::new(70, 72, 76))?;
        let mut streets: Vec<Street> = Vec::new();
        for mut item in table.tables_at_most("streets", 64)? {
            let name = item.optional_string("name")?;
            let name = name.ok_or_else(|| item.missing("name", "a name such as \"street 1\""))?;
            if streets.iter().any(|street| street.name == name) {
                return Err(item.problem(
                    "name",
                    "streets with different names",
                    format!("{name:?} twice"),
                    "",
                ));
            }
            let path_table = item.optional_table("path")?;
            let path_table =
                path_table.ok_or_else(|| item.missing("path", "a table with pieces or points"))?;
            let (path_spec, path, odd) = PathSpec::read(path_table)?;
            warnings.extend(odd);
            let mut markings = Vec::new();
            for marking in item.tables_at_most("markings", 64)? {
                markings.extend(Marking::read(marking, None, path.length_m())?);
            }
            item.finish()?;
            streets.push(Street {
                name,
                path,
                path_spec,
                markings,
            });
        }
        let mut items = table.tables_at_most("places", 128)?;
        let mut places = Vec::new();
        for item in &mut items {
            places.push(Place::read(item, path, &streets, things)?);
        }
        let depots: Vec<u8> = places.iter().filter_map(Place::depot).collect();
        for (item, place) in items.into_iter().zip(&places) {
            if let PlaceKind::Area { depot, .. } = &place.kind
                && !depots.contains(depot)
            {
                let numbers: Vec<String> = depots.iter().map(u8::to_string).collect();
                let known = format!("the number of a depot: {}", numbers.join(", "));
                let help = "add the place with kind = \"depot\", or correct the number";
                return Err(item.problem("depot", known, depot.to_string(), help));
            }
            item.finish()?;
        }
        table.finish()?;
        Ok(Self {
            street_width_m,
            street_colour,
            streets,
            places,
        })
    }

    pub(crate) fn write(&self, document: &mut Document) {
        document.header("warehouse");
        document.number("street_width_m", self.street_width_m);
        document.text("street_colour", &self.street_colour.to_string());
        for street in &self.streets {
            document.item("warehouse.streets");
            document.text("name", &street.name);
            street.path_spec.write(document, "warehouse.streets.path");
            for marking in &street.markings {
                marking.write(document, "warehouse.streets.markings");
            }
        }
        for place in &self.places {
            place.write(document, &self.streets);
        }
    }
}

/// Which of the names a key holds; absent is none, another name an error.
fn one_of<'a>(
    table: &mut Table,
    key: &'static str,
    what: &str,
    names: impl Iterator<Item = &'a str>,
) -> Result<Option<usize>, WorldError> {
    let Some(found) = table.optional_string(key)? else {
        return Ok(None);
    };
    let names: Vec<&str> = names.collect();
    if let Some(index) = names.iter().position(|name| *name == found) {
        return Ok(Some(index));
    }
    let help = match nearest_names(&found, &names).first() {
        Some(name) => format!("did you mean {name:?}?"),
        None => String::new(),
    };
    let all = if names.is_empty() {
        "there is none".to_owned()
    } else {
        names.join(", ")
    };
    Err(table.problem(
        key,
        format!("the name of {what}: {all}"),
        format!("{found:?}"),
        help,
    ))
}

impl Place {
    /// The number of a depot; `None` for other places.
    fn depot(&self) -> Option<u8> {
        match self.kind {
            PlaceKind::Depot { number } => Some(number),
            _ => None,
        }
    }

    fn read(
        table: &mut Table,
        path: &Curve,
        streets: &[Street],
        things: &[Thing],
    ) -> Result<Self, WorldError> {
        let names = streets.iter().map(|street| street.name.as_str());
        let street = one_of(table, "street", "a street", names)?;
        let length_m = street.map_or(path, |index| &streets[index].path).length_m();
        let crossing_depth_m = table.f64("crossing_depth_m", 0.005, 10.0, 0.08)?;
        let crossing_m = table.required_f64("crossing_m", 0.0, FAR_M)?;
        if crossing_m > length_m {
            return Err(table.problem(
                "crossing_m",
                format!("a station on its street (0 to {length_m:.3} m)"),
                format!("{crossing_m}"),
                "",
            ));
        }
        let depot = |table: &mut Table| -> Result<u8, WorldError> {
            let number = table.optional_u64("depot", 0, 9)?;
            Ok(number.ok_or_else(|| table.missing("depot", "a digit from 0 to 9"))? as u8)
        };
        let kind = match table.required_word("kind", &["start", "area", "depot"])? {
            "start" => PlaceKind::Start,
            "area" => {
                let depot = depot(table)?;
                let lights = || things.iter().filter(|thing| thing.texture.shines());
                let names = lights().map(|thing| thing.name.as_str());
                let light = one_of(table, "light", "a light among [[things]]", names)?;
                PlaceKind::Area {
                    depot,
                    light: light
                        .and_then(|index| lights().nth(index))
                        .map(|thing| thing.name.clone()),
                }
            }
            _ => PlaceKind::Depot {
                number: depot(table)?,
            },
        };
        Ok(Self {
            kind,
            street,
            crossing_m,
            crossing_depth_m,
        })
    }

    fn write(&self, document: &mut Document, streets: &[Street]) {
        document.item("warehouse.places");
        match &self.kind {
            PlaceKind::Start => document.text("kind", "start"),
            PlaceKind::Area { depot, light } => {
                document.text("kind", "area");
                document.line("depot", depot);
                if let Some(light) = light {
                    document.text("light", light);
                }
            }
            PlaceKind::Depot { number } => {
                document.text("kind", "depot");
                document.line("depot", number);
            }
        }
        if let Some(street) = self.street {
            document.text("street", &streets[street].name);
        }
        document.number("crossing_m", self.crossing_m);
        document.number("crossing_depth_m", self.crossing_depth_m);
    }
}
