//! Pieces that continue each other become one line (C17 in SPEC).

mod support;

use senda_vision::{
    BlobLimits, Contrast, ExtractorOptions, FloorMap, JoinLimits, LineBlob, LineExtractor, LineFitter,
    LineJoiner, LineState, WidthProfile,
};
use support::{Floor, Line, gopigo_camera, render};

struct Scene {
    extractor: LineExtractor,
    joiner: LineJoiner,
    map: FloorMap,
}

impl Scene {
    fn new(width: u32, height: u32) -> Self {
        let camera = gopigo_camera(width, height);
        let profile = WidthProfile::from_camera(&camera, 0.02);
        let (width, height) = (width as usize, height as usize);
        Self {
            extractor: LineExtractor::new(width, height, &profile, ExtractorOptions::default()),
            joiner: LineJoiner::new(JoinLimits::default()),
            map: FloorMap::from_camera(&camera, width, height),
        }
    }

    fn lines(&mut self, floor: &Floor, lines: &[Line]) -> Vec<LineBlob> {
        let camera = gopigo_camera(self.map.width() as u32, self.map.height() as u32);
        let image = render(&camera, floor, lines);
        let blobs = self.extractor.extract(&image, Contrast::Dark).to_vec();
        let fragments = self.extractor.fragments();
        self.joiner
            .join(&blobs, fragments, &self.map, &BlobLimits::default())
            .to_vec()
    }

    fn state(&self, line: &LineBlob) -> LineState {
        LineFitter::new()
            .arc([line], &self.map)
            .expect("a joined line has points")
            .state()
    }
}

const FLOOR: f64 = 170.0;
const TAPE: f64 = 45.0;

#[test]
fn dashes_become_the_line_that_they_are() {
    for (width, height) in [(160, 120), (320, 240)] {
        let mut scene = Scene::new(width, height);
        for dash_m in [(0.06, 0.04), (0.04, 0.04), (0.03, 0.06)] {
            for (d_m, theta_rad, curvature_per_m) in [
                (0.0, 0.0, 0.0),
                (0.02, 0.2, 0.0),
                (0.0, 0.0, 1.0),
                (0.0, 0.0, -2.0),
            ] {
                let line = Line {
                    dash_m: Some(dash_m),
                    curvature_per_m,
                    ..Line::straight(d_m, theta_rad, TAPE)
                };
                let place = format!("{width}x{height} {line:?}");
                let joined = scene.lines(
                    &Floor {
                        speckle: 20.0,
                        ..Floor::plain(FLOOR)
                    },
                    &[line],
                );
                assert_eq!(joined.len(), 1, "{place}");
                let state = scene.state(&joined[0]);
                assert!((state.d_m - d_m).abs() < 2e-3, "{place}: {state:?}");
                assert!(
                    (state.theta_rad - theta_rad).abs() < 1f64.to_radians(),
                    "{place}: {state:?}"
                );
                assert!(
                    (state.curvature_per_m - curvature_per_m).abs() < 0.2,
                    "{place}: {state:?}"
                );
            }
        }
    }
}

#[test]
fn a_lane_of_a_whole_and_a_dashed_line_keeps_them_apart() {
    let mut scene = Scene::new(320, 240);
    let dashed = Line {
        dash_m: Some((0.06, 0.04)),
        ..Line::straight(0.05, 0.0, TAPE)
    };
    let whole = Line::straight(-0.05, 0.0, TAPE);
    let joined = scene.lines(&Floor::plain(FLOOR), &[dashed, whole]);
    assert_eq!(joined.len(), 2);
    let mut offsets: Vec<f64> = joined.iter().map(|line| scene.state(line).d_m).collect();
    offsets.sort_by(f64::total_cmp);
    assert!(
        (offsets[0] + 0.05).abs() < 2e-3 && (offsets[1] - 0.05).abs() < 2e-3,
        "{offsets:?}"
    );
}

#[test]
fn whole_lines_pass_unchanged() {
    let mut scene = Scene::new(160, 120);
    let image = render(
        &gopigo_camera(160, 120),
        &Floor::plain(FLOOR),
        &[Line::straight(0.01, 0.1, TAPE)],
    );
    let blobs = scene.extractor.extract(&image, Contrast::Dark).to_vec();
    let fragments = scene.extractor.fragments().to_vec();
    assert_eq!(
        scene
            .joiner
            .join(&blobs, &fragments, &scene.map, &BlobLimits::default()),
        &blobs[..]
    );
}

#[test]
fn speckles_seldom_make_a_line() {
    let mut scene = Scene::new(160, 120);
    let found: usize = (0..12)
        .map(|seed| {
            let floor = Floor {
                speckle: 40.0,
                noise: 4.0,
                seed,
                ..Floor::plain(140.0)
            };
            scene.lines(&floor, &[]).len()
        })
        .sum();
    assert!(found <= 1, "{found} of 12");
}

#[test]
fn joined_moments_are_those_of_all_pixels() {
    // The same line once whole, once joined from its halves.
    let map = FloorMap::from_camera(&gopigo_camera(160, 120), 160, 120);
    let mut scene = Scene::new(160, 120);
    let image = render(
        &gopigo_camera(160, 120),
        &Floor::plain(FLOOR),
        &[Line::straight(0.0, 0.2, TAPE)],
    );
    let whole = scene.extractor.extract(&image, Contrast::Dark)[0].clone();
    let mut cut = image.clone();
    for y in 44..50 {
        cut.row_mut(y).fill(FLOOR as u8);
    }
    let blobs = scene.extractor.extract(&cut, Contrast::Dark).to_vec();
    let fragments = scene.extractor.fragments().to_vec();
    assert!(
        blobs.len() + fragments.len() >= 2,
        "the cut did not part the line"
    );
    let joined = &scene
        .joiner
        .join(&blobs, &fragments, &map, &BlobLimits::default())[0];
    for (joined, whole) in joined.bounds.iter().zip(whole.bounds) {
        assert!((joined - whole).abs() <= 1.0);
    }
    assert!((joined.centroid - whole.centroid).length() < 2.0);
    assert!((joined.orientation_rad - whole.orientation_rad).abs() < 0.02);
    assert!((joined.ellipticity / whole.ellipticity - 1.0).abs() < 0.1);
}
