//! Finds the sheet's two squares: shrinks the search region until exactly two four-cornered regions are left (C1).

use super::contour::{Mask, Region, area, regions};
use super::edges;
use super::fit::image_from_floor;
use super::picture::{Gray, Picture};
use super::{CalibrationError, Sheet, Side};
use senda_geom::{Homography, Lens, Vec2, Vec3};

/// How much of the picture's upper part goes at a time: 3 px of the document's 320 px width.
const STEP_OF_WIDTH: f64 = 3.0 / 320.0;
/// Ways to tell dark from light, tried in turn: side of the window to average over as a part of the picture's width, and
/// the part of that average below which a pixel is dark. The first suits even light; wide windows suit near
/// squares, narrow ones strong shadows, high parts faint prints, low parts dark paper with reflections. Guesses, tried
/// on the pictures of the tests.
const WAYS: [(f64, f64); 6] = [
    (0.5, 0.65),
    (0.35, 0.75),
    (0.8, 0.5),
    (0.25, 0.85),
    (0.5, 0.45),
    (0.8, 0.75),
];

/// The eight corners, exact, and how well they fit the sheet.
#[derive(Debug, Clone)]
pub(super) struct Found {
    /// Where they are in the picture (px), in the order of [`Sheet::corners`].
    pub(super) image: [Vec2; 8],
    /// Where a lens without distortion would show them (px); the same without a known lens.
    pub(super) ideal: [Vec2; 8],
}

/// Finds the corners, or tells what was found instead.
pub(super) fn find(picture: &Picture, sheet: &Sheet, lens: Option<&Lens>) -> Result<Found, CalibrationError> {
    let mut failure: Option<CalibrationError> = None;
    for (window, part) in WAYS {
        let mask = dark(&picture.search, window, part);
        match find_in(&mask, picture, sheet, lens) {
            Ok(found) => return Ok(found),
            Err(error) => {
                if failure.as_ref().is_none_or(|f| telling(&error) > telling(f)) {
                    failure = Some(error);
                }
            }
        }
    }
    Err(failure.expect("there is more than one way"))
}

/// Which of several failures says most about the picture.
fn telling(error: &CalibrationError) -> u8 {
    match error {
        CalibrationError::TooManySquares { .. } => 6,
        CalibrationError::UpsideDown => 5,
        CalibrationError::DoNotFit { .. } => 4,
        CalibrationError::CutOff { whole: 1, .. } => 3,
        CalibrationError::OneSquare { .. } => 2,
        CalibrationError::CutOff { .. } => 1,
        _ => 0,
    }
}

/// Dark: below a part of the mean over a square window around the pixel.
fn dark(gray: &Gray, window: f64, part: f64) -> Mask {
    let (width, height) = (gray.width, gray.height);
    // Sums over everything above and to the left, with a row and a column of zeros in front.
    let stride = width + 1;
    let mut sums = vec![0.0f64; stride * (height + 1)];
    for y in 0..height {
        let mut row = 0.0;
        for x in 0..width {
            row += f64::from(gray.values[y * width + x]);
            sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
        }
    }
    let half = ((window * width as f64 / 2.0) as usize).max(2);
    let mut dark = vec![false; width * height];
    for y in 0..height {
        let (y0, y1) = (y.saturating_sub(half), (y + half + 1).min(height));
        for x in 0..width {
            let (x0, x1) = (x.saturating_sub(half), (x + half + 1).min(width));
            let sum = sums[y1 * stride + x1] - sums[y0 * stride + x1] - sums[y1 * stride + x0]
                + sums[y0 * stride + x0];
            let mean = sum / ((y1 - y0) * (x1 - x0)) as f64;
            dark[y * width + x] = f64::from(gray.values[y * width + x]) < part * mean;
        }
    }
    Mask { width, height, dark }
}

type Quad = [Vec2; 4];

fn find_in(
    mask: &Mask,
    picture: &Picture,
    sheet: &Sheet,
    lens: Option<&Lens>,
) -> Result<Found, CalibrationError> {
    let step = ((STEP_OF_WIDTH * mask.width as f64).round() as usize).max(1);
    let size = Vec2::new(picture.full.width as f64, picture.full.height as f64);
    let whole_picture = regions(mask, 0);
    let mut seen: Vec<Quad> = Vec::new();
    // A pair among more than two regions: second choice, if shrinking never leaves exactly two.
    let mut second_choice: Option<[Quad; 2]> = None;
    let mut misfit: Option<CalibrationError> = None;
    // Squares need some rows to be seen in.
    let mut tops = (0..mask.height.saturating_sub(12)).step_by(step).peekable();
    let mut chosen = None;
    let mut regions_here = whole_picture.clone();
    while let Some(top) = tops.next() {
        let quads: Vec<Quad> = regions_here
            .iter()
            .filter(|region| region.touches(mask, top) == [false; 4])
            .filter_map(Region::four_corners)
            .map(|quad| quad.map(|corner| corner * picture.shrink as f64))
            .collect();
        for quad in &quads {
            if !seen
                .iter()
                .any(|other| distance(quad, other) < 3.0 * picture.shrink as f64)
            {
                seen.push(*quad);
            }
        }
        // More regions than this are a pattern on the floor; shrinking will drop them.
        let pairs = if quads.len() <= 12 {
            fitting_pairs(&quads, sheet, lens, size, &mut misfit)
        } else {
            Vec::new()
        };
        if let [pair] = pairs[..] {
            if quads.len() == 2 {
                chosen = Some(pair);
                break;
            }
            second_choice.get_or_insert(pair);
        }
        match tops.peek() {
            Some(next)
                if regions_here
                    .iter()
                    .any(|r| r.bounds[1] < *next && r.bounds[3] > *next) =>
            {
                regions_here = regions(mask, *next);
            }
            // The cut goes through none of them: the same, without those above it.
            Some(next) => regions_here.retain(|region| region.bounds[1] >= *next),
            None => break,
        }
    }
    let Some(pair) = chosen.or(second_choice) else {
        return Err(describe(mask, &whole_picture, &seen, picture, misfit));
    };
    let found = exact(&pair, picture, sheet, lens)?;
    if !is_black_on_white(&found, picture, sheet, lens) {
        return Err(describe(mask, &whole_picture, &[], picture, None));
    }
    let others = third_squares(&found, &pair, &seen, sheet, lens);
    if others > 0 {
        return Err(CalibrationError::TooManySquares { found: 2 + others });
    }
    Ok(found)
}

fn middle(quad: &Quad) -> Vec2 {
    (quad[0] + quad[1] + quad[2] + quad[3]) / 4.0
}

fn distance(a: &Quad, b: &Quad) -> f64 {
    (middle(a) - middle(b)).length()
}

/// Pairs, near square first, that fit the sheet roughly. Says why the last pair of only two does not.
fn fitting_pairs(
    quads: &[Quad],
    sheet: &Sheet,
    lens: Option<&Lens>,
    size: Vec2,
    misfit: &mut Option<CalibrationError>,
) -> Vec<[Quad; 2]> {
    let mut pairs = Vec::new();
    for (index, a) in quads.iter().enumerate() {
        for b in &quads[index + 1..] {
            let (near, far) = if middle(a).y > middle(b).y { (a, b) } else { (b, a) };
            match rough_fit(near, far, sheet, lens, size) {
                Ok(()) => pairs.push([*near, *far]),
                // Two regions that are off by the size of a square have nothing to do with the sheet.
                Err(CalibrationError::DoNotFit { error_px, .. })
                    if error_px > 0.5 * area(far).abs().sqrt() => {}
                Err(error) if quads.len() == 2 => *misfit = Some(error),
                Err(_) => {}
            }
        }
    }
    pairs
}

/// Corners of both squares in the order of [`Sheet::corners`]: near left, near right, far left, far right, as seen along
/// the direction from the near square to the far one.
fn ordered(near: &Quad, far: &Quad) -> Option<[Vec2; 8]> {
    let up = (middle(far) - middle(near)).try_normalize()?;
    let right = Vec2::new(-up.y, up.x);
    let mut corners = [Vec2::ZERO; 8];
    for (half, quad) in [near, far].into_iter().enumerate() {
        let centre = middle(quad);
        let mut taken = [false; 4];
        for corner in quad {
            let place = *corner - centre;
            let slot = usize::from(place.dot(right) > 0.0) + 2 * usize::from(place.dot(up) > 0.0);
            if taken[slot] {
                return None;
            }
            taken[slot] = true;
            corners[4 * half + slot] = *corner;
        }
    }
    Some(corners)
}

fn rough_fit(
    near: &Quad,
    far: &Quad,
    sheet: &Sheet,
    lens: Option<&Lens>,
    size: Vec2,
) -> Result<(), CalibrationError> {
    let (near_area, far_area) = (area(near).abs(), area(far).abs());
    let far_side = far_area.sqrt();
    let limit_px = 1.5 + 0.06 * far_side;
    let does_not_fit = |error_px| CalibrationError::DoNotFit {
        error_px,
        limit_px,
        side_m: sheet.square_side_m,
    };
    let corners = ordered(near, far).ok_or(does_not_fit(near_area.sqrt()))?;
    let ideal = match undistorted(&corners, lens) {
        Some(ideal) => ideal,
        None => return Err(does_not_fit(near_area.sqrt())),
    };
    let error_px = match Homography::fit(&sheet.corners(), &ideal) {
        Some(map) if sees_all_from_one_side(&map, sheet) && could_be_a_camera(&map, lens, size) => {
            misses(&map, sheet, &ideal)
        }
        _ => near_area.sqrt(),
    };
    if !(error_px <= limit_px) {
        return Err(does_not_fit(error_px));
    }
    // Seen from straight above both are equal; rough corners are some per cent off.
    if near_area < 0.85 * far_area {
        return Err(CalibrationError::UpsideDown);
    }
    Ok(())
}

/// Whether no corner of the sheet is behind the camera.
fn sees_all_from_one_side(image_from_floor: &Homography, sheet: &Sheet) -> bool {
    let depth = |p: Vec2| (image_from_floor.matrix() * Vec3::new(p.x, p.y, 1.0)).z;
    let depths = sheet.corners().map(depth);
    depths.iter().all(|d| *d > 0.0) || depths.iter().all(|d| *d < 0.0)
}

/// Whether a camera with about square pixels could see the floor like this: never longer along the view than across it, and
/// foreshortened only as much as near things are larger than far ones. Blots of a pattern are neither.
fn could_be_a_camera(image_from_floor: &Homography, lens: Option<&Lens>, size: Vec2) -> bool {
    let centre = lens.map_or(size / 2.0, |lens| edges::pinhole_part(lens).1);
    let centred = |column: Vec3| column.truncate() - centre * column.z;
    let map = image_from_floor.matrix();
    let along = centred(map.x_axis).length_squared();
    let across = centred(map.y_axis).length_squared();
    // With K = diag(f, f, 1) the first two columns of K⁻¹·map are equally long: f² = (across - along) / perspective.
    let perspective = map.x_axis.z * map.x_axis.z - map.y_axis.z * map.y_axis.z;
    let shorter = across - along;
    if shorter < 0.3 * across {
        // From nearly above the focal length does not show. Wide frames may have pixels up to 1.4 times as high as wide.
        return shorter > -across;
    }
    let focal = (shorter / perspective).sqrt();
    // Views of 136° to 6°; not a number when the far side is the larger one.
    (0.2 * size.x..10.0 * size.x).contains(&focal)
}

/// Root mean square distance between the sheet's corners, mapped, and those found (px).
pub(super) fn misses(image_from_floor: &Homography, sheet: &Sheet, ideal: &[Vec2; 8]) -> f64 {
    let corners = sheet.corners();
    let squares = corners.iter().zip(ideal).map(|(floor, pixel)| {
        image_from_floor
            .map(*floor)
            .map_or(f64::INFINITY, |p| (p - *pixel).length_squared())
    });
    (squares.sum::<f64>() / 8.0).sqrt()
}

fn undistorted(corners: &[Vec2; 8], lens: Option<&Lens>) -> Option<[Vec2; 8]> {
    let mut ideal = *corners;
    for corner in &mut ideal {
        *corner = edges::ideal_from_image(lens, *corner)?;
    }
    Some(ideal)
}

/// How far exact corners may be from where they should, on average, in a picture of a width: a sixth of a per cent of it, but at
/// least half a pixel. What a badly printed or curled sheet stays within. Guess.
pub(super) fn fit_limit_px(width_px: f64) -> f64 {
    (width_px * 0.0016).max(0.5)
}

/// Exact corners from the edges in the full picture, checked against the sheet.
fn exact(
    pair: &[Quad; 2],
    picture: &Picture,
    sheet: &Sheet,
    lens: Option<&Lens>,
) -> Result<Found, CalibrationError> {
    let size = picture.full.width as f64;
    let limit_px = fit_limit_px(size);
    let does_not_fit = |error_px| CalibrationError::DoNotFit {
        error_px,
        limit_px,
        side_m: sheet.square_side_m,
    };
    let rough = ordered(&pair[0], &pair[1]).ok_or(does_not_fit(size))?;
    let mut image = rough;
    let mut ideal = rough;
    for half in 0..2 {
        // Around the square: near left, near right, far right, far left.
        let slots = [0, 1, 3, 2].map(|slot| slot + 4 * half);
        let quad = slots.map(|slot| rough[slot]);
        let refined = edges::refine(&picture.full, &quad, lens, picture.shrink as f64).ok_or(
            CalibrationError::OneSquare {
                column_px: middle(&pair[1 - half]).x,
                row_px: middle(&pair[1 - half]).y,
            },
        )?;
        for (index, slot) in slots.into_iter().enumerate() {
            image[slot] = refined.image[index];
            ideal[slot] = refined.ideal[index];
        }
    }
    let error_px = image_from_floor(sheet, &ideal).map_or(size, |map| misses(&map, sheet, &ideal));
    if !(error_px <= limit_px) {
        return Err(does_not_fit(error_px));
    }
    Ok(Found { image, ideal })
}

/// Whether the squares are dark throughout and have light paper all around: two blots of the floor that happen to have eight
/// fitting corners have not.
fn is_black_on_white(found: &Found, picture: &Picture, sheet: &Sheet, lens: Option<&Lens>) -> bool {
    let Some(map) = image_from_floor(sheet, &found.ideal) else {
        return false;
    };
    let side = sheet.square_side_m;
    let look = |floor: Vec2| {
        let pixel = map
            .map(floor)
            .and_then(|ideal| edges::image_from_ideal(lens, ideal));
        pixel.map(|pixel| picture.full.sample(pixel))
    };
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    // Ink over paper of each square; `None` where it is not one on the other.
    let ratios = [sheet.near_square_m, sheet.far_square_m].map(|start| {
        let centre = Vec2::new(start + side / 2.0, 0.0);
        let mut ink: Vec<f64> = Vec::new();
        let mut paper: Vec<f64> = Vec::new();
        for i in 0..6 {
            let part = (f64::from(i) + 0.5) / 6.0 - 0.5;
            for k in 0..6 {
                let other = (f64::from(k) + 0.5) / 6.0 - 0.5;
                ink.extend(look(centre + Vec2::new(part, other) * 0.85 * side));
            }
            // Sheet::check keeps a fifth of a side of white around the squares.
            for edge in [-0.63, 0.63] {
                paper.extend(look(centre + Vec2::new(part * 1.2, edge) * side));
                paper.extend(look(centre + Vec2::new(edge, part * 1.2) * side));
            }
        }
        let (black, white) = (median(&mut ink), median(&mut paper));
        // Nearer to the ink, because paper may lie half in a shadow.
        let level = black + 0.25 * (white - black);
        let dark = ink.iter().filter(|value| **value < level).count();
        let light = paper.iter().filter(|value| **value > level).count();
        // Reflections take some.
        (dark as f64 >= 0.85 * 36.0 && light as f64 >= 0.85 * 24.0).then(|| black / white)
    });
    // The same ink on the same paper: light changes both alike, a reflection on one square lifts its black.
    matches!(ratios, [Some(near), Some(far)] if (near - far).abs() < 0.25)
}

/// How many other regions are squares of the same size around the sheet: then nobody knows which two are meant. Shrinking
/// alone would cut a third one off and go on with the wrong two.
fn third_squares(
    found: &Found,
    pair: &[Quad; 2],
    seen: &[Quad],
    sheet: &Sheet,
    lens: Option<&Lens>,
) -> usize {
    let Some(floor_from_image) = image_from_floor(sheet, &found.ideal).and_then(|map| map.inverse()) else {
        return 0;
    };
    let side = sheet.square_side_m;
    let is_one = |quad: &&Quad| {
        if pair
            .iter()
            .any(|one| distance(quad, one) < 0.5 * area(one).abs().sqrt())
        {
            return false;
        }
        let mut floor = [Vec2::ZERO; 4];
        for (place, corner) in floor.iter_mut().zip(quad.iter()) {
            let ideal = edges::ideal_from_image(lens, *corner);
            match ideal.and_then(|p| floor_from_image.map(p)) {
                Some(p) => *place = p,
                None => return false,
            }
        }
        let sides_fit = (0..4).all(|i| {
            let length = (floor[(i + 1) % 4] - floor[i]).length();
            (0.7 * side..1.4 * side).contains(&length)
        });
        let centre = middle(&floor);
        let ahead = (sheet.page_start_m..sheet.page_end_m() + 2.0 * side).contains(&centre.x);
        sides_fit && ahead && centre.y.abs() < sheet.page_width_m / 2.0
    };
    seen.iter().filter(is_one).count()
}

/// What the picture shows instead of two squares.
fn describe(
    mask: &Mask,
    regions: &[Region],
    seen: &[Quad],
    picture: &Picture,
    misfit: Option<CalibrationError>,
) -> CalibrationError {
    if let Some(error) = misfit {
        return error;
    }
    if seen.len() > 2 {
        return CalibrationError::TooManySquares { found: seen.len() };
    }
    let largest_cut = regions
        .iter()
        // What touches several sides is the floor around the sheet.
        .filter(|region| region.touches(mask, 0).iter().filter(|touches| **touches).count() == 1)
        .filter(|region| region.could_be_cut_off())
        .filter(|region| region.area_px < mask.width * mask.height / 4)
        .filter(|region| {
            // Of the same order of size as the one that is whole, if there is one.
            let region_px = (region.area_px * picture.shrink * picture.shrink) as f64;
            seen.first()
                .is_none_or(|quad| (0.1..8.0).contains(&(region_px / area(quad).abs())))
        })
        .max_by_key(|region| region.area_px);
    match (largest_cut, seen) {
        (Some(region), _) => {
            let [left, top, right, _] = region.touches(mask, 0);
            let side = if left {
                Side::Left
            } else if right {
                Side::Right
            } else if top {
                Side::Top
            } else {
                Side::Bottom
            };
            CalibrationError::CutOff {
                side,
                whole: seen.len(),
            }
        }
        (None, [quad, ..]) => CalibrationError::OneSquare {
            column_px: middle(quad).x,
            row_px: middle(quad).y,
        },
        (None, []) => CalibrationError::NoSquare {
            dark_regions: regions.len(),
        },
    }
}
