//! What can be wrong with a network file, told so that its writer can fix it.

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode};
use thiserror::Error;

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
    Invalid(Box<Problem>),
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

/// One thing that is wrong in a network file: where, what was expected, what was found, what to do.
#[derive(Debug, Error)]
#[error("{file}:{line}: {key}: expected {expected}, but found {found}{}", help_text(.help))]
pub struct Problem {
    /// Name of the file or other source.
    pub file: String,
    /// Line, counted from 1.
    pub line: usize,
    /// Column, counted from 1 in characters.
    pub column: usize,
    /// Full key, such as `layer[2].filters`; empty for the file as a whole.
    pub key: String,
    /// What would have been right.
    pub expected: String,
    /// What stands there.
    pub found: String,
    /// What to do; empty when that is obvious.
    pub help: String,
    pub(crate) source_text: NamedSource<String>,
    pub(crate) span: std::ops::Range<usize>,
}

fn help_text(help: &str) -> String {
    if help.is_empty() {
        String::new()
    } else {
        format!("; {help}")
    }
}

impl Diagnostic for Problem {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        (!self.help.is_empty()).then(|| Box::new(&self.help) as Box<dyn std::fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        Some(&self.source_text)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let label = LabeledSpan::new_with_span(
            Some(format!("expected {}", self.expected)),
            (self.span.start, self.span.len()),
        );
        Some(Box::new(std::iter::once(label)))
    }
}

/// The known names nearest to `found`, best first, at most three.
pub(crate) fn nearest_names(found: &str, known: &[&str]) -> Vec<String> {
    let mut scored: Vec<(f64, &str)> = known
        .iter()
        .map(|name| (strsim::normalized_damerau_levenshtein(found, name), *name))
        .filter(|(score, name)| *score > 0.4 || name.starts_with(found) && !found.is_empty())
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored
        .into_iter()
        .take(3)
        .map(|(_, name)| name.to_owned())
        .collect()
}
