//! `senda world …`: list, check, draw, make and print worlds.

use super::write_file;
use crate::terminal;
use anyhow::{Context, Result, bail};
use clap::{Args, Subcommand};
use senda_run::{
    random,
    scenario::{find_world, usual_vehicle},
};
use senda_world::{
    FLOOR_PRESETS, LIGHT_PRESETS, VehicleSpec, World,
    draw::{self, Ink, Paper, Print, PrintOptions},
    paint,
};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Names of ready worlds, vehicles, floors, lights and random families
    List {
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Read a world file and say what is wrong with it
    Check {
        /// World files, or names of ready worlds
        #[arg(required = true)]
        files: Vec<PathBuf>,
        /// Vehicle that should fit
        #[arg(long)]
        vehicle: Option<String>,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Draw a world: SVG as a plan, PNG as it looks from above
    Draw {
        /// Ready world, world file or random-line:SEED
        world: String,
        /// Where to write it; the ending says the format
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Pixels a metre of a PNG
        #[arg(long, default_value_t = 250.0)]
        resolution: f64,
        /// Floor instead of the world's own
        #[arg(long)]
        floor: Option<String>,
        /// Light instead of the world's own
        #[arg(long)]
        light: Option<String>,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Make a world from a seed
    Random {
        /// Seed
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Family: random-line, random-lane, random-circuit, random-road, … (`senda world list` shows all)
        #[arg(long, default_value = "random-line")]
        family: String,
        /// Tightest curve (m)
        #[arg(long, value_name = "M")]
        min_radius: Option<f64>,
        /// Shortest and longest length, such as 4,9 (m)
        #[arg(long, value_delimiter = ',', value_name = "M,M")]
        length: Option<Vec<f64>>,
        /// Where to write it
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Make a road lap from way points: one x,y a line, metres, in driving order
    FromWaypoints {
        /// Text file (CSV) with the way points of one lap
        file: PathBuf,
        /// Metres in the file's unit: 1000 for kilometres, 0.001 for millimetres
        #[arg(long, default_value_t = 1.0, value_name = "M")]
        scale: f64,
        /// Drive against the order of the points
        #[arg(long)]
        reverse: bool,
        /// Seed of what lies beside the road: water, trees, dirt, kerbs' places
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Where to write the world
        #[arg(short, long, value_name = "FILE")]
        out: PathBuf,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Print a warehouse's codes, number signs and crossings at true scale
    Boards {
        /// Ready world, world file or random-warehouse:SEED
        world: String,
        /// PDF file
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// a4 or a3
        #[arg(long, default_value = "a4")]
        paper: String,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Print a world at true scale, to tape it on a floor
    Print {
        /// Ready world, world file or random-line:SEED
        world: String,
        /// PDF file, or a folder for SVG pages
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// a4 or a3
        #[arg(long, default_value = "a4")]
        paper: String,
        /// Sheets on their long side
        #[arg(long)]
        landscape: bool,
        /// Edges only, to lay tape on
        #[arg(long)]
        outline: bool,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    match arguments.what {
        What::List { json } => list(json),
        What::Check { files, vehicle, json } => check(&files, vehicle.as_deref(), json),
        What::Draw {
            world,
            out,
            resolution,
            floor,
            light,
            json,
        } => {
            let mut world = find_world(&world)?;
            if let Some(floor) = floor {
                world = world.with_floor(&floor)?;
            }
            if let Some(light) = light {
                world = world.with_light(&light)?;
            }
            if !(10.0..=2000.0).contains(&resolution) {
                bail!("--resolution {resolution}: expected 10 to 2000 pixels a metre");
            }
            let bytes = match extension(&out) {
                "svg" => draw::svg(&world).into_bytes(),
                "png" => {
                    let mut picture = paint::paint(&world, 1.0 / resolution);
                    let painted = 1.0 / picture.metres_per_texel;
                    if painted < 0.99 * resolution {
                        tell!(
                            "warning: {} is drawn with {painted:.0} pixels a metre, not with --resolution {resolution}: its size or its texel_m allows no more",
                            world.name
                        );
                    }
                    draw::add_upright(&mut picture, &world);
                    draw::png(&picture)
                }
                other => bail!(
                    "{}: expected a name that ends in .svg or .png, but found `{other}`",
                    out.display()
                ),
            };
            write_file(&out, &bytes)?;
            terminal::answer(json, &json!({ "file": out }), &out.display().to_string())
        }
        What::Random {
            seed,
            family,
            min_radius,
            length,
            out,
            json,
        } => {
            let Some(mut difficulty) = random::difficulty(&family) else {
                let world =
                    find_world(&format!("{family}:{seed}")).with_context(|| format!("--family {family}"))?;
                if min_radius.is_some() || length.is_some() {
                    bail!(
                        "--min-radius, --length: expected another family, for {family} has its own measures"
                    );
                }
                return write_world(&world, &out, json);
            };
            if min_radius.is_none() && length.is_none() {
                // The same world as by its name.
                return write_world(&World::random(seed, &difficulty), &out, json);
            }
            difficulty.min_radius_m = min_radius.unwrap_or(difficulty.min_radius_m);
            if let Some(length) = length {
                let [least, most] = length.as_slice() else {
                    bail!("--length: expected two numbers such as 4,9")
                };
                difficulty.length_m = [*least, *most];
            }
            let world = World::random_within(seed, &difficulty).context("--length, --min-radius")?;
            write_world(&world, &out, json)
        }
        What::FromWaypoints {
            file,
            scale,
            reverse,
            seed,
            out,
            json,
        } => {
            if !(scale.is_finite() && scale > 0.0) {
                bail!("--scale {scale}: expected metres in the file's unit, above 0");
            }
            let bytes = std::fs::read(&file).with_context(|| format!("cannot read {}", file.display()))?;
            // What is not text is refused as a line that holds no numbers, with its place.
            let text = String::from_utf8_lossy(&bytes);
            let (world, warnings) = World::from_waypoints(&file.display().to_string(), &text, scale, seed)?;
            for warning in warnings {
                tell!("warning: {warning}");
            }
            write_world(&if reverse { world.reversed() } else { world }, &out, json)
        }
        What::Boards {
            world,
            out,
            paper,
            json,
        } => {
            let world = find_world(&world)?;
            if extension(&out) != "pdf" {
                bail!("{}: expected a name that ends in .pdf", out.display());
            }
            let pdf = draw::boards(&world, paper_named(&paper)?).with_context(|| {
                format!(
                    "{}: expected codes, number signs or crossings that fit on {paper}, but found none, or a larger one",
                    world.name
                )
            })?;
            write_file(&out, &pdf)?;
            let words = format!("{}: print at 100 % and check the ruler", out.display());
            terminal::answer(json, &json!({ "file": out }), &words)
        }
        What::Print {
            world,
            out,
            paper,
            landscape,
            outline,
            json,
        } => {
            let world = find_world(&world)?;
            let paper = paper_named(&paper)?;
            let ink = if outline { Ink::Outline } else { Ink::Full };
            let options = PrintOptions {
                paper,
                landscape,
                ink,
                ..PrintOptions::default()
            };
            let print = Print::new(&world, &options).with_context(|| world.name.clone())?;
            let (count, (columns, rows)) = (print.sheet_count(), print.grid());
            match extension(&out) {
                "pdf" => write_file(&out, &print.pdf())?,
                "" => {
                    for (name, page) in print.svg() {
                        write_file(&out.join(format!("{name}.svg")), page.as_bytes())?;
                    }
                }
                other => bail!(
                    "{}: expected a name that ends in .pdf, or a folder (a name without an ending) for SVG pages, but found `{other}`",
                    out.display()
                ),
            }
            let words = format!(
                "{}: {count} sheets ({columns} x {rows}); print at 100 % and check the ruler",
                out.display()
            );
            let value = json!({ "path": out, "sheets": count, "columns": columns, "rows": rows });
            terminal::answer(json, &value, &words)
        }
    }
}

fn paper_named(name: &str) -> Result<Paper> {
    match name {
        "a4" => Ok(Paper::A4),
        "a3" => Ok(Paper::A3),
        other => bail!("--paper {other}: expected a4 or a3"),
    }
}

fn write_world(world: &World, out: &Path, json: bool) -> Result<()> {
    if extension(out) != "toml" {
        bail!(
            "--out {}: expected a name that ends in .toml, for what is written is a world file; `senda world draw` draws it",
            out.display()
        );
    }
    write_file(out, world.to_toml().as_bytes())?;
    let length_m = world.path.length_m();
    let value = json!({
        "file": out, "length_m": length_m, "tightest_radius_m": world.path.tightest_radius_m(),
    });
    let words = format!("{}: {length_m:.2} m{}", out.display(), tightest(world));
    terminal::answer(json, &value, &words)
}

/// `, tightest curve 0.31 m`; nothing where all is straight.
fn tightest(world: &World) -> String {
    let radius_m = world.path.tightest_radius_m();
    radius_m.map_or_else(String::new, |radius_m| {
        format!(", tightest curve {radius_m:.3} m")
    })
}

/// Names with their descriptions.
fn listed<T: serde::Serialize>(pairs: &[(T, T)]) -> Vec<Value> {
    let one = |(name, description): &(T, T)| json!({ "name": name, "description": description });
    pairs.iter().map(one).collect()
}

fn list(json: bool) -> Result<()> {
    let pair = |(name, description): (&str, String)| (name.to_owned(), description);
    let worlds = World::names().map(|name| {
        let world = World::named(name);
        (name, world.map(|world| world.description).unwrap_or_default())
    });
    let vehicles = VehicleSpec::names().map(|name| {
        let vehicle = VehicleSpec::named(name);
        (
            name,
            vehicle.map(|vehicle| vehicle.description).unwrap_or_default(),
        )
    });
    let worlds: Vec<_> = worlds.map(pair).collect();
    let vehicles: Vec<_> = vehicles.map(pair).collect();
    let mut listed_worlds = listed(&worlds);
    for (entry, (name, _)) in listed_worlds.iter_mut().zip(&worlds) {
        entry["vehicle"] = usual_vehicle(name).into();
    }
    if json {
        let all = json!({
            "worlds": listed_worlds,
            "families": listed(&random::FAMILIES),
            "vehicles": listed(&vehicles),
            "floors": FLOOR_PRESETS,
            "lights": LIGHT_PRESETS,
            "drivers": listed(&senda_run::pilot::DRIVERS),
        });
        return terminal::print(&serde_json::to_string_pretty(&all)?);
    }
    say!("worlds, and the vehicle that they are for")?;
    for (name, description) in worlds {
        say!("  {name:22} {:14}  {description}", usual_vehicle(&name))?;
    }
    for (name, description) in random::FAMILIES {
        say!(
            "  {:22} {:14}  {description}",
            format!("{name}:SEED"),
            usual_vehicle(name)
        )?;
    }
    say!("\nvehicles")?;
    for (name, description) in vehicles {
        say!("  {name:22} {description}")?;
    }
    say!("\nfloors   {}", FLOOR_PRESETS.join(", "))?;
    say!("lights   {}", LIGHT_PRESETS.join(", "))?;
    say!("\ndrivers")?;
    for (name, description) in senda_run::pilot::DRIVERS {
        say!("  {name:22} {description}")?;
    }
    Ok(())
}

fn check(files: &[PathBuf], vehicle: Option<&str>, json: bool) -> Result<()> {
    let vehicle = vehicle.map(senda_run::scenario::find_vehicle).transpose()?;
    let mut broken = 0;
    let mut all = Vec::new();
    for file in files {
        let loaded = match file.to_str() {
            Some(name) if !file.exists() => find_world(name)
                .map(|world| (world, Vec::new()))
                .map_err(anyhow::Error::from),
            _ => World::load(file).map_err(anyhow::Error::from),
        };
        match loaded {
            Ok((world, mut warnings)) => {
                if let Some(vehicle) = &vehicle {
                    warnings.extend(world.check_vehicle(vehicle));
                }
                let (length_m, is_closed) = (world.path.length_m(), world.path.is_closed());
                if json {
                    let warnings: Vec<String> = warnings.iter().map(ToString::to_string).collect();
                    all.push(json!({
                        "file": file, "length_m": length_m, "closed": is_closed, "warnings": warnings,
                        "tightest_radius_m": world.path.tightest_radius_m(),
                    }));
                    continue;
                }
                say!(
                    "{}: {length_m:.2} m, {}{}, {} warning{}",
                    file.display(),
                    if is_closed { "closed" } else { "open" },
                    tightest(&world),
                    warnings.len(),
                    if warnings.len() == 1 { "" } else { "s" }
                )?;
                for warning in warnings {
                    tell!("warning: {warning}");
                }
            }
            Err(error) => {
                broken += 1;
                if json {
                    all.push(json!({ "file": file, "error": format!("{error:#}") }));
                } else {
                    terminal::complain(&error);
                }
            }
        }
    }
    if json {
        terminal::print(&serde_json::to_string_pretty(&all)?)?;
    }
    if broken > 0 {
        bail!("{broken} of {} worlds cannot be used", files.len());
    }
    Ok(())
}

fn extension(path: &Path) -> &str {
    path.extension()
        .and_then(|extension| extension.to_str())
        .unwrap_or_default()
}
