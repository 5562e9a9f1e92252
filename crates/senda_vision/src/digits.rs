//! Digits on boards that are seen aslant: corners, then cells against templates.

use senda_core::Image;

/// Eight times the luminance.
pub(crate) fn luminance([red, green, blue]: [u8; 3]) -> i32 {
    2 * i32::from(red) + 5 * i32::from(green) + i32::from(blue)
}

/// Corners of what is kept in a box, as of a board seen aslant: upper left, upper right, lower right, lower left.
pub(crate) fn corners(
    keeps: impl Fn(usize, usize) -> bool,
    [left, top, right, bottom]: [usize; 4],
) -> [[f64; 2]; 4] {
    let mut best = [(f64::NEG_INFINITY, [0.0; 2]); 4];
    for v in top..bottom {
        for u in left..right {
            if keeps(u, v) {
                for (best, [du, dv]) in
                    best.iter_mut()
                        .zip([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
                {
                    // The pixel's own outer corner.
                    let at = [u as f64 + 0.5 + 0.5 * du, v as f64 + 0.5 + 0.5 * dv];
                    let reach = du * at[0] + dv * at[1];
                    if reach > best.0 {
                        *best = (reach, at);
                    }
                }
            }
        }
    }
    best.map(|(_, at)| at)
}

/// The digit on a board of these corners, by the part of each cell that is dark, against templates.
pub(crate) fn digit(image: &Image, corners: [[f64; 2]; 4]) -> Option<(u8, f64)> {
    const COLUMNS: usize = 6;
    const ROWS: usize = 10;
    /// Samples along each side of the board.
    const SIDE: usize = 36;
    let luminance = |u: f64, v: f64| {
        let (u, v) = (u.max(0.0) as usize, v.max(0.0) as usize);
        let pixel = image.pixel(u.min(image.width() - 1), v.min(image.height() - 1));
        luminance([pixel[0], pixel[1], pixel[2]])
    };
    let mut samples = [[0i32; SIDE]; SIDE];
    for (row, samples) in samples.iter_mut().enumerate() {
        let down = (row as f64 + 0.5) / SIDE as f64;
        for (column, sample) in samples.iter_mut().enumerate() {
            let across = (column as f64 + 0.5) / SIDE as f64;
            let along = |axis: usize| {
                let upper = corners[0][axis] + (corners[1][axis] - corners[0][axis]) * across;
                let lower = corners[3][axis] + (corners[2][axis] - corners[3][axis]) * across;
                upper + (lower - upper) * down
            };
            *sample = luminance(along(0), along(1));
        }
    }
    // Board and digit: most of the board is light, a tenth of it or more is dark.
    let mut sorted: Vec<i32> = samples.iter().flatten().copied().collect();
    sorted.sort_unstable();
    let (darkest, lightest) = (sorted[sorted.len() / 30], sorted[sorted.len() * 7 / 10]);
    if lightest - darkest < 120 {
        return None;
    }
    // The digit fills the middle half of the board's width, and 10 of 12 parts of its height count.
    let mut cells = [[0.0; COLUMNS]; ROWS];
    for (row, cells) in cells.iter_mut().enumerate() {
        for (column, cell) in cells.iter_mut().enumerate() {
            for sample in 0..9 {
                let value = samples[3 * (row + 1) + sample / 3][3 * (column + 3) + sample % 3];
                let dark = f64::from(lightest - value) / f64::from(lightest - darkest);
                *cell += dark.clamp(0.0, 1.0) / 9.0;
            }
        }
    }
    let mut scores: Vec<(f64, u8)> = (0..10u8)
        .map(|digit| (correlation(&cells, &TEMPLATES[usize::from(digit)]), digit))
        .collect();
    scores.sort_by(|a, b| b.0.total_cmp(&a.0));
    let ((best, digit), (second, _)) = (scores[0], scores[1]);
    (best > 0.6 && best - second > 0.03).then_some((digit, best))
}

fn correlation(cells: &[[f64; 6]; 10], template: &[&[u8; 6]; 10]) -> f64 {
    let pairs = || {
        cells
            .iter()
            .flatten()
            .zip(template.iter().flat_map(|row| row.iter()))
            .map(|(cell, letter)| (*cell, f64::from(letter - b'0') / 9.0))
    };
    let (mut sa, mut sb) = (0.0, 0.0);
    for (a, b) in pairs() {
        (sa, sb) = (sa + a, sb + b);
    }
    let (ma, mb) = (sa / 60.0, sb / 60.0);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in pairs() {
        let (a, b) = (a - ma, b - mb);
        (ab, aa, bb) = (ab + a * b, aa + a * a, bb + b * b);
    }
    ab / (aa * bb).sqrt().max(1e-9)
}

/// How dark the cells of each digit are (0 to 9), in the middle 6 of 12 columns and 10 of 12 rows of its board.
const TEMPLATES: [[&[u8; 6]; 10]; 10] = [
    [
        b"026620", b"186681", b"660066", b"830038", b"920029", b"920029", b"830038", b"660066", b"186681",
        b"026620",
    ],
    [
        b"002600", b"038920", b"296920", b"121920", b"001920", b"001920", b"001920", b"001920", b"001920",
        b"000600",
    ],
    [
        b"036630", b"485683", b"840057", b"500057", b"000083", b"000780", b"006810", b"058100", b"595333",
        b"666666",
    ],
    [
        b"036520", b"786694", b"100056", b"000076", b"007881", b"004693", b"000048", b"100038", b"885695",
        b"036530",
    ],
    [
        b"000340", b"001860", b"007960", b"048560", b"193460", b"771571", b"999999", b"111571", b"000460",
        b"000240",
    ],
    [
        b"166665", b"393332", b"460000", b"574410", b"697893", b"010057", b"000029", b"100057", b"885793",
        b"036510",
    ],
    [
        b"000130", b"006992", b"068200", b"293100", b"498961", b"882175", b"750049", b"560056", b"287782",
        b"015510",
    ],
    [
        b"666666", b"333368", b"000074", b"000291", b"000570", b"000830", b"003800", b"006600", b"019100",
        b"016000",
    ],
    [
        b"036630", b"295592", b"560065", b"470074", b"197791", b"585585", b"930039", b"920029", b"684486",
        b"046640",
    ],
    [
        b"015510", b"287782", b"650065", b"940057", b"571288", b"169894", b"001392", b"002860", b"299600",
        b"031000",
    ],
];
