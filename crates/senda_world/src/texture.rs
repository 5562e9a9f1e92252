//! What is painted on things: colours, patterns, pictures, and pictures made from what they say (codes, signs, lights).

use crate::colour::{Colour, ReadColour};
use crate::error::WorldError;
use crate::pictures::{self, LightProgram};
use crate::reader::Table;
use crate::writer::{Document, quoted};

/// What is painted on a thing.
#[derive(Debug, Clone, PartialEq)]
pub enum Texture {
    /// One colour.
    Plain {
        /// The colour.
        colour: Colour,
    },
    /// Squares of two colours.
    Checker {
        /// First colour.
        colour: Colour,
        /// Second colour.
        second_colour: Colour,
        /// Side of a square (m).
        size_m: f64,
    },
    /// Upright stripes of two colours.
    Stripes {
        /// First colour.
        colour: Colour,
        /// Second colour.
        second_colour: Colour,
        /// Width of a stripe (m).
        size_m: f64,
    },
    /// A picture of cells, stretched over the face: signs, QR codes, lights. Programs generate it; files write it as
    /// rows of characters with a palette.
    Cells(Cells),
    /// A QR code with its quiet zone, made from its text.
    Qr {
        /// What the code says: 1 to 64 printable ASCII characters.
        text: String,
        /// Its picture.
        cells: Cells,
    },
    /// A number sign, light blue with a dark digit (document D).
    Sign {
        /// The digit, 0 ..= 9.
        number: u8,
        /// Its picture.
        cells: Cells,
    },
    /// A pedestrian light, the red lamp above the green one; what it shows changes with time.
    Light {
        /// When it is green.
        program: LightProgram,
        /// How it looks while green.
        green: Cells,
        /// How it looks while red.
        red: Cells,
    },
}

/// A small picture: rows from top to bottom, cells from left to right as seen from in front.
#[derive(Debug, Clone, PartialEq)]
pub struct Cells {
    /// Cells in a row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
    /// `width · height` colours.
    pub cells: Vec<Colour>,
}

impl Texture {
    /// A QR code that says `text`; `None` for text that is empty, longer than 64 characters or not printable ASCII.
    pub fn qr(text: &str) -> Option<Self> {
        let cells = pictures::qr(text)?;
        Some(Self::Qr {
            text: text.to_owned(),
            cells,
        })
    }

    /// A number sign. Of larger numbers the last digit is shown.
    pub fn sign(number: u8) -> Self {
        Self::Sign {
            number: number % 10,
            cells: pictures::sign(number % 10),
        }
    }

    /// A pedestrian light with a program.
    pub fn light(program: LightProgram) -> Self {
        Self::Light {
            program,
            green: pictures::light(true),
            red: pictures::light(false),
        }
    }

    /// The looks between which it changes, and the index of the one that shows at a time (s): one look for everything but
    /// lights, whose looks are red and green in this order.
    pub fn look_at(&self, time_s: f64) -> usize {
        match self {
            Self::Light { program, .. } => usize::from(program.is_green(time_s)),
            _ => 0,
        }
    }

    /// Every look as a texture that does not change: see [`Texture::look_at`].
    pub fn looks(&self) -> Vec<Texture> {
        match self {
            Self::Light { green, red, .. } => vec![Self::Cells(red.clone()), Self::Cells(green.clone())],
            other => vec![other.clone()],
        }
    }

    /// Whether it shines of itself: a light's lamps are as bright in a dark room.
    pub fn shines(&self) -> bool {
        matches!(self, Self::Light { .. })
    }

    /// The colour at a place of a face of `width_m` x `height_m`: `right_m` from its left edge as seen from in
    /// front, `down_m` from its upper edge.
    pub fn colour_at(&self, right_m: f64, down_m: f64, width_m: f64, height_m: f64) -> Colour {
        match self {
            Self::Plain { colour } => *colour,
            Self::Checker {
                colour,
                second_colour,
                size_m,
            } => {
                let odd = ((right_m / size_m).floor() + (down_m / size_m).floor()).rem_euclid(2.0);
                if odd < 1.0 { *colour } else { *second_colour }
            }
            Self::Stripes {
                colour,
                second_colour,
                size_m,
            } => {
                if (right_m / size_m).floor().rem_euclid(2.0) < 1.0 {
                    *colour
                } else {
                    *second_colour
                }
            }
            Self::Cells(cells)
            | Self::Qr { cells, .. }
            | Self::Sign { cells, .. }
            | Self::Light { red: cells, .. } => {
                let column = (right_m / width_m * cells.width as f64).max(0.0) as usize;
                let row = (down_m / height_m * cells.height as f64).max(0.0) as usize;
                cells.cells[row.min(cells.height - 1) * cells.width + column.min(cells.width - 1)]
            }
        }
    }

    pub(crate) fn write(&self, document: &mut Document) {
        match self {
            Texture::Plain { colour } => {
                document.text("kind", "plain");
                document.text("colour", &colour.to_string());
            }
            Texture::Checker {
                colour,
                second_colour,
                size_m,
            }
            | Texture::Stripes {
                colour,
                second_colour,
                size_m,
            } => {
                let checker = matches!(self, Texture::Checker { .. });
                document.text("kind", if checker { "checker" } else { "stripes" });
                document.text("colour", &colour.to_string());
                document.text("second_colour", &second_colour.to_string());
                document.number("size_m", *size_m);
            }
            Texture::Cells(cells) => write_cells(cells, document),
            Texture::Qr { text, .. } => {
                document.text("kind", "qr");
                document.text("text", text);
            }
            Texture::Sign { number, .. } => {
                document.text("kind", "sign");
                document.line("number", number);
            }
            Texture::Light { program, .. } => {
                document.text("kind", "light");
                program.write(document);
            }
        }
    }
}

pub(crate) fn read_texture(mut table: Table) -> Result<Texture, WorldError> {
    let kind = table.required_word(
        "kind",
        &["plain", "checker", "stripes", "cells", "qr", "sign", "light"],
    )?;
    if kind == "cells" {
        let cells = read_cells(&mut table)?;
        table.finish()?;
        return Ok(Texture::Cells(cells));
    }
    if let Some(made) = read_made(&mut table, kind)? {
        table.finish()?;
        return Ok(made);
    }
    let colour = table
        .optional_colour("colour")?
        .ok_or_else(|| table.missing("colour", "a colour"))?;
    let texture = if kind == "plain" {
        Texture::Plain { colour }
    } else {
        let second_colour = table.colour("second_colour", Colour::new(240, 240, 236))?;
        let size_m = table.required_f64("size_m", 1e-4, 1000.0)?;
        if kind == "checker" {
            Texture::Checker {
                colour,
                second_colour,
                size_m,
            }
        } else {
            Texture::Stripes {
                colour,
                second_colour,
                size_m,
            }
        }
    };
    table.finish()?;
    Ok(texture)
}

/// Palette letters, in the order in which the writer gives them out.
const LETTERS: &str = "#.abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789";

/// `palette = ["# black", ". white"]`, `rows = ["#.#", …]`.
fn read_cells(table: &mut Table) -> Result<Cells, WorldError> {
    let mut palette: Vec<(char, Colour)> = Vec::new();
    for entry in table.strings("palette")? {
        let mut letters = entry.chars();
        let colour = letters
            .next()
            .zip(letters.as_str().strip_prefix(' ').and_then(Colour::parse));
        palette.push(colour.ok_or_else(|| {
            table.problem(
                "palette",
                "entries such as \"# black\"",
                format!("{entry:?}"),
                "one character, a blank, a colour",
            )
        })?);
    }
    let rows = table.strings("rows")?;
    let width = rows.first().map_or(0, |row| row.chars().count());
    if width == 0 || width > 4096 || rows.len() > 4096 {
        return Err(table.problem("rows", "1 to 4096 rows of 1 to 4096 characters", "others", ""));
    }
    let mut cells = Vec::with_capacity(width * rows.len());
    for row in &rows {
        if row.chars().count() != width {
            return Err(table.problem(
                "rows",
                format!("rows of {width} characters"),
                format!("{row:?}"),
                "",
            ));
        }
        for letter in row.chars() {
            let colour = palette.iter().find(|(known, _)| *known == letter);
            let (_, colour) = colour.ok_or_else(|| {
                table.problem("rows", "characters of the palette", format!("{letter:?}"), "")
            })?;
            cells.push(*colour);
        }
    }
    Ok(Cells {
        width,
        height: rows.len(),
        cells,
    })
}

fn write_cells(cells: &Cells, document: &mut Document) {
    let mut colours: Vec<Colour> = cells.cells.clone();
    colours.sort_unstable();
    colours.dedup();
    // More colours than letters cannot come from a file; the rest becomes the last letter's.
    let letters: Vec<char> = LETTERS.chars().collect();
    let letter = |colour: &Colour| {
        let index = colours.binary_search(colour).unwrap_or(0);
        letters[index.min(letters.len() - 1)]
    };
    let palette: Vec<String> = colours
        .iter()
        .take(letters.len())
        .map(|colour| quoted(&format!("{} {colour}", letter(colour))))
        .collect();
    let rows: Vec<String> = cells
        .cells
        .chunks(cells.width)
        .map(|row| quoted(&row.iter().map(letter).collect::<String>()))
        .collect();
    document.text("kind", "cells");
    document.line("palette", format!("[{}]", palette.join(", ")));
    document.line("rows", format!("[\n  {},\n]", rows.join(",\n  ")));
}

/// Pictures that are made from what they say.
fn read_made(table: &mut Table, kind: &str) -> Result<Option<Texture>, WorldError> {
    Ok(Some(match kind {
        "qr" => {
            let expected = "1 to 64 printable ASCII characters";
            let text = table
                .optional_string("text")?
                .ok_or_else(|| table.missing("text", expected))?;
            Texture::qr(&text)
                .ok_or_else(|| table.problem("text", expected, format!("{text:?}"), "as \"I2\""))?
        }
        "sign" => {
            let number = table.optional_u64("number", 0, 9)?;
            Texture::sign(number.ok_or_else(|| table.missing("number", "a digit from 0 to 9"))? as u8)
        }
        "light" => Texture::light(LightProgram::read(table)?),
        _ => return Ok(None),
    }))
}
