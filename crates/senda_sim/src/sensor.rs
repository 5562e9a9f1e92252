//! A camera as a sensor: automatic exposure, shutter, noise, JPEG.

use crate::options::{Delivery, SimOptions};
use crate::random::{Random, Source};
use crate::render::{Motion, Noise, Optics, Renderer, Scene, Shot};
use senda_core::codec;
use senda_core::{CodecError, Encoded, Frame, Image, ImageFormat, JpegArtefacts, Stamp};
use senda_geom::{Camera, Pose2, trig};
use senda_world::CameraSpec;

/// Widest image for which [`CameraSpec::blur_px`] is given (px): the blur scales with the width.
const BLUR_WIDTH_PX: f64 = 320.0;

/// One camera of the vehicle.
#[derive(Debug, Clone)]
pub(crate) struct CameraSensor {
    spec: CameraSpec,
    renderer: Renderer,
    random: Random,
    exposure: Option<Exposure>,
    raw: Image,
    /// What JPEG does to a frame, where its bytes are not wanted.
    artefacts: Option<JpegArtefacts>,
}

/// The automatic exposure's state.
#[derive(Debug, Clone, Copy)]
struct Exposure {
    /// Factor on light.
    gain: f64,
    /// The gain that is right at the start, at light level 1: there the shutter is open for its nominal time.
    reference: f64,
}

/// What a frame is taken of.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moment {
    pub(crate) stamp: Stamp,
    pub(crate) world_from_vehicle: Pose2,
    pub(crate) speed_mps: f64,
    pub(crate) yaw_rate_radps: f64,
    pub(crate) light_level: f64,
}

impl CameraSensor {
    pub(crate) fn new(spec: &CameraSpec, index: usize, scene: &Scene, options: &SimOptions) -> Self {
        let mut random = Random::new(options.seed, Source::Camera(index as u64));
        let mut mounting = spec.camera.mounting;
        mounting.tilt_rad += spec.mounting_std_rad * random.normal();
        mounting.yaw_rad += spec.mounting_std_rad * random.normal();
        let camera = Camera {
            mounting,
            ..spec.camera.clone()
        };
        let optics = Optics {
            vignetting: spec.vignetting,
            blur_px: spec.blur_px * f64::from(camera.width_px) / BLUR_WIDTH_PX,
            sharpness: options.sharpness,
        };
        Self {
            renderer: Renderer::new(&camera, scene, &optics),
            spec: spec.clone(),
            random,
            exposure: None,
            raw: Image::default(),
            artefacts: match options.delivery {
                Delivery::Compressed => None,
                Delivery::Pixels => spec.jpeg_quality.map(JpegArtefacts::new),
            },
        }
    }

    /// Exposes a frame, `elapsed_s` after the last one.
    pub(crate) fn expose(
        &mut self,
        scene: &Scene,
        moment: &Moment,
        elapsed_s: f64,
        frame: &mut Frame,
    ) -> Result<(), CodecError> {
        let exposure = match self.exposure {
            Some(exposure) => exposure,
            None => self.first_exposure(scene, moment),
        };
        let settings = &self.spec.exposure;
        // How much more exposure than at the start in light level 1; first by the shutter, then by amplification.
        let more = exposure.gain / exposure.reference;
        let shutter_s = (settings.shutter_s * more).min(settings.shutter_limit_s);
        let amplified = if shutter_s > 0.0 {
            (more * settings.shutter_s / shutter_s).max(1.0)
        } else {
            more.max(1.0)
        };
        let noise = &self.spec.noise;
        let dark = noise.read * amplified;
        let shot = Shot {
            world_from_vehicle: moment.world_from_vehicle,
            time_s: moment.stamp.as_s(),
            gain: [exposure.gain * moment.light_level; 3],
            motion: Motion {
                speed_mps: moment.speed_mps,
                yaw_rate_radps: moment.yaw_rate_radps,
                exposure_s: shutter_s,
            },
            noise: Noise {
                dark,
                bright: (dark * dark + noise.shot * noise.shot * amplified).sqrt(),
                seed: self.random.bits(),
            },
        };
        if frame.camera != self.spec.camera.name {
            frame.camera.clone_from(&self.spec.camera.name);
        }
        frame.stamp = moment.stamp;
        match (self.spec.jpeg_quality, &mut self.artefacts) {
            (None, _) => {
                self.renderer.render(scene, &shot, &mut frame.image);
                frame.encoded = None;
            }
            (Some(_), Some(artefacts)) => {
                self.renderer.render(scene, &shot, &mut self.raw);
                artefacts.apply(&self.raw, &mut frame.image)?;
                frame.encoded = None;
            }
            (Some(quality), None) => {
                self.renderer.render(scene, &shot, &mut self.raw);
                let encoded = frame.encoded.get_or_insert_with(|| Encoded {
                    format: ImageFormat::Jpeg,
                    bytes: Vec::new(),
                });
                encoded.format = ImageFormat::Jpeg;
                codec::encode_jpeg_into(&self.raw, quality, &mut encoded.bytes)?;
                encoded.decode_into(&mut frame.image)?;
            }
        }
        let gain = if settings.automatic {
            let right = exposure.gain * correction(settings.target, &frame.image);
            let kept = if settings.time_constant_s > 0.0 {
                trig::exp(-elapsed_s / settings.time_constant_s)
            } else {
                0.0
            };
            // Exposure control works in stops: in the logarithm of the gain.
            (exposure.gain * trig::pow(right / exposure.gain, 1.0 - kept)).clamp(1e-4, 1e4)
        } else {
            exposure.gain
        };
        self.exposure = Some(Exposure { gain, ..exposure });
        Ok(())
    }

    /// What is right where the run starts, found by trial.
    fn first_exposure(&mut self, scene: &Scene, moment: &Moment) -> Exposure {
        let mut at_level_one = 1.0;
        for _ in 0..4 {
            let shot = Shot {
                gain: [at_level_one; 3],
                ..Shot::still(moment.world_from_vehicle)
            };
            self.renderer.render(scene, &shot, &mut self.raw);
            at_level_one = (at_level_one * correction(self.spec.exposure.target, &self.raw)).clamp(1e-3, 1e3);
        }
        let settings = &self.spec.exposure;
        let gain = if settings.automatic {
            // Over-exposed or under-exposed at first, as cameras are until they have seen some frames.
            at_level_one / moment.light_level.max(1e-3) * settings.start_gain
        } else {
            at_level_one
        };
        Exposure {
            gain,
            reference: at_level_one,
        }
    }
}

/// Factor on the gain that would bring an image's mean to the target (0..=1 of the encoded range).
fn correction(target: f64, image: &Image) -> f64 {
    /// Pixels between those that are measured, across and down.
    const STEP: usize = 4;
    let (mut sum, mut count) = (0u64, 0u64);
    for v in (0..image.height()).step_by(STEP) {
        for pixel in image.row(v).chunks_exact(3).step_by(STEP) {
            sum += u64::from(pixel[0]) + 2 * u64::from(pixel[1]) + u64::from(pixel[2]);
            count += 1;
        }
    }
    let mean = (sum as f64 / (count.max(1) * 4 * 255) as f64).max(0.01);
    let ratio = target / mean;
    // Encoded values are square roots of light.
    ratio * ratio
}
