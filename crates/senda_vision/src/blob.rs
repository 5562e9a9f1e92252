//! One connected component of the thresholded residue, described by its moments (C5 in SPEC).

use crate::components::Moments;
use crate::{BlobLimits, WidthProfile};
use senda_geom::{Vec2, trig};

/// The middle of a blob in one row: where one run of its pixels lies.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RowPoint {
    /// Row centre (px, so row index + 0.5).
    pub v: f64,
    /// Middle of the line (px): of the run, weighted with the residue, so finer than a pixel. Where the picture's edge
    /// cuts the run: half the line's expected width from the end that is visible, so it may lie outside.
    pub u: f64,
    /// Length of the run (px).
    pub width_px: f64,
    /// Whether the left or right edge of the image cuts the run: then `u` is an estimate.
    pub at_edge: bool,
}

/// A component that may be a line. Coordinates in pixels of the image, u right, v down, pixel centres at +0.5.
#[derive(Debug, PartialEq, Default)]
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

impl Clone for LineBlob {
    fn clone(&self) -> Self {
        Self {
            rows: self.rows.clone(),
            ..*self
        }
    }

    /// Keeps the memory of the rows, which a derived one would not.
    fn clone_from(&mut self, source: &Self) {
        let mut rows = std::mem::take(&mut self.rows);
        rows.clone_from(&source.rows);
        *self = Self { rows, ..*source };
    }
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

    /// The part of its rows that the picture's edge does not cut, 0..=1.
    pub fn whole_part(&self) -> f64 {
        let whole = self.rows.iter().filter(|row| !row.at_edge).count();
        whole as f64 / self.rows.len().max(1) as f64
    }

    /// Takes over everything that follows from the sums over its pixels, and empties the rows.
    pub(crate) fn set_moments(&mut self, moments: &Moments, scale: &Scale) {
        let n = moments.count as f64;
        // Exact integers before the division: no cancellation, however far the blob is from the corner.
        let spread = |product: u64, a: u64, b: u64| {
            let exact = i128::from(moments.count) * i128::from(product) - i128::from(a) * i128::from(b);
            exact as f64 / (n * n)
        };
        // A pixel is a square, whose own variance is 1/12: a row of single pixels has a thickness.
        let uu = spread(moments.xx, moments.x, moments.x) + 1.0 / 12.0;
        let vv = spread(moments.yy, moments.y, moments.y) + 1.0 / 12.0;
        let uv = spread(moments.xy, moments.x, moments.y);
        self.area_px = n;
        self.bounds = [moments.left, moments.top, moments.right, moments.bottom].map(f64::from);
        self.centroid = Vec2::new(moments.x as f64 / n + 0.5, moments.y as f64 / n + 0.5);
        self.set_shape(uu, uv, vv, scale);
        self.residue_mean = 0.0;
        self.rows.clear();
    }

    /// Axes and score from the variances and the covariance of its pixels; area and box must be set.
    pub(crate) fn set_shape(&mut self, uu: f64, uv: f64, vv: f64, scale: &Scale) {
        let (mean, half) = ((uu + vv) / 2.0, (uu - vv) / 2.0);
        let radius = (half * half + uv * uv).sqrt();
        self.lambda_max_px2 = mean + radius;
        self.lambda_min_px2 = (mean - radius).max(1.0 / 12.0);
        self.ellipticity = (self.lambda_max_px2 / self.lambda_min_px2).sqrt();
        // The long axis is (sin φ, cos φ) in (u, v): its upper end leans left when u grows with v.
        self.orientation_rad = if radius > 0.0 {
            0.5 * trig::atan2(2.0 * uv, vv - uu)
        } else {
            0.0
        };
        self.score = (7.0 * self.box_area_px() + self.area_px) * scale.size_factor + 150.0 * self.ellipticity;
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
    /// Its width scatters too much for a painted line: a cluster of speckles.
    Uneven,
    /// Stands out no more than noise does.
    Faint,
}

/// How an image's size relates to the 320x240 that the limits are given for (C6 in SPEC).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    width: f64,
    height: f64,
    /// 320 · 240 / (width · height).
    size_factor: f64,
}

impl Scale {
    /// For images of this size (px).
    pub fn new(width: usize, height: usize) -> Self {
        let (width, height) = (width as f64, height as f64);
        Self {
            width,
            height,
            size_factor: 320.0 * 240.0 / (width * height).max(1.0),
        }
    }

    /// The area (px²) that a blob must exceed.
    pub fn area_min(&self, limits: &BlobLimits) -> f64 {
        self.width * self.height * limits.area_part
    }

    /// Whether a blob is about as wide as a line; `profile` is for the image in use.
    pub(crate) fn is_fragment(&self, blob: &LineBlob, profile: &WidthProfile) -> bool {
        // Measured: dashes 1.0 to 1.3 (more where they lean), specks of a speckled floor 0.5 to 0.95. Tape of 1.5 cm
        // where 2 cm are expected should pass too.
        mean_width(blob, profile).is_some_and(|width| (0.75..2.5).contains(&width))
    }

    /// Whether a blob may contain a piece of a line: a reflection that melts with one makes it wider.
    pub(crate) fn is_piece(&self, blob: &LineBlob, profile: &WidthProfile) -> bool {
        mean_width(blob, profile).is_some_and(|width| (0.75..4.0).contains(&width))
    }

    /// Whether a blob stands out and its rows have the even width of a painted line; `profile` is for the image in use.
    /// Widths of blobs with few whole rows pass: they say too little.
    pub fn check_paint(
        &self,
        blob: &LineBlob,
        profile: &WidthProfile,
        limits: &BlobLimits,
    ) -> Result<(), Rejection> {
        if blob.residue_mean <= limits.strength {
            return Err(Rejection::Faint);
        }
        let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for row in blob.rows.iter().filter(|row| !row.at_edge) {
            let part = row.width_px / profile.at(row.v).max(1.0);
            n += 1.0;
            sum += part;
            squares += part * part;
        }
        if n < 8.0 {
            return Ok(());
        }
        let mean = sum / n;
        let scatter = (squares / n - mean * mean).max(0.0).sqrt() / mean;
        if scatter > limits.width_scatter * mean.max(1.0) {
            Err(Rejection::Uneven)
        } else {
            Ok(())
        }
    }

    /// Whether a blob passes all limits of C5 in SPEC; if not, the first one that it fails.
    pub fn check(&self, blob: &LineBlob, limits: &BlobLimits) -> Result<(), Rejection> {
        let side = self.width * limits.side_part;
        let part = blob.area_px / blob.box_area_px();
        let compact = |[fill, ellipticity, score]: &[f64; 3]| {
            part > *fill && blob.ellipticity < *ellipticity && blob.score < *score
        };
        let failures = [
            (blob.area_px <= self.area_min(limits), Rejection::Area),
            (blob.ellipticity <= limits.ellipticity, Rejection::Ellipticity),
            (blob.score <= limits.score, Rejection::Score),
            (
                blob.lambda_min_px2 * self.size_factor <= limits.lambda_min_px2,
                Rejection::LambdaMin,
            ),
            (
                blob.lambda_max_px2 * self.size_factor <= limits.lambda_max_px2,
                Rejection::LambdaMax,
            ),
            (
                blob.centroid.x <= side || blob.centroid.x >= self.width - side,
                Rejection::Side,
            ),
            (
                blob.orientation_rad.abs() > limits.orientation_rad,
                Rejection::Orientation,
            ),
            (limits.compact.iter().any(compact), Rejection::Compact),
        ];
        match failures.iter().find(|(failed, _)| *failed) {
            Some((_, rejection)) => Err(*rejection),
            None => Ok(()),
        }
    }
}

/// Mean width of a blob's whole rows as a multiple of the expected width; `None` with fewer than three.
fn mean_width(blob: &LineBlob, profile: &WidthProfile) -> Option<f64> {
    let (mut n, mut sum) = (0.0, 0.0);
    for row in blob.rows.iter().filter(|row| !row.at_edge) {
        n += 1.0;
        sum += row.width_px / profile.at(row.v).max(1.0);
    }
    (n >= 3.0).then(|| sum / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::Components;

    /// The moments of the pixels of a picture that `inside` holds for (u, v at pixel centres).
    fn blob(width: usize, height: usize, inside: impl Fn(f64, f64) -> bool) -> LineBlob {
        let mut components = Components::with_size(width, height);
        let mut row = vec![0; width.next_multiple_of(8)];
        components.label(height, &mut row, |y, row| {
            for (x, bit) in row[..width].iter_mut().enumerate() {
                *bit = u8::from(inside(x as f64 + 0.5, y as f64 + 0.5));
            }
        });
        assert_eq!(components.moments().len(), 1);
        let mut blob = LineBlob::default();
        blob.set_moments(&components.moments()[0], &Scale::new(width, height));
        blob
    }

    /// A bar of 320x240 around (u, v), leaning left by `lean`, in a picture of another size.
    fn bar(size: (usize, usize), centre: (f64, f64), lean: f64, length: f64, thickness: f64) -> LineBlob {
        let scale = size.0 as f64 / 320.0;
        let (sin, cos) = trig::sincos(lean);
        blob(size.0, size.1, |u, v| {
            let (u, v) = (u / scale - centre.0, v / scale - centre.1);
            (u * sin + v * cos).abs() < length / 2.0 && (u * cos - v * sin).abs() < thickness / 2.0
        })
    }

    const SIZE: (usize, usize) = (320, 240);

    #[test]
    fn moments_of_a_bar_are_those_of_a_rectangle() {
        for lean in [-1.2, -0.6, 0.0, 0.3, 1.0, 1.5] {
            let blob = bar(SIZE, (160.0, 120.0), lean, 150.0, 20.0);
            assert!((blob.centroid - Vec2::new(160.0, 120.0)).length() < 0.1);
            assert!(
                (blob.orientation_rad - lean).abs() < 2e-3,
                "{lean}: {}",
                blob.orientation_rad
            );
            assert!(
                (blob.lambda_max_px2 - 150.0 * 150.0 / 12.0).abs() < 20.0,
                "{}",
                blob.lambda_max_px2
            );
            assert!(
                (blob.lambda_min_px2 - 20.0 * 20.0 / 12.0).abs() < 1.0,
                "{}",
                blob.lambda_min_px2
            );
            assert!((blob.ellipticity - 7.5).abs() < 0.15);
            let expected = 7.0 * blob.box_area_px() + blob.area_px + 150.0 * blob.ellipticity;
            assert!((blob.score - expected).abs() < 1e-6);
            let [first, second] = blob.two_points(10.0);
            assert!((second.y - first.y + 10.0).abs() < 1e-9);
            // Left-leaning is positive: further up is further left.
            assert!(lean == 0.0 || (second.x < first.x) == (lean > 0.0));
        }
    }

    #[test]
    fn every_limit_refuses_what_it_is_for() {
        let limits = BlobLimits::default();
        let check = |size: (usize, usize), blob: &LineBlob| Scale::new(size.0, size.1).check(blob, &limits);
        // The same things in pictures of every size (C6).
        for size in [(123, 92), (160, 120), SIZE, (640, 480)] {
            let at =
                |centre, lean, length, thickness| check(size, &bar(size, centre, lean, length, thickness));
            let middle = (160.0, 120.0);
            assert_eq!(at(middle, 0.2, 200.0, 20.0), Ok(()), "{size:?}");
            assert_eq!(at(middle, 0.0, 11.0, 8.5), Err(Rejection::Area), "{size:?}");
            assert_eq!(
                at(middle, 0.0, 120.0, 100.0),
                Err(Rejection::Ellipticity),
                "{size:?}"
            );
            assert_eq!(at(middle, 0.0, 90.0, 20.0), Err(Rejection::Score), "{size:?}");
            assert_eq!(
                at((5.0, 120.0), 0.0, 220.0, 20.0),
                Err(Rejection::Side),
                "{size:?}"
            );
            assert_eq!(
                at((315.0, 120.0), 0.0, 220.0, 20.0),
                Err(Rejection::Side),
                "{size:?}"
            );
            assert_eq!(
                at(middle, 1.31, 220.0, 24.0),
                Err(Rejection::Orientation),
                "{size:?}"
            );
            assert_eq!(
                at(middle, -1.31, 220.0, 24.0),
                Err(Rejection::Orientation),
                "{size:?}"
            );
            assert_eq!(at(middle, 1.2, 220.0, 24.0), Ok(()), "{size:?}");
            assert_eq!(at(middle, 0.0, 120.0, 40.0), Err(Rejection::Compact), "{size:?}");
        }
        // Thinner than a pixel cannot be drawn in the small pictures.
        let thin = |size| check(size, &bar(size, (160.0, 120.0), 0.5, 230.0, 4.0));
        assert_eq!(thin(SIZE), Err(Rejection::LambdaMin));
        assert_eq!(thin((640, 480)), Err(Rejection::LambdaMin));
        let mut short = bar(SIZE, (160.0, 120.0), 0.0, 200.0, 20.0);
        short.lambda_max_px2 = 15.0;
        assert_eq!(check(SIZE, &short), Err(Rejection::LambdaMax));
    }

    #[test]
    fn the_three_compact_limits_hold_together() {
        let limits = BlobLimits::default();
        let scale = Scale::new(320, 240);
        let with = |fill: f64, ellipticity: f64, score: f64| {
            let mut blob = bar(SIZE, (160.0, 120.0), 0.2, 200.0, 20.0);
            blob.area_px = fill * blob.box_area_px();
            (blob.ellipticity, blob.score) = (ellipticity, score);
            scale.check(&blob, &limits)
        };
        for (fill, ellipticity, score) in [(0.6, 3.8, 50_000.0), (0.4, 4.0, 35_000.0), (0.3, 5.0, 27_500.0)] {
            assert_eq!(
                with(fill + 0.01, ellipticity - 0.01, score - 1.0),
                Err(Rejection::Compact)
            );
            // What is a little less compact, more slender or larger must only pass the next milder row.
            assert_eq!(with(fill + 0.01, 5.0, score - 1.0), Ok(()));
            assert_eq!(with(0.3, ellipticity - 0.01, score - 1.0), Ok(()));
        }
        assert_eq!(with(0.9, 2.0, 50_000.0), Ok(()));
    }

    #[test]
    fn clusters_of_uneven_width_are_no_lines() {
        let profile = WidthProfile {
            intercept_px: 20.0,
            slope_px_per_row: 0.0,
            width_px: 320,
            height_px: 240,
        };
        let limits = BlobLimits::default();
        let scale = Scale::new(320, 240);
        let with_widths = |width_of: &dyn Fn(usize) -> f64, at_edge: bool| {
            let rows = (0..100)
                .map(|y| RowPoint {
                    v: y as f64 + 0.5,
                    u: 100.0,
                    width_px: width_of(y),
                    at_edge,
                })
                .collect();
            let blob = LineBlob {
                rows,
                residue_mean: 20.0,
                ..LineBlob::default()
            };
            scale.check_paint(&blob, &profile, &limits)
        };
        assert_eq!(with_widths(&|_| 22.0, false), Ok(()));
        assert_eq!(with_widths(&|_| 60.0, false), Ok(()));
        assert_eq!(
            with_widths(&|y| if y % 2 == 0 { 8.0 } else { 20.0 }, false),
            Err(Rejection::Uneven)
        );
        assert_eq!(
            with_widths(&|y| if y % 2 == 0 { 8.0 } else { 20.0 }, true),
            Ok(())
        );
    }
}
