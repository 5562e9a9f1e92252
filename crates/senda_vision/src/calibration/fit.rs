//! From eight corners to the calibration: homography, mounting, placement and line width.

use super::corners::{Found, fit_limit_px, misses};
use super::edges::pinhole_part;
use super::model::{Calibration, Placement, Reprojection};
use super::picture::Picture;
use super::{CalibrationError, CalibrationOptions, Sheet, WidthProfile};
use senda_geom::{Camera, Homography, Lens, Mat3, Mounting, Vec2, Vec3, trig};

/// The calibration that exact corners give.
pub(super) fn fit(
    picture: &Picture,
    found: &Found,
    sheet: &Sheet,
    options: &CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    let (width_px, height_px) = (picture.full.width as u32, picture.full.height as u32);
    let does_not_fit = || CalibrationError::DoNotFit {
        error_px: f64::from(width_px),
        limit_px: 0.5,
        side_m: sheet.square_side_m,
    };
    let mut map = image_from_floor(sheet, &found.ideal).ok_or_else(does_not_fit)?;
    let mut camera = None;
    if let Some(lens) = options.lens {
        let start = mounting_from(&map, &lens, sheet).ok_or_else(does_not_fit)?;
        let fitted = Camera {
            name: "center".into(),
            width_px,
            height_px,
            lens,
            mounting: start,
        };
        let fitted = refined(fitted, sheet, &found.image).ok_or_else(does_not_fit)?;
        map = ideal_image_from_floor(&fitted);
        camera = Some(fitted);
    }
    let floor_from_image = map.inverse().ok_or_else(does_not_fit)?;
    let calibration = Calibration {
        width_px,
        height_px,
        floor_from_image,
        corners_px: found.image,
        sheet: *sheet,
        placement: placement(&found.image, sheet, width_px, options.placement_limit),
        reprojection: Reprojection {
            rms_px: misses(&map, sheet, &found.ideal),
            max_px: 0.0,
            max_m: 0.0,
        },
        square_width: square_width(&found.image, width_px, height_px),
        camera,
    };
    let reprojection = reprojection(&calibration).ok_or_else(does_not_fit)?;
    let limit_px = fit_limit_px(f64::from(width_px));
    // The corners alone fit, or they would not have been found: it is the lens.
    if calibration.camera.is_some() && !(reprojection.rms_px <= limit_px) {
        return Err(CalibrationError::OtherLens {
            error_px: reprojection.rms_px,
            limit_px,
        });
    }
    Ok(Calibration {
        reprojection,
        ..calibration
    })
}

/// How far a calibration misses its own corners; `None` when its map puts them out of sight.
pub(super) fn reprojection(calibration: &Calibration) -> Option<Reprojection> {
    let (width, height) = (calibration.width_px, calibration.height_px);
    let (mut squares, mut max_px, mut max_m) = (0.0, 0.0f64, 0.0f64);
    for (floor, pixel) in calibration.sheet.corners().iter().zip(&calibration.corners_px) {
        let miss_px = (calibration.pixel_from_floor(*floor, width, height)? - *pixel).length();
        let miss_m = (calibration.floor_from_pixel(*pixel, width, height)? - *floor).length();
        squares += miss_px * miss_px;
        max_px = max_px.max(miss_px);
        max_m = max_m.max(miss_m);
    }
    Some(Reprojection {
        rms_px: (squares / 8.0).sqrt(),
        max_px,
        max_m,
    })
}

/// The document's eq. 12, from the means of each square's corners; and the same in metres and radians.
pub(super) fn placement(corners: &[Vec2; 8], sheet: &Sheet, width_px: u32, limit: f64) -> Placement {
    let square = |half: usize| -> &[Vec2] { &corners[4 * half..][..4] };
    let middle_u = |half: usize| square(half).iter().map(|c| c.x).sum::<f64>() / 4.0;
    let centre_u = f64::from(width_px) / 2.0;
    // At a square's distance a pixel is as wide as the square's side over its width in pixels.
    let to_the_left_m = |half: usize| {
        let c = square(half);
        let side_px = (c[1].x - c[0].x + c[3].x - c[2].x) / 2.0;
        (centre_u - middle_u(half)) * sheet.square_side_m / side_px
    };
    let (near_m, far_m) = (to_the_left_m(0), to_the_left_m(1));
    let slope = (far_m - near_m) / (sheet.far_square_m - sheet.near_square_m);
    Placement {
        position_px: middle_u(0) - centre_u,
        orientation_px: middle_u(0) - middle_u(1),
        limit_px: limit * f64::from(width_px),
        lateral_m: near_m - slope * (sheet.near_square_m + sheet.square_side_m / 2.0),
        turn_rad: trig::atan(slope),
    }
}

/// Least-squares line through the widths of the four edges across the sheet against their rows (the document's 5.3.2).
pub(super) fn square_width(corners: &[Vec2; 8], width_px: u32, height_px: u32) -> WidthProfile {
    let edge = |i: usize| {
        let (left, right) = (corners[2 * i], corners[2 * i + 1]);
        ((left.y + right.y) / 2.0, right.x - left.x)
    };
    let edges: [(f64, f64); 4] = std::array::from_fn(edge);
    let row = edges.iter().map(|e| e.0).sum::<f64>() / 4.0;
    let width = edges.iter().map(|e| e.1).sum::<f64>() / 4.0;
    let spread: f64 = edges.iter().map(|e| (e.0 - row) * (e.0 - row)).sum();
    let shared: f64 = edges.iter().map(|e| (e.0 - row) * (e.1 - width)).sum();
    // The squares are some pixels high: their edges never share a row.
    let slope_px_per_row = shared / spread;
    WidthProfile {
        intercept_px: width - slope_px_per_row * row,
        slope_px_per_row,
        width_px,
        height_px,
    }
}

/// The map from the floor to ideal pixels with the least squared distances **in the picture**, where the error is: the
/// linear fit, improved by Gauss and Newton. (The linear fit alone weights far corners wrongly.)
pub(super) fn image_from_floor(sheet: &Sheet, ideal: &[Vec2; 8]) -> Option<Homography> {
    // Floor coordinates around the sheet's middle in units of a square's side, so that the ninth number is never near 0.
    let corners = sheet.corners();
    let centre = corners.iter().copied().sum::<Vec2>() / 8.0;
    let side = sheet.square_side_m;
    let local = corners.map(|c| (c - centre) / side);
    let start = Homography::fit(&local, ideal)?.matrix();
    if !(start.z_axis.z.abs() > 1e-9) {
        return None;
    }
    let start = start * (1.0 / start.z_axis.z);
    let first: [f64; 8] = std::array::from_fn(|i| start.col(i % 3)[i / 3]);
    let matrix = |p: &[f64; 8]| {
        Mat3::from_cols(
            Vec3::new(p[0], p[3], p[6]),
            Vec3::new(p[1], p[4], p[7]),
            Vec3::new(p[2], p[5], 1.0),
        )
    };
    let residuals = |p: &[f64; 8]| {
        let map = Homography::from_matrix(matrix(p));
        let mut out = [0.0; 16];
        for i in 0..8 {
            let miss = map.map(local[i])? - ideal[i];
            (out[2 * i], out[2 * i + 1]) = (miss.x, miss.y);
        }
        Some(out)
    };
    let best = least_squares(first, [1e-5; 8], residuals)?;
    let local_from_floor = Mat3::from_cols(
        Vec3::new(1.0 / side, 0.0, 0.0),
        Vec3::new(0.0, 1.0 / side, 0.0),
        Vec3::new(-centre.x / side, -centre.y / side, 1.0),
    );
    Some(Homography::from_matrix(matrix(&best) * local_from_floor))
}

/// Place and direction of a camera from its map of the floor (Zhang 2000, for a known lens).
fn mounting_from(image_from_floor: &Homography, lens: &Lens, sheet: &Sheet) -> Option<Mounting> {
    let (focal, centre) = pinhole_part(lens);
    let direction_from_pixel = Mat3::from_cols(
        Vec3::new(1.0 / focal.x, 0.0, 0.0),
        Vec3::new(0.0, 1.0 / focal.y, 0.0),
        Vec3::new(-centre.x / focal.x, -centre.y / focal.y, 1.0),
    );
    let mut map = direction_from_pixel * image_from_floor.matrix();
    // The sheet is in front of the camera.
    let middle = sheet.corners().iter().copied().sum::<Vec2>() / 8.0;
    if (map * Vec3::new(middle.x, middle.y, 1.0)).z < 0.0 {
        map *= -1.0;
    }
    let scale = (map.x_axis.length() + map.y_axis.length()) / 2.0;
    let x = map.x_axis.try_normalize()?;
    let y = (map.y_axis - x * x.dot(map.y_axis)).try_normalize()?;
    let camera_from_vehicle = Mat3::from_cols(x, y, x.cross(y));
    let vehicle_from_camera = camera_from_vehicle.transpose();
    let place = vehicle_from_camera * (map.z_axis / -scale);
    // Mounting::vehicle_from_camera = Rz(yaw) · Ry(tilt) · Rx(roll) · level.
    let level = Mat3::from_cols(Vec3::NEG_Y, Vec3::NEG_Z, Vec3::X);
    let turn = vehicle_from_camera * level.transpose();
    let mounting = Mounting {
        x_m: place.x,
        y_m: place.y,
        z_m: place.z,
        yaw_rad: trig::atan2(turn.x_axis.y, turn.x_axis.x),
        tilt_rad: trig::asin((-turn.x_axis.z).clamp(-1.0, 1.0)),
        roll_rad: trig::atan2(turn.y_axis.z, turn.z_axis.z),
    };
    (place.is_finite() && place.z > 0.0).then_some(mounting)
}

/// The camera moved and turned so that it sees the sheet's corners where they were found.
fn refined(camera: Camera, sheet: &Sheet, image: &[Vec2; 8]) -> Option<Camera> {
    let corners = sheet.corners();
    let placed = |p: &[f64; 6]| Camera {
        mounting: Mounting {
            x_m: p[0],
            y_m: p[1],
            z_m: p[2],
            yaw_rad: p[3],
            tilt_rad: p[4],
            roll_rad: p[5],
        },
        name: String::new(),
        ..camera
    };
    let m = camera.mounting;
    let first = [m.x_m, m.y_m, m.z_m, m.yaw_rad, m.tilt_rad, m.roll_rad];
    let residuals = |p: &[f64; 6]| {
        let camera = placed(p);
        let mut out = [0.0; 16];
        for i in 0..8 {
            let miss = camera.pixel_from_floor(corners[i])? - image[i];
            (out[2 * i], out[2 * i + 1]) = (miss.x, miss.y);
        }
        Some(out)
    };
    let best = least_squares(first, [1e-6; 6], residuals)?;
    let mounting = placed(&best).mounting;
    (mounting.z_m > 0.0).then_some(Camera { mounting, ..camera })
}

/// What the camera's lens without distortion makes of the floor.
fn ideal_image_from_floor(camera: &Camera) -> Homography {
    let (focal, centre) = pinhole_part(&camera.lens);
    let pixel_from_direction = Mat3::from_cols(
        Vec3::new(focal.x, 0.0, 0.0),
        Vec3::new(0.0, focal.y, 0.0),
        Vec3::new(centre.x, centre.y, 1.0),
    );
    let turn = camera.mounting.vehicle_from_camera().transpose();
    let direction_from_floor = Mat3::from_cols(turn.x_axis, turn.y_axis, turn * -camera.mounting.position());
    Homography::from_matrix(pixel_from_direction * direction_from_floor)
}

/// Gauss-Newton with central differences of the given steps, halving a step that does not help. `None` when the start
/// cannot be evaluated or the normal equations are singular at it.
fn least_squares<const N: usize>(
    first: [f64; N],
    steps: [f64; N],
    residuals: impl Fn(&[f64; N]) -> Option<[f64; 16]>,
) -> Option<[f64; N]> {
    let cost = |r: &[f64; 16]| r.iter().map(|x| x * x).sum::<f64>();
    let mut best = first;
    let mut now = residuals(&best)?;
    for _ in 0..20 {
        let mut jacobian = [[0.0; 16]; N];
        for (k, column) in jacobian.iter_mut().enumerate() {
            let step = steps[k] * best[k].abs().max(1.0);
            let (mut low, mut high) = (best, best);
            low[k] -= step;
            high[k] += step;
            let (low, high) = (residuals(&low)?, residuals(&high)?);
            for i in 0..16 {
                column[i] = (high[i] - low[i]) / (2.0 * step);
            }
        }
        let dot = |a: &[f64; 16], b: &[f64; 16]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let normal: [[f64; N]; N] =
            std::array::from_fn(|i| std::array::from_fn(|k| dot(&jacobian[i], &jacobian[k])));
        let right: [f64; N] = std::array::from_fn(|i| -dot(&jacobian[i], &now));
        let change = solve(normal, right)?;
        let mut part = 1.0;
        let better = loop {
            let mut next = best;
            for k in 0..N {
                next[k] += part * change[k];
            }
            match residuals(&next) {
                Some(r) if cost(&r) < cost(&now) => break Some((next, r)),
                _ if part < 1e-3 => break None,
                _ => part /= 2.0,
            }
        };
        let Some((next, r)) = better else {
            break;
        };
        let gained = cost(&now) - cost(&r);
        (best, now) = (next, r);
        if gained <= 1e-12 * (1.0 + cost(&now)) {
            break;
        }
    }
    Some(best)
}

/// Solves a small linear system by elimination with scaled pivots; `None` when it is singular. Own and plain: a library's
/// blocked product may use fused instructions where the processor has them, and then the bits differ.
#[allow(
    clippy::needless_range_loop,
    reason = "rows and columns of one matrix are read and written by index"
)]
fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> Option<[f64; N]> {
    // Unknowns of very different size (metres, radians, pixels): bring the diagonal to 1 first.
    let scale: [f64; N] = std::array::from_fn(|i| 1.0 / matrix[i][i].sqrt());
    for i in 0..N {
        for k in 0..N {
            matrix[i][k] *= scale[i] * scale[k];
        }
        right[i] *= scale[i];
    }
    for column in 0..N {
        let mut pivot = column;
        for row in column + 1..N {
            if matrix[row][column].abs() > matrix[pivot][column].abs() {
                pivot = row;
            }
        }
        if !(matrix[pivot][column].abs() > 1e-14) {
            return None;
        }
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        for row in column + 1..N {
            let part = matrix[row][column] / matrix[column][column];
            for k in column..N {
                matrix[row][k] -= part * matrix[column][k];
            }
            right[row] -= part * right[column];
        }
    }
    for row in (0..N).rev() {
        let known: f64 = (row + 1..N).map(|k| matrix[row][k] * right[k]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    Some(std::array::from_fn(|i| right[i] * scale[i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera(mounting: Mounting) -> Camera {
        Camera {
            name: "center".into(),
            width_px: 320,
            height_px: 240,
            lens: Lens::pinhole(320, 240, 0.942, 0.738),
            mounting,
        }
    }

    proptest! {
        #[test]
        fn exact_corners_give_the_exact_mounting(
            x in -0.05..0.08f64, y in -0.02..0.02f64, z in 0.06..0.3f64,
            yaw in -0.2..0.2f64, tilt in 0.35..1.0f64, roll in -0.1..0.1f64,
        ) {
            let sheet = Sheet::default();
            let mounting = Mounting { x_m: x, y_m: y, z_m: z, yaw_rad: yaw, tilt_rad: tilt, roll_rad: roll };
            let truth = camera(mounting);
            let corners = sheet.corners().map(|c| truth.pixel_from_floor(c));
            prop_assume!(corners.iter().all(Option::is_some));
            let corners = corners.map(Option::unwrap);
            prop_assume!(corners.iter().all(|c| c.abs().max_element() < 1000.0));
            let map = image_from_floor(&sheet, &corners).unwrap();
            let start = mounting_from(&map, &truth.lens, &sheet).unwrap();
            let found = refined(camera(start), &sheet, &corners).unwrap().mounting;
            for (a, b) in [(found.x_m, x), (found.y_m, y), (found.z_m, z), (found.yaw_rad, yaw), (found.tilt_rad, tilt), (found.roll_rad, roll)] {
                prop_assert!((a - b).abs() < 1e-6, "{found:?} {mounting:?}");
            }
            let direct = ideal_image_from_floor(&truth);
            for c in sheet.corners() {
                prop_assert!((direct.map(c).unwrap() - map.map(c).unwrap()).length() < 1e-6);
            }
        }
    }

    #[test]
    fn small_systems_are_solved_and_singular_ones_refused() {
        let solved = solve([[4.0, 1.0], [1.0, 3.0]], [1.0, 2.0]).unwrap();
        assert!((solved[0] - 1.0 / 11.0).abs() < 1e-15 && (solved[1] - 7.0 / 11.0).abs() < 1e-15);
        assert!(solve([[1.0, 1.0], [1.0, 1.0]], [1.0, 2.0]).is_none());
        assert!(solve([[0.0, 0.0], [0.0, 1.0]], [1.0, 2.0]).is_none());
    }
}
