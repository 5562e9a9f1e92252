//! The calibration file: TOML, version 1.

use super::fit::{placement, reprojection, square_width};
use super::{Calibration, Placement, Reprojection, Sheet};
use senda_geom::{Camera, Homography, Lens, Mat3, Mounting, Vec2, Vec3};
use serde::{Deserialize, Serialize};

/// The version that [`Calibration::to_toml`] writes.
const VERSION: u32 = 1;
/// Numbers that can be computed from others in the file must agree with them this well (px).
const AGREEMENT_PX: f64 = 0.01;
const HEAD: &str = "\
# Camera calibration by senda.
# Pixels: u right, v down, pixel centres at +0.5, for the image size below; frames of other sizes are scaled to it.
# Floor: metres in the vehicle frame, x forward from the axle, y left.
# floor_from_image: (x·w, y·w, w) = matrix · (u, v, 1), rows of the matrix.
# corners_px: near square, then far one; each near left, near right, far left, far right.
# square_width: width of a line as wide as a square = intercept_px + slope_px_per_row · v.
";

/// Why a calibration file cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{source_name}{}: {}{problem}", line.map(|l| format!(":{l}")).unwrap_or_default(), key.as_ref().map(|k| format!("{k}: ")).unwrap_or_default())]
pub struct CalibrationFileError {
    /// The file's name, as given.
    pub source_name: String,
    /// The line (from 1), where one is to blame.
    pub line: Option<usize>,
    /// The key with its tables, such as `sheet.track_m`.
    pub key: Option<String>,
    /// What was expected, what was found, what to do.
    pub problem: String,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: u32,
    width_px: u32,
    height_px: u32,
    floor_from_image: [[f64; 3]; 3],
    corners_px: [[f64; 2]; 8],
    placement: PlacementTable,
    reprojection: ReprojectionTable,
    square_width: WidthTable,
    sheet: Sheet,
    #[serde(skip_serializing_if = "Option::is_none")]
    camera: Option<CameraTable>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlacementTable {
    position_px: f64,
    orientation_px: f64,
    limit_px: f64,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ReprojectionTable {
    rms_px: f64,
    max_px: f64,
    max_m: f64,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct WidthTable {
    intercept_px: f64,
    slope_px_per_row: f64,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    name: String,
    lens: Lens,
    mounting: Mounting,
}

impl Calibration {
    /// The calibration file. [`Calibration::parse`] gives back the same numbers, bit for bit.
    pub fn to_toml(&self) -> String {
        let matrix = self.floor_from_image.matrix();
        let file = File {
            version: VERSION,
            width_px: self.width_px,
            height_px: self.height_px,
            floor_from_image: [0, 1, 2].map(|row| matrix.row(row).to_array()),
            corners_px: self.corners_px.map(|c| [c.x, c.y]),
            placement: PlacementTable {
                position_px: self.placement.position_px,
                orientation_px: self.placement.orientation_px,
                limit_px: self.placement.limit_px,
            },
            reprojection: ReprojectionTable {
                rms_px: self.reprojection.rms_px,
                max_px: self.reprojection.max_px,
                max_m: self.reprojection.max_m,
            },
            square_width: WidthTable {
                intercept_px: self.square_width.intercept_px,
                slope_px_per_row: self.square_width.slope_px_per_row,
            },
            sheet: self.sheet,
            camera: self.camera.as_ref().map(|camera| CameraTable {
                name: camera.name.clone(),
                lens: camera.lens,
                mounting: camera.mounting,
            }),
        };
        let body = toml::to_string(&file).expect("numbers, names and tables are valid TOML");
        // One point or row of the matrix a line. They stand before the first table; behind it a name may hold anything.
        let (points, tables) = body.split_at(body.find("\n[").unwrap_or(body.len()));
        let points = format!("{points}\n")
            .replace("[[", "[\n  [")
            .replace("], [", "],\n  [")
            .replace("]]\n", "],\n]\n");
        format!("{HEAD}{}{tables}", points.trim_end())
    }

    /// Reads a calibration file. Unknown keys are refused, values checked, and the numbers must agree with each other, so
    /// that a damaged digit is noticed. `source_name` is the file's name for errors.
    pub fn parse(source_name: &str, text: &str) -> Result<Self, CalibrationFileError> {
        let reader = Reader { source_name, text };
        let file: File = toml::from_str(text).map_err(|error| reader.syntax(&error))?;
        reader.check(&file)?;
        reader.calibration(file)
    }
}

struct Reader<'a> {
    source_name: &'a str,
    text: &'a str,
}

impl Reader<'_> {
    fn line_at(&self, byte: usize) -> usize {
        1 + self.text.bytes().take(byte).filter(|b| *b == b'\n').count()
    }

    fn syntax(&self, error: &toml::de::Error) -> CalibrationFileError {
        let message = error.message();
        let problem = if message.starts_with("missing field") {
            format!("{message}; the file is incomplete: calibrate again")
        } else {
            senda_toml::with_nearest(message)
        };
        CalibrationFileError {
            source_name: self.source_name.to_owned(),
            line: error.span().map(|span| self.line_at(span.start)),
            key: None,
            problem,
        }
    }

    fn wrong(&self, key: &str, problem: String) -> CalibrationFileError {
        CalibrationFileError {
            source_name: self.source_name.to_owned(),
            line: self.line_of(key),
            key: Some(key.to_owned()),
            problem,
        }
    }

    /// The line on which a key's value begins.
    fn line_of(&self, key: &str) -> Option<usize> {
        let root = toml::de::DeTable::parse(self.text).ok()?;
        let mut table = root.get_ref();
        let mut byte = None;
        for part in key.split('.') {
            let (_, value) = table.iter().find(|(name, _)| name.get_ref().as_ref() == part)?;
            byte = Some(value.span().start);
            match value.get_ref() {
                toml::de::DeValue::Table(inner) => table = inner,
                _ => break,
            }
        }
        byte.map(|byte| self.line_at(byte))
    }

    fn check(&self, file: &File) -> Result<(), CalibrationFileError> {
        if file.version != VERSION {
            let found = file.version;
            return Err(self.wrong(
                "version",
                format!("expected {VERSION}, but found {found}: the file was written by another senda"),
            ));
        }
        for (key, size) in [("width_px", file.width_px), ("height_px", file.height_px)] {
            if !(1..=65_536).contains(&size) {
                return Err(self.wrong(key, format!("expected 1 to 65536 px, but found {size}")));
            }
        }
        let matrix = file.floor_from_image.as_flattened();
        let corners = file.corners_px.as_flattened();
        let (placed, fitted) = (&file.placement, &file.reprojection);
        let mut numbers: Vec<(&str, &[f64], f64, f64)> = vec![
            ("floor_from_image", matrix, -1e12, 1e12),
            ("corners_px", corners, -1e5, 1e5),
            (
                "placement.position_px",
                std::slice::from_ref(&placed.position_px),
                -1e5,
                1e5,
            ),
            (
                "placement.orientation_px",
                std::slice::from_ref(&placed.orientation_px),
                -1e5,
                1e5,
            ),
            (
                "placement.limit_px",
                std::slice::from_ref(&placed.limit_px),
                0.0,
                1e5,
            ),
            (
                "reprojection.rms_px",
                std::slice::from_ref(&fitted.rms_px),
                0.0,
                1e5,
            ),
            (
                "reprojection.max_px",
                std::slice::from_ref(&fitted.max_px),
                0.0,
                1e5,
            ),
            (
                "reprojection.max_m",
                std::slice::from_ref(&fitted.max_m),
                0.0,
                1e3,
            ),
            (
                "square_width.intercept_px",
                std::slice::from_ref(&file.square_width.intercept_px),
                -1e6,
                1e6,
            ),
            (
                "square_width.slope_px_per_row",
                std::slice::from_ref(&file.square_width.slope_px_per_row),
                -1e4,
                1e4,
            ),
        ];
        let mounting;
        if let Some(camera) = &file.camera {
            let m = camera.mounting;
            mounting = [m.x_m, m.y_m, m.z_m, m.yaw_rad, m.tilt_rad, m.roll_rad];
            numbers.push(("camera.mounting", &mounting, -100.0, 100.0));
        }
        for (key, values, low, high) in numbers {
            for value in values {
                if !(low..=high).contains(value) {
                    return Err(self.wrong(
                        key,
                        format!("expected numbers from {low} to {high}, but found {value}"),
                    ));
                }
            }
        }
        file.sheet
            .check()
            .map_err(|error| self.wrong("sheet", error.to_string()))
    }

    fn calibration(&self, file: File) -> Result<Calibration, CalibrationFileError> {
        let rows = file.floor_from_image.map(|[a, b, c]| Vec3::new(a, b, c));
        let corners_px = file.corners_px.map(|[u, v]| Vec2::new(u, v));
        let camera = file.camera.map(|table| Camera {
            name: table.name,
            width_px: file.width_px,
            height_px: file.height_px,
            lens: table.lens,
            mounting: table.mounting,
        });
        let calibration = Calibration {
            width_px: file.width_px,
            height_px: file.height_px,
            floor_from_image: Homography::from_matrix(Mat3::from_cols(rows[0], rows[1], rows[2]).transpose()),
            corners_px,
            sheet: file.sheet,
            placement: Placement {
                position_px: file.placement.position_px,
                orientation_px: file.placement.orientation_px,
                limit_px: file.placement.limit_px,
                // Not in the file: they follow from the corners.
                ..placement(&corners_px, &file.sheet, file.width_px, 0.0)
            },
            reprojection: Reprojection {
                rms_px: file.reprojection.rms_px,
                max_px: file.reprojection.max_px,
                max_m: file.reprojection.max_m,
            },
            square_width: crate::WidthProfile {
                intercept_px: file.square_width.intercept_px,
                slope_px_per_row: file.square_width.slope_px_per_row,
                width_px: file.width_px,
                height_px: file.height_px,
            },
            camera,
        };
        self.check_agreement(&calibration)?;
        Ok(calibration)
    }

    /// The same facts are in the file twice: as corners and as what was computed from them.
    fn check_agreement(&self, calibration: &Calibration) -> Result<(), CalibrationFileError> {
        let disagrees = |key: &str, says: f64, gives: f64| {
            let problem = format!(
                "the file says {says}, but its corners_px give {gives}: the file is damaged or was edited; calibrate again"
            );
            Err(self.wrong(key, problem))
        };
        let agree = |a: f64, b: f64| (a - b).abs() <= AGREEMENT_PX;
        let (says, corners) = (&calibration.placement, &calibration.corners_px);
        let gives = placement(corners, &calibration.sheet, calibration.width_px, 0.0);
        if !agree(says.position_px, gives.position_px) {
            return disagrees("placement.position_px", says.position_px, gives.position_px);
        }
        if !agree(says.orientation_px, gives.orientation_px) {
            return disagrees(
                "placement.orientation_px",
                says.orientation_px,
                gives.orientation_px,
            );
        }
        let says = &calibration.square_width;
        let gives = square_width(corners, calibration.width_px, calibration.height_px);
        if !agree(says.intercept_px, gives.intercept_px) {
            return disagrees("square_width.intercept_px", says.intercept_px, gives.intercept_px);
        }
        // Over the height of the picture.
        let height = f64::from(calibration.height_px);
        if !agree(says.slope_px_per_row * height, gives.slope_px_per_row * height) {
            return disagrees(
                "square_width.slope_px_per_row",
                says.slope_px_per_row,
                gives.slope_px_per_row,
            );
        }
        let says = calibration.reprojection.max_px;
        // The homography of a file with a camera is for programs that know no lenses; check it as well.
        let pinhole_only = Calibration {
            camera: None,
            ..calibration.clone()
        };
        let bends = calibration
            .camera
            .as_ref()
            .is_some_and(|c| !matches!(c.lens, Lens::Pinhole { .. }));
        for (key, judged) in [("camera", calibration), ("floor_from_image", &pinhole_only)] {
            if key == "floor_from_image" && bends {
                continue;
            }
            let gives = reprojection(judged).map_or(f64::INFINITY, |r| r.max_px);
            if !agree(says, gives) {
                let key = if calibration.camera.is_none() {
                    "floor_from_image"
                } else {
                    key
                };
                let problem = format!(
                    "takes the sheet's corners {gives:.2} px from corners_px, where the file says {says:.2} px: the file is damaged or was edited; calibrate again"
                );
                return Err(self.wrong(key, problem));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
