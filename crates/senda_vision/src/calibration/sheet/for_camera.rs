//! The sheet that a camera can measure: as near as it sees the floor, no larger than need be.

use super::{Sheet, SheetError};
use senda_geom::{Camera, Vec2};

/// White that stays between squares and the picture's edge, as a part of its width: mountings are off by degrees. Guess.
const MARGIN: f64 = 0.03;
/// Least height and width of a square in the picture (px): below, edges have too few pixels to fit. Tried on the ready vehicles.
const LEAST_PX: f64 = 8.0;
/// Sheets are tried this far apart (m) …
const STEP_M: f64 = 0.005;
/// … up to this much further ahead than their usual place (m).
const FURTHEST_M: f64 = 6.0;
/// A sheet that is moved lies wholly ahead of the axle: a wheel mark on half a sheet helps nobody (m).
const CLEAR_M: f64 = 0.01;

/// How a camera sees a sheet.
enum Sight {
    /// Squares and the white around them lie within the picture; the least side of a square (px).
    Whole(f64),
    /// Some of it lies outside.
    Cut,
}

impl Sheet {
    /// The sheet for a camera that looks at the floor ahead: A4 where the camera sees its squares large enough, else A3; at
    /// its usual place where that is in the picture, else as near as it is. `landscape`: pages across the vehicle.
    ///
    /// ```
    /// use senda_vision::calibration::Sheet;
    /// use senda_geom::{Camera, Lens, Mounting};
    /// let mounting = Mounting { x_m: 0.04, y_m: 0.0, z_m: 0.095, yaw_rad: 0.0, tilt_rad: 0.576, roll_rad: 0.0 };
    /// let lens = Lens::pinhole(160, 120, 0.94, 0.74);
    /// let camera = Camera { name: "center".into(), width_px: 160, height_px: 120, lens, mounting };
    /// assert_eq!(Sheet::for_camera(&camera, false), Ok(Sheet::a4_portrait()));
    /// ```
    pub fn for_camera(camera: &Camera, landscape: bool) -> Result<Self, SheetError> {
        let pages = if landscape {
            [Self::a4_landscape(), Self::a3_landscape()]
        } else {
            [Self::a4_portrait(), Self::a3_portrait()]
        };
        let mut largest_px: Option<f64> = None;
        for page in pages {
            let first = ((CLEAR_M - page.page_start_m).max(0.0) / STEP_M).ceil() as u32;
            let steps = (FURTHEST_M / STEP_M) as u32;
            for step in std::iter::once(0).chain(first.max(1)..=steps) {
                let sheet = page.moved(f64::from(step) * STEP_M);
                match sheet.seen_by(camera) {
                    Sight::Whole(side_px) if side_px >= LEAST_PX => return Ok(sheet),
                    Sight::Whole(side_px) => {
                        largest_px = Some(largest_px.map_or(side_px, |largest| largest.max(side_px)));
                        // Further ahead they are smaller still.
                        break;
                    }
                    Sight::Cut => {}
                }
            }
        }
        Err(match largest_px {
            Some(side_px) => SheetError::TooSmallInPicture {
                side_px,
                least_px: LEAST_PX,
            },
            None => SheetError::NotInPicture,
        })
    }

    fn seen_by(&self, camera: &Camera) -> Sight {
        let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
        let margin = MARGIN * width;
        let gap_m = self.square_side_m / 5.0;
        let mut least_px = f64::INFINITY;
        for square in self.squares() {
            let middle = (square[0] + square[2]) / 2.0;
            let mut places = [Vec2::ZERO; 4];
            for (place, corner) in places.iter_mut().zip(square) {
                let around = corner + (corner - middle) * (2.0 * gap_m / self.square_side_m);
                let (Some(seen), Some(white)) =
                    (camera.pixel_from_floor(corner), camera.pixel_from_floor(around))
                else {
                    return Sight::Cut;
                };
                let inside = (margin..=width - margin).contains(&white.x)
                    && (margin..=height - margin).contains(&white.y);
                if !inside {
                    return Sight::Cut;
                }
                *place = seen;
            }
            // Near left, near right, far right, far left.
            let [a, b, c, d] = places;
            for side in [a - b, b - c, c - d, d - a] {
                least_px = least_px.min(side.length());
            }
        }
        Sight::Whole(least_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_world::VehicleSpec;

    fn sheet(vehicle: &str, landscape: bool) -> Result<Sheet, SheetError> {
        let camera = VehicleSpec::named(vehicle).unwrap().body().cameras[0].clone();
        Sheet::for_camera(&camera, landscape)
    }

    /// Squares lay 14 cm ahead for every vehicle: only one camera of the library saw them.
    #[test]
    fn every_camera_near_the_floor_gets_a_sheet_that_it_sees() {
        assert_eq!(sheet("gopigo", false), Ok(Sheet::a4_portrait()));
        assert_eq!(sheet("gopigo", true), Ok(Sheet::a4_landscape()));
        for vehicle in ["unicycle", "picar", "donkeycar", "warehouse-cart"] {
            for landscape in [false, true] {
                let sheet = sheet(vehicle, landscape).unwrap();
                sheet.check().unwrap();
            }
        }
        assert!(sheet("picar", false).unwrap().near_square_m > 0.17);
    }

    #[test]
    fn a_camera_that_no_page_serves_says_what_to_change() {
        let error = sheet("sedan", false).unwrap_err().to_string();
        assert!(
            error.contains("px") && error.contains("mount the camera lower"),
            "{error}"
        );
        let mut camera = VehicleSpec::named("gopigo").unwrap().body().cameras[0].clone();
        camera.mounting.tilt_rad = -1.0;
        let error = Sheet::for_camera(&camera, false).unwrap_err().to_string();
        assert!(error.contains("does not see the floor"), "{error}");
    }
}
