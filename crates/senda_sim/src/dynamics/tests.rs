//! Motion against formulas.

use super::*;
use senda_core::{Drive, Turn};

/// A vehicle without faults.
fn ideal(steering: &str, more: &str) -> VehicleSpec {
    let toml = format!(
        "width_m = 0.2\nlength_m = 0.3\nspeed_limit_mps = 1.0\nrate_hz = 20\n\
         [steering]\n{steering}\n[wheels]\ndiameter_m = 0.065\n{more}"
    );
    VehicleSpec::parse("ideal.toml", &toml).unwrap().0
}

const DIFFERENTIAL: &str = "kind = \"differential\"\ntrack_m = 0.11";
const ACKERMANN: &str = "kind = \"ackermann\"\nwheelbase_m = 0.2\nsteering_limit_deg = 30";

fn run(dynamics: &mut Dynamics, command: Command, time_s: f64) -> State {
    dynamics.command(&command);
    let steps = (time_s * 1e9 / dynamics.step_ns() as f64).round() as u64;
    for _ in 0..steps {
        dynamics.advance(0.0);
    }
    *dynamics.state()
}

fn at_rest(spec: &VehicleSpec) -> Dynamics {
    Dynamics::new(spec, Pose2::default(), 1)
}

#[test]
fn a_vehicle_that_begins_rolling_goes_on_as_it_rolls() {
    for steering in [DIFFERENTIAL, ACKERMANN] {
        let mut dynamics = at_rest(&ideal(steering, "")).rolling(0.5);
        let state = run(&mut dynamics, Command::curvature(0.0, 0.5), 2.0);
        let pose = state.world_from_vehicle;
        assert!((pose.x_m - 1.0).abs() < 1e-9 && pose.y_m == 0.0, "{pose:?}");
        assert!((state.speed_mps - 0.5).abs() < 1e-12);
    }
}

#[test]
fn a_unicycle_drives_a_circle_of_radius_speed_by_yaw_rate() {
    let mut dynamics = at_rest(&ideal(DIFFERENTIAL, ""));
    for _ in 0..7 {
        let pose = run(&mut dynamics, Command::yaw_rate(0.8, 0.2), 0.55).world_from_vehicle;
        let from_centre = senda_geom::trig::hypot(pose.x_m, pose.y_m - 0.25);
        assert!((from_centre - 0.25).abs() < 1e-9, "{from_centre}");
    }
}

#[test]
fn it_turns_in_place_to_the_left() {
    let state = run(
        &mut at_rest(&ideal(DIFFERENTIAL, "")),
        Command::yaw_rate(1.0, 0.0),
        0.5,
    );
    assert!((state.world_from_vehicle.heading_rad - 0.5).abs() < 1e-9);
    assert!(state.world_from_vehicle.position().length() < 1e-12);
}

#[test]
fn a_car_drives_a_circle_of_radius_wheelbase_by_tangent() {
    let mut dynamics = at_rest(&ideal(ACKERMANN, ""));
    let radius_m = 0.2 / trig::tan(0.3);
    for _ in 0..9 {
        let pose = run(&mut dynamics, Command::steering(0.3, 0.5), 0.35).world_from_vehicle;
        let from_centre = senda_geom::trig::hypot(pose.x_m, pose.y_m - radius_m);
        assert!((from_centre - radius_m).abs() < 1e-9);
    }
    let state = run(&mut dynamics, Command::steering(2.0, 0.5), 0.1);
    assert!((state.steering_rad - 30f64.to_radians()).abs() < 1e-12, "limited");
}

#[test]
fn a_command_acts_after_exactly_its_delay() {
    let mut dynamics = at_rest(&ideal(DIFFERENTIAL, "[drive]\ndelay_s = 0.06"));
    assert_eq!(dynamics.step_ns(), 5_000_000);
    dynamics.command(&Command::curvature(0.0, 0.5));
    for step in 0..12 {
        dynamics.advance(0.0);
        assert_eq!(dynamics.state().speed_mps, 0.0, "after {} steps", step + 1);
    }
    dynamics.advance(0.0);
    assert_eq!(dynamics.state().speed_mps, 0.5);
}

#[test]
fn speed_follows_with_its_time_constant_and_acceleration_limit() {
    let mut dynamics = at_rest(&ideal(DIFFERENTIAL, "[drive]\nspeed_time_constant_s = 0.1"));
    let speed = run(&mut dynamics, Command::curvature(0.0, 1.0), 0.1).speed_mps;
    assert!((speed - (1.0 - trig::exp(-1.0))).abs() < 1e-9, "{speed}");
    let mut dynamics = at_rest(&ideal(DIFFERENTIAL, "[drive]\nacceleration_limit_mps2 = 2.0"));
    assert!((run(&mut dynamics, Command::curvature(0.0, 1.0), 0.1).speed_mps - 0.2).abs() < 1e-9);
    assert!((run(&mut dynamics, Command::curvature(0.0, 1.0), 1.0).speed_mps - 1.0).abs() < 1e-9);
}

#[test]
fn the_steering_has_rate_step_and_play() {
    let servo = "[drive]\nsteering_rate_limit_degps = 100";
    let state = run(
        &mut at_rest(&ideal(ACKERMANN, servo)),
        Command::steering(0.5, 0.1),
        0.1,
    );
    assert!((state.steering_rad - 10f64.to_radians()).abs() < 1e-9);
    let servo = "[drive]\nsteering_step_deg = 5";
    let state = run(
        &mut at_rest(&ideal(ACKERMANN, servo)),
        Command::steering(0.15, 0.1),
        0.1,
    );
    assert!(
        (state.steering_rad - 10f64.to_radians()).abs() < 1e-9,
        "{}",
        state.steering_rad
    );
    let servo = "[drive]\nsteering_play_deg = 2";
    let mut dynamics = at_rest(&ideal(ACKERMANN, servo));
    let there = run(&mut dynamics, Command::steering(0.2, 0.1), 0.1).steering_rad;
    assert!((there - (0.2 - 1f64.to_radians())).abs() < 1e-9);
    let back = run(&mut dynamics, Command::steering(0.19, 0.1), 0.1).steering_rad;
    assert_eq!(there, back, "within the play the wheels stay");
}

#[test]
fn too_slow_is_standing_still() {
    let mut dynamics = at_rest(&ideal(DIFFERENTIAL, "[drive]\ndead_band_mps = 0.05"));
    assert_eq!(
        run(&mut dynamics, Command::curvature(0.0, 0.049), 0.2).speed_mps,
        0.0
    );
    assert_eq!(
        run(&mut dynamics, Command::curvature(0.0, 0.051), 0.2).speed_mps,
        0.051
    );
}

const TYRES: &str =
    "[tyres]\nmass_kg = 1.5\ncentre_ahead_m = 0.08\nfront_stiffness_npr = 60\nrear_stiffness_npr = 80";

#[test]
fn sliding_tyres_roll_like_the_kinematic_bicycle_when_slow() {
    let mut dynamics = at_rest(&ideal(ACKERMANN, TYRES));
    let state = run(&mut dynamics, Command::steering(0.2, 0.05), 3.0);
    let rolling = 0.05 * 0.2 / 0.2; // Linear tyres take the angle for its tangent.
    assert!(
        (state.yaw_rate_radps / rolling - 1.0).abs() < 0.01,
        "{}",
        state.yaw_rate_radps
    );
    assert!(state.sliding_mps.abs() < 1e-3);
}

#[test]
fn fast_curves_settle_at_the_understeer_gradient() {
    let spec = ideal(ACKERMANN, TYRES);
    let mut dynamics = at_rest(&spec);
    let state = run(&mut dynamics, Command::steering(0.1, 1.0), 3.0);
    // Rajamani 2012, eq. 3.2: δ = L/R + K·v²/R with K = m/L·(l_r/C_f - l_f/C_r).
    let understeer = 1.5 / 0.2 * (0.08 / 60.0 - 0.12 / 80.0);
    let expected = 0.1 / (0.2 + understeer);
    assert!(
        (state.yaw_rate_radps - expected).abs() < 1e-6,
        "{} {expected}",
        state.yaw_rate_radps
    );
    // The step's size does not matter for where it settles; the path stays finite and smooth.
    assert!(state.sliding_mps.abs() > 1e-3 && state.world_from_vehicle.x_m.is_finite());
}

#[test]
fn grip_ends_curves_that_are_too_fast() {
    let spec = ideal(ACKERMANN, &format!("{TYRES}\ngrip_mps2 = 0.5"));
    let state = run(&mut at_rest(&spec), Command::steering(0.5, 1.0), 2.0);
    assert!((state.yaw_rate_radps * state.speed_mps).abs() <= 0.5 + 1e-9);
}

const MOTOR: &str =
    "[motor]\nslope_per_turnps = 115.7985\nintercept = 18.1987\nreference_v = 9.277\ndead_value = 20";

#[test]
fn motor_values_are_whole_and_top_speed_falls_with_the_voltage() {
    let turn_m = std::f64::consts::PI * 0.065;
    let full = "[battery]\nstart_v = 9.277\nempty_v = 7.0";
    let speed = |battery: &str, wanted_mps: f64| {
        let mut dynamics = at_rest(&ideal(DIFFERENTIAL, &format!("{MOTOR}\n{battery}")));
        run(&mut dynamics, Command::curvature(0.0, wanted_mps), 0.2).speed_mps
    };
    let value = (115.7985 * 0.13 / turn_m + 18.1987).round();
    assert!((speed(full, 0.13) - (value - 18.1987) / 115.7985 * turn_m).abs() < 1e-9);
    let top = (255.0 - 18.1987) / 115.7985 * turn_m;
    assert!((speed(full, 0.9) - top).abs() < 1e-9);
    let weak = "[battery]\nstart_v = 7.4216\nempty_v = 7.0";
    assert!((speed(weak, 0.9) - 0.8 * top).abs() < 1e-6);
    // Less is lost where the controller can make up for it.
    assert!((speed(weak, 0.13) - 0.13).abs() < 0.003);
}

#[test]
fn a_battery_sags_under_load_and_drains() {
    let mut dynamics = at_rest(&ideal(
        DIFFERENTIAL,
        "[battery]\nstart_v = 8.0\nempty_v = 6.0\nsag_v = 0.4\ndrain_vps = 0.01\nnoise_v = 0.05",
    ));
    let loaded_v = run(&mut dynamics, Command::curvature(0.0, 1.0), 10.0).battery_v;
    assert!((loaded_v - 7.5).abs() < 0.04, "{loaded_v}");
    let rested_v = run(&mut dynamics, Command::STOP, 0.1).battery_v;
    assert!((rested_v - 7.9).abs() < 0.01, "{rested_v}");
    let measured: Vec<f64> = (0..50).filter_map(|_| dynamics.measure_battery()).collect();
    let mean = measured.iter().sum::<f64>() / 50.0;
    assert!((mean - rested_v).abs() < 0.03 && measured[0] != measured[1]);
}

#[test]
fn encoders_count_ticks_and_some_only_upwards() {
    let turn_m = std::f64::consts::PI * 0.065;
    for (signed, back) in [(true, 0), (false, 108)] {
        let more = format!("[encoders]\nticks_per_turn = 18\nsigned = {signed}");
        let mut dynamics = at_rest(&ideal(DIFFERENTIAL, &more));
        run(&mut dynamics, Command::curvature(0.0, turn_m), 3.01);
        let wheels = dynamics.wheels().unwrap();
        assert_eq!((wheels.left_ticks, wheels.right_ticks), (54, 54));
        run(&mut dynamics, Command::curvature(0.0, -turn_m), 3.0);
        assert_eq!(dynamics.wheels().unwrap().left_ticks, back);
    }
    let mut dynamics = at_rest(&ideal(DIFFERENTIAL, "[encoders]\nticks_per_turn = 360"));
    run(&mut dynamics, Command::yaw_rate(1.0, 0.3), 2.0);
    let wheels = dynamics.wheels().unwrap();
    let apart_m = (wheels.right_ticks - wheels.left_ticks) as f64 * turn_m / 360.0;
    assert!(
        (apart_m - 2.0 * 0.11).abs() < 0.002,
        "the right wheel is outside: {apart_m}"
    );
}

#[test]
fn slip_is_seen_in_the_path_and_not_by_the_encoders() {
    let spec = ideal(DIFFERENTIAL, "noise = 0.1\n[encoders]\nticks_per_turn = 3600");
    let mut dynamics = at_rest(&spec);
    let pose = run(&mut dynamics, Command::curvature(0.0, 0.2), 5.0).world_from_vehicle;
    assert!(pose.heading_rad.abs() > 1e-3);
    let wheels = dynamics.wheels().unwrap();
    assert_eq!(wheels.left_ticks, wheels.right_ticks);
}

#[test]
fn limits_keep_the_curvature_and_a_throttle_is_part_of_top_speed() {
    let spec = ideal(DIFFERENTIAL, "");
    let state = run(&mut at_rest(&spec), Command::curvature(4.0, 3.0), 0.1);
    assert!((state.yaw_rate_radps / state.speed_mps - 4.0).abs() < 1e-9);
    assert!(state.wheels_mps[1] <= 1.0 + 1e-12);
    let pedal = Command {
        turn: Turn::CurvaturePerM(0.0),
        drive: Drive::Throttle(0.3),
    };
    assert!((run(&mut at_rest(&spec), pedal, 0.1).speed_mps - 0.3).abs() < 1e-12);
}
