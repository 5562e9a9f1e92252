//! Where to mount a camera: view angles, and tilt and height against what the camera sees of the floor (C2 in SPEC).
//!
//! ```
//! use senda_vision::calibration::placement;
//! // An A4 page upright on a wall 84 cm away fills 219 of the image's 480 rows.
//! let view_rad = placement::view_angle_rad(219.0, 480.0, 0.297, 0.84).unwrap();
//! assert!((view_rad.to_degrees() - 42.3).abs() < 0.1);
//! // Camera 9.5 cm high, tilted 33° down: sees the floor from 6.9 cm to 45 cm ahead of itself.
//! let view = placement::floor_view(0.095, 33f64.to_radians(), view_rad);
//! assert!((view.near_m - 0.069).abs() < 0.001 && (view.far_m - 0.45).abs() < 0.005);
//! ```

use senda_geom::trig;
use std::f64::consts::FRAC_PI_2;

/// View angle (rad) of a camera along one axis of its image, from a photograph of a page that is parallel to the image:
/// the page's extent (px) and the image's (px) along that axis, the page's true extent and its distance to the lens (m).
/// `None` unless all are positive, and the page no larger than the image.
pub fn view_angle_rad(page_px: f64, image_px: f64, page_m: f64, distance_m: f64) -> Option<f64> {
    let positive = [page_px, image_px, page_m, distance_m]
        .iter()
        .all(|x| x.is_finite() && *x > 0.0);
    (positive && page_px <= image_px)
        .then(|| 2.0 * trig::atan(image_px * page_m / page_px / 2.0 / distance_m))
}

/// The stretch of floor ahead of the lens that the middle column of the image shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorView {
    /// Where it begins: what the lower edge of the image sees (m ahead of the lens, along the floor). Negative when
    /// the camera also sees floor behind the point below the lens.
    pub near_m: f64,
    /// Where it ends: what the upper edge sees; infinite when that looks at or above the horizon.
    pub far_m: f64,
}

/// What a camera `height_m` above the floor, tilted `tilt_rad` down, with a vertical view angle of `view_rad` sees:
/// near = h·tan(90° - tilt - view/2), far = h·tan(90° - tilt + view/2) (the document's eq. 11 in general form).
pub fn floor_view(height_m: f64, tilt_rad: f64, view_rad: f64) -> FloorView {
    // Beyond a right angle from straight down the ray never meets the floor (ahead or behind).
    let reach = |from_vertical_rad: f64| {
        if from_vertical_rad >= FRAC_PI_2 - 1e-12 {
            f64::INFINITY
        } else if from_vertical_rad <= -FRAC_PI_2 + 1e-12 {
            f64::NEG_INFINITY
        } else {
            height_m * trig::tan(from_vertical_rad)
        }
    };
    FloorView {
        near_m: reach(FRAC_PI_2 - tilt_rad - view_rad / 2.0),
        far_m: reach(FRAC_PI_2 - tilt_rad + view_rad / 2.0),
    }
}

/// The tilts (rad) worth using: from the one where the image's upper edge looks at the horizon to the one where its lower
/// edge looks straight down.
pub fn useful_tilts_rad(view_rad: f64) -> [f64; 2] {
    [view_rad / 2.0, FRAC_PI_2 - view_rad / 2.0]
}

/// One row of [`table`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltRow {
    /// Tilt down from the horizontal (rad).
    pub tilt_rad: f64,
    /// What the camera sees at that tilt.
    pub view: FloorView,
}

/// Tilt against near and far limit over the useful tilts, every `step_rad` (at least 0.01°), the last one included.
pub fn table(height_m: f64, view_rad: f64, step_rad: f64) -> Vec<TiltRow> {
    let [first, last] = useful_tilts_rad(view_rad);
    let step_rad = step_rad.max(1e-4 * std::f64::consts::PI / 1.8);
    let mut rows = Vec::new();
    let mut index = 0.0;
    loop {
        let tilt_rad = (first + index * step_rad).min(last);
        rows.push(TiltRow {
            tilt_rad,
            view: floor_view(height_m, tilt_rad, view_rad),
        });
        // Also ends on a view angle that is not a number.
        if !(tilt_rad < last) {
            return rows;
        }
        index += 1.0;
    }
}

/// The tilt (rad) at which the view begins `near_m` ahead of the lens.
pub fn tilt_for_near_rad(height_m: f64, near_m: f64, view_rad: f64) -> f64 {
    FRAC_PI_2 - view_rad / 2.0 - trig::atan2(near_m, height_m)
}

/// The tilt (rad) at which the view ends `far_m` ahead of the lens.
pub fn tilt_for_far_rad(height_m: f64, far_m: f64, view_rad: f64) -> f64 {
    FRAC_PI_2 + view_rad / 2.0 - trig::atan2(far_m, height_m)
}

/// Height (m) and tilt (rad) at which the camera sees the floor exactly from `near_m` to `far_m` ahead of the lens. Of the two
/// solutions the lower mounting comes first; the higher one looks more steeply down. `None` when the view angle is too
/// wide to show only that stretch, or the limits are not 0 < near < far.
pub fn mountings_for(near_m: f64, far_m: f64, view_rad: f64) -> Option<[(f64, f64); 2]> {
    if !(near_m > 0.0 && far_m > near_m && view_rad > 0.0 && view_rad < FRAC_PI_2) {
        return None;
    }
    // atan(far/h) - atan(near/h) = view  <=>  tan(view)·h² - (far - near)·h + tan(view)·near·far = 0.
    let tangent = trig::tan(view_rad);
    let stretch = far_m - near_m;
    let discriminant = stretch * stretch - 4.0 * tangent * tangent * near_m * far_m;
    if !(discriminant >= 0.0) {
        return None;
    }
    let root = discriminant.sqrt();
    Some([-root, root].map(|root| {
        let height_m = (stretch + root) / (2.0 * tangent);
        (height_m, tilt_for_far_rad(height_m, far_m, view_rad))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_documents_view_angles() {
        let vertical = view_angle_rad(351.0 - 132.0, 480.0, 0.297, 0.84).unwrap();
        let horizontal = view_angle_rad(400.0 - 243.0, 640.0, 0.21, 0.84).unwrap();
        assert!(
            (vertical.to_degrees() - 42.3).abs() < 0.1,
            "{}",
            vertical.to_degrees()
        );
        assert!(
            (horizontal.to_degrees() - 54.0).abs() < 0.1,
            "{}",
            horizontal.to_degrees()
        );
        assert!(view_angle_rad(0.0, 480.0, 0.297, 0.84).is_none());
        assert!(view_angle_rad(219.0, 480.0, f64::NAN, 0.84).is_none());
    }

    #[test]
    fn the_documents_limits_and_tilt() {
        let view = 42.3f64.to_radians();
        let [least, most] = useful_tilts_rad(view).map(f64::to_degrees);
        assert!((least - 21.15).abs() < 1e-9 && (most - 68.85).abs() < 1e-9);
        for tilt in [25.0f64, 33.0, 60.0] {
            let seen = floor_view(0.095, tilt.to_radians(), view);
            assert!((seen.near_m - 0.095 * trig::tan((68.85 - tilt).to_radians())).abs() < 1e-12);
            assert!((seen.far_m - 0.095 * trig::tan((111.15 - tilt).to_radians())).abs() < 1e-12);
        }
        // 50 cm far and 7 cm near ask for "about 33°": 31.9° and 32.4° to the digit.
        let far = tilt_for_far_rad(0.095, 0.5, view).to_degrees();
        let near = tilt_for_near_rad(0.095, 0.07, view).to_degrees();
        assert!(
            (far - 31.91).abs() < 0.01 && (near - 32.45).abs() < 0.05,
            "{far} {near}"
        );
    }

    #[test]
    fn at_the_least_tilt_the_view_reaches_the_horizon_and_at_the_largest_the_point_below() {
        let rows = table(0.095, 42.3f64.to_radians(), 5f64.to_radians());
        assert_eq!(rows.len(), 11);
        assert_eq!(rows[0].view.far_m, f64::INFINITY);
        assert!(rows.last().unwrap().view.near_m.abs() < 1e-12);
        assert!(
            rows.windows(2)
                .all(|w| w[1].view.near_m < w[0].view.near_m && w[1].view.far_m < w[0].view.far_m)
        );
        assert_eq!(floor_view(0.1, 1.6, 3.1).near_m, f64::NEG_INFINITY);
    }

    proptest! {
        #[test]
        fn wanted_limits_come_back(height in 0.05..0.5f64, near in 0.02..0.5f64, stretch in 0.05..2.0f64, view in 0.3..1.5f64) {
            let tilt = tilt_for_near_rad(height, near, view);
            prop_assert!((floor_view(height, tilt, view).near_m - near).abs() < 1e-9);
            let far = near + stretch;
            let tilt = tilt_for_far_rad(height, far, view);
            prop_assert!((floor_view(height, tilt, view).far_m - far).abs() < 1e-9);
            if let Some(mountings) = mountings_for(near, far, view) {
                for (height, tilt) in mountings {
                    let seen = floor_view(height, tilt, view);
                    prop_assert!((seen.near_m - near).abs() < 1e-6 && (seen.far_m - far).abs() < 1e-6);
                }
            }
        }
    }
}
