//! Signs and lights by colour and shape: the classical detector (document D uses a network for them, D7 in SPEC).

use crate::components::Components;
use crate::detection::{Detection, Detector, ObjectClass};
use crate::{HsvRange, street::colours};
use senda_core::{Channels, Image};

/// What counts as a sign's board and as a lit lamp. Sizes are parts of the frame's width.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClassicalOptions {
    /// Light blue of the boards.
    pub board: HsvRange,
    /// Lit red lamps.
    pub red_lamp: HsvRange,
    /// Lit green lamps.
    pub green_lamp: HsvRange,
    /// Smallest board and lamp.
    pub board_part: f64,
    /// Smallest lamp.
    pub lamp_part: f64,
    /// Only this part of the frame's height is searched, from the top.
    pub part: f64,
}

impl Default for ClassicalOptions {
    /// Measured on rendered frames of the worlds for tuning.
    fn default() -> Self {
        Self {
            board: HsvRange {
                low: [74, 45, 60],
                high: [118, 255, 255],
            },
            red_lamp: HsvRange {
                low: [165, 100, 130],
                high: [12, 255, 255],
            },
            green_lamp: HsvRange {
                low: [48, 38, 120],
                high: [98, 255, 255],
            },
            board_part: 0.045,
            lamp_part: 0.016,
            part: 0.62,
        }
    }
}

/// Frames are shrunk by the whole factor that leaves at least this width (px).
const WORKING_WIDTH_PX: usize = 320;

/// The classical detector.
#[derive(Debug, Clone, Default)]
pub struct ClassicalDetector {
    options: ClassicalOptions,
    small: Image,
    row: Vec<u8>,
    components: Components,
    found: Vec<Detection>,
}

impl ClassicalDetector {
    /// With other limits.
    pub fn new(options: ClassicalOptions) -> Self {
        Self {
            options,
            ..Self::default()
        }
    }

    /// Boxes (px of the shrunk frame) of what has a colour, with the part of each that is filled.
    fn blobs(&mut self, colour: HsvRange, height: usize, mut each: impl FnMut(&Image, [usize; 4], f64)) {
        let small = &self.small;
        self.row.clear();
        self.row.resize(small.width().next_multiple_of(8), 0);
        self.components.label(height, &mut self.row, |v, row| {
            for (out, pixel) in row.iter_mut().zip(small.row(v).as_chunks::<3>().0) {
                *out = u8::from(colour.contains(crate::hsv(*pixel)));
            }
        });
        for blob in self.components.moments() {
            let size = [blob.left, blob.top, blob.right, blob.bottom].map(|side| side as usize);
            let area = (size[2] - size[0]) * (size[3] - size[1]);
            each(small, size, blob.count as f64 / area.max(1) as f64);
        }
    }
}

impl Detector for ClassicalDetector {
    fn detect(&mut self, frame: &Image) -> &[Detection] {
        self.found.clear();
        if frame.channels() != Channels::Rgb || frame.width() < 64 || frame.height() < 48 {
            return &self.found;
        }
        let factor = (frame.width() / WORKING_WIDTH_PX).max(1);
        colours::shrink(frame, factor, &mut self.small);
        let width = self.small.width() as f64;
        let height = (self.small.height() as f64 * self.options.part.clamp(0.1, 1.0)) as usize;
        let options = self.options;
        let mut found = std::mem::take(&mut self.found);
        let mut keep = |class, size: [usize; 4], confidence: f64| {
            found.push(Detection {
                class,
                box_px: size.map(|side| (side * factor) as f32),
                confidence: confidence.clamp(0.0, 1.0) as f32,
            });
        };
        let full_width = self.small.width();
        self.blobs(options.board, height, |image, size, filled| {
            let (w, h) = ((size[2] - size[0]) as f64, (size[3] - size[1]) as f64);
            // Cut by the frame's edge its digit cannot be told.
            let whole = size[0] > 0 && size[2] < full_width;
            if whole && h > options.board_part * width && (0.55..1.5).contains(&(w / h)) && filled > 0.5 {
                if let Some((digit, confidence)) = digit(image, size) {
                    keep(ObjectClass::Sign(digit), size, confidence);
                }
            }
        });
        for (class, colour, partner) in [
            (ObjectClass::RedLight, options.red_lamp, 1.0),
            (ObjectClass::GreenLight, options.green_lamp, -1.0),
        ] {
            self.blobs(colour, height, |image, size, filled| {
                let (w, h) = ((size[2] - size[0]) as f64, (size[3] - size[1]) as f64);
                let round = (0.55..1.6).contains(&(w / h)) && filled > 0.5;
                if !round || h < options.lamp_part * width {
                    return;
                }
                if let Some(confidence) = lamp(image, size, partner) {
                    // The whole light, as labels have it: 2.4 wide, lamps of 0.74 of its width.
                    let side = 0.5 * (w + h) / 0.74;
                    let middle_u = 0.5 * (size[0] + size[2]) as f64;
                    let lamp_v = 0.5 * (size[1] + size[3]) as f64;
                    let middle_v = lamp_v + partner * 0.55 * side;
                    let at = |value: f64| value.max(0.0) as usize;
                    let whole = [
                        at(middle_u - 0.5 * side),
                        at(middle_v - 1.2 * side),
                        at(middle_u + 0.5 * side),
                        at(middle_v + 1.2 * side),
                    ];
                    keep(class, whole, confidence * filled / 0.785);
                }
            });
        }
        found.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        self.found = found;
        &self.found
    }
}

/// Whether a bright blob is a light's lamp: grey housing around it, and in the direction of its partner (1 down, -1 up) a
/// dark lamp.
fn lamp(image: &Image, [left, top, right, bottom]: [usize; 4], partner: f64) -> Option<f64> {
    let (w, h) = ((right - left) as f64, (bottom - top) as f64);
    let (u, v) = (0.5 * (left + right) as f64, 0.5 * (top + bottom) as f64);
    let radius = 0.25 * (w + h);
    let pixel = |u: f64, v: f64| -> Option<[i32; 3]> {
        let inside = u >= 0.0 && v >= 0.0 && (u as usize) < image.width() && (v as usize) < image.height();
        inside.then(|| {
            let pixel = image.pixel(u as usize, v as usize);
            [0, 1, 2].map(|c| i32::from(pixel[c]))
        })
    };
    let value = |pixel: [i32; 3]| pixel[0].max(pixel[1]).max(pixel[2]);
    let own = value(pixel(u, v)?);
    // Lamps' middles are 1.1 of the board's width apart, their radius is 0.37 of it.
    let other = value(pixel(u, v + partner * 1.1 / 0.37 * radius)?);
    // Between the two lamps and beyond the partner lies housing.
    let between = pixel(u, v + partner * 0.55 / 0.37 * radius)?;
    let grey = value(between) - between.iter().min().copied().unwrap_or(0);
    let dark = f64::from(own - other) / f64::from(own.max(1));
    (dark > 0.35 && grey < 70 && value(between) < own && other < value(between) + 15)
        .then_some(0.6 + 0.4 * dark)
}

/// The digit on a board, by the part of each cell that is dark, against templates.
fn digit(image: &Image, [left, top, right, bottom]: [usize; 4]) -> Option<(u8, f64)> {
    const COLUMNS: usize = 6;
    const ROWS: usize = 10;
    let luminance = |u: usize, v: usize| {
        let pixel = image.pixel(u.min(image.width() - 1), v.min(image.height() - 1));
        i32::from(pixel[0]) * 2 + i32::from(pixel[1]) * 5 + i32::from(pixel[2])
    };
    // Board and digit are the two sides of the middle between the darkest and the lightest.
    let (mut darkest, mut lightest) = (i32::MAX, 0);
    for v in top + 1..bottom.saturating_sub(1) {
        for u in left + 1..right.saturating_sub(1) {
            let value = luminance(u, v);
            (darkest, lightest) = (darkest.min(value), lightest.max(value));
        }
    }
    if lightest - darkest < 150 {
        return None;
    }
    // The digit fills the middle half of the board's width, and 10 of 12 parts of its height count.
    let (w, h) = ((right - left) as f64, (bottom - top) as f64);
    let mut cells = [[0.0; COLUMNS]; ROWS];
    for (row, cells) in cells.iter_mut().enumerate() {
        for (column, cell) in cells.iter_mut().enumerate() {
            for sample in 0..9 {
                let u = (column as f64 + f64::from(sample % 3) / 3.0 + 1.0 / 6.0 + 3.0) / 12.0;
                let v = (row as f64 + f64::from(sample / 3) / 3.0 + 1.0 / 6.0 + 1.0) / 12.0;
                let value = luminance(left + (u * w) as usize, top + (v * h) as usize);
                *cell += f64::from(lightest - value) / f64::from(lightest - darkest) / 9.0;
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
