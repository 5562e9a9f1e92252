//! Corners to fractions of a pixel: straight lines fitted to the places where the brightness steps.

use super::picture::Gray;
use senda_geom::{Lens, Vec2, Vec3};

/// Rounds of fitting, each starting from the last one's lines.
const ROUNDS: usize = 4;
/// Places along a profile across an edge, for each pixel of its length.
const SAMPLES_PER_PX: f64 = 4.0;
/// Shortest half of a profile (px): a sharp edge's step, widened by sampling between pixels, still fits into it.
const LEAST_REACH: f64 = 1.75;
/// Most places to look at along an edge; more add nothing.
const MOST_PLACES: f64 = 240.0;

/// A square's corners, in the order given.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refined {
    /// In the picture (px).
    pub(super) image: [Vec2; 4],
    /// Where a lens without distortion would show them (px).
    pub(super) ideal: [Vec2; 4],
}

/// The pixel that a lens of the same focal lengths without distortion would show in place of `pixel`; `None` where such
/// a lens sees nothing.
pub(super) fn ideal_from_image(lens: Option<&Lens>, pixel: Vec2) -> Option<Vec2> {
    let Some(lens) = lens else {
        return Some(pixel);
    };
    let ray = lens.ray(pixel);
    let (focal, centre) = pinhole_part(lens);
    // Beyond about 84° from the axis the ideal pixel is too far away to compute with.
    (ray.z > 0.1).then(|| centre + focal * Vec2::new(ray.x, ray.y) / ray.z)
}

/// The reverse of [`ideal_from_image`].
pub(super) fn image_from_ideal(lens: Option<&Lens>, ideal: Vec2) -> Option<Vec2> {
    let Some(lens) = lens else {
        return Some(ideal);
    };
    let (focal, centre) = pinhole_part(lens);
    let place = (ideal - centre) / focal;
    lens.project(Vec3::new(place.x, place.y, 1.0))
}

/// Focal lengths and principal point (px).
pub(super) fn pinhole_part(lens: &Lens) -> (Vec2, Vec2) {
    match *lens {
        Lens::Pinhole {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
        }
        | Lens::KannalaBrandt {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
            ..
        }
        | Lens::Brown {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
            ..
        } => (
            Vec2::new(focal_u_px, focal_v_px),
            Vec2::new(centre_u_px, centre_v_px),
        ),
    }
}

/// Moves the corners of a dark quadrilateral (px, in order around it, each within about `1.5 · rough_px` of the truth)
/// to where straight lines through its edges cross. `None` when an edge is not there.
pub(super) fn refine(gray: &Gray, rough: &[Vec2; 4], lens: Option<&Lens>, rough_px: f64) -> Option<Refined> {
    let mut image = *rough;
    let mut ideal = *rough;
    for round in 0..ROUNDS {
        let reach = match round {
            0 => widest_reach(gray, &image) + 1.5 * rough_px,
            1 => widest_reach(gray, &image),
            // Wide profiles collect noise: as narrow as the blur allows, now that it can be measured.
            _ => sharpest_reach(gray, &image).min(widest_reach(gray, &image)),
        };
        let lines = edge_lines(gray, &image, lens, reach)?;
        for index in 0..4 {
            ideal[index] = lines[(index + 3) % 4].crossing(&lines[index])?;
            image[index] = image_from_ideal(lens, ideal[index])?;
            let moved = (image[index] - rough[index]).length();
            if !(moved < 3.0 + 3.0 * rough_px) {
                return None;
            }
        }
    }
    Some(Refined { image, ideal })
}

/// A straight line in the ideal picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    through: Vec2,
    direction: Vec2,
}

impl Line {
    /// Where two lines cross, unless they are nearly parallel.
    pub(super) fn crossing(&self, other: &Line) -> Option<Vec2> {
        let cross = self.direction.perp_dot(other.direction);
        // Lines less than 5° apart are no corner.
        (cross.abs() > 0.09).then(|| {
            let along = (other.through - self.through).perp_dot(other.direction) / cross;
            self.through + self.direction * along
        })
    }
}

/// Half the length of profiles (px): wide enough to see both sides of a blurred edge, narrow enough not to reach the next
/// edge or the paper's end.
fn widest_reach(gray: &Gray, corners: &[Vec2; 4]) -> f64 {
    let lengths: [f64; 4] = std::array::from_fn(|i| (corners[(i + 1) % 4] - corners[i]).length());
    let thin = (lengths[0] + lengths[2]).min(lengths[1] + lengths[3]) / 2.0;
    (0.18 * thin).clamp(LEAST_REACH, (0.012 * gray.width as f64).max(4.0))
}

/// Half the length that profiles need (px), from how far apart a fifth and four fifths of the step are in the mean profile of
/// all edges.
fn sharpest_reach(gray: &Gray, corners: &[Vec2; 4]) -> f64 {
    let centre = middle(corners);
    let reach = widest_reach(gray, corners);
    const COUNT: usize = 48;
    let mut mean = [0.0; COUNT];
    for index in 0..4 {
        let edge = Edge::new(corners[index], corners[(index + 1) % 4], centre, reach);
        for part in 0..24 {
            let foot = edge.foot((f64::from(part) + 0.5) / 24.0);
            for (k, value) in mean.iter_mut().enumerate() {
                let place = ((k as f64 + 0.5) / COUNT as f64 * 2.0 - 1.0) * reach;
                *value += gray.sample(foot + edge.outwards * place);
            }
        }
    }
    let (dark, light) = (mean[0], mean[COUNT - 1]);
    let within = |value: &&f64| {
        let part = (**value - dark) / (light - dark);
        (0.2..0.8).contains(&part)
    };
    let width = mean.iter().filter(within).count() as f64 / COUNT as f64 * 2.0 * reach;
    // A sharp picture, sampled between pixels, has a width of about 0.8 px and ends its step 1.5 px from the edge.
    (1.0 + 1.5 * width).max(LEAST_REACH)
}

fn middle(corners: &[Vec2; 4]) -> Vec2 {
    (corners[0] + corners[1] + corners[2] + corners[3]) / 4.0
}

/// The lines through the edges from corner 0 to 1, 1 to 2, 2 to 3 and 3 to 0.
fn edge_lines(gray: &Gray, corners: &[Vec2; 4], lens: Option<&Lens>, reach: f64) -> Option<[Line; 4]> {
    let centre = middle(corners);
    let mut lines = [None; 4];
    for (index, line) in lines.iter_mut().enumerate() {
        let edge = Edge::new(corners[index], corners[(index + 1) % 4], centre, reach);
        *line = Some(edge_line(gray, &edge, reach, lens)?);
    }
    let [Some(a), Some(b), Some(c), Some(d)] = lines else {
        return None;
    };
    Some([a, b, c, d])
}

/// The part of an edge that profiles can cross.
struct Edge {
    start: Vec2,
    end: Vec2,
    /// Away from the square, one px long.
    outwards: Vec2,
}

impl Edge {
    fn new(from: Vec2, to: Vec2, centre: Vec2, reach: f64) -> Self {
        let length = (to - from).length();
        let along = (to - from).normalize_or_zero();
        let outwards = Vec2::new(along.y, -along.x);
        let outwards = if outwards.dot(from - centre) < 0.0 {
            -outwards
        } else {
            outwards
        };
        // Near a corner the profile would see the neighbouring edge.
        let margin = (0.5 + 0.6 * reach).max(0.1 * length).min(0.3 * length);
        Self {
            start: from + along * margin,
            end: to - along * margin,
            outwards,
        }
    }

    /// The place at a part (0..1) of the length.
    fn foot(&self, part: f64) -> Vec2 {
        self.start + (self.end - self.start) * part
    }
}

fn edge_line(gray: &Gray, edge: &Edge, reach: f64, lens: Option<&Lens>) -> Option<Line> {
    let places = (edge.end - edge.start).length().clamp(6.0, MOST_PLACES).ceil();
    let mut steps = Vec::with_capacity(places as usize);
    for index in 0..places as usize {
        let foot = edge.foot((index as f64 + 0.5) / places);
        if let Some((offset, contrast)) = step(gray, foot, edge.outwards, reach) {
            steps.push((foot + edge.outwards * offset, contrast));
        }
    }
    let mut contrasts: Vec<f64> = steps.iter().map(|(_, contrast)| *contrast).collect();
    contrasts.sort_by(f64::total_cmp);
    let usual = *contrasts.get(contrasts.len() / 2)?;
    // Fainter steps are reflections or dirt across the edge.
    steps.retain(|(_, contrast)| *contrast > 0.4 * usual);
    if (steps.len() as f64) < 0.5 * places {
        return None;
    }
    let points: Vec<Vec2> = steps
        .iter()
        .filter_map(|(p, _)| ideal_from_image(lens, *p))
        .collect();
    robust_line(&points)
}

/// Where along the profile through `foot` (px from it, outwards positive) the brightness steps from dark to light, and
/// by how much. The place follows from the mean: of a step from dark to light at e, a profile from -reach to +reach is
/// light for (reach - e) of its 2·reach, however blurred the step (grey moments; Tabatabai & Mitchell 1984).
fn step(gray: &Gray, foot: Vec2, outwards: Vec2, reach: f64) -> Option<(f64, f64)> {
    let count = (2.0 * reach * SAMPLES_PER_PX).ceil() as usize;
    let outer_part = (count / 6).max(1);
    let (mut sum, mut dark, mut light) = (0.0, 0.0, 0.0);
    for index in 0..count {
        let place = ((index as f64 + 0.5) / count as f64 * 2.0 - 1.0) * reach;
        let value = gray.sample(foot + outwards * place);
        sum += value;
        if index < outer_part {
            dark += value;
        }
        if index >= count - outer_part {
            light += value;
        }
    }
    let (dark, light) = (dark / outer_part as f64, light / outer_part as f64);
    let contrast = light - dark;
    if !(contrast > 8.0) {
        return None;
    }
    let light_part = (sum / count as f64 - dark) / contrast;
    Some(((reach * (1.0 - 2.0 * light_part)).clamp(-reach, reach), contrast))
}

/// The line with the least sum of weighted squared distances, points far from it losing their weight (Tukey).
pub(super) fn robust_line(points: &[Vec2]) -> Option<Line> {
    let mut weights = vec![1.0; points.len()];
    let mut line = None;
    for _ in 0..6 {
        let fitted = weighted_line(points, &weights)?;
        line = Some(fitted);
        let mut distances: Vec<f64> = points
            .iter()
            .map(|p| fitted.direction.perp_dot(*p - fitted.through).abs())
            .collect();
        for (weight, distance) in weights.iter_mut().zip(&distances) {
            *weight = *distance;
        }
        distances.sort_by(f64::total_cmp);
        // 1.4826 · median = standard deviation of a normal distribution; at least 0.05 px, so that noise-free
        // pictures keep all points.
        let limit = 4.0 * (1.4826 * distances[distances.len() / 2]).max(0.05);
        for weight in &mut weights {
            let part = *weight / limit;
            let kept = (1.0 - part * part).max(0.0);
            *weight = kept * kept;
        }
    }
    line
}

fn weighted_line(points: &[Vec2], weights: &[f64]) -> Option<Line> {
    let total: f64 = weights.iter().sum();
    if !(total > 2.0) {
        return None;
    }
    let through = points.iter().zip(weights).map(|(p, w)| *p * *w).sum::<Vec2>() / total;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (point, weight) in points.iter().zip(weights) {
        let d = *point - through;
        xx += weight * d.x * d.x;
        xy += weight * d.x * d.y;
        yy += weight * d.y * d.y;
    }
    // The eigenvector of the larger eigenvalue of the scatter matrix, in the form that does not cancel.
    let half = (xx - yy) / 2.0;
    let root = (half * half + xy * xy).sqrt();
    let direction = if half >= 0.0 {
        Vec2::new(half + root, xy)
    } else {
        Vec2::new(xy, root - half)
    };
    direction
        .try_normalize()
        .map(|direction| Line { through, direction })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A dark square of side 30 px, turned, in a white picture, each pixel the mean over 16x16 places: level edges are up to 1/32 px off.
    fn drawn(middle: Vec2, turn: f64) -> (Gray, [Vec2; 4]) {
        let (s, c) = senda_geom::trig::sincos(turn);
        let (along, across) = (Vec2::new(c, s), Vec2::new(-s, c));
        let values = (0..64 * 64)
            .map(|i| {
                let inside = (0..256).filter(|k| {
                    let sub = Vec2::new((k % 16) as f64 + 0.5, (k / 16) as f64 + 0.5) / 16.0;
                    let p = Vec2::new((i % 64) as f64, (i / 64) as f64) + sub - middle;
                    p.dot(along).abs() < 15.0 && p.dot(across).abs() < 15.0
                });
                220.0 - 200.0 * inside.count() as f32 / 256.0
            })
            .collect();
        let corner = |a: f64, b: f64| middle + along * a + across * b;
        let corners = [
            corner(-15.0, -15.0),
            corner(15.0, -15.0),
            corner(15.0, 15.0),
            corner(-15.0, 15.0),
        ];
        (
            Gray {
                width: 64,
                height: 64,
                values,
            },
            corners,
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn corners_come_back_within_a_tenth_of_a_pixel(
            x in 31.0..33.0f64, y in 31.0..33.0f64, turn in -0.7..0.7f64, off in prop::array::uniform8(-1.0..1.0f64),
        ) {
            let (gray, truth) = drawn(Vec2::new(x, y), turn);
            let rough = std::array::from_fn(|i| truth[i] + Vec2::new(off[2 * i], off[2 * i + 1]));
            let refined = refine(&gray, &rough, None, 1.0).unwrap();
            for (found, true_corner) in refined.image.iter().zip(truth) {
                prop_assert!((*found - true_corner).length() < 0.1, "{found} {true_corner}");
            }
        }
    }

    #[test]
    fn where_there_is_no_edge_there_is_no_corner() {
        let gray = Gray {
            width: 64,
            height: 64,
            values: vec![90.0; 64 * 64],
        };
        let rough = [(20.0, 20.0), (40.0, 20.0), (40.0, 40.0), (20.0, 40.0)].map(|(x, y)| Vec2::new(x, y));
        assert!(refine(&gray, &rough, None, 1.0).is_none());
    }

    #[test]
    fn ideal_pixels_invert() {
        let lens = Lens::equidistant(320, 240, 2.0);
        for pixel in [
            Vec2::new(30.0, 200.0),
            Vec2::new(160.0, 120.0),
            Vec2::new(250.0, 40.0),
        ] {
            let ideal = ideal_from_image(Some(&lens), pixel).unwrap();
            assert!((image_from_ideal(Some(&lens), ideal).unwrap() - pixel).length() < 1e-6);
        }
        let back = Lens::equidistant(320, 240, 4.0);
        assert!(ideal_from_image(Some(&back), Vec2::new(2.0, 120.0)).is_none());
    }
}
