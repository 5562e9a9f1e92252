//! Classical vision for line-following vehicles: finds painted lines in camera frames and puts them on the floor.
//!
//! ```
//! use senda_core::{Channels, Image};
//! use senda_vision::{Contrast, ExtractorOptions, LineExtractor, WidthProfile};
//! // A dark vertical line, 20 px wide, on a bright floor.
//! let mut image = Image::new(320, 240, Channels::Gray);
//! for y in 0..240 {
//!     for (x, pixel) in image.row_mut(y).iter_mut().enumerate() {
//!         *pixel = if (150..170).contains(&x) { 40 } else { 190 };
//!     }
//! }
//! let profile = WidthProfile { intercept_px: 20.0, slope_px_per_row: 0.0, width_px: 320, height_px: 240 };
//! let mut extractor = LineExtractor::new(320, 240, &profile, ExtractorOptions::default());
//! let contrast = extractor.decide_contrast(&image);
//! assert_eq!(contrast, Contrast::Dark);
//! let blobs = extractor.extract(&image, contrast);
//! assert_eq!(blobs.len(), 1);
//! assert!((blobs[0].centroid.x - 160.0).abs() < 0.1 && blobs[0].orientation_rad.abs() < 0.01);
//! ```
//!
//! The way from a frame to a line: [`LineExtractor`] (C3 to C6 in SPEC) delivers [`LineBlob`]s in image coordinates
//! (u right, v down, pixel centres at +0.5); [`FloorMap`] takes their points to the floor in the vehicle frame
//! (x forward, y left, m); [`floor_line`] fits straight lines and arcs there and gives the state \[d, θ\] (C9);
//! [`LineJoiner`] takes dashes together.
//!
//! This crate does not know who calls it, no files (except text handed to [`calibration`]), no clock, and nothing
//! about time: each frame stands alone. Which blob is *the* line is the drivers' decision.

pub mod alignment;
pub mod binary;
pub mod blob;
pub mod blur;
pub mod classical;
pub mod components;
pub mod detection;
mod digits;
pub mod extractor;
mod finder_patterns;
pub mod floor_line;
pub mod floor_map;
pub mod hough;
pub mod hsv;
pub mod line_joiner;
pub mod luminance;
pub mod morphology;
pub mod options;
pub mod qr;
pub mod street;
pub mod stripes;
pub mod width_profile;

mod blob_pool;
mod channel_choice;
mod simd;

pub mod calibration;

pub use blob::{LineBlob, Rejection, RowPoint};
pub use classical::{ClassicalDetector, ClassicalOptions};
pub use detection::{Detection, Detector, ObjectClass};
pub use extractor::{ContrastScores, LineExtractor, Statistics};
pub use floor_line::{FloorLine, LineFitter, LineState};
pub use floor_map::FloorMap;
pub use hough::{Hough, HoughOptions, Segment};
pub use hsv::{HsvRange, hsv};
pub use line_joiner::{JoinLimits, LineJoiner};
pub use options::{BlobLimits, Channel, Contrast, ExtractorOptions};
pub use qr::{QrCode, QrLimits, QrReader};
pub use senda_core::{Canny, Gradients};
pub use street::{StreetEyes, StreetView};
pub use stripes::{Stripe, StripeFinder};
pub use width_profile::WidthProfile;
