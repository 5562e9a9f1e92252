//! `senda study follow`: the controller on the kinematics alone (C13 in SPEC).

use super::{report::command_line, write_file};
use anyhow::Result;
use clap::{Args, Subcommand};
use senda_drivers::follow::Form;
use senda_drivers::study::{self, Start, StudyOptions, Trace, Verdict};
use senda_eval::report::{Page, StudyTrace, study_html, study_limits};
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
    /// Proportional gains (1/s)
    #[arg(long, value_delimiter = ',', default_value = "1.1,3")]
    kp: Vec<f64>,
    /// Integral gains (1/s²)
    #[arg(long, value_delimiter = ',', default_value = "0")]
    ki: Vec<f64>,
    /// Derivative gains
    #[arg(long, value_delimiter = ',', default_value = "0")]
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
    /// Print all traces as JSON
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
    let options = StudyOptions {
        form: flags.form,
        starts: flags.starts.clone(),
        kp_per_s: flags.kp.clone(),
        ki_per_s2: flags.ki.clone(),
        kd: flags.kd.clone(),
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
    let traces = study::study(&options)?;
    if let Some(path) = &flags.report {
        write_file(path, page(&traces).as_bytes())?;
        tell!("report: {}", path.display());
    }
    if flags.json {
        say!("{}", serde_json::to_string_pretty(&traces)?)?;
        return Ok(());
    }
    say!("start d, angle      Kp    Ki    Kd     L      settles  overshoot  largest d  verdict")?;
    for trace in &traces {
        let settles = trace
            .settle_time_s
            .map_or("never".to_owned(), |time| format!("{time:.1} s"));
        say!(
            "{:6.1} cm {:6.1}°  {:5.2} {:5.2} {:5.2} {:5.0} cm {:>10} {:7.1} cm {:7.1} cm  {}",
            trace.start.d_m * 100.0,
            trace.start.theta_rad.to_degrees(),
            trace.gains.kp_per_s,
            trace.gains.ki_per_s2,
            trace.gains.kd,
            trace.look_ahead_m * 100.0,
            settles,
            trace.overshoot_m * 100.0,
            trace.largest_d_m * 100.0,
            verdict(trace),
        )?;
    }
    say!("\n{}", study_limits(study::SETTLED_D_M, study::SETTLED_THETA_RAD))?;
    if flags.form != Form::Document {
        return Ok(());
    }
    for look_ahead_m in &flags.look_ahead {
        let one = StudyOptions {
            look_ahead_m: vec![*look_ahead_m],
            ..options.clone()
        };
        if let Some(gain) = study::critical_gain(&one) {
            let length_cm = look_ahead_m * 100.0;
            say!("At L = {length_cm:.0} cm and with these times, small errors grow above Kp = {gain:.2}.")?;
        }
    }
    Ok(())
}

fn page(traces: &[Trace]) -> String {
    let shown: Vec<StudyTrace> = traces
        .iter()
        .map(|trace| StudyTrace {
            group: format!(
                "from {:.1} cm, {:.1}°",
                trace.start.d_m * 100.0,
                trace.start.theta_rad.to_degrees()
            ),
            label: label(trace),
            verdict: verdict(trace),
            good: trace.verdict == Verdict::Converges,
            settled_d_m: trace.settled_d_m,
            settled_theta_rad: trace.settled_theta_rad,
            settle_time_s: trace.settle_time_s,
            overshoot_m: trace.overshoot_m,
            time_s: trace.time_s.clone(),
            d_m: trace.d_m.clone(),
            theta_rad: trace.theta_rad.clone(),
            omega_radps: trace.omega_radps.clone(),
        })
        .collect();
    study_html(&Page::new("Study of the path follower", &command_line()), &shown)
}

/// `Kp 1.1, L 40 cm`, and the other gains where they are used.
fn label(trace: &Trace) -> String {
    let mut label = format!(
        "Kp {}, L {:.0} cm",
        trace.gains.kp_per_s,
        trace.look_ahead_m * 100.0
    );
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
