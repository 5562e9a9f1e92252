//! A red zebra crossing ahead: how far its near edge is and how the vehicle stands to it (D4 in SPEC).

use senda_geom::{Vec2, trig};

/// A crossing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// From the vehicle's origin to the near edge, straight ahead (m).
    pub distance_m: f64,
    /// Direction of the street, which is across the edge (rad, left positive): 0 when the vehicle stands square to it.
    pub angle_rad: f64,
    /// To the left: the middle of what is seen of it (m).
    pub left_m: f64,
    /// Width of what is seen (m).
    pub width_m: f64,
    /// Red pixels.
    pub pixels: usize,
}

/// Fewest red pixels of a crossing (noise and far crossings have fewer).
const FEWEST: usize = 40;
/// A crossing is at least this wide as seen (m): two bars and what is between them.
const NARROWEST_M: f64 = 0.06;
/// Red within this distance beside the way belongs to the street ahead (m).
const BESIDE_M: f64 = 0.16;
/// Columns across the street (m): each finds its own nearest red.
const COLUMN_M: f64 = 0.008;
const COLUMNS: usize = (2.0 * BESIDE_M / COLUMN_M) as usize;

/// The document's low median: the median of the values on the near side of their mean, so that a red lamp high in the picture
/// (far away, were it on the floor) moves nothing. `values` are distances; smaller is nearer. `None` for an empty slice.
pub fn low_median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.sort_unstable_by(f64::total_cmp);
    let near = values.partition_point(|value| *value <= mean).max(1);
    Some(values[(near - 1) / 2])
}

/// The nearest crossing among red floor points (vehicle frame, m).
pub fn find(red: &[Vec2]) -> Option<Crossing> {
    // The nearest cluster of red: what lies 14 cm beyond its nearest part is another crossing, or a lamp.
    let mut histogram = [0usize; 75];
    for point in red.iter().filter(|point| point.y.abs() < BESIDE_M) {
        if let Some(bin) = histogram.get_mut((point.x / 0.02) as usize) {
            *bin += 1;
        }
    }
    let first = histogram
        .windows(2)
        .position(|bins| bins[0] + bins[1] >= FEWEST / 4 && bins[0] > 0)?;
    let (from_m, to_m) = (first as f64 * 0.02 - 0.02, first as f64 * 0.02 + 0.12);
    let mut nearest = [f64::INFINITY; COLUMNS];
    let (mut pixels, mut low, mut high) = (0, f64::INFINITY, f64::NEG_INFINITY);
    for point in red {
        if !(from_m..to_m).contains(&point.x) || point.y.abs() >= BESIDE_M {
            continue;
        }
        pixels += 1;
        (low, high) = (low.min(point.y), high.max(point.y));
        let column = (((point.y + BESIDE_M) / COLUMN_M) as usize).min(COLUMNS - 1);
        nearest[column] = nearest[column].min(point.x);
    }
    if pixels < FEWEST || high - low < NARROWEST_M {
        return None;
    }
    let (intercept_m, slope) = edge(&nearest)?;
    Some(Crossing {
        distance_m: intercept_m,
        // The edge runs along (slope, 1); the street across it along (1, -slope).
        angle_rad: trig::atan2(-slope, 1.0),
        left_m: 0.5 * (low + high),
        width_m: high - low,
        pixels,
    })
}

/// The near edge x = intercept + slope·y through the columns' nearest red: by the median of all pairs' slopes, which bars'
/// sides and single pixels do not move (Theil 1950, Sen 1968).
fn edge(nearest: &[f64; COLUMNS]) -> Option<(f64, f64)> {
    let at = |column: usize| (column as f64 + 0.5) * COLUMN_M - BESIDE_M;
    let mut slopes = [0.0; COLUMNS * (COLUMNS - 1) / 2];
    let mut count = 0;
    for j in 0..COLUMNS {
        for i in 0..j {
            if nearest[i].is_finite() && nearest[j].is_finite() && j - i >= 3 {
                slopes[count] = (nearest[j] - nearest[i]) / (at(j) - at(i));
                count += 1;
            }
        }
    }
    if count < 3 {
        return None;
    }
    let slope = median(&mut slopes[..count]);
    let mut rests = [0.0; COLUMNS];
    let mut rest_count = 0;
    for (column, x) in nearest.iter().enumerate().filter(|(_, x)| x.is_finite()) {
        rests[rest_count] = x - slope * at(column);
        rest_count += 1;
    }
    Some((median(&mut rests[..rest_count]), slope))
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}
