//! Way point files that somebody got wrong: each is answered with what is wrong and where.

use senda_geom::trig;
use senda_world::World;

/// A lap of 40 points around an ellipse, in metres times `unit`.
fn lap(unit: f64) -> Vec<String> {
    (0..40)
        .map(|i| {
            let (sin, cos) = trig::sincos(f64::from(i) * std::f64::consts::TAU / 40.0);
            format!("{:.6},{:.6}", 140.0 * cos * unit, 100.0 * sin * unit)
        })
        .collect()
}

fn error(lines: &[String]) -> String {
    World::from_waypoints("lap.csv", &lines.join("\n"), 1.0, 1)
        .unwrap_err()
        .to_string()
}

#[test]
fn two_laps_in_one_file_are_no_lap() {
    let mut twice = lap(1.0);
    // A second time around, as a recorded drive has it: a hand's breadth beside the first.
    twice.extend(lap(1.0005));
    let told = error(&twice);
    assert!(
        told.contains("does not cross itself") && told.contains("lines"),
        "{told}"
    );
    // Exactly the same points again.
    let mut same = lap(1.0);
    same.extend(lap(1.0));
    assert!(error(&same).contains("does not cross itself"));
}

#[test]
fn a_figure_of_eight_names_both_places() {
    let eight: Vec<String> = (0..40)
        .map(|i| {
            let (sin, cos) = trig::sincos(f64::from(i) * std::f64::consts::TAU / 40.0 + 0.01);
            format!("{:.3},{:.3}", 150.0 * sin, 150.0 * sin * cos)
        })
        .collect();
    let told = error(&eight);
    assert!(told.contains("the pieces after lines 20 and 40 cross"), "{told}");
}

#[test]
fn one_point_is_no_lap_however_often_it_is_written() {
    for lines in [
        vec!["3,4"],
        vec!["x,y", "3,4"],
        vec!["3,4"; 500],
        vec!["x,y"],
        vec![],
    ] {
        let lines: Vec<String> = lines.into_iter().map(str::to_owned).collect();
        assert!(
            error(&lines).contains("at least four different points"),
            "{lines:?}"
        );
    }
}

#[test]
fn the_wrong_unit_is_guessed_from_the_length() {
    for (unit, says) in [(0.001, "kilometres"), (100.0, "centimetres"), (1e-5, "degrees")] {
        let told = World::from_waypoints("lap.csv", &lap(unit).join("\n"), 1.0, 1).unwrap_err();
        let help = format!(
            "{told} {}",
            miette::Diagnostic::help(&told)
                .map(|help| help.to_string())
                .unwrap_or_default()
        );
        assert!(help.contains(says) && help.contains("--scale"), "{unit}: {help}");
    }
    // Millimetres lie beyond what any world has, and are named by the first line that says so.
    let told = error(&lap(1000.0));
    assert!(told.contains("metres from") && told.contains("--scale"), "{told}");
}

#[test]
fn repeats_in_the_middle_and_at_the_end_are_left_out_with_their_lines() {
    let mut lines = lap(1.0);
    lines.insert(20, lines[19].clone());
    lines.insert(21, lines[19].clone());
    lines.push(lines[0].clone());
    let (world, warnings) = World::from_waypoints("lap.csv", &lines.join("\n"), 1.0, 1).unwrap();
    let told: Vec<String> = warnings.iter().map(ToString::to_string).collect();
    assert_eq!(told.len(), 3, "{told:?}");
    for (told, line) in told.iter().zip(["lap.csv:21", "lap.csv:22", "lap.csv:43"]) {
        assert!(told.contains(line), "{told}");
    }
    assert!(
        world
            == World::from_waypoints("lap.csv", &lap(1.0).join("\n"), 1.0, 1)
                .unwrap()
                .0
    );
}
