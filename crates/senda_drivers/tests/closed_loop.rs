//! The drivers drive: floor, camera, vehicle and driver in a loop, without the simulator.

mod support;

use senda_core::{Drive, Driver, Image};
use senda_drivers::{
    ContrastChoice, Form, LaneDriver, LaneOptions, LineDriver, LineOptions, LossOptions, WhileLost,
};
use senda_geom::{Curve, Pose2};
use support::{Floor, Lap, Loop, Watched, circle, gopigo, kit_car, s_curve, straight};

/// Options for the vehicle of these tests, which has one period of delay and no lag.
fn line(form: Form, speed_mps: f64) -> LineOptions {
    let mut options = LineOptions {
        form,
        ..LineOptions::default()
    };
    (options.track.delay_s, options.track.lag_s) = (0.05, 0.0);
    options.set_speed(Some(speed_mps));
    options
}

fn lane(form: Form, speed_mps: f64) -> LaneOptions {
    let mut options = LaneOptions {
        form,
        ..LaneOptions::default()
    };
    (options.track.delay_s, options.track.lag_s) = (0.05, 0.0);
    options.set_speed(Some(speed_mps));
    options
}

/// One line on a speckled floor.
fn one_line(path: &Curve, floor_level: u8, line_level: u8) -> Floor {
    let mut floor = Floor::around(path, 0.7, floor_level);
    floor.stripe(path, 0.018, line_level, None);
    floor.speckle(20);
    floor
}

/// Two light lines on a darker floor.
fn two_lines(path: &Curve, half_width_m: f64, line_width_m: f64) -> Floor {
    let mut floor = Floor::around(path, 0.9, 90);
    for side in [half_width_m, -half_width_m] {
        floor.stripe(&path.offset(side), line_width_m, 230, None);
    }
    floor.speckle(20);
    floor
}

fn drive_line(path: &Curve, floor: &Floor, options: LineOptions, size: (u32, u32)) -> Lap {
    let body = gopigo(size.0, size.1);
    let mut run = Loop::new(&body, floor, path);
    run.goal_m = path.length_m() - 0.55;
    run.drive(&mut LineDriver::new(&body, options).unwrap())
}

#[track_caller]
fn arrives(lap: &Lap, goal_m: f64, mean_m: f64, largest_m: f64) {
    assert!(
        lap.travelled_m >= goal_m,
        "only {:.2} of {goal_m:.2} m",
        lap.travelled_m
    );
    assert!(
        lap.mean_m < mean_m && lap.largest_m < largest_m,
        "mean {:.4} m, largest {:.4} m",
        lap.mean_m,
        lap.largest_m
    );
}

#[test]
fn the_line_is_followed_on_straights_circles_and_s_curves() {
    for (path, mean_m, largest_m) in [
        (straight(2.5), 0.001, 0.003),
        (circle(0.4), 0.003, 0.006),
        (s_curve(0.4), 0.003, 0.010),
        (s_curve(0.25), 0.006, 0.020),
    ] {
        let floor = one_line(&path, 170, 40);
        for speed_mps in [0.13, 0.2] {
            let lap = drive_line(&path, &floor, line(Form::Curve, speed_mps), (160, 120));
            arrives(&lap, path.length_m() - 0.55, mean_m, largest_m);
        }
    }
}

#[test]
fn the_documents_form_follows_too_but_cuts_curves() {
    let path = s_curve(0.5);
    let floor = one_line(&path, 170, 40);
    let lap = drive_line(&path, &floor, line(Form::Document, 0.13), (160, 120));
    arrives(&lap, path.length_m() - 0.55, 0.05, 0.10);
    let curve = drive_line(&path, &floor, line(Form::Curve, 0.13), (160, 120));
    assert!(
        curve.mean_m < 0.25 * lap.mean_m,
        "{} {}",
        curve.mean_m,
        lap.mean_m
    );
}

#[test]
fn light_lines_and_small_images_are_followed_as_well() {
    let path = s_curve(0.4);
    let floor = one_line(&path, 90, 225);
    for size in [(123, 92), (160, 120)] {
        let lap = drive_line(&path, &floor, line(Form::Curve, 0.13), size);
        arrives(&lap, path.length_m() - 0.55, 0.004, 0.012);
    }
}

#[test]
fn a_dashed_line_is_joined() {
    // C5's limits refuse every single one of these dashes.
    for (dash_m, gap_m) in [(0.14, 0.05), (0.10, 0.05), (0.08, 0.04)] {
        let path = s_curve(0.5);
        let mut floor = Floor::around(&path, 0.7, 170);
        floor.dashes(&path, 0.018, 40, dash_m, gap_m);
        floor.speckle(20);
        let body = gopigo(160, 120);
        let mut run = Loop::new(&body, &floor, &path);
        run.goal_m = path.length_m() - 0.55;
        let mut driver = Watched::new(LineDriver::new(&body, line(Form::Curve, 0.13)).unwrap());
        let lap = run.drive(&mut driver);
        arrives(&lap, run.goal_m, 0.006, 0.02);
        assert!(
            driver.longest_gap < 10,
            "{dash_m} {gap_m}: {}",
            driver.longest_gap
        );
    }
}

#[test]
fn lamps_mirrored_on_a_line_leave_enough_of_it() {
    let path = circle(0.3);
    for (floor_level, line_level, left_m) in [(170, 40, 0.0), (90, 200, 0.03)] {
        let mut floor = one_line(&path, floor_level, line_level);
        for i in 0..6 {
            let at = path.pose_at(0.4 + 0.25 * f64::from(i));
            floor.disc(at.position() + at.left() * left_m, 0.025, 255);
        }
        let body = gopigo(160, 120);
        let mut run = Loop::new(&body, &floor, &path);
        run.goal_m = path.length_m() - 0.55;
        let mut driver = Watched::new(LineDriver::new(&body, line(Form::Curve, 0.13)).unwrap());
        let lap = run.drive(&mut driver);
        arrives(&lap, run.goal_m, 0.006, 0.02);
        assert!(driver.longest_gap < 10, "{line_level}: {}", driver.longest_gap);
    }
}

#[test]
fn a_line_that_leaves_the_picture_at_its_side_is_enough_to_begin_with() {
    let path = circle(0.25);
    for (floor_level, line_level) in [(170, 40), (90, 225)] {
        let floor = one_line(&path, floor_level, line_level);
        let body = gopigo(123, 92);
        let mut run = Loop::new(&body, &floor, &path);
        run.start = path.pose_at(0.3).compose(Pose2::new(0.0, 0.0, -0.15));
        run.start_station_m = 0.3;
        run.goal_m = 1.0;
        let lap = run.drive(&mut LineDriver::new(&body, line(Form::Curve, 0.13)).unwrap());
        arrives(&lap, 1.0, 0.02, 0.05);
    }
}

/// C16: where the vehicle starts, when it is on the line for good (s), and how far it was from it.
fn approach(form: Form, d_m: f64, theta_deg: f64) -> (f64, f64) {
    let path = straight(3.0);
    let floor = one_line(&path, 170, 40);
    let body = gopigo(160, 120);
    let mut run = Loop::new(&body, &floor, &path);
    run.start = Pose2::new(0.5, -d_m, -theta_deg.to_radians());
    run.start_station_m = 0.5;
    run.seconds = 25.0;
    let lap = run.drive(&mut LineDriver::new(&body, line(form, 0.07)).unwrap());
    let on_line = |i: usize| lap.offsets_m[i].abs() < 0.01 && lap.headings_rad[i].abs() < 2f64.to_radians();
    let last_off = (0..lap.offsets_m.len()).rev().find(|i| !on_line(*i)).unwrap();
    assert!(last_off + 1 < lap.offsets_m.len(), "never on the line");
    let largest_m = lap
        .offsets_m
        .iter()
        .fold(0.0f64, |most, offset| most.max(offset.abs()));
    (body.period_s * last_off as f64, largest_m)
}

#[test]
fn from_21_5_cm_and_44_6_degrees_it_is_on_the_line_in_under_10_s() {
    let (settled_s, _) = approach(Form::Curve, -0.215, 44.6);
    assert!(settled_s < 10.0, "{settled_s}");
    // With the document's constants it takes longer than the 10 s that it reads off its figure.
    let (document_s, _) = approach(Form::Document, -0.215, 44.6);
    assert!(document_s > settled_s && document_s < 17.0, "{document_s}");
}

#[test]
fn from_4_cm_and_12_degrees_it_makes_a_detour_and_converges() {
    for form in [Form::Curve, Form::Document] {
        let (settled_s, largest_m) = approach(form, 0.04, 12.0);
        assert!(
            largest_m > 0.042 && largest_m < 0.06 && settled_s < 12.0,
            "{form:?} {settled_s} {largest_m}"
        );
    }
}

#[test]
fn where_the_line_ends_the_vehicle_stops_within_35_cm() {
    let path = straight(4.0);
    let mut floor = Floor::around(&path, 0.7, 170);
    floor.stripe(&path, 0.018, 40, Some((0.0, 1.5)));
    let body = gopigo(160, 120);
    for (form, while_lost) in [
        (Form::Document, None),
        (Form::Curve, None),
        (Form::Curve, Some(WhileLost::Hold)),
    ] {
        let mut options = line(form, 0.13);
        options.loss = LossOptions {
            while_lost,
            ..LossOptions::default()
        };
        let mut driver = LineDriver::new(&body, options).unwrap();
        let lap = Loop::new(&body, &floor, &path).drive(&mut driver);
        // The camera's nearest floor is 11 cm ahead of the axle: there the line is out of sight at 1.39 m.
        let stopped = lap.stopped_after_m.expect("stops");
        assert!(
            driver.is_done() && stopped > 1.2 && stopped < 1.5 + 0.37,
            "{form:?} {stopped}"
        );
    }
}

#[test]
fn frames_without_a_line_cost_nothing() {
    let path = s_curve(0.4);
    let floor = one_line(&path, 170, 40);
    let body = gopigo(160, 120);
    let mut run = Loop::new(&body, &floor, &path);
    run.goal_m = path.length_m() - 0.55;
    // Every third second the camera is blinded for half a second.
    run.spoil = Box::new(|step, image: &mut Image| {
        if step > 40 && step % 60 < 10 {
            image.pixels_mut().fill(255);
        }
    });
    let lap = run.drive(&mut LineDriver::new(&body, line(Form::Curve, 0.13)).unwrap());
    arrives(&lap, run.goal_m, 0.005, 0.02);
}

#[test]
fn over_exposed_first_frames_do_not_fix_the_wrong_contrast() {
    let path = straight(2.5);
    let floor = one_line(&path, 90, 225);
    let body = gopigo(160, 120);
    let mut run = Loop::new(&body, &floor, &path);
    run.goal_m = 1.5;
    run.spoil = Box::new(|step, image: &mut Image| {
        if step < 6 {
            // White, but for a dark reflection beside the line.
            for (i, pixel) in image.pixels_mut().iter_mut().enumerate() {
                let dark = (20..26).contains(&(i % 160)) && step == 2;
                *pixel = if dark { 60 } else { 255 };
            }
        }
    });
    let lap = run.drive(&mut LineDriver::new(&body, line(Form::Curve, 0.13)).unwrap());
    arrives(&lap, 1.5, 0.03, 0.12);
}

#[test]
fn a_forced_contrast_sees_nothing_else() {
    let path = straight(2.0);
    let floor = one_line(&path, 170, 40);
    let body = gopigo(160, 120);
    let mut options = line(Form::Curve, 0.13);
    options.sight.contrast = ContrastChoice::Light;
    let mut run = Loop::new(&body, &floor, &path);
    run.seconds = 8.0;
    let mut driver = LineDriver::new(&body, options).unwrap();
    let lap = run.drive(&mut driver);
    assert!(lap.travelled_m < 0.01 && driver.is_done(), "{}", lap.travelled_m);
}

#[test]
fn stains_and_reflections_beside_the_line_are_left_alone() {
    let path = s_curve(0.4);
    let mut floor = one_line(&path, 170, 40);
    for i in 0..12 {
        let at = path.pose_at(0.3 + 0.2 * f64::from(i));
        let side = if i % 2 == 0 { 0.12 } else { -0.10 };
        floor.disc(at.position() + at.left() * side, 0.02, 250);
        floor.disc(at.position() - at.left() * side, 0.015, 60);
    }
    let lap = drive_line(&path, &floor, line(Form::Curve, 0.13), (160, 120));
    arrives(&lap, path.length_m() - 0.55, 0.008, 0.03);
}

#[test]
fn the_lane_is_followed_on_straights_circles_and_s_curves() {
    let body = gopigo(160, 120);
    for path in [straight(2.5), circle(0.5), s_curve(0.5), s_curve(0.35)] {
        let floor = two_lines(&path, 0.10, 0.018);
        for speed_mps in [0.16, 0.25] {
            let mut run = Loop::new(&body, &floor, &path);
            run.goal_m = path.length_m() - 0.7;
            let lap = run.drive(&mut LaneDriver::new(&body, lane(Form::Curve, speed_mps)).unwrap());
            arrives(&lap, run.goal_m, 0.004, 0.012);
        }
    }
}

#[test]
fn the_documents_lane_form_follows_gentle_curves() {
    let body = gopigo(160, 120);
    let path = s_curve(0.6);
    let floor = two_lines(&path, 0.10, 0.018);
    let mut run = Loop::new(&body, &floor, &path);
    run.goal_m = path.length_m() - 0.7;
    let lap = run.drive(&mut LaneDriver::new(&body, lane(Form::Document, 0.135)).unwrap());
    arrives(&lap, run.goal_m, 0.06, 0.12);
}

/// An edge and the line in the middle were taken for the lane: half a lane from its middle, the lap was driven.
#[test]
fn where_the_width_is_given_a_centre_line_is_no_edge() {
    let body = gopigo(160, 120);
    for path in [circle(0.5), s_curve(0.8)] {
        let mut floor = two_lines(&path, 0.15, 0.018);
        floor.stripe(&path, 0.018, 230, None);
        let mut options = lane(Form::Curve, 0.16);
        options.shape.width_m = Some(0.3);
        let mut run = Loop::new(&body, &floor, &path);
        run.goal_m = path.length_m() - 0.7;
        let lap = run.drive(&mut LaneDriver::new(&body, options).unwrap());
        arrives(&lap, run.goal_m, 0.01, 0.03);
    }
}

#[test]
fn a_dashed_centre_line_between_the_edges_does_not_matter() {
    let body = gopigo(160, 120);
    let path = s_curve(0.5);
    let mut floor = two_lines(&path, 0.10, 0.018);
    floor.dashes(&path, 0.018, 230, 0.08, 0.08);
    let mut run = Loop::new(&body, &floor, &path);
    run.goal_m = path.length_m() - 0.7;
    let lap = run.drive(&mut LaneDriver::new(&body, lane(Form::Curve, 0.16)).unwrap());
    arrives(&lap, run.goal_m, 0.004, 0.012);
}

#[test]
fn a_wide_lane_is_a_matter_of_options() {
    let body = kit_car();
    let path = s_curve(1.5);
    let floor = two_lines(&path, 0.30, 0.05);
    let mut options = lane(Form::Curve, 0.5);
    options.sight.line_width_m = 0.05;
    options.shape.widest_m = 0.9;
    let mut run = Loop::new(&body, &floor, &path);
    run.goal_m = path.length_m() - 0.7;
    let lap = run.drive(&mut LaneDriver::new(&body, options).unwrap());
    arrives(&lap, run.goal_m, 0.015, 0.03);
}

#[test]
fn a_lane_of_which_one_line_is_in_sight_at_first_is_not_taken_for_one_line() {
    let body = gopigo(160, 120);
    let path = straight(3.0);
    let mut floor = Floor::around(&path, 0.7, 90);
    // The right line begins later; the left one is nearer than half the vehicle's width.
    floor.stripe(&path.offset(0.065), 0.018, 230, None);
    floor.stripe(&path.offset(-0.065), 0.018, 230, Some((0.9, 3.0)));
    let mut run = Loop::new(&body, &floor, &path);
    run.start = Pose2::new(0.0, 0.02, 0.0);
    run.goal_m = 2.0;
    let lap = run.drive(&mut LaneDriver::new(&body, lane(Form::Curve, 0.16)).unwrap());
    arrives(&lap, 2.0, 0.01, 0.025);
}

#[test]
fn a_line_that_ends_leaves_the_lane_to_the_other_one() {
    let body = gopigo(160, 120);
    let path = straight(4.0);
    let mut floor = Floor::around(&path, 0.7, 90);
    floor.stripe(&path.offset(0.10), 0.018, 230, None);
    floor.stripe(&path.offset(-0.10), 0.018, 230, Some((0.0, 1.2)));
    let mut run = Loop::new(&body, &floor, &path);
    run.goal_m = 3.2;
    let lap = run.drive(&mut LaneDriver::new(&body, lane(Form::Curve, 0.16)).unwrap());
    arrives(&lap, 3.2, 0.004, 0.012);
}

#[test]
fn the_same_observations_give_a_new_driver_the_same_commands() {
    let path = s_curve(0.4);
    let floor = one_line(&path, 170, 40);
    for form in [Form::Document, Form::Curve, Form::PurePursuit] {
        let once = drive_line(&path, &floor, line(form, 0.13), (160, 120));
        let twice = drive_line(&path, &floor, line(form, 0.13), (160, 120));
        assert!(once.commands.len() > 100);
        assert_eq!(once.commands, twice.commands);
    }
}

#[test]
fn sharp_curves_are_driven_slower_when_asked() {
    let path = circle(0.3);
    let floor = one_line(&path, 170, 40);
    let mut options = line(Form::Curve, 0.3);
    options.speed.curve_yaw_rate_radps = 0.5;
    let lap = drive_line(&path, &floor, options, (160, 120));
    arrives(&lap, path.length_m() - 0.55, 0.006, 0.015);
    let Drive::SpeedMps(last) = lap.commands[lap.commands.len() - 1].drive else {
        panic!("line drivers command speeds");
    };
    assert!((last - 0.15).abs() < 0.03, "{last}");
}
