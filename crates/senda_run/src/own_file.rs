//! Reading our own TOML files: what is wrong is told with what was expected and what to do.

use crate::RunError;
use serde::de::DeserializeOwned;
use std::path::Path;

/// A kind of file, for messages.
pub(crate) struct Kind {
    /// Such as `scenario file`.
    pub(crate) name: &'static str,
    /// What to do where there is none, or an incomplete one.
    pub(crate) help: &'static str,
}

/// The text of a file, or why not.
pub(crate) fn read(path: &Path, kind: &Kind) -> Result<String, RunError> {
    let wrong = |found: String| RunError::File {
        path: path.to_owned(),
        reason: format!("expected a {}, but {found}; {}", kind.name, kind.help),
    };
    let bytes = std::fs::read(path).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => wrong("found no such file".to_owned()),
        _ => wrong(format!("it cannot be read: {error}")),
    })?;
    String::from_utf8(bytes).map_err(|error| {
        wrong(format!(
            "found bytes that are no UTF-8 text from byte {} on",
            error.utf8_error().valid_up_to()
        ))
    })
}

/// What a file says. Errors name the line, and of unknown keys the nearest known one.
pub(crate) fn load<T: DeserializeOwned>(path: &Path, kind: &Kind) -> Result<T, RunError> {
    let text = read(path, kind)?;
    let wrong = |reason: String| RunError::File {
        path: path.to_owned(),
        reason,
    };
    if text.trim().is_empty() {
        return Err(wrong(format!(
            "expected a {}, but found an empty file; {}",
            kind.name, kind.help
        )));
    }
    toml::from_str(&text).map_err(|error: toml::de::Error| {
        let (message, whole) = (error.message(), error.to_string());
        let said = whole
            .trim_end()
            .replacen(message, &senda_toml::with_nearest(message), 1);
        wrong(if message.starts_with("missing field") {
            format!("{said}; {}", kind.help)
        } else {
            said
        })
    })
}
