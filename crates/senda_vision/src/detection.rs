//! What object detectors say: classes, boxes, and the interface that all of them have (D7 in SPEC).

use senda_core::Image;

/// What a warehouse vehicle looks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ObjectClass {
    /// A pedestrian light that shows green.
    GreenLight,
    /// A pedestrian light that shows red.
    RedLight,
    /// A number sign with this digit (0 ..= 9; document D has 0 and 1).
    Sign(u8),
}

impl ObjectClass {
    /// Document D's four classes in the order of its network: green light, red light, sign 0, sign 1.
    pub const DOCUMENT: [ObjectClass; 4] = [
        ObjectClass::GreenLight,
        ObjectClass::RedLight,
        ObjectClass::Sign(0),
        ObjectClass::Sign(1),
    ];

    /// The class of an index: document D's four first, then the signs 2 to 9. `None` beyond.
    pub fn from_index(index: usize) -> Option<Self> {
        match index {
            0 => Some(Self::GreenLight),
            1 => Some(Self::RedLight),
            2..=11 => Some(Self::Sign((index - 2) as u8)),
            _ => None,
        }
    }

    /// The inverse of [`ObjectClass::from_index`].
    pub fn index(self) -> usize {
        match self {
            Self::GreenLight => 0,
            Self::RedLight => 1,
            Self::Sign(digit) => 2 + usize::from(digit),
        }
    }

    /// Name as in a `.names` file: `green-light`, `red-light`, `sign-0`.
    pub fn name(self) -> String {
        match self {
            Self::GreenLight => "green-light".to_owned(),
            Self::RedLight => "red-light".to_owned(),
            Self::Sign(digit) => format!("sign-{digit}"),
        }
    }

    /// The class of a name; `None`: not one of them.
    pub fn parse(name: &str) -> Option<Self> {
        (0..12)
            .filter_map(Self::from_index)
            .find(|class| class.name() == name)
    }
}

/// One object in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// What it is.
    pub class: ObjectClass,
    /// Left, top, right, bottom (px of the frame, edges of pixels: 0 is the frame's edge).
    pub box_px: [f32; 4],
    /// How sure the detector is, 0 ..= 1.
    pub confidence: f32,
}

impl Detection {
    /// Middle of the box (px).
    pub fn middle_px(&self) -> [f32; 2] {
        let [left, top, right, bottom] = self.box_px;
        [0.5 * (left + right), 0.5 * (top + bottom)]
    }

    /// Height of the box (px): nearer things are higher.
    pub fn height_px(&self) -> f32 {
        self.box_px[3] - self.box_px[1]
    }
}

/// Finds objects in frames: Tiny YOLO, or the classical one.
pub trait Detector: Send {
    /// The objects in an RGB frame of any size, the surest first. The same frame gives the same answer; the slice is valid
    /// until the next call.
    fn detect(&mut self, frame: &Image) -> &[Detection];
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_indices_and_names_belong_together() {
        for index in 0..12 {
            let class = ObjectClass::from_index(index).unwrap();
            assert_eq!(class.index(), index);
            assert_eq!(ObjectClass::parse(&class.name()), Some(class));
        }
        assert_eq!(ObjectClass::DOCUMENT.map(ObjectClass::index), [0, 1, 2, 3]);
        assert_eq!(ObjectClass::from_index(12), None);
        assert_eq!(ObjectClass::parse("cat"), None);
    }
}
