//! Reading TOML tables with positions: every complaint can point at its line, and no key goes unnoticed.

use crate::error::{Problem, Warning, WorldError, nearest_names};
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
    pub(crate) fn line(&self, at: usize) -> usize {
        1 + self.text.as_bytes()[..at.min(self.text.len())]
            .iter()
            .filter(|b| **b == b'\n')
            .count()
    }

    pub(crate) fn problem(
        &self,
        span: Range<usize>,
        key: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
        help: impl Into<String>,
    ) -> WorldError {
        let mut start = span.start.min(self.text.len());
        while !self.text.is_char_boundary(start) {
            start -= 1;
        }
        let line_start = self.text[..start].rfind('\n').map_or(0, |i| i + 1);
        WorldError::Invalid(Box::new(Problem {
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

    pub(crate) fn warning(&self, at: usize, key: &str, message: impl Into<String>) -> Warning {
        Warning {
            file: self.name.to_owned(),
            line: Some(self.line(at)),
            key: key.to_owned(),
            message: message.into(),
        }
    }

    /// The whole file as a table.
    pub(crate) fn table(&'a self) -> Result<Table<'a>, WorldError> {
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
    pub(crate) source: &'a Source<'a>,
    pub(crate) path: String,
    pub(crate) span: Range<usize>,
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

    pub(crate) fn key_path(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    /// Where a key (taken or not) stands; the table itself when it is absent.
    pub(crate) fn position(&self, key: &str) -> usize {
        self.entries
            .iter()
            .find(|entry| entry.key == key)
            .map_or(self.span.start, |entry| entry.key_span.start)
    }

    pub(crate) fn has(&self, key: &str) -> bool {
        self.entries.iter().any(|entry| entry.key == key)
    }

    pub(crate) fn warning(&self, key: &str, message: impl Into<String>) -> Warning {
        self.source
            .warning(self.position(key), &self.key_path(key), message)
    }

    /// A complaint about a key of this table.
    pub(crate) fn problem(
        &self,
        key: &str,
        expected: impl Into<String>,
        found: impl Into<String>,
        help: impl Into<String>,
    ) -> WorldError {
        let span = self
            .entries
            .iter()
            .find(|entry| entry.key == key)
            .map_or(self.span.clone(), |entry| entry.key_span.clone());
        let path = if key.is_empty() {
            self.path.clone()
        } else {
            self.key_path(key)
        };
        self.source.problem(span, path, expected, found, help)
    }

    fn take(&mut self, key: &'static str) -> Option<Spanned<DeValue<'a>>> {
        self.known.push(key);
        self.entries
            .iter_mut()
            .find(|entry| entry.key == key)
            .and_then(|entry| entry.value.take())
    }

    /// The key is needed and absent. If a similar unknown key stands there, that is the mistake.
    pub(crate) fn missing(&self, key: &'static str, expected: &str) -> WorldError {
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

    pub(crate) fn optional_f64(
        &mut self,
        key: &'static str,
        lowest: f64,
        highest: f64,
    ) -> Result<Option<f64>, WorldError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let path = self.key_path(key);
        number(self.source, &path, &value, lowest, highest).map(Some)
    }

    pub(crate) fn f64(
        &mut self,
        key: &'static str,
        lowest: f64,
        highest: f64,
        default: f64,
    ) -> Result<f64, WorldError> {
        Ok(self.optional_f64(key, lowest, highest)?.unwrap_or(default))
    }

    pub(crate) fn required_f64(
        &mut self,
        key: &'static str,
        lowest: f64,
        highest: f64,
    ) -> Result<f64, WorldError> {
        match self.optional_f64(key, lowest, highest)? {
            Some(value) => Ok(value),
            None => Err(self.missing(key, &range_text(lowest, highest))),
        }
    }

    /// An angle: `key_rad`, or `key_deg` at this human edge. Limits in radians.
    pub(crate) fn optional_angle(
        &mut self,
        key_rad: &'static str,
        key_deg: &'static str,
        lowest_rad: f64,
        highest_rad: f64,
    ) -> Result<Option<f64>, WorldError> {
        if self.has(key_rad) && self.has(key_deg) {
            return Err(self.problem(
                key_deg,
                format!("either {key_rad} or {key_deg}"),
                "both",
                format!("remove {key_deg}"),
            ));
        }
        if let Some(degrees) =
            self.optional_f64(key_deg, lowest_rad.to_degrees(), highest_rad.to_degrees())?
        {
            return Ok(Some(degrees.to_radians()));
        }
        self.optional_f64(key_rad, lowest_rad, highest_rad)
    }

    pub(crate) fn optional_u64(
        &mut self,
        key: &'static str,
        lowest: u64,
        highest: u64,
    ) -> Result<Option<u64>, WorldError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let expected = format!("a whole number from {lowest} to {highest}");
        let number = match value.get_ref() {
            DeValue::Integer(integer) => u64::from_str_radix(integer.as_str(), integer.radix()).ok(),
            _ => None,
        };
        match number {
            Some(number) if (lowest..=highest).contains(&number) => Ok(Some(number)),
            _ => {
                let found = shown(value.get_ref());
                Err(self
                    .source
                    .problem(value.span(), self.key_path(key), expected, found, ""))
            }
        }
    }

    pub(crate) fn bool(&mut self, key: &'static str, default: bool) -> Result<bool, WorldError> {
        let Some(value) = self.take(key) else {
            return Ok(default);
        };
        match value.get_ref() {
            DeValue::Boolean(flag) => Ok(*flag),
            other => Err(self.source.problem(
                value.span(),
                self.key_path(key),
                "true or false",
                shown(other),
                "",
            )),
        }
    }

    pub(crate) fn optional_string(&mut self, key: &'static str) -> Result<Option<String>, WorldError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        match value.get_ref() {
            DeValue::String(text) => Ok(Some(text.clone().into_owned())),
            other => Err(self.source.problem(
                value.span(),
                self.key_path(key),
                "text in quotes",
                shown(other),
                "",
            )),
        }
    }

    /// One word out of a list; an unknown one is refused with the nearest.
    pub(crate) fn optional_word(
        &mut self,
        key: &'static str,
        words: &[&'static str],
    ) -> Result<Option<&'static str>, WorldError> {
        let Some(found) = self.optional_string(key)? else {
            return Ok(None);
        };
        if let Some(word) = words.iter().find(|word| **word == found) {
            return Ok(Some(word));
        }
        let help = match nearest_names(&found, words).first() {
            Some(name) => format!("did you mean {name:?}?"),
            None => String::new(),
        };
        Err(self.problem(
            key,
            format!("one of {}", words.join(", ")),
            format!("{found:?}"),
            help,
        ))
    }

    pub(crate) fn required_word(
        &mut self,
        key: &'static str,
        words: &[&'static str],
    ) -> Result<&'static str, WorldError> {
        match self.optional_word(key, words)? {
            Some(word) => Ok(word),
            None => Err(self.missing(key, &format!("one of {}", words.join(", ")))),
        }
    }

    pub(crate) fn optional_table(&mut self, key: &'static str) -> Result<Option<Table<'a>>, WorldError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let path = self.key_path(key);
        let span = value.span();
        match value.into_inner() {
            DeValue::Table(table) => Ok(Some(Table::new(self.source, path, span, table))),
            other => Err(self
                .source
                .problem(span, path, "a table", shown(&other), format!("write [{key}]"))),
        }
    }

    /// An array of tables; absent is empty.
    pub(crate) fn tables(&mut self, key: &'static str) -> Result<Vec<Table<'a>>, WorldError> {
        let path = self.key_path(key);
        let mut tables = Vec::new();
        for (index, value) in self.array(key)?.unwrap_or_default().into_iter().enumerate() {
            let (item_path, span) = (format!("{path}[{index}]"), value.span());
            match value.into_inner() {
                DeValue::Table(table) => tables.push(Table::new(self.source, item_path, span, table)),
                other => {
                    return Err(self.source.problem(
                        span,
                        item_path,
                        "a table",
                        shown(&other),
                        format!("write [[{key}]] or {{ … }}"),
                    ));
                }
            }
        }
        Ok(tables)
    }

    /// An array of tables, at most `limit` of them: what costs time for each place of the floor must not be endless.
    pub(crate) fn tables_at_most(
        &mut self,
        key: &'static str,
        limit: usize,
    ) -> Result<Vec<Table<'a>>, WorldError> {
        let tables = self.tables(key)?;
        if tables.len() > limit {
            let found = format!("{}", tables.len());
            return Err(self.problem(key, format!("at most {limit} of them"), found, ""));
        }
        Ok(tables)
    }

    /// An array of numbers.
    pub(crate) fn optional_numbers(
        &mut self,
        key: &'static str,
        lowest: f64,
        highest: f64,
    ) -> Result<Option<Vec<f64>>, WorldError> {
        let path = self.key_path(key);
        let Some(array) = self.array(key)? else {
            return Ok(None);
        };
        let mut numbers = Vec::with_capacity(array.len());
        for (index, value) in array.iter().enumerate() {
            numbers.push(number(
                self.source,
                &format!("{path}[{index}]"),
                value,
                lowest,
                highest,
            )?);
        }
        Ok(Some(numbers))
    }

    /// An array of texts; absent is an error.
    pub(crate) fn strings(&mut self, key: &'static str) -> Result<Vec<String>, WorldError> {
        let path = self.key_path(key);
        let Some(array) = self.array(key)? else {
            return Err(self.missing(key, "an array of texts"));
        };
        let mut texts = Vec::with_capacity(array.len());
        for (index, value) in array.iter().enumerate() {
            match value.get_ref() {
                DeValue::String(text) => texts.push(text.clone().into_owned()),
                other => {
                    return Err(self.source.problem(
                        value.span(),
                        format!("{path}[{index}]"),
                        "text in quotes",
                        shown(other),
                        "",
                    ));
                }
            }
        }
        Ok(texts)
    }

    /// An array of `[x, y]` pairs.
    pub(crate) fn optional_pairs(
        &mut self,
        key: &'static str,
        lowest: f64,
        highest: f64,
    ) -> Result<Option<Vec<[f64; 2]>>, WorldError> {
        let path = self.key_path(key);
        let Some(array) = self.array(key)? else {
            return Ok(None);
        };
        let mut pairs = Vec::with_capacity(array.len());
        for (index, value) in array.iter().enumerate() {
            let item_path = format!("{path}[{index}]");
            let DeValue::Array(pair) = value.get_ref() else {
                let found = shown(value.get_ref());
                return Err(self
                    .source
                    .problem(value.span(), item_path, "a pair [x, y]", found, ""));
            };
            let mut items = pair.iter();
            let (Some(x), Some(y), None) = (items.next(), items.next(), items.next()) else {
                let found = format!("{} numbers", pair.iter().count());
                return Err(self
                    .source
                    .problem(value.span(), item_path, "a pair [x, y]", found, ""));
            };
            pairs.push([
                number(self.source, &item_path, x, lowest, highest)?,
                number(self.source, &item_path, y, lowest, highest)?,
            ]);
        }
        Ok(Some(pairs))
    }

    fn array(&mut self, key: &'static str) -> Result<Option<Vec<Spanned<DeValue<'a>>>>, WorldError> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let span = value.span();
        match value.into_inner() {
            DeValue::Array(array) => Ok(Some(array.into_iter().collect())),
            other => Err(self
                .source
                .problem(span, self.key_path(key), "an array", shown(&other), "")),
        }
    }

    /// All keys must have been read by now; the first one that was not is refused with the nearest known key.
    pub(crate) fn finish(self) -> Result<(), WorldError> {
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

fn number(
    source: &Source,
    path: &str,
    value: &Spanned<DeValue>,
    lowest: f64,
    highest: f64,
) -> Result<f64, WorldError> {
    let number = match value.get_ref() {
        DeValue::Float(float) => float.as_str().parse::<f64>().ok(),
        DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix())
            .ok()
            .map(|whole| whole as f64),
        _ => None,
    };
    match number {
        // -0.0 would print as such and compare equal: keep one zero.
        Some(number) if number >= lowest && number <= highest => Ok(number + 0.0),
        _ => Err(source.problem(
            value.span(),
            path,
            range_text(lowest, highest),
            shown(value.get_ref()),
            "",
        )),
    }
}

fn range_text(lowest: f64, highest: f64) -> String {
    let tidy = |value: f64| {
        let rounded = (value * 1e6).round() / 1e6;
        format!("{rounded}")
    };
    format!("a number from {} to {}", tidy(lowest), tidy(highest))
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
