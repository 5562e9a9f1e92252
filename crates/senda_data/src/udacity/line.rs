//! One row of the log.

/// One row of `driving_log.csv`.
#[derive(Debug, Clone, PartialEq)]
pub enum LogLine {
    /// Nothing, or the names of the columns.
    Empty,
    /// A record.
    Record {
        /// Paths of the centre, left and right picture as written; empty where there is none.
        pictures: [String; 3],
        /// -1 full left to 1 full right.
        steering: f64,
        /// 0 to 1.
        throttle: f64,
        /// 0 to 1.
        brake: f64,
        /// Miles an hour.
        speed_mph: f64,
    },
}

/// Reads one row, with or without its end. Rows written on machines with a decimal comma (`0,05` for 0.05) are put
/// together again where only one reading makes sense. The error says what was expected and found.
pub fn parse_line(line: &[u8]) -> Result<LogLine, String> {
    let text = std::str::from_utf8(line)
        .map_err(|e| format!("expected UTF-8, but byte {} is not", e.valid_up_to() + 1))?;
    let text = text
        .trim_start_matches('\u{feff}')
        .trim_matches(['\0', '\r', '\n', ' ', '\t']);
    if text.is_empty() {
        return Ok(LogLine::Empty);
    }
    // One row at a time, so that a stray quote costs its row and not the rest of the file.
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .buffer_capacity(text.len() + 1)
        .from_reader(text.as_bytes());
    let mut row = csv::StringRecord::new();
    if !reader.read_record(&mut row).map_err(|e| e.to_string())? {
        return Ok(LogLine::Empty);
    }
    let fields: Vec<&str> = row.iter().collect();
    if fields.iter().any(|field| field.eq_ignore_ascii_case("steering")) {
        return Ok(LogLine::Empty);
    }
    let (Some(pictures), Some(numbers)) = (fields.get(..3), fields.get(3..)) else {
        return Err(format!("expected 7 columns, but found {}", fields.len()));
    };
    let [steering, throttle, brake, speed_mph] = match numbers.len() {
        4 => plain(numbers)?,
        5..=8 => with_decimal_commas(numbers)?,
        other => return Err(format!("expected 7 columns, but found {}", other + 3)),
    };
    for (name, value, range) in [
        ("steering", steering, -1.0..=1.0),
        ("throttle", throttle, -1.0..=1.0),
        ("brake", brake, 0.0..=1.0),
    ] {
        if !range.contains(&value) {
            return Err(format!(
                "{name}: expected {} to {}, but found {value}",
                range.start(),
                range.end()
            ));
        }
    }
    Ok(LogLine::Record {
        pictures: [0, 1, 2].map(|i| pictures[i].to_owned()),
        steering,
        throttle,
        brake,
        speed_mph,
    })
}

const NAMES: [&str; 4] = ["steering", "throttle", "brake", "speed"];

fn plain(fields: &[&str]) -> Result<[f64; 4], String> {
    let mut numbers = [0.0; 4];
    for ((number, field), name) in numbers.iter_mut().zip(fields).zip(NAMES) {
        *number = field
            .parse()
            .ok()
            .filter(|number: &f64| number.is_finite())
            .ok_or_else(|| format!("{name}: expected a number, but found {field:?}"))?;
    }
    Ok(numbers)
}

/// Four numbers out of five to eight fields: some commas are decimal points.
fn with_decimal_commas(fields: &[&str]) -> Result<[f64; 4], String> {
    let mut readings = Vec::new();
    split(fields, &mut Vec::new(), &mut readings);
    readings.retain(|[steering, throttle, brake, _]| {
        (-1.0..=1.0).contains(steering) && (0.0..=1.0).contains(throttle) && (0.0..=1.0).contains(brake)
    });
    // `0,22,5` is brake 0 and speed 22.5 far more often than brake 0.22 and speed 5.
    if readings.len() > 1 && readings.iter().any(|reading| reading[2] == 0.0) {
        readings.retain(|reading| reading[2] == 0.0);
    }
    match readings.as_slice() {
        [only] => Ok(*only),
        [] => Err(format!(
            "expected steering, throttle, brake and speed, but found {:?}",
            fields.join(",")
        )),
        several => Err(format!(
            "decimal commas: {:?} can be read in {} ways",
            fields.join(","),
            several.len()
        )),
    }
}

fn split(fields: &[&str], so_far: &mut Vec<f64>, readings: &mut Vec<[f64; 4]>) {
    if let (Ok(reading), []) = (<[f64; 4]>::try_from(so_far.as_slice()), fields) {
        readings.push(reading);
    }
    if so_far.len() >= 4 {
        return;
    }
    let candidates = [
        fields
            .first()
            .and_then(|whole| whole_number(whole))
            .map(|n| (1, n)),
        fields
            .get(..2)
            .and_then(|two| fraction(two[0], two[1]))
            .map(|n| (2, n)),
    ];
    for (used, number) in candidates.into_iter().flatten() {
        so_far.push(number);
        split(&fields[used..], so_far, readings);
        so_far.pop();
    }
}

/// A number as the simulator writes one without decimals: never `05` or `-`.
fn whole_number(text: &str) -> Option<f64> {
    let digits = text.strip_prefix('-').unwrap_or(text);
    let (mantissa, _) = digits.split_once(['e', 'E']).unwrap_or((digits, ""));
    let plain =
        mantissa.bytes().all(|b| b.is_ascii_digit()) && (mantissa == "0" || !mantissa.starts_with('0'));
    if mantissa.is_empty() || !plain {
        return None;
    }
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

/// `0` and `05` as 0.05. The simulator never writes zeros at the end.
fn fraction(whole: &str, decimals: &str) -> Option<f64> {
    whole_number(whole)?;
    let (digits, _) = decimals.split_once(['e', 'E']).unwrap_or((decimals, ""));
    if digits.is_empty() || !digits.bytes().all(|b| b.is_ascii_digit()) || digits.ends_with('0') {
        return None;
    }
    format!("{whole}.{decimals}")
        .parse()
        .ok()
        .filter(|number: &f64| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(line: &str, expected: &str) {
        let found = match parse_line(line.as_bytes()) {
            Ok(LogLine::Empty) => "empty".to_owned(),
            Ok(LogLine::Record {
                pictures,
                steering,
                throttle,
                brake,
                speed_mph,
            }) => format!("{} {steering} {throttle} {brake} {speed_mph}", pictures[0]),
            Err(reason) => reason,
        };
        assert!(
            found.contains(expected),
            "{line}\n  expected {expected}\n  found    {found}"
        );
    }

    #[test]
    fn rows_of_real_logs() {
        check(
            r"C:\me\IMG\center_1.jpg,C:\l.jpg,C:\r.jpg,-0.05,0.9,0,22.5",
            r"C:\me\IMG\center_1.jpg -0.05 0.9 0 22.5",
        );
        check("center,left,right,steering,throttle,brake,speed", "empty");
        check(
            "IMG/center_1.jpg, IMG/left_1.jpg, IMG/right_1.jpg, 0, 0, 0, 22.14829",
            "IMG/center_1.jpg 0 0 0 22.14829",
        );
        check("a.jpg,b.jpg,c.jpg,0,1,0,7.845E-05", "a.jpg 0 1 0 0.00007845");
        check("\r\n", "empty");
    }

    #[test]
    fn decimal_commas() {
        check("a.jpg,b.jpg,c.jpg,0,05,0,9,0,22,5", "a.jpg 0.05 0.9 0 22.5");
        check("a.jpg,b.jpg,c.jpg,-0,25,1,0,30,19", "a.jpg -0.25 1 0 30.19");
        check("a.jpg,b.jpg,c.jpg,0,0,0,7,845E-05", "a.jpg 0 0 0 0.00007845");
        check("a.jpg,b.jpg,c.jpg,0,1,2,3,4,5,6,7,8", "expected 7 columns");
        check("a.jpg,b.jpg,c.jpg,x,1,0,2,3", "expected steering");
    }

    #[test]
    fn broken_rows_say_what_is_wrong() {
        check("a.jpg", "expected 7 columns, but found 1");
        check("a.jpg,b.jpg,c.jpg,0,0,0", "expected 7 columns, but found 6");
        check("a.jpg,b.jpg,c.jpg,left,0,0,1", "steering: expected a number");
        check("a.jpg,b.jpg,c.jpg,NaN,0,0,1", "steering: expected a number");
        check(
            "a.jpg,b.jpg,c.jpg,25,0,0,1",
            "steering: expected -1 to 1, but found 25",
        );
        check("\"a.jpg,b.jpg,c.jpg,0,0,0,1", "expected 7 columns");
    }
}
