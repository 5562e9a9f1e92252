//! From pixels to the floor in the vehicle frame and back.

use senda_geom::{Camera, Homography, Vec2};

/// Takes pixels of one image size (u right, v down, pixel centres at +0.5) to floor points in the vehicle frame
/// (x forward, y left, m; origin below the axle's centre) and back.
#[derive(Debug, Clone)]
pub struct FloorMap {
    width: usize,
    height: usize,
    camera: Option<Camera>,
    floor_from_image: Option<Homography>,
}

impl FloorMap {
    /// For a camera delivering frames of `width` x `height` px (its own size or another).
    pub fn from_camera(camera: &Camera, width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            camera: Some(camera.resized(width as u32, height as u32)),
            floor_from_image: None,
        }
    }

    /// From a calibration: `floor_from_image` maps pixels of an image of `calibrated_width` x `calibrated_height` to
    /// the floor (m); the map is for frames of `width` x `height` (C6).
    pub fn from_homography(
        floor_from_image: &Homography,
        calibrated_width: usize,
        calibrated_height: usize,
        width: usize,
        height: usize,
    ) -> Self {
        let _ = (calibrated_width, calibrated_height);
        Self {
            width,
            height,
            camera: None,
            floor_from_image: Some(*floor_from_image),
        }
    }

    /// Width of the frames that this map is for (px).
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height of the frames that this map is for (px).
    pub fn height(&self) -> usize {
        self.height
    }

    /// The floor point (vehicle frame, m) that a pixel sees; `None` at or above the horizon.
    pub fn floor(&self, pixel: Vec2) -> Option<Vec2> {
        match (&self.camera, &self.floor_from_image) {
            (Some(camera), _) => camera.floor_from_pixel(pixel),
            (None, Some(homography)) => homography.map(pixel),
            (None, None) => None,
        }
    }

    /// The pixel on which a floor point (vehicle frame, m) falls, inside the image or not; `None` behind the camera.
    pub fn pixel(&self, floor: Vec2) -> Option<Vec2> {
        match (&self.camera, &self.floor_from_image) {
            (Some(camera), _) => camera.pixel_from_floor(floor),
            (None, Some(homography)) => homography.inverse()?.map(floor),
            (None, None) => None,
        }
    }
}
