//! The page that all reports share: template, style, script.

use super::run::RunSection;
use crate::{plot, text};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use minijinja::value::Serde;
use serde::Serialize;
use sha2::{Digest, Sha256};

const TEMPLATE: &str = include_str!("report.html");
const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// Variables that only the page uses, beside those of the plots.
const PAGE_LIGHT: &str =
    "--page:#f5f6f6;--raised:#e9eced;--good:#00704f;--good-bg:rgba(0,158,115,.13);--on-accent:#fff;";
const PAGE_DARK: &str =
    "--page:#0f1418;--raised:#20282f;--good:#4fd6a9;--good-bg:rgba(55,201,155,.16);--on-accent:#08141d;";

/// What stands at the head of a report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Page {
    /// Title: what it is about.
    pub title: String,
    /// One sentence below it; may be empty.
    pub subtitle: String,
    /// Command line that makes this report again; empty for none.
    pub command: String,
    /// Version of senda.
    pub version: String,
    /// Commit that it was built from; empty where unknown.
    pub commit: String,
    /// Further facts: name and value.
    pub facts: Vec<(String, String)>,
    /// Remarks that a reader must not miss: warnings, what was left out.
    pub notes: Vec<String>,
    /// Space for embedded camera frames in the whole page (bytes, as base64). More frames are thinned evenly.
    pub frame_budget_bytes: usize,
}

impl Default for Page {
    fn default() -> Self {
        Self {
            title: "senda report".into(),
            subtitle: String::new(),
            command: String::new(),
            version: env!("CARGO_PKG_VERSION").into(),
            commit: String::new(),
            facts: Vec::new(),
            notes: Vec::new(),
            frame_budget_bytes: 7_000_000,
        }
    }
}

impl Page {
    /// A page with a title and the command that makes it.
    pub fn new(title: &str, command: &str) -> Self {
        Self {
            title: title.into(),
            command: command.into(),
            ..Self::default()
        }
    }
}

/// A plot with title and caption.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Figure {
    pub(super) title: String,
    pub(super) svg: String,
    pub(super) caption: String,
}

/// A table; the first column holds the rows' names.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Table {
    pub(super) caption: String,
    pub(super) columns: Vec<String>,
    /// How many of the first columns hold words (set flush left); the rest holds numbers.
    pub(super) words: usize,
    pub(super) rows: Vec<Row>,
}

/// A row of a [`Table`]. `tone` is a style class: `bad`, `first` (of a group) or empty.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Row {
    pub(super) cells: Vec<String>,
    pub(super) tone: &'static str,
}

/// A figure in large type.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Card {
    label: String,
    value: String,
    unit: String,
    detail: String,
    hint: String,
    tone: &'static str,
}

impl Card {
    /// `1.23 cm` is set as a large number with a small unit. `tone` is a style class: `good`, `bad` or empty.
    pub(super) fn new(label: &str, figure: String, detail: String, hint: &str, tone: &'static str) -> Self {
        let (value, unit) = match figure.split_once(' ') {
            Some((number, unit)) if number.ends_with(|c: char| c.is_ascii_digit()) => {
                (number.to_owned(), unit.to_owned())
            }
            _ => (figure, String::new()),
        };
        Self {
            label: label.to_owned(),
            value,
            unit,
            detail,
            hint: hint.to_owned(),
            tone,
        }
    }
}

/// A part of the page that is not a run.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Section {
    pub(super) title: String,
    pub(super) intro: String,
    pub(super) cards: Vec<Card>,
    /// How wide figures are: empty for small ones, `wide`, `single` for one in a row.
    pub(super) grid: &'static str,
    pub(super) figures: Vec<Figure>,
    pub(super) tables: Vec<Table>,
    /// What went wrong and the command that repeats it.
    pub(super) commands: Vec<(String, String)>,
    /// Folded texts: title and text.
    pub(super) details: Vec<(String, String)>,
}

/// The whole page.
pub(super) fn render(page: &Page, runs: Vec<RunSection>, sections: Vec<Section>) -> String {
    let dark = format!("color-scheme:dark;{}{PAGE_DARK}", plot::PALETTE_DARK);
    let light = format!("color-scheme:light;{}{PAGE_LIGHT}", plot::PALETTE_LIGHT);
    let css = format!(
        ":root{{{light}}}@media(prefers-color-scheme:dark){{:root{{{dark}}}}}\
:root[data-theme=light]{{{light}}}:root[data-theme=dark]{{{dark}}}@media print{{:root:root{{{light}}}}}\n{}\n{STYLE}",
        plot::RULES
    );
    let script_hash = format!("sha256-{}", STANDARD.encode(Sha256::digest(SCRIPT)));
    let mut environment = minijinja::Environment::new();
    environment.set_auto_escape_callback(|_| minijinja::AutoEscape::Html);
    // Our own escaping, as in figures: it also removes control characters.
    environment.set_formatter(|out, state, value| match value.as_str() {
        Some(words) if !value.is_safe() => Ok(out.write_str(&text::escape(words))?),
        _ => minijinja::escape_formatter(out, state, value),
    });
    environment
        .add_template("report.html", TEMPLATE)
        .expect("the embedded template parses: every test renders it");
    environment
        .get_template("report.html")
        .and_then(|template| {
            template.render(minijinja::context! {
                page => Serde(page),
                runs => Serde(runs),
                sections => Serde(sections),
                css => css,
                script => SCRIPT,
                script_hash => script_hash,
            })
        })
        .expect("the embedded template renders: every test renders it")
}
