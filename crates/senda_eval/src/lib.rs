//! Judges a drive: metrics as pure functions, plots, and reports as single HTML files.
//!
//! (being written)

pub mod agreement;
pub mod metrics;
pub mod plot;
pub mod report;
pub mod statistics;
pub mod summary;
pub mod text;

pub use agreement::{Agreement, agreement};
pub use metrics::{Course, Metrics, measure};
pub use summary::Summary;
