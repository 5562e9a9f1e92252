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
/// value in the window. Windows may reach over the picture's border by half their width; what lies outside does not
/// count (as in OpenCV): a line cut by the border is found while half of it is visible.
#[derive(Debug, Clone)]
pub struct LineResidue {
    width: usize,
    /// Narrow and wide width of each row (px); (0, 0): nothing is expected in this row.
    widths: Vec<(usize, usize)>,
    /// How far windows may reach over the border, at most (px).
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
        let widest = widths.iter().map(|(_, wide)| *wide).max().unwrap_or(0);
        let padding = widest / 2;
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
            let mut window = 1;
            grow(maxima, &mut window, narrow, width + 2 * padding, u8::max);
            arrange(maxima, window, narrow, narrow / 2, width, padding, narrow_minima);
            grow(maxima, &mut window, wide, width + 2 * padding, u8::max);
            arrange(maxima, window, wide, wide / 2, width, padding, wide_minima);
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition, literally.
    fn closing(row: &[u8], size: usize) -> Vec<u8> {
        let (width, size, reach) = (row.len() as i64, size as i64, size as i64 / 2);
        let inside = |x: i64| x >= 0 && x < width;
        (0..width)
            .map(|x| {
                (x - size + 1..=x)
                    .filter(|a| *a >= -reach && *a <= width - size + reach)
                    .map(|a| {
                        (a..a + size)
                            .filter(|i| inside(*i))
                            .map(|i| row[i as usize])
                            .max()
                            .unwrap_or(0)
                    })
                    .min()
                    .expect("a window around every pixel")
            })
            .collect()
    }

    fn residue(row: &[u8], narrow: usize, wide: usize) -> Vec<u8> {
        let (narrow, wide) = (closing(row, narrow), closing(row, wide));
        wide.iter()
            .zip(narrow)
            .map(|(wide, narrow)| wide - narrow)
            .collect()
    }

    proptest! {
        #[test]
        fn equals_the_definition_row_by_row(
            rows in (1usize..90).prop_flat_map(|width| {
                prop::collection::vec((prop::collection::vec(any::<u8>(), width), 1usize..=100, 1usize..=100), 1..6)
            }),
        ) {
            let width = rows[0].0.len();
            let source: Vec<u8> = rows.iter().flat_map(|(row, _, _)| row.clone()).collect();
            let widths: Vec<(usize, usize)> = rows.iter().map(|(_, a, b)| (*a, *b)).collect();
            for level in [Level::Baseline, Level::detect()] {
                let mut filter = LineResidue::with_level(width, widths.iter().copied(), level);
                let mut target = vec![9; source.len()];
                for contrast in [Contrast::Dark, Contrast::Light] {
                    filter.filter(&source, contrast, &mut target);
                    for ((row, a, b), out) in rows.iter().zip(target.chunks(width)) {
                        let (a, b) = ((*a).min(width), (*b).min(width));
                        let row: Vec<u8> = match contrast {
                            Contrast::Dark => row.clone(),
                            Contrast::Light => row.iter().map(|value| 255 - value).collect(),
                        };
                        let expected = if a < b { residue(&row, a, b) } else { vec![0; width] };
                        prop_assert_eq!(out, &expected[..]);
                    }
                }
            }
        }

        #[test]
        fn a_slope_alone_leaves_nothing_inside(start in 0u8..100, step in 0u8..2) {
            let row: Vec<u8> = (0..80).map(|x| start + step * x).collect();
            let mut target = vec![0; 80];
            LineResidue::new(80, [(5, 20)]).filter(&row, Contrast::Dark, &mut target);
            prop_assert!(target[10..70].iter().all(|value| *value == 0));
        }
    }

    #[test]
    fn keeps_what_is_as_wide_as_a_line_and_drops_the_rest() {
        let mut row = vec![200; 120];
        row[10..13].fill(50); // thinner than the narrow filter
        row[40..52].fill(50); // a line
        row[70..110].fill(50); // wider than the wide filter
        let mut target = vec![0; 120];
        LineResidue::new(120, [(6, 24)]).filter(&row, Contrast::Dark, &mut target);
        for (x, value) in target.iter().enumerate() {
            assert_eq!(*value, if (40..52).contains(&x) { 150 } else { 0 }, "at {x}");
        }
    }

    #[test]
    fn a_line_cut_by_the_border_is_kept() {
        let mut row = vec![200; 120];
        row[..8].fill(50);
        let mut target = vec![0; 120];
        LineResidue::new(120, [(6, 24)]).filter(&row, Contrast::Dark, &mut target);
        assert_eq!(target[..8], [150; 8]);
    }

    #[test]
    fn senseless_widths_are_harmless() {
        let mut target = [7; 12];
        LineResidue::new(4, [(0, 0), (9, 3), (1, 1 << 40)]).filter(&[0; 12], Contrast::Light, &mut target);
        assert_eq!(target, [0; 12]);
        LineResidue::new(0, [(1, 2)]).filter(&[], Contrast::Dark, &mut []);
        LineResidue::new(5, []).filter(&[], Contrast::Dark, &mut []);
    }
}
