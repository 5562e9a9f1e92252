//! Every package that a program of ours is built from may be used by whoever uses ours.
//!
//! `cargo deny` checks this in depth, texts included; this is the short form that needs nothing installed. Both read
//! `deny.toml`.

use crate::workspace::Package;

/// Packages whose licence `deny.toml` does not allow.
pub(crate) fn violations(packages: &[Package], deny: &str) -> Vec<String> {
    let allowed = listed(deny, "allow = [");
    if allowed.is_empty() {
        return vec!["deny.toml: expected a list `allow = [`, one licence a line".to_owned()];
    }
    packages
        .iter()
        .filter_map(|package| {
            // An exception is for one package: { crate = "name", allow = ["licence"] }.
            let mut allowed = allowed.clone();
            let exception = format!("crate = \"{}\", allow", package.name);
            for line in deny.lines().filter(|line| line.contains(&exception)) {
                allowed.extend(line.split('"').skip(3).step_by(2));
            }
            let is_allowed = |licence: &str| allowed.contains(&licence);
            if is_satisfied(&package.licence, &is_allowed) {
                return None;
            }
            let path = package.path.join(" -> ");
            Some(format!(
                "{path}: the licence `{}` is not allowed by deny.toml",
                package.licence
            ))
        })
        .collect()
}

/// The quoted words of the list that `opening` begins, up to the line that closes it.
fn listed<'a>(text: &'a str, opening: &str) -> Vec<&'a str> {
    text.lines()
        .skip_while(|line| line.trim() != opening)
        .skip(1)
        .take_while(|line| line.trim() != "]")
        .filter_map(|line| line.split('"').nth(1))
        .collect()
}

/// Whether an SPDX expression can be met with the allowed licences. `OR` binds less than `AND`; the old `/` is an `OR`.
fn is_satisfied(expression: &str, is_allowed: &dyn Fn(&str) -> bool) -> bool {
    let spaced = expression
        .replace('(', " ( ")
        .replace(')', " ) ")
        .replace('/', " OR ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut rest = words.as_slice();
    any_of(&mut rest, is_allowed) == Some(true) && rest.is_empty()
}

fn any_of(words: &mut &[&str], is_allowed: &dyn Fn(&str) -> bool) -> Option<bool> {
    let mut any = all_of(words, is_allowed)?;
    while let Some(("OR", rest)) = first(words) {
        *words = rest;
        any |= all_of(words, is_allowed)?;
    }
    Some(any)
}

fn all_of(words: &mut &[&str], is_allowed: &dyn Fn(&str) -> bool) -> Option<bool> {
    let mut all = licence(words, is_allowed)?;
    while let Some(("AND", rest)) = first(words) {
        *words = rest;
        all &= licence(words, is_allowed)?;
    }
    Some(all)
}

fn licence(words: &mut &[&str], is_allowed: &dyn Fn(&str) -> bool) -> Option<bool> {
    let (word, rest) = first(words)?;
    *words = rest;
    if word == "(" {
        let inner = any_of(words, is_allowed)?;
        let (")", rest) = first(words)? else { return None };
        *words = rest;
        return Some(inner);
    }
    if let Some(("WITH", rest)) = first(words) {
        let (exception, rest) = first(rest)?;
        *words = rest;
        return Some(is_allowed(&format!("{word} WITH {exception}")) || is_allowed(word));
    }
    Some(is_allowed(word))
}

fn first<'a, 'b>(words: &'b [&'a str]) -> Option<(&'a str, &'b [&'a str])> {
    words.split_first().map(|(word, rest)| (*word, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DENY: &str = r#"
allow = [
  "MIT",
  "Apache-2.0",
  "Unicode-3.0",
]
exceptions = [
  { crate = "jpeg-encoder", allow = ["IJG"] },
]
"#;

    fn check(name: &str, licence: &str) -> Vec<String> {
        let path = vec!["senda_core".to_owned(), name.to_owned()];
        violations(
            &[Package {
                name: name.to_owned(),
                links: None,
                licence: licence.to_owned(),
                path,
            }],
            DENY,
        )
    }

    #[test]
    fn allowed_expressions_pass() {
        for licence in [
            "MIT",
            "MIT OR Apache-2.0",
            "GPL-3.0 OR MIT",
            "MIT/Apache-2.0",
            "(MIT OR Apache-2.0) AND Unicode-3.0",
            "Apache-2.0 WITH LLVM-exception",
        ] {
            assert!(check("x", licence).is_empty(), "{licence}");
        }
        assert!(check("jpeg-encoder", "(MIT OR Apache-2.0) AND IJG").is_empty());
    }

    #[test]
    fn others_are_refused_with_the_way_to_them() {
        for licence in [
            "GPL-3.0",
            "MIT AND GPL-3.0",
            "(MIT OR Apache-2.0) AND IJG",
            "",
            "(MIT",
            "MIT OR",
        ] {
            assert_eq!(check("x", licence).len(), 1, "{licence}");
        }
        assert!(check("zedbar", "LGPL-2.1")[0].starts_with("senda_core -> zedbar"));
        assert_eq!(violations(&[], "[licenses]").len(), 1);
    }
}
