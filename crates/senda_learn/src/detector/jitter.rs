//! Pictures moved and scaled, with their boxes: darknet's jitter. What is learned of one place is then known at others.

use rand::{Rng, RngExt};
use senda_nets::{Boxed, Rect};

/// So much of every box must stay in the picture; less could not be labelled.
const STAYS: f32 = 0.7;
/// Boxes do not become lower than this part of the picture: what is labelled in pictures from the simulator is higher.
const LOWEST: f32 = 0.075;
/// A box that ends nearer to the picture's edge than this may be cut by it.
const EDGE: f32 = 0.01;
/// Draws until one is found that leaves the boxes whole enough; then the picture stays as it is.
const TRIES: usize = 5;

/// Where a place (part of the picture, along one axis) goes: `scale · place + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Move {
    scale: f32,
    shift: f32,
}

impl Move {
    fn draw(by: f64, zoom: f64, rng: &mut impl Rng) -> Self {
        let shift = rng.random_range(-by..=by);
        // Around the middle.
        Self {
            scale: zoom as f32,
            shift: (0.5 - 0.5 * zoom + shift) as f32,
        }
    }

    /// Both ends of an interval, cut at the picture's edges, with the part of it that is left. `None`: it was cut by an edge
    /// that now comes into view, so nobody knows where the thing ends.
    fn interval(self, low: f32, high: f32) -> Option<(f32, f32, f32)> {
        let (from, to) = (self.scale * low + self.shift, self.scale * high + self.shift);
        if (low < EDGE && from > EDGE) || (high > 1.0 - EDGE && to < 1.0 - EDGE) {
            return None;
        }
        let (seen_from, seen_to) = (from.max(0.0), to.min(1.0));
        Some((
            seen_from,
            seen_to,
            (seen_to - seen_from) / (to - from).max(f32::MIN_POSITIVE),
        ))
    }
}

/// Moves by up to `by` of width and height and scales by up to `1 ± by`; `channels` planes of `height` x `width` bytes. Returns
/// the boxes of the new picture.
pub(super) fn jitter(
    by: f64,
    [channels, height, width]: [usize; 3],
    pixels: &mut [u8],
    truths: &[Boxed],
    source: &mut Vec<u8>,
    rng: &mut impl Rng,
) -> Vec<Boxed> {
    if by <= 0.0 {
        return truths.to_vec();
    }
    for _ in 0..TRIES {
        let zoom = rng.random_range(1.0 - by..=1.0 + by);
        let across = Move::draw(by, zoom, rng);
        let down = Move::draw(by, zoom, rng);
        if let Some(moved) = truths.iter().map(|truth| place(truth, across, down)).collect() {
            source.clear();
            source.extend_from_slice(pixels);
            for (plane, out) in source
                .chunks_exact(height * width)
                .zip(pixels.chunks_exact_mut(height * width))
                .take(channels)
            {
                resample(plane, out, width, across, down);
            }
            return moved;
        }
    }
    truths.to_vec()
}

fn place(truth: &Boxed, across: Move, down: Move) -> Option<Boxed> {
    let rect = truth.rect;
    let (left, right, part_across) = across.interval(rect.x - 0.5 * rect.width, rect.x + 0.5 * rect.width)?;
    let (top, bottom, part_down) = down.interval(rect.y - 0.5 * rect.height, rect.y + 0.5 * rect.height)?;
    (part_across * part_down >= STAYS && bottom - top >= LOWEST).then_some(Boxed {
        rect: Rect {
            x: 0.5 * (left + right),
            y: 0.5 * (top + bottom),
            width: right - left,
            height: bottom - top,
        },
        ..*truth
    })
}

/// Bilinear; beyond the edges the edge goes on.
fn resample(plane: &[u8], out: &mut [u8], width: usize, across: Move, down: Move) {
    let height = plane.len() / width.max(1);
    let taps = |way: Move, count: usize| -> Vec<(usize, usize, f32)> {
        (0..count)
            .map(|index| {
                let place = ((index as f32 + 0.5) / count as f32 - way.shift) / way.scale;
                let at = (place * count as f32 - 0.5).clamp(0.0, (count - 1) as f32);
                let low = at as usize;
                (low, (low + 1).min(count - 1), at - low as f32)
            })
            .collect()
    };
    let columns = taps(across, width);
    for (row, (upper, lower, part)) in out.chunks_exact_mut(width).zip(taps(down, height)) {
        let (upper, lower) = (&plane[upper * width..][..width], &plane[lower * width..][..width]);
        for (value, (left, right, along)) in row.iter_mut().zip(&columns) {
            let mix = |row: &[u8]| {
                let (a, b) = (f32::from(row[*left]), f32::from(row[*right]));
                a + (b - a) * along
            };
            let (a, b) = (mix(upper), mix(lower));
            *value = (a + (b - a) * part + 0.5) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn boxed(x: f32, y: f32, width: f32, height: f32) -> Boxed {
        Boxed {
            class: 2,
            confidence: 1.0,
            rect: Rect { x, y, width, height },
        }
    }

    /// A bright rectangle on dark: afterwards the box still is where the brightness is.
    #[test]
    fn boxes_go_where_their_things_go() {
        let (width, height) = (80, 60);
        let truth = boxed(0.5, 0.4, 0.2, 0.3);
        let mut moved_at_all = 0;
        for seed in 0..40 {
            let mut pixels = vec![10u8; 3 * width * height];
            for plane in pixels.chunks_exact_mut(width * height) {
                for v in 15..33 {
                    plane[v * width + 32..v * width + 48].fill(210);
                }
            }
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let found = jitter(
                0.2,
                [3, height, width],
                &mut pixels,
                &[truth],
                &mut Vec::new(),
                &mut rng,
            );
            let rect = found[0].rect;
            moved_at_all += usize::from(rect != truth.rect);
            let bright: Vec<(usize, usize)> = (0..width * height)
                .filter(|at| pixels[*at] > 110)
                .map(|at| (at % width, at / width))
                .collect();
            let end = |values: Vec<usize>| (*values.iter().min().unwrap(), *values.iter().max().unwrap() + 1);
            let (left, right) = end(bright.iter().map(|at| at.0).collect());
            let (top, bottom) = end(bright.iter().map(|at| at.1).collect());
            let near = |part: f32, full: usize, px: usize| (part * full as f32 - px as f32).abs() < 1.2;
            assert!(near(rect.x - 0.5 * rect.width, width, left), "{rect:?} {left}");
            assert!(near(rect.x + 0.5 * rect.width, width, right), "{rect:?} {right}");
            assert!(near(rect.y - 0.5 * rect.height, height, top), "{rect:?} {top}");
            assert!(
                near(rect.y + 0.5 * rect.height, height, bottom),
                "{rect:?} {bottom}"
            );
        }
        assert!(moved_at_all > 30, "{moved_at_all}");
    }

    #[test]
    fn what_an_edge_cut_stays_at_that_edge() {
        let truth = boxed(0.05, 0.5, 0.1, 0.3);
        for seed in 0..40 {
            let mut pixels = vec![0u8; 3 * 20 * 20];
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let found = jitter(0.2, [3, 20, 20], &mut pixels, &[truth], &mut Vec::new(), &mut rng);
            let left = found[0].rect.x - 0.5 * found[0].rect.width;
            assert!(left < EDGE, "{left}");
        }
    }

    #[test]
    fn none_is_none() {
        let truth = [boxed(0.5, 0.5, 0.1, 0.3)];
        let mut pixels: Vec<u8> = (0..48).collect();
        let before = pixels.clone();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let found = jitter(0.0, [3, 4, 4], &mut pixels, &truth, &mut Vec::new(), &mut rng);
        assert_eq!((found.as_slice(), pixels), (&truth[..], before));
    }
}
