//! Geometry for small ground vehicles: poses, angles, curves, cameras and homographies.
//!
//! ```
//! use senda_geom::{Curve, Pose2, Vec2};
//! let path = Curve::from_points(&[Vec2::new(0.0, 0.0), Vec2::new(2.0, 0.0)], false).unwrap();
//! let place = path.project(Vec2::new(0.5, 0.1));
//! assert!((place.station_m - 0.5).abs() < 1e-9);
//! assert!((place.offset_m - 0.1).abs() < 1e-9); // left of the path is positive
//! let goal_in_vehicle = Pose2::new(1.0, 0.0, 0.0).inverse().transform(Vec2::new(2.0, 0.0));
//! assert!((goal_in_vehicle.x - 1.0).abs() < 1e-12);
//! ```
//!
//! Conventions (DESIGN): SI units, radians, right-handed, x forward, y left, z up, counter-clockwise positive.
//! Images: u right, v down, pixel centres at integer + 0.5. Names say the frames: `world_from_vehicle`.
//!
//! This crate does not know files, clocks, devices or pixels' contents.

pub mod angle;
pub mod camera;
pub mod curve;
pub mod homography;
pub mod lens;
pub mod pose;
pub mod segment;
pub mod tracker;
pub mod trig;

mod spline;

pub use camera::{Camera, Mounting};
pub use curve::{Curve, CurveError, Place};
pub use glam::{DMat3 as Mat3, DVec2 as Vec2, DVec3 as Vec3};
pub use homography::Homography;
pub use lens::Lens;
pub use pose::Pose2;
pub use segment::Segment;
pub use tracker::Tracker;
