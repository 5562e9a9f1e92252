use super::colours::{ColourLimits, lightness, shrink};
use super::crossing::{find, low_median};
use super::junction;
use super::trace::{Expected, Rings, Trace};
use senda_core::{Channels, Image};
use senda_geom::Vec2;

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

/// Bars seen aslant: distance and angle come out; a single bar or a spot is no crossing.
#[test]
fn crossings_of_points_are_measured() {
    let bars = |count: usize, slope: f64| -> Vec<Vec2> {
        (0..count)
            .flat_map(|bar| (0..11).map(move |i| (bar, i)))
            .flat_map(|(bar, i)| (0..20).map(move |j| (bar, i, j)))
            .map(|(bar, i, j)| {
                let y = -0.1 + 0.044 * bar as f64 + 0.002 * f64::from(i);
                Vec2::new(0.3 + slope * y + 0.004 * f64::from(j), y)
            })
            .collect()
    };
    for slope in [-0.1, 0.0, 0.08] {
        let crossing = find(&bars(5, slope)).unwrap();
        assert!((crossing.distance_m - 0.3).abs() < 0.003, "{crossing:?}");
        assert!((crossing.angle_rad + slope).abs() < 0.02, "{crossing:?}");
    }
    assert_eq!(find(&bars(1, 0.0)), None);
    assert_eq!(find(&[]), None);
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
