//! Drawings are well-formed, prints are at true scale and complete.

use senda_world::draw::{self, CannotPrint, Ink, Paper, Print, PrintOptions};
use senda_world::{Difficulty, Texture, Thing, ThingShape, World, paint};

#[test]
fn every_world_can_be_drawn() {
    for name in World::names() {
        let world = World::named(name).unwrap();
        let svg = draw::svg(&world);
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("start") && svg.contains(&format!(">{name}<")));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert!(svg.len() < 400_000, "{name}: {}", svg.len());
    }
    let busy = World::random(
        4,
        &Difficulty {
            things: 5,
            ..Difficulty::lane()
        },
    );
    assert!(draw::svg(&busy).len() > 1000);
}

#[test]
fn a_png_has_the_paintings_size() {
    let painting = paint::paint(&World::named("oval").unwrap(), 0.02);
    let bytes = draw::png(&painting);
    assert_eq!(&bytes[1..4], b"PNG");
    let number = |at: usize| u32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    assert_eq!(
        (number(16) as usize, number(20) as usize),
        (painting.width, painting.height)
    );
}

#[test]
fn a_print_has_the_sheets_that_its_length_needs() {
    let world = World::named("straight").unwrap();
    let print = |paper, landscape| {
        let options = PrintOptions {
            paper,
            landscape,
            ..PrintOptions::default()
        };
        Print::new(&world, &options).unwrap()
    };
    // 6 m over sheets of 210 - 24 mm, 297 - 24 mm and 420 - 24 mm.
    assert_eq!(print(Paper::A4, false).grid(), (33, 1));
    assert_eq!(print(Paper::A4, true).grid(), (23, 1));
    assert_eq!(print(Paper::A3, true).grid(), (16, 1));
    assert_eq!(print(Paper::A3, true).sheet_count(), 16);
    let oval = Print::new(&World::named("oval").unwrap(), &PrintOptions::default()).unwrap();
    let (columns, rows) = oval.grid();
    assert!(oval.sheet_count() < columns * rows, "blank sheets are left out");
    let pdf = String::from_utf8(print(Paper::A3, true).pdf()).unwrap();
    assert_eq!(pdf.matches("/Type /Page ").count(), 16);
    // 420 x 297 mm in points, and a viewer that is asked not to scale.
    assert!(pdf.contains("/MediaBox [0 0 1190.551 841.89]"), "{}", &pdf[..600]);
    assert!(pdf.contains("/PrintScaling /None"));
    // Every object begins where the table says.
    let table = pdf
        .rfind("startxref\n")
        .map(|at| pdf[at + 10..].lines().next().unwrap())
        .unwrap();
    let table: usize = table.parse().unwrap();
    for (i, line) in pdf[table..]
        .lines()
        .skip(3)
        .take_while(|line| line.ends_with(" n "))
        .enumerate()
    {
        let at: usize = line[..10].parse().unwrap();
        assert!(pdf[at..].starts_with(&format!("{} 0 obj", i + 1)));
    }
}

/// The sum of what the sheets show is the circuit: the line's length over all sheets, in millimetres of paper, is the
/// line's length on the floor.
#[test]
fn a_print_is_at_true_scale() {
    let world = World::named("straight").unwrap();
    let print = Print::new(&world, &PrintOptions::default()).unwrap();
    let mut covered_mm = 0.0;
    for (_, svg) in print.svg() {
        assert!(svg.contains("width=\"210mm\" height=\"297mm\" viewBox=\"0 0 210 297\""));
        // The marking is the only stroke of 18 mm; the clip rectangle is the tile.
        let tile = svg.split("<clipPath").nth(1).unwrap();
        let value = |name: &str| -> f64 {
            let rest = tile.split(&format!("{name}=\"")).nth(1).unwrap();
            rest.split('"').next().unwrap().parse().unwrap()
        };
        let (left, right) = (value("x"), value("x") + value("width"));
        let line = svg
            .lines()
            .find(|line| line.contains("stroke-width=\"18\""))
            .unwrap();
        let points: Vec<f64> = line
            .split("d=\"M")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap()
            .split('L')
            .map(|point| point.split(' ').next().unwrap().parse().unwrap())
            .collect();
        covered_mm += points.last().unwrap().min(right) - points[0].max(left);
        // The ruler: from 0 to 10 cm are 100 mm.
        let ticks: Vec<&str> = svg
            .lines()
            .filter(|line| line.contains("stroke-width=\"0.12\""))
            .collect();
        assert!(ticks.len() >= 101);
    }
    assert!((covered_mm - 6000.0).abs() < 0.05, "{covered_mm}");
}

#[test]
fn outlines_take_two_lines_and_huge_prints_are_refused() {
    let world = World::named("oval").unwrap();
    let options = PrintOptions {
        ink: Ink::Outline,
        ..PrintOptions::default()
    };
    let sheet = Print::new(&world, &options).unwrap().svg()[0].1.clone();
    assert!(sheet.matches("stroke-width=\"0.3\"").count() >= 2);
    assert!(!sheet.contains("stroke-width=\"18\""));
    let text =
        "[path]\npoints = [[0, 0], [5000, 0], [9000, 9000]]\n[[markings]]\nwidth_m = 0.1\ncolour = \"red\"\n";
    let (road, _) = World::parse("road.toml", text).unwrap();
    assert!(matches!(
        Print::new(&road, &PrintOptions::default()),
        Err(CannotPrint::TooLarge { .. })
    ));
    let mut bare = world;
    bare.markings.clear();
    assert!(matches!(
        Print::new(&bare, &PrintOptions::default()),
        Err(CannotPrint::Nothing)
    ));
}

#[test]
fn a_boards_face_reads_from_left_to_right() {
    let text = "[path]\npoints = [[0, 0], [2, 0]]\n[[things]]\nkind = \"board\"\nwidth_m = 0.2\nheight_m = 0.1\nbottom_m = 0.05\n\
        station_m = 1.0\noffset_m = 0.3\ntexture = { kind = \"cells\", palette = [\"r red\", \"b blue\"], rows = [\"rb\", \"bb\"] }\n";
    let (world, _) = World::parse("sign.toml", text).unwrap();
    let thing: &Thing = &world.things[0];
    assert!(matches!(thing.shape, ThingShape::Board { .. }));
    let front = &thing.faces()[0];
    // It faces the vehicles that come along (-x); their right is -y.
    assert!((front.normal.x + 1.0).abs() < 1e-9 && (front.right.y + 1.0).abs() < 1e-9);
    assert!((front.corner.y - 0.4).abs() < 1e-9 && (front.corner.z - 0.15).abs() < 1e-9);
    let Texture::Cells(_) = &front.texture else {
        panic!("expected cells")
    };
    let colour = |right: f64, down: f64| front.texture.colour_at(right, down, 0.2, 0.1).to_string();
    assert_eq!(
        [colour(0.05, 0.02), colour(0.15, 0.02), colour(0.05, 0.08)],
        ["#c82428", "#2450be", "#2450be"]
    );
    assert_eq!(World::parse("back.toml", &world.to_toml()).unwrap().0, world);
}

/// A wide, short marking's sheets were those of a square around it, blank ones among them.
#[test]
fn sheets_without_paint_are_left_out() {
    let text = "[path]\npieces = [{ kind = \"straight\", length_m = 1 }]\n[[markings]]\nwidth_m = 0.3\ncolour = \"red\"\n\
                from_m = 0.5\nto_m = 0.6\n";
    let (world, _) = World::parse("bar.toml", text).unwrap();
    let print = Print::new(&world, &PrintOptions::default()).unwrap();
    // Two sheets of 186 mm share its 10 cm, three of 273 mm its 30 cm.
    assert_eq!((print.grid(), print.sheet_count()), ((4, 3), 6));
}
