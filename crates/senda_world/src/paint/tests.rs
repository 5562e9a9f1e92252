use super::*;
use crate::{Colour, Dash, FLOOR_PRESETS, Marking};

/// FNV-1a over the texels: small, and enough to notice a change.
fn digest(painting: &FloorPainting) -> u64 {
    painting
        .texels
        .iter()
        .flatten()
        .chain(&painting.outside)
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
        })
}

fn texel_at(painting: &FloorPainting, at: Vec2) -> [u8; 4] {
    let place = (at - painting.origin) / painting.metres_per_texel;
    painting.texels[place.y as usize * painting.width + place.x as usize]
}

fn mean(painting: &FloorPainting) -> f64 {
    let sum: u64 = painting.texels.iter().map(|t| u64::from(t[1])).sum();
    sum as f64 / painting.texels.len() as f64
}

#[test]
fn pictures_are_pinned() {
    let mut found = Vec::new();
    for floor in FLOOR_PRESETS {
        let mut world = World::named("oval").unwrap().with_floor(floor).unwrap();
        world = world.with_light("mixed").unwrap();
        world.markings[0].wear = 0.4;
        world.markings[0].stain = 0.4;
        found.push((floor, digest(&paint(&world, 0.01))));
    }
    let pinned: Vec<(&str, u64)> = vec![
        ("plain", 0x05c67decf10448e8),
        ("dark", 0x0ba12db6dbbb3e1a),
        ("speckled", 0x23e041d52ac2ec56),
        ("dark-speckled", 0x9c9ad8912a1b6f17),
        ("wood", 0x9e0df839b6245ad6),
        ("dark-wood", 0x4991e614d551321b),
        ("tiles", 0x8f54719378f20a52),
        ("carpet", 0x5355f7b2823bbabd),
        ("glossy", 0x13c5cd6f32b21b96),
        ("glossy-dark", 0x98f367386f6f4bc4),
        ("glossy-speckled", 0x5b5e4d1f85faa97d),
        ("glossy-dark-speckled", 0xa6e91c83231e9010),
        ("glossy-wood", 0x13ead669fb934ce8),
        ("glossy-tiles", 0x173a708406b9dde6),
    ];
    assert_eq!(found, pinned, "{found:#x?}");
}

#[test]
fn a_line_has_its_width_place_and_colour() {
    let mut world = World::named("straight").unwrap();
    world.floor.contrast = 0.0;
    world.markings = vec![Marking {
        gloss: 0.0,
        ..Marking::solid(0.10, 0.02, Colour::new(0, 0, 0))
    }];
    let painting = paint(&world, 0.001);
    // Darkness across the line adds up to its width, wherever its edges fall between texels.
    let dark: f64 = (0..400)
        .map(|i| {
            let y = -0.2 + (f64::from(i) + 0.5) * 0.001;
            let texel = texel_at(&painting, Vec2::new(3.0, y));
            0.001 * (1.0 - f64::from(texel[1]) / f64::from(painting.outside[1]))
        })
        .sum();
    assert!((dark - 0.02).abs() < 3e-4, "{dark}");
    assert!(texel_at(&painting, Vec2::new(3.0, 0.10))[1] < 3);
    assert!(
        texel_at(&painting, Vec2::new(3.0, -0.10))[1] > 150,
        "left is positive"
    );
    assert!(
        texel_at(&painting, Vec2::new(6.02, 0.10))[1] > 150,
        "it ends with the path"
    );
}

#[test]
fn dashes_cover_their_share() {
    let mut world = World::named("straight").unwrap();
    world.floor.contrast = 0.0;
    let dash = Dash {
        length_m: 0.1,
        gap_m: 0.05,
        phase_m: 0.02,
    };
    world.markings = vec![Marking {
        dash: Some(dash),
        ..Marking::solid(0.0, 0.02, Colour::new(0, 0, 0))
    }];
    let painting = paint(&world, 0.002);
    let dark = |x: f64| texel_at(&painting, Vec2::new(x, 0.0))[1] < 20;
    assert!(!dark(0.01) && dark(0.03) && dark(0.11) && !dark(0.13) && dark(0.18));
    let share = (0..3000).filter(|i| dark(f64::from(*i) * 0.002)).count() as f64 / 3000.0;
    assert!((share - 2.0 / 3.0).abs() < 0.02, "{share}");
}

#[test]
fn wear_removes_paint_and_stain_changes_it() {
    let mut world = World::named("oval").unwrap();
    let darkness = |world: &World| 255.0 - mean(&paint(world, 0.004));
    let fresh = darkness(&world);
    world.markings[0].wear = 0.5;
    let worn = darkness(&world);
    world.markings[0].wear = 1.0;
    let gone = darkness(&world);
    world.markings.clear();
    let bare = darkness(&world);
    let left = |value: f64| (value - bare) / (fresh - bare);
    assert!((0.2..0.8).contains(&left(worn)), "{}", left(worn));
    assert!(left(gone) < 0.12, "{}", left(gone));
}

#[test]
fn the_same_place_looks_the_same_at_any_margin_and_coarser_texels() {
    let world = World::named("oval").unwrap().with_floor("wood").unwrap();
    let mut wide = world.clone();
    wide.margin_m = 1.1;
    let (a, b) = (paint(&world, 0.004), paint(&wide, 0.004));
    // Light and unevenness hang on a grid that begins at the corner, so equality is near, not exact.
    for i in 0..50 {
        let at = Vec2::new(0.02 * f64::from(i), 0.013 * f64::from(i));
        let (p, q) = (texel_at(&a, at), texel_at(&b, at));
        assert!((0..3).all(|c| p[c].abs_diff(q[c]) <= 3), "{at} {p:?} {q:?}");
    }
    for floor in FLOOR_PRESETS {
        let world = world.clone().with_floor(floor).unwrap();
        let (fine, coarse) = (mean(&paint(&world, 0.003)), mean(&paint(&world, 0.012)));
        assert!((fine - coarse).abs() < 5.0, "{floor}: {fine} {coarse}");
        let outside = f64::from(paint(&world, 0.012).outside[1]);
        assert!((outside - coarse).abs() < 16.0, "{floor}: {outside} {coarse}");
    }
}

#[test]
fn light_falls_where_it_should() {
    let mut world = World::named("oval").unwrap();
    world.floor.contrast = 0.0;
    world.light.direction_rad = 0.0;
    world.light.gradient = 0.6;
    let painting = paint(&world, 0.01);
    let (low, high) = world.bounds();
    let y = high.y - 0.1;
    let (dark, bright) = (
        texel_at(&painting, Vec2::new(low.x + 0.05, y))[1],
        texel_at(&painting, Vec2::new(high.x - 0.05, y))[1],
    );
    // 0.4 of the light is 0.4^(1/2.2) = 0.66 of the encoded value.
    let ratio = f64::from(dark) / f64::from(bright);
    assert!((ratio - 0.66).abs() < 0.03, "{ratio}");

    let world = World::named("oval").unwrap().with_light("lamp").unwrap();
    let painting = paint(&world, 0.01);
    let lamp = world.light.lamps[0].position();
    assert!(texel_at(&painting, lamp)[1] > texel_at(&painting, world.bounds().0 + Vec2::splat(0.05))[1] + 20);
}

#[test]
fn reversing_a_world_leaves_its_floor_alone() {
    let mut world = World::named("oval").unwrap();
    world.markings[0].offset_m = 0.07;
    world.markings[0].span_m = Some((0.3, 3.0));
    world.markings[0].dash = Some(Dash {
        length_m: 0.1,
        gap_m: 0.07,
        phase_m: 0.03,
    });
    let (there, back) = (paint(&world, 0.004), paint(&world.clone().reversed(), 0.004));
    let differing = there
        .texels
        .iter()
        .zip(&back.texels)
        .filter(|(a, b)| (0..4).any(|c| a[c].abs_diff(b[c]) > 12))
        .count();
    assert!(differing < 20, "{differing}");
}

#[test]
fn a_huge_world_is_painted_coarsely() {
    let text = "[path]\npoints = [[0, 0], [300, 10], [310, 200], [0, 220]]\nclosed = true\n\
                [[markings]]\nwidth_m = 0.1\ncolour = \"white\"\n";
    let (world, warnings) = World::parse("road.toml", text).unwrap();
    assert!(
        warnings.len() == 1 && warnings[0].message.contains("mm a texel"),
        "{warnings:?}"
    );
    let painting = paint(&world, 0.5);
    assert_eq!(painting.metres_per_texel, 0.5);
    let (low, high) = world.bounds();
    let finest_m = ((high.x - low.x) * (high.y - low.y) / TEXEL_BUDGET as f64).sqrt();
    assert!(finest_m > 0.02 && finest_m < 0.05, "{finest_m}");
}

#[test]
fn a_long_narrow_world_is_painted_coarsely() {
    for length_m in [110.0, 125.0, 3000.0] {
        let text = format!(
            "[path]\nclosed = false\npieces = [{{ kind = \"straight\", length_m = {length_m} }}]\n\
             [[markings]]\nwidth_m = 0.018\ncolour = \"black\"\n"
        );
        let (world, _) = World::parse("long.toml", &text).unwrap();
        let (width, height) = Painter::new(&world, 0.001).size();
        assert!(
            width.max(height) <= LONGEST_SIDE,
            "{length_m} m: {width} x {height}"
        );
    }
}

#[test]
fn a_texel_is_the_same_in_every_window() {
    let lake = World::named("lake").unwrap();
    let lane = World::named("s-curves-lane").unwrap();
    let oval = |floor: &str| World::named("oval").unwrap().with_floor(floor).unwrap();
    for (world, texel_m) in [
        (oval("glossy-wood").with_light("mixed").unwrap(), 0.005),
        (oval("tiles").with_light("lamp").unwrap(), 0.005),
        (lane, 0.007),
        (World::named("warehouse").unwrap(), 0.01),
        (lake, 1.0),
    ] {
        let whole = paint(&world, texel_m);
        let painter = Painter::new(&world, texel_m);
        assert_eq!(painter.size(), (whole.width, whole.height));
        assert_eq!(painter.outside(), whole.outside);
        let mut brush = Brush::default();
        let mut texels = Vec::new();
        let (wide, high) = (whole.width.div_ceil(7), 37);
        for column in (0..whole.width).step_by(wide) {
            for row in (0..whole.height).step_by(high) {
                let window = Window {
                    columns: column..whole.width.min(column + wide),
                    rows: row..whole.height.min(row + high),
                };
                texels.resize(window.columns.len() * window.rows.len(), [0; 4]);
                painter.paint(&window, &mut brush, &mut texels);
                for (row, texels) in window.rows.zip(texels.chunks_exact(window.columns.len())) {
                    let same = &whole.texels[row * whole.width..][window.columns.clone()];
                    assert!(
                        texels == same,
                        "{}: row {row}, columns {:?}",
                        world.name,
                        window.columns
                    );
                }
            }
        }
    }
}
