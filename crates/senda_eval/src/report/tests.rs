//! Reports as a reader's browser gets them.

use super::*;
use crate::Summary;
use crate::metrics::Course;
use senda_core::codec::{encode_jpeg, encode_png};
use senda_core::{Body, Channels, Command, Drive, Explanation, Stamp, Steering, Truth};
use senda_data::{EncodedFrame, Recording, RecordingHeader, Step};
use senda_geom::Pose2;
use senda_world::World;
use serde_json::Value;

const HOSTILE: &str = "</script><script>alert(1)</script><img src=x onerror=alert(2)>'\"&\u{1b}[2J{{ 7*7 }}";

fn body() -> Body {
    Body {
        name: "gopigo".into(),
        steering: Steering::Differential { track_m: 0.11 },
        width_m: 0.14,
        length_m: 0.2,
        speed_limit_mps: 0.5,
        yaw_rate_limit_radps: 5.0,
        period_s: 0.05,
        encoders: None,
        cameras: vec![],
    }
}

fn world() -> World {
    world_along("points = [[0, 0], [2, 0]]")
}

/// A world of one line along a path.
fn world_along(path: &str) -> World {
    let text = format!("name = \"test\"\n[path]\n{path}\n[[markings]]\nwidth_m = 0.02\ncolour = \"black\"\n");
    World::parse("test.toml", &text).unwrap().0
}

/// A drive along the test world with a picture in every step.
fn recording(steps: usize, name: &str, lossless: bool) -> Recording {
    let mut picture = Image::new(32, 24, Channels::Rgb);
    let step = |i: usize| {
        for (place, byte) in picture.pixels_mut().iter_mut().enumerate() {
            *byte = ((place * 37 + i * 11) % 251) as u8;
        }
        let encoded = if lossless {
            encode_png(&picture)
        } else {
            encode_jpeg(&picture, 90)
        }
        .unwrap();
        let stamp = Stamp::from_s(0.1 * i as f64);
        let mut explanation = Explanation::default();
        explanation.signal("found", if i % 10 == 9 { 0.0 } else { 1.0 });
        explanation.signal("d_m", if i % 10 == 9 { f64::NAN } else { 0.01 });
        explanation.signal(name, 1.0);
        explanation.polyline([[1.0, 2.0], [3.0, 9.0]], name, false);
        explanation.text([4.0, 5.0], name, "red");
        if i == 3 {
            explanation.event(name);
        }
        let x_m = 2.0 * i as f64 / (steps.max(2) - 1) as f64;
        Step {
            stamp,
            frames: vec![EncodedFrame {
                camera: "center".into(),
                stamp,
                encoded,
            }],
            speed_mps: None,
            wheels: None,
            battery_v: None,
            command: Command::yaw_rate(0.1, 0.13),
            truth: Some(Truth {
                stamp,
                world_from_vehicle: Pose2::new(x_m, 0.03, 0.0),
                ..Truth::default()
            }),
            explanation,
        }
    };
    Recording {
        header: RecordingHeader {
            senda: "0.1.0".into(),
            commit: String::new(),
            scenario: name.into(),
            world: Some(name.into()),
            reversed: false,
            body: body(),
            driver: name.into(),
            seed: 7,
        },
        steps: (0..steps).map(step).collect(),
        summary: None,
        lost: vec![],
        warnings: vec![name.into()],
    }
}

fn summary(recording: &Recording, world: &World, name: &str) -> Summary {
    let course = Course::of(world, Some(1.0));
    Summary {
        world: name.into(),
        floor: name.into(),
        light: name.into(),
        ..Summary::from_recording(recording, Some(&course))
    }
}

fn run<'a>(recording: &'a Recording, summary: &'a Summary, world: Option<&'a World>) -> ReportRun<'a> {
    ReportRun {
        title: "",
        summary,
        recording,
        world,
        course: None,
        command: HOSTILE,
        frame_times_s: &[],
        look: None,
    }
}

/// Every element is closed in order, attributes are quoted: what a strict reader asks of a page.
fn assert_well_formed(page: &str) {
    let mut open: Vec<String> = Vec::new();
    let mut rest = page;
    while let Some(begin) = rest.find('<') {
        rest = &rest[begin..];
        if rest.starts_with("<!") {
            rest = &rest[rest.find('>').unwrap()..];
            continue;
        }
        let mut quoted = false;
        let end = rest
            .char_indices()
            .find(|(_, c)| {
                quoted ^= *c == '"';
                *c == '>' && !quoted
            })
            .unwrap_or_else(|| panic!("unclosed tag: {}", &rest[..80.min(rest.len())]))
            .0;
        let tag = &rest[1..end];
        rest = &rest[end + 1..];
        let name: String = tag
            .trim_start_matches('/')
            .chars()
            .take_while(|c| c.is_ascii_alphanumeric())
            .collect();
        assert!(
            !name.is_empty(),
            "a bare < before {}",
            &rest[..60.min(rest.len())]
        );
        if tag.starts_with('/') {
            assert_eq!(
                open.pop().as_deref(),
                Some(name.as_str()),
                "before {}",
                &rest[..60.min(rest.len())]
            );
        } else if tag.ends_with('/') || ["meta", "input", "br", "img", "link"].contains(&name.as_str()) {
        } else if name == "script" || name == "style" {
            rest = &rest[rest.find(&format!("</{name}>")).unwrap() + name.len() + 3..];
        } else {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "left open: {open:?}");
}

/// The data of the page's runs.
fn data(page: &str) -> Vec<Value> {
    page.split("<script type=\"application/json\" class=\"data\">")
        .skip(1)
        .map(|rest| serde_json::from_str(&rest[..rest.find("</script>").unwrap()]).unwrap())
        .collect()
}

#[test]
fn a_page_holds_every_frame_as_recorded_and_is_the_same_every_time() {
    let (recording, world) = (recording(30, "line", false), world());
    let summary = summary(&recording, &world, "test");
    let make = || {
        html(
            &Page::new("Test", "senda drive"),
            &[run(&recording, &summary, Some(&world))],
        )
    };
    let page = make();
    assert_eq!(page, make());
    assert_well_formed(&page);
    for step in &recording.steps {
        assert!(page.contains(&STANDARD.encode(&step.frames[0].encoded.bytes)));
    }
    let data = &data(&page)[0];
    assert_eq!(data["frames"].as_array().unwrap().len(), 30);
    assert_eq!(data["t"].as_array().unwrap().len(), 30);
    assert_eq!(data["columns"]["offset"]["values"][5], 3);
    assert_eq!(data["columns"]["signal d_m"]["values"][9], Value::Null);
    assert!(page.contains("completed") && page.contains("Lane error") && page.contains("sp-vehicle"));
}

/// Empty plots were shown, and two were called "Speed".
#[test]
fn every_plot_shows_something_and_has_a_name_of_its_own() {
    let (mut recording, world) = (recording(30, "line", false), world());
    for (i, step) in recording.steps.iter_mut().enumerate() {
        let explanation = &mut step.explanation;
        explanation.signals.retain(|signal| signal.name != "d_m");
        for name in ["d_m", "mean", "max", "threshold", "strange"] {
            explanation.signal(name, f64::NAN);
        }
        explanation.signal("speed_mps", 0.1 + 0.001 * i as f64);
    }
    let summary = summary(&recording, &world, "test");
    for world in [Some(&world), None] {
        let shown = run(&recording, &summary, world);
        let course = world.map(|world| Course::of(world, Some(1.0)));
        let columns = super::columns::columns(&shown, course.as_ref());
        let mut titles: Vec<String> = super::plots::groups(&columns)
            .into_iter()
            .flat_map(|group| group.figures)
            .map(|figure| figure.title)
            .collect();
        for absent in ["Distance d", "Line filter", "Strange"] {
            assert!(!titles.iter().any(|title| title == absent), "{titles:?}");
        }
        for present in ["Speed", "Speed, as the driver has it"] {
            assert!(titles.iter().any(|title| title == present), "{titles:?}");
        }
        let count = titles.len();
        titles.sort();
        titles.dedup();
        assert_eq!(titles.len(), count, "{titles:?}");
    }
}

/// Cards told of 12 cm lane error and "never outside" where 5 % of the road had been driven, all of it in the middle.
#[test]
fn cards_of_an_unfinished_run_tell_the_undriven_road_apart() {
    let (recording, world) = (recording(10, "x", true), world());
    let card = |completed: bool| {
        let summary = Summary {
            completed,
            ..summary(&recording, &world, "x")
        };
        html(&Page::default(), &[run(&recording, &summary, Some(&world))])
    };
    let words = [
        "undriven road counts as outside",
        "where it drove",
        "never as far as it drove",
    ];
    for word in words {
        assert!(card(false).contains(word), "{word}");
    }
    // The list of all figures has its own words.
    for word in ["Lane error where it drove", "never as far as it drove"] {
        assert!(!card(true).contains(word), "{word}");
    }
}

#[test]
fn nothing_is_loaded_from_anywhere() {
    let (recording, world) = (recording(5, "line", false), world());
    let summary = summary(&recording, &world, "test");
    let page = html(&Page::default(), &[run(&recording, &summary, Some(&world))]);
    let namespace = "http://www.w3.org/2000/svg";
    assert!(!page.replace(namespace, "").contains("://"));
    assert!(page.contains("default-src 'none'"));
    // The only script that may run is the page's own: its hash must be that of the bytes in the page.
    let begin = page.rfind("<script>").unwrap() + "<script>".len();
    let script = &page[begin..page.rfind("</script>").unwrap()];
    use sha2::Digest;
    let hash = STANDARD.encode(sha2::Sha256::digest(script));
    assert!(page.contains(&format!("script-src 'sha256-{hash}'")));
}

#[test]
fn hostile_names_stay_text_everywhere() {
    let (recording, mut world) = (recording(12, HOSTILE, false), world());
    world.name = HOSTILE.into();
    let summary = summary(&recording, &world, HOSTILE);
    let page = Page {
        title: HOSTILE.into(),
        subtitle: HOSTILE.into(),
        commit: HOSTILE.into(),
        facts: vec![(HOSTILE.into(), HOSTILE.into())],
        notes: vec![HOSTILE.into()],
        ..Page::new(HOSTILE, HOSTILE)
    };
    let shown = run(&recording, &summary, Some(&world));
    let sweep = [
        SweepRun {
            world: HOSTILE.into(),
            line_colour: HOSTILE.into(),
            summary: Some(summary.clone()),
            error: String::new(),
            command: HOSTILE.into(),
            latency_s: 0.0,
            image_px: None,
            tightest_m: None,
        },
        SweepRun {
            world: HOSTILE.into(),
            line_colour: HOSTILE.into(),
            summary: None,
            error: HOSTILE.into(),
            command: HOSTILE.into(),
            latency_s: 0.0,
            image_px: None,
            tightest_m: None,
        },
    ];
    let study = [StudyTrace {
        group: HOSTILE.into(),
        label: HOSTILE.into(),
        verdict: HOSTILE.into(),
        time_s: vec![0.0, 1.0],
        d_m: vec![0.1, 0.0],
        ..StudyTrace::default()
    }];
    for page in [
        html(&page, &[shown, shown]),
        sweep_html(&page, &sweep),
        study_html(&page, &study),
        real_data_html(&page, &recording, &recording, &[]),
    ] {
        assert_well_formed(&page);
        assert!(!page.contains("<img") && !page.contains("<script>alert") && !page.contains('\u{1b}'));
        // Templates in names are not evaluated.
        assert!(page.contains("{{ 7*7 }}"));
        for data in data(&page) {
            assert_eq!(data["frames"][0]["shapes"][0][1], "magenta");
        }
    }
}

#[test]
fn frames_are_thinned_to_the_budget() {
    for lossless in [false, true] {
        let (recording, world) = (recording(200, "line", lossless), world());
        let summary = summary(&recording, &world, "test");
        let budget = 60_000;
        let page = Page {
            frame_budget_bytes: 2 * budget,
            ..Page::default()
        };
        let shown = run(&recording, &summary, Some(&world));
        let page = html(&page, &[shown, shown]);
        for data in data(&page) {
            let frames = data["frames"].as_array().unwrap();
            let bytes: usize = frames
                .iter()
                .map(|frame| frame["src"].as_str().unwrap().len())
                .sum();
            assert!(bytes < budget + budget / 5, "{bytes}");
            assert!(frames.len() >= 10, "{}", frames.len());
            let steps: Vec<u64> = frames
                .iter()
                .map(|frame| frame["step"].as_u64().unwrap())
                .collect();
            let apart: Vec<u64> = steps.windows(2).map(|w| w[1] - w[0]).collect();
            assert!(apart.iter().all(|gap| *gap == apart[0]), "even: {apart:?}");
            assert!(steps[steps.len() - 1] + apart[0] >= 190, "to the end: {steps:?}");
        }
    }
}

#[test]
fn poor_recordings_still_make_a_page() {
    let world = world();
    let mut no_truth = recording(4, "line", false);
    let mut no_frames = recording(4, "line", false);
    let mut damaged = recording(4, "line", false);
    for i in 0..4 {
        no_truth.steps[i].truth = None;
        no_frames.steps[i].frames.clear();
        damaged.steps[i].frames[0].encoded.bytes.truncate(20);
    }
    damaged.steps[2].stamp = Stamp::default();
    for recording in [
        recording(0, "line", false),
        recording(1, "line", false),
        no_truth,
        no_frames,
        damaged,
    ] {
        let summary = Summary::from_recording(&recording, Some(&Course::of(&world, None)));
        for world in [None, Some(&world)] {
            let page = html(&Page::default(), &[run(&recording, &summary, world)]);
            assert_well_formed(&page);
            assert_eq!(data(&page).len(), 1);
        }
        assert_well_formed(&real_data_html(&Page::default(), &recording, &recording, &[]));
    }
    for page in [
        html(&Page::default(), &[]),
        sweep_html(&Page::default(), &[]),
        study_html(&Page::default(), &[]),
    ] {
        assert_well_formed(&page);
    }
}

#[test]
fn a_sweep_of_deliveries_tells_of_packages_and_not_of_lanes() {
    let (recording, world) = (recording(30, "line", false), world());
    let of = |completed: bool| SweepRun {
        world: "warehouse".into(),
        summary: Some(Summary {
            completed,
            delivery: Some(crate::Delivery {
                correct: completed,
                returned: true,
                events: vec![crate::delivery::Event {
                    time_s: 3.0,
                    text: "search -> failed: no sign was found".into(),
                }],
                ..crate::Delivery::default()
            }),
            ..summary(&recording, &world, "test")
        }),
        ..SweepRun::default()
    };
    let runs = [of(true), of(false)];
    let table = sweep_table(&runs);
    let row = &table.rows[0];
    assert_eq!((row.lane_error_m, row.heading_error_rad), (None, None));
    assert_eq!(row.delivery.as_ref().unwrap().correct.hits, 1);
    let html = sweep_html(&Page::new("deliveries", "senda sweep"), &runs);
    for words in ["Whole deliveries", "red lights passed", "no sign was found"] {
        assert!(html.contains(words), "{words}");
    }
    assert!(!html.contains("Lane error") && !html.contains("without a loss"));
}

#[test]
fn a_sweep_counts_by_property_and_tells_how_to_repeat_failures() {
    let (recording, world) = (recording(30, "line", false), world());
    let good = summary(&recording, &world, "test");
    let runs: Vec<SweepRun> = (0..40)
        .map(|i| SweepRun {
            world: "test".into(),
            line_colour: if i % 5 == 0 { "pink" } else { "white" }.into(),
            image_px: Some(if i % 2 == 0 { [160, 120] } else { [123, 92] }),
            tightest_m: (i % 4 > 0).then_some(0.3 + 0.1 * (i % 4) as f64),
            summary: Some(Summary {
                seed: i,
                floor: if i % 2 == 0 {
                    "plain".into()
                } else {
                    "glossy".into()
                },
                light: if i % 4 < 2 {
                    "lamp".into()
                } else {
                    "daylight".into()
                },
                speed_mps: Some(if i < 20 { 0.13 } else { 0.16 }),
                lost: u32::from(i == 21),
                ..good.clone()
            }),
            error: String::new(),
            command: format!("senda drive --seed {i}"),
            latency_s: if i % 10 == 0 { 0.1 } else { 0.0 },
        })
        .collect();
    let table = sweep_table(&runs);
    let by_latency: Vec<&str> = table
        .rows
        .iter()
        .filter(|row| row.by == "latency")
        .map(|row| row.value.as_str())
        .collect();
    assert_eq!(by_latency, ["0 ms", "100 ms"]);
    let counts = |by: &str| -> Vec<(&str, u64)> {
        let rows = table.rows.iter().filter(|row| row.by == by);
        rows.map(|row| (row.value.as_str(), row.completed.count))
            .collect()
    };
    assert_eq!(counts("line"), [("pink", 8), ("white", 32)]);
    assert_eq!(counts("image"), [("123x92", 20), ("160x120", 20)]);
    assert_eq!(
        counts("curves"),
        [
            ("radius 0.25 to 0.5 m", 10),
            ("radius 0.5 to 1 m", 20),
            ("straight", 10)
        ]
    );
    let row = |by: &str, value: &str| {
        table
            .rows
            .iter()
            .find(|row| row.by == by && row.value == value)
            .unwrap()
    };
    assert_eq!(
        (
            row("all", "all runs").without_loss.hits,
            row("all", "all runs").completed.hits
        ),
        (39, 40)
    );
    assert_eq!(row("floor", "plain").without_loss.hits, 20);
    assert_eq!(row("floor", "glossy").without_loss.hits, 19);
    assert_eq!(row("speed", "16.0 cm/s").without_loss.hits, 19);
    assert!(
        table.rows.iter().all(|row| row.by != "world"),
        "one value is no comparison"
    );
    let page = sweep_html(&Page::default(), &runs);
    assert!(page.contains("senda drive --seed 21") && !page.contains("senda drive --seed 20<"));
    assert_eq!(page, sweep_html(&Page::default(), &runs));
    let back: SweepTable = serde_json::from_str(&serde_json::to_string(&table).unwrap()).unwrap();
    assert_eq!(back.rows.len(), table.rows.len());
}

#[test]
fn a_picture_with_shapes_is_a_file_of_its_own() {
    let image = Image::new(64, 48, Channels::Rgb);
    let mut explanation = Explanation::default();
    explanation.polyline([[1.0, 1.0], [5.0, 5.0], [1.0, 5.0]], "lime", true);
    explanation.circle([9.0, 9.0], 3.0, "url(https://example.com)");
    explanation.text([1.0, 9.0], HOSTILE, "red");
    let svg = picture_svg(&image, &encode_png(&image).unwrap(), &explanation.shapes);
    assert_well_formed(&svg);
    assert!(svg.contains("polygon") && !svg.contains("url(") && !svg.contains("<img"));
}

#[test]
fn the_time_of_each_frame_is_shown_on_foreign_data_too() {
    let recording = recording(20, "lane", false);
    let page = |times_s: &[f64]| real_data_html(&Page::default(), &recording, &recording, times_s);
    let timed = page(&[0.0042; 20]);
    assert!(timed.contains("Time spent") && timed.contains("4.2 ms"));
    let untimed = page(&[]);
    assert!(!untimed.contains("Time spent") && !untimed.contains("Time a frame"));
}

/// Frames that nobody drove on told of a distance, a speed and a true place.
#[test]
fn foreign_data_tell_no_figures_that_nobody_measured() {
    let mut recording = recording(20, "lane", false);
    for step in &mut recording.steps {
        step.truth = None;
    }
    let page = |recording: &Recording| real_data_html(&Page::default(), recording, recording, &[]);
    let told = page(&recording);
    for word in ["on average", "steering change:", "truly", "no true pose"] {
        assert!(!told.contains(word), "{word}");
    }
    assert!(told.contains("Distance d") && told.contains("recorded: 20 frames in 1.90 s"));
    for step in &mut recording.steps {
        step.speed_mps = Some(0.5);
    }
    assert!(
        page(&recording).contains("in 1.90 s, 50.0 cm/s on average"),
        "measured"
    );
}

#[test]
fn a_run_shows_its_hard_curves_and_pedals_where_it_has_them() {
    let mut recording = recording(20, "human", false);
    let page = |recording: &Recording, world: &World| {
        let summary = summary(recording, world, "test");
        html(&Page::default(), &[run(recording, &summary, Some(world))])
    };
    let pieces =
        "pieces = [{ kind = \"straight\", length_m = 2 }, { kind = \"arc\", radius_m = 0.5, turn_deg = 90 }]";
    let bent = world_along(pieces);
    let shown = page(&recording, &bent);
    assert_well_formed(&shown);
    assert!(shown.contains("Hard curve 1") && shown.contains("% of the lap: the driven path over"));
    assert!(!shown.contains(">Throttle<"), "it has no pedal");
    assert!(!page(&recording, &world()).contains("Hard curve"));
    for step in &mut recording.steps {
        step.command.drive = Drive::Throttle(0.25);
    }
    assert!(page(&recording, &bent).contains(">Throttle<"));
}
