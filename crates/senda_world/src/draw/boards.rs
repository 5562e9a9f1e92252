//! What stands and lies in a warehouse, at true scale on paper: codes, number signs, crossings (document D).

use super::pdf::{self, Page};
use super::print::{INK, PALE, Paper, crop_marks, draw_ruler};
use super::shape::Shape;
use crate::colour::Colour;
use crate::pictures;
use crate::texture::{Cells, Texture};
use crate::thing::ThingShape;
use crate::warehouse::PlaceKind;
use crate::world::World;
use senda_geom::Vec2;

/// Border that holds labels and what the printer cannot reach (mm).
const BORDER_MM: f64 = 12.0;

/// A board or crossing, to be cut out.
#[derive(Debug, Clone, PartialEq)]
struct Sheet {
    size_mm: Vec2,
    picture: Picture,
    words: Vec<String>,
    count: usize,
}

#[derive(Debug, Clone, PartialEq)]
enum Picture {
    /// Dark and light cells: a code.
    Code(Cells),
    /// A number sign.
    Sign(u8),
    /// A crossing's bars, in their colour.
    Bars { count: usize, colour: Colour },
}

/// Prints every code, number sign and crossing of a world, one a page and each only once; lights are not printed, since they
/// change. `None`: it has none, or one that is larger than the paper.
pub fn boards(world: &World, paper: Paper) -> Option<Vec<u8>> {
    let mut sheets: Vec<Sheet> = Vec::new();
    let mut add = |size_m: Vec2, picture: Picture, words: Vec<String>| {
        let size_mm = size_m * 1e3;
        let same = |sheet: &&mut Sheet| sheet.picture == picture && sheet.size_mm == size_mm;
        match sheets.iter_mut().find(same) {
            Some(sheet) => sheet.count += 1,
            None => sheets.push(Sheet {
                size_mm,
                picture,
                words,
                count: 1,
            }),
        }
    };
    let places = world.warehouse.iter().flat_map(|warehouse| &warehouse.places);
    let mut packages: Vec<String> = places
        .filter_map(|place| match place.kind {
            PlaceKind::Depot { number } => Some(format!("I{number}")),
            _ => None,
        })
        .collect();
    packages.sort();
    for thing in &world.things {
        let ThingShape::Board { width_m } = thing.shape else {
            continue;
        };
        let stands = format!("lower edge {:.0} mm above the floor", thing.bottom_m * 1e3);
        let size_m = Vec2::new(width_m, thing.height_m);
        match &thing.texture {
            Texture::Qr { text, .. } => {
                // Of packages a world shows one; on paper there is one for each depot.
                let texts = if text.starts_with('I') {
                    packages.clone()
                } else {
                    vec![text.clone()]
                };
                for text in texts {
                    if let Some(Texture::Qr { cells, .. }) = Texture::qr(&text) {
                        let words = vec![format!("code {text}"), stands.clone()];
                        add(size_m, Picture::Code(cells), words);
                    }
                }
            }
            Texture::Sign { number, .. } => {
                add(
                    size_m,
                    Picture::Sign(*number),
                    vec![format!("sign {number}"), stands],
                );
            }
            _ => {}
        }
    }
    if let Some(warehouse) = &world.warehouse {
        for place in &warehouse.places {
            let bars = warehouse.bars(place);
            if let Some(first) = bars.first() {
                add(
                    Vec2::new(warehouse.street_width_m, place.crossing_depth_m),
                    Picture::Bars {
                        count: bars.len(),
                        colour: first.colour,
                    },
                    vec![
                        "crossing".to_owned(),
                        "across the street, on the floor".to_owned(),
                    ],
                );
            }
        }
    }
    if sheets.is_empty() {
        return None;
    }
    let total = sheets.len();
    let pages = sheets
        .iter()
        .enumerate()
        .map(|(index, sheet)| sheet.page(paper, &format!("{} of {total}", index + 1)))
        .collect::<Option<Vec<Page>>>()?;
    Some(pdf::write(
        &pages,
        &format!("{}: boards at true scale", world.name),
    ))
}

impl Sheet {
    /// Upright where it fits, else lying; `None`: neither.
    fn page(&self, paper: Paper, number: &str) -> Option<Page> {
        let [short_mm, long_mm] = paper.size_mm();
        // Beside the border, the ruler wants its 10 cm and the words their lines.
        let fits = |width_mm: f64, height_mm: f64| {
            self.size_mm.x <= width_mm - 2.0 * BORDER_MM && self.size_mm.y <= height_mm - 4.0 * BORDER_MM
        };
        let (width_mm, height_mm) = [(short_mm, long_mm), (long_mm, short_mm)]
            .into_iter()
            .find(|(width_mm, height_mm)| fits(*width_mm, *height_mm))?;
        let low = Vec2::new(
            0.5 * (width_mm - self.size_mm.x),
            0.5 * (height_mm - self.size_mm.y),
        );
        let high = low + self.size_mm;
        let mut shapes = Vec::new();
        self.draw(low, &mut shapes);
        crop_marks(low, high, &mut shapes);
        draw_ruler(Vec2::splat(BORDER_MM), &mut shapes);
        let mut words = self.words.clone();
        words.insert(
            1,
            format!("{:.0} x {:.0} mm when cut out", self.size_mm.x, self.size_mm.y),
        );
        if self.count > 1 {
            words.push(format!("needed {} times", self.count));
        }
        let at = Vec2::new(BORDER_MM, height_mm - BORDER_MM);
        shapes.push(Shape::text(at, 4.0, INK, words.join(", ")).bold());
        let help = format!("{number}; print at 100 %, check the ruler, glue to cardboard");
        shapes.push(Shape::text(at - Vec2::new(0.0, 5.0), 3.0, PALE, help));
        Some(Page {
            width_mm,
            height_mm,
            shapes,
        })
    }

    fn draw(&self, low: Vec2, shapes: &mut Vec<Shape>) {
        let size = self.size_mm;
        // Parts of the board from its upper left corner, as pictures are.
        let at = |x: f64, y: f64| low + Vec2::new(x * size.x, (1.0 - y) * size.y);
        let mut area = |left: f64, top: f64, right: f64, bottom: f64, colour: Colour| {
            shapes.push(Shape::Area {
                points: vec![at(left, top), at(right, top), at(right, bottom), at(left, bottom)],
                colour,
            });
        };
        match &self.picture {
            Picture::Code(cells) => {
                // Runs of a colour, a hair longer downwards: rasterisers leave light seams between areas that only touch.
                let (width, height) = (cells.width as f64, cells.height as f64);
                for (row, line) in cells.cells.chunks_exact(cells.width).enumerate() {
                    let mut from = 0;
                    for run in line.chunk_by(|a, b| a == b) {
                        let dark = run[0].luminance() < 128.0;
                        let below = (row as f64 + if dark { 1.01 } else { 1.0 }) / height;
                        if dark {
                            let (left, right) = (from as f64 / width, (from + run.len()) as f64 / width);
                            area(left, row as f64 / height, right, below.min(1.0), run[0]);
                        }
                        from += run.len();
                    }
                }
            }
            Picture::Sign(number) => {
                area(0.0, 0.0, 1.0, 1.0, pictures::SIGN);
                for stroke in pictures::strokes(*number) {
                    let points = stroke
                        .iter()
                        .map(|point| at(0.25 + 0.5 * point.x, 0.15 + 0.7 * point.y))
                        .collect();
                    shapes.push(Shape::Line {
                        points,
                        closed: false,
                        width_mm: 2.0 * pictures::STROKE * size.x.min(size.y),
                        colour: pictures::DIGIT,
                        dash_mm: None,
                        round: true,
                    });
                }
            }
            Picture::Bars { count, colour } => {
                let part = 1.0 / (2 * count - 1) as f64;
                for bar in 0..*count {
                    let left = 2.0 * bar as f64 * part;
                    area(left, 0.0, left + part, 1.0, *colour);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(world: &str) -> String {
        let world = World::named(world).unwrap();
        String::from_utf8_lossy(&boards(&world, Paper::A4).unwrap()).into_owned()
    }

    /// Codes at four places and on three packages, two signs, one crossing; the same board is one page.
    #[test]
    fn every_board_has_its_page_once() {
        let pdf = text("warehouse");
        for words in [
            "code P", "code F0", "code F1", "code F2", "code I0", "code I1", "code I2", "sign 0", "sign 1",
            "crossing",
        ] {
            let found = pdf.matches(&format!("({words},")).count();
            assert_eq!(found, 1, "{words}");
        }
        assert!(pdf.contains("needed 6 times") && !pdf.contains("sign 2"));
    }

    #[test]
    fn a_crossing_is_as_wide_as_its_street() {
        // On the lying sheet of 297 mm 20 cm begin at 48.5 mm; bars are a ninth of it.
        let pdf = text("warehouse");
        assert!(pdf.contains("48.5 145 m 70.722 145 l"), "left bar");
    }

    #[test]
    fn worlds_without_boards_print_none() {
        let world = World::named("oval").unwrap();
        assert!(boards(&world, Paper::A4).is_none());
    }
}
