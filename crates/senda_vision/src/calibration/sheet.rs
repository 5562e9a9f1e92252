//! The printed calibration sheet: where its squares lie, and how to draw it (C1 in SPEC).

mod draw;
mod for_camera;
mod pdf;
mod svg;

pub use pdf::pdf;
pub use svg::svg;

use senda_geom::Vec2;
use serde::{Deserialize, Serialize};

/// Long side of an A4 page (m), ISO 216.
pub const A4_LONG_M: f64 = 0.297;
/// Long side of an A3 page (m), ISO 216; its short side is A4's long one.
pub const A3_LONG_M: f64 = 0.420;
/// Short side of an A4 page (m), ISO 216.
pub const A4_SHORT_M: f64 = 0.210;

/// Dimensions of the calibration sheet, in the vehicle frame of a vehicle that stands right on it: x forward from the
/// axle, y left from the vehicle's middle. The page is centred on the vehicle's middle.
///
/// The default is an A4 page under a two-wheeled robot of 11 cm track (C1, C18): squares of 5 cm, and the axle 15 mm
/// inside the page. Where on the page the squares lie is our choice: as far apart as the page allows, with white
/// paper beyond the far one, and inside the view of a camera 9.5 cm high, tilted 33°.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sheet {
    /// Size of the page across the vehicle (m).
    pub page_width_m: f64,
    /// Size of the page along the vehicle (m).
    pub page_length_m: f64,
    /// Where the page begins, ahead of the axle (m); negative: the vehicle's wheels stand on the page.
    pub page_start_m: f64,
    /// Side of the two black squares (m).
    pub square_side_m: f64,
    /// Edge of the near square that is nearest to the axle (m ahead of it).
    pub near_square_m: f64,
    /// Edge of the far square that is nearest to the axle (m ahead of it).
    pub far_square_m: f64,
    /// Distance between the middles of the wheels (m): where the wheel marks go.
    pub track_m: f64,
    /// Width of a tyre (m): how wide a wheel mark is.
    pub wheel_width_m: f64,
}

impl Default for Sheet {
    fn default() -> Self {
        Self {
            page_width_m: A4_SHORT_M,
            page_length_m: A4_LONG_M,
            page_start_m: -0.015,
            square_side_m: 0.05,
            near_square_m: 0.14,
            far_square_m: 0.215,
            track_m: 0.11,
            wheel_width_m: 0.026,
        }
    }
}

impl Sheet {
    /// An A4 page along the vehicle, the wheels standing on it.
    pub fn a4_portrait() -> Self {
        Self::default()
    }

    /// An A4 page across the vehicle, 10 cm ahead of the axle: for vehicles too wide for a page, or with a
    /// camera that sees the floor only further ahead. The wheels stand beside it, so that it carries no wheel marks
    /// but a middle line and the distance to measure.
    pub fn a4_landscape() -> Self {
        Self {
            page_width_m: A4_LONG_M,
            page_length_m: A4_SHORT_M,
            page_start_m: 0.10,
            near_square_m: 0.14,
            far_square_m: 0.235,
            ..Self::default()
        }
    }

    /// The same on an A3 page with squares of 7 cm, for cameras that see squares of 5 cm too small.
    pub fn a3_portrait() -> Self {
        Self {
            page_width_m: A4_LONG_M,
            page_length_m: A3_LONG_M,
            square_side_m: 0.07,
            near_square_m: 0.205,
            far_square_m: 0.31,
            ..Self::default()
        }
    }

    /// An A3 page across the vehicle, 10 cm ahead of the axle, with squares of 7 cm.
    pub fn a3_landscape() -> Self {
        Self {
            page_width_m: A3_LONG_M,
            page_length_m: A4_LONG_M,
            page_start_m: 0.10,
            square_side_m: 0.07,
            near_square_m: 0.155,
            far_square_m: 0.285,
            ..Self::default()
        }
    }

    /// The same sheet moved forward by `forward_m`, for a camera that does not see the floor so near.
    pub fn moved(self, forward_m: f64) -> Self {
        Self {
            page_start_m: self.page_start_m + forward_m,
            near_square_m: self.near_square_m + forward_m,
            far_square_m: self.far_square_m + forward_m,
            ..self
        }
    }

    /// Refuses dimensions that cannot be printed or seen.
    pub fn check(&self) -> Result<(), SheetError> {
        for (key, value, low, high) in [
            ("page_width_m", self.page_width_m, 0.05, 2.0),
            ("page_length_m", self.page_length_m, 0.05, 5.0),
            ("page_start_m", self.page_start_m, -1.0, 10.0),
            ("square_side_m", self.square_side_m, 0.01, 1.0),
            ("near_square_m", self.near_square_m, 0.0, 10.0),
            ("far_square_m", self.far_square_m, 0.0, 10.0),
            ("track_m", self.track_m, 0.01, 2.0),
            ("wheel_width_m", self.wheel_width_m, 0.001, 0.5),
        ] {
            if !(low..=high).contains(&value) {
                return Err(SheetError::OutOfRange {
                    key,
                    value,
                    low,
                    high,
                });
            }
        }
        let gap_m = self.square_side_m / 5.0;
        let wrong = |what: &'static str| Err(SheetError::DoesNotFit { what });
        if self.far_square_m < self.near_square_m + self.square_side_m + gap_m {
            return wrong(
                "far_square_m must leave at least a fifth of a square's side of white beyond the near square",
            );
        }
        if self.near_square_m < self.page_start_m + gap_m {
            return wrong("near_square_m must leave white paper between the page's edge and the near square");
        }
        if self.far_square_m + self.square_side_m + gap_m > self.page_end_m() {
            return wrong("the far square and a white margin beyond it must lie on the page");
        }
        if self.square_side_m + 2.0 * gap_m > self.page_width_m {
            return wrong("square_side_m leaves no white at the sides of the page");
        }
        Ok(())
    }

    /// Where the page ends, ahead of the axle (m).
    pub fn page_end_m(&self) -> f64 {
        self.page_start_m + self.page_length_m
    }

    /// Whether the axle is on the page, so that wheel marks can be printed.
    pub fn carries_wheels(&self) -> bool {
        self.page_start_m < 0.0 && self.track_m + self.wheel_width_m < self.page_width_m
    }

    /// The eight corners on the floor (vehicle frame, m), near square first, each square in the order near left, near
    /// right, far left, far right (the document's order, its fig. 38).
    pub fn corners(&self) -> [Vec2; 8] {
        let half = self.square_side_m / 2.0;
        let corner = |index: usize| {
            let start = if index < 4 {
                self.near_square_m
            } else {
                self.far_square_m
            };
            let forward = if index % 4 >= 2 { self.square_side_m } else { 0.0 };
            Vec2::new(
                start + forward,
                if index.is_multiple_of(2) { half } else { -half },
            )
        };
        std::array::from_fn(corner)
    }

    /// The two black squares as closed polygons on the floor (vehicle frame, m), near one first.
    pub fn squares(&self) -> [[Vec2; 4]; 2] {
        let c = self.corners();
        [[c[0], c[1], c[3], c[2]], [c[4], c[5], c[7], c[6]]]
    }

    /// The white page as a closed polygon on the floor (vehicle frame, m).
    pub fn page(&self) -> [Vec2; 4] {
        let half = self.page_width_m / 2.0;
        [
            Vec2::new(self.page_start_m, half),
            Vec2::new(self.page_start_m, -half),
            Vec2::new(self.page_end_m(), -half),
            Vec2::new(self.page_end_m(), half),
        ]
    }
}

/// Why a [`Sheet`] cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SheetError {
    /// A dimension is outside its range.
    #[error("sheet: expected {key} from {low} to {high} m, but found {value}")]
    OutOfRange {
        /// The field.
        key: &'static str,
        /// What it is (m).
        value: f64,
        /// Smallest allowed (m).
        low: f64,
        /// Largest allowed (m).
        high: f64,
    },
    /// A camera sees the squares of every page too small.
    #[error(
        "expected a page up to A3 whose squares are {least_px:.0} px or more in the picture, but found {side_px:.1} px at most: the camera \
         is too far from the floor for its frames; give the vehicle file larger frames (width_px, height_px), mount the camera lower, or tilt \
         it further down"
    )]
    TooSmallInPicture {
        /// Least side of a square, on the page that suits best (px).
        side_px: f64,
        /// What it should be (px).
        least_px: f64,
    },
    /// A camera sees no place for a page.
    #[error(
        "expected a camera that sees two squares on the floor ahead of the vehicle whole, but it does not see the floor there; tilt it \
         down, and check its height (z_m) and tilt in the vehicle file"
    )]
    NotInPicture,
    /// The dimensions contradict each other.
    #[error("sheet: {what}")]
    DoesNotFit {
        /// The broken rule.
        what: &'static str,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ready_sheets_can_be_printed() {
        for sheet in [
            Sheet::a4_portrait(),
            Sheet::a4_landscape(),
            Sheet::a3_portrait(),
            Sheet::a3_landscape(),
        ] {
            sheet.check().unwrap();
        }
        assert!(Sheet::a4_portrait().carries_wheels());
        assert!(!Sheet::a4_landscape().carries_wheels());
        assert!(!Sheet::a4_portrait().moved(0.2).carries_wheels());
    }

    #[test]
    fn corners_are_ordered_near_left_first() {
        let corners = Sheet::default().corners();
        assert_eq!(corners[0], Vec2::new(0.14, 0.025));
        assert_eq!(corners[1], Vec2::new(0.14, -0.025));
        assert_eq!(corners[2].y, 0.025);
        assert!((corners[7] - Vec2::new(0.265, -0.025)).length() < 1e-12);
    }

    #[test]
    fn impossible_dimensions_are_refused_by_name() {
        let far = Sheet {
            far_square_m: 0.25,
            ..Sheet::default()
        };
        assert!(far.check().unwrap_err().to_string().contains("on the page"));
        let near = Sheet {
            far_square_m: 0.19,
            ..Sheet::default()
        };
        assert!(
            near.check()
                .unwrap_err()
                .to_string()
                .contains("white beyond the near")
        );
        let nan = Sheet {
            track_m: f64::NAN,
            ..Sheet::default()
        };
        assert!(nan.check().unwrap_err().to_string().contains("track_m"));
    }
}
