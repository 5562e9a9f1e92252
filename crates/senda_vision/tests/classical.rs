//! The classical detector on drawn boards: seen aslant, in coloured light, on floors that are as light or as blue as they.

use senda_core::{Channels, Image};
use senda_vision::{ClassicalDetector, Detection, Detector, ObjectClass};
use senda_world::Texture;

/// A floor of one colour under a wall, and a board on it in coloured light: its left edge 60 px high, its right one `aslant` px
/// lower and as much shorter.
fn picture(texture: &Texture, floor: [u8; 3], light: [f64; 3], aslant: f64) -> Image {
    let mut image = Image::new(320, 240, Channels::Rgb);
    let lit = |rgb: [u8; 3]| {
        let mut shown = [0u8; 3];
        for (shown, (value, light)) in shown.iter_mut().zip(rgb.iter().zip(light)) {
            *shown = (f64::from(*value) * light).min(255.0) as u8;
        }
        shown
    };
    let (left, top, width, height) = (120.0, 40.0, 50.0, 60.0);
    for v in 0..240 {
        for u in 0..320 {
            let across = (u as f64 + 0.5 - left) / width;
            let (from, to) = (top + aslant * across, top + height);
            let down = (v as f64 + 0.5 - from) / (to - from);
            let inside = (0.0..1.0).contains(&across) && (0.0..1.0).contains(&down);
            let rgb = if inside {
                texture.colour_at(across, down, 1.0, 1.0).rgb
            } else {
                floor
            };
            image.row_mut(v)[3 * u..3 * u + 3].copy_from_slice(&lit(rgb));
        }
    }
    image
}

fn surest(image: &Image) -> Option<Detection> {
    ClassicalDetector::default().detect(image).first().copied()
}

#[test]
fn digits_are_told_whatever_the_floor_the_light_and_the_angle() {
    let cases = [
        ("grey floor", [120, 120, 120], [1.0, 1.0, 1.0], 0.0),
        (
            "bluish floor, seed 3's failure",
            [112, 120, 142],
            [1.0, 1.0, 1.0],
            4.0,
        ),
        (
            "warm light on a light floor: the board is greenish",
            [225, 220, 210],
            [1.0, 0.80, 0.52],
            4.0,
        ),
        ("warm light on wood", [200, 160, 110], [1.0, 0.85, 0.60], -4.0),
        ("dark, aslant", [70, 70, 70], [0.5, 0.5, 0.5], 14.0),
    ];
    for (name, floor, light, aslant) in cases {
        for number in 0..10u8 {
            let found = surest(&picture(&Texture::sign(number), floor, light, aslant));
            let class = found.map(|one| one.class);
            assert_eq!(
                class,
                Some(ObjectClass::Sign(number)),
                "{name}, {number}: {found:?}"
            );
        }
    }
}

/// Behind the board a street with its green line: in the light of a low sun both are as blue, against the floor, as the board,
/// and far away what is left of the line has the board's own colour.
#[test]
fn a_digit_before_a_street_is_told_at_sunset() {
    let light = [1.0, 0.745, 0.51];
    for number in 0..10u8 {
        let mut image = picture(&Texture::sign(number), [155, 146, 150], light, 0.0);
        let bare = image.clone();
        for v in 55..85usize {
            let street = if (66..74).contains(&v) {
                [40.0, 150.0, 90.0]
            } else {
                [84.0, 82.0, 98.0]
            };
            for u in (0..118).chain(172..320) {
                let lit = [0, 1, 2].map(|channel| (street[channel] * light[channel]) as u8);
                image.row_mut(v)[3 * u..3 * u + 3].copy_from_slice(&lit);
            }
            let far = if (66..68).contains(&v) { 290 } else { 172 };
            for u in (118..120).chain(170..far) {
                let board = bare.pixel(124, 50).to_vec();
                image.row_mut(v)[3 * u..3 * u + 3].copy_from_slice(&board);
            }
        }
        let class = surest(&image).map(|one| one.class);
        assert_eq!(class, Some(ObjectClass::Sign(number)));
    }
}

/// What a crossing's bars are: red, and below each the street.
#[test]
fn a_crossings_bars_are_no_lights() {
    let mut image = Image::new(320, 240, Channels::Rgb);
    image.pixels_mut().fill(70);
    for bar in 0..5usize {
        for v in 90..108 {
            let from = 80 + 34 * bar;
            for u in from..from + 17 {
                image.row_mut(v)[3 * u..3 * u + 3].copy_from_slice(&[204, 30, 38]);
            }
        }
    }
    let found = ClassicalDetector::default().detect(&image).to_vec();
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn lights_are_told_by_their_lit_lamp_and_the_dark_one() {
    let program = senda_world::LightProgram {
        green_s: 5.0,
        red_s: 5.0,
        offset_s: 0.0,
    };
    let looks = Texture::light(program).looks();
    for (look, class) in looks.iter().zip([ObjectClass::RedLight, ObjectClass::GreenLight]) {
        // Boards of 50 x 60 px hold it as a stretched picture: here it is drawn upright in the middle third.
        let mut image = picture(look, [140, 135, 130], [1.0, 0.9, 0.8], 0.0);
        let wide = image.clone();
        for v in 40..100 {
            for u in 0..320 {
                let source = 120 + (u as i64 - 132) * 2;
                let inside = (132..157).contains(&u);
                let from = if inside { source as usize } else { 10 };
                let pixel = wide.pixel(from, v).to_vec();
                image.row_mut(v)[3 * u..3 * u + 3].copy_from_slice(&pixel);
            }
        }
        assert_eq!(surest(&image).map(|one| one.class), Some(class));
    }
}
