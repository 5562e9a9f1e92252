//! Joins pieces that continue each other on the floor: dashed lines, lines interrupted by reflections or wear, hard
//! curves that the horizontal filter cut (C17 in SPEC).

use crate::blob::Scale;
use crate::blob_pool::BlobPool;
use crate::{BlobLimits, FloorMap, LineBlob, LineFitter};
use senda_geom::{Vec2, angle, trig};
use serde::{Deserialize, Serialize};

/// When two pieces belong to one line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JoinLimits {
    /// A joined line has at least so many pieces. Three are dashes; two may be one line with a reflection across it.
    pub pieces: usize,
    /// Longest gap between two pieces (m).
    pub gap_m: f64,
    /// Largest difference of their directions (rad).
    pub turn_rad: f64,
    /// The next piece may begin this part of the gap beside where the last one points.
    pub aside_part: f64,
    /// An arc through all points of a joined line misses them by at most this (m, root mean square).
    pub rms_m: f64,
    /// A joined line is at least this long from end to end (m).
    pub length_m: f64,
    /// And bends at most this much (1/m).
    pub curvature_per_m: f64,
}

impl Default for JoinLimits {
    /// Guesses for roads of a few decimetres: gaps as long as a vehicle, arcs of 15 cm radius.
    fn default() -> Self {
        Self {
            pieces: 2,
            gap_m: 0.2,
            turn_rad: 40f64.to_radians(),
            aside_part: 0.4,
            rms_m: 0.0015,
            length_m: 0.12,
            curvature_per_m: 7.0,
        }
    }
}

/// Joins the blobs of a frame; owns the memory that this needs.
#[derive(Debug, Clone, Default)]
pub struct LineJoiner {
    limits: JoinLimits,
    pieces: Vec<Piece>,
    chain: Vec<usize>,
    fitter: LineFitter,
    joined: BlobPool,
}

#[derive(Debug, Clone, Copy)]
struct Piece {
    /// Index among the blobs, then the fragments.
    index: usize,
    near: Vec2,
    far: Vec2,
    heading_rad: f64,
    /// Mean width across its direction (m).
    width_m: f64,
    residue: f64,
    used: bool,
}

/// Pieces shorter than this (m) are about as long as wide: their own direction says nothing.
const SHORT_M: f64 = 0.025;

/// Next pieces may begin this far behind or beside the end of the last (m): ends are blurred.
const SLACK_M: f64 = 0.01;

/// Neighbouring dashes are of the same paint: their widths and residues differ by less than these factors (guesses;
/// the residue of the farthest is lower, as it is blurred most).
const ALIKE_WIDTH: f64 = 1.4;
const ALIKE_RESIDUE: f64 = 1.8;

impl LineJoiner {
    /// With limits.
    pub fn new(limits: JoinLimits) -> Self {
        Self {
            limits,
            ..Self::default()
        }
    }

    /// Other limits from now on.
    pub fn set_limits(&mut self, limits: JoinLimits) {
        self.limits = limits;
    }

    /// The lines of a frame: `blobs` that nothing continues, as they are, and joined ones in place of the rest, largest
    /// score first. `fragments` ([`crate::LineExtractor::fragments`]) appear only as parts of joined lines, which pass
    /// the limits of C5 as a whole. Moments, box and rows are those of all parts together.
    pub fn join(
        &mut self,
        blobs: &[LineBlob],
        fragments: &[LineBlob],
        map: &FloorMap,
        limits: &BlobLimits,
    ) -> &[LineBlob] {
        self.joined.clear();
        let scale = Scale::new(map.width(), map.height());
        let part = |index: usize| {
            blobs
                .get(index)
                .unwrap_or_else(|| &fragments[index - blobs.len()])
        };
        self.find_pieces(blobs.iter().chain(fragments), map);
        for first in 0..self.pieces.len() {
            if self.pieces[first].used {
                continue;
            }
            self.follow(first);
            // The longest beginning of the chain that is one smooth line: beyond it the road may bend.
            let joined = (self.limits.pieces.max(2)..=self.chain.len())
                .rev()
                .any(|count| self.join_first(count, part, map, (&scale, limits)));
            if joined {
                continue;
            }
            // Nothing to join: the piece stands alone, and what it could not take is free for others.
            self.pieces[first].used = true;
        }
        // Blobs that are in no chain, or that have no place on the floor.
        let chains = self.joined.blobs().len();
        for blob in blobs {
            if !self.joined.blobs()[..chains]
                .iter()
                .any(|line| contains(line, blob))
            {
                self.joined.push().clone_from(blob);
            }
        }
        self.joined.sort();
        self.joined.blobs()
    }

    /// Makes a line of the chain's first pieces, if they are one.
    fn join_first<'a>(
        &mut self,
        count: usize,
        part: impl Fn(usize) -> &'a LineBlob,
        map: &FloorMap,
        (scale, limits): (&Scale, &BlobLimits),
    ) -> bool {
        let chain = &self.chain[..count];
        let parts = chain.iter().map(|piece| part(self.pieces[*piece].index));
        let line = self.fitter.arc(parts.clone(), map);
        let smooth = line.is_some_and(|line| {
            line.rms_m <= self.limits.rms_m
                && line.end_m - line.start_m >= self.limits.length_m
                && line.curvature_per_m.abs() <= self.limits.curvature_per_m
        });
        if !smooth {
            return false;
        }
        let blob = self.joined.push();
        merge(blob, parts, scale);
        if scale.check(blob, limits).is_err() {
            self.joined.pop();
            return false;
        }
        for piece in chain {
            self.pieces[*piece].used = true;
        }
        true
    }

    fn find_pieces<'a>(&mut self, parts: impl Iterator<Item = &'a LineBlob>, map: &FloorMap) {
        self.pieces.clear();
        for (index, blob) in parts.enumerate() {
            let Some(line) = self.fitter.straight([blob], map) else {
                continue;
            };
            let (near, far) = (line.at(line.start_m), line.at(line.end_m));
            self.pieces.push(Piece {
                index,
                near,
                far,
                heading_rad: line.heading_rad,
                width_m: width_on_floor(blob, map) * trig::cos(line.heading_rad),
                residue: blob.residue_mean,
                used: false,
            });
        }
        self.pieces
            .sort_unstable_by(|a, b| a.near.x.total_cmp(&b.near.x).then(a.near.y.total_cmp(&b.near.y)));
    }

    /// Collects the pieces that continue `first`, each the best next one.
    fn follow(&mut self, first: usize) {
        self.chain.clear();
        self.chain.push(first);
        let mut heading_rad = self.pieces[first].heading_rad;
        if self.is_short(first) {
            heading_rad = f64::NAN;
        }
        loop {
            let last = self.pieces[self.chain[self.chain.len() - 1]];
            let next = (0..self.pieces.len())
                .filter(|index| !self.pieces[*index].used && !self.chain.contains(index))
                .filter_map(|index| Some((self.cost(&last, heading_rad, index)?, index)))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, next)) = next else {
                return;
            };
            heading_rad = if self.is_short(next) {
                let along = (self.pieces[next].near + self.pieces[next].far - last.near - last.far) / 2.0;
                trig::atan2(along.y, along.x)
            } else {
                self.pieces[next].heading_rad
            };
            self.chain.push(next);
        }
    }

    fn is_short(&self, piece: usize) -> bool {
        (self.pieces[piece].far - self.pieces[piece].near).length() < SHORT_M
    }

    /// How badly a piece continues the last one, whose direction may be unknown (NaN); `None`: not at all.
    fn cost(&self, last: &Piece, heading_rad: f64, next: usize) -> Option<f64> {
        let piece = &self.pieces[next];
        let gap = piece.near - last.far;
        let length = gap.length();
        if length > self.limits.gap_m {
            return None;
        }
        let heading_rad = if heading_rad.is_nan() {
            if self.is_short(next) {
                let along = (piece.near + piece.far - last.near - last.far) / 2.0;
                trig::atan2(along.y, along.x)
            } else {
                piece.heading_rad
            }
        } else {
            heading_rad
        };
        let alike = |a: f64, b: f64, factor: f64| a < factor * b && b < factor * a;
        if !alike(last.width_m, piece.width_m, ALIKE_WIDTH)
            || !alike(last.residue, piece.residue, ALIKE_RESIDUE)
        {
            return None;
        }
        let (sin, cos) = trig::sincos(heading_rad);
        let ahead = gap.x * cos + gap.y * sin;
        let aside = (gap.y * cos - gap.x * sin).abs();
        let turn = angle::difference(piece.heading_rad, heading_rad).abs();
        let fits = ahead > -SLACK_M
            && aside < self.limits.aside_part * length + SLACK_M
            && (self.is_short(next) || turn < self.limits.turn_rad);
        fits.then_some(length + 2.0 * aside)
    }
}

/// Whether all rows of `part` are rows of `line`: both come from the same frame, so a row in common means the same
/// component.
fn contains(line: &LineBlob, part: &LineBlob) -> bool {
    part.rows.first().is_some_and(|row| line.rows.contains(row))
}

/// Mean length of a blob's whole rows (m).
fn width_on_floor(blob: &LineBlob, map: &FloorMap) -> f64 {
    let (mut n, mut sum) = (0.0, 0.0);
    for row in blob.rows.iter().filter(|row| !row.at_edge) {
        if let Some(scale_m) = map.metres_per_pixel(Vec2::new(row.u, row.v)) {
            n += 1.0;
            sum += scale_m * row.width_px;
        }
    }
    sum / n
}

/// Moments, box and rows of several blobs taken as one.
fn merge<'a>(merged: &mut LineBlob, parts: impl Iterator<Item = &'a LineBlob> + Clone, scale: &Scale) {
    let area: f64 = parts.clone().map(|part| part.area_px).sum();
    let centroid = parts
        .clone()
        .map(|part| part.centroid * part.area_px)
        .sum::<Vec2>()
        / area;
    let (mut uu, mut uv, mut vv) = (0.0, 0.0, 0.0);
    let mut bounds = [f64::INFINITY, f64::INFINITY, 0.0, 0.0];
    merged.residue_mean = 0.0;
    for part in parts {
        let weight = part.area_px / area;
        let along = part.axis();
        let across = along.perp();
        let to = part.centroid - centroid;
        let spread = |a: f64, b: f64, i: f64, j: f64, u: f64, v: f64| {
            weight * (part.lambda_max_px2 * a * b + part.lambda_min_px2 * i * j + u * v)
        };
        uu += spread(along.x, along.x, across.x, across.x, to.x, to.x);
        uv += spread(along.x, along.y, across.x, across.y, to.x, to.y);
        vv += spread(along.y, along.y, across.y, across.y, to.y, to.y);
        bounds = [
            bounds[0].min(part.bounds[0]),
            bounds[1].min(part.bounds[1]),
            bounds[2].max(part.bounds[2]),
            bounds[3].max(part.bounds[3]),
        ];
        merged.residue_mean += weight * part.residue_mean;
        merged.rows.extend_from_slice(&part.rows);
    }
    merged
        .rows
        .sort_unstable_by(|a, b| a.v.total_cmp(&b.v).then(a.u.total_cmp(&b.u)));
    merged.area_px = area;
    merged.bounds = bounds;
    merged.centroid = centroid;
    merged.set_shape(uu, uv, vv, scale);
}
