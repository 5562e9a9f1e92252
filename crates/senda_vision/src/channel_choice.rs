//! Which grey picture shows the lines of a frame best: coloured tape on a floor of the same brightness (A5 in SPEC).

use crate::{Channel, Contrast, LineBlob, LineExtractor};
use senda_core::{Channels, Image};
use senda_geom::{Mat3, Vec3};

/// What is tried besides luminance: colourfulness, and the two opponent axes of the eye.
const CANDIDATES: [Channel; 3] = [
    Channel::Chroma,
    Channel::Projection {
        red: 0.5,
        green: -0.5,
        blue: 0.0,
        offset: 128.0,
    },
    Channel::Projection {
        red: -0.25,
        green: -0.25,
        blue: 0.5,
        offset: 128.0,
    },
];

/// Luminance stays while it shows the lines at least this part as well as the best (guess): it is the document's,
/// and cameras deliver it with less noise than colour.
const LUMINANCE_PREFERENCE: f64 = 0.5;

/// Variance (grey levels²) that is added to each colour of floor and line: the sensor's noise, so that a flat
/// synthetic floor does not make one axis look perfect.
const NOISE_VARIANCE: f64 = 16.0;

impl LineExtractor {
    /// Looks for the channel and contrast in which this frame shows its lines best (C4, and coloured tape of the
    /// floor's brightness: A5 in SPEC), and uses that channel from now on. Luminance unless another is clearly better.
    ///
    /// Candidates are luminance, chroma and two opponent colours. If one of the latter wins, its lines and the floor
    /// beside them teach a projection that separates the two best (Fisher's linear discriminant), which is used if it
    /// shows them better still. About a dozen extractions: for the first frame of a run, or after a loss.
    pub fn decide(&mut self, image: &Image) -> Contrast {
        self.use_channel(Channel::Luminance);
        let (plain_contrast, luminance) = self.better_contrast(image);
        if image.channels() == Channels::Gray {
            return self.decide_contrast(image);
        }
        let mut best = (Channel::Luminance, plain_contrast, luminance);
        for channel in CANDIDATES {
            self.use_channel(channel);
            let (contrast, strength) = self.better_contrast(image);
            if strength > best.2 {
                best = (channel, contrast, strength);
            }
        }
        if luminance >= LUMINANCE_PREFERENCE * best.2 {
            self.use_channel(Channel::Luminance);
            return self.decide_contrast(image);
        }
        self.use_channel(best.0);
        self.extract(image, best.1);
        self.fragments();
        let parts = self.blobs().iter().chain(self.found_fragments());
        if let Some(channel) = discriminant(image, parts) {
            self.use_channel(channel);
            let (contrast, strength) = self.better_contrast(image);
            if strength > best.2 {
                best = (channel, contrast, strength);
            }
        }
        self.use_channel(best.0);
        best.1
    }

    /// The contrast that shows more, and how much: the sum over the blobs of score times residue against the residue
    /// elsewhere, which makes channels of different noise comparable.
    fn better_contrast(&mut self, image: &Image) -> (Contrast, f64) {
        let mut strength = |contrast| -> f64 {
            self.extract(image, contrast);
            let pixels = (self.width() * self.height()) as f64;
            let (mut area, mut total, mut shown) = (0.0, 0.0, 0.0);
            self.fragments();
            for blob in self.blobs().iter().chain(self.found_fragments()) {
                area += blob.area_px;
                total += blob.area_px * blob.residue_mean;
                shown += blob.score * blob.whole_part() * blob.residue_mean;
            }
            let elsewhere = (self.statistics().mean * pixels - total).max(0.0) / (pixels - area).max(1.0);
            shown / (elsewhere + 1.0)
        };
        let (dark, light) = (strength(Contrast::Dark), strength(Contrast::Light));
        if light > dark {
            (Contrast::Light, light)
        } else {
            (Contrast::Dark, dark)
        }
    }
}

/// Mean and scatter of a set of colours.
#[derive(Default)]
struct Colours {
    count: f64,
    sum: Vec3,
    products: Mat3,
}

impl Colours {
    fn add(&mut self, pixel: &[u8]) {
        let colour = Vec3::new(f64::from(pixel[0]), f64::from(pixel[1]), f64::from(pixel[2]));
        self.count += 1.0;
        self.sum += colour;
        self.products += Mat3::from_cols(colour * colour.x, colour * colour.y, colour * colour.z);
    }

    fn mean(&self) -> Vec3 {
        self.sum / self.count
    }

    fn covariance(&self) -> Mat3 {
        let mean = self.mean();
        self.products * (1.0 / self.count) - Mat3::from_cols(mean * mean.x, mean * mean.y, mean * mean.z)
    }
}

/// The projection that separates the blobs' colours from those beside them; lines come out light.
fn discriminant<'a>(image: &Image, blobs: impl Iterator<Item = &'a LineBlob>) -> Option<Channel> {
    let (mut line, mut floor) = (Colours::default(), Colours::default());
    for row in blobs.flat_map(|blob| &blob.rows) {
        let y = row.v as usize;
        if row.at_edge || y >= image.height() {
            continue;
        }
        // The middle half of the line; and beside it, from one width off the middle on, clear of the blurred edge.
        let take = |from: f64, to: f64, colours: &mut Colours| {
            let (from, to) = (from.max(0.0) as usize, to.max(0.0) as usize);
            for x in from..to.min(image.width()) {
                colours.add(image.pixel(x, y));
            }
        };
        let width = row.width_px;
        take(row.u - 0.25 * width, row.u + 0.25 * width, &mut line);
        take(row.u - 1.5 * width, row.u - width, &mut floor);
        take(row.u + width, row.u + 1.5 * width, &mut floor);
    }
    if line.count < 30.0 || floor.count < 30.0 {
        return None;
    }
    let scatter =
        (line.covariance() + floor.covariance()) * 0.5 + Mat3::from_diagonal(Vec3::splat(NOISE_VARIANCE));
    let weights = scatter.inverse() * (line.mean() - floor.mean());
    let size = weights.x.abs() + weights.y.abs() + weights.z.abs();
    if !(size > 0.0 && size.is_finite()) {
        return None;
    }
    let weights = weights / size;
    let middle = (line.mean() + floor.mean()) / 2.0;
    Some(Channel::Projection {
        red: weights.x,
        green: weights.y,
        blue: weights.z,
        offset: 128.0 - weights.dot(middle),
    })
}
