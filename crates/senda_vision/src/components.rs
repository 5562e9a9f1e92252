//! Connected components of a binary picture with their moments, from runs of set pixels.

/// A maximal run of set pixels in one row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// Row.
    pub y: u32,
    /// First column.
    pub start: u32,
    /// Column after the last.
    pub end: u32,
    /// Index of the component it belongs to.
    pub component: u32,
}

/// Sums over the pixels of one component; columns and rows count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Moments {
    /// Number of pixels.
    pub count: u64,
    /// Σx.
    pub x: u64,
    /// Σy.
    pub y: u64,
    /// Σx².
    pub xx: u64,
    /// Σxy.
    pub xy: u64,
    /// Σy².
    pub yy: u64,
    /// Smallest column.
    pub left: u32,
    /// Column after the largest.
    pub right: u32,
    /// Smallest row.
    pub top: u32,
    /// Row after the largest.
    pub bottom: u32,
}

impl Moments {
    fn add(&mut self, run: &Run) {
        let (start, end, y) = (u64::from(run.start), u64::from(run.end), u64::from(run.y));
        let count = end - start;
        let x = (start + end - 1) * count / 2;
        if self.count == 0 {
            (self.left, self.right, self.top) = (run.start, run.end, run.y);
        }
        self.count += count;
        self.x += x;
        self.y += y * count;
        self.xx += squares_below(end) - squares_below(start);
        self.xy += x * y;
        self.yy += y * y * count;
        self.left = self.left.min(run.start);
        self.right = self.right.max(run.end);
        // Runs come in the order of their rows.
        self.bottom = run.y + 1;
    }
}

/// 0² + 1² + … + (n-1)².
fn squares_below(n: u64) -> u64 {
    if n == 0 { 0 } else { (n - 1) * n * (2 * n - 1) / 6 }
}

/// Labels components; keeps its memory between pictures.
#[derive(Debug, Clone, Default)]
pub struct Components {
    runs: Vec<Run>,
    /// Union-find over provisional labels, then the final index of each.
    parents: Vec<u32>,
    moments: Vec<Moments>,
}

impl Components {
    /// Empty, with room for the worst picture of this size, so that labelling never allocates.
    pub fn with_size(width: usize, height: usize) -> Self {
        let runs = height * width.div_ceil(2);
        // A label is made by a run that touches none above: at most one in every 2x2 pixels.
        let labels = height.div_ceil(2) * width.div_ceil(2);
        Self {
            runs: Vec::with_capacity(runs),
            parents: Vec::with_capacity(labels),
            moments: Vec::with_capacity(labels),
        }
    }

    /// Forgets the last picture.
    pub fn clear(&mut self) {
        self.runs.clear();
        self.parents.clear();
        self.moments.clear();
    }

    /// Finds the components (pixels that touch at an edge or a corner belong together) of a picture given row by row:
    /// `mask_row(y, row)` fills `row`, whose bytes are then 0 or 1; `row` is working memory, as long as the picture is
    /// wide, rounded up to whole words of 8.
    pub fn label(&mut self, height: usize, row: &mut [u8], mut mask_row: impl FnMut(usize, &mut [u8])) {
        self.clear();
        let mut above = 0..0;
        for y in 0..height {
            mask_row(y, row);
            let begin = self.runs.len();
            append_runs(row, y as u32, &mut self.runs);
            self.join(above, begin);
            above = begin..self.runs.len();
        }
        self.resolve();
    }

    /// The runs of the last picture, by row, then by column.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// The moments of each component, in the order of their first pixels.
    pub fn moments(&self) -> &[Moments] {
        &self.moments
    }

    /// Labels the runs from `begin` on with those that they touch in the row above.
    fn join(&mut self, above: std::ops::Range<usize>, begin: usize) {
        let mut first = above.start;
        for index in begin..self.runs.len() {
            let run = self.runs[index];
            // Touching at a corner counts: ends may meet.
            while first < above.end && self.runs[first].end < run.start {
                first += 1;
            }
            let mut label = u32::MAX;
            let mut other = first;
            while other < above.end && self.runs[other].start <= run.end {
                let root = find(&mut self.parents, self.runs[other].component);
                if label == u32::MAX {
                    label = root;
                } else if root != label {
                    let (low, high) = (root.min(label), root.max(label));
                    self.parents[high as usize] = low;
                    label = low;
                }
                other += 1;
            }
            if label == u32::MAX {
                label = self.parents.len() as u32;
                self.parents.push(label);
            }
            self.runs[index].component = label;
        }
    }

    /// Replaces labels by component indices and sums up the moments.
    fn resolve(&mut self) {
        for label in 0..self.parents.len() {
            let parent = self.parents[label] as usize;
            self.parents[label] = if parent == label {
                self.moments.push(Moments::default());
                self.moments.len() as u32 - 1
            } else {
                // A parent is smaller than its child, so it is already a final index.
                self.parents[parent]
            };
        }
        for run in &mut self.runs {
            run.component = self.parents[run.component as usize];
            self.moments[run.component as usize].add(run);
        }
    }
}

fn find(parents: &mut [u32], mut label: u32) -> u32 {
    while parents[label as usize] != label {
        let grandparent = parents[parents[label as usize] as usize];
        parents[label as usize] = grandparent;
        label = grandparent;
    }
    label
}

/// Appends the runs of a row of bytes 0 and 1 (whole words of 8).
#[inline(always)]
fn append_runs(row: &[u8], y: u32, runs: &mut Vec<Run>) {
    let mut before = 0u64;
    let mut open = 0;
    let mut inside = false;
    let (words, _) = row.as_chunks::<8>();
    for (index, word) in words.iter().enumerate() {
        let word = u64::from_le_bytes(*word);
        // Byte i of `edges` is 1 where pixel i differs from the one before it.
        let mut edges = word ^ (word << 8 | before);
        before = word >> 56;
        while edges != 0 {
            let x = index as u32 * 8 + edges.trailing_zeros() / 8;
            edges &= edges - 1;
            if inside {
                runs.push(Run {
                    y,
                    start: open,
                    end: x,
                    component: 0,
                });
            } else {
                open = x;
            }
            inside = !inside;
        }
    }
    if inside {
        runs.push(Run {
            y,
            start: open,
            end: words.len() as u32 * 8,
            component: 0,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn label(mask: &[Vec<bool>]) -> Components {
        let width = mask[0].len();
        let mut components = Components::with_size(width, mask.len());
        let mut row = vec![0; width.next_multiple_of(8)];
        components.label(mask.len(), &mut row, |y, row| {
            for (to, from) in row.iter_mut().zip(&mask[y]) {
                *to = u8::from(*from);
            }
        });
        components
    }

    /// Flood fill with 8 neighbours, in scan order.
    fn flood(mask: &[Vec<bool>]) -> (Vec<Vec<u32>>, Vec<Moments>) {
        let (height, width) = (mask.len(), mask[0].len());
        let mut labels = vec![vec![u32::MAX; width]; height];
        let mut all = Vec::new();
        for y in 0..height {
            for x in 0..width {
                if !mask[y][x] || labels[y][x] != u32::MAX {
                    continue;
                }
                let label = all.len() as u32;
                let mut moments = Moments {
                    left: x as u32,
                    right: 0,
                    top: y as u32,
                    ..Moments::default()
                };
                let mut open = vec![(x, y)];
                labels[y][x] = label;
                while let Some((x, y)) = open.pop() {
                    let (a, b) = (x as u64, y as u64);
                    moments.count += 1;
                    moments.x += a;
                    moments.y += b;
                    moments.xx += a * a;
                    moments.xy += a * b;
                    moments.yy += b * b;
                    moments.left = moments.left.min(x as u32);
                    moments.right = moments.right.max(x as u32 + 1);
                    moments.bottom = moments.bottom.max(y as u32 + 1);
                    for v in y.saturating_sub(1)..(y + 2).min(height) {
                        for u in x.saturating_sub(1)..(x + 2).min(width) {
                            if mask[v][u] && labels[v][u] == u32::MAX {
                                labels[v][u] = label;
                                open.push((u, v));
                            }
                        }
                    }
                }
                all.push(moments);
            }
        }
        (labels, all)
    }

    proptest! {
        #[test]
        fn equal_those_of_a_flood_fill(
            mask in (1usize..40).prop_flat_map(|width| {
                (0.1..0.9f64).prop_flat_map(move |density| {
                    prop::collection::vec(prop::collection::vec(prop::bool::weighted(density), width), 1..25)
                })
            }),
        ) {
            let components = label(&mask);
            let (labels, moments) = flood(&mask);
            prop_assert_eq!(components.moments(), &moments[..]);
            let mut set = 0;
            for run in components.runs() {
                for x in run.start..run.end {
                    prop_assert_eq!(labels[run.y as usize][x as usize], run.component);
                    set += 1;
                }
            }
            prop_assert_eq!(set, mask.iter().flatten().filter(|bit| **bit).count());
        }
    }

    #[test]
    fn arms_that_meet_late_are_one() {
        let rows = ["#...#...#", "#.#.#.#.#", "#..#...#.", ".#######."];
        let mask: Vec<Vec<bool>> = rows
            .iter()
            .map(|row| row.bytes().map(|byte| byte == b'#').collect())
            .collect();
        let components = label(&mask);
        assert_eq!(components.moments().len(), 1);
        assert_eq!(components.moments()[0].count, 18);
    }

    #[test]
    fn the_worst_pictures_stay_within_the_reserved_memory() {
        for (width, height) in [(64, 33), (123, 92), (1, 1), (7, 2)] {
            for pattern in [
                |x: usize, y: usize| (x | y) & 1 == 0,
                |x: usize, y: usize| (x + y) & 1 == 0,
            ] {
                let mask: Vec<Vec<bool>> = (0..height)
                    .map(|y| (0..width).map(|x| pattern(x, y)).collect())
                    .collect();
                let fresh = Components::with_size(width, height);
                let components = label(&mask);
                assert_eq!(components.runs.capacity(), fresh.runs.capacity());
                assert_eq!(components.parents.capacity(), fresh.parents.capacity());
                assert_eq!(components.moments.capacity(), fresh.moments.capacity());
            }
        }
    }
}
