use super::colours::{ColourLimits, lightness, shrink};
use super::crossing::{Red, find, low_median};
use super::junction;
use super::trace::{Expected, Rings, Trace};
use senda_core::{Channels, Image};
use senda_geom::{Vec2, trig};

fn plain(value: [u8; 3]) -> Image {
    let mut image = Image::new(64, 48, Channels::Rgb);
    for pixel in image.pixels_mut().as_chunks_mut::<3>().0 {
        *pixel = value;
    }
    image
}

/// D4: a lamp, which would lie far away were it on the floor, does not move the low median.
#[test]
fn a_red_lamp_does_not_move_the_low_median() {
    let mut crossing: Vec<f64> = (0..100).map(|i| 0.30 + 0.0005 * f64::from(i)).collect();
    let alone = low_median(&mut crossing.clone()).unwrap();
    crossing.extend([2.5; 30]);
    assert!((low_median(&mut crossing).unwrap() - alone).abs() < 0.02);
    assert_eq!(low_median(&mut []), None);
}

/// D3: brighter light, lower limit of saturation.
#[test]
fn limits_follow_the_light() {
    assert!(lightness(&plain([220; 3])) > lightness(&plain([90; 3])) + 0.3);
    let limits = ColourLimits::default();
    let (dark, bright) = (limits.for_light(0.1), limits.for_light(0.9));
    assert!(dark.green.low[1] > bright.green.low[1] && dark.red.low[1] > bright.red.low[1]);
}

#[test]
fn shrinking_takes_means() {
    let mut image = plain([100, 0, 0]);
    image.row_mut(0)[0..3].copy_from_slice(&[140, 40, 0]);
    let mut small = Image::default();
    shrink(&image, 2, &mut small);
    assert_eq!((small.width(), small.height()), (32, 24));
    assert_eq!(small.pixel(0, 0), [110, 10, 0]);
    assert_eq!(small.pixel(1, 0), [100, 0, 0]);
}

/// Red between two bounds to the left (m), 8 cm deep from a distance on, aslant by a slope; 8 mm² each pixel.
fn red(left_m: [f64; 2], distance_m: f64, slope: f64) -> Vec<Red> {
    let count = ((left_m[1] - left_m[0]) / 0.002).round() as usize;
    (0..count)
        .flat_map(|i| (0..20).map(move |j| (i, j)))
        .map(|(i, j)| {
            let y = left_m[0] + 0.002 * (i as f64 + 0.5);
            Red {
                at: Vec2::new(distance_m + slope * y + 0.004 * f64::from(j), y),
                area_m2: 8e-6,
            }
        })
        .collect()
}

/// So many of a crossing's five bars, from the right.
fn bars(count: usize, distance_m: f64, slope: f64) -> Vec<Red> {
    (0..count)
        .map(|bar| -0.1 + 0.044 * bar as f64)
        .flat_map(|from_m| red([from_m, from_m + 0.022], distance_m, slope))
        .collect()
}

/// Bars seen aslant: distance and angle come out; a single bar or a spot is no crossing.
#[test]
fn crossings_of_points_are_measured() {
    for slope in [-0.3, -0.1, 0.0, 0.08, 0.3] {
        let crossing = find(&bars(5, 0.3, slope)).unwrap();
        assert!((crossing.distance_m - 0.3).abs() < 0.003, "{crossing:?}");
        assert!(
            (crossing.angle_rad + trig::atan(slope)).abs() < 0.02,
            "{crossing:?}"
        );
    }
    assert!(find(&bars(3, 0.3, 0.0)).is_some(), "what is seen of it");
    assert_eq!(find(&bars(1, 0.3, 0.0)), None);
    assert_eq!(find(&[]), None);
}

/// Dark wood is orange in warm light: some of its pixels beside the street counted as a crossing, before which the vehicle
/// then stood.
#[test]
fn red_beside_the_street_is_no_crossing_and_hides_none() {
    let mut sparse = red([0.1, 0.16], 0.24, 0.0);
    sparse.extend(red([-0.16, -0.1], 0.24, 0.0));
    let floor = sparse.clone();
    let mut count = 0;
    sparse.retain(|_| {
        count += 1;
        count % 5 == 0
    });
    assert!(sparse.len() > 200);
    // They begin before the crossing: its edge is its own.
    let mut both = sparse.clone();
    both.extend(bars(5, 0.29, 0.05));
    let crossing = find(&both).unwrap();
    assert!((crossing.distance_m - 0.29).abs() < 0.003, "{crossing:?}");
    assert!((crossing.angle_rad + 0.05).abs() < 0.02, "{crossing:?}");
    for (name, beside) in [("planks", floor), ("pixels of planks", sparse)] {
        assert_eq!(find(&beside), None, "{name}");
        let mut both = beside;
        both.extend(bars(5, 0.38, 0.0));
        let crossing = find(&both).unwrap_or_else(|| panic!("{name}"));
        assert!((crossing.distance_m - 0.38).abs() < 0.003, "{name}: {crossing:?}");
    }
    assert_eq!(find(&red([-0.16, 0.16], 0.3, 0.0)), None, "a carpet");
}

/// Far away a short piece's direction is anybody's guess; the line through both sides of the gap is not.
#[test]
fn a_junctions_far_line_continues_the_near_one() {
    for tilt in [-0.18, 0.0, 0.18] {
        let mut rings = Rings::default();
        let mut thick = |middle: Vec2| {
            for across in -3..=3 {
                rings.push(middle + Vec2::new(0.0, 0.003 * f64::from(across)));
            }
        };
        for i in 0..60 {
            let ahead_m = 0.27 + 0.005 * f64::from(i);
            // Straight for a while, then to the right.
            let right_m = if ahead_m > 0.42 {
                2.5 * (ahead_m - 0.42) * (ahead_m - 0.42)
            } else {
                0.0
            };
            thick(Vec2::new(ahead_m, 0.01 - right_m));
        }
        for i in 0..40 {
            let ahead_m = 1.05 + 0.005 * f64::from(i);
            thick(Vec2::new(ahead_m, 0.01 + tilt * (ahead_m - 1.15)));
        }
        rings.cluster();
        let mut line = Trace::default();
        rings.trace(Expected::default(), &mut line);
        let junction = junction::find(&rings, &line).unwrap();
        assert_eq!(junction.side, -1);
        for ahead_m in [0.5, 1.15] {
            let off_m = junction.beyond.left_at(ahead_m) - 0.01;
            assert!(off_m.abs() < 0.012, "{tilt}: {off_m} m at {ahead_m} m");
        }
    }
}
