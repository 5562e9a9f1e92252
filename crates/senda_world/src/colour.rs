//! Colours of paint, floors and light.

use crate::error::WorldError;
use crate::reader::Table;
use serde::{Deserialize, Serialize};

/// An sRGB colour, 8 bits a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Colour {
    /// Red, green, blue.
    pub rgb: [u8; 3],
}

/// Names that files may use instead of `#rrggbb`.
const NAMES: [(&str, [u8; 3]); 16] = [
    ("black", [24, 24, 26]),
    ("white", [240, 240, 236]),
    ("grey", [128, 128, 128]),
    ("light-grey", [190, 190, 188]),
    ("dark-grey", [70, 70, 72]),
    ("red", [200, 36, 40]),
    ("green", [30, 140, 70]),
    ("blue", [36, 80, 190]),
    ("yellow", [240, 205, 40]),
    ("orange", [235, 125, 30]),
    ("pink", [236, 72, 150]),
    ("brown", [110, 72, 44]),
    ("beige", [214, 196, 164]),
    ("cyan", [40, 175, 200]),
    ("purple", [120, 60, 160]),
    ("pure-white", [255, 255, 255]),
];

impl Colour {
    /// From three channels.
    pub const fn new(red: u8, green: u8, blue: u8) -> Self {
        Self {
            rgb: [red, green, blue],
        }
    }

    /// From a name or `#rrggbb`.
    pub fn parse(text: &str) -> Option<Self> {
        if let Some((_, rgb)) = NAMES.iter().find(|(name, _)| *name == text) {
            return Some(Self { rgb: *rgb });
        }
        let digits = text.strip_prefix('#')?;
        if digits.len() != 6 || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
            return None;
        }
        let value = u32::from_str_radix(digits, 16).ok()?;
        Some(Self::new((value >> 16) as u8, (value >> 8) as u8, value as u8))
    }

    /// The name of the known colour that is nearest in red, green and blue: for tables that people read.
    pub fn nearest_name(self) -> &'static str {
        let distance = |rgb: [u8; 3]| -> u32 {
            (0..3)
                .map(|c| u32::from(self.rgb[c].abs_diff(rgb[c])).pow(2))
                .sum()
        };
        NAMES
            .iter()
            .min_by_key(|(_, rgb)| distance(*rgb))
            .map_or("", |(name, _)| name)
    }

    /// Luminance 0..=255 of the encoded channels (weights 0.299, 0.587, 0.114; C3 in SPEC).
    pub fn luminance(self) -> f64 {
        let [r, g, b] = self.rgb.map(f64::from);
        0.299 * r + 0.587 * g + 0.114 * b
    }
}

/// `#rrggbb`.
impl std::fmt::Display for Colour {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [r, g, b] = self.rgb;
        write!(f, "#{r:02x}{g:02x}{b:02x}")
    }
}

impl Serialize for Colour {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Colour {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Self::parse(&text).ok_or_else(|| {
            serde::de::Error::custom(format!(
                "expected a colour such as \"#ec4896\" or \"pink\", but found {text:?}"
            ))
        })
    }
}

/// Colours in tables.
pub(crate) trait ReadColour {
    /// A colour by name or `#rrggbb`.
    fn optional_colour(&mut self, key: &'static str) -> Result<Option<Colour>, WorldError>;

    /// The same with a default.
    fn colour(&mut self, key: &'static str, default: Colour) -> Result<Colour, WorldError> {
        Ok(self.optional_colour(key)?.unwrap_or(default))
    }
}

impl ReadColour for Table<'_> {
    fn optional_colour(&mut self, key: &'static str) -> Result<Option<Colour>, WorldError> {
        let Some(text) = self.optional_string(key)? else {
            return Ok(None);
        };
        if let Some(colour) = Colour::parse(&text) {
            return Ok(Some(colour));
        }
        let names: Vec<&str> = NAMES.iter().map(|(name, _)| *name).collect();
        let help = match crate::error::nearest_names(&text, &names).first() {
            Some(name) => format!("did you mean {name:?}? Names: {}", names.join(", ")),
            None => format!("names: {}", names.join(", ")),
        };
        Err(self.problem(
            key,
            "a colour such as \"#ec4896\" or \"pink\"",
            format!("{text:?}"),
            help,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_numbers_are_colours() {
        assert_eq!(Colour::parse("#ff8000"), Some(Colour::new(255, 128, 0)));
        assert_eq!(
            Colour::parse("pink").map(|c| c.to_string()).as_deref(),
            Some("#ec4896")
        );
        for bad in [
            "", "#", "#12345", "#12345g", "#1234567", "pnk", "#+12345", "#é2345",
        ] {
            assert_eq!(Colour::parse(bad), None, "{bad}");
        }
    }
}
