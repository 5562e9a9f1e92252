//! One connected component of the thresholded residue, described by its moments (C5 in SPEC).

use senda_geom::{Vec2, trig};

/// The middle of a blob in one row: where one run of its pixels lies.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RowPoint {
    /// Row centre (px, so row index + 0.5).
    pub v: f64,
    /// Middle of the run (px), weighted with the residue, so finer than a pixel.
    pub u: f64,
    /// Length of the run (px).
    pub width_px: f64,
    /// Whether the run touches the left or right edge of the image: then `u` is the middle of what is visible, not
    /// of the line.
    pub at_edge: bool,
}

/// A component that may be a line. Coordinates in pixels of the image, u right, v down, pixel centres at +0.5.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LineBlob {
    /// Number of pixels.
    pub area_px: f64,
    /// Bounding box: left, top, right, bottom (px); right and bottom are the outer edges of the last pixels.
    pub bounds: [f64; 4],
    /// Centre of mass (px).
    pub centroid: Vec2,
    /// Angle of the long axis (rad), in (-π/2, π/2]: 0 is vertical in the image, positive when the upper end leans
    /// to the **left**. (The document's figure 53 counts the other way round: it adds `Dy·tan θ` to the column.)
    pub orientation_rad: f64,
    /// √(λmax/λmin); at least 1.
    pub ellipticity: f64,
    /// Variance of the pixels along the short axis (px²).
    pub lambda_min_px2: f64,
    /// Variance of the pixels along the long axis (px²).
    pub lambda_max_px2: f64,
    /// (7 · box + area) · size factor + 150 · ellipticity; the size factor is 320·240/(W·H), so that scores compare
    /// between image sizes.
    pub score: f64,
    /// Mean residue over the blob, in grey levels: how much it stands out from the floor.
    pub residue_mean: f64,
    /// Middle points from top to bottom; several in a row where the blob bends back.
    pub rows: Vec<RowPoint>,
}

impl LineBlob {
    /// Unit vector along the long axis, pointing up in the image (u, v; v negative).
    pub fn axis(&self) -> Vec2 {
        let (sin, cos) = trig::sincos(self.orientation_rad);
        Vec2::new(-sin, -cos)
    }

    /// The centroid and a second point `rows_up_px` rows further up along the orientation (C9 in SPEC takes 10 px at
    /// 320x240).
    pub fn two_points(&self, rows_up_px: f64) -> [Vec2; 2] {
        let lean = trig::tan(self.orientation_rad);
        [
            self.centroid,
            self.centroid + Vec2::new(-lean * rows_up_px, -rows_up_px),
        ]
    }

    /// Area of the bounding box (px²).
    pub fn box_area_px(&self) -> f64 {
        (self.bounds[2] - self.bounds[0]) * (self.bounds[3] - self.bounds[1])
    }
}

/// Which limit of C5 in SPEC a component failed first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rejection {
    /// Area not above W·H/750.
    Area,
    /// Not elongated enough.
    Ellipticity,
    /// Score not above 25,000.
    Score,
    /// Too thin.
    LambdaMin,
    /// Too short.
    LambdaMax,
    /// Centroid in the outer 1/32 of the width.
    Side,
    /// Leans by more than 72°.
    Orientation,
    /// Fills its box, is not slender and not large: a stain or a reflection.
    Compact,
}
