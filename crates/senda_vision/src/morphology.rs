//! Horizontal grey closings and openings whose width grows with the row, and their residue (C3 in SPEC).
//!
//! The largest value of a window of any width costs log2(width) passes over the row: two overlapping windows of a
//! power of two cover it. So a filter that changes its width with the row costs what a fixed one costs.

use crate::Contrast;
use crate::simd::{Kernel, Level};

/// Pixels handled together: the widest register.
const LANES: usize = 32;

/// Residue of two closings of every row: what the wide one fills and the narrow one does not, which is what is
/// darker than its surroundings on both sides and between the two widths wide. For light lines the same of the
/// inverted picture, which is the residue of two openings.
///
/// Definition: closing(x) is the smallest, over all windows of the filter's width that contain x, of the largest
/// value in the window. Windows of the narrow filter may reach over the picture's border by half their width, those
/// of the wide one not at all: so a line that is cut by the border is found while half of it is visible, and found
/// when it just touches the border. (The usual rule, all windows centred in the picture, loses a line that
/// touches the border, because there it melts with the outside.)
#[derive(Debug, Clone)]
pub struct LineResidue {
    width: usize,
    /// Narrow and wide width of each row (px); (0, 0): nothing is expected in this row.
    widths: Vec<(usize, usize)>,
    /// How far windows of the narrow filter may reach over the border, at most (px).
    padding: usize,
    /// The padded row and its running maxima.
    maxima: Vec<u8>,
    /// Running minima of the narrow and of the wide filter.
    minima: [Vec<u8>; 2],
    level: Level,
}

impl LineResidue {
    /// Filters for rows of `width` pixels; `widths` gives the narrow and the wide width of each row, from the top.
    /// Widths are limited to 1..=`width`; a row whose narrow width is not below the wide one gives a residue of 0.
    pub fn new(width: usize, widths: impl IntoIterator<Item = (usize, usize)>) -> Self {
        Self::with_level(width, widths, Level::detect())
    }

    pub(crate) fn with_level(
        width: usize,
        widths: impl IntoIterator<Item = (usize, usize)>,
        level: Level,
    ) -> Self {
        let widths: Vec<(usize, usize)> = widths
            .into_iter()
            .map(|(narrow, wide)| {
                let (narrow, wide) = (narrow.clamp(1, width.max(1)), wide.min(width));
                if narrow < wide { (narrow, wide) } else { (0, 0) }
            })
            .collect();
        let padding = widths.iter().map(|(narrow, _)| narrow / 2).max().unwrap_or(0);
        let widest = widths.iter().map(|(_, wide)| *wide).max().unwrap_or(0);
        // Room to read a window and a register beyond the last position, and to write whole registers.
        let length = width + 2 * padding + 2 * widest + 4 * LANES;
        Self {
            width,
            widths,
            padding,
            maxima: vec![0; length],
            minima: [vec![0; length], vec![0; length]],
            level,
        }
    }

    /// Narrow and wide width of each row (px) as they are used.
    pub fn widths(&self) -> &[(usize, usize)] {
        &self.widths
    }

    /// Writes the residue of `source` to `target`, both rows of the filter's width, as many as it has widths.
    ///
    /// # Panics
    /// When the lengths do not fit.
    pub fn filter(&mut self, source: &[u8], contrast: Contrast, target: &mut [u8]) {
        assert_eq!(source.len(), self.width * self.widths.len());
        assert_eq!(target.len(), source.len());
        if source.is_empty() {
            return;
        }
        self.level.run(ResidueKernel {
            filter: self,
            source,
            // x ^ 0xff = 255 - x turns light lines into dark ones.
            flip: match contrast {
                Contrast::Dark => 0x00,
                Contrast::Light => 0xff,
            },
            target,
        });
    }
}

struct ResidueKernel<'a> {
    filter: &'a mut LineResidue,
    source: &'a [u8],
    flip: u8,
    target: &'a mut [u8],
}

impl Kernel for ResidueKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let LineResidue {
            width,
            widths,
            padding,
            maxima,
            minima: [narrow_minima, wide_minima],
            ..
        } = self.filter;
        let (width, padding) = (*width, *padding);
        let rows = self
            .source
            .chunks_exact(width)
            .zip(self.target.chunks_exact_mut(width));
        for ((source, target), (narrow, wide)) in rows.zip(widths.iter().copied()) {
            if wide == 0 {
                target.fill(0);
                continue;
            }
            maxima[..padding].fill(0);
            for (to, from) in maxima[padding..padding + width].iter_mut().zip(source) {
                *to = from ^ self.flip;
            }
            maxima[padding + width..].fill(0);
            let reach = narrow / 2;
            let mut window = 1;
            grow(maxima, &mut window, narrow, width + 2 * padding, u8::max);
            arrange(maxima, window, narrow, reach, width, padding, narrow_minima);
            grow(maxima, &mut window, wide, width + 2 * padding, u8::max);
            arrange(maxima, window, wide, 0, width, padding, wide_minima);
            for (minima, size) in [(&mut *narrow_minima, narrow), (&mut *wide_minima, wide)] {
                let mut window = 1;
                grow(minima, &mut window, size, width + size, u8::min);
                if window < size {
                    combine(minima, size - window, width, u8::min);
                }
            }
            for ((to, narrow), wide) in target.iter_mut().zip(&*narrow_minima).zip(&*wide_minima) {
                // Every wide window contains a narrow one around the same pixel: never negative.
                *to = wide - narrow;
            }
        }
    }
}

/// Doubles the window over which each value is the extreme, until the next doubling would exceed `size`.
#[inline(always)]
fn grow(values: &mut [u8], window: &mut usize, size: usize, count: usize, extreme: impl Fn(u8, u8) -> u8) {
    while 2 * *window <= size {
        combine(values, *window, count, &extreme);
        *window *= 2;
    }
}

/// `values[i] = extreme(values[i], values[i + shift])` for the first `count` (and up to a register more) positions.
#[inline(always)]
fn combine(values: &mut [u8], shift: usize, count: usize, extreme: impl Fn(u8, u8) -> u8) {
    let values = &mut values[..count.next_multiple_of(LANES) + shift];
    let mut start = 0;
    while start < count {
        let other: [u8; LANES] = values[start + shift..start + shift + LANES]
            .try_into()
            .expect("32 long");
        let own: &mut [u8; LANES] = (&mut values[start..start + LANES]).try_into().expect("32 long");
        for i in 0..LANES {
            own[i] = extreme(own[i], other[i]);
        }
        start += LANES;
    }
}

/// Completes the maxima over windows of `size` and lays them out so that the minimum over `size` neighbours from
/// position x on is the closing at x; windows that reach further than `reach` over the border count as 255.
#[inline(always)]
fn arrange(
    maxima: &[u8],
    window: usize,
    size: usize,
    reach: usize,
    width: usize,
    padding: usize,
    minima: &mut [u8],
) {
    // Window [a, a + size) goes to position a + size - 1; a runs from -reach to width - size + reach.
    let first = size - 1 - reach;
    let count = width - size + 1 + 2 * reach;
    let from = padding - reach;
    minima[..first].fill(255);
    let near = &maxima[from..from + count];
    let far = &maxima[from + size - window..from + size - window + count];
    for ((to, near), far) in minima[first..first + count].iter_mut().zip(near).zip(far) {
        *to = *near.max(far);
    }
    let end = first + count;
    minima[end..end + size + LANES].fill(255);
}
