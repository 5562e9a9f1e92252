//! A file's name and text, and what to say about a place in it.

use crate::{Problem, Table, Warning};
use miette::NamedSource;
use std::marker::PhantomData;
use std::ops::Range;
use toml::de::DeTable;

/// A file's name and text.
#[derive(Debug)]
pub struct Source<'a, E> {
    name: &'a str,
    text: &'a str,
    error: PhantomData<fn() -> E>,
}

impl<'a, E: From<Box<Problem>>> Source<'a, E> {
    /// A file by the name that complaints shall use.
    pub fn new(name: &'a str, text: &'a str) -> Self {
        Self {
            name,
            text,
            error: PhantomData,
        }
    }

    /// The name.
    pub fn name(&self) -> &'a str {
        self.name
    }

    /// The text.
    pub fn text(&self) -> &'a str {
        self.text
    }

    /// The line (from 1) of a byte.
    fn line(&self, at: usize) -> usize {
        1 + self.text.as_bytes()[..at.min(self.text.len())]
            .iter()
            .filter(|b| **b == b'\n')
            .count()
    }

    /// A complaint about a place in the file.
    pub fn problem(
        &self,
        span: Range<usize>,
        key: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
        help: impl Into<String>,
    ) -> E {
        let mut start = span.start.min(self.text.len());
        while !self.text.is_char_boundary(start) {
            start -= 1;
        }
        let line_start = self.text[..start].rfind('\n').map_or(0, |i| i + 1);
        E::from(Box::new(Problem {
            file: self.name.to_owned(),
            line: self.line(start),
            column: 1 + self.text[line_start..start].chars().count(),
            key: key.into(),
            expected: expected.into(),
            found: found.into(),
            help: help.into(),
            source_text: NamedSource::new(self.name, self.text.to_owned()),
            span: start..span.end.clamp(start, self.text.len()),
        }))
    }

    /// Something odd at a place in the file.
    pub fn warning(&self, at: usize, key: &str, message: impl Into<String>) -> Warning {
        Warning {
            file: self.name.to_owned(),
            line: Some(self.line(at)),
            key: key.to_owned(),
            message: message.into(),
        }
    }

    /// The whole file as a table.
    ///
    /// # Errors
    /// Where the text is not TOML.
    pub fn table(&'a self) -> Result<Table<'a, E>, E> {
        let parsed = DeTable::parse(self.text).map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            self.problem(
                span,
                "",
                "TOML",
                error.message(),
                "see https://toml.io for the syntax",
            )
        })?;
        let span = parsed.span();
        Ok(Table::new(self, String::new(), span, parsed.into_inner()))
    }
}
