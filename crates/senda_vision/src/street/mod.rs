//! Streets of document D: the green line in their middle, red crossings across them, junctions where they meet.
//!
//! [`StreetEyes`] looks at a frame once: it shrinks it (which is the low-pass filter of D2 in SPEC), finds green and red with
//! limits that follow the light ([`colours`], D3), puts both on the floor and makes of them a [`StreetView`]: the line from the
//! vehicle outwards ([`trace`], D2), the crossing ahead ([`crossing`], D4) and the junction ([`junction`], D5). The document
//! works with rows and columns of one camera; here everything is measured on the floor, so any camera will do.

pub mod colours;
pub mod crossing;
pub mod junction;
pub mod trace;

use crate::FloorMap;
use crate::street::colours::{ColourLimits, Limits};
use senda_core::{Channels, Image};
use senda_geom::{Camera, Vec2};

pub use crossing::{Crossing, Red};
pub use junction::{FarLine, Junction};
pub use trace::{Cluster, Trace};

/// Frames are shrunk by the whole factor that leaves at least this width (px).
const WORKING_WIDTH_PX: usize = 240;
/// Floor beyond this (m from the vehicle's origin) is not looked at: a row of pixels spans 4 cm there.
const FAR_M: f64 = 1.5;

/// What one frame shows of the street. Floor points are in the vehicle frame (x forward, y left, m).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StreetView {
    /// The line, from the vehicle outwards; empty when none is seen.
    pub line: Trace,
    /// The red crossing ahead.
    pub crossing: Option<Crossing>,
    /// The junction ahead.
    pub junction: Option<Junction>,
    /// The limits in use for this frame's light (D3).
    pub limits: Limits,
}

/// Finds streets in the frames of one camera. Reused between frames: allocates only while it warms up.
#[derive(Debug, Clone)]
pub struct StreetEyes {
    factor: usize,
    width: usize,
    height: usize,
    /// Floor point of every working pixel as x, y (m), and the area that it shows (m²); x is NaN where there is none within
    /// reach.
    floor: Vec<[f32; 3]>,
    map: FloorMap,
    small: Image,
    colours: ColourLimits,
    rings: trace::Rings,
    red: Vec<Red>,
    view: StreetView,
}

impl StreetEyes {
    /// For a camera that delivers frames of `width` x `height` px.
    pub fn new(camera: &Camera, width: usize, height: usize, colours: ColourLimits) -> Self {
        let factor = (width / WORKING_WIDTH_PX).max(1);
        let (small_width, small_height) = (width / factor, height / factor);
        let map = FloorMap::from_camera(camera, small_width, small_height);
        let floor = (0..small_width * small_height)
            .map(|index| {
                let (u, v) = (index % small_width, index / small_width);
                let at = |right: f64, down: f64| {
                    map.floor(Vec2::new(u as f64 + 0.5 + right, v as f64 + 0.5 + down))
                };
                match at(0.0, 0.0) {
                    Some(point) if point.length() < FAR_M && point.x > 0.0 => {
                        let side = |other: Option<Vec2>| other.unwrap_or(point) - point;
                        let area_m2 = side(at(1.0, 0.0)).perp_dot(side(at(0.0, 1.0))).abs();
                        [point.x as f32, point.y as f32, area_m2 as f32]
                    }
                    _ => [f32::NAN; 3],
                }
            })
            .collect();
        Self {
            factor,
            width: small_width,
            height: small_height,
            floor,
            map,
            small: Image::default(),
            colours,
            rings: trace::Rings::default(),
            red: Vec::new(),
            view: StreetView::default(),
        }
    }

    /// Whether it is for frames of this size.
    pub fn fits(&self, frame: &Image) -> bool {
        self.factor == (frame.width() / WORKING_WIDTH_PX).max(1)
            && (self.width, self.height) == (frame.width() / self.factor, frame.height() / self.factor)
            && frame.channels() == Channels::Rgb
    }

    /// Looks at an RGB frame of its size; others show nothing. `expected` is where the line should be, as a distance to the
    /// left at the near end of the view (m), and how far from there it may be.
    pub fn look(&mut self, frame: &Image, expected: trace::Expected) -> &StreetView {
        self.view.line.points.clear();
        (self.view.crossing, self.view.junction) = (None, None);
        if !self.fits(frame) {
            return &self.view;
        }
        colours::shrink(frame, self.factor, &mut self.small);
        let limits = self.colours.for_light(colours::lightness(&self.small));
        self.view.limits = limits;
        self.rings.clear();
        self.red.clear();
        let pixels = self.small.pixels().as_chunks::<3>().0;
        for (pixel, floor) in pixels.iter().zip(&self.floor) {
            // Grey pixels are most: the cheapest test first.
            if floor[0].is_nan()
                || pixel.iter().max() < pixel.iter().min().map(|least| least.saturating_add(20)).as_ref()
            {
                continue;
            }
            let [x, y, area_m2] = floor.map(f64::from);
            let hsv = crate::hsv(*pixel);
            if limits.green.contains(hsv) {
                self.rings.push(Vec2::new(x, y));
            } else if limits.red.contains(hsv) {
                self.red.push(Red {
                    at: Vec2::new(x, y),
                    area_m2,
                });
            }
        }
        self.rings.cluster();
        self.rings.trace(expected, &mut self.view.line);
        self.view.crossing = crossing::find(&self.red);
        self.view.junction = junction::find(&self.rings, &self.view.line);
        &self.view
    }

    /// Green clusters of the last frame near a line y = `intercept_m` + `slope`·x and at least `from_m` ahead, as a fit of
    /// them: for crossing a junction (D6). `None`: too few.
    pub fn line_near(&self, intercept_m: f64, slope: f64, gate_m: f64, from_m: f64) -> Option<FarLine> {
        junction::fit_near(&self.rings, intercept_m, slope, gate_m, from_m)
    }

    /// What was last seen.
    pub fn view(&self) -> &StreetView {
        &self.view
    }

    /// Pixel of the original frame on which a floor point falls, for drawings.
    pub fn pixel(&self, floor: Vec2) -> Option<[f32; 2]> {
        let at = self.map.pixel(floor)? * self.factor as f64;
        Some([at.x as f32, at.y as f32])
    }
}

#[cfg(test)]
mod tests;
