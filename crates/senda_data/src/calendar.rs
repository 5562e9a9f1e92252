//! Days and dates (Gregorian, UTC), for file names that hold a date.

/// A date.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Date {
    pub(crate) year: u64,
    /// 1..=12.
    pub(crate) month: u64,
    /// 1..=31.
    pub(crate) day: u64,
}

/// The date of a day, counted from 1970-01-01 (Hinnant, "chrono-compatible low-level date algorithms").
pub(crate) fn date(days: u64) -> Date {
    let days = days + 719_468;
    let era = days / 146_097;
    let day_of_era = days % 146_097;
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    // Months counted from March, so that the leap day is the last of the year.
    let shifted = (5 * day_of_year + 2) / 153;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    Date {
        year: year_of_era + era * 400 + u64::from(month <= 2),
        month,
        day: day_of_year - (153 * shifted + 2) / 5 + 1,
    }
}

/// Days from 1970-01-01 to a date; `None` when it is no date from 1970 on.
pub(crate) fn days(date_: Date) -> Option<u64> {
    let Date { year, month, day } = date_;
    if !(1970..10_000).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    let year = year - u64::from(month <= 2);
    let (era, year_of_era) = (year / 400, year % 400);
    let shifted = if month > 2 { month - 3 } else { month + 9 };
    let day_of_year = (153 * shifted + 2) / 5 + day - 1;
    let day_of_era = year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year;
    let days = (era * 146_097 + day_of_era).checked_sub(719_468)?;
    (date(days) == date_).then_some(days)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_dates_and_every_day_back() {
        let at = |year, month, day| Date { year, month, day };
        assert_eq!(date(0), at(1970, 1, 1));
        assert_eq!(date(20_454), at(2026, 1, 1));
        assert_eq!(days(at(2000, 2, 29)), Some(11_016));
        assert_eq!(days(at(2001, 2, 29)), None);
        assert_eq!(days(at(2026, 13, 1)), None);
        for day in 0..60_000 {
            assert_eq!(days(date(day)), Some(day));
        }
    }
}
