//! Codes since the last stop: of several of one kind the largest counts, since it is the nearest.

/// What has been read.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Codes {
    pub(super) depot: Option<u8>,
    pub(super) start: bool,
    pub(super) package: Option<u8>,
    /// Two packages that were seen at once, about as large.
    rivals: Option<[u8; 2]>,
    /// In how many readings the same package, and no other, has been seen.
    alone: u32,
    candidate: Option<u8>,
}

/// A code for this vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Code {
    Package(u8),
    Depot(u8),
    Start,
}

/// A code larger than this part of the largest may be as near (guess).
const LIKE: f32 = 0.8;
/// A package is the one when so many readings in a row that show any showed it alone (1 s): a frame may fail to show another.
const ALONE: u32 = 10;

/// What a text says; other codes are none of this vehicle's business.
fn code(text: &str) -> Option<Code> {
    let mut letters = text.chars();
    let number = |digits: &str| digits.parse::<u8>().ok().filter(|_| digits.len() <= 3);
    match (letters.next(), number(letters.as_str())) {
        (Some('I'), Some(depot)) => Some(Code::Package(depot)),
        (Some('F'), Some(depot)) => Some(Code::Depot(depot)),
        _ if text == "P" => Some(Code::Start),
        _ => None,
    }
}

impl Codes {
    /// Takes the codes of one frame with their sizes (px), the largest first. Returns the two packages between which it cannot
    /// choose, once for each two.
    pub(super) fn take<'a>(&mut self, seen: impl Iterator<Item = (&'a str, f32)>) -> Option<[u8; 2]> {
        let (mut depot, mut package, mut rival) = (None, None, None);
        for (text, size_px) in seen {
            match (code(text), package) {
                (Some(Code::Depot(number)), _) => depot = depot.or(Some(number)),
                (Some(Code::Start), _) => self.start = true,
                (Some(Code::Package(number)), None) => package = Some((number, size_px)),
                (Some(Code::Package(number)), Some((first, largest_px)))
                    if number != first && size_px > LIKE * largest_px =>
                {
                    rival = rival.or(Some(number));
                }
                _ => {}
            }
        }
        self.depot = depot.or(self.depot);
        let (number, _) = package?;
        if let Some(rival) = rival {
            let rivals = Some([number.min(rival), number.max(rival)]);
            self.alone = 0;
            let are_new = self.rivals != rivals;
            self.rivals = rivals;
            return rivals.filter(|_| are_new);
        }
        if self.candidate.replace(number) != Some(number) {
            self.alone = 0;
        }
        self.alone += 1;
        if self.alone >= ALONE {
            self.package = Some(number);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The last one read counted, which was the smallest.
    #[test]
    fn of_several_codes_the_largest_counts() {
        let mut codes = Codes::default();
        let seen = [("I0", 131.0), ("F3", 90.0), ("I2", 99.0), ("F1", 80.0)];
        assert_eq!(codes.take(seen.into_iter()), None);
        assert_eq!(codes.package, None, "another may come into view");
        for _ in 1..ALONE {
            codes.take(seen.into_iter());
        }
        assert_eq!((codes.package, codes.depot), (Some(0), Some(3)));
    }

    #[test]
    fn between_two_packages_it_waits_until_one_is_gone() {
        let mut codes = Codes::default();
        let both = [("I2", 100.0), ("I0", 99.0)];
        assert_eq!(codes.take(both.into_iter()), Some([0, 2]));
        assert_eq!(codes.take(both.into_iter().rev()), None, "said once");
        // A frame that fails to show one of them, and one that shows none.
        codes.take(both.into_iter().take(1));
        codes.take(std::iter::empty());
        codes.take(both.into_iter());
        assert_eq!(codes.package, None);
        for _ in 0..ALONE {
            assert_eq!(codes.package, None);
            codes.take(both.into_iter().skip(1));
        }
        assert_eq!(codes.package, Some(0));
        // The same code twice is one package.
        let mut codes = Codes::default();
        for _ in 0..ALONE {
            codes.take([("I1", 100.0), ("I1", 99.0)].into_iter());
        }
        assert_eq!(codes.package, Some(1));
        // One that is read first, beside one that is read a little later.
        let mut codes = Codes::default();
        for _ in 1..ALONE {
            codes.take([("I0", 100.0)].into_iter());
        }
        assert_eq!(codes.take(both.into_iter()), Some([0, 2]));
        assert_eq!(codes.package, None);
    }

    #[test]
    fn codes_that_are_none_of_its_business_change_nothing() {
        let mut codes = Codes::default();
        let foreign = [
            "",
            "Z9",
            "I",
            "F",
            "I-1",
            "I9999",
            "F1x",
            "PP",
            "https://example.org",
            "i2",
            "Iä",
        ];
        codes.take(foreign.into_iter().map(|text| (text, 100.0)));
        assert!(codes.depot.is_none() && codes.package.is_none() && !codes.start);
        for _ in 0..ALONE {
            codes.take(["F2", "I7", "P"].into_iter().map(|text| (text, 100.0)));
        }
        assert!(codes.depot == Some(2) && codes.package == Some(7) && codes.start);
    }
}
