//! What is wrong in a file, told so that its writer can fix it.

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode};
use thiserror::Error;

/// One thing that is wrong in a file: where, what was expected, what was found, what to do.
#[derive(Debug, Error)]
#[error("{file}:{line}: {}expected {expected}, but found {found}{}", key_text(.key), help_text(.help))]
pub struct Problem {
    /// Name of the file or other source.
    pub file: String,
    /// Line, counted from 1.
    pub line: usize,
    /// Column, counted from 1 in characters.
    pub column: usize,
    /// Full key, such as `path.pieces[2].radius_m`; empty for the file as a whole.
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

fn key_text(key: &str) -> String {
    if key.is_empty() {
        String::new()
    } else {
        format!("{key}: ")
    }
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

/// Something in a file that is allowed but probably not meant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    /// Name of the file or other source.
    pub file: String,
    /// Line, counted from 1, where one can be named.
    pub line: Option<usize>,
    /// Full key; empty for the file as a whole.
    pub key: String,
    /// What is odd and what to do.
    pub message: String,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.file)?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if !self.key.is_empty() {
            write!(f, ": {}", self.key)?;
        }
        write!(f, ": {}", self.message)
    }
}

/// What serde says about an unknown key or word ("unknown field `a`, expected one of `b`, `c`"), with the nearest of the known
/// ones; every other message as it is.
pub fn with_nearest(message: &str) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    let is_unknown = message.contains("unknown field `") || message.contains("unknown variant `");
    let nearest = match quoted.next() {
        Some(found) if is_unknown => nearest_names(found, &quoted.collect::<Vec<_>>()),
        _ => Vec::new(),
    };
    match nearest.first() {
        Some(name) => format!("{message}; did you mean `{name}`?"),
        None => message.to_owned(),
    }
}

/// The known names nearest to `found`, best first, at most three.
pub fn nearest_names(found: &str, known: &[&str]) -> Vec<String> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn serdes_lists_of_known_keys_gain_the_nearest() {
        for (message, nearest) in [
            (
                "unknown field `lpas`, expected one of `world`, `laps`, `seed`",
                Some("laps"),
            ),
            (
                "unknown variant `documnet`, expected `document` or `shape`",
                Some("document"),
            ),
            ("unknown field `nmae`, expected one of `sheet`, `camera`", None),
            ("missing field `world`", None),
            ("invalid type: string \"a`b\", expected f64", None),
        ] {
            let said = with_nearest(message);
            match nearest {
                Some(name) => assert!(said.ends_with(&format!("; did you mean `{name}`?")), "{said}"),
                None => assert_eq!(said, message),
            }
        }
    }
}
