//! Sobel's gradients and Canny's edges of grey pictures (A4 and B3 in SPEC): here, because drivers look for lines with them
//! and networks are shown them.

/// Gradients of a grey picture, in the units of Sobel's 3x3 kernels (a step of one grey level gives 4).
#[derive(Debug, Clone, Default)]
pub struct Gradients {
    /// Towards larger u.
    pub du: Vec<i16>,
    /// Towards larger v.
    pub dv: Vec<i16>,
}

/// Computes the gradients of `source` (rows of `width` pixels), border repeated, into `gradients`, whose memory is
/// reused.
///
/// # Panics
/// When the length is not whole rows.
pub fn sobel(source: &[u8], width: usize, gradients: &mut Gradients) {
    gradients.du.clear();
    gradients.dv.clear();
    gradients.du.resize(source.len(), 0);
    gradients.dv.resize(source.len(), 0);
    if source.is_empty() {
        return;
    }
    assert!(
        width > 0 && source.len().is_multiple_of(width),
        "expected whole rows"
    );
    let last = source.len() / width - 1;
    for y in 0..=last {
        let row = |y: usize| &source[y * width..(y + 1) * width];
        let (above, own, below) = (row(y.saturating_sub(1)), row(y), row((y + 1).min(last)));
        let out = y * width..(y + 1) * width;
        let (du, dv) = (&mut gradients.du[out.clone()], &mut gradients.dv[out]);
        for x in 0..width {
            let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
            let at = |row: &[u8], x: usize| i16::from(row[x]);
            du[x] =
                at(above, right) - at(above, left) + 2 * (at(own, right) - at(own, left)) + at(below, right)
                    - at(below, left);
            dv[x] = at(below, left) - at(above, left) + 2 * (at(below, x) - at(above, x)) + at(below, right)
                - at(above, right);
        }
    }
}

/// Canny's edge detector (Canny 1986) with the sum of the gradients' amounts as strength, as OpenCV's default; owns
/// its memory.
#[derive(Debug, Clone, Default)]
pub struct Canny {
    gradients: Gradients,
    strength: Vec<u16>,
    open: Vec<u32>,
}

const WEAK: u8 = 1;
const EDGE: u8 = 255;

impl Canny {
    /// A detector without memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Writes 255 on edges and 0 elsewhere: ridges of the gradient above `high`, and those above `low` that are
    /// connected to them (8 neighbours). A4 takes (200, 400).
    ///
    /// # Panics
    /// When the lengths differ or are not whole rows.
    pub fn detect(&mut self, source: &[u8], width: usize, low: u16, high: u16, edges: &mut [u8]) {
        assert_eq!(source.len(), edges.len());
        sobel(source, width, &mut self.gradients);
        edges.fill(0);
        if source.is_empty() {
            return;
        }
        let Gradients { du, dv } = &self.gradients;
        self.strength.clear();
        self.strength.extend(
            du.iter()
                .zip(dv)
                .map(|(u, v)| u.unsigned_abs() + v.unsigned_abs()),
        );
        let height = source.len() / width;
        let strength = &self.strength;
        let at = |x: i64, y: i64| {
            let inside = x >= 0 && y >= 0 && x < width as i64 && y < height as i64;
            if inside {
                strength[y as usize * width + x as usize]
            } else {
                0
            }
        };
        self.open.clear();
        for y in 0..height {
            for x in 0..width {
                let index = y * width + x;
                let own = strength[index];
                if own <= low {
                    continue;
                }
                let (u, v) = (i32::from(du[index]), i32::from(dv[index]));
                // Sectors of 45°, whose borders lie at 22.5°: tan = 0.4142 = 13573 / 32768.
                let (flat, steep) = (u.abs() * 13_573, v.abs() << 15);
                let (dx, dy) = if steep < flat {
                    (1, 0)
                } else if steep > flat + (u.abs() << 16) {
                    (0, 1)
                } else if (u < 0) == (v < 0) {
                    (1, 1)
                } else {
                    (1, -1)
                };
                let (x, y) = (x as i64, y as i64);
                // Of two equal neighbours only the second is the ridge.
                if own > at(x - dx, y - dy) && own >= at(x + dx, y + dy) {
                    edges[index] = if own > high { EDGE } else { WEAK };
                    if own > high {
                        self.open.push(index as u32);
                    }
                }
            }
        }
        while let Some(index) = self.open.pop() {
            let (x, y) = (index as usize % width, index as usize / width);
            for v in y.saturating_sub(1)..(y + 2).min(height) {
                for u in x.saturating_sub(1)..(x + 2).min(width) {
                    let neighbour = v * width + u;
                    if edges[neighbour] == WEAK {
                        edges[neighbour] = EDGE;
                        self.open.push(neighbour as u32);
                    }
                }
            }
        }
        for edge in edges {
            if *edge == WEAK {
                *edge = 0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(grey: impl Fn(usize, usize) -> u8) -> Vec<u8> {
        (0..40 * 30).map(|i| grey(i % 40, i / 40)).collect()
    }

    #[test]
    fn gradients_of_a_slope_are_its_slope() {
        let mut gradients = Gradients::default();
        sobel(&picture(|x, y| (3 * x + 2 * y) as u8), 40, &mut gradients);
        // Eight times the slope: twice the distance, weights 1 2 1.
        assert_eq!((gradients.du[40 * 10 + 10], gradients.dv[40 * 10 + 10]), (24, 16));
    }

    #[test]
    fn a_step_gives_one_thin_edge() {
        for (step, along_rows) in [(17, true), (17, false)] {
            let source = picture(|x, y| {
                if (if along_rows { x } else { y }) < step {
                    40
                } else {
                    200
                }
            });
            let mut edges = vec![9; source.len()];
            Canny::new().detect(&source, 40, 200, 400, &mut edges);
            for y in 0..30 {
                for x in 0..40 {
                    let place = if along_rows { x } else { y };
                    assert_eq!(edges[y * 40 + x] == 255, place == step - 1, "{x} {y}");
                }
            }
        }
    }

    #[test]
    fn weak_edges_live_only_beside_strong_ones() {
        // The same step, fading out downwards; and a weak one by itself.
        let fading = picture(|x, y| if x < 20 { 60 } else { 190 - 3 * y as u8 });
        let mut edges = vec![0; fading.len()];
        Canny::new().detect(&fading, 40, 100, 400, &mut edges);
        assert!(edges[25 * 40..26 * 40].contains(&255));
        let weak = picture(|x, _| if x < 20 { 60 } else { 110 });
        Canny::new().detect(&weak, 40, 100, 400, &mut edges);
        assert!(!edges.contains(&255));
        assert!(edges.iter().all(|edge| *edge == 0 || *edge == 255));
    }

    #[test]
    fn diagonal_edges_are_found_whole() {
        for rising in [false, true] {
            let source = picture(|x, y| {
                if (if rising { x + y } else { x + 30 - y }) < 35 {
                    30
                } else {
                    220
                }
            });
            let mut edges = vec![0; source.len()];
            Canny::new().detect(&source, 40, 200, 400, &mut edges);
            let rows = edges.chunks(40).filter(|row| row.contains(&255)).count();
            assert!(rows >= 28, "{rows}");
        }
    }

    #[test]
    fn empty_pictures_have_no_edges() {
        Canny::new().detect(&[], 0, 1, 2, &mut []);
    }
}
