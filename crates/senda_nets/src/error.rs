//! What can be wrong with a network file, told so that its writer can fix it.

use miette::{Diagnostic, LabeledSpan, SourceCode};
use thiserror::Error;

pub use senda_toml::Problem;
pub(crate) use senda_toml::nearest_names;

/// Why a network could not be used.
#[derive(Debug, Error)]
pub enum NetworkError {
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
    /// No ready network has this name.
    #[error("expected the name of a network, but found {found:?}; {help}")]
    UnknownName {
        /// The name that was asked for.
        found: String,
        /// The known names, nearest first (at most three).
        nearest: Vec<String>,
        /// What to do.
        help: String,
    },
}

impl NetworkError {
    pub(crate) fn unknown_name(found: &str, known: &[&str]) -> Self {
        let nearest = nearest_names(found, known);
        let help = match nearest.first() {
            Some(name) => format!("did you mean {name:?}? Known: {}", known.join(", ")),
            None => format!("known: {}", known.join(", ")),
        };
        Self::UnknownName {
            found: found.to_owned(),
            nearest,
            help,
        }
    }

    fn problem(&self) -> Option<&Problem> {
        match self {
            Self::Invalid(problem) => Some(problem),
            Self::Read { .. } | Self::UnknownName { .. } => None,
        }
    }
}

impl Diagnostic for NetworkError {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        self.problem().and_then(Diagnostic::help)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.problem().and_then(Diagnostic::source_code)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        self.problem().and_then(Diagnostic::labels)
    }
}
