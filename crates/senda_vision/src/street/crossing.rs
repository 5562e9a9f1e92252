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

/// A red pixel: where it lies on the floor (vehicle frame, m) and how much of it it shows (m²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Red {
    /// Its middle.
    pub at: Vec2,
    /// The floor that it shows (m²).
    pub area_m2: f64,
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

/// Strips along the bars (m): a bar fills several.
const STRIP_M: f64 = 0.004;
const STRIPS: usize = (2.4 * BESIDE_M / STRIP_M) as usize;
/// A strip is red when it is so over at least this length (m): bars are 8 cm long, and a red plank beside the street shows
/// here and there a pixel.
const RED_M: f64 = 0.02;
/// Bars and what is between two of them are between so narrow and so wide (m): 22 mm on streets of 20 cm.
const BAR_M: [f64; 2] = [0.008, 0.06];

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

/// The nearest crossing among red pixels.
pub fn find(red: &[Red]) -> Option<Crossing> {
    let mut histogram = [0usize; 75];
    for point in red.iter().map(|red| red.at).filter(|at| at.y.abs() < BESIDE_M) {
        if let Some(bin) = histogram.get_mut((point.x / 0.02) as usize) {
            *bin += 1;
        }
    }
    let mut from = 0;
    loop {
        let begins = |bins: &[usize]| bins[0] + bins[1] >= FEWEST / 4 && bins[0] > 0;
        let first = from + histogram[from..].windows(2).position(begins)?;
        if let Some(crossing) = in_cluster(red, first as f64 * 0.02) {
            return Some(crossing);
        }
        // Red without bars: behind it there may be a crossing, of which a cluster holds all when it begins 6 cm before.
        from = first + 3;
    }
}

/// The crossing in a cluster of red: what lies 14 cm beyond its nearest part is another crossing, or a lamp.
fn in_cluster(red: &[Red], nearest_m: f64) -> Option<Crossing> {
    let (from_m, to_m) = (nearest_m - 0.02, nearest_m + 0.12);
    let cluster = || {
        red.iter()
            .filter(move |red| (from_m..to_m).contains(&red.at.x) && red.at.y.abs() < BESIDE_M)
    };
    let mut nearest = [f64::INFINITY; COLUMNS];
    let (mut pixels, mut low, mut high) = (0, f64::INFINITY, f64::NEG_INFINITY);
    for point in cluster().map(|red| red.at) {
        pixels += 1;
        (low, high) = (low.min(point.y), high.max(point.y));
        let column = (((point.y + BESIDE_M) / COLUMN_M) as usize).min(COLUMNS - 1);
        nearest[column] = nearest[column].min(point.x);
    }
    if pixels < FEWEST || high - low < NARROWEST_M {
        return None;
    }
    let (mut intercept_m, mut slope) = edge(&nearest)?;
    let mut strips = [0.0; STRIPS];
    let along_edge = Vec2::new(slope, 1.0).normalize();
    for red in cluster() {
        let across_m = (red.at - Vec2::new(intercept_m, 0.0)).dot(along_edge);
        let strip = across_m / STRIP_M + 0.5 * STRIPS as f64;
        if let Some(area_m2) = strips.get_mut(strip as usize) {
            *area_m2 += red.area_m2;
        }
    }
    let bars_m = bars(&strips)?;
    // What is red beside the bars says nothing about their edge.
    let mut beside = false;
    for (column, nearest) in nearest.iter_mut().enumerate().filter(|(_, x)| x.is_finite()) {
        let y = (column as f64 + 0.5) * COLUMN_M - BESIDE_M;
        let across_m = (Vec2::new(*nearest, y) - Vec2::new(intercept_m, 0.0)).dot(along_edge);
        if !(bars_m[0] - COLUMN_M..bars_m[1] + COLUMN_M).contains(&across_m) {
            (*nearest, beside) = (f64::INFINITY, true);
        }
    }
    if beside {
        (intercept_m, slope) = edge(&nearest)?;
    }
    Some(Crossing {
        distance_m: intercept_m,
        // The edge runs along (slope, 1); the street across it along (1, -slope).
        angle_rad: trig::atan2(-slope, 1.0),
        left_m: 0.5 * (low + high),
        width_m: high - low,
        pixels,
    })
}

/// Where strips (m² of red) are red and not red in turn, at least two bars side by side: from the first bar to the last (m along
/// the edge). Of several such places the one with most bars.
fn bars(strips: &[f64; STRIPS]) -> Option<[f64; 2]> {
    let [narrow_m, wide_m] = BAR_M;
    let at_m = |strip: usize| (strip as f64 - 0.5 * STRIPS as f64) * STRIP_M;
    let is_red = |strip: usize| strips[strip] > RED_M * STRIP_M;
    // Number of bars, beginning and end of the present place and of the best.
    let (mut place, mut best) = ((0, 0, 0), (0, 0, 0));
    let mut begin = 0;
    for end in 1..=STRIPS {
        if end < STRIPS && is_red(end) == is_red(begin) {
            continue;
        }
        let width_m = (end - begin) as f64 * STRIP_M;
        if width_m >= wide_m {
            place = (0, 0, 0);
        } else if width_m >= narrow_m && is_red(begin) {
            let first = if place.0 == 0 { begin } else { place.1 };
            place = (place.0 + 1, first, end);
            if place.0 > best.0 {
                best = place;
            }
        }
        begin = end;
    }
    let (count, begin, end) = best;
    (count >= 2).then_some([at_m(begin), at_m(end)])
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
