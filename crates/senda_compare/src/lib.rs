//! Networks compared by how they really drive (document B): laps are recorded, networks trained several times each, and every one of
//! them driven; tables, intervals, tests and verdicts come from that.
//!
//! ```
//! use senda_compare::{PartOf, Plan};
//! let plan = Plan::preset("document-b").unwrap();
//! assert!(plan.rows.iter().any(|row| row.identity() == "TinyPilotNet/steering"));
//! // A quarter of the work, for one of four machines.
//! assert_eq!("2/4".parse::<PartOf>().unwrap().to_string(), "2/4");
//! assert!("5/4".parse::<PartOf>().is_err());
//! ```
//!
//! A [`Plan`] becomes jobs: record a lap, prepare frames, train a network, measure its offline error, drive a lap. Each makes one file
//! named by a hash of everything that it depends on, so a comparison that was interrupted goes on where it stopped, parts of it can
//! be done on other machines and joined by [`merge`], and a plan that changes keeps what still holds. [`Comparison`] does the
//! work, [`Results`] judges it.
//!
//! This crate does not know the command line and reads no clock itself; how laps are driven and networks trained is `senda_run`'s and
//! `senda_learn`'s business.

mod error;
mod figure;
mod folder;
mod job;
mod plan;
mod plots;
mod read;
mod results;
mod tables;
mod work;

pub use error::CompareError;
pub use figure::Figure;
pub use folder::{Amount, Comparison, PartOf, merge};
pub use plan::{
    Claim, ClaimPart, Condition, Control, Data, Judging, LessonPlan, Plan, Published, Purpose, Relation, Row,
};
pub use plots::{Laps, Shown};
pub use results::{Beside, Judged, JudgedPart, MATTERS, Results, Spread, Trained, Verdict};
pub use work::{Cost, Crew, Done, Offline, OfflineAnswer, Progress};
