//! Figures as SVG text: line plots, scatter, rates with intervals, heat grids and maps.
//!
//! The same input gives the same bytes. Colours are CSS variables of a palette that colour-blind readers can tell apart
//! (Okabe & Ito 2008) with a light and a dark form. [`standalone`] makes a file of a figure; inside a page the page's
//! style sheet defines the variables ([`PALETTE_LIGHT`], [`PALETTE_DARK`], [`RULES`]).

mod axis;
mod chart;
mod heat;
mod lap;
mod line;
mod map;
mod rates;
mod svg;
mod timeline;

pub use axis::{Axis, ticks};
pub use chart::WalkedChart;
pub use heat::HeatGrid;
pub use lap::{HardCurve, against_percent, hard_curves};
pub use line::{Band, LinePlot, Rule, Series, Span, Stroke};
pub use map::{Map, MapStyle, Track};
pub use rates::{RateRow, RateRows};
pub(crate) use svg::thinned;
pub use timeline::Timeline;

/// Variables of the light form, as CSS declarations.
pub const PALETTE_LIGHT: &str = "--surface:#ffffff;--ink:#1a2026;--ink-2:#55606b;--ink-3:#8b96a1;--grid:#e6e9ec;--axis:#b6bec6;\
--s0:#0072b2;--s1:#d55e00;--s2:#009e73;--s3:#b3588f;--s4:#b88600;--s5:#8c564b;--s6:#5b5b5b;--alarm:#c8102e;\
--band:rgba(0,158,115,.10);--span:rgba(200,16,46,.12);--road:#eceff1;--road-line:#9aa5af;";

/// Variables of the dark form, as CSS declarations.
pub const PALETTE_DARK: &str = "--surface:#171d23;--ink:#e9edf0;--ink-2:#a9b4be;--ink-3:#78838e;--grid:#29323a;--axis:#4a555f;\
--s0:#4db1ee;--s1:#ff8c42;--s2:#37c99b;--s3:#e08fbf;--s4:#e9bb3f;--s5:#c49c94;--s6:#b5bcc3;--alarm:#ff6477;\
--band:rgba(55,201,155,.12);--span:rgba(255,100,119,.16);--road:#222a31;--road-line:#5d6873;";

/// Style rules of all figures; classes begin with `sp-`.
pub const RULES: &str = "\
.sp{font:12px system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif;fill:var(--ink-2)}\
.sp text{font-variant-numeric:tabular-nums}\
.sp-title{font-size:14px;font-weight:600;fill:var(--ink)}\
.sp-strong{fill:var(--ink)}\
.sp-small{font-size:10.5px}\
.sp-bg{fill:var(--surface)}\
.sp-grid{stroke:var(--grid);stroke-width:1;fill:none}\
.sp-axis{stroke:var(--axis);stroke-width:1;fill:none}\
.sp-zero{stroke:var(--axis);stroke-width:1;fill:none}\
.sp-band{fill:var(--band)}\
.sp-span{fill:var(--span)}\
.sp-rule{stroke:var(--ink-3);stroke-width:1;stroke-dasharray:2 3;fill:none}\
.sp-line{fill:none;stroke-width:1.6;stroke-linejoin:round;stroke-linecap:round}\
.sp-thin{stroke-width:1}\
.sp-dash{stroke-dasharray:5 4}\
.sp-dot{stroke:none;fill-opacity:.55}\
.sp-alarm{stroke:var(--alarm)}\
.sp-road{fill:none;stroke:var(--road);stroke-linejoin:round}\
.sp-road-line{fill:none;stroke:var(--road-line)}\
.sp-box{fill:var(--surface);stroke:var(--axis);stroke-width:1}\
.sp-lit .sp-box{fill:var(--s4);fill-opacity:.35;stroke:var(--s4);stroke-width:2}\
.sp-cursor line{stroke:var(--ink);stroke-width:1;opacity:.6}\
.sp-cursor circle{stroke:var(--surface);stroke-width:1.5}\
.sp-c0{stroke:var(--s0)}.sp-c1{stroke:var(--s1)}.sp-c2{stroke:var(--s2)}.sp-c3{stroke:var(--s3)}\
.sp-c4{stroke:var(--s4)}.sp-c5{stroke:var(--s5)}.sp-c6{stroke:var(--s6)}\
.sp-f0{fill:var(--s0)}.sp-f1{fill:var(--s1)}.sp-f2{fill:var(--s2)}.sp-f3{fill:var(--s3)}\
.sp-f4{fill:var(--s4)}.sp-f5{fill:var(--s5)}.sp-f6{fill:var(--s6)}.sp-falarm{fill:var(--alarm)}";

/// Number of colours that series take turns with.
pub const COLOURS: usize = 7;

/// A figure as an SVG file of its own that follows the reader's light or dark setting.
pub fn standalone(figure: &str) -> String {
    let style = format!(
        "<style>svg{{{PALETTE_LIGHT}}}@media(prefers-color-scheme:dark){{svg{{{PALETTE_DARK}}}}}{RULES}</style>\
<rect class=\"sp-bg\" width=\"100%\" height=\"100%\"/>"
    );
    match figure.find('>') {
        Some(end) => format!("{}{style}{}\n", &figure[..=end], &figure[end + 1..]),
        None => figure.to_owned(),
    }
}
