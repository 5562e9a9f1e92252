//! A world: a path with markings on a floor, its light and the things that stand on it.

use crate::colour::{Colour, ReadColour};
use crate::error::{Warning, WorldError};
use crate::floor::{Floor, FloorKind};
use crate::landscape::Landscape;
use crate::light::Light;
use crate::marking::Marking;
use crate::path::{self, FAR_M, PathSpec};
use crate::reader::{Source, Table};
use crate::texture::Texture;
use crate::thing::Thing;
use crate::vehicle::VehicleSpec;
use crate::warehouse::Warehouse;
use crate::writer::Document;
use senda_geom::{Curve, Vec2};
use std::borrow::Cow;
use std::path::Path;

/// Corridor to either side of a single line (m) unless the file says otherwise (guess: a little more than the
/// width of document C's vehicle).
const LINE_CORRIDOR_M: f64 = 0.15;
/// Painted floor around the markings (m) unless the file says otherwise.
const MARGIN_M: f64 = 0.8;

/// A resolved and validated world: plain data and the path made of it.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// Name, such as `oval`.
    pub name: String,
    /// One sentence for lists; may be empty.
    pub description: String,
    /// What vehicles follow, in driving direction: the middle of the line or of the lane.
    pub path: Curve,
    /// How the path is written.
    pub path_spec: PathSpec,
    /// Distance between the middles of the lane's two lines (m); `None`: a single line.
    pub lane_width_m: Option<f64>,
    /// Beyond this offset (m) to either side a vehicle has left the path.
    pub corridor_half_width_m: f64,
    /// Station (m) at which laps begin.
    pub start_station_m: f64,
    /// Lines on the floor.
    pub markings: Vec<Marking>,
    /// The floor.
    pub floor: Floor,
    /// The light.
    pub light: Light,
    /// Upright things.
    pub things: Vec<Thing>,
    /// Open land: areas, woods and walls; empty in rooms.
    pub landscape: Landscape,
    /// What is seen beyond the floor.
    pub backdrop: Backdrop,
    /// Painted floor around the path's outermost markings (m).
    pub margin_m: f64,
    /// Streets beside the path and places to stop at; `None`: there is only the path.
    pub warehouse: Option<Warehouse>,
    /// Finest texel worth painting (m), however near a camera comes: a road of a kilometre needs no millimetres, and has
    /// no memory for them. 0: as fine as the cameras see.
    pub texel_m: f64,
}

/// Paint along one curve.
#[derive(Debug, Clone)]
pub struct Layer<'a> {
    /// The curve.
    pub path: &'a Curve,
    /// What is painted along it, in this order.
    pub markings: Cow<'a, [Marking]>,
}

/// What a camera sees beyond the floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Backdrop {
    /// Colour at the horizon: the foot of the walls.
    pub horizon: Colour,
    /// Colour straight above.
    pub zenith: Colour,
    /// Colour of hills along the horizon, under an open sky; `None`: a room with walls and windows.
    pub hills: Option<Colour>,
}

impl Default for Backdrop {
    fn default() -> Self {
        Self {
            horizon: Colour::new(150, 146, 140),
            zenith: Colour::new(206, 204, 200),
            hills: None,
        }
    }
}

impl World {
    /// Reads a world from TOML text. `source_name` (a file name) appears in messages.
    pub fn parse(source_name: &str, toml: &str) -> Result<(Self, Vec<Warning>), WorldError> {
        let source = Source::new(source_name, toml);
        let mut table = source.table()?;
        if toml.trim().is_empty() {
            return Err(table.problem(
                "",
                "a world",
                "an empty file",
                "start from a copy of worlds/oval.toml",
            ));
        }
        table.only(&[
            "name",
            "description",
            "lane_width_m",
            "corridor_half_width_m",
            "start_station_m",
            "margin_m",
            "texel_m",
            "path",
            "markings",
            "floor",
            "warehouse",
            "light",
            "things",
            "areas",
            "woods",
            "walls",
            "backdrop",
        ])?;
        let (world, mut warnings) = Self::read(&mut table)?;
        warnings.extend(world.geometry_warnings(&table));
        table.finish()?;
        Ok((world, warnings))
    }

    /// Reads a world file.
    pub fn load(path: &Path) -> Result<(Self, Vec<Warning>), WorldError> {
        let text = read_text(path, "world")?;
        Self::parse(&path.display().to_string(), &text)
    }

    fn read(table: &mut Table) -> Result<(Self, Vec<Warning>), WorldError> {
        let name = table
            .optional_string("name")?
            .unwrap_or_else(|| stem(table.source().name()).to_owned());
        let description = table.optional_string("description")?.unwrap_or_default();
        let lane_width_m = table.optional_f64("lane_width_m", 0.01, 100.0)?;
        let corridor_half_width_m = table.f64(
            "corridor_half_width_m",
            0.005,
            100.0,
            lane_width_m.map_or(LINE_CORRIDOR_M, |width_m| width_m / 2.0),
        )?;
        let start_station_m = table.f64("start_station_m", 0.0, FAR_M, 0.0)?;
        let margin_m = table.f64("margin_m", 0.0, 100.0, MARGIN_M)?;
        let texel_m = table.f64("texel_m", 0.0, 1.0, 0.0)?;
        let path_table = table.optional_table("path")?;
        let path_table = path_table.ok_or_else(|| table.missing("path", "a table with pieces or points"))?;
        let (path_spec, path, mut warnings) = PathSpec::read(path_table)?;
        if start_station_m > path.length_m() {
            return Err(table.problem(
                "start_station_m",
                format!("a station on the path (0 to {:.3} m)", path.length_m()),
                format!("{start_station_m}"),
                "",
            ));
        }
        let mut markings = Vec::new();
        for item in table.tables_at_most("markings", 256)? {
            markings.extend(Marking::read(item, lane_width_m, path.length_m())?);
        }
        let floor = match table.optional_table("floor")? {
            Some(floor) => Floor::read(floor)?,
            None => Floor::of_kind(crate::floor::FloorKind::Plain),
        };
        let (mut things, mut in_the_way) = (Vec::new(), Vec::new());
        for item in table.tables_at_most("things", 256)? {
            things.push(Thing::read(item, &path, &mut in_the_way)?);
        }
        let warehouse = match table.optional_table("warehouse")? {
            Some(warehouse) => Some(Warehouse::read(warehouse, &path, &things, &mut warnings)?),
            None => None,
        };
        // A warehouse's package stands before the vehicle, and its streets are driven around.
        if warehouse.is_none() {
            warnings.append(&mut in_the_way);
        }
        let (low, high) = bounds_of(&layers(&path, &markings, warehouse.as_ref()), margin_m);
        let light = match table.optional_table("light")? {
            Some(light) => Light::read(light, low, high)?,
            None => Light::default(),
        };
        let landscape = Landscape::read(table, &path)?;
        let backdrop = match table.optional_table("backdrop")? {
            Some(mut backdrop) => {
                let usual = Backdrop::default();
                let read = Backdrop {
                    horizon: backdrop.colour("horizon", usual.horizon)?,
                    zenith: backdrop.colour("zenith", usual.zenith)?,
                    hills: backdrop.optional_colour("hills")?,
                };
                backdrop.finish()?;
                read
            }
            None => Backdrop::default(),
        };
        let world = Self {
            name,
            description,
            path,
            path_spec,
            lane_width_m,
            corridor_half_width_m,
            start_station_m,
            markings,
            floor,
            light,
            things,
            landscape,
            backdrop,
            margin_m,
            warehouse,
            texel_m,
        };
        Ok((world, warnings))
    }

    /// The resolved copy: every default written out. `parse(to_toml())` gives the same world.
    pub fn to_toml(&self) -> String {
        let mut document = Document::default();
        document.text("name", &self.name);
        if !self.description.is_empty() {
            document.text("description", &self.description);
        }
        if let Some(lane_width_m) = self.lane_width_m {
            document.number("lane_width_m", lane_width_m);
        }
        document.number("corridor_half_width_m", self.corridor_half_width_m);
        document.number("start_station_m", self.start_station_m);
        document.number("margin_m", self.margin_m);
        // Left out where it says nothing: what older worlds resolve to does not change.
        if self.texel_m > 0.0 {
            document.number("texel_m", self.texel_m);
        }
        self.path_spec.write(&mut document, "path");
        for marking in &self.markings {
            marking.write(&mut document, "markings");
        }
        self.floor.write(&mut document);
        self.light.write(&mut document);
        for thing in &self.things {
            thing.write(&mut document);
        }
        if let Some(warehouse) = &self.warehouse {
            warehouse.write(&mut document);
        }
        self.landscape.write(&mut document);
        document.header("backdrop");
        document.text("horizon", &self.backdrop.horizon.to_string());
        document.text("zenith", &self.backdrop.zenith.to_string());
        if let Some(hills) = self.backdrop.hills {
            document.text("hills", &hills.to_string());
        }
        document.finish()
    }

    /// The same world on a ready floor ([`crate::FLOOR_PRESETS`]). Markings that would vanish on it (nearly the floor's
    /// lightness) turn from dark to light or from light to dark.
    pub fn with_floor(mut self, name: &str) -> Result<Self, WorldError> {
        self.floor = Floor::preset(name)?;
        if self.warehouse.is_some() {
            // Lines lie on streets, not on the floor, and their colour is what tells them.
            return Ok(self);
        }
        let floor = self.floor.colour.luminance();
        for marking in &mut self.markings {
            if (marking.colour.luminance() - floor).abs() < 50.0 {
                marking.colour = if floor < 128.0 {
                    Colour::new(240, 240, 236)
                } else {
                    Colour::new(24, 24, 26)
                };
            }
        }
        Ok(self)
    }

    /// The same world in a ready light ([`crate::LIGHT_PRESETS`]).
    pub fn with_light(mut self, name: &str) -> Result<Self, WorldError> {
        let (low, high) = self.bounds();
        self.light = Light::preset(name, low, high)?;
        Ok(self)
    }

    /// The same world with all lines in one colour.
    pub fn with_line_colour(mut self, colour: Colour) -> Self {
        for marking in &mut self.markings {
            marking.colour = colour;
        }
        self
    }

    /// The same world driven the other way round. Floor, paint and light stay where they are; the lap begins at the
    /// same place on a closed path and at the other end of an open one.
    pub fn reversed(self) -> Self {
        let length_m = self.path.length_m();
        Self {
            path: self.path.reversed(),
            start_station_m: if self.path.is_closed() && self.start_station_m > 0.0 {
                length_m - self.start_station_m
            } else {
                self.start_station_m
            },
            path_spec: PathSpec {
                reversed: !self.path_spec.reversed,
                ..self.path_spec
            },
            markings: self
                .markings
                .iter()
                .map(|marking| marking.reversed(length_m))
                .collect(),
            light: self.light.reversed(),
            warehouse: self.warehouse.map(|warehouse| warehouse.reversed(length_m)),
            landscape: self.landscape.reversed(length_m),
            ..self
        }
    }

    /// Level of the light at a station (m): [`Light::level`] times the change along the lap.
    pub fn light_level_at(&self, station_m: f64) -> f64 {
        let part = self.path.normalise_station(station_m) / self.path.length_m();
        self.light.level * self.light.along(part, self.path.is_closed())
    }

    /// The rectangle of floor that is painted: lowest and highest x and y (m).
    pub fn bounds(&self) -> (Vec2, Vec2) {
        bounds_of(
            &layers(&self.path, &self.markings, self.warehouse.as_ref()),
            self.margin_m,
        )
    }

    /// Everything that is painted on the floor, what lies below first: surfaces of streets, lines, crossings.
    pub fn layers(&self) -> Vec<Layer<'_>> {
        layers(&self.path, &self.markings, self.warehouse.as_ref())
    }

    /// The same world whose package says something else (things named `package`). `None`: the text does not fit a code.
    pub fn with_package(mut self, text: &str) -> Option<Self> {
        let texture = Texture::qr(text)?;
        for thing in self.things.iter_mut().filter(|thing| thing.name == "package") {
            thing.texture = texture.clone();
        }
        Some(self)
    }

    /// The same world with its lights elsewhere in their programs: `part` (0 ..= 1) of a cycle later.
    pub fn with_lights_later(mut self, part: f64) -> Self {
        for thing in &mut self.things {
            if let Texture::Light { program, .. } = &mut thing.texture {
                let cycle_s = program.green_s + program.red_s;
                program.offset_s = (program.offset_s + part * cycle_s).rem_euclid(cycle_s.max(1e-9));
            }
        }
        self
    }

    /// What does not fit between this world and a vehicle: a lane that is narrower than the vehicle, curves that it
    /// cannot take.
    pub fn check_vehicle(&self, vehicle: &VehicleSpec) -> Vec<Warning> {
        let warning = |key: &str, message: String| Warning {
            file: self.name.clone(),
            line: None,
            key: key.to_owned(),
            message,
        };
        let mut warnings = Vec::new();
        if let Some(lane_width_m) = self.lane_width_m
            && lane_width_m < vehicle.width_m
        {
            warnings.push(warning(
                "lane_width_m",
                format!(
                    "the lane ({lane_width_m:.3} m) is narrower than {} ({:.3} m)",
                    vehicle.name, vehicle.width_m
                ),
            ));
        }
        let radius_m = path::smallest_radius_m(&self.path);
        let least_m = 1.0 / vehicle.body().curvature_limit_per_m();
        if radius_m < least_m {
            warnings.push(warning(
                "path",
                format!(
                    "the tightest curve ({radius_m:.3} m) is tighter than {} can turn ({least_m:.3} m)",
                    vehicle.name
                ),
            ));
        }
        warnings
    }

    /// Possible but odd geometry.
    fn geometry_warnings(&self, table: &Table) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let reach_m = self
            .markings
            .iter()
            .map(|marking| marking.offset_m.abs() + marking.width_m / 2.0)
            .fold(0.01, f64::max);
        let radius_m = path::smallest_radius_m(&self.path);
        if reach_m >= radius_m {
            warnings.push(table.warning(
                "markings",
                format!(
                    "a marking reaches {reach_m:.3} m from the path, further than its tightest radius \
                     {radius_m:.3} m: it folds there"
                ),
            ));
        } else if let Some((first_m, second_m)) = path::self_overlap(&self.path, 2.0 * reach_m) {
            warnings.push(table.warning(
                "path",
                format!("the path overlaps itself at stations {first_m:.2} m and {second_m:.2} m"),
            ));
        }
        if let Some(lane_width_m) = self.lane_width_m
            && lane_width_m < 0.12
        {
            warnings.push(table.warning(
                "lane_width_m",
                format!("a lane of {lane_width_m:.3} m is narrower than every vehicle of the library"),
            ));
        }
        if self.markings.is_empty() {
            warnings.push(table.warning("markings", "nothing is painted: add [[markings]]".to_owned()));
        }
        let (low, high) = self.bounds();
        let finest_m = crate::paint::finest_texel_m(high - low);
        if finest_m > self.texel_m.max(0.002) {
            warnings.push(table.warning(
                "path",
                format!(
                    "the floor is so large ({:.0} m x {:.0} m) that it is painted at {:.0} mm a texel at best",
                    high.x - low.x,
                    high.y - low.y,
                    finest_m * 1e3
                ),
            ));
        }
        for (index, wall) in self.landscape.walls.iter().enumerate() {
            if wall.offset_m.abs() <= wall.width_m / 2.0 {
                warnings.push(table.warning(
                    "walls",
                    format!(
                        "wall {index} stands on the path, from {:.2} m to {:.2} m: move it aside (offset_m)",
                        wall.from_m, wall.to_m
                    ),
                ));
            }
        }
        for (index, marking) in self.markings.iter().enumerate() {
            if let Some((_, to_m)) = marking.span_m
                && to_m > self.path.length_m()
            {
                warnings.push(table.warning("markings", format!("marking {index} ends beyond the path")));
            }
            // In open land paint lies over paint, and verges are meant to be like the ground.
            let bare_floor = self.landscape.is_empty() && self.floor.kind != FloorKind::Grass;
            if bare_floor && (marking.colour.luminance() - self.floor.colour.luminance()).abs() < 12.0 {
                warnings.push(table.warning(
                    "markings",
                    format!("marking {index} is nearly as light as the floor: it will be hard to see"),
                ));
            }
        }
        warnings
    }
}

fn layers<'a>(path: &'a Curve, markings: &'a [Marking], warehouse: Option<&'a Warehouse>) -> Vec<Layer<'a>> {
    let lines = Layer {
        path,
        markings: Cow::Borrowed(markings),
    };
    let Some(warehouse) = warehouse else {
        return vec![lines];
    };
    let streets = || warehouse.streets.iter();
    let surface = |path: &'a Curve| Layer {
        path,
        markings: Cow::Owned(vec![warehouse.surface()]),
    };
    let mut layers = vec![surface(path)];
    layers.extend(streets().map(|street| surface(&street.path)));
    layers.push(lines);
    layers.extend(streets().map(|street| Layer {
        path: &street.path,
        markings: Cow::Borrowed(&street.markings),
    }));
    layers.extend(warehouse.places.iter().map(|place| Layer {
        path: warehouse.street_of(path, place),
        markings: Cow::Owned(warehouse.bars(place)),
    }));
    layers
}

fn bounds_of(layers: &[Layer], margin_m: f64) -> (Vec2, Vec2) {
    let one = |layer: &Layer| {
        let reach_m = layer
            .markings
            .iter()
            .map(|marking| marking.offset_m.abs() + marking.width_m / 2.0)
            .fold(0.0, f64::max);
        let around = Vec2::splat(reach_m + margin_m);
        let points = layer
            .path
            .polyline((layer.path.length_m() / 2000.0).clamp(0.01, 1.0));
        let (low, high) = points.iter().fold((points[0], points[0]), |(low, high), p| {
            (low.min(*p), high.max(*p))
        });
        (low - around, high + around)
    };
    let first = one(&layers[0]);
    layers[1..]
        .iter()
        .map(one)
        .fold(first, |(low, high), (l, h)| (low.min(l), high.max(h)))
}

/// A file name without folders and extension.
pub(crate) fn stem(source_name: &str) -> &str {
    let name = source_name.rsplit(['/', '\\']).next().unwrap_or(source_name);
    name.strip_suffix(".toml").unwrap_or(name)
}

/// The text of a world or vehicle file (`what`), or why not.
pub(crate) fn read_text(path: &Path, what: &str) -> Result<String, WorldError> {
    let read_error = |reason: String| WorldError::Read {
        file: path.display().to_string(),
        reason,
    };
    let bytes = std::fs::read(path).map_err(|error| {
        read_error(match error.kind() {
            std::io::ErrorKind::NotFound => {
                format!("expected a {what} file, but found no such file; `senda world list` shows the ready {what}s")
            }
            _ => format!("expected a {what} file, but it cannot be read: {error}"),
        })
    })?;
    String::from_utf8(bytes).map_err(|error| {
        read_error(format!(
            "expected a {what} file (TOML, UTF-8 text), but found other bytes from byte {} on",
            error.utf8_error().valid_up_to()
        ))
    })
}
