//! Straight line segments in a mask: the progressive probabilistic Hough transform (Matas, Galambos, Kittler 2000),
//! as A4 in SPEC uses it.

use senda_geom::trig;
use std::f64::consts::PI;

/// What counts as a segment. The defaults are A4's.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HoughOptions {
    /// Distance between neighbouring lines of the accumulator (px).
    pub distance_step_px: f64,
    /// Angle between them (rad).
    pub angle_step_rad: f64,
    /// Votes that start a segment.
    pub votes: u32,
    /// Shortest segment (px, along the longer axis).
    pub length_min_px: u32,
    /// Longest gap within a segment (px, along the longer axis).
    pub gap_max_px: u32,
}

impl Default for HoughOptions {
    fn default() -> Self {
        Self {
            distance_step_px: 1.0,
            angle_step_rad: PI / 180.0,
            votes: 25,
            length_min_px: 10,
            gap_max_px: 6,
        }
    }
}

/// A segment between two pixels: u, v of each end (pixel indices).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Segment {
    /// One end.
    pub from: [u32; 2],
    /// The other end.
    pub to: [u32; 2],
}

/// Finds segments; owns its memory. The order in which points vote is drawn from a fixed sequence: the same mask gives
/// the same segments.
#[derive(Debug, Clone)]
pub struct Hough {
    options: HoughOptions,
    /// Cosine and sine of each angle, divided by the distance step.
    directions: Vec<[f64; 2]>,
    votes: Vec<u32>,
    points: Vec<[u32; 2]>,
    left: Vec<u8>,
    segments: Vec<Segment>,
}

/// A point has not voted, has voted, or is no (longer a) point.
const WAITING: u8 = 1;
const VOTED: u8 = 2;
const GONE: u8 = 0;

impl Hough {
    /// With options; steps that are not positive become the defaults.
    pub fn new(options: HoughOptions) -> Self {
        let default = HoughOptions::default();
        let positive = |value: f64, default: f64| if value > 1e-3 { value } else { default };
        let angle_step = positive(options.angle_step_rad, default.angle_step_rad);
        let distance_step = positive(options.distance_step_px, default.distance_step_px);
        let count = (PI / angle_step).round().max(1.0) as usize;
        let directions = (0..count)
            .map(|i| {
                let (sin, cos) = trig::sincos(i as f64 * PI / count as f64);
                [cos / distance_step, sin / distance_step]
            })
            .collect();
        Self {
            options,
            directions,
            votes: Vec::new(),
            points: Vec::new(),
            left: Vec::new(),
            segments: Vec::new(),
        }
    }

    /// The segments of a mask (bytes 0 and not 0, rows of `width`), in the order in which they were found.
    ///
    /// # Panics
    /// When the length is not whole rows.
    pub fn segments(&mut self, mask: &[u8], width: usize) -> &[Segment] {
        self.segments.clear();
        if mask.is_empty() {
            return &[];
        }
        assert!(
            width > 0 && mask.len().is_multiple_of(width),
            "expected whole rows"
        );
        let height = mask.len() / width;
        let scale = self.directions[0][0].abs();
        let reach = ((width + height) as f64 * scale).ceil() as i64 + 1;
        let row = 2 * reach as usize + 1;
        self.votes.clear();
        self.votes.resize(self.directions.len() * row, 0);
        self.points.clear();
        self.left.clear();
        self.left
            .extend(mask.iter().map(|bit| if *bit != 0 { WAITING } else { GONE }));
        for (index, bit) in mask.iter().enumerate() {
            if *bit != 0 {
                self.points.push([(index % width) as u32, (index / width) as u32]);
            }
        }
        let mut state = 0x2545_f491_4f6c_dd1du64;
        for remaining in (1..=self.points.len()).rev() {
            // Marsaglia's xorshift, a fixed start: a shuffle, not chance.
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            let drawn = (state % remaining as u64) as usize;
            let point = self.points.swap_remove(drawn);
            let index = point[1] as usize * width + point[0] as usize;
            if self.left[index] != WAITING {
                continue;
            }
            self.left[index] = VOTED;
            let (mut best, mut best_angle) = (0, 0);
            for angle in 0..self.directions.len() {
                let votes = &mut self.votes[angle * row..][..row][slot(self.directions[angle], point, reach)];
                *votes += 1;
                if *votes > best {
                    (best, best_angle) = (*votes, angle);
                }
            }
            if best >= self.options.votes {
                self.take(point, best_angle, width, height, reach);
            }
        }
        &self.segments
    }

    /// Walks both ways along a line through a point, takes the pixels that it meets out of the vote, and keeps the
    /// segment if it is long enough.
    fn take(&mut self, point: [u32; 2], angle: usize, width: usize, height: usize, reach: i64) {
        let [cos, sin] = self.directions[angle];
        // The line runs across its normal; one step is one pixel along the longer axis.
        let longer = cos.abs().max(sin.abs());
        let step = [-sin / longer, cos / longer];
        let mut ends = [point; 2];
        let walk = |direction: f64, visit: &mut dyn FnMut(usize, [u32; 2]) -> bool| {
            for i in 0.. {
                let x = (f64::from(point[0]) + direction * f64::from(i) * step[0]).round();
                let y = (f64::from(point[1]) + direction * f64::from(i) * step[1]).round();
                if !(x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64)
                    || !visit(y as usize * width + x as usize, [x as u32, y as u32])
                {
                    return;
                }
            }
        };
        for (end, direction) in [1.0, -1.0].into_iter().enumerate() {
            let (left, mut gap) = (&self.left, 0);
            walk(direction, &mut |index, pixel| {
                gap = if left[index] == GONE { gap + 1 } else { 0 };
                if gap == 0 {
                    ends[end] = pixel;
                }
                gap <= self.options.gap_max_px
            });
        }
        let [from, to] = ends;
        let length = from[0].abs_diff(to[0]).max(from[1].abs_diff(to[1]));
        let long_enough = length >= self.options.length_min_px;
        let (left, votes, directions) = (&mut self.left, &mut self.votes, &self.directions);
        let row = 2 * reach as usize + 1;
        for (end, direction) in [1.0, -1.0].into_iter().enumerate() {
            walk(direction, &mut |index, pixel| {
                if left[index] == VOTED && long_enough {
                    for (angle, normal) in directions.iter().enumerate() {
                        votes[angle * row + slot(*normal, pixel, reach)] -= 1;
                    }
                }
                left[index] = GONE;
                pixel != ends[end]
            });
        }
        if long_enough {
            self.segments.push(Segment { from, to });
        }
    }
}

/// Which distance from the corner the line through a point with a normal has.
#[inline(always)]
fn slot([cos, sin]: [f64; 2], [x, y]: [u32; 2], reach: i64) -> usize {
    ((f64::from(x) * cos + f64::from(y) * sin).round() as i64 + reach) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(width: usize, height: usize, lines: &[([f64; 2], [f64; 2])]) -> Vec<u8> {
        let mut mask = vec![0; width * height];
        for (from, to) in lines {
            for i in 0..=400 {
                let part = f64::from(i) / 400.0;
                let x = (from[0] + part * (to[0] - from[0])).round() as usize;
                let y = (from[1] + part * (to[1] - from[1])).round() as usize;
                mask[y * width + x] = 255;
            }
        }
        mask
    }

    fn near(segment: &Segment, from: [f64; 2], to: [f64; 2]) -> bool {
        let close = |a: [u32; 2], b: [f64; 2]| {
            (f64::from(a[0]) - b[0]).abs() <= 4.0 && (f64::from(a[1]) - b[1]).abs() <= 4.0
        };
        (close(segment.from, from) && close(segment.to, to))
            || (close(segment.from, to) && close(segment.to, from))
    }

    #[test]
    fn lines_of_every_direction_are_found_with_their_ends() {
        for (from, to) in [
            ([10.0, 50.0], [110.0, 50.0]),
            ([60.0, 5.0], [60.0, 90.0]),
            ([10.0, 10.0], [90.0, 85.0]),
            ([20.0, 90.0], [100.0, 15.0]),
            ([30.0, 90.0], [55.0, 10.0]),
        ] {
            let mut hough = Hough::new(HoughOptions::default());
            let segments = hough.segments(&mask(120, 100, &[(from, to)]), 120);
            assert!(
                segments.iter().any(|segment| near(segment, from, to)),
                "{from:?} {to:?}: {segments:?}"
            );
        }
    }

    #[test]
    fn gaps_within_the_limit_are_bridged_and_longer_ones_part() {
        let options = HoughOptions {
            votes: 15,
            ..HoughOptions::default()
        };
        let two = |gap: f64| {
            mask(
                120,
                40,
                &[([5.0, 20.0], [50.0, 20.0]), ([50.0 + gap, 20.0], [110.0, 20.0])],
            )
        };
        let mut hough = Hough::new(options);
        assert_eq!(hough.segments(&two(5.0), 120).len(), 1);
        assert_eq!(hough.segments(&two(15.0), 120).len(), 2);
    }

    #[test]
    fn the_same_mask_gives_the_same_segments() {
        let picture = mask(
            120,
            100,
            &[([10.0, 10.0], [90.0, 85.0]), ([20.0, 90.0], [100.0, 15.0])],
        );
        let mut used = Hough::new(HoughOptions::default());
        let first = used.segments(&picture, 120).to_vec();
        assert_eq!(first, used.segments(&picture, 120));
        assert!(first.len() >= 2);
    }

    #[test]
    fn empty_and_full_masks_do_no_harm() {
        let mut hough = Hough::new(HoughOptions {
            distance_step_px: 0.0,
            angle_step_rad: f64::NAN,
            ..Default::default()
        });
        assert!(hough.segments(&[], 0).is_empty());
        assert!(hough.segments(&[0; 64], 8).is_empty());
        hough.segments(&[255; 64 * 48], 64);
    }
}
