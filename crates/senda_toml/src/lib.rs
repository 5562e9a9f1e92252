//! TOML files read key by key, so that every complaint names file, line and key, says what was expected and what was
//! found, and no key goes unnoticed.
//!
//! ```
//! use senda_toml::{Problem, Source};
//! let source = Source::<Box<Problem>>::new("track.toml", "lenght_m = 3.0\n");
//! let mut table = source.table()?;
//! let problem = table.required_f64("length_m", 0.0, 100.0).unwrap_err();
//! assert_eq!((problem.line, problem.help.as_str()), (1, "did you mean \"length_m\"?"));
//! # Ok::<(), Box<Problem>>(())
//! ```
//!
//! The errors are the caller's own: anything that can be made from a boxed [`Problem`]. This crate does not know what any
//! key means. Files that need no more than serde's errors are read with `toml` and serde.

mod lists;
mod problem;
mod source;
mod table;
mod values;

pub use problem::{Problem, Warning, nearest_names, with_nearest};
pub use source::Source;
pub use table::Table;
pub use values::WordOrNumbers;
