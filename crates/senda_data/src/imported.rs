//! What all imported data sets share: times, camera sizes, provenance.

use crate::warnings::Warnings;
use crate::{RecordingHeader, Step};
use senda_core::{Body, Stamp};

/// Steps between times shorter than this (s) are not those of a camera: the set was converted by a program that wrote
/// its own time. Cameras of these vehicles deliver 10 to 60 frames a second; seen in converted tubs: 2-3 ms.
const SHORTEST_PERIOD_S: f64 = 0.010;

/// Stamps from a data set's own times (s on any scale, increasing or not), and the usual time between them (s).
pub(crate) fn stamps(times_s: &[Option<f64>], nominal_s: f64, warnings: &mut Warnings) -> (Vec<Stamp>, f64) {
    let evenly = |period_s: f64| {
        let period_ns = Stamp::from_s(period_s).ns;
        (0..times_s.len() as u64)
            .map(|i| Stamp::from_ns(i.saturating_mul(period_ns)))
            .collect()
    };
    let mut steps_s: Vec<f64> = times_s
        .windows(2)
        .filter_map(|pair| Some(pair[1]? - pair[0]?))
        .filter(|step_s| *step_s > 0.0)
        .collect();
    steps_s.sort_by(f64::total_cmp);
    let Some(&usual_s) = steps_s.get(steps_s.len() / 2) else {
        if times_s.len() > 1 {
            warnings.add("times missing", || {
                format!(
                    "there are no usable times: the nominal {:.1} frames a second are taken",
                    1.0 / nominal_s
                )
            });
        }
        return (evenly(nominal_s), nominal_s);
    };
    if usual_s < SHORTEST_PERIOD_S {
        warnings.add("times useless", || {
            format!(
                "times are {:.1} ms apart, which no camera of such a vehicle does (converted data?): \
                 the nominal {:.1} frames a second are taken",
                usual_s * 1e3,
                1.0 / nominal_s
            )
        });
        return (evenly(nominal_s), nominal_s);
    }
    let mut stamps = Vec::with_capacity(times_s.len());
    let mut now_s = 0.0;
    let mut previous: Option<f64> = None;
    for (i, time) in times_s.iter().enumerate() {
        let step_s = match (previous, time) {
            _ if i == 0 => 0.0,
            (Some(before), Some(time)) if *time > before => time - before,
            _ => {
                warnings.add("times that do not increase", || {
                    format!("record {i}: its time is missing or does not increase: {usual_s:.3} s are taken")
                });
                usual_s
            }
        };
        now_s += step_s;
        previous = time.or(previous);
        stamps.push(Stamp::from_s(now_s));
    }
    (stamps, usual_s)
}

/// Gives the body's cameras the size of the pictures that were recorded with them.
pub(crate) fn fit_cameras(body: &mut Body, steps: &[Step], warnings: &mut Warnings) {
    for camera in &mut body.cameras {
        let mut frames = steps
            .iter()
            .flat_map(|step| &step.frames)
            .filter(|f| f.camera == camera.name);
        let Some(image) = frames.find_map(|frame| frame.encoded.decode().ok()) else {
            continue;
        };
        let (width, height) = (image.width() as u32, image.height() as u32);
        if (width, height) == (camera.width_px, camera.height_px) || width == 0 || height == 0 {
            continue;
        }
        let was = (camera.width_px, camera.height_px);
        *camera = camera.resized(width, height);
        if u64::from(width) * u64::from(was.1) != u64::from(height) * u64::from(was.0) {
            warnings.add("camera shapes", || {
                format!(
                    "camera {}: the pictures are {width}x{height} px, but the vehicle's camera is {}x{}: \
                     its lens was stretched to fit, so distances on the floor are guesses",
                    camera.name, was.0, was.1
                )
            });
        }
    }
}

/// The header of an imported recording. The scenario says where it came from.
pub(crate) fn header(format: &str, source: &str, body: Body, driver: &str) -> RecordingHeader {
    RecordingHeader {
        senda: env!("CARGO_PKG_VERSION").into(),
        commit: String::new(),
        scenario: format!(
            "[import]\nformat = {}\nsource = {}\n",
            toml_string(format),
            toml_string(source)
        ),
        world: None,
        reversed: false,
        body,
        driver: driver.into(),
        seed: 0,
    }
}

/// A basic TOML string: its escapes are those of JSON.
fn toml_string(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ns(times: &[Option<f64>]) -> (Vec<u64>, f64, usize) {
        let mut warnings = Warnings::default();
        let (stamps, period) = stamps(times, 0.05, &mut warnings);
        (
            stamps.iter().map(|s| s.ns).collect(),
            period,
            warnings.finish().len(),
        )
    }

    #[test]
    fn real_times_are_kept_and_converted_ones_replaced() {
        let (stamps, period, warned) = ns(&[Some(10.0), Some(10.1), Some(10.3)]);
        assert_eq!(stamps, [0, 100_000_000, 300_000_000]);
        assert!((period - 0.2).abs() < 1e-9 && warned == 0);
        let (stamps, period, warned) = ns(&[Some(10.0), Some(10.002), Some(10.005)]);
        assert_eq!(
            (stamps, period, warned),
            (vec![0, 50_000_000, 100_000_000], 0.05, 1)
        );
    }

    #[test]
    fn times_that_jump_back_never_make_stamps_decrease() {
        let (stamps, _, warned) = ns(&[Some(10.0), Some(10.1), None, Some(3.0), Some(3.1)]);
        assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]), "{stamps:?}");
        assert_eq!(warned, 2);
    }

    #[test]
    fn nothing_and_one_are_fine() {
        assert_eq!(ns(&[]), (vec![], 0.05, 0));
        assert_eq!(ns(&[Some(5.0)]), (vec![0], 0.05, 0));
    }
}
