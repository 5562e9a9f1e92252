//! Which part of the floor a camera looks at, level of detail by level of detail.

use super::kernel::{Detail, Positions, STEPS_PER_TEXEL};
use senda_geom::{Vec2, trig};
use std::f64::consts::PI;
use std::ops::Range;

/// Sides of an outline, at most.
const SIDES: usize = 16;

/// Texels (of its own level) that a look reaches beyond its place: the right and lower neighbour, and rounding.
const REACH: f64 = 2.5;

/// A convex outline around everything that a camera looks up in one level, in texels of level 0, in the vehicle frame.
#[derive(Debug, Clone)]
pub(super) struct Outline {
    pub(super) level: usize,
    corners: Vec<Vec2>,
    /// Distance of the farthest corner from the vehicle.
    radius: f64,
}

/// Where a vehicle stands, in texels of level 0, and how far it may be from there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stand {
    pub(super) at: Vec2,
    pub(super) cos: f64,
    pub(super) sin: f64,
    /// Texels.
    pub(super) astray: f64,
    /// Angle (rad).
    pub(super) turned: f64,
}

impl Stand {
    /// The same place with more room around it (texels; angle in rad).
    pub(super) fn widened(&self, astray: f64, turned: f64) -> Self {
        Self {
            astray: self.astray + astray,
            turned: self.turned + turned,
            ..*self
        }
    }

    /// Whether everything that is seen from the other stand is seen from this one too. What a turn moves, it moves by the chord of
    /// the angle times the distance, which is how outlines take it.
    pub(super) fn covers(&self, other: &Self) -> bool {
        let chord = Vec2::new(self.cos - other.cos, self.sin - other.sin).length();
        (self.at - other.at).length() + other.astray <= self.astray && chord + other.turned <= self.turned
    }
}

/// Equal squares over a texture, and what lies around them: row and column 0 lie before the texture, 1 and following
/// on it, the last ones beyond it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Squares {
    /// Side of a square (texels of level 0).
    pub(super) side: usize,
    /// Size of the texture (texels of level 0).
    pub(super) size: [usize; 2],
}

impl Squares {
    /// Columns and rows, with those before and beyond the texture.
    pub(super) fn count(&self) -> [usize; 2] {
        self.size.map(|size| size.div_ceil(self.side) + 2)
    }

    /// The column (axis 0) or row (axis 1) of a place.
    fn index(&self, place: f64, axis: usize) -> usize {
        if place < 0.0 {
            0
        } else if place >= self.size[axis] as f64 {
            self.size[axis].div_ceil(self.side) + 1
        } else {
            place as usize / self.side + 1
        }
    }

    /// What a row covers along y.
    fn band(&self, row: usize) -> [f64; 2] {
        let last = self.size[1].div_ceil(self.side);
        let edge = |row: usize| (row * self.side).min(self.size[1]) as f64;
        match row {
            0 => [f64::NEG_INFINITY, 0.0],
            row if row > last => [self.size[1] as f64, f64::INFINITY],
            row => [edge(row - 1), edge(row)],
        }
    }
}

impl Outline {
    /// The outlines of a camera's groups, the finest level first.
    pub(super) fn of_groups<'a>(groups: impl Iterator<Item = (&'a Positions, &'a Detail)>) -> Vec<Self> {
        let directions: [Vec2; SIDES] = std::array::from_fn(|i| {
            let (sin, cos) = trig::sincos(2.0 * PI * i as f64 / SIDES as f64);
            Vec2::new(cos, sin)
        });
        let mut supports: Vec<Option<[f64; SIDES]>> = Vec::new();
        for (at, detail) in groups {
            let level = usize::from(detail.level);
            let scale = f64::from(1u32 << level) / STEPS_PER_TEXEL;
            let (low, high) =
                at.x.iter()
                    .zip(&at.y)
                    .fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), (x, y)| {
                        let point = Vec2::new(f64::from(*x), f64::from(*y));
                        (low.min(point), high.max(point))
                    });
            let spread = Vec2::new(f64::from(detail.spread[0]), f64::from(detail.spread[1])).abs();
            let middle = (low + high) * (0.5 * scale);
            let half = (high - low + spread) * (0.5 * scale) + Vec2::splat(REACH * f64::from(1u32 << level));
            if supports.len() <= level {
                supports.resize(level + 1, None);
            }
            let support = supports[level].get_or_insert([f64::NEG_INFINITY; SIDES]);
            for (support, direction) in support.iter_mut().zip(&directions) {
                *support = support.max(middle.dot(*direction) + half.dot(direction.abs()));
            }
        }
        let outline = |(level, support): (usize, Option<[f64; SIDES]>)| {
            let corners = intersection(&directions, &support?);
            Some(Self {
                level,
                radius: corners
                    .iter()
                    .fold(0.0, |radius: f64, corner| radius.max(corner.length())),
                corners,
            })
        };
        supports.into_iter().enumerate().filter_map(outline).collect()
    }

    /// The squares that the outline may touch: calls `visit` with a row and a range of columns until it answers `true`,
    /// and says whether it did. `spans` is working memory.
    pub(super) fn any_touched(
        &self,
        stand: &Stand,
        squares: &Squares,
        spans: &mut Vec<[f64; 2]>,
        mut visit: impl FnMut(usize, Range<usize>) -> bool,
    ) -> bool {
        let margin = stand.astray + stand.turned * self.radius + 1.0;
        let turned = |corner: &Vec2| {
            stand.at
                + Vec2::new(
                    stand.cos * corner.x - stand.sin * corner.y,
                    stand.sin * corner.x + stand.cos * corner.y,
                )
        };
        let lowest = self
            .corners
            .iter()
            .map(|c| turned(c).y)
            .fold(f64::INFINITY, f64::min);
        let highest = self
            .corners
            .iter()
            .map(|c| turned(c).y)
            .fold(f64::NEG_INFINITY, f64::max);
        let first = squares.index(lowest - margin, 1);
        let last = squares.index(highest + margin, 1);
        spans.clear();
        spans.resize(last - first + 1, [f64::INFINITY, f64::NEG_INFINITY]);
        let mut before = turned(&self.corners[self.corners.len() - 1]);
        for corner in &self.corners {
            let here = turned(corner);
            let (low, high) = if before.y < here.y {
                (before, here)
            } else {
                (here, before)
            };
            before = here;
            for row in squares.index(low.y - margin, 1)..=squares.index(high.y + margin, 1) {
                // The part of the edge beside this row, widened by the margin.
                let [from, to] = squares.band(row);
                let part = |y: f64| {
                    let y = y.clamp(low.y, high.y);
                    let rise = high.y - low.y;
                    if rise > 1e-9 { (y - low.y) / rise } else { 0.0 }
                };
                let (mut a, mut b) = (
                    low.lerp(high, part(from - margin)),
                    low.lerp(high, part(to + margin)),
                );
                if high.y - low.y <= 1e-9 {
                    (a, b) = (low, high);
                }
                let span = &mut spans[row - first];
                *span = [span[0].min(a.x).min(b.x), span[1].max(a.x).max(b.x)];
            }
        }
        spans.iter().enumerate().any(|(i, [low, high])| {
            if low > high {
                return false;
            }
            let columns = squares.index(low - margin, 0)..squares.index(high + margin, 0) + 1;
            visit(first + i, columns)
        })
    }
}

/// Corners of the convex polygon of all points whose component along each direction is at most its support.
fn intersection(directions: &[Vec2; SIDES], supports: &[f64; SIDES]) -> Vec<Vec2> {
    const FAR: f64 = 1e9;
    let mut corners = vec![
        Vec2::new(-FAR, -FAR),
        Vec2::new(FAR, -FAR),
        Vec2::new(FAR, FAR),
        Vec2::new(-FAR, FAR),
    ];
    for (direction, support) in directions.iter().zip(supports) {
        let beyond = |corner: Vec2| corner.dot(*direction) - support;
        let mut kept = Vec::with_capacity(corners.len() + 1);
        for (i, a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            let (before, after) = (beyond(*a), beyond(b));
            if before <= 0.0 {
                kept.push(*a);
            }
            if (before < 0.0 && after > 0.0) || (before > 0.0 && after < 0.0) {
                kept.push(a.lerp(b, before / (before - after)));
            }
        }
        corners = kept;
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wider_stand_covers_small_moves_and_turns() {
        let stand = |x: f64, heading: f64, astray: f64, turned: f64| {
            let (sin, cos) = trig::sincos(heading);
            Stand {
                at: Vec2::new(x, 0.0),
                cos,
                sin,
                astray,
                turned,
            }
        };
        let wide = stand(0.0, 3.13, 0.0, 0.0).widened(10.0, 0.05);
        assert!(wide.covers(&stand(9.9, 3.13, 0.0, 0.0)));
        assert!(wide.covers(&stand(0.0, -3.12, 0.0, 0.0)));
        assert!(!wide.covers(&stand(10.1, 3.13, 0.0, 0.0)));
        assert!(!wide.covers(&stand(0.0, 3.05, 0.0, 0.0)));
        // What the other one strays while its shutter is open counts too.
        assert!(!wide.covers(&stand(9.0, 3.13, 2.0, 0.0)));
        assert!(!wide.covers(&stand(0.0, 3.10, 0.0, 0.03)));
    }
}
