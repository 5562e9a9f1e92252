//! Reports: one self-contained HTML file each, readable from a disk without network.
//!
//! [`html`] shows runs with a player that scrubs through the camera frames in step with all plots; [`sweep_html`] shows
//! rates over many runs; [`study_html`] a study of the kinematics; [`real_data_html`] a driver on recorded real frames
//! beside the human; [`training_html`] how a network was trained; [`parts_html`] tables and plots that
//! somebody else put together. The same input gives the same bytes. Text from files (world names, driver names, events) can
//! neither act nor load anything: it is escaped, and the page forbids every script but its own.

mod columns;
mod delivery;
mod frames;
mod page;
mod parts;
mod plots;
mod real;
mod run;
mod signals;
mod study;
mod sweep;
mod sweep_delivery;
mod training;

pub use frames::Look;
pub use page::Page;
pub use parts::{Part, PartFigure, PartTable, parts_html, parts_markdown};
pub use real::real_data_html;
pub use run::ReportRun;
pub use study::{StudyTrace, study_html, study_limits};
pub use sweep::{SweepRow, SweepRun, SweepTable, sweep_html, sweep_table};
pub use sweep_delivery::DeliveryRow;
pub use training::{TrainingEpoch, TrainingReport, TrainingRound, training_html};

use crate::text::escape;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use senda_core::{Encoded, Image, ImageFormat, Shape};

/// A report of one or several runs.
pub fn html(page: &Page, runs: &[ReportRun]) -> String {
    let sections = if runs.len() > 1 {
        vec![run::comparison(runs)]
    } else {
        Vec::new()
    };
    // Space in proportion to need, so that all runs play at about the same frame rate.
    let needs: Vec<usize> = runs.iter().map(|run| frames::size_of(run.recording)).collect();
    let need = needs.iter().sum::<usize>().max(1);
    let share = |i: usize| (page.frame_budget_bytes as f64 * needs[i] as f64 / need as f64).ceil() as usize;
    let runs = runs
        .iter()
        .enumerate()
        .map(|(i, run)| run::section(run, i, share(i)))
        .collect();
    page::render(page, runs, sections)
}

/// A picture with shapes drawn over it as an SVG file of its own, such as a calibration photograph with its corners.
pub fn picture_svg(image: &Image, encoded: &Encoded, shapes: &[Shape]) -> String {
    let (width, height) = (image.width(), image.height());
    // Line widths and letters that suit the picture's size.
    let unit = (width as f64 / 320.0).max(0.4);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\">\
<image width=\"{width}\" height=\"{height}\" href=\"{}\"/>",
        data_uri(encoded)
    );
    for shape in shapes {
        let colour = escape(&frames::safe_colour(frames::colour_of(shape)));
        out += &match shape {
            Shape::Polyline { points, closed, .. } => {
                let joined: Vec<String> = points.iter().map(|[u, v]| format!("{u:.1},{v:.1}")).collect();
                let element = if *closed { "polygon" } else { "polyline" };
                format!(
                    "<{element} points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{unit:.2}\"/>",
                    joined.join(" ")
                )
            }
            Shape::Circle {
                centre: [u, v],
                radius_px,
                ..
            } => format!(
                "<circle cx=\"{u:.1}\" cy=\"{v:.1}\" r=\"{radius_px:.1}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{unit:.2}\"/>"
            ),
            Shape::Text { at: [u, v], text, .. } => format!(
                "<text x=\"{u:.1}\" y=\"{v:.1}\" fill=\"{colour}\" font-family=\"system-ui,sans-serif\" font-size=\"{:.1}\">{}</text>",
                9.0 * unit,
                escape(text)
            ),
        };
    }
    out + "</svg>\n"
}

fn data_uri(encoded: &Encoded) -> String {
    let kind = match encoded.format {
        ImageFormat::Jpeg => "jpeg",
        ImageFormat::Png => "png",
    };
    format!("data:image/{kind};base64,{}", STANDARD.encode(&encoded.bytes))
}

#[cfg(test)]
mod tests;
