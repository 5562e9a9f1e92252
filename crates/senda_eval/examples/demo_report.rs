//! Writes reports of made-up drives, to look at what readers will see without a simulator:
//! `cargo run --release -p senda_eval --example demo_report -- FOLDER` gives runs.html, sweep.html, study.html and
//! real.html in that folder.

use senda_core::codec::encode_jpeg;
use senda_core::{Body, Channels, Command, Explanation, Image, Stamp, Truth};
use senda_data::{EncodedFrame, Recording, RecordingHeader, Step};
use senda_eval::metrics::Course;
use senda_eval::report::{self, Page, ReportRun, StudyTrace, SweepRun};
use senda_eval::{Agreement, Summary, agreement};
use senda_geom::{Pose2, Tracker, Vec2, trig};
use senda_world::{VehicleSpec, World};
use std::path::PathBuf;

const LANE: &str = r#"
name = "made-up lane"
lane_width_m = 0.28
[path]
closed = true
points = [[0, 0], [1.6, -0.3], [2.9, 0.2], [3.0, 1.5], [2.0, 1.75], [1.35, 1.2], [0.4, 1.9], [-0.6, 1.1]]
[[markings]]
side = "left"
width_m = 0.02
colour = "white"
dash = { length_m = 0.1, gap_m = 0.06 }
[[markings]]
side = "right"
width_m = 0.02
colour = "white"
[floor]
kind = "plain"
colour = "grey"
"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("expected a folder to write to")?);
    let body = VehicleSpec::named("gopigo")?.body();
    let oval = World::named("oval")?;
    let lane = World::parse("made-up lane", LANE)?.0;
    let runs = [
        made_up(&oval, &body, "line", [0.6, 0.13, 0.0, 1.0], 1),
        made_up(&oval, &body, "line", [1.2, 0.16, 0.0, 2.0], 2),
        made_up(&lane, &body, "lane", [0.8, 0.16, 0.0, 1.0], 3),
        made_up(&lane, &body, "lane", [1.6, 0.2, 1.0, 1.0], 4),
    ];
    let worlds = [&oval, &oval, &lane, &lane];
    let summaries: Vec<Summary> = runs
        .iter()
        .zip(worlds)
        .enumerate()
        .map(|(i, (run, world))| {
            let laps = if i == 1 { 2.0 } else { 1.0 };
            Summary {
                world: world.name.clone(),
                floor: ["plain", "speckled", "wood", "glossy"][i].into(),
                light: ["daylight", "lamp", "daylight", "lamp"][i].into(),
                speed_mps: Some([0.13, 0.16, 0.16, 0.2][i]),
                ..Summary::from_recording(run, Some(&Course::of(world, Some(laps))))
            }
        })
        .collect();
    let times: Vec<Vec<f64>> = runs
        .iter()
        .map(|run| {
            (0..run.steps.len())
                .map(|i| 1e-3 + 1e-4 * noise(i as u64))
                .collect()
        })
        .collect();
    let shown: Vec<ReportRun> = (0..runs.len())
        .map(|i| ReportRun {
            title: "",
            summary: &summaries[i],
            recording: &runs[i],
            world: Some(worlds[i]),
            course: None,
            command: "senda drive --world oval --vehicle gopigo --driver line --laps 1 --seed 1",
            frame_times_s: &times[i],
            look: None,
        })
        .collect();
    let page = Page {
        subtitle:
            "Made-up drives that show what a report looks like: two drivers, two circuits, four floors."
                .into(),
        commit: "0123abc".into(),
        ..Page::new(
            "Line and lane around two circuits",
            "senda tour --report tour.html",
        )
    };
    std::fs::write(folder.join("runs.html"), report::html(&page, &shown))?;
    std::fs::write(
        folder.join("sweep.html"),
        report::sweep_html(
            &Page::new("Sweep of made-up runs", "senda sweep"),
            &sweep(&summaries),
        ),
    )?;
    std::fs::write(
        folder.join("study.html"),
        report::study_html(
            &Page::new("Follow controller: constants compared", "senda study follow"),
            &study(),
        ),
    )?;
    let (human, driven) = as_real(&runs[2]);
    let _: Agreement = agreement::of_recordings(&human, &driven);
    std::fs::write(
        folder.join("real.html"),
        report::real_data_html(
            &Page::new("Lane driver over recorded frames", "senda replay tub"),
            &human,
            &driven,
            &[],
        ),
    )?;
    Ok(())
}

/// Scatter in -1..1 that is the same everywhere (SplitMix64).
fn noise(i: u64) -> f64 {
    let mut z = i.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// A drive by a simple rule. `[disturbance, speed, whether it leaves, laps]`.
fn made_up(
    world: &World,
    body: &Body,
    driver: &str,
    [disturbance, speed_mps, leaves, laps]: [f64; 4],
    seed: u64,
) -> Recording {
    let path = &world.path;
    let length_m = path.length_m();
    let mut pose = path.pose_at(world.start_station_m);
    let mut tracker = Tracker::new(world.start_station_m);
    let mut steps = Vec::new();
    let camera = body.cameras[0].resized(160, 120);
    for i in 0.. {
        let time_s = 0.05 * f64::from(i);
        let place = tracker.advance(path, pose.position());
        let road = path.pose_at(place.station_m);
        let theta_rad = senda_geom::angle::difference(road.heading_rad, pose.heading_rad);
        let d_m = -place.offset_m + 0.002 * noise(seed * 7919 + i as u64);
        let gone = leaves > 0.0 && tracker.travelled_m() > 0.57 * length_m;
        let found = if gone && i % 3 != 0 { 0.0 } else { 1.0 };
        let push =
            disturbance * (0.3 * trig::sin(0.9 * time_s) + 0.2 * trig::sin(2.3 * time_s + seed as f64));
        let desired_rad = trig::atan2(d_m, 0.25);
        let omega = if gone {
            0.1
        } else {
            2.0 * (theta_rad + desired_rad) + speed_mps * path.curvature_at(place.station_m) + push
        };
        let speed_now = speed_mps
            * (1.0 - 0.2 * (path.curvature_at(place.station_m).abs() / 2.0).min(1.0))
            * (time_s / 0.5).min(1.0);
        let mut explanation = Explanation::default();
        explanation.signal("mean", 9.0 + noise(i as u64));
        explanation.signal("max", 140.0 + 20.0 * noise(i as u64 + 99));
        explanation.signal("threshold", 22.8 + 2.0 * noise(i as u64 + 99));
        explanation.signal("desired_angle_rad", -desired_rad);
        explanation.signal("omega_radps", omega);
        explanation.signal("left_mps", speed_mps - 0.055 * omega);
        explanation.signal("right_mps", speed_mps + 0.055 * omega);
        explanation.signal("d_m", if found > 0.0 { d_m } else { f64::NAN });
        explanation.signal("theta_rad", if found > 0.0 { theta_rad } else { f64::NAN });
        explanation.signal("found", found);
        if gone && i % 40 == 1 {
            explanation.event("lane lost");
        }
        let mut image = Image::new(160, 120, Channels::Rgb);
        let mut line: Vec<[f32; 2]> = Vec::new();
        // Blocks of 2x2 px of every third frame: quick enough for a look.
        for v in (0..120).step_by(2).filter(|_| i % 3 == 0) {
            for u in (0..160).step_by(2) {
                let pixel = Vec2::new(f64::from(u) + 1.0, f64::from(v) + 1.0);
                let grain = (10.0 * noise((u + 160 * v) as u64 + 31 * i as u64)) as i32;
                let mut colour = [150, 165, 185];
                if let Some(floor) = camera.floor_from_pixel(pixel) {
                    let world_point = pose.transform(floor);
                    let place = path.project_near(world_point, place.station_m, 0.9);
                    colour = [186, 178, 165];
                    for marking in &world.markings {
                        if (place.offset_m - marking.offset_m).abs() < 0.5 * marking.width_m
                            && marking.covers(place.station_m)
                        {
                            colour = marking.colour.rgb.map(i32::from);
                        }
                    }
                }
                let rgb = colour.map(|part| (part + grain).clamp(0, 255) as u8);
                for (du, dv) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let at = 3 * ((u + du) + 160 * (v + dv)) as usize;
                    image.pixels_mut()[at..at + 3].copy_from_slice(&rgb);
                }
            }
        }
        for ahead in 0..30 {
            let point = path
                .pose_at(place.station_m + 0.08 + 0.015 * f64::from(ahead))
                .position();
            if let Some(pixel) = camera.pixel_from_floor(pose.inverse().transform(point)) {
                line.push([pixel.x as f32, pixel.y as f32]);
            }
        }
        if found > 0.0 {
            explanation.polyline(line.clone(), "#ff3b6b", false);
            if let Some(at) = line.get(8) {
                explanation.circle(*at, 5.0, "#ffd23b");
                explanation.text([at[0] + 7.0, at[1]], "d", "#ffd23b");
            }
        }
        let stamp = Stamp::from_s(time_s);
        let encoded = encode_jpeg(&image, 80).expect("160x120 is a size that JPEG holds");
        let frame = EncodedFrame {
            camera: "center".into(),
            stamp,
            encoded,
        };
        steps.push(Step {
            stamp,
            frames: if i % 3 == 0 { vec![frame] } else { vec![] },
            speed_mps: None,
            wheels: None,
            battery_v: None,
            command: Command::yaw_rate(omega, speed_mps),
            truth: Some(Truth {
                stamp,
                world_from_vehicle: pose,
                speed_mps: speed_now,
                yaw_rate_radps: omega,
                ..Truth::default()
            }),
            explanation,
        });
        if tracker.travelled_m() >= laps * length_m || place.offset_m.abs() > 0.4 || time_s > 200.0 {
            break;
        }
        pose = pose.advance(speed_now, omega, 0.05);
        let _: Pose2 = pose;
    }
    Recording {
        header: RecordingHeader {
            senda: "0.1.0".into(),
            commit: "0123abc".into(),
            scenario: format!(
                "world = \"{}\"\ndriver = \"{driver}\"\nseed = {seed}\n",
                world.name
            ),
            world: Some(world.to_toml()),
            reversed: false,
            body: body.clone(),
            driver: driver.into(),
            seed,
        },
        steps,
        summary: None,
        lost: vec![],
        warnings: vec![],
    }
}

fn sweep(examples: &[Summary]) -> Vec<SweepRun> {
    let mut runs = Vec::new();
    for i in 0..600u64 {
        let base = &examples[(i % 3) as usize];
        let speed = [0.10, 0.13, 0.16, 0.20][(i / 3 % 4) as usize];
        let bad = noise(i * 31) > 1.0 - 12.0 * (speed - 0.08) * (speed - 0.08);
        let summary = Summary {
            seed: i,
            floor: ["plain", "speckled", "wood", "tiles", "carpet", "glossy"][(i / 12 % 6) as usize].into(),
            light: ["daylight", "lamp", "dim"][(i / 72 % 3) as usize].into(),
            speed_mps: Some(speed),
            lost: u32::from(bad),
            lane_error_mean_m: base.lane_error_mean_m.map(|e| e * (1.0 + 0.3 * noise(i))),
            completed: !bad || i % 2 == 0,
            departures: u32::from(bad && i % 2 == 1),
            first_departure_percent: Some(43.0),
            ..base.clone()
        };
        runs.push(SweepRun {
            world: base.world.clone(),
            line_colour: String::new(),
            command: format!(
                "senda drive --world {} --driver {} --speed {speed} --seed {i}",
                base.world, base.driver
            ),
            summary: Some(summary),
            error: String::new(),
            latency_s: 0.0,
            image_px: None,
            tightest_m: None,
        });
    }
    runs
}

fn study() -> Vec<StudyTrace> {
    let mut traces = Vec::new();
    for (group, d0, theta0) in [
        ("from −21.5 cm, 44.6°", -0.215, 0.778),
        ("from 4 cm, 12°", 0.04, 0.21),
    ] {
        for kp in [0.5, 0.9, 1.1, 1.3, 2.5] {
            let mut trace = StudyTrace {
                group: group.into(),
                label: format!("Kp {kp}, L 40 cm"),
                verdict: if kp < 2.0 {
                    "converges".into()
                } else {
                    "oscillates".into()
                },
                good: kp < 2.0,
                settled_d_m: 0.01,
                settled_theta_rad: 2f64.to_radians(),
                settle_time_s: (kp < 2.0).then_some(9.3 / kp),
                ..StudyTrace::default()
            };
            let (mut d, mut theta) = (d0, theta0);
            let mut queue = [0.0; 10];
            for i in 0..600 {
                let omega = kp * (theta + trig::atan2(d, 0.4));
                queue.rotate_left(1);
                queue[9] = omega;
                trace.time_s.push(0.05 * f64::from(i));
                trace.d_m.push(d);
                trace.theta_rad.push(theta);
                trace.omega_radps.push(omega);
                theta -= 0.05 * queue[0];
                d += 0.05 * 0.07 * trig::sin(theta);
            }
            traces.push(trace);
        }
    }
    traces
}

/// The same frames as if a human had driven and nobody knew where.
fn as_real(run: &Recording) -> (Recording, Recording) {
    let mut driven = run.clone();
    driven.header.world = None;
    for step in &mut driven.steps {
        step.truth = None;
    }
    let mut human = driven.clone();
    let mut held = 0.0;
    for (i, step) in human.steps.iter_mut().enumerate() {
        if let senda_core::Turn::YawRateRadps(rate) = step.command.turn {
            held = if i % 7 == 0 {
                rate + 0.05 * noise(i as u64)
            } else {
                held
            };
            step.command = Command::yaw_rate(held + 0.04, 0.16);
        }
        step.explanation.clear();
    }
    (human, driven)
}
