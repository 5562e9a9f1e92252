//! Values of a TOML file as numbers and words, and how to speak of them.

use crate::{Problem, Source};
use toml::Spanned;
use toml::de::DeValue;

/// What [`crate::Table::optional_word_or_numbers`] found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WordOrNumbers {
    /// One of the words.
    Word(&'static str),
    /// The numbers written there.
    Numbers(Vec<usize>),
}

/// A number within its range.
pub(crate) fn number<E: From<Box<Problem>>>(
    source: &Source<E>,
    path: &str,
    value: &Spanned<DeValue>,
    lowest: f64,
    highest: f64,
) -> Result<f64, E> {
    let number = match value.get_ref() {
        DeValue::Float(float) => float.as_str().replace('_', "").parse::<f64>().ok(),
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

/// A whole number that is not negative.
pub(crate) fn whole(value: &DeValue) -> Option<u64> {
    match value {
        DeValue::Integer(integer) => u64::from_str_radix(integer.as_str(), integer.radix()).ok(),
        _ => None,
    }
}

/// One whole number, or an array of them.
pub(crate) fn wholes(value: &DeValue) -> Option<Vec<usize>> {
    let size = |value: &DeValue| whole(value).and_then(|number| usize::try_from(number).ok());
    match value {
        DeValue::Array(array) => array.iter().map(|item| size(item.get_ref())).collect(),
        other => size(other).map(|number| vec![number]),
    }
}

pub(crate) fn range_text(lowest: f64, highest: f64) -> String {
    // Limits that were degrees or single precision a moment ago.
    let tidy = |value: f64| {
        let rounded = (value * 1e6).round() / 1e6;
        if rounded == 0.0 {
            format!("{value}")
        } else {
            format!("{rounded}")
        }
    };
    format!("a number from {} to {}", tidy(lowest), tidy(highest))
}

pub(crate) fn whole_text(lowest: u64, highest: u64) -> String {
    format!("a whole number from {lowest} to {highest}")
}

/// A value in words, short.
pub(crate) fn shown(value: &DeValue) -> String {
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
