//! What a calibration knows: the map from pixels to the floor and what it was measured from.

use super::{Sheet, WidthProfile};
use crate::FloorMap;
use senda_geom::{Camera, Homography, Lens, Vec2, Vec3};

/// A calibrated camera: everything that [`super::calibrate`] found, and the contents of the calibration file.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Width of the picture (px). Frames of other sizes are scaled to it (the document's 5.8.2.1).
    pub width_px: u32,
    /// Height of the picture (px).
    pub height_px: u32,
    /// From pixels (u, v, pixel centres at +0.5) to the floor in the vehicle frame (m). With a [`Calibration::camera`]
    /// whose lens bends straight lines: from the pixels that the same lens without its distortion would give.
    pub floor_from_image: Homography,
    /// The eight corners in the picture (px), in the order of [`Sheet::corners`].
    pub corners_px: [Vec2; 8],
    /// The sheet that was seen.
    pub sheet: Sheet,
    /// How well the vehicle stood on it.
    pub placement: Placement,
    /// How well the map fits the corners.
    pub reprojection: Reprojection,
    /// Width of a line as wide as the squares against the image row; [`Calibration::width_profile`] scales it.
    pub square_width: WidthProfile,
    /// Lens, place and direction, if the lens was known.
    pub camera: Option<Camera>,
}

/// How the vehicle stood on the sheet, in pixels of the picture (the document's eq. 12).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Middle of the near square minus the middle of the picture (px); positive: the sheet is too far to the right.
    pub position_px: f64,
    /// Middle of the near square minus middle of the far one (px); positive: the sheet leans to the left.
    pub orientation_px: f64,
    /// Largest accepted amount of either (px).
    pub limit_px: f64,
    /// How far to the left of the vehicle's middle the sheet lies, at the axle (m), if the camera looks straight ahead
    /// from the vehicle's middle. (The two errors in pixels mix this with the next.)
    pub lateral_m: f64,
    /// How far the sheet is turned to the left (rad), on the same condition.
    pub turn_rad: f64,
}

impl Placement {
    /// Whether both errors are accepted.
    pub fn is_within_limit(&self) -> bool {
        self.position_px.abs() <= self.limit_px && self.orientation_px.abs() <= self.limit_px
    }

    /// What to do about it, such as "move it 4 mm to the left, turn it 2.0° to the right".
    pub fn advice(&self) -> String {
        let side = |amount: f64| if amount > 0.0 { "left" } else { "right" };
        let mut parts = Vec::new();
        // Less cannot be done by hand.
        if self.lateral_m.abs() >= 0.0005 {
            let (amount, side) = (self.lateral_m.abs() * 1e3, side(self.lateral_m));
            parts.push(format!("move it {amount:.0} mm to the {side}"));
        }
        if self.turn_rad.abs() >= 0.003 {
            let (amount, side) = (self.turn_rad.abs().to_degrees(), side(self.turn_rad));
            parts.push(format!("turn it {amount:.1}° to the {side}"));
        }
        if parts.is_empty() {
            parts.push("check that the camera looks straight ahead".to_owned());
        }
        parts.join(", ")
    }
}

/// How far the map from pixels to the floor misses the corners it was fitted to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reprojection {
    /// Root mean square distance in the picture (px).
    pub rms_px: f64,
    /// Largest distance in the picture (px).
    pub max_px: f64,
    /// Largest distance on the floor (m).
    pub max_m: f64,
}

impl Calibration {
    /// The floor point (vehicle frame, m) seen by a pixel of a frame of `width_px` x `height_px`; `None` at or above
    /// the horizon.
    pub fn floor_from_pixel(&self, pixel: Vec2, width_px: u32, height_px: u32) -> Option<Vec2> {
        let pixel = Vec2::new(
            pixel.x * f64::from(self.width_px) / f64::from(width_px),
            pixel.y * f64::from(self.height_px) / f64::from(height_px),
        );
        match &self.camera {
            Some(camera) => camera.floor_from_pixel(pixel),
            None => map_on_the_side_of(&self.floor_from_image, pixel, self.corners_px[0]),
        }
    }

    /// The pixel of a frame of `width_px` x `height_px` that sees a floor point (vehicle frame, m); `None` for points
    /// behind the camera.
    pub fn pixel_from_floor(&self, floor: Vec2, width_px: u32, height_px: u32) -> Option<Vec2> {
        let pixel = match &self.camera {
            Some(camera) => camera.pixel_from_floor(floor)?,
            None => {
                let image_from_floor = self.floor_from_image.inverse()?;
                map_on_the_side_of(&image_from_floor, floor, self.sheet.corners()[0])?
            }
        };
        Some(Vec2::new(
            pixel.x * f64::from(width_px) / f64::from(self.width_px),
            pixel.y * f64::from(height_px) / f64::from(self.height_px),
        ))
    }

    /// The map to the floor for frames of `width_px` x `height_px`.
    pub fn floor_map(&self, width_px: usize, height_px: usize) -> FloorMap {
        match &self.camera {
            Some(camera) => FloorMap::from_camera(camera, width_px, height_px),
            None => FloorMap::from_homography(
                &self.floor_from_image,
                self.width_px as usize,
                self.height_px as usize,
                width_px,
                height_px,
            ),
        }
    }

    /// The lens without distortion, with square pixels and its axis in the picture's middle, that shows the floor like this
    /// (Zhang 2000, eq. 3 and 4 with one unknown); `None` where the floor does not tell, as from straight above.
    pub fn pinhole_lens(&self) -> Option<Lens> {
        let centre = 0.5 * Vec2::new(f64::from(self.width_px), f64::from(self.height_px));
        let image_from_floor = self.floor_from_image.inverse()?.matrix();
        let centred = |column: Vec3| (column.truncate() - centre * column.z, column.z);
        let ((ahead, ahead_z), (left, left_z)) =
            (centred(image_from_floor.x_axis), centred(image_from_floor.y_axis));
        // Directions ahead and to the left are at right angles and equally long: two equations in 1/f².
        let weights = [ahead.dot(left), ahead.length_squared() - left.length_squared()];
        let sides = [-ahead_z * left_z, left_z * left_z - ahead_z * ahead_z];
        let inverse = (weights[0] * sides[0] + weights[1] * sides[1])
            / (weights[0] * weights[0] + weights[1] * weights[1]);
        let focal_px = 1.0 / inverse.sqrt();
        // Views of 136° to 6°, as where the squares are looked for.
        let sizes = 0.2 * f64::from(self.width_px)..10.0 * f64::from(self.width_px);
        sizes.contains(&focal_px).then_some(Lens::Pinhole {
            focal_u_px: focal_px,
            focal_v_px: focal_px,
            centre_u_px: centre.x,
            centre_v_px: centre.y,
        })
    }

    /// Expected width of a line `line_width_m` wide (px) against the row, for the picture's size; scale it with
    /// [`WidthProfile::scaled`]. (The document also multiplies the intercept by the ratio of widths to heights instead
    /// of widths alone; the two agree only at its own size.)
    pub fn width_profile(&self, line_width_m: f64) -> WidthProfile {
        self.square_width.widened(line_width_m / self.sheet.square_side_m)
    }
}

/// Maps a point, unless it lies beyond the line that maps to infinity (the horizon) as seen from a point known to be on the
/// right side.
fn map_on_the_side_of(map: &Homography, point: Vec2, known: Vec2) -> Option<Vec2> {
    let depth = |p: Vec2| (map.matrix() * Vec3::new(p.x, p.y, 1.0)).z;
    // A thousandth of the known point's depth is hundreds of metres away: the horizon for all that a sheet can tell.
    (depth(point) / depth(known) > 1e-3)
        .then(|| map.map(point))
        .flatten()
}
