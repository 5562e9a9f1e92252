//! `senda calibrate …`: sheet, camera, placement and motors (C1, C2, C11 in SPEC).

use super::write_file;
use crate::terminal;
use anyhow::{Context, Result, anyhow, bail};
use clap::{Args, Subcommand};
use senda_core::Encoded;
use senda_geom::Camera;
use senda_run::{photograph, scenario::find_vehicle};
use senda_vision::calibration::{
    Calibration, CalibrationError, CalibrationOptions, Sheet, calibrate,
    motor::{Measurement, MotorLine},
    overlay, placement, sheet,
};
use senda_world::VehicleSpec;
use serde_json::json;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Draw the sheet to print at true scale (PDF or SVG)
    Sheet {
        /// Where to write it; the ending says the format
        #[arg(long, value_name = "FILE", default_value = "calibration-sheet.pdf")]
        out: PathBuf,
        /// Landscape instead of portrait
        #[arg(long)]
        landscape: bool,
        /// Vehicle whose camera must see the squares, and whose wheel marks are drawn
        #[arg(long, default_value = "gopigo")]
        vehicle: String,
        /// Where the near square begins, ahead of the axle (m), instead of where the vehicle's camera sees it
        #[arg(long, value_name = "M")]
        near_square: Option<f64>,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Find the sheet in a picture and write the calibration file
    Camera {
        /// Photograph (JPEG or PNG) of the sheet by the vehicle's camera
        photo: Option<PathBuf>,
        /// Let the simulated camera take the picture instead
        #[arg(long, conflicts_with = "photo")]
        simulate: bool,
        /// Vehicle whose lens and sheet are used
        #[arg(long, default_value = "gopigo")]
        vehicle: String,
        /// The sheet was printed in landscape
        #[arg(long)]
        landscape: bool,
        /// The sheet was printed with this --near-square (m)
        #[arg(long, value_name = "M")]
        near_square: Option<f64>,
        /// The lens is unknown: tell it from the sheet, as one without distortion
        #[arg(long)]
        unknown_lens: bool,
        /// Accept a vehicle that does not stand right on the sheet
        #[arg(long)]
        accept: bool,
        /// Seed of the simulated picture
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Where to write the calibration
        #[arg(long, value_name = "FILE", default_value = "calibration.toml")]
        out: PathBuf,
        /// Write the picture with the found corners (SVG)
        #[arg(long, value_name = "FILE")]
        overlay: Option<PathBuf>,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// What a camera sees of the floor, by height and tilt
    Placement {
        /// Height of the lens (m)
        #[arg(long, default_value_t = 0.095, allow_negative_numbers = true)]
        height: f64,
        /// Vertical view angle (degrees)
        #[arg(long, default_value_t = 42.3, allow_negative_numbers = true)]
        view_deg: f64,
        /// Wanted near limit (m), with --far: prints height and tilt that give both
        #[arg(long, requires = "far")]
        near: Option<f64>,
        /// Wanted far limit (m)
        #[arg(long, requires = "near")]
        far: Option<f64>,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// The camera's view angle from a page of known size photographed at a known distance
    ViewAngle {
        /// Size of the page in the picture (px)
        #[arg(long)]
        page_px: f64,
        /// Size of the picture in the same direction (px)
        #[arg(long)]
        image_px: f64,
        /// Real size of the page (m); A4 is 0.297 by 0.210
        #[arg(long, default_value_t = 0.297)]
        page: f64,
        /// Distance from the lens (m)
        #[arg(long)]
        distance: f64,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Fit motor value against wheel speed from measurements with the encoders
    Motors {
        /// CSV file with the columns value,turns_per_s,volts
        measurements: PathBuf,
        /// Voltage for which the line is given
        #[arg(long, default_value_t = 9.277)]
        volts: f64,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    match arguments.what {
        What::Sheet {
            out,
            landscape,
            vehicle,
            near_square,
            json,
        } => {
            let page = page(landscape, near_square, &find_vehicle(&vehicle)?)?;
            let bytes = match extension(&out) {
                "pdf" => sheet::pdf(&page),
                "svg" => sheet::svg(&page).into_bytes(),
                other => bail!(
                    "{}: expected a name that ends in .pdf or .svg, but found `{other}`",
                    out.display()
                ),
            };
            write_file(&out, &bytes)?;
            let paper = if page.page_width_m.max(page.page_length_m) > sheet::A4_LONG_M {
                "A3"
            } else {
                "A4"
            };
            let words = format!(
                "{}: {paper}, squares of {:.0} mm from {:.0} and {:.0} mm ahead of the axle; print at 100 % and check the ruler",
                out.display(),
                page.square_side_m * 1e3,
                page.near_square_m * 1e3,
                page.far_square_m * 1e3
            );
            let value = json!({ "file": out, "paper": paper, "sheet": page });
            terminal::answer(json, &value, &words)
        }
        What::Camera {
            photo,
            simulate,
            vehicle,
            landscape,
            near_square,
            unknown_lens,
            accept,
            seed,
            out,
            overlay,
            json,
        } => {
            let spec = find_vehicle(&vehicle)?;
            let page = page(landscape, near_square, &spec)?;
            let (image, encoded) = match photo {
                Some(path) => read_picture(&path)?,
                None if !simulate => bail!(
                    "expected a photograph of the sheet, but found none; with --simulate the simulated camera takes it"
                ),
                None => {
                    let image = photograph::of_sheet(&spec, &page, seed)?;
                    let encoded = senda_core::codec::encode_png(&image)?;
                    (image, encoded)
                }
            };
            let camera = spec
                .body()
                .cameras
                .into_iter()
                .next()
                .context("the vehicle has no camera")?;
            let (width_px, height_px) = (image.width() as u32, image.height() as u32);
            if !unknown_lens {
                terminal::warn(&other_shape(&camera, &spec.name, width_px, height_px));
            }
            let camera = camera.resized(width_px, height_px);
            let options = CalibrationOptions {
                lens: (!unknown_lens).then_some(camera.lens),
                misplaced: if accept {
                    senda_vision::calibration::Misplaced::Accept
                } else {
                    senda_vision::calibration::Misplaced::Refuse
                },
                ..CalibrationOptions::default()
            };
            let mut result = calibrate(&image, &page, &options);
            if let Some(lens) = result
                .as_ref()
                .ok()
                .filter(|_| unknown_lens)
                .and_then(Calibration::pinhole_lens)
            {
                let told = CalibrationOptions {
                    lens: Some(lens),
                    ..options
                };
                // Where no such lens shows the sheet like this, the floor map alone is left.
                result = calibrate(&image, &page, &told).or(result);
            }
            if let Some(path) = overlay {
                let shapes = self::overlay(&result, width_px, height_px);
                write_file(
                    &path,
                    senda_eval::report::picture_svg(&image, &encoded, &shapes).as_bytes(),
                )?;
            }
            let calibration = result.map_err(with_the_flag)?;
            write_file(&out, calibration.to_toml().as_bytes())?;
            let value = json!({
                "file": out,
                "position_px": calibration.placement.position_px,
                "orientation_px": calibration.placement.orientation_px,
                "limit_px": calibration.placement.limit_px,
                "rms_px": calibration.reprojection.rms_px,
                "max_px": calibration.reprojection.max_px,
                "max_m": calibration.reprojection.max_m,
                "camera": calibration.camera,
            });
            terminal::answer(json, &value, &described(&calibration, &out))
        }
        What::Placement {
            height,
            view_deg,
            near,
            far,
            json,
        } => {
            if !(height > 0.0 && height <= 100.0) {
                bail!("--height {height}: expected metres above 0 and at most 100");
            }
            if !(view_deg > 0.0 && view_deg < 180.0) {
                bail!("--view-deg {view_deg}: expected degrees above 0 and below 180");
            }
            let view = view_deg.to_radians();
            if let (Some(near), Some(far)) = (near, far) {
                if !(0.0 < near && near < far) {
                    bail!("--near {near} --far {far}: expected a near limit above 0 and below the far one");
                }
                let Some(mountings) = placement::mountings_for(near, far, view) else {
                    bail!(
                        "no height and tilt let {view_deg}° see from {near} to {far} m: a larger view angle is needed"
                    );
                };
                let words = mountings.map(|(height, tilt)| {
                    format!("height {:.1} cm, tilt {:.1}°", height * 100.0, tilt.to_degrees())
                });
                let value = mountings.map(|(height, tilt)| json!({ "height_m": height, "tilt_rad": tilt }));
                return terminal::answer(json, &json!(value), &words.join("\n"));
            }
            let rows = placement::table(height, view, 1f64.to_radians());
            if json {
                // A far limit that is no number: the horizon.
                let row = |row: &placement::TiltRow| json!({ "tilt_rad": row.tilt_rad, "near_m": row.view.near_m, "far_m": row.view.far_m });
                let rows: Vec<_> = rows.iter().map(row).collect();
                return terminal::print(&serde_json::to_string_pretty(&rows)?);
            }
            say!(
                "height {:.1} cm, vertical view {view_deg}°\n  tilt   sees from      to",
                height * 100.0
            )?;
            for row in rows {
                let far_m = row.view.far_m;
                let far = if far_m.is_finite() {
                    format!("{:.1} cm", far_m * 100.0)
                } else {
                    "horizon".into()
                };
                say!(
                    "{:5.1}° {:9.1} cm {far:>9}",
                    row.tilt_rad.to_degrees(),
                    row.view.near_m * 100.0
                )?;
            }
            Ok(())
        }
        What::ViewAngle {
            page_px,
            image_px,
            page,
            distance,
            json,
        } => {
            let angle = placement::view_angle_rad(page_px, image_px, page, distance)
                .context("expected sizes and a distance above 0, and a page not larger than the picture")?;
            let words = format!("{:.1}°", angle.to_degrees());
            terminal::answer(json, &json!({ "view_rad": angle }), &words)
        }
        What::Motors {
            measurements,
            volts,
            json,
        } => {
            let text = std::fs::read_to_string(&measurements)
                .with_context(|| format!("cannot read {}", measurements.display()))?;
            let rows = parse_measurements(&measurements, &text)?;
            let fit = MotorLine::fit(&rows, volts)?;
            let words = format!(
                "value = {:.4} · turns/s + {:.4} at {volts} V  ({} measurements, {:.2} RMS)",
                fit.line.value_per_revps, fit.line.value_at_rest, fit.measurements, fit.rms_value
            );
            let value = json!({
                "slope_per_turnps": fit.line.value_per_revps,
                "intercept": fit.line.value_at_rest,
                "reference_v": volts,
                "measurements": fit.measurements,
                "rms_value": fit.rms_value,
            });
            terminal::answer(json, &value, &words)
        }
    }
}

/// The vehicle's sheet, the same whenever it is asked for: what was printed is what is looked for.
fn page(landscape: bool, near_square: Option<f64>, vehicle: &VehicleSpec) -> Result<Sheet> {
    let body = vehicle.body();
    let own = body
        .cameras
        .first()
        .map(|camera| Sheet::for_camera(camera, landscape));
    let mut page = match own {
        Some(Ok(page)) => page,
        Some(Err(error)) if near_square.is_none() => {
            return Err(error).with_context(|| format!("no sheet for the camera of {}", vehicle.name));
        }
        _ if landscape => Sheet::a4_landscape(),
        _ => Sheet::a4_portrait(),
    };
    if let Some(near_square_m) = near_square {
        page = page.moved(near_square_m - page.near_square_m);
    }
    page.track_m = match vehicle.steering {
        senda_core::Steering::Differential { track_m } => track_m,
        senda_core::Steering::Ackermann { .. } => vehicle.wheels.track_m,
    };
    page.check()?;
    Ok(page)
}

/// What to say where the vehicle's camera takes pictures of another shape.
fn other_shape(camera: &Camera, vehicle: &str, width_px: u32, height_px: u32) -> Vec<String> {
    let is_other = u64::from(width_px) * u64::from(camera.height_px)
        != u64::from(height_px) * u64::from(camera.width_px);
    let words = || {
        format!(
            "the picture is {width_px}x{height_px} px, but {vehicle}'s camera is {}x{}: its lens was stretched to fit; where the \
             picture was cropped instead, use --unknown-lens",
            camera.width_px, camera.height_px
        )
    };
    is_other.then(words).into_iter().collect()
}

/// The library's words name no flags; here the reader has them.
fn with_the_flag(error: CalibrationError) -> anyhow::Error {
    let flag = match error {
        CalibrationError::Misplaced { .. } => "--accept",
        CalibrationError::OtherLens { .. } => "--unknown-lens, or another --vehicle",
        CalibrationError::CutOff { .. } => "--near-square M, for `calibrate sheet` and `calibrate camera`",
        _ => return error.into(),
    };
    anyhow!("{error} ({flag})")
}

fn extension(path: &Path) -> &str {
    path.extension()
        .and_then(|extension| extension.to_str())
        .unwrap_or_default()
}

fn read_picture(path: &Path) -> Result<(senda_core::Image, Encoded)> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let encoded = Encoded::recognise(bytes).with_context(|| path.display().to_string())?;
    let image = encoded.decode().with_context(|| path.display().to_string())?;
    Ok((image, encoded))
}

fn described(calibration: &Calibration, out: &Path) -> String {
    let (placement, fit) = (&calibration.placement, &calibration.reprojection);
    let mut words = format!(
        "position {:+.1} px, orientation {:+.1} px (accepted up to {:.1} px)\n\
         corners fit to {:.2} px on average, {:.2} px at most ({:.1} mm on the floor)\n",
        placement.position_px,
        placement.orientation_px,
        placement.limit_px,
        fit.rms_px,
        fit.max_px,
        fit.max_m * 1e3
    );
    if let Some(camera) = &calibration.camera {
        words += &format!(
            "camera: height {:.1} cm, tilt {:.1}°\n",
            camera.mounting.z_m * 100.0,
            camera.mounting.tilt_rad.to_degrees()
        );
    } else {
        words += "no lens without distortion shows the sheet like this: the file holds the floor map alone, which drivers do not use; \
                  name a vehicle whose file has the lens\n";
    }
    words + &format!("calibration: {}", out.display())
}

fn parse_measurements(path: &Path, text: &str) -> Result<Vec<Measurement>> {
    let mut rows = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || (index == 0 && line.starts_with(|c: char| c.is_alphabetic())) {
            continue;
        }
        let numbers: Option<Vec<f64>> = line.split(',').map(|cell| cell.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some([value, revolutions_per_s, volts]) => {
                rows.push(Measurement {
                    value: *value,
                    revolutions_per_s: *revolutions_per_s,
                    volts: *volts,
                });
            }
            _ => bail!(
                "{}:{}: expected value,turns_per_s,volts such as 100,0.73,9.277, but found `{line}`",
                path.display(),
                index + 1
            ),
        }
    }
    Ok(rows)
}
