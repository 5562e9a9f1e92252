//! What groups of pixels look at.

use super::GROUP;
#[cfg(doc)]
use super::{SLOTS, STEPS_PER_TEXEL};
use std::ops::Range;

/// Eight neighbouring pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Group {
    pub(crate) at: Positions,
    pub(crate) detail: Detail,
}

/// Where the pixels of a group look on a plane, in texels of their level times [`STEPS_PER_TEXEL`], in the order of
/// [`SLOTS`]. One line of the processor's cache.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Positions {
    /// Along the vehicle's x axis.
    pub(crate) x: [f32; GROUP],
    /// Along the vehicle's y axis.
    pub(crate) y: [f32; GROUP],
}

/// How finely a group of pixels looks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Detail {
    /// The longer axis of a pixel's footprint, over which several looks are spread.
    pub(crate) spread: [f32; 2],
    /// Level of detail.
    pub(crate) level: u8,
    /// Logarithm (base 2) of the looks that the footprint needs.
    pub(crate) looks_log2: u8,
}

/// Groups, their positions apart: they are all that is read of most.
#[derive(Debug, Clone, Default)]
pub(crate) struct Groups {
    positions: Vec<Positions>,
    details: Vec<Detail>,
    /// The most looks that one of them needs.
    most_looks_log2: u8,
}

impl Groups {
    pub(crate) fn with_capacity(count: usize) -> Self {
        Self {
            positions: Vec::with_capacity(count),
            details: Vec::with_capacity(count),
            most_looks_log2: 0,
        }
    }

    pub(crate) fn push(&mut self, group: Group) {
        self.positions.push(group.at);
        self.details.push(group.detail);
        self.most_looks_log2 = self.most_looks_log2.max(group.detail.looks_log2);
    }

    pub(crate) fn run(&self, range: Range<usize>) -> GroupRun<'_> {
        GroupRun {
            positions: &self.positions[range.clone()],
            details: &self.details[range],
            most_looks_log2: self.most_looks_log2,
        }
    }
}

/// Consecutive groups.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroupRun<'a> {
    positions: &'a [Positions],
    details: &'a [Detail],
    most_looks_log2: u8,
}

#[cfg_attr(
    not(target_arch = "x86_64"),
    expect(dead_code, reason = "only the vector loops look ahead")
)]
impl<'a> GroupRun<'a> {
    pub(crate) fn len(self) -> usize {
        self.positions.len()
    }

    pub(crate) fn iter(self) -> impl Iterator<Item = (&'a Positions, &'a Detail)> {
        self.positions.iter().zip(self.details)
    }

    pub(crate) fn details(self) -> &'a [Detail] {
        self.details
    }

    /// Whether every group needs one look.
    pub(crate) fn look_once(self) -> bool {
        self.most_looks_log2 == 0 || self.details.iter().all(|detail| detail.looks_log2 == 0)
    }

    pub(crate) fn split_at(self, count: usize) -> (Self, Self) {
        let (first_positions, later_positions) = self.positions.split_at(count);
        let (first_details, later_details) = self.details.split_at(count);
        let of = |positions, details| Self {
            positions,
            details,
            ..self
        };
        (
            of(first_positions, first_details),
            of(later_positions, later_details),
        )
    }
}
