//! What can be wrong with a world or vehicle file, told so that its writer can fix it.

use miette::{Diagnostic, LabeledSpan, SourceCode};
use thiserror::Error;

pub(crate) use senda_toml::nearest_names;
pub use senda_toml::{Problem, Warning};

/// Why a world or vehicle file could not be used.
#[derive(Debug, Error)]
pub enum WorldError {
    /// The file could not be read.
    #[error("{file}: {reason}")]
    Read {
        /// Path as given.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// Something in the file is wrong. Also a [`Diagnostic`] with the source line.
    #[error(transparent)]
    Invalid(#[from] Box<Problem>),
    /// No world, vehicle or preset has this name.
    #[error("expected the name of a {what}, but found {found:?}; {help}")]
    UnknownName {
        /// `world`, `vehicle`, `floor` or `light`.
        what: &'static str,
        /// The name that was asked for.
        found: String,
        /// The known names, nearest first (at most three).
        nearest: Vec<String>,
        /// What to do.
        help: String,
    },
}

impl WorldError {
    pub(crate) fn unknown_name<'a>(
        what: &'static str,
        found: &str,
        known: impl Iterator<Item = &'a str>,
    ) -> Self {
        let all: Vec<&str> = known.collect();
        let nearest = nearest_names(found, &all);
        let help = match nearest.first() {
            Some(name) => format!("did you mean {name:?}? Known: {}", all.join(", ")),
            None => format!("known: {}", all.join(", ")),
        };
        Self::UnknownName {
            what,
            found: found.to_owned(),
            nearest,
            help,
        }
    }
}

impl Diagnostic for WorldError {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        match self {
            Self::Invalid(problem) => problem.help(),
            Self::Read { .. } | Self::UnknownName { .. } => None,
        }
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        match self {
            Self::Invalid(problem) => problem.source_code(),
            Self::Read { .. } | Self::UnknownName { .. } => None,
        }
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        match self {
            Self::Invalid(problem) => problem.labels(),
            Self::Read { .. } | Self::UnknownName { .. } => None,
        }
    }
}
