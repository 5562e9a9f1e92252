//! Arrays in a table.

use crate::values::{number, shown};
use crate::{Problem, Table};
use toml::Spanned;
use toml::de::DeValue;

impl<'a, E: From<Box<Problem>>> Table<'a, E> {
    /// An array of tables; absent is empty.
    pub fn tables(&mut self, key: &'static str) -> Result<Vec<Table<'a, E>>, E> {
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
    pub fn tables_at_most(&mut self, key: &'static str, limit: usize) -> Result<Vec<Table<'a, E>>, E> {
        let tables = self.tables(key)?;
        if tables.len() > limit {
            let found = format!("{}", tables.len());
            return Err(self.problem(key, format!("at most {limit} of them"), found, ""));
        }
        Ok(tables)
    }

    /// An array of numbers.
    pub fn optional_numbers(
        &mut self,
        key: &'static str,
        lowest: f64,
        highest: f64,
    ) -> Result<Option<Vec<f64>>, E> {
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
    pub fn strings(&mut self, key: &'static str) -> Result<Vec<String>, E> {
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
    pub fn optional_pairs(
        &mut self,
        key: &'static str,
        lowest: f64,
        highest: f64,
    ) -> Result<Option<Vec<[f64; 2]>>, E> {
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

    fn array(&mut self, key: &'static str) -> Result<Option<Vec<Spanned<DeValue<'a>>>>, E> {
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
}
