//! Blobs of one frame, in memory that the next frame uses again.

use crate::blur::FINE_BITS;
use crate::components::{Components, Moments};
use crate::{LineBlob, RowPoint, WidthProfile};
use senda_geom::trig;

/// A list of blobs that forgets without freeing.
#[derive(Debug, Clone, Default)]
pub(crate) struct BlobPool {
    /// The blobs of this frame first (`found`), then spare ones whose memory waits to be used again.
    blobs: Vec<LineBlob>,
    found: usize,
    /// For each component of the frame the index of its blob, or `NONE`.
    blob_of: Vec<u32>,
}

const NONE: u32 = u32::MAX;
/// Room for the rows of a line through a small picture; longer blobs make their own once.
const ROWS_EXPECTED: usize = 128;

/// The thresholded picture's grey values, with [`FINE_BITS`], from row `top` on.
#[derive(Clone, Copy)]
pub(crate) struct Residue<'a> {
    pub(crate) fine: &'a [u16],
    pub(crate) top: usize,
    pub(crate) width: usize,
    pub(crate) profile: &'a WidthProfile,
}

impl BlobPool {
    pub(crate) fn blobs(&self) -> &[LineBlob] {
        &self.blobs[..self.found]
    }

    pub(crate) fn clear(&mut self) {
        self.found = 0;
        self.blob_of.clear();
    }

    /// An empty blob at the end of the list.
    pub(crate) fn push(&mut self) -> &mut LineBlob {
        if self.found == self.blobs.len() {
            self.blobs.push(LineBlob {
                rows: Vec::with_capacity(ROWS_EXPECTED),
                ..LineBlob::default()
            });
        }
        self.found += 1;
        let blob = &mut self.blobs[self.found - 1];
        blob.rows.clear();
        blob
    }

    /// Takes the last blob back.
    pub(crate) fn pop(&mut self) {
        self.found -= 1;
    }

    /// Fills the pool from components: `admit` describes a component in the blob that it is given, or refuses it. The rows
    /// follow for those that are admitted.
    pub(crate) fn collect(
        &mut self,
        components: &Components,
        residue: Residue<'_>,
        mut admit: impl FnMut(&Moments, &mut LineBlob) -> bool,
    ) {
        self.clear();
        for moments in components.moments() {
            let blob = self.push();
            if admit(moments, blob) {
                self.blob_of.push(self.found as u32 - 1);
            } else {
                self.pop();
                self.blob_of.push(NONE);
            }
        }
        if self.found > 0 {
            self.add_rows(components, residue);
        }
    }

    /// Drops the blobs that `keep` does not want; the order of the others is undefined.
    pub(crate) fn retain(&mut self, mut keep: impl FnMut(&LineBlob) -> bool) {
        let mut index = 0;
        while index < self.found {
            if keep(&self.blobs[index]) {
                index += 1;
            } else {
                self.found -= 1;
                self.blobs.swap(index, self.found);
            }
        }
    }

    /// Largest score first; among equals the upper left one. The unstable sort allocates nothing.
    pub(crate) fn sort(&mut self) {
        self.blobs[..self.found].sort_unstable_by(|a, b| {
            b.score
                .total_cmp(&a.score)
                .then(a.bounds[1].total_cmp(&b.bounds[1]))
                .then(a.bounds[0].total_cmp(&b.bounds[0]))
        });
    }

    fn add_rows(&mut self, components: &Components, residue: Residue<'_>) {
        for run in components.runs() {
            let index = self.blob_of[run.component as usize];
            if index == NONE {
                continue;
            }
            let blob = &mut self.blobs[index as usize];
            let row = (run.y as usize - residue.top) * residue.width;
            let (start, end) = (run.start as usize, run.end as usize);
            let (mut sum, mut moment) = (0u64, 0u64);
            for (i, value) in residue.fine[row + start..row + end].iter().enumerate() {
                sum += u64::from(*value);
                moment += u64::from(*value) * i as u64;
            }
            let v = f64::from(run.y) + 0.5;
            let at_edge = start == 0 || end == residue.width;
            let u = if at_edge {
                let half = 0.5 * residue.profile.at(v) / trig::cos(blob.orientation_rad);
                let middle = (start + end) as f64 / 2.0;
                match (start == 0, end == residue.width) {
                    (true, false) => (end as f64 - half).min(middle),
                    (false, true) => (start as f64 + half).max(middle),
                    _ => middle,
                }
            } else {
                start as f64 + 0.5 + moment as f64 / sum.max(1) as f64
            };
            blob.residue_mean += sum as f64;
            blob.rows.push(RowPoint {
                v,
                u,
                width_px: (end - start) as f64,
                at_edge,
            });
        }
        for blob in &mut self.blobs[..self.found] {
            blob.residue_mean /= blob.area_px * f64::from(1 << FINE_BITS);
        }
    }
}
