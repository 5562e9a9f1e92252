//! `senda study follow`: the controller on the kinematics alone (C13 in SPEC).

use super::{report::command_line, write_file};
use crate::terminal;
use anyhow::{Result, bail};
use clap::{Args, Subcommand};
use senda_drivers::follow::Form;
use senda_drivers::study::{self, Start, StudyOptions, Trace, Verdict};
use senda_eval::report::{Page, StudyTrace, study_html, study_limits};
use serde::Serialize;
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    study: Study,
}

#[derive(Subcommand)]
enum Study {
    /// Distance, angle and yaw rate over time, for any constants of the path follower
    Follow(Box<Follow>),
}

#[derive(Args)]
struct Follow {
    /// Starting states as DISTANCE_CM:ANGLE_DEG, in the document's signs (positive: the line is to the left)
    #[arg(long, value_delimiter = ',', default_value = "-21.5:44.6,4:12", allow_hyphen_values = true, value_parser = parse_start)]
    starts: Vec<Start>,
    /// Proportional gains (1/s) of the document's form [default: 1.1,3]
    #[arg(long, value_delimiter = ',')]
    kp: Vec<f64>,
    /// Integral gains (1/s²) of the document's form [default: 0]
    #[arg(long, value_delimiter = ',')]
    ki: Vec<f64>,
    /// Derivative gains of the document's form [default: 0]
    #[arg(long, value_delimiter = ',')]
    kd: Vec<f64>,
    /// Look-ahead distances (m)
    #[arg(
        long = "look-ahead",
        value_delimiter = ',',
        default_value = "0.05,0.4,1",
        value_name = "M"
    )]
    look_ahead: Vec<f64>,
    /// Speed (m/s)
    #[arg(long, default_value_t = StudyOptions::default().speed_mps)]
    speed: f64,
    /// Time between pictures (s)
    #[arg(long, default_value_t = StudyOptions::default().period_s)]
    period: f64,
    /// Time from picture to wheels (s); it decides above which Kp swings grow
    #[arg(long, default_value_t = StudyOptions::default().delay_s)]
    delay: f64,
    /// Duration of each run (s)
    #[arg(long, default_value_t = StudyOptions::default().duration_s)]
    duration: f64,
    /// Bias of the measured distance (m)
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    d_bias: f64,
    /// Standard deviation of the measured distance (m)
    #[arg(long, default_value_t = 0.0)]
    d_noise: f64,
    /// Bias of the measured angle (degrees)
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    theta_bias_deg: f64,
    /// Standard deviation of the measured angle (degrees)
    #[arg(long, default_value_t = 0.0)]
    theta_noise_deg: f64,
    /// Curvature of the line (1/m, left positive)
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    curvature: f64,
    /// document, curve or pure-pursuit
    #[arg(long, default_value = "document", value_parser = parse_form)]
    form: Form,
    /// Seed of the noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write a report with plots (one HTML file)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print all traces and the limits of Kp as JSON
    #[arg(long)]
    json: bool,
}

fn parse_start(text: &str) -> Result<Start, String> {
    let numbers = text
        .split_once(':')
        .and_then(|(d, angle)| Some((d.parse::<f64>().ok()?, angle.parse::<f64>().ok()?)));
    let (d_cm, theta_deg) = numbers
        .ok_or_else(|| format!("expected DISTANCE_CM:ANGLE_DEG such as -21.5:44.6, but found `{text}`"))?;
    Ok(Start {
        d_m: d_cm / 100.0,
        theta_rad: theta_deg.to_radians(),
    })
}

fn parse_form(text: &str) -> Result<Form, String> {
    match text {
        "document" => Ok(Form::Document),
        "curve" => Ok(Form::Curve),
        "pure-pursuit" => Ok(Form::PurePursuit),
        other => Err(format!(
            "expected document, curve or pure-pursuit, but found `{other}`"
        )),
    }
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let Study::Follow(flags) = arguments.study;
    let is_document = flags.form == Form::Document;
    let gains_given = [("--kp", &flags.kp), ("--ki", &flags.ki), ("--kd", &flags.kd)];
    if let Some((flag, _)) = gains_given
        .iter()
        .find(|(_, given)| !is_document && !given.is_empty())
    {
        bail!("{flag}: only the document's form has this gain: leave it out, or study --form document");
    }
    let or = |given: &[f64], otherwise: &[f64]| match given {
        [] => otherwise.to_vec(),
        given => given.to_vec(),
    };
    let options = StudyOptions {
        form: flags.form,
        starts: flags.starts.clone(),
        kp_per_s: or(&flags.kp, if is_document { &[1.1, 3.0] } else { &[1.1] }),
        ki_per_s2: or(&flags.ki, &[0.0]),
        kd: or(&flags.kd, &[0.0]),
        look_ahead_m: flags.look_ahead.clone(),
        speed_mps: flags.speed,
        period_s: flags.period,
        delay_s: flags.delay,
        duration_s: flags.duration,
        d_bias_m: flags.d_bias,
        d_noise_m: flags.d_noise,
        theta_bias_rad: flags.theta_bias_deg.to_radians(),
        theta_noise_rad: flags.theta_noise_deg.to_radians(),
        curvature_per_m: flags.curvature,
        seed: flags.seed,
        ..StudyOptions::default()
    };
    let traces = study::study(&options, &terminal::interrupted)?;
    if terminal::ended_early() {
        bail!(terminal::Interrupted(": nothing is studied".to_owned()));
    }
    let limits = if is_document {
        limits(&options)?
    } else {
        Vec::new()
    };
    if let Some(path) = &flags.report {
        write_file(path, page(&traces, &limits, flags.form).as_bytes())?;
        tell!("report: {}", path.display());
    }
    if flags.json {
        let found = serde_json::json!({ "traces": traces, "limits": limits });
        say!("{}", serde_json::to_string_pretty(&found)?)?;
        return Ok(());
    }
    say!("start d, angle      Kp    Ki    Kd     L      settles  overshoot  largest d  verdict")?;
    for trace in &traces {
        let gains = if is_document {
            let gains = trace.gains;
            format!("{:5.2} {:5.2} {:5.2}", gains.kp_per_s, gains.ki_per_s2, gains.kd)
        } else {
            format!("{:>5} {:>5} {:>5}", "-", "-", "-")
        };
        let settles = trace
            .settle_time_s
            .map_or("never".to_owned(), |time| format!("{time:.1} s"));
        say!(
            "{:6.1} cm {:6.1}°  {gains} {:5.0} cm {:>10} {:7.1} cm {:7.1} cm  {}",
            trace.start.d_m * 100.0,
            trace.start.theta_rad.to_degrees(),
            trace.look_ahead_m * 100.0,
            settles,
            trace.overshoot_m * 100.0,
            trace.largest_d_m * 100.0,
            verdict(trace),
        )?;
    }
    say!("\n{}", study_limits(study::SETTLED_D_M, study::SETTLED_THETA_RAD))?;
    for limit in &limits {
        say!("{}", limit.words())?;
    }
    Ok(())
}

/// Between which Kp small errors die out, beside what Kp is combined with.
#[derive(Serialize)]
struct Limit {
    look_ahead_m: f64,
    ki_per_s2: f64,
    kd: f64,
    /// They die out between these; none: for no Kp that was tried. A highest one at the end of what was tried is no limit.
    stable_kp_per_s: Option<(f64, f64)>,
    /// The Kp that were tried.
    tried_kp_per_s: (f64, f64),
}

impl Limit {
    fn words(&self) -> String {
        let (lowest, highest) = self.tried_kp_per_s;
        let errors = match self.stable_kp_per_s {
            Some((0.0, high)) if high >= highest => format!("die out up to Kp = {highest}"),
            Some((low, high)) if high >= highest => format!("die out above Kp = {low:.2}"),
            Some((0.0, high)) => format!("grow above Kp = {high:.2}"),
            Some((low, high)) => format!("die out between Kp = {low:.2} and {high:.2} only"),
            None => format!("die out for no Kp from {lowest} to {highest}"),
        };
        let mut gains = String::new();
        for (name, gain) in [("Ki", self.ki_per_s2), ("Kd", self.kd)] {
            if gain != 0.0 {
                gains += &format!(", {name} = {gain}");
            }
        }
        let length_cm = self.look_ahead_m * 100.0;
        format!("At L = {length_cm:.0} cm{gains} and with these times, small errors {errors}.")
    }
}

/// The limits of Kp for all that it is combined with.
fn limits(options: &StudyOptions) -> Result<Vec<Limit>> {
    let mut limits = Vec::new();
    for look_ahead_m in &options.look_ahead_m {
        for ki_per_s2 in &options.ki_per_s2 {
            for kd in &options.kd {
                let one = StudyOptions {
                    look_ahead_m: vec![*look_ahead_m],
                    ki_per_s2: vec![*ki_per_s2],
                    kd: vec![*kd],
                    ..options.clone()
                };
                let stable_kp_per_s = study::critical_gains(&one, &terminal::interrupted);
                if terminal::ended_early() {
                    bail!(terminal::Interrupted(
                        ": not all limits of Kp are told".to_owned()
                    ));
                }
                limits.push(Limit {
                    look_ahead_m: *look_ahead_m,
                    ki_per_s2: *ki_per_s2,
                    kd: *kd,
                    stable_kp_per_s,
                    tried_kp_per_s: study::GAINS_TRIED,
                });
            }
        }
    }
    Ok(limits)
}

/// Points of a course that a plot has room for.
const PLOTTED_POINTS: usize = 2000;

fn page(traces: &[Trace], limits: &[Limit], form: Form) -> String {
    let plotted = |values: &[f64]| -> Vec<f64> {
        let every = values.len().div_ceil(PLOTTED_POINTS).max(1);
        values.iter().copied().step_by(every).collect()
    };
    let shown: Vec<StudyTrace> = traces
        .iter()
        .map(|trace| StudyTrace {
            group: format!(
                "from {:.1} cm, {:.1}°",
                trace.start.d_m * 100.0,
                trace.start.theta_rad.to_degrees()
            ),
            label: label(trace, form),
            verdict: verdict(trace),
            good: trace.verdict == Verdict::Converges,
            settled_d_m: trace.settled_d_m,
            settled_theta_rad: trace.settled_theta_rad,
            settle_time_s: trace.settle_time_s,
            overshoot_m: trace.overshoot_m,
            time_s: plotted(&trace.time_s),
            d_m: plotted(&trace.d_m),
            theta_rad: plotted(&trace.theta_rad),
            omega_radps: plotted(&trace.omega_radps),
        })
        .collect();
    let page = Page {
        notes: limits.iter().map(Limit::words).collect(),
        ..Page::new("Study of the path follower", &command_line())
    };
    study_html(&page, &shown)
}

/// `Kp 1.1, L 40 cm`, and the other gains where they are used.
fn label(trace: &Trace, form: Form) -> String {
    let length = format!("L {:.0} cm", trace.look_ahead_m * 100.0);
    if form != Form::Document {
        return length;
    }
    let mut label = format!("Kp {}, {length}", trace.gains.kp_per_s);
    for (name, gain) in [("Ki", trace.gains.ki_per_s2), ("Kd", trace.gains.kd)] {
        if gain != 0.0 {
            label += &format!(", {name} {gain}");
        }
    }
    label
}

fn verdict(trace: &Trace) -> String {
    match trace.verdict {
        Verdict::Converges => "converges".to_owned(),
        Verdict::Beside => format!("beside the line, d {:.1} cm", trace.rest_d_m * 100.0),
        Verdict::Slow => "slow".to_owned(),
        Verdict::Oscillates => "oscillates".to_owned(),
        Verdict::Unstable => "unstable".to_owned(),
    }
}
