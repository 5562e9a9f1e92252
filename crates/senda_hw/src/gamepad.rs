//! Gamepads and steering wheels through Linux's event devices (`/dev/input/event*`).
//!
//! What the kernel's numbers mean is in [`Layout`], which is plain arithmetic; [`Gamepad`] is the open device.

use std::path::PathBuf;
use thiserror::Error;

/// What a person does with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Turned the wheel or the left stick: -1 full right to 1 full left.
    Steering(f64),
    /// Moved the pedal or the right trigger: 0 to 1.
    Pedal(f64),
    /// Pressed left on the cross.
    Left,
    /// Pressed right on the cross.
    Right,
    /// Pressed the lower button (A, cross), or the first one of a wheel: drive.
    Go,
    /// Pressed the right button (B, circle), or the second one of a wheel: stand.
    Stop,
    /// Pressed start or the middle button: end.
    Quit,
    /// It is not there any more.
    Gone,
}

/// Why there is no gamepad.
#[derive(Debug, Error)]
pub enum GamepadError {
    /// None among the devices that may be read.
    #[error(
        "expected a gamepad or steering wheel, but found none among {readable} devices of /dev/input that may be read{}; plug one in, or name its device",
        forbidden_words(*forbidden)
    )]
    None {
        /// Devices that were looked at.
        readable: usize,
        /// Devices that may not be read.
        forbidden: usize,
    },
    /// A device that cannot be opened.
    #[error("{}: cannot be opened: {source}{}", path.display(), permission_words(source))]
    Open {
        /// Which one.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// A device without a steering axis: a keyboard, a mouse.
    #[error("{}: expected a gamepad or steering wheel, but found `{name}`, which has no axis to steer with", path.display())]
    NoSteering {
        /// Which one.
        path: PathBuf,
        /// What it calls itself.
        name: String,
    },
    /// Not on this system.
    #[error(
        "gamepads are read through Linux's event devices, which this system does not have; drive by keyboard"
    )]
    NotHere,
}

const PERMISSION: &str =
    "add yourself to the group `input` (`sudo usermod -aG input $USER`) and log in again";

fn forbidden_words(forbidden: usize) -> String {
    match forbidden {
        0 => String::new(),
        count => format!(" ({count} more may not be read: {PERMISSION})"),
    }
}

fn permission_words(source: &std::io::Error) -> String {
    match source.kind() {
        std::io::ErrorKind::PermissionDenied => format!("; {PERMISSION}"),
        _ => String::new(),
    }
}

/// The range of an axis, and where it is when nobody touches it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Axis {
    /// Smallest value.
    pub low: i32,
    /// Largest value.
    pub high: i32,
    /// Value when the device was opened.
    pub rest: i32,
}

impl Axis {
    /// -1 at the low end to 1 at the high end.
    fn part(self, value: i32) -> f64 {
        let (low, high) = (f64::from(self.low), f64::from(self.high));
        if !(high > low) {
            return 0.0;
        }
        ((f64::from(value) - low) / (high - low) * 2.0 - 1.0).clamp(-1.0, 1.0)
    }

    /// A pedal rests at one of its ends.
    fn rests_at_end(self) -> bool {
        self.part(self.rest).abs() > 0.8
    }

    /// 0 at rest to 1 at the other end: many pedals count down.
    fn pressed(self, value: i32) -> f64 {
        let part = if self.part(self.rest) > 0.0 {
            -self.part(value)
        } else {
            self.part(value)
        };
        (part + 1.0) / 2.0
    }
}

/// An event as the kernel gives it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Raw {
    /// Kind: [`Raw::KEY`] or [`Raw::AXIS`].
    pub kind: u16,
    /// Which key or axis.
    pub code: u16,
    /// Its value.
    pub value: i32,
}

/// Numbers of `linux/input-event-codes.h`.
impl Raw {
    /// A key or button.
    pub const KEY: u16 = 0x01;
    /// An absolute axis.
    pub const AXIS: u16 = 0x03;

    const X: u16 = 0x00;
    const Z: u16 = 0x02;
    const RZ: u16 = 0x05;
    const GAS: u16 = 0x09;
    const CROSS_X: u16 = 0x10;

    const JOYSTICK: u16 = 0x120;
    const SOUTH: u16 = 0x130;
    const EAST: u16 = 0x131;
    const START: u16 = 0x13b;
    const MODE: u16 = 0x13c;
    const WHEEL: u16 = 0x150;
}

/// What the axes of a device mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    steering: Axis,
    pedal: Option<(u16, Axis)>,
}

impl Layout {
    /// The steering axis, and code and range of the pedal's, where there is one.
    pub fn new(steering: Axis, pedal: Option<(u16, Axis)>) -> Self {
        Self { steering, pedal }
    }

    /// Of a device with these axes and buttons; `None` where nothing steers, or it is no gamepad.
    pub fn of(axis: impl Fn(u16) -> Option<Axis>, has_button: impl Fn(u16) -> bool) -> Option<Self> {
        let is_pad = has_button(Raw::SOUTH);
        if !(is_pad || has_button(Raw::JOYSTICK) || has_button(Raw::WHEEL)) {
            return None;
        }
        // On pads Z is the left trigger, on wheels it is the accelerator.
        let order = if is_pad {
            [Raw::GAS, Raw::RZ]
        } else {
            [Raw::GAS, Raw::Z]
        };
        let pedal = order
            .into_iter()
            .filter_map(|code| Some((code, axis(code)?)))
            .find(|(_, axis)| axis.rests_at_end());
        Some(Self::new(axis(Raw::X)?, pedal))
    }

    /// What an event means; `None`: nothing.
    pub fn motion(&self, raw: Raw) -> Option<Motion> {
        match (raw.kind, raw.code, raw.value) {
            // The kernel counts to the right.
            (Raw::AXIS, Raw::X, value) => Some(Motion::Steering(-self.steering.part(value))),
            (Raw::AXIS, Raw::CROSS_X, -1) => Some(Motion::Left),
            (Raw::AXIS, Raw::CROSS_X, 1) => Some(Motion::Right),
            (Raw::AXIS, code, value) => match self.pedal {
                Some((pedal, axis)) if pedal == code => Some(Motion::Pedal(axis.pressed(value))),
                _ => None,
            },
            (Raw::KEY, Raw::SOUTH | Raw::JOYSTICK, 1) => Some(Motion::Go),
            (Raw::KEY, Raw::EAST, 1) => Some(Motion::Stop),
            (Raw::KEY, code, 1) if code == Raw::JOYSTICK + 1 => Some(Motion::Stop),
            (Raw::KEY, Raw::START | Raw::MODE, 1) => Some(Motion::Quit),
            _ => None,
        }
    }
}

#[cfg(target_os = "linux")]
mod device {
    use super::{Axis, GamepadError, Layout, Motion, Raw};
    use std::io::ErrorKind;
    use std::path::{Path, PathBuf};

    /// An open gamepad or steering wheel.
    pub struct Gamepad {
        device: evdev::Device,
        layout: Layout,
        name: String,
    }

    impl Gamepad {
        /// Opens the device at a path, or the first gamepad of `/dev/input`.
        pub fn open(path: Option<&Path>) -> Result<Self, GamepadError> {
            if let Some(path) = path {
                let device = evdev::Device::open(path).map_err(|source| open_error(path, source))?;
                let name = name(&device);
                return Self::of(device)?.ok_or_else(|| GamepadError::NoSteering {
                    path: path.to_owned(),
                    name,
                });
            }
            let (mut readable, mut forbidden) = (0, 0);
            for path in event_devices() {
                match evdev::Device::open(&path) {
                    Err(error) if error.kind() == ErrorKind::PermissionDenied => forbidden += 1,
                    Err(_) => {}
                    Ok(device) => {
                        readable += 1;
                        if let Some(gamepad) = Self::of(device)? {
                            return Ok(gamepad);
                        }
                    }
                }
            }
            Err(GamepadError::None { readable, forbidden })
        }

        fn of(device: evdev::Device) -> Result<Option<Self>, GamepadError> {
            let states: Vec<(u16, Axis)> = device
                .get_absinfo()
                .map(|all| {
                    all.map(|(code, info)| {
                        let axis = Axis {
                            low: info.minimum(),
                            high: info.maximum(),
                            rest: info.value(),
                        };
                        (code.0, axis)
                    })
                    .collect()
                })
                .unwrap_or_default();
            let axis = |code: u16| states.iter().find(|(own, _)| *own == code).map(|(_, axis)| *axis);
            let has_button = |code: u16| {
                device
                    .supported_keys()
                    .is_some_and(|keys| keys.contains(evdev::KeyCode(code)))
            };
            let Some(layout) = Layout::of(axis, has_button) else {
                return Ok(None);
            };
            let name = name(&device);
            device
                .set_nonblocking(true)
                .map_err(|source| open_error(Path::new(&name), source))?;
            Ok(Some(Self { device, layout, name }))
        }

        /// What it calls itself.
        pub fn name(&self) -> &str {
            &self.name
        }

        /// Adds what was done since the last call. Does not wait. After [`Motion::Gone`] nothing comes any more.
        pub fn motions(&mut self, motions: &mut Vec<Motion>) {
            match self.device.fetch_events() {
                Ok(events) => motions.extend(events.filter_map(|event| {
                    self.layout.motion(Raw {
                        kind: event.event_type().0,
                        code: event.code(),
                        value: event.value(),
                    })
                })),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
                Err(_) => motions.push(Motion::Gone),
            }
        }
    }

    fn name(device: &evdev::Device) -> String {
        device.name().unwrap_or("a device without a name").to_owned()
    }

    fn open_error(path: &Path, source: std::io::Error) -> GamepadError {
        GamepadError::Open {
            path: path.to_owned(),
            source,
        }
    }

    /// In the order of their numbers.
    fn event_devices() -> Vec<PathBuf> {
        let entries = std::fs::read_dir("/dev/input").into_iter().flatten().flatten();
        let mut all: Vec<(u32, PathBuf)> = entries
            .filter_map(|entry| {
                let number = entry.file_name().to_str()?.strip_prefix("event")?.parse().ok()?;
                Some((number, entry.path()))
            })
            .collect();
        all.sort();
        all.into_iter().map(|(_, path)| path).collect()
    }
}

#[cfg(not(target_os = "linux"))]
mod device {
    use super::{GamepadError, Motion};
    use std::path::Path;

    /// An open gamepad or steering wheel: none on this system.
    pub enum Gamepad {}

    impl Gamepad {
        /// Says that there is none.
        pub fn open(_path: Option<&Path>) -> Result<Self, GamepadError> {
            Err(GamepadError::NotHere)
        }

        /// What it calls itself.
        pub fn name(&self) -> &str {
            match *self {}
        }

        /// What was done since the last call.
        pub fn motions(&mut self, _motions: &mut Vec<Motion>) {
            match *self {}
        }
    }
}

pub use device::Gamepad;

#[cfg(test)]
mod tests {
    use super::*;

    const STICK: Axis = Axis {
        low: -32768,
        high: 32767,
        rest: 0,
    };

    fn axis(code: u16, value: i32) -> Raw {
        Raw {
            kind: Raw::AXIS,
            code,
            value,
        }
    }

    fn key(code: u16, value: i32) -> Raw {
        Raw {
            kind: Raw::KEY,
            code,
            value,
        }
    }

    #[test]
    fn left_is_positive() {
        let layout = Layout::new(STICK, None);
        assert_eq!(layout.motion(axis(Raw::X, -32768)), Some(Motion::Steering(1.0)));
        assert_eq!(layout.motion(axis(Raw::X, 32767)), Some(Motion::Steering(-1.0)));
        assert_eq!(layout.motion(axis(Raw::CROSS_X, -1)), Some(Motion::Left));
        assert_eq!(layout.motion(axis(Raw::CROSS_X, 0)), None);
    }

    #[test]
    fn pedals_that_count_down_are_pressed_downwards_and_sticks_are_no_pedals() {
        let down = Axis {
            low: 0,
            high: 255,
            rest: 255,
        };
        let wheel = Layout::of(
            |code| match code {
                Raw::X => Some(STICK),
                Raw::Z => Some(down),
                _ => None,
            },
            |button| button == Raw::JOYSTICK,
        )
        .unwrap();
        assert_eq!(wheel.motion(axis(Raw::Z, 255)), Some(Motion::Pedal(0.0)));
        assert_eq!(wheel.motion(axis(Raw::Z, 0)), Some(Motion::Pedal(1.0)));
        let pad = Layout::of(|_| Some(STICK), |button| button == Raw::SOUTH).unwrap();
        assert_eq!(pad.motion(axis(Raw::RZ, 32767)), None, "a second stick");
    }

    #[test]
    fn keyboards_mice_and_broken_axes_are_no_gamepads() {
        assert_eq!(Layout::of(|_| Some(STICK), |_| false), None);
        assert_eq!(Layout::of(|_| None, |button| button == Raw::SOUTH), None);
        let flat = Axis {
            low: 5,
            high: 5,
            rest: 5,
        };
        assert_eq!(
            Layout::new(flat, None).motion(axis(Raw::X, 5)),
            Some(Motion::Steering(-0.0))
        );
    }

    #[test]
    fn buttons_count_when_pressed_not_when_let_go() {
        let layout = Layout::new(STICK, None);
        assert_eq!(layout.motion(key(Raw::SOUTH, 1)), Some(Motion::Go));
        assert_eq!(layout.motion(key(Raw::SOUTH, 0)), None);
        assert_eq!(layout.motion(key(Raw::EAST, 1)), Some(Motion::Stop));
        assert_eq!(layout.motion(key(Raw::JOYSTICK + 1, 1)), Some(Motion::Stop));
        assert_eq!(layout.motion(key(Raw::START, 1)), Some(Motion::Quit));
    }

    #[test]
    fn a_device_that_is_none_is_named_with_what_to_do() {
        let message = match Gamepad::open(Some("/dev/input/no-such-device".as_ref())) {
            Err(error) => error.to_string(),
            Ok(_) => panic!("there is no such device"),
        };
        assert!(
            message.contains("no-such-device") || message.contains("does not have"),
            "{message}"
        );
        let none = GamepadError::None {
            readable: 3,
            forbidden: 2,
        }
        .to_string();
        assert!(none.contains("3 devices") && none.contains("usermod"), "{none}");
    }
}
