//! Saving a training between two steps, and going on.

use super::{TrainError, Trainer};

const STATE_MAGIC: &[u8; 8] = b"sendatr1";
const STATE_HEADER: usize = 44;

impl Trainer {
    /// Everything that the next steps depend on: weights, Adam's moments, the number of steps and the learning rate. The
    /// state carried between sequences is not part of it: save between runs.
    pub fn state(&self) -> Vec<u8> {
        let count = self.weights.values.len() + 2 * self.first_moment.len();
        let mut bytes = Vec::with_capacity(STATE_HEADER + 4 * count);
        bytes.extend_from_slice(STATE_MAGIC);
        bytes.extend_from_slice(&(self.weights.values.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&(self.first_moment.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&self.step.to_le_bytes());
        bytes.extend_from_slice(&self.options.seed.to_le_bytes());
        bytes.extend_from_slice(&self.options.learning_rate.to_le_bytes());
        for value in self
            .weights
            .values
            .iter()
            .chain(&self.first_moment)
            .chain(&self.second_moment)
        {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        bytes
    }

    /// Goes on where [`Trainer::state`] was taken: the same steps then give the same weights, bit for bit.
    ///
    /// # Errors
    /// When the bytes are not such a state, or one of another network. Nothing is changed then.
    pub fn resume(&mut self, bytes: &[u8]) -> Result<(), TrainError> {
        let wrong = |found: &str| TrainError::State(found.to_owned());
        let Some(header) = bytes.get(..STATE_HEADER) else {
            return Err(wrong("too few bytes"));
        };
        if &header[..8] != STATE_MAGIC {
            return Err(wrong("other bytes, or another version"));
        }
        let number = |index: usize| {
            let mut eight = [0; 8];
            eight.copy_from_slice(&header[8 + 8 * index..16 + 8 * index]);
            u64::from_le_bytes(eight)
        };
        let (weights, moments) = (self.weights.values.len(), self.first_moment.len());
        if number(0) != weights as u64 || number(1) != moments as u64 {
            return Err(wrong("one of another network"));
        }
        if bytes.len() != STATE_HEADER + 4 * (weights + 2 * moments) {
            return Err(wrong("one that was cut short"));
        }
        let float = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        let mut values = bytes[STATE_HEADER..].chunks_exact(4).map(float);
        for place in self
            .weights
            .values
            .iter_mut()
            .chain(&mut self.first_moment)
            .chain(&mut self.second_moment)
        {
            *place = values.next().unwrap_or_default();
        }
        self.step = number(2);
        self.options.seed = number(3);
        self.options.learning_rate = float(&header[40..44]);
        for index in 0..self.engine.layers.len() {
            self.engine.pack(index, &self.weights.values, &mut self.packed);
        }
        self.reset_state();
        Ok(())
    }
}
