//! What all imported data sets share: times, runs, camera sizes, provenance.

use crate::warnings::Warnings;
use crate::{Recording, RecordingHeader, Step};
use senda_core::{Body, Stamp};
use serde::Deserialize;

/// Where data of another program came from.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct Origin {
    /// Name of the format: `tub`.
    pub format: String,
    /// The set's own name.
    pub source: String,
}

impl RecordingHeader {
    /// Where the data came from if another program recorded them, read just now or imported long ago; `None` for runs of senda.
    pub fn origin(&self) -> Option<Origin> {
        #[derive(Deserialize)]
        struct Scenario {
            import: Origin,
        }
        let scenario: Scenario = toml::from_str(&self.scenario).ok()?;
        Some(scenario.import)
    }
}

/// A record of a foreign data set that can become a step.
#[derive(Debug)]
pub(crate) struct Taken {
    /// The run it belongs to; neighbours with equal names are one run.
    pub(crate) run: Option<String>,
    /// Its time (ns on any scale), where it has one.
    pub(crate) time_ns: Option<u64>,
    /// The step, without stamps.
    pub(crate) step: Step,
}

/// A foreign data set, read.
#[derive(Debug)]
pub(crate) struct Set {
    /// Name of the format.
    pub(crate) format: &'static str,
    /// The set's own name.
    pub(crate) source: String,
    /// Time between records (s) where they do not say.
    pub(crate) nominal_s: f64,
    /// Records in order.
    pub(crate) records: Vec<Taken>,
    /// What was wrong with the set.
    pub(crate) warnings: Warnings,
}

impl Set {
    /// All of it as one recording, with an event where each run begins if there are several.
    pub(crate) fn joined(mut self, body: &Body) -> Recording {
        let runs = 1 + self
            .records
            .windows(2)
            .filter(|pair| pair[0].run != pair[1].run)
            .count();
        if runs > 1 {
            self.warnings.add("several runs", || {
                format!("there are {runs} runs, which are separate drives: here they follow each other")
            });
            let mut before: Option<Option<String>> = None;
            for taken in &mut self.records {
                if before.as_ref() != Some(&taken.run) {
                    let name = taken.run.as_deref().unwrap_or("without a name");
                    taken.step.explanation.event(format!("run {name} begins"));
                    before = Some(taken.run.clone());
                }
            }
        }
        self.recording(body)
    }

    /// One recording a run: sequences never cross runs. What concerns the whole set is warned of in the first.
    pub(crate) fn apart(self, body: &Body) -> Vec<Recording> {
        let Self {
            format,
            source,
            nominal_s,
            records,
            warnings,
        } = self;
        let mut runs: Vec<Vec<Taken>> = Vec::new();
        for record in records {
            match runs.last_mut() {
                Some(run) if run[0].run == record.run => run.push(record),
                _ => runs.push(vec![record]),
            }
        }
        if runs.is_empty() {
            runs.push(Vec::new());
        }
        let mut warnings = Some(warnings);
        runs.into_iter()
            .map(|records| {
                let part = Self {
                    format,
                    source: source.clone(),
                    nominal_s,
                    records,
                    warnings: warnings.take().unwrap_or_default(),
                };
                part.recording(body)
            })
            .collect()
    }

    fn recording(self, body: &Body) -> Recording {
        let Self {
            format,
            source,
            nominal_s,
            records,
            mut warnings,
        } = self;
        let times: Vec<_> = records.iter().map(|taken| taken.time_ns).collect();
        let (stamps, period_s) = stamps(&times, nominal_s, &mut warnings);
        let mut steps = Vec::with_capacity(records.len());
        for (taken, stamp) in records.into_iter().zip(stamps) {
            let mut step = taken.step;
            step.stamp = stamp;
            for frame in &mut step.frames {
                frame.stamp = stamp;
            }
            steps.push(step);
        }
        if steps.is_empty() {
            warnings.add("nothing", || "there is no usable record".into());
        }
        let mut body = body.clone();
        body.period_s = period_s;
        fit_cameras(&mut body, &steps, &mut warnings);
        Recording {
            lost: Vec::new(),
            header: header(format, &source, body, driver_of(&steps)),
            steps,
            summary: None,
            warnings: warnings.finish(),
        }
    }
}

/// Times closer together than this (ns) are not those of a camera: the set was converted by a program that wrote its own
/// time. Cameras of these vehicles deliver 10 to 60 frames a second; seen in converted tubs: 2-3 ms.
const SHORTEST_PERIOD_NS: u64 = 10_000_000;

/// Stamps from a data set's own times (ns on any scale, increasing or not), and the usual time between them (s).
fn stamps(times_ns: &[Option<u64>], nominal_s: f64, warnings: &mut Warnings) -> (Vec<Stamp>, f64) {
    let evenly = || {
        let period_ns = Stamp::from_s(nominal_s).ns;
        (0..times_ns.len() as u64)
            .map(|i| Stamp::from_ns(i.saturating_mul(period_ns)))
            .collect()
    };
    let mut steps_ns: Vec<u64> = times_ns
        .windows(2)
        .filter_map(|pair| pair[1]?.checked_sub(pair[0]?))
        .filter(|step_ns| *step_ns > 0)
        .collect();
    steps_ns.sort_unstable();
    let Some(&usual_ns) = steps_ns.get(steps_ns.len() / 2) else {
        if times_ns.len() > 1 {
            warnings.add("times missing", || {
                format!(
                    "there are no usable times: the nominal {:.1} frames a second are taken",
                    1.0 / nominal_s
                )
            });
        }
        return (evenly(), nominal_s);
    };
    if usual_ns < SHORTEST_PERIOD_NS {
        warnings.add("times useless", || {
            format!(
                "times are {:.1} ms apart, which no camera of such a vehicle does (converted data?): \
                 the nominal {:.1} frames a second are taken",
                usual_ns as f64 * 1e-6,
                1.0 / nominal_s
            )
        });
        return (evenly(), nominal_s);
    }
    let mut stamps = Vec::with_capacity(times_ns.len());
    let mut now = Stamp::default();
    let mut previous: Option<u64> = None;
    for (i, time) in times_ns.iter().enumerate() {
        let step_ns = match (previous, time) {
            _ if i == 0 => 0,
            (Some(before), Some(time)) if *time > before => time - before,
            _ => {
                warnings.add("times that do not increase", || {
                    format!(
                        "record {i}: its time is missing or does not increase: {:.3} s are taken",
                        usual_ns as f64 * 1e-9
                    )
                });
                usual_ns
            }
        };
        now.ns = now.ns.saturating_add(step_ns);
        previous = time.or(previous);
        stamps.push(now);
    }
    (stamps, usual_ns as f64 * 1e-9)
}

/// Gives the body's cameras the size of the pictures that were recorded with them.
fn fit_cameras(body: &mut Body, steps: &[Step], warnings: &mut Warnings) {
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

/// The header of an imported recording. The scenario says where it came from ([`RecordingHeader::origin`]).
fn header(format: &str, source: &str, body: Body, driver: &str) -> RecordingHeader {
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

/// An event of this beginning names who drove where it was not a person alone (Donkeycar's `user/mode`).
pub(crate) const MODE: &str = "mode ";

/// Who drove: a person, unless the records say otherwise.
fn driver_of(steps: &[Step]) -> &'static str {
    let by_itself = |step: &&Step| {
        step.explanation
            .events
            .iter()
            .any(|event| event.starts_with(MODE))
    };
    match steps.iter().filter(by_itself).count() {
        0 => "human",
        count if count == steps.len() => "autopilot",
        _ => "human and autopilot",
    }
}

/// A basic TOML string: its escapes are those of JSON.
fn toml_string(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stamps (ms), period (s) and number of warnings for times (ms).
    fn check(times_ms: &[Option<u64>]) -> (Vec<u64>, f64, usize) {
        let mut warnings = Warnings::default();
        let times_ns: Vec<_> = times_ms
            .iter()
            .map(|time| time.map(|ms| ms * 1_000_000))
            .collect();
        let (stamps, period) = stamps(&times_ns, 0.05, &mut warnings);
        let stamps_ms = stamps.iter().map(|stamp| stamp.ns / 1_000_000).collect();
        (stamps_ms, period, warnings.finish().len())
    }

    #[test]
    fn real_times_are_kept_and_converted_ones_replaced() {
        assert_eq!(
            check(&[Some(10_000), Some(10_100), Some(10_300)]),
            (vec![0, 100, 300], 0.2, 0)
        );
        assert_eq!(
            check(&[Some(10_000), Some(10_002), Some(10_005)]),
            (vec![0, 50, 100], 0.05, 1)
        );
    }

    #[test]
    fn only_imported_recordings_have_an_origin() {
        let body = Body {
            name: "car".into(),
            steering: senda_core::Steering::Differential { track_m: 0.1 },
            width_m: 0.1,
            length_m: 0.2,
            speed_limit_mps: 1.0,
            yaw_rate_limit_radps: 3.0,
            period_s: 0.05,
            encoders: None,
            cameras: vec![],
        };
        let imported = header("tub", "a \"tub\" = [x]", body, "human");
        let origin = imported.origin().unwrap();
        assert_eq!(
            (origin.format.as_str(), origin.source.as_str()),
            ("tub", "a \"tub\" = [x]")
        );
        for scenario in ["", "world = \"oval\"", "import = 3", "[import"] {
            let own = RecordingHeader {
                scenario: scenario.into(),
                ..imported.clone()
            };
            assert_eq!(own.origin(), None, "{scenario}");
        }
    }

    #[test]
    fn times_that_jump_back_never_make_stamps_decrease() {
        let (stamps, _, warned) = check(&[Some(10_000), Some(10_100), None, Some(3_000), Some(3_100)]);
        assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]), "{stamps:?}");
        assert_eq!(warned, 2);
    }

    #[test]
    fn nothing_and_one_are_fine() {
        assert_eq!(check(&[]), (vec![], 0.05, 0));
        assert_eq!(check(&[Some(5)]), (vec![0], 0.05, 0));
    }
}
