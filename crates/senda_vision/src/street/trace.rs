//! The line from the vehicle outwards, on the floor: rings of 2 cm around the vehicle, clusters of green in each, and the
//! chain of clusters that continues the line (D2 in SPEC takes the median column of the lowest rows instead).

use senda_geom::{Vec2, trig};

/// Depth of a ring (m).
const RING_M: f64 = 0.02;
/// Rings reach this far (m).
const REACH_M: f64 = 1.5;
/// A line may be hidden for this long (m): a crossing over it is 8 cm deep.
const LONGEST_GAP_M: f64 = 0.13;
/// The next cluster may lie this far beside the line's continuation (m), and this much more per metre of gap.
const GATE_M: f64 = 0.022;
const GATE_PER_M: f64 = 0.45;

/// Green pixels of one ring that hang together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cluster {
    /// Their mean (vehicle frame, m).
    pub at: Vec2,
    /// Their extent across the ring (m).
    pub width_m: f64,
    /// Number of pixels.
    pub pixels: usize,
}

/// Where the line's near end should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected {
    /// To the left (m).
    pub left_m: f64,
    /// How far from there it may be (m).
    pub within_m: f64,
}

impl Default for Expected {
    fn default() -> Self {
        Self {
            left_m: 0.0,
            within_m: 0.16,
        }
    }
}

/// A line as points from the vehicle outwards.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trace {
    /// Points (vehicle frame, m); their distances from the origin grow.
    pub points: Vec<Vec2>,
}

impl Trace {
    /// From the first to the last point (m).
    pub fn length_m(&self) -> f64 {
        self.points
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).length())
            .sum()
    }

    /// The point at a distance from the origin (m), between two points of the trace; the nearest end beyond them. `None` for an
    /// empty trace.
    pub fn at_distance(&self, distance_m: f64) -> Option<Vec2> {
        let (first, last) = (self.points.first()?, self.points.last()?);
        if distance_m <= first.length() {
            return Some(*first);
        }
        for pair in self.points.windows(2) {
            let (near, far) = (pair[0].length(), pair[1].length());
            if distance_m <= far {
                let part = (distance_m - near) / (far - near).max(1e-9);
                return Some(pair[0].lerp(pair[1], part.clamp(0.0, 1.0)));
            }
        }
        Some(*last)
    }

    /// Direction of the first `over_m` (rad, left positive), by its ends; `None` when there is not that much.
    pub fn direction_rad(&self, over_m: f64) -> Option<f64> {
        let first = self.points.first()?;
        let end = self
            .points
            .iter()
            .find(|point| (**point - *first).length() >= over_m)?;
        let along = *end - *first;
        Some(trig::atan2(along.y, along.x))
    }
}

/// Green pixels of a frame by distance.
#[derive(Debug, Clone)]
pub struct Rings {
    /// Tangent of the bearing, x and y of each pixel, by ring.
    pixels: Vec<Vec<[f64; 3]>>,
    clusters: Vec<Vec<Cluster>>,
}

impl Default for Rings {
    fn default() -> Self {
        let count = (REACH_M / RING_M).ceil() as usize;
        Self {
            pixels: vec![Vec::new(); count],
            clusters: vec![Vec::new(); count],
        }
    }
}

impl Rings {
    pub(super) fn clear(&mut self) {
        for ring in &mut self.pixels {
            ring.clear();
        }
    }

    pub(super) fn push(&mut self, point: Vec2) {
        let index = (point.length() / RING_M) as usize;
        if let Some(ring) = self.pixels.get_mut(index) {
            ring.push([point.y / point.x, point.x, point.y]);
        }
    }

    /// Takes each ring's pixels together, from right to left.
    pub(super) fn cluster(&mut self) {
        for (index, (pixels, clusters)) in self.pixels.iter_mut().zip(&mut self.clusters).enumerate() {
            clusters.clear();
            pixels.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
            let distance_m = (index as f64 + 0.5) * RING_M;
            // A pixel of 320 spans 0.0036 of its distance; a lost one in between does not part a line.
            let gap = (0.008f64).max(0.012 * distance_m) / distance_m;
            let mut begin = 0;
            for end in 1..=pixels.len() {
                if end < pixels.len() && pixels[end][0] - pixels[end - 1][0] < gap {
                    continue;
                }
                let part = &pixels[begin..end];
                begin = end;
                if part.len() < 2 && distance_m < 1.0 {
                    continue;
                }
                let sum = part.iter().fold(Vec2::ZERO, |sum, p| sum + Vec2::new(p[1], p[2]));
                clusters.push(Cluster {
                    at: sum / part.len() as f64,
                    width_m: (part[part.len() - 1][0] - part[0][0]) * distance_m,
                    pixels: part.len(),
                });
            }
        }
    }

    /// All clusters with their ring's number.
    pub(super) fn clusters(&self) -> impl Iterator<Item = &Cluster> {
        self.clusters.iter().flatten()
    }

    /// The chain of clusters that begins where the line is expected.
    pub(super) fn trace(&self, expected: Expected, trace: &mut Trace) {
        /// The line's near end is within this distance (m), or it is not under the vehicle any more.
        const BEGIN_M: f64 = 0.48;
        trace.points.clear();
        for (index, ring) in self.clusters.iter().enumerate() {
            let distance_m = (index as f64 + 0.5) * RING_M;
            let best = match trace.points.last().copied() {
                None if distance_m > BEGIN_M => return,
                None => {
                    let away = |cluster: &Cluster| (cluster.at.y - expected.left_m).abs();
                    nearest(ring, away, expected.within_m)
                }
                Some(last) => {
                    let gap_m = distance_m - last.length();
                    if gap_m > LONGEST_GAP_M {
                        return;
                    }
                    let direction = heading(&trace.points);
                    let away = |cluster: &Cluster| {
                        let step = cluster.at - last;
                        // Beside the continuation; backwards is nowhere.
                        if step.dot(direction) <= 0.0 {
                            return f64::INFINITY;
                        }
                        step.perp_dot(direction).abs()
                    };
                    nearest(ring, away, GATE_M + GATE_PER_M * gap_m.max(0.0))
                }
            };
            if let Some(cluster) = best {
                trace.points.push(cluster.at);
            }
        }
    }
}

fn nearest(ring: &[Cluster], away: impl Fn(&Cluster) -> f64, within_m: f64) -> Option<&Cluster> {
    ring.iter()
        .min_by(|a, b| away(a).total_cmp(&away(b)))
        .filter(|cluster| away(cluster) <= within_m)
}

/// Direction in which a chain goes on: of its last 6 cm; straight ahead at first.
fn heading(points: &[Vec2]) -> Vec2 {
    let last = points[points.len() - 1];
    let from = points.iter().rev().find(|point| (last - **point).length() > 0.05);
    match from {
        Some(from) => (last - *from).normalize(),
        None => {
            // Little is known yet: a mix of straight ahead and what there is.
            let along = last - points[0];
            (Vec2::new(0.06, 0.0) + along).normalize()
        }
    }
}
