//! Reading TOML tables with positions: every complaint can point at its line, and no key goes unnoticed.

use crate::error::{NetworkError, Problem, nearest_names};
use miette::NamedSource;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A file's name and text.
#[derive(Debug)]
pub(crate) struct Source<'a> {
    pub(crate) name: &'a str,
    pub(crate) text: &'a str,
}

impl<'a> Source<'a> {
    pub(crate) fn problem(
        &self,
        span: Range<usize>,
        key: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
        help: impl Into<String>,
    ) -> NetworkError {
        let mut start = span.start.min(self.text.len());
        while !self.text.is_char_boundary(start) {
            start -= 1;
        }
        let line_start = self.text[..start].rfind('\n').map_or(0, |i| i + 1);
        NetworkError::Invalid(Box::new(Problem {
            file: self.name.to_owned(),
            line: 1 + self.text[..start].matches('\n').count(),
            column: 1 + self.text[line_start..start].chars().count(),
            key: key.into(),
            expected: expected.into(),
            found: found.into(),
            help: help.into(),
            source_text: NamedSource::new(self.name, self.text.to_owned()),
            span: start..span.end.clamp(start, self.text.len()),
        }))
    }

    /// The whole file as a table.
    pub(crate) fn table(&'a self) -> Result<Table<'a>, NetworkError> {
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

struct Entry<'a> {
    key: String,
    key_span: Range<usize>,
    value: Option<Spanned<DeValue<'a>>>,
}

/// A table that is being read: every accessor takes its key out, [`Table::finish`] complains about the rest.
pub(crate) struct Table<'a> {
    source: &'a Source<'a>,
    path: String,
    span: Range<usize>,
    entries: Vec<Entry<'a>>,
    known: Vec<&'static str>,
}

impl<'a> Table<'a> {
    fn new(source: &'a Source<'a>, path: String, span: Range<usize>, table: DeTable<'a>) -> Self {
        let entries = table
            .into_iter()
            .map(|(key, value)| Entry {
                key_span: key.span(),
                key: key.into_inner().into_owned(),
                value: Some(value),
            })
            .collect();
        Self {
            source,
            path,
            span,
            entries,
            known: Vec::new(),
        }
    }

    fn key_path(&self, key: &str) -> String {
        match (self.path.is_empty(), key.is_empty()) {
            (true, _) => key.to_owned(),
            (_, true) => self.path.clone(),
            _ => format!("{}.{key}", self.path),
        }
    }

    /// Where the table stands.
    pub(crate) fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    /// A complaint about a key of this table, or about the table itself.
    pub(crate) fn problem(
        &self,
        key: &str,
        expected: impl Into<String>,
        found: impl Into<String>,
        help: impl Into<String>,
    ) -> NetworkError {
        let span = self
            .entries
            .iter()
            .find(|entry| entry.key == key)
            .map_or(self.span.clone(), |entry| entry.key_span.clone());
        self.source
            .problem(span, self.key_path(key), expected, found, help)
    }

    fn take(&mut self, key: &'static str) -> Option<Spanned<DeValue<'a>>> {
        self.known.push(key);
        self.entries
            .iter_mut()
            .find(|entry| entry.key == key)
            .and_then(|entry| entry.value.take())
    }

    /// The key is needed and absent. If a similar unknown key stands there, that is the mistake.
    pub(crate) fn missing(&self, key: &'static str, expected: &str) -> NetworkError {
        let similar = self.entries.iter().find(|entry| {
            entry.value.is_some()
                && !self.known.contains(&entry.key.as_str())
                && strsim::normalized_damerau_levenshtein(&entry.key, key) > 0.6
        });
        match similar {
            Some(entry) => self.source.problem(
                entry.key_span.clone(),
                self.key_path(&entry.key),
                format!("the key {key:?}"),
                format!("the unknown key {:?}", entry.key),
                format!("did you mean {key:?}?"),
            ),
            None => self.source.problem(
                self.span.clone(),
                self.key_path(key),
                expected,
                "nothing",
                format!("add {key}"),
            ),
        }
    }

    fn wrong(&self, key: &str, value: &Spanned<DeValue>, expected: impl Into<String>) -> NetworkError {
        let found = shown(value.get_ref());
        self.source
            .problem(value.span(), self.key_path(key), expected, found, "")
    }

    pub(crate) fn optional_f32(
        &mut self,
        key: &'static str,
        lowest: f32,
        highest: f32,
    ) -> Result<Option<f32>, NetworkError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let number = match value.get_ref() {
            DeValue::Float(float) => float.as_str().replace('_', "").parse::<f32>().ok(),
            DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix())
                .ok()
                .map(|whole| whole as f32),
            _ => None,
        };
        match number {
            Some(number) if number >= lowest && number <= highest => Ok(Some(number + 0.0)),
            _ => Err(self.wrong(key, &value, format!("a number from {lowest} to {highest}"))),
        }
    }

    pub(crate) fn optional_whole(
        &mut self,
        key: &'static str,
        lowest: usize,
        highest: usize,
    ) -> Result<Option<usize>, NetworkError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        match whole(value.get_ref()) {
            Some(number) if (lowest..=highest).contains(&number) => Ok(Some(number)),
            _ => Err(self.wrong(key, &value, whole_text(lowest, highest))),
        }
    }

    pub(crate) fn required_whole(
        &mut self,
        key: &'static str,
        lowest: usize,
        highest: usize,
    ) -> Result<usize, NetworkError> {
        match self.optional_whole(key, lowest, highest)? {
            Some(value) => Ok(value),
            None => Err(self.missing(key, &whole_text(lowest, highest))),
        }
    }

    /// A whole number for both directions, or `[vertical, horizontal]`.
    pub(crate) fn optional_pair(
        &mut self,
        key: &'static str,
        lowest: usize,
        highest: usize,
    ) -> Result<Option<[usize; 2]>, NetworkError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let expected = || {
            format!(
                "{}, or a pair [vertical, horizontal]",
                whole_text(lowest, highest)
            )
        };
        let numbers = wholes(value.get_ref());
        let is_good = |numbers: &[usize]| numbers.iter().all(|n| (lowest..=highest).contains(n));
        match numbers.as_deref() {
            Some([both]) if is_good(&[*both]) => Ok(Some([*both; 2])),
            Some([vertical, horizontal]) if is_good(&[*vertical, *horizontal]) => {
                Ok(Some([*vertical, *horizontal]))
            }
            _ => Err(self.wrong(key, &value, expected())),
        }
    }

    pub(crate) fn required_pair(
        &mut self,
        key: &'static str,
        lowest: usize,
        highest: usize,
    ) -> Result<[usize; 2], NetworkError> {
        match self.optional_pair(key, lowest, highest)? {
            Some(pair) => Ok(pair),
            None => Err(self.missing(key, &whole_text(lowest, highest))),
        }
    }

    /// One of the words, or the numbers written there (one, or as many as the array holds).
    pub(crate) fn optional_word_or_numbers(
        &mut self,
        key: &'static str,
        words: &[&'static str],
        highest: usize,
        expected: &str,
    ) -> Result<Option<WordOrNumbers>, NetworkError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        if let DeValue::String(text) = value.get_ref() {
            if let Some(word) = words.iter().find(|word| **word == text.as_ref()) {
                return Ok(Some(WordOrNumbers::Word(word)));
            }
            return Err(self.unknown_word(key, value.span(), text, words));
        }
        match wholes(value.get_ref()) {
            Some(numbers) if numbers.iter().all(|n| *n <= highest) => {
                Ok(Some(WordOrNumbers::Numbers(numbers)))
            }
            _ => Err(self.wrong(key, &value, expected)),
        }
    }

    pub(crate) fn bool(&mut self, key: &'static str, default: bool) -> Result<bool, NetworkError> {
        let Some(value) = self.take(key) else {
            return Ok(default);
        };
        match value.get_ref() {
            DeValue::Boolean(flag) => Ok(*flag),
            _ => Err(self.wrong(key, &value, "true or false")),
        }
    }

    pub(crate) fn optional_string(&mut self, key: &'static str) -> Result<Option<String>, NetworkError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        match value.get_ref() {
            DeValue::String(text) => Ok(Some(text.clone().into_owned())),
            _ => Err(self.wrong(key, &value, "text in quotes")),
        }
    }

    /// One text or an array of texts.
    pub(crate) fn optional_strings(
        &mut self,
        key: &'static str,
    ) -> Result<Option<Vec<String>>, NetworkError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let texts = match value.get_ref() {
            DeValue::String(text) => Some(vec![text.clone().into_owned()]),
            DeValue::Array(array) => array
                .iter()
                .map(|item| match item.get_ref() {
                    DeValue::String(text) => Some(text.clone().into_owned()),
                    _ => None,
                })
                .collect(),
            _ => None,
        };
        match texts {
            Some(texts) => Ok(Some(texts)),
            None => Err(self.wrong(key, &value, "text in quotes or an array of texts")),
        }
    }

    fn unknown_word(&self, key: &str, span: Range<usize>, found: &str, words: &[&str]) -> NetworkError {
        let help = match nearest_names(found, words).first() {
            Some(name) => format!("did you mean {name:?}?"),
            None => String::new(),
        };
        self.source.problem(
            span,
            self.key_path(key),
            format!("one of {}", words.join(", ")),
            format!("{found:?}"),
            help,
        )
    }

    /// One word out of a list; an unknown one is refused with the nearest.
    pub(crate) fn optional_word(
        &mut self,
        key: &'static str,
        words: &[&'static str],
    ) -> Result<Option<&'static str>, NetworkError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let DeValue::String(text) = value.get_ref() else {
            return Err(self.wrong(key, &value, "text in quotes"));
        };
        match words.iter().find(|word| **word == text.as_ref()) {
            Some(word) => Ok(Some(word)),
            None => Err(self.unknown_word(key, value.span(), text, words)),
        }
    }

    pub(crate) fn required_table(&mut self, key: &'static str) -> Result<Table<'a>, NetworkError> {
        let Some(value) = self.take(key) else {
            return Err(self.missing(key, &format!("a table [{key}]")));
        };
        let (path, span) = (self.key_path(key), value.span());
        match value.into_inner() {
            DeValue::Table(table) => Ok(Table::new(self.source, path, span, table)),
            other => Err(self
                .source
                .problem(span, path, "a table", shown(&other), format!("write [{key}]"))),
        }
    }

    /// An array of tables; absent is empty.
    pub(crate) fn tables(&mut self, key: &'static str) -> Result<Vec<Table<'a>>, NetworkError> {
        let Some(value) = self.take(key) else {
            return Ok(Vec::new());
        };
        let (path, span) = (self.key_path(key), value.span());
        let array = match value.into_inner() {
            DeValue::Array(array) => array,
            other => {
                return Err(self.source.problem(
                    span,
                    path,
                    "an array of tables",
                    shown(&other),
                    format!("write [[{key}]]"),
                ));
            }
        };
        let mut tables = Vec::new();
        for (index, value) in array.into_iter().enumerate() {
            let (item_path, span) = (format!("{path}[{index}]"), value.span());
            match value.into_inner() {
                DeValue::Table(table) => tables.push(Table::new(self.source, item_path, span, table)),
                other => {
                    return Err(self.source.problem(
                        span,
                        item_path,
                        "a table",
                        shown(&other),
                        format!("write [[{key}]]"),
                    ));
                }
            }
        }
        Ok(tables)
    }

    /// All keys must have been read by now; the first one that was not is refused with the nearest known key.
    pub(crate) fn finish(&self) -> Result<(), NetworkError> {
        let Some(entry) = self.entries.iter().find(|entry| entry.value.is_some()) else {
            return Ok(());
        };
        let nearest = nearest_names(&entry.key, &self.known);
        let known = self.known.join(", ");
        let (expected, help) = match nearest.first() {
            Some(name) => (
                format!("the key {name:?}"),
                format!("did you mean {name:?}? Known here: {known}"),
            ),
            None => ("a known key".to_owned(), format!("known here: {known}")),
        };
        Err(self.source.problem(
            entry.key_span.clone(),
            self.key_path(&entry.key),
            expected,
            format!("the unknown key {:?}", entry.key),
            help,
        ))
    }
}

/// What [`Table::optional_word_or_numbers`] found.
pub(crate) enum WordOrNumbers {
    Word(&'static str),
    Numbers(Vec<usize>),
}

fn whole(value: &DeValue) -> Option<usize> {
    match value {
        DeValue::Integer(integer) => usize::from_str_radix(integer.as_str(), integer.radix()).ok(),
        _ => None,
    }
}

fn wholes(value: &DeValue) -> Option<Vec<usize>> {
    match value {
        DeValue::Array(array) => array.iter().map(|item| whole(item.get_ref())).collect(),
        other => whole(other).map(|number| vec![number]),
    }
}

fn whole_text(lowest: usize, highest: usize) -> String {
    format!("a whole number from {lowest} to {highest}")
}

fn shown(value: &DeValue) -> String {
    match value {
        DeValue::String(text) => {
            let short: String = text.chars().take(60).collect();
            format!("the text {short:?}")
        }
        DeValue::Integer(integer) => format!("{integer}"),
        DeValue::Float(float) => format!("{float}"),
        DeValue::Boolean(flag) => format!("{flag}"),
        DeValue::Datetime(datetime) => format!("the date {datetime}"),
        DeValue::Array(_) => "an array".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}
