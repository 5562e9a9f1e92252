//! Foreign text never panics, and every complaint names file, line, key, what was expected, what was found, what to do.

use proptest::prelude::*;
use senda_world::{VehicleSpec, World, WorldError};
use std::path::Path;

const PATH: &str = "[path]\npieces = [{ kind = \"straight\", length_m = 2.0 }]\n";

/// Checks that `text` is refused at `line` for `key`, in words that contain `words`.
fn check(text: &str, line: usize, key: &str, words: &[&str]) {
    let WorldError::Invalid(problem) = World::parse("mine.toml", text).unwrap_err() else {
        panic!("expected a problem in the file");
    };
    let message = problem.to_string();
    assert_eq!((problem.line, problem.key.as_str()), (line, key), "{message}");
    assert!(message.starts_with(&format!("mine.toml:{line}: ")), "{message}");
    for word in words {
        assert!(message.contains(word), "{word:?} in {message}");
    }
}

/// A light that did not exist was taken without a word, and red ones were then not judged.
#[test]
fn what_a_warehouse_refers_to_exists() {
    let good = World::named("warehouse").unwrap().to_toml();
    let refused = |from: &str, to: &str, key: &str, words: &[&str]| {
        assert_eq!(good.matches(from).count(), 1, "{from}");
        let text = good.replacen(from, to, 1);
        let line = 1 + text[..text.find(to).unwrap()].matches('\n').count();
        check(&text, line, key, words);
    };
    refused(
        "light = \"light 1\"",
        "light = \"light 9\"",
        "warehouse.places[1].light",
        &[
            "a light among [[things]]: light 1",
            "found \"light 9\"",
            "did you mean \"light 1\"?",
        ],
    );
    refused(
        "street = \"street 2\"",
        "street = \"stret 2\"",
        "warehouse.places[4].street",
        &["street 1, street 2", "did you mean \"street 2\"?"],
    );
    refused(
        "depot = 0\nlight",
        "depot = 7\nlight",
        "warehouse.places[1].depot",
        &["the number of a depot: 0, 1, 2", "found 7"],
    );
}

#[test]
fn messages_name_line_key_and_remedy() {
    check("", 1, "", &["an empty file", "worlds/oval.toml"]);
    check("[path\n", 1, "", &["TOML"]);
    check("name = \"x\"\n", 1, "path", &["add path"]);
    check(
        &format!("lane_widht_m = 0.2\n{PATH}"),
        1,
        "lane_widht_m",
        &["did you mean \"lane_width_m\"?"],
    );
    // Not that a lane's two sides need a width, nor that nothing closes an open path: those follow.
    check(
        &format!("{PATH}[[markings]]\nside = \"both\"\nwidth_m = 0.02\ncolour = \"black\"\n").replacen(
            "[path]",
            "lane_widht_m = 0.2\n[path]",
            1,
        ),
        1,
        "lane_widht_m",
        &["did you mean \"lane_width_m\"?"],
    );
    check(
        "[path]\nclose = true\npieces = [{ kind = \"arc\", radius_m = 1, turn_deg = 90 }, { kind = \"close\" }]\n",
        2,
        "path.close",
        &["did you mean \"closed\"?"],
    );
    check(
        &format!("{PATH}[floor]\nkind = \"wod\"\n"),
        4,
        "floor.kind",
        &["\"wod\"", "did you mean \"wood\"?"],
    );
    check(
        &format!("{PATH}[floor]\nkind = \"wood\"\n\ncolr = \"red\"\n"),
        6,
        "floor.colr",
        &["did you mean \"colour\"?"],
    );
    check(
        &format!("{PATH}[[markings]]\nwidth_m = 0.02\ncolour = \"blck\"\n"),
        5,
        "markings[0].colour",
        &["did you mean \"black\"?"],
    );
    check(
        &format!("{PATH}[[markings]]\nwidht_m = 0.02\ncolour = \"black\"\n"),
        4,
        "markings[0].widht_m",
        &["did you mean \"width_m\"?"],
    );
    check(
        &format!("{PATH}[light]\nlevel = \"high\"\n"),
        4,
        "light.level",
        &["a number from 0.001 to 20", "the text \"high\""],
    );
    check(
        &format!("{PATH}[light]\ngradient = 1.5\n"),
        4,
        "light.gradient",
        &["from 0 to 1", "but found 1.5"],
    );
    check(
        &format!("{PATH}[light]\ngradient = nan\n"),
        4,
        "light.gradient",
        &["but found nan"],
    );
    check(
        &format!("{PATH}[light]\npreset = \"lmp\"\n"),
        4,
        "light.preset",
        &["did you mean \"lamp\"?"],
    );
    check(
        &format!("start_station_m = 3.0\n{PATH}"),
        1,
        "start_station_m",
        &["0 to 2.000 m"],
    );
}

#[test]
fn impossible_geometry_is_an_error() {
    let pieces = |pieces: &str| format!("[path]\npieces = [\n{pieces}\n]\n");
    check(
        &pieces("{ kind = \"straight\", length_m = 0 }"),
        3,
        "path.pieces[0].length_m",
        &["but found 0"],
    );
    check(
        &pieces("{ kind = \"arc\", radius_m = 1, turn_deg = 0 }"),
        3,
        "path.pieces[0].turn_deg",
        &["straight"],
    );
    check(
        &pieces("{ kind = \"arc\", radius_m = 1, turn_deg = 5, turn_rad = 1 }"),
        3,
        "path.pieces[0].turn_deg",
        &["both"],
    );
    check(
        &pieces("{ kind = \"close\" }"),
        3,
        "path.pieces[0].kind",
        &["closed = true"],
    );
    check(
        "[path]\npoints = [[1, 1], [1, 1]]\n",
        2,
        "path.points",
        &["at least two distinct points, but found 2 in the same place"],
    );
    check(
        "[path]\npoints = [[1, 1]]\n",
        2,
        "path.points",
        &["at least two distinct points, but found 1 in all"],
    );
    // They were said to be in the same place.
    check(
        "[path]\nclosed = true\npoints = [[0, 0], [0, 0], [1, 1]]\n",
        3,
        "path.points",
        &[
            "at least three distinct points",
            "but found 3, of which 2 are distinct",
        ],
    );
    check(
        "[path]\npoints = [[1, 1, 1], [1, 1]]\n",
        2,
        "path.points[0]",
        &["[x, y]"],
    );
    check(
        "[path]\nclosed = true\npieces = [{ kind = \"straight\", length_m = 1.0 }]\n",
        3,
        "path.pieces",
        &["a gap of 1.000 m", "kind = \"close\""],
    );
    // A board beyond the end of an open path stood where nobody looked for it.
    let board = |station_m: &str| {
        format!(
            "{PATH}[[things]]\nkind = \"board\"\nstation_m = {station_m}\nwidth_m = 0.1\nheight_m = 0.1\ncolour = \"red\"\n"
        )
    };
    for station_m in ["3", "-0.1"] {
        check(
            &board(station_m),
            5,
            "things[0].station_m",
            &["0 to 2.000 m", station_m, "x_m and y_m"],
        );
    }
    World::parse("mine.toml", &board("2")).unwrap();
}

#[test]
fn things_in_the_middle_of_the_path_are_a_warning() {
    let warned = |place: &str| -> Vec<String> {
        let text = format!(
            "{PATH}[[things]]\nkind = \"box\"\n{place}\nlength_m = 0.1\nwidth_m = 0.2\nheight_m = 0.1\ncolour = \"red\"\n\
             [[markings]]\nwidth_m = 0.02\ncolour = \"black\"\n"
        );
        let (_, warnings) = World::parse("mine.toml", &text).unwrap();
        warnings.iter().map(ToString::to_string).collect()
    };
    let [warning] = &warned("station_m = 1.5")[..] else {
        panic!("{:?}", warned("station_m = 1.5"))
    };
    for word in [
        "mine.toml:4",
        "things[0]",
        "in the middle of the path, at 1.4",
        "offset_m",
    ] {
        assert!(warning.contains(word), "{word:?} in {warning}");
    }
    assert_eq!(warned("station_m = 1.5\noffset_m = 0.09").len(), 1);
    assert!(warned("station_m = 1.5\noffset_m = 0.11").is_empty());
    // A bridge.
    assert!(warned("station_m = 1.5\nbottom_m = 0.5").is_empty());
}

#[test]
fn odd_geometry_is_a_warning() {
    let warned = |text: &str| -> Vec<String> {
        let (_, warnings) = World::parse("mine.toml", text).unwrap();
        warnings.iter().map(ToString::to_string).collect()
    };
    let line = "[[markings]]\nwidth_m = 0.02\ncolour = \"black\"\n";
    assert_eq!(warned(&format!("{PATH}{line}")), Vec::<String>::new());
    let eight = "[path]\nclosed = true\npieces = [\n\
        { kind = \"arc\", radius_m = 0.5, turn_deg = 360 }, { kind = \"arc\", radius_m = 0.5, turn_deg = -360 }]\n";
    let found = warned(&format!("{eight}{line}"));
    assert!(
        found.len() == 1 && found[0].contains("overlaps itself"),
        "{found:?}"
    );
    let lane = "lane_width_m = 0.3\n[path]\npieces = [{ kind = \"arc\", radius_m = 0.1, turn_deg = 90 }]\n\
        [[markings]]\nside = \"both\"\nwidth_m = 0.02\ncolour = \"black\"\n";
    let found = warned(lane);
    assert!(
        found.len() == 1 && found[0].starts_with("mine.toml:4: markings:"),
        "{found:?}"
    );
    assert!(found[0].contains("tightest radius"), "{found:?}");
    let narrow = "lane_width_m = 0.05\n[path]\npoints = [[0, 0], [1, 0]]\n\
        [[markings]]\nside = \"both\"\nwidth_m = 0.01\ncolour = \"black\"\n";
    assert!(warned(narrow)[0].contains("narrower than every vehicle"));
    assert!(warned(PATH)[0].contains("nothing is painted"));
    let world = World::named("circuit-1").unwrap();
    let mut wide = VehicleSpec::named("picar").unwrap();
    wide.width_m = 0.4;
    assert!(
        world.check_vehicle(&wide)[0]
            .to_string()
            .contains("narrower than picar")
    );
}

#[test]
fn vehicle_messages_too() {
    let text = include_str!("../../../vehicles/gopigo.toml");
    let refused = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        VehicleSpec::parse("mine.toml", &text.replacen(from, to, 1))
            .unwrap_err()
            .to_string()
    };
    let message = refused("tilt_deg", "titl_deg");
    assert!(
        message.contains("cameras[0].mounting.titl_deg") && message.contains("did you mean"),
        "{message}"
    );
    let message = refused("horizontal_view_deg = 54", "horizontal_view_deg = 180");
    assert!(message.contains("from 1.145916 to 171"), "{message}");
    let message = refused("kind = \"differential\"", "kind = \"tank\"");
    assert!(message.contains("one of differential, ackermann"), "{message}");
    let message = refused("ticks_per_turn = 18", "ticks_per_turn = 18.5");
    assert!(message.contains("a whole number"), "{message}");
    assert!(VehicleSpec::parse("mine.toml", "").is_err());
    let missing = World::load(Path::new("no/such/world.toml"))
        .unwrap_err()
        .to_string();
    assert!(missing.starts_with("no/such/world.toml: "), "{missing}");
}

/// A diagnostic with the source line for terminals.
#[test]
fn diagnostics_show_the_line() {
    use miette::Diagnostic;
    let error = World::parse("mine.toml", &format!("lane_widht_m = 0.2\n{PATH}")).unwrap_err();
    let label = error.labels().unwrap().next().unwrap();
    assert_eq!((label.offset(), label.len()), (0, "lane_widht_m".len()));
    assert!(error.source_code().is_some());
    assert!(error.help().unwrap().to_string().contains("lane_width_m"));
}

/// Words that worlds are made of: nearer to the reader's branches than random letters.
fn word() -> impl Strategy<Value = String> {
    let words = [
        "[path]",
        "[floor]",
        "[light]",
        "[[markings]]",
        "[[things]]",
        "[[light.lamps]]",
        "closed = true",
        "reversed = true",
        "points = [[0, 0], [1, 0], [1, 1]]",
        "points = [[0, 0], [1e9, 0]]",
        "points = []",
        "pieces = [{ kind = \"arc\", radius_m = 0.001, turn_rad = 12 }, { kind = \"close\" }]",
        "pieces = [{ kind = \"clothoid\", length_m = 1e5, end_curvature_per_m = 1e3 }]",
        "pieces = [{ kind = \"straight\", length_m = 0.2 }, { kind = \"arc\", radius_m = 5, turn_deg = 359 }]",
        "width_m = 0.02",
        "colour = \"red\"",
        "colour = \"#é\"",
        "kind = \"wood\"",
        "kind = \"box\"",
        "x_m = 1",
        "y_m = inf",
        "height_m = 1",
        "length_m = 0.3",
        "station_m = -4",
        "lane_width_m = 100",
        "level = 1e-3",
        "preset = \"lamp\"",
        "along_lap = [{ lap_part = 0, level = 1 }]",
        "shadows = { strength = 1, scale_m = 0.01 }",
        "side = \"both\"",
        "dash = { length_m = 0.001, gap_m = 1e5 }",
        "double_gap_m = 0.01",
        "from_m = 0.5",
        "to_m = 0.1",
        "wear = 1",
        "texture = { kind = \"cells\", palette = [\"# red\"], rows = [\"#\"] }",
        "seed = 9223372036854775807",
        "\u{0}",
        "name = \"\\u0007\"",
        "margin_m = 100",
    ];
    prop_oneof![
        8 => prop::sample::select(words.to_vec()).prop_map(str::to_owned),
        1 => "[a-z_]{1,12} = [-0-9.e\\[\\]{}\"]{1,8}",
        1 => "\\PC{0,20}",
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn foreign_text_never_panics(lines in prop::collection::vec(word(), 0..16)) {
        let text = lines.join("\n");
        match World::parse("foreign.toml", &text) {
            Ok((world, _)) => {
                let (back, _) = World::parse("resolved.toml", &world.to_toml()).unwrap();
                prop_assert_eq!(&back, &world);
                let _ = world.clone().reversed().to_toml();
                let _ = world.light_level_at(0.3);
            }
            Err(WorldError::Invalid(problem)) => {
                prop_assert!(problem.line <= text.lines().count().max(1) + 1);
                prop_assert!(!problem.expected.is_empty() && !problem.found.is_empty());
            }
            Err(other) => prop_assert!(false, "{other}"),
        }
        let _ = VehicleSpec::parse("foreign.toml", &text);
    }

    #[test]
    fn damaged_library_files_never_panic(at in 0usize..1500, with in "\\PC{0,4}", cut in 0usize..40, pick in 0usize..4) {
        let texts = [
            include_str!("../../../worlds/unseen-3.toml"),
            include_str!("../../../worlds/circuit-4.toml"),
            include_str!("../../../vehicles/gopigo.toml"),
            include_str!("../../../vehicles/picar.toml"),
        ];
        let letters: Vec<char> = texts[pick].chars().collect();
        let at = at.min(letters.len());
        let text: String = letters[..at]
            .iter()
            .copied()
            .chain(with.chars())
            .chain(letters[(at + cut).min(letters.len())..].iter().copied())
            .collect();
        let _ = World::parse("damaged.toml", &text);
        let _ = VehicleSpec::parse("damaged.toml", &text);
    }
}
