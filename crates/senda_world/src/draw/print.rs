//! A world at true scale on sheets of paper, to be cut, joined and taped to a floor.

use super::lines::marking_lines;
use super::pdf::{self, Page};
use super::shape::{Anchor, Shape, to_svg};
use crate::colour::Colour;
use crate::marking::Marking;
use crate::world::World;
use senda_geom::Vec2;
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub(super) const INK: Colour = Colour::new(30, 30, 34);
pub(super) const PALE: Colour = Colour::new(150, 150, 156);
const PATH: Colour = Colour::new(226, 61, 84);

/// Sizes of paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Paper {
    /// 210 x 297 mm.
    #[default]
    A4,
    /// 297 x 420 mm.
    A3,
}

impl Paper {
    /// Short and long side (mm).
    pub(super) fn size_mm(self) -> [f64; 2] {
        match self {
            Paper::A4 => [210.0, 297.0],
            Paper::A3 => [297.0, 420.0],
        }
    }
}

/// How much ink the markings take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ink {
    /// Filled in their colour: the sheets themselves are the circuit.
    #[default]
    Full,
    /// Edges only: where to lay the tape.
    Outline,
}

/// How to print.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PrintOptions {
    /// Size of the sheets.
    pub paper: Paper,
    /// Whether sheets lie on their long side.
    pub landscape: bool,
    /// Filled or outlined.
    pub ink: Ink,
    /// Border that is cut away (m), 10 mm or more: it holds the labels and what the printer cannot reach.
    pub border_m: f64,
}

impl Default for PrintOptions {
    fn default() -> Self {
        Self {
            paper: Paper::A4,
            landscape: false,
            ink: Ink::Full,
            border_m: 0.012,
        }
    }
}

/// Most sheets of one print: more is a mistake (and a forest).
pub const SHEET_LIMIT: usize = 2_000;

/// One sheet of a print, for tests and for those who write their own files.
struct Sheet {
    label: String,
    shapes: Vec<Shape>,
}

/// Why a world cannot be printed.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum CannotPrint {
    /// No line is painted in it.
    #[error("there is nothing to print: the world has no markings; add [[markings]]")]
    Nothing,
    /// It takes too many sheets.
    #[error(
        "the markings cover {width_m:.1} m x {height_m:.1} m and would take more than {SHEET_LIMIT} sheets; choose larger paper (--paper) or a smaller world"
    )]
    TooLarge {
        /// Along x (m).
        width_m: f64,
        /// Along y (m).
        height_m: f64,
    },
}

/// A print of a world: its sheets, in reading order from the upper left; sheets without paint are left out.
pub struct Print {
    width_mm: f64,
    height_mm: f64,
    columns: usize,
    rows: usize,
    sheets: Vec<Sheet>,
    title: String,
}

impl Print {
    /// Lays a world out on sheets at true scale.
    ///
    /// # Errors
    /// When there is nothing to print, or it would take more than [`SHEET_LIMIT`] sheets.
    pub fn new(world: &World, options: &PrintOptions) -> Result<Self, CannotPrint> {
        let [short_mm, long_mm] = options.paper.size_mm();
        let (width_mm, height_mm) = if options.landscape {
            (long_mm, short_mm)
        } else {
            (short_mm, long_mm)
        };
        let border_mm = (options.border_m * 1e3).clamp(10.0, 60.0);
        let tile = Vec2::new(width_mm - 2.0 * border_mm, height_mm - 2.0 * border_mm);
        // Streets' surfaces are floor, not paint: ink is for lines and crossings.
        let surface_m = world.warehouse.as_ref().map(|warehouse| warehouse.street_width_m);
        let mut markings: Vec<Marking> = Vec::new();
        let mut runs: Vec<(usize, Vec<Vec2>)> = Vec::new();
        for layer in world.layers() {
            let paint = layer.markings.iter();
            for marking in paint.filter(|marking| Some(marking.width_m) != surface_m) {
                let number = markings.len();
                runs.extend(
                    marking_lines(layer.path, marking, 0.0)
                        .into_iter()
                        .map(|run| (number, run)),
                );
                markings.push(marking.clone());
            }
        }
        let reach = markings.iter().map(|m| m.width_m).fold(0.0, f64::max);
        let mut points = runs.iter().flat_map(|(_, run)| run).copied();
        let first = points.next().ok_or(CannotPrint::Nothing)?;
        let (low, high) = points.fold((first, first), |(l, h), p| (l.min(p), h.max(p)));
        let (low, high) = (low - Vec2::splat(reach), high + Vec2::splat(reach));
        let size_mm = (high - low) * 1e3;
        let count = |length: f64, tile: f64| (length / tile).ceil().max(1.0);
        let (columns, rows) = (count(size_mm.x, tile.x), count(size_mm.y, tile.y));
        let too_large = CannotPrint::TooLarge {
            width_m: size_mm.x / 1e3,
            height_m: size_mm.y / 1e3,
        };
        if columns * rows > 20.0 * SHEET_LIMIT as f64 {
            return Err(too_large);
        }
        let (columns, rows) = (columns as usize, rows as usize);
        let layout = Layout {
            world,
            options,
            markings,
            runs,
            // The grid is centred on the circuit.
            corner: (low + high) * 0.5e3 - Vec2::new(tile.x * columns as f64, tile.y * rows as f64) * 0.5,
            tile,
            border: Vec2::splat(border_mm),
            columns,
            rows,
        };
        let painted = layout.painted();
        let total = painted.iter().filter(|painted| **painted).count();
        match total {
            0 => return Err(CannotPrint::Nothing),
            1..=SHEET_LIMIT => (),
            _ => return Err(too_large),
        }
        let mut sheets = Vec::new();
        for row in (0..rows).rev() {
            for column in 0..columns {
                if painted[row * columns + column] {
                    sheets.push(layout.sheet(column, row, sheets.len() + 1, total, &painted));
                }
            }
        }
        Ok(Self {
            width_mm,
            height_mm,
            columns,
            rows,
            sheets,
            title: format!("{} at true scale", world.name),
        })
    }

    /// Number of sheets.
    pub fn sheet_count(&self) -> usize {
        self.sheets.len()
    }

    /// Columns and rows of the grid of sheets, blank ones included.
    pub fn grid(&self) -> (usize, usize) {
        (self.columns, self.rows)
    }

    /// All sheets as one PDF, a page each.
    pub fn pdf(self) -> Vec<u8> {
        let (width_mm, height_mm) = (self.width_mm, self.height_mm);
        let pages: Vec<Page> = self
            .sheets
            .into_iter()
            .map(|sheet| Page {
                width_mm,
                height_mm,
                shapes: sheet.shapes,
            })
            .collect();
        pdf::write(&pages, &self.title)
    }

    /// Every sheet as an SVG document of true size, with its label (`B2`).
    pub fn svg(&self) -> Vec<(String, String)> {
        self.sheets
            .iter()
            .map(|sheet| {
                let title = format!("{} {}", self.title, sheet.label);
                let text = to_svg(&sheet.shapes, self.width_mm, self.height_mm, &title);
                (sheet.label.clone(), text)
            })
            .collect()
    }
}

/// What all sheets share. Lengths in millimetres; the floor's own millimetres are its metres times 1,000.
struct Layout<'a> {
    world: &'a World,
    options: &'a PrintOptions,
    markings: Vec<Marking>,
    /// Marking and points (m).
    runs: Vec<(usize, Vec<Vec2>)>,
    /// Lower left corner of the grid on the floor.
    corner: Vec2,
    tile: Vec2,
    border: Vec2,
    columns: usize,
    rows: usize,
}

impl Layout<'_> {
    fn tile_corner(&self, column: usize, row: usize) -> Vec2 {
        self.corner + self.tile * Vec2::new(column as f64, row as f64)
    }

    /// Which tiles carry paint.
    fn painted(&self) -> Vec<bool> {
        // Paint is looked for in such steps (mm): what is narrower than this on a sheet is cut away with its border.
        const STEP_MM: f64 = 2.0;
        let mut painted = vec![false; self.columns * self.rows];
        for (number, run) in &self.runs {
            let width_mm = self.markings[*number].width_m * 1e3;
            let across = (width_mm / STEP_MM).ceil().max(1.0);
            for pair in run.windows(2) {
                let (from, step) = (pair[0] * 1e3, (pair[1] - pair[0]) * 1e3);
                let left = step.perp().normalize_or_zero();
                let along = (step.length() / STEP_MM).ceil().max(1.0);
                for i in 0..=along as usize {
                    for j in 0..=across as usize {
                        let aside_mm = width_mm * (j as f64 / across - 0.5);
                        let at = from + step * (i as f64 / along) + left * aside_mm;
                        let tile = (at - self.corner) / self.tile;
                        painted[clamp(tile.y, self.rows) * self.columns + clamp(tile.x, self.columns)] = true;
                    }
                }
            }
        }
        painted
    }

    fn sheet(&self, column: usize, row: usize, number: usize, total: usize, painted: &[bool]) -> Sheet {
        let corner = self.tile_corner(column, row);
        let onto = |floor_mm: Vec2| floor_mm - corner + self.border;
        let (low, high) = (self.border, self.border + self.tile);
        let mut inside = Vec::new();
        self.draw_runs(corner, &onto, &mut inside);
        self.draw_path(corner, &onto, &mut inside);
        let mut shapes = vec![Shape::Clipped {
            low,
            high,
            shapes: inside,
        }];
        crop_marks(low, high, &mut shapes);
        let label = self.label(column, row);
        self.draw_labels(column, row, &label, number, total, &mut shapes);
        self.draw_overview(column, row, painted, &mut shapes);
        draw_ruler(low, &mut shapes);
        Sheet { label, shapes }
    }

    /// Letter of the row from the top, number of the column from the left: `B3`.
    fn label(&self, column: usize, row: usize) -> String {
        let mut row = self.rows - 1 - row;
        let mut letters = String::new();
        loop {
            letters.insert(0, char::from(b'A' + (row % 26) as u8));
            if row < 26 {
                break;
            }
            row = row / 26 - 1;
        }
        format!("{letters}{}", column + 1)
    }

    fn draw_runs(&self, corner: Vec2, onto: &dyn Fn(Vec2) -> Vec2, shapes: &mut Vec<Shape>) {
        for (number, run) in &self.runs {
            let marking = &self.markings[*number];
            let width_mm = marking.width_m * 1e3;
            let reach = Vec2::splat(width_mm + 12.0);
            let (low, high) = (corner - reach, corner + self.tile + reach);
            let near = |p: &Vec2| {
                let at = *p * 1e3;
                at.cmpge(low).all() && at.cmple(high).all()
            };
            for part in run.split(|p| !near(p)).filter(|part| part.len() > 1) {
                let points: Vec<Vec2> = part.iter().map(|p| onto(*p * 1e3)).collect();
                match self.options.ink {
                    Ink::Full => shapes.push(Shape::line(points, width_mm, printed(marking.colour))),
                    Ink::Outline => {
                        for side in [0.5, -0.5] {
                            shapes.push(Shape::line(parallel(&points, side * width_mm), 0.3, INK));
                        }
                    }
                }
            }
        }
    }

    /// The path as a hair line with arrows: which way round, and where the sheets must meet.
    fn draw_path(&self, corner: Vec2, onto: &dyn Fn(Vec2) -> Vec2, shapes: &mut Vec<Shape>) {
        let path = &self.world.path;
        let steps = (path.length_m() / 0.01).ceil() as usize;
        let mut run: Vec<Vec2> = Vec::new();
        let (low, high) = (corner - Vec2::splat(12.0), corner + self.tile + Vec2::splat(12.0));
        for i in 0..=steps {
            let pose = path.pose_at(path.length_m() * i as f64 / steps as f64);
            let at = pose.position() * 1e3;
            if !(at.cmpge(low).all() && at.cmple(high).all()) {
                flush(&mut run, shapes);
                continue;
            }
            run.push(onto(at));
            if i % 10 == 0 {
                let (at, forward, left) = (onto(at), pose.forward(), pose.left());
                shapes.push(Shape::Area {
                    points: vec![at + forward * 2.4, at + left * 1.1, at - left * 1.1],
                    colour: PATH,
                });
            }
        }
        flush(&mut run, shapes);
    }

    fn draw_labels(
        &self,
        column: usize,
        row: usize,
        label: &str,
        number: usize,
        total: usize,
        shapes: &mut Vec<Shape>,
    ) {
        // All of it stands in the border, which is cut away: nothing is printed over the paint.
        let (low, high) = (self.border, self.border + self.tile);
        let middle = (low + high) * 0.5;
        let head = Vec2::new(low.x + 7.0, high.y + 2.4);
        shapes.push(Shape::text(head, 6.0, INK, label).bold());
        let title = format!(
            "{}, sheet {number} of {total}, true scale: the bar below must measure 10 cm",
            self.world.name
        );
        shapes.push(Shape::text(head + Vec2::new(14.0, 0.0), 2.8, INK, title));
        // Neighbours, beside the edge that meets them.
        let mut neighbour = |dx: i64, dy: i64, at: Vec2, anchor: Anchor| {
            let (x, y) = (column as i64 + dx, row as i64 + dy);
            if (0..self.columns as i64).contains(&x) && (0..self.rows as i64).contains(&y) {
                let text = self.label(x as usize, y as usize);
                shapes.push(Shape::text(at, 3.2, PALE, text).anchored(anchor));
            }
        };
        neighbour(-1, 0, Vec2::new(low.x - 1.2, middle.y), Anchor::Right);
        neighbour(1, 0, Vec2::new(high.x + 1.2, middle.y), Anchor::Left);
        neighbour(0, 1, Vec2::new(high.x - 8.0, high.y + 1.4), Anchor::Right);
        neighbour(0, -1, Vec2::new(high.x - 8.0, low.y - 3.8), Anchor::Right);
    }

    /// Lower left corner of a free place for something of a size, in a corner of the sheet; `None`: paint is everywhere.
    fn free_corner(&self, column: usize, row: usize, size: Vec2) -> Option<Vec2> {
        let spare = self.tile - size - Vec2::splat(8.0);
        let corners = [(1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        corners.into_iter().find_map(|(x, y)| {
            let within = Vec2::splat(4.0) + spare * Vec2::new(x, y);
            let low = self.tile_corner(column, row) + within;
            let taken = self.runs.iter().any(|(number, run)| {
                let reach = Vec2::splat(self.markings[*number].width_m * 500.0 + 1.0);
                run.iter().any(|p| {
                    let at = *p * 1e3;
                    at.cmpge(low - reach).all() && at.cmple(low + size + reach).all()
                })
            });
            (!taken).then_some(self.border + within)
        })
    }

    /// The whole circuit in a corner of the sheet, this sheet marked.
    fn draw_overview(&self, column: usize, row: usize, painted: &[bool], shapes: &mut Vec<Shape>) {
        let grid = Vec2::new(self.columns as f64, self.rows as f64) * self.tile;
        let scale = 30.0 / grid.max_element();
        let size = grid * scale;
        let Some(low) = self.free_corner(column, row, size) else {
            return;
        };
        // The edges of many small sheets would be one grey block.
        let has_edges = (self.tile * scale).min_element() > 1.5;
        for y in 0..self.rows {
            for x in 0..self.columns {
                let corner = low + self.tile * scale * Vec2::new(x as f64, y as f64);
                let far = corner + self.tile * scale;
                let points = vec![
                    corner,
                    Vec2::new(far.x, corner.y),
                    far,
                    Vec2::new(corner.x, far.y),
                ];
                let here = (x, y) == (column, row);
                if here || painted[y * self.columns + x] {
                    let light = if here {
                        Colour::new(250, 205, 212)
                    } else {
                        Colour::new(242, 242, 244)
                    };
                    shapes.push(Shape::Area {
                        points: points.clone(),
                        colour: light,
                    });
                }
                if !has_edges {
                    continue;
                }
                shapes.push(Shape::Line {
                    points,
                    closed: true,
                    width_mm: 0.1,
                    colour: PALE,
                    dash_mm: None,
                    round: false,
                });
            }
        }
        let path = &self.world.path;
        let points = path
            .polyline((path.length_m() / 200.0).max(0.01))
            .into_iter()
            .map(|p| low + (p * 1e3 - self.corner) * scale)
            .collect();
        shapes.push(Shape::line(points, 0.35, INK));
    }
}

fn clamp(part: f64, count: usize) -> usize {
    (part.floor().max(0.0) as usize).min(count - 1)
}

fn flush(run: &mut Vec<Vec2>, shapes: &mut Vec<Shape>) {
    let points = std::mem::take(run);
    if points.len() > 1 {
        shapes.push(Shape::line(points, 0.12, PATH));
    }
}

/// Paint nearly as white as paper would be lost on it: it is printed as a pale grey.
fn printed(colour: Colour) -> Colour {
    if colour.luminance() > 225.0 {
        Colour::new(205, 205, 208)
    } else {
        colour
    }
}

/// A line beside another, `offset` to its left.
fn parallel(points: &[Vec2], offset: f64) -> Vec<Vec2> {
    (0..points.len())
        .map(|i| {
            let (a, b) = (points[i.saturating_sub(1)], points[(i + 1).min(points.len() - 1)]);
            points[i] + (b - a).normalize_or_zero().perp() * offset
        })
        .collect()
}

pub(super) fn crop_marks(low: Vec2, high: Vec2, shapes: &mut Vec<Shape>) {
    for (x, outward_x) in [(low.x, -1.0), (high.x, 1.0)] {
        for (y, outward_y) in [(low.y, -1.0), (high.y, 1.0)] {
            let corner = Vec2::new(x, y);
            let marks = [Vec2::new(outward_x, 0.0), Vec2::new(0.0, outward_y)];
            for mark in marks {
                shapes.push(Shape::line(
                    vec![corner + mark * 0.8, corner + mark * 4.8],
                    0.15,
                    INK,
                ));
                shapes.push(Shape::line(vec![corner, corner - mark * 2.0], 0.1, PALE));
            }
        }
    }
}

/// 10 cm in centimetres: a ruler laid beside it shows whether the printer kept the scale.
pub(super) fn draw_ruler(low: Vec2, shapes: &mut Vec<Shape>) {
    let from = Vec2::new(low.x + 7.0, low.y - 5.6);
    shapes.push(Shape::line(vec![from, from + Vec2::new(100.0, 0.0)], 0.2, INK));
    for mm in 0..=100 {
        let height = match mm {
            mm if mm % 10 == 0 => 3.0,
            mm if mm % 5 == 0 => 2.0,
            _ => 1.0,
        };
        let at = from + Vec2::new(f64::from(mm), 0.0);
        shapes.push(Shape::line(vec![at, at + Vec2::new(0.0, height)], 0.12, INK));
        if mm % 10 == 0 {
            let text = format!("{}", mm / 10);
            shapes.push(Shape::text(at - Vec2::new(0.0, 2.4), 2.2, INK, text).anchored(Anchor::Middle));
        }
    }
}
