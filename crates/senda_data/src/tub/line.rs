//! One line of a catalog.

use serde_json::Value;
use std::collections::BTreeMap;

/// One record of a tub.
#[derive(Debug, Clone, PartialEq)]
pub struct TubRecord {
    /// Its number in the tub.
    pub index: u64,
    /// The recording session, where it is written.
    pub session: Option<String>,
    /// Time of writing (ms since 1970), where it is written.
    pub timestamp_ms: Option<u64>,
    /// Who drove: `user`, `local_angle` (autopilot steers), `local` (autopilot drives).
    pub mode: Option<String>,
    /// Picture files by key: `cam/image_array`.
    pub images: BTreeMap<String, String>,
    /// Every other number by key: `user/angle`, `pilot/throttle`, `imu/acl_x`.
    pub numbers: BTreeMap<String, f64>,
}

/// What a line of a catalog can be.
#[derive(Debug, Clone, PartialEq)]
pub enum TubLine {
    /// Nothing, or a place that the tub marks as empty.
    Empty,
    /// A record.
    Record(TubRecord),
}

/// Reads one line of a catalog, with or without its end. The error says what was expected and found.
pub fn parse_line(line: &[u8]) -> Result<TubLine, String> {
    let line = line.trim_ascii();
    // A power cut leaves zero bytes at the end of a file on some file systems.
    if line.iter().all(|byte| *byte == 0) {
        return Ok(TubLine::Empty);
    }
    let text = std::str::from_utf8(line)
        .map_err(|e| format!("expected UTF-8, but byte {} is not", e.valid_up_to() + 1))?;
    let value: Value = serde_json::from_str(text).map_err(|e| format!("expected a JSON object, but {e}"))?;
    let Value::Object(map) = value else {
        return Err(format!("expected a JSON object, but found {}", kind(&value)));
    };
    if map.get("__empty__").is_some_and(|v| v != &Value::Bool(false)) {
        return Ok(TubLine::Empty);
    }
    let index = map
        .get("_index")
        .ok_or("_index: expected a whole number, but found nothing")?;
    let index = index.as_u64().ok_or_else(|| {
        format!(
            "_index: expected a whole number from 0, but found {}",
            short(index)
        )
    })?;
    let mut record = TubRecord {
        index,
        session: None,
        timestamp_ms: None,
        mode: None,
        images: BTreeMap::new(),
        numbers: BTreeMap::new(),
    };
    for (key, value) in map {
        match (key.as_str(), value) {
            ("_index", _) => {}
            ("_session_id", Value::String(session)) => record.session = Some(session),
            ("_timestamp_ms", Value::Number(number)) => {
                // Other programs write fractions; a cast limits what does not fit.
                record.timestamp_ms = number.as_u64().or(number.as_f64().map(|ms| ms as u64));
            }
            ("user/mode", Value::String(mode)) => record.mode = Some(mode),
            (_, Value::Number(number)) => {
                if let Some(number) = number.as_f64().filter(|n| n.is_finite()) {
                    record.numbers.insert(key, number);
                }
            }
            (_, Value::String(text)) if is_picture(&text) => {
                record.images.insert(key, text);
            }
            // Words, lists and what other parts add: nothing that a recording holds.
            _ => {}
        }
    }
    Ok(TubLine::Record(record))
}

fn is_picture(name: &str) -> bool {
    let lower = name.to_ascii_lowercase();
    [".jpg", ".jpeg", ".png"].iter().any(|end| lower.ends_with(end))
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "a truth value",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}

/// A value for a message: long ones cut.
fn short(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(40) {
        Some((at, _)) => format!("{}…", &text[..at]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(line: &str, expected: &str) {
        let found = match parse_line(line.as_bytes()) {
            Ok(TubLine::Empty) => "empty".to_owned(),
            Ok(TubLine::Record(record)) => {
                format!(
                    "{} {:?} {:?} {:?}",
                    record.index, record.session, record.images, record.numbers
                )
            }
            Err(reason) => reason,
        };
        assert!(
            found.contains(expected),
            "{line}\n  expected {expected}\n  found    {found}"
        );
    }

    #[test]
    fn records_of_real_tubs() {
        check(
            r#"{"_index": 7, "_session_id": "22-11-29_0", "_timestamp_ms": 1669759744666, "cam/image_array": "7_cam_image_array_.jpg", "user/angle": -0.5, "user/mode": "user", "user/throttle": 0.436}"#,
            r#"7 Some("22-11-29_0") {"cam/image_array": "7_cam_image_array_.jpg"} {"user/angle": -0.5, "user/throttle": 0.436}"#,
        );
        check(r#"{"__empty__": true}"#, "empty");
        check("", "empty");
        check("\0\0\0", "empty");
        check(
            r#"{"_index": 1, "behavior/one_hot_state_array": [0, 1], "user/angle": 1}"#,
            r#"1 None {} {"user/angle": 1.0}"#,
        );
    }

    #[test]
    fn broken_lines_say_what_is_wrong() {
        check(r#"{"_index": 1, "user/angle": NaN}"#, "expected a JSON object");
        check(r#"{"_index": 1, "user/an"#, "EOF");
        check(r#"[1]"#, "found a list");
        check(
            r#"{"user/angle": 0.0}"#,
            "_index: expected a whole number, but found nothing",
        );
        check(r#"{"_index": -3}"#, "found -3");
        check(r#"{"_index": 1e300}"#, "found 1e");
        assert!(
            parse_line(b"{\"_index\": 1, \xff}")
                .unwrap_err()
                .contains("byte 15")
        );
    }
}
