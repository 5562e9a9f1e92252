//! A page of parts: tables and plots that somebody else put together, as HTML and as Markdown.

use super::frames;
use super::page::{Figure, Page, Row, Section, Table, render};
use super::run::{self, ReportRun};
use crate::plot;

/// A part of a page.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Part {
    /// Heading.
    pub title: String,
    /// A few sentences below it; may be empty.
    pub intro: String,
    /// Tables.
    pub tables: Vec<PartTable>,
    /// Plots.
    pub figures: Vec<PartFigure>,
}

/// A table; the first columns hold words, the rest numbers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PartTable {
    /// What it shows and how to read it.
    pub caption: String,
    /// Headings.
    pub columns: Vec<String>,
    /// How many of the first columns hold words.
    pub words: usize,
    /// The rows, each with as many cells as there are columns.
    pub rows: Vec<Vec<String>>,
}

/// A plot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PartFigure {
    /// Heading.
    pub title: String,
    /// The plot as [`plot`] draws it.
    pub svg: String,
    /// What it shows.
    pub caption: String,
}

/// A page of parts, followed by runs with their players.
pub fn parts_html(page: &Page, parts: &[Part], runs: &[ReportRun]) -> String {
    let needs: Vec<usize> = runs.iter().map(|run| frames::size_of(run.recording)).collect();
    let need = needs.iter().sum::<usize>().max(1);
    let sections = runs
        .iter()
        .zip(&needs)
        .enumerate()
        .map(|(index, (run, own))| {
            let share = (page.frame_budget_bytes as f64 * *own as f64 / need as f64).ceil() as usize;
            run::section(run, index, share)
        })
        .collect();
    render(page, sections, parts.iter().map(section).collect())
}

fn section(part: &Part) -> Section {
    let table = |table: &PartTable| Table {
        caption: table.caption.clone(),
        columns: table.columns.clone(),
        words: table.words,
        rows: table
            .rows
            .iter()
            .map(|cells| Row {
                cells: cells.clone(),
                tone: "",
            })
            .collect(),
    };
    let figure = |figure: &PartFigure| Figure {
        title: figure.title.clone(),
        svg: figure.svg.clone(),
        caption: figure.caption.clone(),
    };
    Section {
        title: part.title.clone(),
        intro: part.intro.clone(),
        tables: part.tables.iter().map(table).collect(),
        figures: part.figures.iter().map(figure).collect(),
        grid: "single",
        ..Section::default()
    }
}

/// The same parts as Markdown, without a title of its own. Plots become files of their own: what comes back is the text and each
/// file's name and content; `folder` is where they will lie, as seen from the text.
pub fn parts_markdown(parts: &[Part], folder: &str) -> (String, Vec<(String, String)>) {
    let mut text = String::new();
    let mut files = Vec::new();
    for part in parts {
        text += &format!("## {}\n\n", part.title);
        if !part.intro.is_empty() {
            text += &format!("{}\n\n", part.intro);
        }
        for table in &part.tables {
            let dashes: Vec<&str> = (0..table.columns.len())
                .map(|column| if column < table.words { "---" } else { "---:" })
                .collect();
            text += &format!(
                "{}{}",
                line(&table.columns),
                format_args!("|{}|\n", dashes.join("|"))
            );
            for row in &table.rows {
                text += &line(row);
            }
            text.push('\n');
            if !table.caption.is_empty() {
                text += &format!("{}\n\n", table.caption);
            }
        }
        for figure in &part.figures {
            let name = format!("{}-{}.svg", slug(&part.title), slug(&figure.title));
            text += &format!("![{}]({folder}/{name})\n\n{}\n\n", figure.title, figure.caption);
            files.push((name, plot::standalone(&figure.svg)));
        }
    }
    text.truncate(text.trim_end().len());
    text.push('\n');
    (text, files)
}

fn line(cells: &[String]) -> String {
    let cells: Vec<String> = cells
        .iter()
        .map(|cell| cell.replace('|', "\\|").replace('\n', " "))
        .collect();
    format!("| {} |\n", cells.join(" | "))
}

/// Letters, digits and single dashes.
fn slug(title: &str) -> String {
    let mut slug = String::new();
    for letter in title.to_lowercase().chars() {
        if letter.is_ascii_alphanumeric() {
            slug.push(letter);
        } else if !slug.ends_with('-') {
            slug.push('-');
        }
    }
    slug.trim_matches('-').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part() -> Part {
        Part {
            title: "Lane error, two networks".into(),
            intro: "Smaller is better.".into(),
            tables: vec![PartTable {
                caption: "In metres.".into(),
                columns: vec!["network".into(), "mean".into()],
                words: 1,
                rows: vec![vec!["a|b <i>".into(), "0.5".into()]],
            }],
            figures: vec![PartFigure {
                title: "Path".into(),
                svg: "<svg class=\"sp\"></svg>".into(),
                caption: "From above.".into(),
            }],
        }
    }

    #[test]
    fn markdown_holds_the_tables_and_names_the_plots() {
        let (text, files) = parts_markdown(&[part()], "plots");
        assert!(
            text.contains("| network | mean |\n|---|---:|\n| a\\|b <i> | 0.5 |\n"),
            "{text}"
        );
        assert!(
            text.contains("(plots/lane-error-two-networks-path.svg)"),
            "{text}"
        );
        assert_eq!(files[0].0, "lane-error-two-networks-path.svg");
        assert!(files[0].1.contains("<style>"));
    }

    #[test]
    fn the_page_holds_them_too_and_escapes_words() {
        let html = parts_html(&Page::new("Networks", ""), &[part()], &[]);
        assert!(
            html.contains("a|b &lt;i&gt;") && html.contains("In metres."),
            "{html}"
        );
    }
}
