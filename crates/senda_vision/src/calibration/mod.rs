//! Camera calibration from a printed sheet (C1, C2, C11 in SPEC).
//!
//! ```
//! use senda_core::{Channels, Image};
//! use senda_vision::calibration::{CalibrationError, CalibrationOptions, Sheet, calibrate, sheet};
//! // Print it, stand the vehicle on it, take a picture.
//! let page = Sheet::a4_portrait();
//! let drawing = sheet::svg(&page);
//! assert!(drawing.contains("210mm"));
//! // A picture without the sheet says so.
//! let picture = Image::new(320, 240, Channels::Gray);
//! let error = calibrate(&picture, &page, &CalibrationOptions::default()).unwrap_err();
//! assert!(matches!(error, CalibrationError::TooDark { .. }));
//! ```
//!
//! [`calibrate`] finds the eight corners of the sheet's two squares, measures how well the vehicle stands on it, and
//! gives a [`Calibration`]: the homography from pixels to the floor, and the width that a line has at each image row.
//! [`Calibration::to_toml`] and [`Calibration::parse`] are the calibration file. [`placement`] helps to mount the
//! camera before that; [`motor`] is the motors' calibration.
//!
//! This module takes no pictures and opens no files.

#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "`!(error <= limit)` also refuses what is not a number; the lint's rewriting would let it pass"
)]

mod contour;
mod corners;
mod edges;
mod file;
mod fit;
mod model;
pub mod motor;
mod overlay;
mod picture;
pub mod placement;
pub mod sheet;
#[cfg(test)]
mod synthetic;
#[cfg(test)]
mod tests;

pub use file::CalibrationFileError;
pub use model::{Calibration, Placement, Reprojection};
pub use overlay::overlay;
pub use sheet::{Sheet, SheetError};

use crate::WidthProfile;
use senda_core::Image;
use senda_geom::Lens;

/// How to calibrate.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationOptions {
    /// The lens, if it is known, in pixels of the picture's size. Needed for wide lenses; with it the camera's place
    /// and tilt come out too, and the floor map is more exact (6 unknowns instead of 8).
    pub lens: Option<Lens>,
    /// Largest position and orientation error to accept, as a part of the picture's width. The document's 3 px of
    /// 320, "about 1 %".
    pub placement_limit: f64,
    /// What to do beyond that limit.
    pub misplaced: Misplaced,
}

impl Default for CalibrationOptions {
    fn default() -> Self {
        Self {
            lens: None,
            placement_limit: 0.01,
            misplaced: Misplaced::Refuse,
        }
    }
}

/// What to do when the sheet lies beside where it should.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Misplaced {
    /// Give [`CalibrationError::Misplaced`], which carries the calibration for somebody who accepts it.
    #[default]
    Refuse,
    /// Give the calibration all the same; its [`Placement`] still says how far off it is.
    Accept,
}

/// An edge of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The left edge.
    Left,
    /// The right edge.
    Right,
    /// The upper edge.
    Top,
    /// The lower edge.
    Bottom,
}

impl std::fmt::Display for Side {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Top => "upper",
            Self::Bottom => "lower",
        })
    }
}

/// Why a picture gave no calibration: what was found instead, and what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The sheet's dimensions contradict each other.
    #[error(transparent)]
    Sheet(#[from] SheetError),
    /// Too few pixels to see the squares.
    #[error(
        "expected a picture of at least {smallest_width_px}x{smallest_height_px} px, but found {width_px}x{height_px}: use a larger camera size"
    )]
    TooSmall {
        /// Width found (px).
        width_px: usize,
        /// Height found (px).
        height_px: usize,
        /// Smallest width that works (px).
        smallest_width_px: usize,
        /// Smallest height that works (px).
        smallest_height_px: usize,
    },
    /// Nearly black.
    #[error(
        "the picture is too dark: its brightest parts reach {brightest} of 255, expected at least {needed}; turn on a light or let the camera settle for some frames"
    )]
    TooDark {
        /// Brightness that 2 % of the pixels exceed.
        brightest: u8,
        /// What it should be at least.
        needed: u8,
    },
    /// Nothing to see: fog, a covered lens, or burnt out.
    #[error(
        "the picture has too little contrast: expected black squares on white paper, but 96 % of it lies between {darkest} and {brightest} of 255; look for a covered lens, too bright light, or a camera that does not see the sheet"
    )]
    NoContrast {
        /// Brightness that 2 % of the pixels stay below.
        darkest: u8,
        /// Brightness that 2 % of the pixels exceed.
        brightest: u8,
    },
    /// No dark four-cornered region anywhere.
    #[error(
        "expected two black squares, but found none ({dark_regions} dark regions have other shapes); put the vehicle on the sheet so that the camera sees both squares whole, with white paper around them"
    )]
    NoSquare {
        /// Dark regions large enough to be squares.
        dark_regions: usize,
    },
    /// One square only.
    #[error(
        "expected two black squares, but found one (around column {column_px:.0}, row {row_px:.0}); tilt or move the camera until it sees both, and look for a reflection or shadow on the other"
    )]
    OneSquare {
        /// Its middle (px from the left).
        column_px: f64,
        /// Its middle (px from the top).
        row_px: f64,
    },
    /// More than two that could belong to the sheet.
    #[error(
        "expected two black squares, but found {found} four-cornered dark regions that could be them; cover or remove what does not belong to the sheet"
    )]
    TooManySquares {
        /// How many.
        found: usize,
    },
    /// A square leaves the picture.
    #[error(
        "a black square is cut off at the {side} edge of the picture (and {whole} whole ones are seen); move the vehicle or tilt the camera so that both are whole, or use a sheet with squares {}",
        match side { Side::Bottom => "further ahead", Side::Top => "nearer", _ => "in the middle" }
    )]
    CutOff {
        /// At which edge.
        side: Side,
        /// Squares seen whole.
        whole: usize,
    },
    /// Two regions, but they are not this sheet.
    #[error(
        "found two four-cornered dark regions, but they do not fit the sheet: {error_px:.1} px off on average, expected less than {limit_px:.1}; check that the sheet is flat and printed at 100 % with {:.0} mm squares, and give the lens if it is a wide one",
        side_m * 1e3
    )]
    DoNotFit {
        /// Root mean square distance between corners found and corners expected (px).
        error_px: f64,
        /// Largest that would do (px).
        limit_px: f64,
        /// The sheet's side (m).
        side_m: f64,
    },
    /// The sheet is there, but not as the lens would show it.
    #[error(
        "the squares are seen as another lens would show them: {error_px:.1} px off on average, expected less than {limit_px:.1}; \
         check that the picture is of this camera, neither cropped nor stretched, or calibrate with the lens unknown"
    )]
    OtherLens {
        /// Root mean square distance between corners found and corners expected (px).
        error_px: f64,
        /// Largest that would do (px).
        limit_px: f64,
    },
    /// The lower square is the smaller one.
    #[error(
        "the lower square is the smaller one: the picture is upside down or the vehicle looks at the sheet from its far end; turn the picture or the sheet"
    )]
    UpsideDown,
    /// Found, but the vehicle does not stand right on it.
    #[error(
        "the vehicle does not stand right on the sheet: position {:+.1} px, orientation {:+.1} px, accepted up to {:.1} px; {}, or accept it as it is",
        calibration.placement.position_px, calibration.placement.orientation_px, calibration.placement.limit_px,
        calibration.placement.advice()
    )]
    Misplaced {
        /// The calibration, for somebody who accepts it as it is.
        calibration: Box<Calibration>,
    },
}

/// Calibrates from one picture of the sheet (gray or RGB, any size from 96x72): finds the corners, measures the
/// placement, fits the maps.
pub fn calibrate(
    image: &Image,
    sheet: &Sheet,
    options: &CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    sheet.check()?;
    let picture = picture::Picture::new(image)?;
    let found = corners::find(&picture, sheet, options.lens.as_ref())?;
    let calibration = fit::fit(&picture, &found, sheet, options)?;
    if options.misplaced == Misplaced::Refuse && !calibration.placement.is_within_limit() {
        let calibration = Box::new(calibration);
        return Err(CalibrationError::Misplaced { calibration });
    }
    Ok(calibration)
}
