//! A small picture and the state of the wheel, in a terminal: two pixels a character, as upper half blocks.

use senda_core::{Channels, Image, Observation, Stamp};
use senda_drivers::manual::Wheel;
use std::fmt::Write as _;
use std::io::Write as _;

/// Rows below the picture.
const ROWS_BELOW: usize = 3;
/// Pictures more often than this (ns) only make terminals late.
const SHORTEST_NS: u64 = 60_000_000;
/// Wider pictures only take a slow connection's time (characters).
const WIDEST: usize = 80;
/// Width of the angle's scale (characters), with a middle.
const SCALE: usize = 41;

/// Draws over and over in the same place of standard error.
pub(super) struct View {
    columns: usize,
    rows: usize,
    text: String,
    last: Option<Stamp>,
}

impl View {
    /// Takes a page of the terminal.
    pub(super) fn open(columns: usize, rows: usize) -> Self {
        // Another page, without cursor, so that what was there comes back.
        say("\x1b[?1049h\x1b[?25l\x1b[2J");
        Self {
            columns: columns.min(WIDEST),
            rows,
            text: String::new(),
            last: None,
        }
    }

    /// Draws what the vehicle sees and how the wheel stands. `progress`: hundredths of laps.
    pub(super) fn draw(
        &mut self,
        observation: &Observation,
        wheel: &Wheel,
        progress: u64,
        recorded: Option<u64>,
    ) {
        let now = observation.stamp;
        if self.last.is_some_and(|last| now.ns < last.ns + SHORTEST_NS) {
            return;
        }
        self.last = Some(now);
        self.text.clear();
        self.text.push_str("\x1b[H");
        if let Some(frame) = observation.first_frame() {
            let most = [self.columns, self.rows.saturating_sub(ROWS_BELOW)];
            half_blocks(&frame.image, most, &mut self.text);
        }
        let measured = observation
            .speed_mps
            .map_or(String::new(), |speed| format!(", drives {speed:.2}"));
        let recorded = recorded.map_or(String::new(), |steps| format!("  recording: {steps} frames"));
        // Writing into a string cannot fail.
        let _ = write!(
            self.text,
            "{} {:>3.0}°  speed {:.2} m/s{measured}  {:.1} s  lap {}, {} %{recorded}\x1b[K\n\
             arrows or wasd: steer, go, stop   c: straight   + -: speed   q: quit\x1b[K\x1b[J",
            scale(wheel.angle_deg()),
            wheel.angle_deg(),
            wheel.speed_mps(),
            now.as_s(),
            progress / 100 + 1,
            progress % 100,
        );
        say(&self.text);
    }
}

impl Drop for View {
    fn drop(&mut self) {
        say("\x1b[?25h\x1b[?1049l");
    }
}

fn say(text: &str) {
    let mut to = std::io::stderr().lock();
    // A terminal that is gone is noticed by its keyboard.
    let _ = to.write_all(text.as_bytes()).and_then(|()| to.flush());
}

/// Where the angle stands between 40 (left) and 140.
fn scale(angle_deg: f64) -> String {
    let place = ((angle_deg - 40.0) / 100.0 * (SCALE - 1) as f64).round() as usize;
    (0..SCALE)
        .map(|column| match column {
            _ if column == place => '●',
            _ if column == SCALE / 2 => '|',
            _ => '-',
        })
        .collect()
}

/// Adds the picture, as large as fits into columns and rows, its shape kept: characters are twice as high as wide.
fn half_blocks(image: &Image, [columns, rows]: [usize; 2], text: &mut String) {
    let (width, height) = (image.width(), image.height());
    if image.is_empty() || columns == 0 || rows == 0 {
        return;
    }
    let across = columns.min(width).min((2 * rows * width / height).max(1));
    let down = (across * height / width / 2).clamp(1, rows);
    for row in 0..down {
        let (mut foreground, mut background) = (None, None);
        for column in 0..across {
            let upper = mean(image, [column, 2 * row], [across, 2 * down]);
            let lower = mean(image, [column, 2 * row + 1], [across, 2 * down]);
            if foreground != Some(upper) {
                let [r, g, b] = upper;
                let _ = write!(text, "\x1b[38;2;{r};{g};{b}m");
                foreground = Some(upper);
            }
            if background != Some(lower) {
                let [r, g, b] = lower;
                let _ = write!(text, "\x1b[48;2;{r};{g};{b}m");
                background = Some(lower);
            }
            text.push('▀');
        }
        text.push_str("\x1b[0m\x1b[K\n");
    }
}

/// The mean colour of one of `of` parts of a picture each way.
fn mean(image: &Image, [column, row]: [usize; 2], of: [usize; 2]) -> [u8; 3] {
    let covered = |place: usize, of: usize, pixels: usize| {
        let begin = (place * pixels / of).min(pixels - 1);
        begin..((place + 1) * pixels / of).clamp(begin + 1, pixels)
    };
    let (columns, rows) = (
        covered(column, of[0], image.width()),
        covered(row, of[1], image.height()),
    );
    let count = columns.len() * rows.len();
    let mut sums = [0usize; 3];
    for y in rows {
        for x in columns.clone() {
            let pixel = image.pixel(x, y);
            for (channel, sum) in sums.iter_mut().enumerate() {
                *sum += usize::from(match image.channels() {
                    Channels::Gray => pixel[0],
                    Channels::Rgb => pixel[channel],
                });
            }
        }
    }
    // In steps of 8, so that a camera's noise does not send every colour anew.
    sums.map(|sum| (sum / count) as u8 & 0xf8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(width: usize, height: usize, most: [usize; 2]) -> (usize, usize) {
        let mut text = String::new();
        half_blocks(&Image::new(width, height, Channels::Rgb), most, &mut text);
        let lines: Vec<_> = text.lines().collect();
        let across = lines.iter().map(|line| line.matches('▀').count()).max();
        (across.unwrap_or(0), lines.len())
    }

    #[test]
    fn pictures_fit_and_keep_their_shape() {
        assert_eq!(drawn(160, 120, [80, 40]), (80, 30));
        assert_eq!(drawn(160, 120, [200, 12]), (32, 12));
        assert_eq!(drawn(8, 6, [80, 24]), (8, 3));
        assert_eq!(drawn(0, 0, [80, 24]), (0, 0));
        assert_eq!(drawn(300, 1, [80, 24]), (80, 1));
        assert_eq!(drawn(160, 120, [80, 0]), (0, 0));
    }

    #[test]
    fn the_upper_pixel_is_the_foreground_and_the_lower_one_the_background() {
        let image = Image::from_pixels(1, 2, Channels::Rgb, vec![16, 24, 33, 40, 48, 56]).unwrap();
        let mut text = String::new();
        half_blocks(&image, [1, 1], &mut text);
        assert!(
            text.starts_with("\x1b[38;2;16;24;32m\x1b[48;2;40;48;56m▀"),
            "{text:?}"
        );
    }

    #[test]
    fn the_scale_has_left_on_the_left() {
        assert!(scale(40.0).starts_with('●'));
        assert!(scale(140.0).ends_with('●'));
        assert_eq!(scale(90.0).chars().nth(SCALE / 2), Some('●'));
    }
}
