//! The command line of senda: the only place that prints, parses arguments and reads the clock.

#[macro_use]
mod terminal;
mod cockpit;
mod commands;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

/// Simulate, record, train, evaluate and drive small camera-guided vehicles.
#[derive(Parser)]
#[command(name = "senda", version, about, long_about = None, arg_required_else_help = false)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    /// Drive a line and a lane around several circuits, floors and lights, and write a report
    Tour(commands::tour::Arguments),
    /// Drive one vehicle in one world
    Drive(commands::drive::Arguments),
    /// Deliver a package in a warehouse and come back (document D)
    Deliver(commands::deliver::Arguments),
    /// Run a driver over a recording or real data
    Replay(commands::replay::Arguments),
    /// Write a report of recordings
    Report(commands::report::Arguments),
    /// Check, draw, make and print worlds
    World(commands::world::Arguments),
    /// Calibrate a camera or motors
    Calibrate(commands::calibrate::Arguments),
    /// Study a controller without pictures
    Study(commands::study::Arguments),
    /// Look into data and convert it
    Data(commands::data::Arguments),
    /// Run many scenarios and give rates with intervals
    Sweep(commands::sweep::Arguments),
    /// From nothing to a driving network: the expert drives, a network learns and is corrected
    Learn(commands::learn::Arguments),
    /// Train a network on recordings
    Train(commands::train::Arguments),
    /// Drive a trained network on circuits it never saw and give rates with intervals
    Evaluate(commands::evaluate::Arguments),
    /// Compare networks by how they really drive: train each several times, drive, give tables (document B)
    Compare(commands::compare::Arguments),
    /// Join the parts of a comparison that was spread over several machines
    Merge(commands::compare::MergeArguments),
    /// Show what a network looks at, in a picture or a run
    Look(commands::look::Arguments),
    /// Look into trained networks, bring them in and out, take them to 8 bits
    Model(commands::model::Arguments),
    /// Find signs and lights: make pictures, train, evaluate, run
    Detector(commands::detector::Arguments),
    /// Show networks as lists of layers
    Net(commands::net::Arguments),
    /// Measure senda's speed on this machine
    Bench(commands::bench::Arguments),
}

fn main() -> std::process::ExitCode {
    let matches = with_negative_numbers(Arguments::command()).get_matches();
    let arguments = Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    terminal::end_with_the_reader();
    terminal::listen_for_interrupts();
    let result = match arguments.command {
        None => greet(),
        Some(Command::Tour(arguments)) => commands::tour::run(arguments),
        Some(Command::Drive(arguments)) => commands::drive::run(arguments),
        Some(Command::Deliver(arguments)) => commands::deliver::run(arguments),
        Some(Command::Replay(arguments)) => commands::replay::run(arguments),
        Some(Command::Report(arguments)) => commands::report::run(arguments),
        Some(Command::World(arguments)) => commands::world::run(arguments),
        Some(Command::Calibrate(arguments)) => commands::calibrate::run(arguments),
        Some(Command::Study(arguments)) => commands::study::run(arguments),
        Some(Command::Data(arguments)) => commands::data::run(arguments),
        Some(Command::Sweep(arguments)) => commands::sweep::run(arguments),
        Some(Command::Learn(arguments)) => commands::learn::run(arguments),
        Some(Command::Train(arguments)) => commands::train::run(arguments),
        Some(Command::Evaluate(arguments)) => commands::evaluate::run(arguments),
        Some(Command::Compare(arguments)) => commands::compare::run(arguments),
        Some(Command::Merge(arguments)) => commands::compare::run_merge(arguments),
        Some(Command::Look(arguments)) => commands::look::run(arguments),
        Some(Command::Model(arguments)) => commands::model::run(arguments),
        Some(Command::Detector(arguments)) => commands::detector::run(arguments),
        Some(Command::Net(arguments)) => commands::net::run(arguments),
        Some(Command::Bench(arguments)) => commands::bench::run(arguments),
    };
    match result {
        // What was done until then is saved, but it is not the whole.
        Ok(()) if terminal::ended_early() => terminal::INTERRUPTED_CODE.into(),
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) if error.is::<terminal::Interrupted>() => {
            terminal::tell(error.to_string());
            terminal::INTERRUPTED_CODE.into()
        }
        Err(error) => {
            terminal::complain(&error);
            std::process::ExitCode::FAILURE
        }
    }
}

/// A negative number is a value wherever one is expected: whoever reads it says what it may be.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command
        .mut_args(|argument| {
            let takes_values = argument.get_action().takes_values();
            argument.allow_negative_numbers(takes_values)
        })
        .mut_subcommands(with_negative_numbers)
}

fn greet() -> anyhow::Result<()> {
    say!(
        "senda {} simulates, records, trains, evaluates and drives small camera-guided vehicles.

  senda tour                                              see it drive: a report in a few seconds
  senda drive --world oval --vehicle gopigo --driver line --report run.html
  senda replay RECORDING --report replay.html             run a driver over recorded or real frames

`senda --help` lists all commands.",
        env!("CARGO_PKG_VERSION")
    )
}
