//! From a camera's frame to line candidates on the floor: what `line` and `lane` both see by.

use crate::candidate::{Candidate, Look, Rows, describe};
use crate::options::{DriverError, check};
use senda_core::{Body, Explanation, Frame, Image, Observation, Stamp};
use senda_geom::{Camera, Vec2};
use senda_vision::{
    BlobLimits, Contrast, ExtractorOptions, FloorMap, JoinLimits, LineBlob, LineExtractor, LineJoiner,
    Statistics, WidthProfile,
};
use serde::{Deserialize, Serialize};

/// Whether lines are dark or light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ContrastChoice {
    /// Decided from what the first frames show (C4), and again as long as no line has been tracked.
    #[default]
    Auto,
    /// Dark lines on a lighter floor.
    Dark,
    /// Light lines on a darker floor.
    Light,
}

/// How the driver looks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SightOptions {
    /// Width of the line that is expected (m). The filters have wide margins: 1 to 4 cm pass with the default.
    pub line_width_m: f64,
    /// Dark or light lines.
    pub contrast: ContrastChoice,
    /// Points of a line further ahead than this are not used for its shape (m).
    pub range_m: f64,
    /// Points are not used where one image row is more than this on the floor (m): there, a pixel decides too much.
    pub row_footprint_m: f64,
    /// The image operations (C3, C5).
    pub extractor: ExtractorOptions,
}

impl Default for SightOptions {
    fn default() -> Self {
        Self {
            line_width_m: 0.02,
            contrast: ContrastChoice::Auto,
            range_m: 1.5,
            row_footprint_m: 0.03,
            extractor: ExtractorOptions::default(),
        }
    }
}

impl SightOptions {
    /// Refuses what makes no sense.
    pub fn validate(&self) -> Result<(), DriverError> {
        check("sight.line_width_m", self.line_width_m, 0.001, 10.0)?;
        check("sight.range_m", self.range_m, 0.05, 1000.0)?;
        check("sight.row_footprint_m", self.row_footprint_m, 0.001, 10.0)
    }
}

/// Camera, extraction and floor map for the image size in use.
pub(crate) struct Sight {
    camera: Camera,
    options: SightOptions,
    eye: Option<Eye>,
    contrast: Option<Contrast>,
    /// Sums of scores over the frames so far, newer ones counting more: dark, light.
    votes: [f64; 2],
    settled: bool,
    last_stamp: Option<Stamp>,
    /// How the line looks, once followed.
    known: Option<Look>,
    candidates: Vec<Candidate>,
    count: usize,
    /// So many of them are whole; the others are pieces.
    whole: usize,
    /// The contrast voted for has shown nothing: this one is tried.
    tried: Option<Contrast>,
    tries: u32,
    /// Dashes have been seen that make up a line: from now on they are joined in every frame.
    dashed: bool,
    /// Frames in a row that showed something faint and nothing better, as long as no line has been begun with.
    faint_frames: u32,
    statistics: Statistics,
}

/// What depends on the image size.
struct Eye {
    extractor: LineExtractor,
    map: FloorMap,
    profile: WidthProfile,
    joiner: LineJoiner,
}

/// The lines of the frame that was looked at last, those of `pieces` or more joined. Two pieces may be smaller than a whole
/// line.
fn joined<'a>(
    extractor: &'a mut LineExtractor,
    joiner: &'a mut LineJoiner,
    map: &FloorMap,
    pieces: usize,
    limits: &BlobLimits,
) -> &'a [LineBlob] {
    joiner.set_limits(JoinLimits {
        pieces,
        ..JoinLimits::default()
    });
    let fragments: &[LineBlob] = if pieces < DASHES {
        extractor.fragments();
        extractor.found_fragments()
    } else {
        &[]
    };
    joiner.join(extractor.blobs(), fragments, map, limits)
}

/// Images smaller than this to a side show nothing (px).
const SMALLEST_SIDE_PX: usize = 16;
/// Rows of a whole candidate may differ from the line's known breadth by this factor: a lamp's image that touches the line
/// is wider, exposure and wear change less.
const BREADTH_OF_WHOLE: f64 = 1.8;
/// Rows of a piece.
const BREADTH_OF_PIECE: f64 = 1.4;
/// Part of the difference by which a frame changes how the line is known to look.
const LOOK_LEARNED: f64 = 0.1;
/// Both contrasts.
const TRIES_BEFORE_DASHES: u32 = 2;
/// Both contrasts, twice.
const TRIES_BEFORE_ONE_DASH: u32 = 4;
/// A single dash is at least this long (m) ...
const SINGLE_DASH_M: f64 = 0.04;
/// ... and stands out by so many times what noise may.
const SINGLE_DASH_STRENGTH: f64 = 4.0;
/// So many pieces that make up a line are dashes; two may be a line with a reflection across it.
const DASHES: usize = 3;
/// So many pieces of lines are looked at, those with the largest scores.
const PIECES_LIMIT: usize = 16;
/// What stands out by less than so many times what noise may is faint ...
const FAINT_STRENGTH: f64 = 2.0;
/// ... and no line to begin with before so many frames in a row have shown it: before the exposure has settled a single
/// frame shows noise as strong.
const FAINT_FRAMES: u32 = 4;
/// With less than this part of its rows whole a blob is cut by the picture's side.
const CUT_PART: f64 = 0.3;
/// A line cut by the picture's side must fill this part of its rows to begin with.
const LEAST_ROWS_ASIDE: f64 = 0.2;

impl Sight {
    pub(crate) fn new(body: &Body, options: &SightOptions) -> Result<Self, DriverError> {
        options.validate()?;
        let camera = body.cameras.first().ok_or_else(|| DriverError::NoCamera {
            body: body.name.clone(),
        })?;
        let lowest = Vec2::new(
            f64::from(camera.width_px) / 2.0,
            f64::from(camera.height_px) - 0.5,
        );
        if !camera
            .floor_from_pixel(lowest)
            .is_some_and(|floor| floor.length() < 100.0)
        {
            return Err(DriverError::NoFloor {
                body: body.name.clone(),
                camera: camera.name.clone(),
            });
        }
        Ok(Self {
            camera: camera.clone(),
            options: options.clone(),
            eye: None,
            contrast: match options.contrast {
                ContrastChoice::Auto => None,
                ContrastChoice::Dark => Some(Contrast::Dark),
                ContrastChoice::Light => Some(Contrast::Light),
            },
            votes: [0.0; 2],
            settled: options.contrast != ContrastChoice::Auto,
            last_stamp: None,
            known: None,
            candidates: Vec::new(),
            count: 0,
            whole: 0,
            tried: None,
            tries: 0,
            dashed: false,
            faint_frames: 0,
            statistics: Statistics::default(),
        })
    }

    /// The frame of this driver's camera, if the observation has a new one.
    pub(crate) fn new_frame<'a>(&mut self, observation: &'a Observation) -> Option<&'a Frame> {
        let frame = observation
            .frame(&self.camera.name)
            .or_else(|| observation.first_frame())?;
        // Recordings without times have 0 everywhere; they are all new.
        let repeated = frame.stamp.ns != 0 && self.last_stamp == Some(frame.stamp);
        self.last_stamp = Some(frame.stamp);
        (!repeated).then_some(frame)
    }

    /// Makes ready for frames of a size; `false` where they are too small to show anything.
    fn open(&mut self, width: usize, height: usize) -> bool {
        if width < SMALLEST_SIDE_PX || height < SMALLEST_SIDE_PX {
            return false;
        }
        let fits = self
            .eye
            .as_ref()
            .is_some_and(|eye| (eye.map.width(), eye.map.height()) == (width, height));
        if !fits {
            let profile = WidthProfile::from_camera(&self.camera, self.options.line_width_m)
                .scaled(width as u32, height as u32);
            self.eye = Some(Eye {
                extractor: LineExtractor::new(width, height, &profile, self.options.extractor.clone()),
                map: FloorMap::from_camera(&self.camera, width, height),
                profile,
                joiner: LineJoiner::default(),
            });
        }
        true
    }

    /// Where the pixels of a frame lie on the floor, without looking for lines in it.
    pub(crate) fn map_for(&mut self, frame: &Frame) -> Option<&FloorMap> {
        self.close();
        self.statistics = Statistics::default();
        if !self.open(frame.image.width(), frame.image.height()) {
            return None;
        }
        self.eye.as_ref().map(|eye| &eye.map)
    }

    /// Looks at a frame; afterwards [`Sight::candidates`] are those of this frame.
    pub(crate) fn look(&mut self, frame: &Frame) {
        self.close();
        self.statistics = Statistics::default();
        let (width, height) = (frame.image.width(), frame.image.height());
        if !self.open(width, height) {
            return;
        }
        self.choose_contrast(&frame.image);
        let Some(eye) = &mut self.eye else { return };
        let Eye {
            extractor,
            map,
            profile,
            joiner,
        } = eye;
        let contrast = self.contrast.unwrap_or(Contrast::Dark);
        let count = extractor.extract(&frame.image, contrast).len();
        self.statistics = extractor.statistics();
        // To begin with dashes, each of which is too small to be a line. Specks make chains too: only when neither contrast
        // shows anything better.
        let begins = count == 0 && !self.settled && self.tries >= TRIES_BEFORE_DASHES;
        let lines = if begins || self.dashed {
            joined(extractor, joiner, map, 2, &self.options.extractor.limits)
        } else if self.settled && count >= DASHES {
            joined(extractor, joiner, map, DASHES, &self.options.extractor.limits)
        } else {
            extractor.blobs()
        };
        if self.faint_frames < FAINT_FRAMES {
            let least = FAINT_STRENGTH * self.options.extractor.limits.strength;
            self.faint_frames = match lines {
                [] => 0,
                _ if lines.iter().any(|blob| blob.residue_mean >= least) => FAINT_FRAMES,
                _ => self.faint_frames + 1,
            };
        }
        let lines = if self.faint_frames < FAINT_FRAMES {
            &[]
        } else {
            lines
        };
        self.dashed |= !lines.is_empty() && (begins || lines.len() < count);
        for blob in lines {
            if self.known.is_some_and(|look| !look.stands_out(blob)) {
                continue;
            }
            let rows = match self.known {
                _ if blob.whole_part() < CUT_PART => Rows::Cut,
                Some(look) => Rows::AsBroadAs(look.breadth, BREADTH_OF_WHOLE),
                None => Rows::Whole,
            };
            let candidate = next(&mut self.candidates, &mut self.count);
            describe(blob, map, profile, &self.options, rows, candidate);
        }
        if begins && self.count == 0 && self.tries >= TRIES_BEFORE_ONE_DASH {
            self.take_single_dashes();
        }
        self.whole = self.count;
    }

    /// Dark or light lines: what is being tried, else what the frames so far show more of, as long as no line has been tracked.
    fn choose_contrast(&mut self, image: &Image) {
        let Some(eye) = &mut self.eye else { return };
        if let Some(tried) = self.tried {
            self.contrast = Some(tried);
        } else if !self.settled {
            let scores = eye.extractor.contrast_scores(image);
            self.votes = [
                0.8 * self.votes[0] + scores.dark,
                0.8 * self.votes[1] + scores.light,
            ];
            self.contrast = Some(if self.votes[0] == 0.0 && self.votes[1] == 0.0 {
                eye.extractor.decide_contrast(image)
            } else if self.votes[0] >= self.votes[1] {
                Contrast::Dark
            } else {
                Contrast::Light
            });
        }
    }

    /// To begin where a short view shows one dash and a gap: dashes that stand out far more than specks do.
    fn take_single_dashes(&mut self) {
        let Some(eye) = &mut self.eye else { return };
        let least = SINGLE_DASH_STRENGTH * self.options.extractor.limits.strength;
        for blob in eye.extractor.found_fragments() {
            if blob.residue_mean < least {
                continue;
            }
            let candidate = next(&mut self.candidates, &mut self.count);
            describe(
                blob,
                &eye.map,
                &eye.profile,
                &self.options,
                Rows::Whole,
                candidate,
            );
            let ends = candidate.points.first().zip(candidate.points.last());
            if !ends.is_some_and(|(near, far)| (far.at - near.at).length() >= SINGLE_DASH_M) {
                self.count -= 1;
            }
        }
        if self.count > 0 {
            (self.dashed, self.faint_frames) = (true, FAINT_FRAMES);
        }
    }

    /// The candidate of this index is the line, or one of its lines: pieces must look like it from now on.
    pub(crate) fn learn(&mut self, index: usize) {
        if index < self.whole {
            let seen = self.candidates[index].look;
            let known = self.known.get_or_insert(seen);
            known.strength += LOOK_LEARNED * (seen.strength - known.strength);
            known.breadth += LOOK_LEARNED * (seen.breadth - known.breadth);
        }
    }

    /// Looks at the same frame again for pieces of the line: dashes, and what reflections leave of it. They follow the
    /// whole candidates, and count as a line only where one is expected. Before a line was followed: a line that the
    /// picture's side cuts.
    pub(crate) fn look_closer(&mut self) {
        let Some(look) = self.known else {
            return self.look_aside();
        };
        self.count = self.whole;
        let Some(eye) = &mut self.eye else { return };
        let pieces = eye.extractor.pieces().iter().filter(|piece| look.is_like(piece));
        for blob in pieces.take(PIECES_LIMIT) {
            let candidate = next(&mut self.candidates, &mut self.count);
            let rows = Rows::AsBroadAs(look.breadth, BREADTH_OF_PIECE);
            describe(blob, &eye.map, &eye.profile, &self.options, rows, candidate);
        }
    }

    /// Looks at the same frame again for a line that the picture's side cuts; the one that stands out most, if any. For
    /// beginning in a curve, when nothing better is in sight.
    pub(crate) fn look_aside(&mut self) {
        self.count = self.whole;
        let Some(eye) = &mut self.eye else { return };
        let least_rows = LEAST_ROWS_ASIDE * eye.map.height() as f64;
        let shown = |blob: &LineBlob| blob.residue_mean * blob.rows.len() as f64;
        let cut = |blob: &&LineBlob| blob.whole_part() < CUT_PART && blob.rows.len() as f64 > least_rows;
        let most = eye
            .extractor
            .pieces()
            .iter()
            .filter(cut)
            .max_by(|a, b| shown(a).total_cmp(&shown(b)));
        if let Some(blob) = most {
            self.faint_frames = FAINT_FRAMES;
            let candidate = next(&mut self.candidates, &mut self.count);
            describe(blob, &eye.map, &eye.profile, &self.options, Rows::Cut, candidate);
        }
    }

    /// The candidates of the last frame: the whole ones, largest score first, then the pieces.
    pub(crate) fn candidates(&self) -> &[Candidate] {
        &self.candidates[..self.count]
    }

    /// The whole candidates of the last frame.
    pub(crate) fn whole(&self) -> &[Candidate] {
        &self.candidates[..self.whole]
    }

    /// Forgets the last frame's candidates: there is no new frame.
    pub(crate) fn close(&mut self) {
        (self.count, self.whole) = (0, 0);
    }

    /// Nothing was found for a while: from now on the other contrast.
    pub(crate) fn doubt(&mut self) {
        if !self.settled {
            self.tries += 1;
            self.tried = Some(match self.contrast {
                Some(Contrast::Dark) => Contrast::Light,
                Some(Contrast::Light) | None => Contrast::Dark,
            });
        }
    }

    /// The contrast is right: a line has been tracked with it.
    pub(crate) fn settle(&mut self) {
        self.settled = true;
    }

    /// The contrast in use.
    pub(crate) fn contrast(&self) -> Option<Contrast> {
        self.contrast
    }

    /// Mean, maximum and threshold of the last frame.
    pub(crate) fn statistics(&self) -> Statistics {
        self.statistics
    }

    /// Width of the frames in use (px); of the camera's description before the first frame.
    pub(crate) fn width_px(&self) -> f64 {
        self.eye
            .as_ref()
            .map_or(f64::from(self.camera.width_px), |eye| eye.map.width() as f64)
    }

    /// Whether a floor point lies well inside the picture.
    pub(crate) fn sees(&self, floor: Vec2) -> bool {
        let Some(eye) = &self.eye else { return false };
        let (width, height) = (eye.map.width() as f64, eye.map.height() as f64);
        floor.length() < self.options.range_m
            && eye.map.pixel(floor).is_some_and(|pixel| {
                let margin = 0.05 * width;
                pixel.x > margin
                    && pixel.x < width - margin
                    && pixel.y > 0.04 * height
                    && pixel.y < height - 2.0
            })
    }

    /// Draws floor points as a line over the picture.
    pub(crate) fn draw_floor_line(
        &self,
        explanation: &mut Explanation,
        points: impl Iterator<Item = Vec2>,
        color: &str,
    ) {
        let Some(eye) = &self.eye else { return };
        let (width, height) = (eye.map.width() as f64, eye.map.height() as f64);
        let pixels: Vec<[f32; 2]> = points
            .filter_map(|floor| eye.map.pixel(floor))
            .filter(|pixel| {
                pixel.x > -width && pixel.x < 2.0 * width && pixel.y > -height && pixel.y < 2.0 * height
            })
            .map(|pixel| [pixel.x as f32, pixel.y as f32])
            .collect();
        if pixels.len() > 1 {
            explanation.polyline(pixels, color, false);
        }
    }

    /// Marks a floor point.
    pub(crate) fn draw_floor_point(&self, explanation: &mut Explanation, floor: Vec2, color: &str) {
        let Some(eye) = &self.eye else { return };
        if let Some(pixel) = eye.map.pixel(floor) {
            if pixel.is_finite() && pixel.length() < 1e5 {
                let radius = (eye.map.width() as f32 / 60.0).max(1.5);
                explanation.circle([pixel.x as f32, pixel.y as f32], radius, color);
            }
        }
    }
}

/// The next candidate of a frame, in memory that earlier frames used.
fn next<'a>(candidates: &'a mut Vec<Candidate>, count: &mut usize) -> &'a mut Candidate {
    if *count == candidates.len() {
        candidates.push(Candidate::roomy());
    }
    *count += 1;
    &mut candidates[*count - 1]
}
