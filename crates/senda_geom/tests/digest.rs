//! One golden for all of geometry, checked on x86-64 and aarch64: whatever moves a last bit moves it.

use senda_geom::{Camera, Curve, Homography, Lens, Mounting, Pose2, Segment, Tracker, Vec2, trig};

/// FNV-1a over the bits of numbers, in order.
struct Digest(u64);

impl Digest {
    fn add(&mut self, number: f64) {
        for byte in number.to_bits().to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn add_point(&mut self, point: Vec2) {
        self.add(point.x);
        self.add(point.y);
    }
}

fn circuit() -> Curve {
    let pieces = [
        Segment::straight(0.7),
        Segment::clothoid(0.4, 0.0, 2.5),
        Segment::arc(0.4, 2.2),
        Segment::clothoid(0.3, 2.5, -1.5),
        Segment::arc(0.9, -0.8),
    ];
    Curve::from_segments(Pose2::new(0.1, -0.2, 0.3), &pieces, 0.01, false).unwrap()
}

fn add_curves(digest: &mut Digest) {
    let points = [(0.0, 0.0), (1.1, 0.2), (1.7, 1.0), (0.4, 1.6), (-0.3, 0.7)].map(|(x, y)| Vec2::new(x, y));
    let spline = Curve::from_points(&points, true).unwrap();
    for curve in [circuit(), circuit().offset(0.13), spline.reversed(), spline] {
        let mut tracker = Tracker::new(0.0);
        for i in 0..200 {
            let pose = curve.pose_at(curve.length_m() * f64::from(i) / 200.0);
            digest.add_point(pose.position());
            digest.add(pose.heading_rad);
            let place = tracker.advance(&curve, pose.transform(Vec2::new(0.01, 0.05)));
            digest.add_point(Vec2::new(place.station_m, place.offset_m));
        }
    }
}

fn add_cameras(digest: &mut Digest) {
    let mounting = Mounting {
        x_m: 0.05,
        y_m: -0.01,
        z_m: 0.095,
        yaw_rad: 0.03,
        tilt_rad: 0.576,
        roll_rad: -0.02,
    };
    let pinhole = Lens::pinhole(160, 120, 0.942, 0.738);
    let wide = Lens::equidistant(160, 120, 2.1);
    let mut bent = wide;
    if let Lens::KannalaBrandt { distortion, .. } = &mut bent {
        *distortion = [-0.02, 0.003, 0.0, 0.0];
    }
    let brown = Lens::Brown {
        focal_u_px: 150.0,
        focal_v_px: 151.0,
        centre_u_px: 80.5,
        centre_v_px: 59.0,
        distortion: [-0.2, 0.05, 1e-3, -1e-3, 0.0],
    };
    for lens in [pinhole, wide, bent, brown] {
        let camera = Camera {
            name: "center".into(),
            width_px: 160,
            height_px: 120,
            lens,
            mounting,
        };
        let (mut pixels, mut floors) = (Vec::new(), Vec::new());
        for v in (61..120).step_by(7) {
            for u in (3..160).step_by(11) {
                let pixel = Vec2::new(f64::from(u), f64::from(v));
                if let Some(floor) = camera.floor_from_pixel(pixel) {
                    digest.add_point(floor);
                    digest.add_point(camera.pixel_from_floor(floor).unwrap_or(Vec2::ZERO));
                    pixels.push(pixel);
                    floors.push(floor);
                }
            }
        }
        let floor_from_image = Homography::fit(&pixels, &floors).unwrap();
        digest.add_point(floor_from_image.map(Vec2::new(80.0, 100.0)).unwrap());
    }
}

#[test]
fn the_digest_of_geometry_is_golden() {
    let mut digest = Digest(0xcbf2_9ce4_8422_2325);
    add_curves(&mut digest);
    add_cameras(&mut digest);
    let mut pose = Pose2::default();
    for i in 0..500 {
        let wave = trig::sin(f64::from(i) * 0.1);
        pose = pose.advance(0.13, 2.0 * wave, 0.05);
        digest.add_point(pose.position());
        digest.add(trig::atan2(wave, trig::exp(-wave)) + trig::tan(wave) + trig::pow(1.1, wave));
    }
    assert_eq!(digest.0, 0x0239_6f3a_c415_8b23, "new digest 0x{:016x}", digest.0);
}
