//! Dark regions of a picture, their outlines, and which of them are four-cornered.

use super::edges::robust_line;
use senda_geom::Vec2;

/// Smallest region worth looking at, as a part of the picture: sides of about 7 px at 320x240. Guess.
const LEAST_AREA: f64 = 1.0 / 1600.0;
/// Smallest region at any size (px): the edge fits need sides of about 5 px.
const LEAST_AREA_PX: usize = 30;

/// Dark (true) or not, per pixel.
#[derive(Debug, Clone)]
pub(super) struct Mask {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) dark: Vec<bool>,
}

/// A connected dark region.
#[derive(Debug, Clone)]
pub(super) struct Region {
    /// Number of pixels.
    pub(super) area_px: usize,
    /// Left, top, right, bottom (px), the last two exclusive.
    pub(super) bounds: [usize; 4],
    /// Outline as joined pixel centres.
    pub(super) outline: Vec<Vec2>,
}

/// All regions below row `top` that are large enough, 8-connected, from top to bottom.
pub(super) fn regions(mask: &Mask, top: usize) -> Vec<Region> {
    let (width, height) = (mask.width, mask.height);
    let least = LEAST_AREA_PX.max((LEAST_AREA * (width * height) as f64) as usize);
    // 0: not dark or not visited yet; else the number of the region.
    let mut labels = vec![0u32; width * height];
    let mut stack = Vec::new();
    let mut found = Vec::new();
    let mut label = 0;
    for start in top * width..width * height {
        if !mask.dark[start] || labels[start] != 0 {
            continue;
        }
        label += 1;
        labels[start] = label;
        stack.push(start);
        let mut area_px = 0;
        let mut bounds = [width, height, 0, 0];
        while let Some(place) = stack.pop() {
            let (x, y) = (place % width, place / width);
            area_px += 1;
            bounds = [
                bounds[0].min(x),
                bounds[1].min(y),
                bounds[2].max(x + 1),
                bounds[3].max(y + 1),
            ];
            for ny in y.saturating_sub(1).max(top)..=(y + 1).min(height - 1) {
                for nx in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                    let next = ny * width + nx;
                    if mask.dark[next] && labels[next] == 0 {
                        labels[next] = label;
                        stack.push(next);
                    }
                }
            }
        }
        if area_px >= least {
            let is_inside = |x: isize, y: isize| {
                let inside = x >= 0 && y >= 0 && x < width as isize && y < height as isize;
                inside && labels[y as usize * width + x as usize] == label
            };
            let outline = trace(
                (start % width) as isize,
                (start / width) as isize,
                &is_inside,
                4 * area_px + 8,
            );
            found.push(Region {
                area_px,
                bounds,
                outline,
            });
        }
    }
    found
}

/// Moore neighbours, clockwise from the left.
const NEIGHBOURS: [(isize, isize); 8] = [
    (-1, 0),
    (-1, -1),
    (0, -1),
    (1, -1),
    (1, 0),
    (1, 1),
    (0, 1),
    (-1, 1),
];

/// Walks around the region clockwise from its first pixel in reading order (Moore neighbour tracing). Ends when it is about
/// to repeat its first step, or after `limit` steps.
fn trace(x: isize, y: isize, is_inside: &dyn Fn(isize, isize) -> bool, limit: usize) -> Vec<Vec2> {
    let (mut at, mut from) = ((x, y), 0);
    let mut outline = Vec::new();
    let mut first_step = None;
    while outline.len() < limit {
        // Clockwise from the empty neighbour that we came along.
        let next = (1..=8)
            .map(|turn| (from + turn) % 8)
            .find(|direction| is_inside(at.0 + NEIGHBOURS[*direction].0, at.1 + NEIGHBOURS[*direction].1));
        let Some(direction) = next else {
            outline.push(Vec2::new(x as f64 + 0.5, y as f64 + 0.5));
            break;
        };
        if first_step == Some((at, direction)) {
            break;
        }
        first_step.get_or_insert((at, direction));
        outline.push(Vec2::new(at.0 as f64 + 0.5, at.1 as f64 + 0.5));
        at = (at.0 + NEIGHBOURS[direction].0, at.1 + NEIGHBOURS[direction].1);
        // The neighbour looked at before the step is empty; from the new pixel it lies in this direction.
        from = if direction % 2 == 0 {
            (direction + 6) % 8
        } else {
            (direction + 5) % 8
        };
    }
    outline
}

/// The closed outline as a polygon that stays within `tolerance_px` of it (Douglas and Peucker 1973). Begins at the
/// outline's point farthest from its middle, which of a convex polygon is a corner.
pub(super) fn polygon(outline: &[Vec2], tolerance_px: f64) -> Vec<Vec2> {
    if outline.len() < 4 {
        return outline.to_vec();
    }
    let middle = outline.iter().copied().sum::<Vec2>() / outline.len() as f64;
    let first = farthest(outline, middle);
    let around: Vec<Vec2> = (0..=outline.len())
        .map(|i| outline[(first + i) % outline.len()])
        .collect();
    let second = farthest(&around, around[0]);
    let mut corners = vec![around[0]];
    simplify(&around[..=second], tolerance_px, &mut corners);
    corners.push(around[second]);
    simplify(&around[second..], tolerance_px, &mut corners);
    corners
}

fn farthest(points: &[Vec2], from: Vec2) -> usize {
    let mut best = (0, -1.0);
    for (index, point) in points.iter().enumerate() {
        let distance = (*point - from).length_squared();
        if distance > best.1 {
            best = (index, distance);
        }
    }
    best.0
}

/// Adds the corners strictly between the ends of an open chain. A work list instead of recursion: outlines come from
/// foreign pictures and may be long.
fn simplify(chain: &[Vec2], tolerance_px: f64, corners: &mut Vec<Vec2>) {
    let mut keep = Vec::new();
    let mut open = vec![(0, chain.len() - 1)];
    while let Some((start, end)) = open.pop() {
        let along = chain[end] - chain[start];
        let length = along.length();
        let mut worst = (start, tolerance_px);
        for (index, point) in chain.iter().enumerate().take(end).skip(start + 1) {
            let offset = *point - chain[start];
            let distance = if length > 1e-9 {
                along.perp_dot(offset).abs() / length
            } else {
                offset.length()
            };
            if distance > worst.1 {
                worst = (index, distance);
            }
        }
        if worst.0 != start {
            keep.push(worst.0);
            open.push((start, worst.0));
            open.push((worst.0, end));
        }
    }
    keep.sort_unstable();
    corners.extend(keep.into_iter().map(|index| chain[index]));
}

/// Signed area (px²) of a polygon; positive when it runs clockwise as seen in an image.
pub(super) fn area(corners: &[Vec2]) -> f64 {
    let next = |i: usize| corners[(i + 1) % corners.len()];
    (0..corners.len())
        .map(|i| corners[i].perp_dot(next(i)))
        .sum::<f64>()
        / 2.0
}

/// Whether all turns go the same way.
pub(super) fn is_convex(corners: &[Vec2]) -> bool {
    let n = corners.len();
    let turn =
        |i: usize| (corners[(i + 1) % n] - corners[i]).perp_dot(corners[(i + 2) % n] - corners[(i + 1) % n]);
    (0..n).all(|i| turn(i) > 0.0) || (0..n).all(|i| turn(i) < 0.0)
}

impl Region {
    /// The edges of the search region that it touches: left, top, right, bottom.
    pub(super) fn touches(&self, mask: &Mask, top: usize) -> [bool; 4] {
        let [left, upper, right, lower] = self.bounds;
        [left == 0, upper <= top, right >= mask.width, lower >= mask.height]
    }

    /// The four corners, clockwise in the image, if this is a filled convex region with four corners.
    pub(super) fn four_corners(&self) -> Option<[Vec2; 4]> {
        let perimeter = perimeter(&self.outline);
        // From 2 % of the perimeter as in OpenCV's examples.
        let mut corners = polygon(&self.outline, 0.02 * perimeter);
        if !(4..=8).contains(&corners.len()) {
            return None;
        }
        // A worn or rounded corner gives two points: drop those that matter least.
        while corners.len() > 4 {
            let n = corners.len();
            let weight = |i: usize| area(&[corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]]).abs();
            let least = (0..n).min_by(|a, b| weight(*a).total_cmp(&weight(*b)))?;
            corners.remove(least);
        }
        let corners: [Vec2; 4] = corners.try_into().ok()?;
        let corners = straightened(&self.outline, straightened(&self.outline, corners));
        let stray = self
            .outline
            .iter()
            .map(|point| nearest_edge(&corners, *point).1)
            .fold(0.0, f64::max);
        let to_outline = |corner: Vec2| {
            self.outline
                .iter()
                .map(|point| (*point - corner).length())
                .fold(f64::INFINITY, f64::min)
        };
        // A disc has no points where the lines through its quarters cross.
        let bare = corners
            .iter()
            .map(|corner| to_outline(*corner))
            .fold(0.0, f64::max);
        if !self.is_filled(&corners) || stray > 0.02 * perimeter + 0.7 || bare > 0.02 * perimeter + 1.0 {
            return None;
        }
        is_convex(&corners).then(|| grown(corners))
    }

    /// Whether this looks like a square that the border cuts: a filled convex region of few corners.
    pub(super) fn could_be_cut_off(&self) -> bool {
        let [left, top, right, bottom] = self.bounds;
        let (wide, high) = ((right - left) as f64, (bottom - top) as f64);
        let corners = polygon(&self.outline, 0.03 * 2.0 * (wide + high));
        (3..=6).contains(&corners.len()) && self.is_filled(&corners) && wide < 8.0 * high && high < 4.0 * wide
    }

    fn is_filled(&self, corners: &[Vec2]) -> bool {
        // The outline runs through pixel centres: half a pixel inside.
        let polygon_px = area(corners).abs() + perimeter(corners) / 2.0 + 1.0;
        let filled = self.area_px as f64 / polygon_px;
        // Rings around the paper fail the lower limit, discs the upper one.
        is_convex(corners) && (0.75..1.2).contains(&filled)
    }
}

/// Corners of a simplified outline are points of it, which noise makes the outermost ones, some pixels off. Lines through
/// the outline's points along each edge cross where the corners are. Unchanged where that fails.
fn straightened(outline: &[Vec2], corners: [Vec2; 4]) -> [Vec2; 4] {
    let mut along_edges: [Vec<Vec2>; 4] = Default::default();
    for point in outline {
        let mut best = (0, f64::INFINITY, 0.5);
        for index in 0..4 {
            let edge = corners[(index + 1) % 4] - corners[index];
            let part =
                ((*point - corners[index]).dot(edge) / edge.length_squared().max(1e-9)).clamp(0.0, 1.0);
            let distance = (corners[index] + edge * part - *point).length();
            if distance < best.1 {
                best = (index, distance, part);
            }
        }
        // Corners are rounded by smoothing.
        if (0.12..0.88).contains(&best.2) {
            along_edges[best.0].push(*point);
        }
    }
    let lines = along_edges.map(|points| robust_line(&points));
    let corner = |i: usize| lines[(i + 3) % 4].as_ref()?.crossing(lines[i].as_ref()?);
    let limit = 0.25
        * (corners[2] - corners[0])
            .length()
            .max((corners[3] - corners[1]).length());
    std::array::from_fn(|i| {
        corner(i)
            .filter(|c| (*c - corners[i]).length() < limit)
            .unwrap_or(corners[i])
    })
}

/// The edge nearest to a point, its distance (px), and where along the edge it is nearest (0..1).
fn nearest_edge(corners: &[Vec2; 4], point: Vec2) -> (usize, f64, f64) {
    let mut best = (0, f64::INFINITY, 0.5);
    for index in 0..4 {
        let edge = corners[(index + 1) % 4] - corners[index];
        let part = ((point - corners[index]).dot(edge) / edge.length_squared().max(1e-9)).clamp(0.0, 1.0);
        let distance = (corners[index] + edge * part - point).length();
        if distance < best.1 {
            best = (index, distance, part);
        }
    }
    best
}

/// Length around a closed polygon (px).
fn perimeter(corners: &[Vec2]) -> f64 {
    (0..corners.len())
        .map(|i| (corners[(i + 1) % corners.len()] - corners[i]).length())
        .sum()
}

/// Corners moved outwards from pixel centres to the outer edges of the pixels.
fn grown(corners: [Vec2; 4]) -> [Vec2; 4] {
    let middle = corners.iter().copied().sum::<Vec2>() / 4.0;
    let mut grown = corners.map(|c| c + (c - middle).normalize_or_zero() * std::f64::consts::FRAC_1_SQRT_2);
    if area(&grown) < 0.0 {
        grown.reverse();
    }
    grown
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mask_of(picture: &[&str]) -> Mask {
        let width = picture[0].len() * 8;
        let height = picture.len() * 8;
        let dark = (0..width * height)
            .map(|i| picture[i / width / 8].as_bytes()[i % width / 8] == b'#')
            .collect();
        Mask { width, height, dark }
    }

    #[test]
    fn blocks_are_told_apart_and_outlined() {
        let mask = mask_of(&[".....", ".#.#.", "...#.", "....."]);
        let found = regions(&mask, 0);
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].area_px, found[0].bounds), (64, [8, 8, 16, 16]));
        assert_eq!(found[0].outline.len(), 28);
        assert_eq!((found[1].area_px, found[1].bounds), (128, [24, 8, 32, 24]));
        let corners = found[0].four_corners().unwrap();
        assert!((area(&corners) - 64.0).abs() < 1.0, "{corners:?}");
    }

    #[test]
    fn cutting_the_upper_rows_cuts_regions() {
        let mask = mask_of(&[".#...", ".#.#.", "...#.", "....."]);
        let found = regions(&mask, 12);
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(|r| r.touches(&mask, 12)[1]));
        assert_eq!(regions(&mask, 24).len(), 0);
    }

    #[test]
    fn rings_discs_and_angles_are_no_squares() {
        let ring = mask_of(&[
            ".......", ".#####.", ".#...#.", ".#...#.", ".#...#.", ".#####.", ".......",
        ]);
        assert!(regions(&ring, 0)[0].four_corners().is_none());
        let angle = mask_of(&[".....", ".#...", ".#...", ".###.", "....."]);
        assert!(regions(&angle, 0)[0].four_corners().is_none());
        let mut disc = mask_of(&["....."; 5]);
        for (i, dark) in disc.dark.iter_mut().enumerate() {
            let (x, y) = ((i % 40) as f64 - 20.0, (i / 40) as f64 - 20.0);
            *dark = x * x + y * y < 150.0;
        }
        assert!(regions(&disc, 0)[0].four_corners().is_none());
    }

    proptest! {
        #[test]
        fn any_picture_is_outlined_without_end(bits in prop::collection::vec(any::<bool>(), 24 * 18)) {
            let mask = Mask { width: 24, height: 18, dark: bits };
            for region in regions(&mask, 0) {
                prop_assert!(region.outline.len() >= 4);
                // A closed walk: neighbours follow each other.
                for i in 0..region.outline.len() {
                    let step = region.outline[(i + 1) % region.outline.len()] - region.outline[i];
                    prop_assert!(step.abs().max_element() == 1.0, "{step}");
                }
                let _ = (region.four_corners(), region.could_be_cut_off());
            }
        }

        #[test]
        fn turned_rectangles_have_their_corners(turn in 0.0..1.57f64, wide in 14.0..50.0f64, high in 10.0..40.0f64) {
            let (s, c) = senda_geom::trig::sincos(turn);
            let middle = Vec2::new(50.3, 49.6);
            let (along, across) = (Vec2::new(c, s), Vec2::new(-s, c));
            let dark = (0..100 * 100).map(|i| {
                let p = Vec2::new((i % 100) as f64 + 0.5, (i / 100) as f64 + 0.5) - middle;
                p.dot(along).abs() < wide / 2.0 && p.dot(across).abs() < high / 2.0
            }).collect();
            let found = regions(&Mask { width: 100, height: 100, dark }, 0);
            let corners = found[0].four_corners();
            prop_assert!(corners.is_some());
            for corner in corners.unwrap() {
                let p = corner - middle;
                let miss = Vec2::new(p.dot(along).abs() - wide / 2.0, p.dot(across).abs() - high / 2.0);
                // Corners of the outline before they are refined: half a pixel of outline and a pixel of raster each way.
                prop_assert!(miss.length() < 2.1, "{miss}");
            }
        }
    }
}
