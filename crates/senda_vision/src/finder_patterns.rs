//! Where in a grey picture a QR code may be: rows that cross a finder pattern (dark and light runs as 1 : 1 : 3 : 1 : 1).
//!
//! A cheap look before the dear one: most frames show no code, and of those that do most is floor.

/// Rows looked at: one in so many. The middle of a finder pattern is three modules high, which is 6 px on the smallest code.
const EVERY: usize = 3;
/// Light and dark are told by the mean over so many pixels to either side.
const REACH_PX: usize = 24;
/// A pattern is at least so wide (px): 1.1 px a module.
const LEAST_PX: usize = 8;
/// Contrast below which a row is even (grey levels around the mean).
const EVEN: u32 = 6;

/// Left, top, right, bottom (px; right and bottom are the first beyond).
pub(crate) type Region = [usize; 4];

/// Finds regions; reused between frames.
#[derive(Debug, Clone, Default)]
pub(crate) struct FinderPatterns {
    sums: Vec<u32>,
    runs: Vec<usize>,
    /// Middle, row and width of a pattern.
    hits: Vec<[usize; 3]>,
    regions: Vec<Region>,
}

impl FinderPatterns {
    /// The regions that may hold a code, each with its surroundings; they do not overlap.
    pub(crate) fn find(&mut self, grey: &[u8], width: usize, height: usize) -> &[Region] {
        self.hits.clear();
        self.regions.clear();
        for row in (EVERY / 2..height).step_by(EVERY) {
            let line = &grey[row * width..(row + 1) * width];
            self.split(line);
            self.take_hits(row);
        }
        for index in 0..self.hits.len() {
            let [middle, row, size] = self.hits[index];
            // One row may look like a pattern by chance; two that are near each other are one.
            let again = self.hits.iter().enumerate().any(|(other, [u, v, _])| {
                other != index && u.abs_diff(middle) <= size / 3 && v.abs_diff(row) <= 2 * EVERY
            });
            if again {
                // A finder is 7 of 21 modules and may be at any corner; seen aslant a code is higher than wide.
                let (across, down) = (3 * size + size / 2, 6 * size);
                self.add([
                    middle.saturating_sub(across),
                    row.saturating_sub(down),
                    (middle + across).min(width),
                    (row + down).min(height),
                ]);
            }
        }
        &self.regions
    }

    /// Lengths of runs of light and dark, beginning with a light one (perhaps of no length).
    fn split(&mut self, line: &[u8]) {
        self.sums.clear();
        self.sums.push(0);
        let mut sum = 0;
        for value in line {
            sum += u32::from(*value);
            self.sums.push(sum);
        }
        self.runs.clear();
        let (mut dark, mut length) = (false, 0);
        for (u, value) in line.iter().enumerate() {
            let (from, to) = (u.saturating_sub(REACH_PX), (u + REACH_PX + 1).min(line.len()));
            let count = (to - from) as u32;
            // Darker than the mean by a little: even floor is light.
            let is_dark = (u32::from(*value) + EVEN) * count < self.sums[to] - self.sums[from];
            if is_dark != dark {
                self.runs.push(length);
                (dark, length) = (is_dark, 0);
            }
            length += 1;
        }
        self.runs.push(length);
    }

    fn take_hits(&mut self, row: usize) {
        let mut start = 0;
        for (index, window) in self.runs.windows(5).enumerate() {
            // Odd places are dark.
            if index % 2 == 1 {
                let total: usize = window.iter().sum();
                let unit = total as f64 / 7.0;
                let fits = total >= LEAST_PX
                    && window
                        .iter()
                        .zip([1.0, 1.0, 3.0, 1.0, 1.0])
                        .all(|(run, modules)| {
                            // A threshold moves both ends of a run by up to a pixel, whatever its length.
                            (*run as f64 - modules * unit).abs() <= 0.55 * unit + 1.0
                        });
                if fits {
                    self.hits.push([start + total / 2, row, total]);
                }
            }
            start += window[0];
        }
    }

    /// Joins what overlaps.
    fn add(&mut self, mut region: Region) {
        loop {
            let found = self.regions.iter().position(|other| {
                region[0] < other[2] && other[0] < region[2] && region[1] < other[3] && other[1] < region[3]
            });
            let Some(found) = found else { break };
            let other = self.regions.swap_remove(found);
            region = [
                region[0].min(other[0]),
                region[1].min(other[1]),
                region[2].max(other[2]),
                region[3].max(other[3]),
            ];
        }
        self.regions.push(region);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Modules of `px` pixels: a finder pattern with its light border, on grey.
    fn picture(px: usize, at: [usize; 2]) -> Vec<u8> {
        let mut grey = vec![130u8; 320 * 200];
        for v in 0..9 * px {
            for u in 0..9 * px {
                let ring = (u / px).abs_diff(4).max((v / px).abs_diff(4));
                let dark = ring <= 1 || ring == 3;
                grey[(at[1] + v) * 320 + at[0] + u] = if dark { 20 } else { 235 };
            }
        }
        grey
    }

    #[test]
    fn a_finder_pattern_gives_one_region_around_it() {
        for px in 2..8 {
            let regions = FinderPatterns::default()
                .find(&picture(px, [120, 60]), 320, 200)
                .to_vec();
            assert_eq!(regions.len(), 1, "{px}: {regions:?}");
            let [left, top, right, bottom] = regions[0];
            let (u, v) = (120 + 9 * px / 2, 60 + 9 * px / 2);
            // 17.5 modules and the border to every side, as far as there is a picture.
            let reach = 18 * px;
            assert!(
                left <= u.saturating_sub(reach) && right >= (u + reach).min(320),
                "{px}"
            );
            assert!(
                top <= v.saturating_sub(reach) && bottom >= (v + reach).min(200),
                "{px}"
            );
        }
    }

    #[test]
    fn even_floor_and_lines_give_none() {
        let mut grey = vec![130u8; 320 * 200];
        assert!(FinderPatterns::default().find(&grey, 320, 200).is_empty());
        for row in grey.chunks_exact_mut(320) {
            row[100..104].fill(20);
            row[180..230].fill(20);
        }
        assert!(FinderPatterns::default().find(&grey, 320, 200).is_empty());
    }

    #[test]
    fn any_bytes_are_taken() {
        for (width, height) in [(1, 1), (7, 3), (33, 5)] {
            let grey: Vec<u8> = (0..width * height).map(|i| (i * 89 % 256) as u8).collect();
            FinderPatterns::default().find(&grey, width, height);
        }
    }
}
