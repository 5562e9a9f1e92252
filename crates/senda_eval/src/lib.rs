//! Judges a drive: metrics that leaving the road never improves, plots, and reports as single HTML files.
//!
//! ```
//! use senda_core::{Stamp, Truth};
//! use senda_eval::{Course, measure};
//! use senda_geom::{Curve, Pose2, Vec2};
//! // A vehicle drives two metres along a straight road, 3 cm to the left of its middle.
//! let road = Curve::from_points(&[Vec2::ZERO, Vec2::new(2.0, 0.0)], false).unwrap();
//! let drive: Vec<Truth> = (0..=40)
//!     .map(|i| Truth {
//!         stamp: Stamp::from_s(0.1 * f64::from(i)),
//!         world_from_vehicle: Pose2::new(0.05 * f64::from(i), 0.03, 0.0),
//!         ..Truth::default()
//!     })
//!     .collect();
//! let course =
//!     Course { path: &road, corridor_half_width_m: 0.15, start_station_m: 0.0, laps: Some(1.0), open_end_m: 0.0 };
//! let found = measure(&course, &drive);
//! assert!(found.completed && found.departures == 0);
//! assert!((found.lane_error.unwrap().mean - 0.03).abs() < 1e-9);
//! ```
//!
//! [`metrics`] are pure functions over true poses (B7 and B8 in SPEC, laps, departures, smoothness), [`mod@agreement`]
//! compares two drivers on the same frames, [`odometry`] reckons
//! a path from the wheels alone (C14), [`statistics`] gives rates and means their intervals, [`paired`] tests
//! what two did with the same seed, [`Summary`] is one run in
//! figures, [`plot`] draws SVG, [`report`] makes the pages.
//!
//! This crate does not know how a recording came about: the same code judges the simulator's run and a robot's. It reads
//! and writes no files and prints nothing.

pub mod agreement;
pub mod delivery;
pub mod metrics;
pub mod odometry;
pub mod paired;
pub mod plot;
pub mod report;
pub mod statistics;
pub mod summary;
pub mod text;

pub use agreement::{Agreement, agreement};
pub use delivery::{Delivery, DeliveryRules};
pub use metrics::{Course, Metrics, measure};
pub use odometry::{Odometer, OdometryError};
pub use summary::Summary;
