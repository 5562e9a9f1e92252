//! A table whose keys are taken out one by one.

use crate::values::{number, range_text, shown, whole, whole_text, wholes};
use crate::{Problem, Source, Warning, WordOrNumbers, nearest_names};
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

struct Entry<'a> {
    key: String,
    key_span: Range<usize>,
    value: Option<Spanned<DeValue<'a>>>,
}

/// A table that is being read: every accessor takes its key out, [`Table::finish`] complains about the rest.
pub struct Table<'a, E> {
    pub(crate) source: &'a Source<'a, E>,
    path: String,
    span: Range<usize>,
    entries: Vec<Entry<'a>>,
    known: Vec<&'static str>,
}

impl<'a, E: From<Box<Problem>>> Table<'a, E> {
    pub(crate) fn new(
        source: &'a Source<'a, E>,
        path: String,
        span: Range<usize>,
        table: DeTable<'a>,
    ) -> Self {
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

    /// The file that the table stands in.
    pub fn source(&self) -> &'a Source<'a, E> {
        self.source
    }

    /// Where the table stands (bytes).
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }

    /// Where a key stands, from the file's top: `path.pieces[2].radius_m`. The empty key is the table itself.
    pub fn key_path(&self, key: &str) -> String {
        match (self.path.is_empty(), key.is_empty()) {
            (true, _) => key.to_owned(),
            (_, true) => self.path.clone(),
            _ => format!("{}.{key}", self.path),
        }
    }

    /// Where a key (taken or not) stands (byte); the table itself when it is absent.
    pub fn position(&self, key: &str) -> usize {
        self.entries
            .iter()
            .find(|entry| entry.key == key)
            .map_or(self.span.start, |entry| entry.key_span.start)
    }

    /// Whether a key stands there, taken or not.
    pub fn has(&self, key: &str) -> bool {
        self.entries.iter().any(|entry| entry.key == key)
    }

    /// Something odd about a key of this table.
    pub fn warning(&self, key: &str, message: impl Into<String>) -> Warning {
        self.source
            .warning(self.position(key), &self.key_path(key), message)
    }

    /// A complaint about a key of this table, or with an empty key about the table itself.
    pub fn problem(
        &self,
        key: &str,
        expected: impl Into<String>,
        found: impl Into<String>,
        help: impl Into<String>,
    ) -> E {
        let span = self
            .entries
            .iter()
            .find(|entry| entry.key == key)
            .map_or(self.span.clone(), |entry| entry.key_span.clone());
        self.source
            .problem(span, self.key_path(key), expected, found, help)
    }

    pub(crate) fn take(&mut self, key: &'static str) -> Option<Spanned<DeValue<'a>>> {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
        self.entries
            .iter_mut()
            .find(|entry| entry.key == key)
            .and_then(|entry| entry.value.take())
    }

    /// The key is needed and absent. If a similar unknown key stands there, that is the mistake.
    pub fn missing(&self, key: &'static str, expected: &str) -> E {
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

    /// A complaint about a value.
    fn wrong(&self, key: &str, value: &Spanned<DeValue>, expected: impl Into<String>) -> E {
        let found = shown(value.get_ref());
        self.source
            .problem(value.span(), self.key_path(key), expected, found, "")
    }

    /// A number within its range.
    pub fn optional_f64(&mut self, key: &'static str, lowest: f64, highest: f64) -> Result<Option<f64>, E> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let path = self.key_path(key);
        number(self.source, &path, &value, lowest, highest).map(Some)
    }

    /// The same with a default.
    pub fn f64(&mut self, key: &'static str, lowest: f64, highest: f64, default: f64) -> Result<f64, E> {
        Ok(self.optional_f64(key, lowest, highest)?.unwrap_or(default))
    }

    /// The same; absent is an error.
    pub fn required_f64(&mut self, key: &'static str, lowest: f64, highest: f64) -> Result<f64, E> {
        match self.optional_f64(key, lowest, highest)? {
            Some(value) => Ok(value),
            None => Err(self.missing(key, &range_text(lowest, highest))),
        }
    }

    /// An angle: `key_rad`, or `key_deg` at this human edge. Limits in radians.
    pub fn optional_angle(
        &mut self,
        key_rad: &'static str,
        key_deg: &'static str,
        lowest_rad: f64,
        highest_rad: f64,
    ) -> Result<Option<f64>, E> {
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

    /// A whole number within its range.
    pub fn optional_u64(&mut self, key: &'static str, lowest: u64, highest: u64) -> Result<Option<u64>, E> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        match whole(value.get_ref()) {
            Some(number) if (lowest..=highest).contains(&number) => Ok(Some(number)),
            _ => Err(self.wrong(key, &value, whole_text(lowest, highest))),
        }
    }

    /// A size or count within its range.
    pub fn optional_whole(
        &mut self,
        key: &'static str,
        lowest: usize,
        highest: usize,
    ) -> Result<Option<usize>, E> {
        let number = self.optional_u64(key, lowest as u64, highest as u64)?;
        Ok(number.map(|number| number as usize))
    }

    /// The same; absent is an error.
    pub fn required_whole(&mut self, key: &'static str, lowest: usize, highest: usize) -> Result<usize, E> {
        match self.optional_whole(key, lowest, highest)? {
            Some(number) => Ok(number),
            None => Err(self.missing(key, &whole_text(lowest as u64, highest as u64))),
        }
    }

    /// A size for both directions, or `[vertical, horizontal]`.
    pub fn optional_pair(
        &mut self,
        key: &'static str,
        lowest: usize,
        highest: usize,
    ) -> Result<Option<[usize; 2]>, E> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let is_good = |numbers: &[usize]| numbers.iter().all(|n| (lowest..=highest).contains(n));
        match wholes(value.get_ref()).as_deref() {
            Some([both]) if is_good(&[*both]) => Ok(Some([*both; 2])),
            Some([vertical, horizontal]) if is_good(&[*vertical, *horizontal]) => {
                Ok(Some([*vertical, *horizontal]))
            }
            _ => {
                let one = whole_text(lowest as u64, highest as u64);
                Err(self.wrong(key, &value, format!("{one}, or a pair [vertical, horizontal]")))
            }
        }
    }

    /// The same; absent is an error.
    pub fn required_pair(
        &mut self,
        key: &'static str,
        lowest: usize,
        highest: usize,
    ) -> Result<[usize; 2], E> {
        match self.optional_pair(key, lowest, highest)? {
            Some(pair) => Ok(pair),
            None => Err(self.missing(key, &whole_text(lowest as u64, highest as u64))),
        }
    }

    /// One of the words, or the numbers written there (one, or as many as the array holds).
    pub fn optional_word_or_numbers(
        &mut self,
        key: &'static str,
        words: &[&'static str],
        highest: usize,
        expected: &str,
    ) -> Result<Option<WordOrNumbers>, E> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        if let DeValue::String(text) = value.get_ref() {
            return match words.iter().find(|word| **word == text.as_ref()) {
                Some(word) => Ok(Some(WordOrNumbers::Word(word))),
                None => Err(self.unknown_word(key, value.span(), text, words)),
            };
        }
        match wholes(value.get_ref()) {
            Some(numbers) if numbers.iter().all(|n| *n <= highest) => {
                Ok(Some(WordOrNumbers::Numbers(numbers)))
            }
            _ => Err(self.wrong(key, &value, expected)),
        }
    }

    /// `true` or `false`.
    pub fn bool(&mut self, key: &'static str, default: bool) -> Result<bool, E> {
        let Some(value) = self.take(key) else {
            return Ok(default);
        };
        match value.get_ref() {
            DeValue::Boolean(flag) => Ok(*flag),
            _ => Err(self.wrong(key, &value, "true or false")),
        }
    }

    /// A text.
    pub fn optional_string(&mut self, key: &'static str) -> Result<Option<String>, E> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        match value.get_ref() {
            DeValue::String(text) => Ok(Some(text.clone().into_owned())),
            _ => Err(self.wrong(key, &value, "text in quotes")),
        }
    }

    /// One text or an array of texts.
    pub fn optional_strings(&mut self, key: &'static str) -> Result<Option<Vec<String>>, E> {
        let Some(value) = self.take(key) else {
            return Ok(None);
        };
        let text = |value: &DeValue| match value {
            DeValue::String(text) => Some(text.clone().into_owned()),
            _ => None,
        };
        let texts = match value.get_ref() {
            DeValue::Array(array) => array.iter().map(|item| text(item.get_ref())).collect(),
            other => text(other).map(|text| vec![text]),
        };
        match texts {
            Some(texts) => Ok(Some(texts)),
            None => Err(self.wrong(key, &value, "text in quotes or an array of texts")),
        }
    }

    fn unknown_word(&self, key: &str, span: Range<usize>, found: &str, words: &[&str]) -> E {
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
    pub fn optional_word(
        &mut self,
        key: &'static str,
        words: &[&'static str],
    ) -> Result<Option<&'static str>, E> {
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

    /// The same; absent is an error.
    pub fn required_word(&mut self, key: &'static str, words: &[&'static str]) -> Result<&'static str, E> {
        match self.optional_word(key, words)? {
            Some(word) => Ok(word),
            None => Err(self.missing(key, &format!("one of {}", words.join(", ")))),
        }
    }

    /// A table; absent is an error.
    pub fn required_table(&mut self, key: &'static str) -> Result<Table<'a, E>, E> {
        match self.optional_table(key)? {
            Some(table) => Ok(table),
            None => Err(self.missing(key, &format!("a table [{key}]"))),
        }
    }

    /// A table.
    pub fn optional_table(&mut self, key: &'static str) -> Result<Option<Table<'a, E>>, E> {
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

    /// Refuses every other key at once, before anything is read: where a misspelt key would otherwise hide behind the
    /// complaint that follows from its absence.
    pub fn only(&mut self, keys: &[&'static str]) -> Result<(), E> {
        self.known.extend_from_slice(keys);
        match self
            .entries
            .iter()
            .find(|entry| !keys.contains(&entry.key.as_str()))
        {
            Some(entry) => Err(self.unknown_key(entry)),
            None => Ok(()),
        }
    }

    /// All keys must have been read by now; the first one that was not is refused with the nearest known key.
    pub fn finish(&self) -> Result<(), E> {
        match self.entries.iter().find(|entry| entry.value.is_some()) {
            Some(entry) => Err(self.unknown_key(entry)),
            None => Ok(()),
        }
    }

    fn unknown_key(&self, entry: &Entry) -> E {
        let nearest = nearest_names(&entry.key, &self.known);
        let known = self.known.join(", ");
        let (expected, help) = match nearest.first() {
            Some(name) => (
                format!("the key {name:?}"),
                format!("did you mean {name:?}? Known here: {known}"),
            ),
            None => ("a known key".to_owned(), format!("known here: {known}")),
        };
        self.source.problem(
            entry.key_span.clone(),
            self.key_path(&entry.key),
            expected,
            format!("the unknown key {:?}", entry.key),
            help,
        )
    }
}
