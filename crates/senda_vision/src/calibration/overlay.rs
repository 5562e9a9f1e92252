//! What a calibration found, to draw over its picture.

use super::{Calibration, CalibrationError};
use senda_core::Shape;
use senda_geom::Vec2;

/// Colours of the document's fig. 38: lower left, lower right, upper left, upper right.
const CORNER_COLORS: [&str; 4] = ["dodgerblue", "limegreen", "red", "purple"];

/// Corners, middle lines and verdict over a picture of `width_px` x `height_px`: accepted, found but misplaced, or
/// what was found instead.
pub fn overlay(result: &Result<Calibration, CalibrationError>, width_px: u32, height_px: u32) -> Vec<Shape> {
    match result {
        Ok(calibration) if calibration.placement.is_within_limit() => {
            found(calibration, width_px, height_px, "limegreen", "accepted")
        }
        Ok(calibration) => found(
            calibration,
            width_px,
            height_px,
            "orange",
            "misplaced, accepted as it is",
        ),
        Err(CalibrationError::Misplaced { calibration }) => {
            found(calibration, width_px, height_px, "orangered", "misplaced")
        }
        Err(error) => vec![text([4.0, 14.0], error.to_string(), "red")],
    }
}

fn found(calibration: &Calibration, width_px: u32, height_px: u32, color: &str, verdict: &str) -> Vec<Shape> {
    let scale = Vec2::new(
        f64::from(width_px) / f64::from(calibration.width_px),
        f64::from(height_px) / f64::from(calibration.height_px),
    );
    let corners = calibration.corners_px.map(|c| c * scale);
    let line = |points: &[Vec2], color: &str, closed| Shape::Polyline {
        points: points.iter().map(|p| pair(*p)).collect(),
        color: color.to_owned(),
        closed,
    };
    let middle = |half: usize| corners[4 * half..][..4].iter().copied().sum::<Vec2>() / 4.0;
    let (middle_u, low) = (f64::from(width_px) / 2.0, f64::from(height_px));
    let mut shapes = vec![
        line(
            &[Vec2::new(middle_u, 0.0), Vec2::new(middle_u, low)],
            "gray",
            false,
        ),
        line(&[middle(0), middle(1)], color, false),
    ];
    for square in corners.chunks_exact(4) {
        shapes.push(line(&[square[0], square[1], square[3], square[2]], color, true));
    }
    let radius_px = (0.008 * width_px as f32).max(1.5);
    for (index, corner) in corners.iter().enumerate() {
        shapes.push(Shape::Circle {
            centre: pair(*corner),
            radius_px,
            color: CORNER_COLORS[index % 4].to_owned(),
        });
    }
    let (placement, reprojection) = (&calibration.placement, &calibration.reprojection);
    let words = [
        format!(
            "{verdict}: position {:+.1} px, orientation {:+.1} px (limit {:.1})",
            placement.position_px, placement.orientation_px, placement.limit_px
        ),
        format!(
            "corners fit within {:.2} px, {:.1} mm",
            reprojection.max_px,
            reprojection.max_m * 1e3
        ),
    ];
    for (row, words) in words.into_iter().enumerate() {
        shapes.push(text([4.0, 14.0 + 14.0 * row as f32], words, color));
    }
    shapes
}

fn pair(point: Vec2) -> [f32; 2] {
    [point.x as f32, point.y as f32]
}

fn text(at: [f32; 2], text: String, color: &str) -> Shape {
    Shape::Text {
        at,
        text,
        color: color.to_owned(),
    }
}
