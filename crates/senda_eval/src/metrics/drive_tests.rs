//! Trajectories whose figures are known in advance.

use super::*;
use crate::metrics::Course;
use proptest::prelude::*;
use senda_core::Stamp;
use senda_geom::{Curve, Pose2, Segment, Vec2};
use std::f64::consts::PI;

const HALF_WIDTH_M: f64 = 0.15;

fn circle() -> Curve {
    Curve::from_segments(Pose2::default(), &[Segment::arc(1.0, 2.0 * PI)], 0.01, true).unwrap()
}

fn straight(length_m: f64) -> Curve {
    Curve::from_points(&[Vec2::ZERO, Vec2::new(length_m, 0.0)], false).unwrap()
}

fn course(path: &Curve, laps: Option<f64>) -> Course<'_> {
    Course {
        path,
        corridor_half_width_m: HALF_WIDTH_M,
        start_station_m: 0.0,
        laps,
        open_end_m: 0.0,
    }
}

/// A drive given by station and offset, 20 frames a second, heading along the way.
fn drive(path: &Curve, places: impl IntoIterator<Item = (f64, f64)>) -> Vec<Truth> {
    let mut truths: Vec<Truth> = Vec::new();
    for (i, (station_m, offset_m)) in places.into_iter().enumerate() {
        let road = path.pose_at(station_m);
        let at = road.position() + road.left() * offset_m;
        let heading_rad = match truths.last().map(|t| at - t.world_from_vehicle.position()) {
            Some(moved) if moved.length() > 1e-9 => trig::atan2(moved.y, moved.x),
            _ => road.heading_rad,
        };
        truths.push(Truth {
            stamp: Stamp::from_ns(50_000_000 * i as u64),
            world_from_vehicle: Pose2::new(at.x, at.y, heading_rad),
            ..Truth::default()
        });
    }
    truths
}

/// Stations from 0 to `end_m` in `steps` equal steps.
fn stations(end_m: f64, steps: usize) -> impl Iterator<Item = f64> {
    (0..=steps).map(move |i| end_m * i as f64 / steps as f64)
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!(
        (found - expected).abs() <= tolerance,
        "expected {expected}, but found {found}"
    );
}

#[test]
fn a_circle_three_centimetres_off_has_three_centimetres_error() {
    let path = circle();
    let truths = drive(&path, stations(2.0 * PI, 400).map(|s| (s, 0.03)));
    let found = measure(&course(&path, Some(1.0)), &truths);
    let lane = found.lane_error.unwrap();
    for value in [
        lane.mean,
        lane.max,
        lane.mean_over_time,
        lane.mean_as_defined,
        lane.max_as_defined,
    ] {
        close(value, 0.03, 1e-7);
    }
    close(found.heading_error.unwrap().max, 0.0, 1e-6);
    assert!(found.completed && found.laps == 1 && found.departures == 0);
    assert_eq!(found.completion, Some(1.0));
    close(found.lap_times_s[0], 20.0, 0.05);
    // The chord polygon of a circle of radius 0.97.
    close(found.distance_m, 2.0 * PI * 0.97, 1e-3);
}

#[test]
fn a_sine_path_has_the_sines_slope_as_heading_error() {
    let path = straight(4.0);
    let (size, wave) = (0.02, 2.0 * PI);
    let truths = drive(
        &path,
        stations(4.0, 4000).map(|s| (s, size * trig::sin(wave * s))),
    );
    let found = measure(&course(&path, Some(1.0)), &truths).heading_error.unwrap();
    close(found.max, trig::atan(size * wave), 1e-3);
    // Mean of |atan(a cos)| for small a: 2a/π, less a third of the cube's mean.
    close(found.mean, 2.0 / PI * size * wave, 1e-3);
}

#[test]
fn signs_are_left_positive() {
    let path = straight(2.0);
    let rows = trace(
        &course(&path, None),
        &drive(&path, stations(1.0, 20).map(|s| (s, 0.1 * s))),
    );
    assert!(rows.offset_m[10] > 0.0 && rows.heading_error_rad[10] > 0.0);
}

#[test]
fn departures_are_counted_once_each_and_spoil_their_lap() {
    let path = circle();
    let offset = |s: f64| {
        if (1.0..1.4).contains(&s) || (8.0..8.2).contains(&s) {
            0.2
        } else {
            0.0
        }
    };
    let truths = drive(&path, stations(6.0 * PI, 1500).map(|s| (s, offset(s))));
    let found = measure(&course(&path, Some(3.0)), &truths);
    assert_eq!((found.departures, found.laps, found.completed), (2, 1, false));
    close(found.first_departure_percent.unwrap(), 100.0 / (2.0 * PI), 0.5);
    close(found.completion.unwrap(), 1.0 - 0.6 / (6.0 * PI), 3e-3);
    close(found.lane_error.unwrap().max, 0.2, 1e-6);
    close(found.heading_error.unwrap().mean_as_defined, 0.0, 0.02);
}

#[test]
fn wavering_at_the_border_is_one_departure() {
    let path = straight(2.0);
    let wavering = stations(2.0, 200)
        .enumerate()
        .map(|(i, s)| (s, HALF_WIDTH_M + if i % 2 == 0 { 0.001 } else { -0.001 }));
    assert_eq!(
        measure(&course(&path, None), &drive(&path, wavering)).departures,
        1
    );
}

#[test]
fn standing_still_does_not_improve_a_mean() {
    let path = circle();
    let offset = |s: f64| 0.03 + 0.05 * trig::sin(s).max(0.0);
    let moving: Vec<(f64, f64)> = stations(2.0 * PI, 400).map(|s| (s, offset(s))).collect();
    let mut resting = moving.clone();
    // Ten seconds at a good place.
    resting.splice(300..300, std::iter::repeat_n(moving[300], 200));
    let [moving, resting] =
        [moving, resting].map(|places| measure(&course(&path, Some(1.0)), &drive(&path, places)));
    let (a, b) = (moving.lane_error.unwrap(), resting.lane_error.unwrap());
    close(b.mean, a.mean, 1e-12);
    assert!(
        b.mean_as_defined < a.mean_as_defined,
        "the document's mean does improve"
    );
    assert!(resting.lap_times_s[0] > moving.lap_times_s[0] + 9.0);
}

#[test]
fn never_moving_costs_the_whole_road() {
    let path = circle();
    let truths = drive(&path, std::iter::repeat_n((0.0, 0.0), 100));
    let found = measure(&course(&path, Some(1.0)), &truths);
    close(found.lane_error.unwrap().mean, HALF_WIDTH_M, 1e-12);
    close(found.heading_error.unwrap().mean, PI / 2.0, 1e-12);
    assert_eq!(
        (found.completion, found.completed, found.laps),
        (Some(0.0), false, 0)
    );
    let no_goal = measure(&course(&path, None), &truths);
    close(no_goal.lane_error.unwrap().mean, 0.0, 1e-9);
    assert_eq!(no_goal.completion, None);
}

/// A start beyond an open path's end was a way of no length, completed by standing there.
#[test]
fn standing_at_the_end_completes_nothing() {
    let path = straight(2.0);
    let at_the_end = |driven_m: f64| {
        let places = stations(driven_m, 50).map(|s| (2.0 - driven_m + s, 0.0));
        measure(&course(&path, Some(1.0)), &drive(&path, places))
    };
    let standing = at_the_end(0.0);
    assert_eq!((standing.completed, standing.completion), (false, Some(0.0)));
    let driving = at_the_end(0.5);
    assert_eq!((driving.completed, driving.completion), (true, Some(1.0)));
}

#[test]
fn reversing_is_not_progress() {
    let path = circle();
    let there: Vec<(f64, f64)> = stations(2.0, 100).map(|s| (s, 0.01)).collect();
    let back: Vec<(f64, f64)> = there.iter().rev().copied().collect();
    let found = measure(
        &course(&path, Some(1.0)),
        &drive(&path, there.into_iter().chain(back)),
    );
    close(found.progress_m, 2.0, 1e-6);
    close(found.reversed_m, 2.0, 1e-6);
    close(found.completion.unwrap(), 2.0 / (2.0 * PI), 1e-6);
    assert!(found.heading_error.unwrap().max > 3.0);
    let backwards = drive(&path, stations(2.0 * PI, 400).map(|s| (-s, 0.0)));
    let found = measure(&course(&path, Some(1.0)), &backwards);
    assert_eq!((found.laps, found.progress_m, found.completed), (0, 0.0, false));
}

#[test]
fn laps_wrap_around_from_any_start() {
    let path = circle();
    let begin_m = 5.0;
    let truths = drive(&path, stations(4.0 * PI, 800).map(|s| (begin_m + s, -0.02)));
    let yardstick = Course {
        start_station_m: begin_m,
        ..course(&path, Some(2.0))
    };
    let found = measure(&yardstick, &truths);
    assert_eq!((found.laps, found.completed), (2, true));
    close(found.lap_times_s[0], found.lap_times_s[1], 0.06);
    let rows = trace(&yardstick, &truths);
    close(rows.percent[0], 0.0, 1e-6);
    close(rows.percent[200], 50.0, 0.1);
    assert!(rows.percent.iter().all(|p| (0.0..=100.0).contains(p)));
}

#[test]
fn what_follows_the_goal_counts_nowhere() {
    let path = straight(1.0);
    let places = stations(1.0, 50)
        .map(|s| (s, 0.0))
        .chain((0..50).map(|i| (1.0, 0.02 * f64::from(i))));
    let found = measure(&course(&path, Some(1.0)), &drive(&path, places));
    assert!(found.completed && found.laps == 1 && found.departures == 0);
    close(found.lane_error.unwrap().max, 0.0, 1e-9);
    assert!(found.frames <= 51);
}

#[test]
fn a_run_that_ends_outside_owes_the_rest() {
    let path = circle();
    let places = stations(PI, 200).map(|s| (s, if s > 3.0 { 0.3 } else { 0.0 }));
    let found = measure(&course(&path, Some(1.0)), &drive(&path, places));
    close(found.completion.unwrap(), 3.0 / (2.0 * PI), 0.01);
    assert!(found.lane_error.unwrap().mean > 0.5 * HALF_WIDTH_M);
    assert!(
        found.lane_error.unwrap().mean_as_defined < 0.02,
        "the document's mean forgives it"
    );
}

#[test]
fn a_start_outside_is_an_approach_and_no_departure_if_it_comes_in() {
    let path = straight(3.0);
    let coming = stations(3.0, 300).map(|s| (s, -0.215 + (0.3 * s).min(0.215)));
    let found = measure(&course(&path, Some(1.0)), &drive(&path, coming));
    assert!(found.completed && found.departures == 0 && found.laps == 1);
    close(found.lane_error.unwrap().max, 0.215, 1e-6);
    let staying = measure(
        &course(&path, Some(1.0)),
        &drive(&path, stations(3.0, 300).map(|s| (s, 0.2))),
    );
    assert_eq!(
        (staying.departures, staying.completed, staying.completion),
        (1, false, Some(0.0))
    );
    let short = measure(
        &course(&path, Some(1.0)),
        &drive(&path, stations(0.5, 50).map(|s| (s, 0.2))),
    );
    assert_eq!((short.departures, short.completion), (1, Some(0.0)));
}

#[test]
fn hostile_poses_do_not_panic() {
    let path = circle();
    let mut truths = drive(&path, stations(2.0, 20).map(|s| (s, 0.0)));
    truths[5].world_from_vehicle.x_m = f64::NAN;
    truths[6].world_from_vehicle.heading_rad = f64::INFINITY;
    truths[7].world_from_vehicle.x_m = 1e300;
    let found = measure(&course(&path, Some(1.0)), &truths);
    // They count as outside; the rest of the run as it is.
    assert_eq!((found.departures, found.frames), (1, 21));
    close(found.progress_m, 2.0, 1e-6);
    close(found.distance_m, 1.6, 1e-2);
    close(found.lane_error.unwrap().mean_as_defined, 0.0, 1e-6);
    assert!(found.lane_error.unwrap().mean.is_finite() && found.heading_error.unwrap().mean.is_finite());
    for truth in &mut truths {
        truth.world_from_vehicle.y_m = f64::NAN;
    }
    let nowhere = measure(&course(&path, Some(1.0)), &truths);
    close(nowhere.lane_error.unwrap().mean, HALF_WIDTH_M, 1e-9);
    truths
        .iter_mut()
        .for_each(|truth| truth.world_from_vehicle = Pose2::default());
    assert_eq!(measure(&course(&path, Some(1.0)), &[]).completion, Some(0.0));
    let one = measure(&course(&path, None), &truths[..1]);
    close(one.lane_error.unwrap().mean, 0.0, 1e-9);
}

fn no_better(worse: &Metrics, good: &Metrics) -> Result<(), TestCaseError> {
    let (w, g) = (
        (worse.lane_error.unwrap(), worse.heading_error.unwrap()),
        (good.lane_error.unwrap(), good.heading_error.unwrap()),
    );
    prop_assert!(w.0.mean >= g.0.mean - 1e-9, "lane mean {} {}", w.0.mean, g.0.mean);
    prop_assert!(w.0.max >= g.0.max - 1e-9);
    prop_assert!(
        w.1.mean >= g.1.mean - 1e-9,
        "heading mean {} {}",
        w.1.mean,
        g.1.mean
    );
    prop_assert!(w.1.max >= g.1.max - 1e-9);
    prop_assert!(worse.completion <= good.completion && worse.laps <= good.laps);
    prop_assert!(!worse.completed && worse.departures >= 1);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Whatever piece of a drive is driven outside instead, or not driven at all because leaving ended the run: no figure
    /// gets better.
    #[test]
    fn leaving_never_improves(
        size in 0.0..0.07f64,
        waves in 1u32..6,
        from in 0.1..0.7f64,
        part in 0.02..0.2f64,
        out in 0.151..0.5f64,
        side in prop::bool::ANY,
    ) {
        let path = circle();
        let inside = |s: f64| size * trig::sin(f64::from(waves) * s);
        let left = from * 2.0 * PI..(from + part) * 2.0 * PI;
        let outside = |s: f64| if left.contains(&s) { if side { out } else { -out } } else { inside(s) };
        let yardstick = course(&path, Some(1.0));
        let good = measure(&yardstick, &drive(&path, stations(2.0 * PI, 400).map(|s| (s, inside(s)))));
        prop_assert!(good.completed);

        let returned = measure(&yardstick, &drive(&path, stations(2.0 * PI, 400).map(|s| (s, outside(s)))));
        no_better(&returned, &good)?;

        let until_left = stations(2.0 * PI, 400).take_while(|s| *s < left.end).map(|s| (s, outside(s)));
        let ended = measure(&yardstick, &drive(&path, until_left));
        no_better(&ended, &good)?;
        prop_assert!(ended.completion <= returned.completion);
        prop_assert!(ended.lane_error.unwrap().mean_over_time >= good.lane_error.unwrap().mean_over_time);
    }
}

/// 20 frames a second along 60 m of a road 6 m wide, at the offset that each station asks for.
fn autonomy_of(offset_m: impl Fn(f64) -> f64) -> (u32, f64) {
    let path = straight(60.0);
    let truths = drive(&path, stations(60.0, 1200).map(|s| (s, offset_m(s))));
    let wide = Course {
        corridor_half_width_m: 3.0,
        ..course(&path, Some(1.0))
    };
    let found = measure(&wide, &truths);
    (found.interventions, found.autonomy.unwrap())
}

#[test]
fn nvidias_autonomy_takes_six_seconds_for_each_time_further_than_a_metre_off() {
    assert_eq!(autonomy_of(|_| 0.9), (0, 1.0));
    let once = autonomy_of(|s| if s > 20.0 { 1.2 } else { 0.0 });
    assert_eq!(once.0, 1);
    close(once.1, 1.0 - 6.0 / 60.0, 1e-9);
    // Twice over the metre without having been back below nine tenths of it is once.
    let wavering = |s: f64| {
        if (20.0..21.0).contains(&s) || s > 22.0 {
            1.1
        } else {
            0.95
        }
    };
    assert_eq!(autonomy_of(wavering).0, 1);
    let twice = autonomy_of(|s| if s % 30.0 > 20.0 { -1.2 } else { 0.0 });
    assert_eq!(twice.0, 2);
    close(twice.1, 1.0 - 12.0 / 60.0, 1e-9);
    // Never below zero: a minute has no room for twelve.
    assert_eq!(autonomy_of(|s| if s % 5.0 > 2.5 { 1.2 } else { 0.0 }), (12, 0.0));
    // One that begins there was put there; one that stays there drives there.
    assert_eq!(autonomy_of(|_| 1.5).0, 1);
}

#[test]
fn in_a_narrow_corridor_leaving_it_is_the_intervention() {
    let path = straight(10.0);
    let truths = drive(
        &path,
        stations(10.0, 400).map(|s| (s, if s > 5.0 { 0.2 } else { 0.1 })),
    );
    let found = measure(&course(&path, Some(1.0)), &truths);
    assert_eq!((found.interventions, found.departures), (1, 1));
    assert_eq!(
        measure(&course(&path, Some(1.0)), &truths[..100]).interventions,
        0
    );
    // Coming in from outside is no intervention.
    let truths = drive(&path, stations(10.0, 400).map(|s| (s, (0.3 - s).max(0.0))));
    assert_eq!(measure(&course(&path, Some(1.0)), &truths).interventions, 0);
}

#[test]
fn speed_is_told_apart_on_straights_and_in_curves() {
    let pieces = [Segment::straight(4.0), Segment::arc(0.5, PI)].repeat(2);
    let path = Curve::from_segments(Pose2::default(), &pieces, 0.01, true).unwrap();
    let mut truths = drive(&path, stations(path.length_m(), 800).map(|s| (s, 0.0)));
    for truth in &mut truths[1..] {
        let place = path.project(truth.world_from_vehicle.position());
        truth.speed_mps = if path.curvature_at(place.station_m).abs() > 1.0 {
            0.3
        } else {
            0.8
        };
    }
    // Setting off counts nowhere.
    truths[0].speed_mps = 100.0;
    let [straight, curved] = measure(&course(&path, Some(1.0)), &truths)
        .speed_by_curvature_mps
        .unwrap();
    close(straight, 0.8, 1e-9);
    close(curved, 0.3, 1e-9);
    let circle = circle();
    let truths = drive(&circle, stations(6.0, 400).map(|s| (s, 0.0)));
    assert_eq!(
        measure(&course(&circle, None), &truths).speed_by_curvature_mps,
        None
    );
}
