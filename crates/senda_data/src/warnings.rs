//! Warnings that stay readable when the same damage happens a thousand times.

/// How many warnings of one kind are told in full.
const TOLD: usize = 5;

/// Collects warnings by kind: the first few in full, the rest as a count.
#[derive(Debug, Default)]
pub(crate) struct Warnings {
    kinds: Vec<Kind>,
}

#[derive(Debug)]
struct Kind {
    name: &'static str,
    told: Vec<String>,
    count: usize,
}

impl Warnings {
    /// Adds one. `kind` is a plural that completes "and 17 more …": `images missing`.
    pub(crate) fn add(&mut self, kind: &'static str, text: impl FnOnce() -> String) {
        let place = match self.kinds.iter().position(|known| known.name == kind) {
            Some(place) => place,
            None => {
                self.kinds.push(Kind {
                    name: kind,
                    told: Vec::new(),
                    count: 0,
                });
                self.kinds.len() - 1
            }
        };
        let known = &mut self.kinds[place];
        known.count += 1;
        if known.told.len() < TOLD {
            known.told.push(text());
        }
    }

    /// In the order of the first of each kind.
    pub(crate) fn finish(self) -> Vec<String> {
        let mut all = Vec::new();
        for kind in self.kinds {
            let more = kind.count - kind.told.len();
            all.extend(kind.told);
            if more > 0 {
                all.push(format!("and {more} more {} ({} in all)", kind.name, kind.count));
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_of_a_kind_become_a_count() {
        let mut warnings = Warnings::default();
        for i in 0..8 {
            warnings.add("images missing", || format!("image {i} is missing"));
        }
        warnings.add("others", || "another".into());
        let all = warnings.finish();
        assert_eq!(all.len(), 7);
        assert_eq!(all[5], "and 3 more images missing (8 in all)");
        assert_eq!(all[6], "another");
    }
}
