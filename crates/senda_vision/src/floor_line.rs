//! Lines on the floor: fits through points, and the vehicle's state relative to them (C9 and C17 in SPEC).

use crate::{FloorMap, LineBlob};
use senda_geom::Vec2;

/// The vehicle relative to a line, both as seen along the line's direction (the way that leads away from the
/// vehicle): the document's \[d, θ\] (C9 in SPEC) in SI, with ḋ = v·sin θ.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LineState {
    /// Distance of the axle's centre from the line (m): positive when the vehicle is to the **left** of the line.
    pub d_m: f64,
    /// Heading of the vehicle against the line (rad): positive when it points to the left of the line's direction.
    pub theta_rad: f64,
    /// Curvature of the line (1/m), left positive; 0 for a straight fit.
    pub curvature_per_m: f64,
}

/// A piece of line on the floor in the vehicle frame: an arc through `point`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FloorLine {
    /// A point of the line (m), in the middle of the points that it was fitted to.
    pub point: Vec2,
    /// Direction there (rad), 0 = the vehicle's forward, left positive; within ±π/2 of away from the vehicle.
    pub heading_rad: f64,
    /// Curvature (1/m), left positive.
    pub curvature_per_m: f64,
    /// Standard error of the curvature (1/m), from the scatter of the points; 0 for a straight fit.
    pub curvature_error_per_m: f64,
    /// Where the fitted points begin, along the tangent, relative to `point` (m, negative).
    pub start_m: f64,
    /// Where they end (m, positive).
    pub end_m: f64,
    /// Weighted root mean square distance of the points (m).
    pub rms_m: f64,
}

impl FloorLine {
    /// The straight line through two points, directed from the first to the second.
    pub fn through(first: Vec2, second: Vec2) -> Option<Self> {
        let _ = (first, second);
        None
    }

    /// C9: through the blob's centroid and a second point 10 px (at 240 rows) further up along its orientation.
    pub fn from_blob_axis(blob: &LineBlob, map: &FloorMap) -> Option<Self> {
        let _ = (blob, map);
        None
    }

    /// The vehicle's \[d, θ\] relative to this line, whose arc is continued to the vehicle.
    pub fn state(&self) -> LineState {
        LineState::default()
    }

    /// Distance of a floor point (vehicle frame, m) from the line's arc, positive to its left (m).
    pub fn offset_of(&self, point: Vec2) -> f64 {
        let _ = point;
        0.0
    }

    /// The point `distance_m` along the arc from `point`.
    pub fn at(&self, distance_m: f64) -> Vec2 {
        let _ = distance_m;
        self.point
    }
}

/// Fits lines to points on the floor; owns the memory that this needs.
#[derive(Debug, Clone, Default)]
pub struct LineFitter {
    points: Vec<Vec2>,
}

impl LineFitter {
    /// An empty fitter.
    pub fn new() -> Self {
        Self::default()
    }

    /// A robust straight line through the middle points of the blobs. `None` with fewer than 3 points on the floor.
    pub fn straight<'a>(
        &mut self,
        blobs: impl IntoIterator<Item = &'a LineBlob>,
        map: &FloorMap,
    ) -> Option<FloorLine> {
        let _ = (blobs.into_iter().count(), map, &self.points);
        None
    }

    /// A robust arc through the middle points of the blobs. Falls back to a straight line with fewer than 5 points.
    pub fn arc<'a>(
        &mut self,
        blobs: impl IntoIterator<Item = &'a LineBlob>,
        map: &FloorMap,
    ) -> Option<FloorLine> {
        self.straight(blobs, map)
    }
}
