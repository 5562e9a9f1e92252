//! A step of gradient descent.

use super::{Trainer, lock};

impl Trainer {
    /// Adds the groups' gradients in order, and takes a step of Adam.
    pub(super) fn descend(&mut self, groups: usize) {
        self.step += 1;
        let options = &self.options;
        let scale = match options.clip_norm {
            None => 1.0,
            Some(limit) => {
                let norm = self.gradient_norm(groups);
                if norm > f64::from(limit) {
                    (f64::from(limit) / norm) as f32
                } else {
                    1.0
                }
            }
        };
        let power = |beta: f32| senda_geom::trig::pow(f64::from(beta), self.step as f64);
        let rate = f64::from(options.learning_rate) * (1.0 - power(options.beta2)).sqrt()
            / (1.0 - power(options.beta1));
        // Keras adds epsilon to the uncorrected root, as the end of section 2 of Kingma and Ba (2015) has it.
        let rate = rate as f32;
        let decay = options.learning_rate * options.weight_decay;
        for block in &self.blocks {
            let range = block.gradient..block.gradient + block.len;
            let Some((first, rest)) = self.groups[..groups].split_first() else {
                return;
            };
            let first = &mut lock(first).gradient[range.clone()];
            for group in rest {
                crate::math::add(&lock(group).gradient[range.clone()], first);
            }
            adam(
                [options.beta1, options.beta2, options.epsilon, rate, decay, scale],
                first,
                &mut self.first_moment[range.clone()],
                &mut self.second_moment[range],
                &mut self.weights.values[block.first..block.first + block.len],
            );
        }
        for index in 0..self.engine.layers.len() {
            if self.engine.layers[index].is_trained() {
                self.engine.pack(index, &self.weights.values, &mut self.packed);
            }
        }
    }

    fn gradient_norm(&self, groups: usize) -> f64 {
        let mut square = 0.0f64;
        for i in 0..self.engine.gradient_len {
            let sum: f32 = self.groups[..groups]
                .iter()
                .map(|group| lock(group).gradient[i])
                .sum();
            square += f64::from(sum) * f64::from(sum);
        }
        square.sqrt()
    }
}

crate::math::vectorised! {
    /// One step of Adam (Kingma and Ba 2015) with decoupled weight decay.
    fn adam(
        constants: [f32; 6],
        gradient: &[f32],
        first: &mut [f32],
        second: &mut [f32],
        weights: &mut [f32],
    ) {
        let [beta1, beta2, epsilon, rate, decay, scale] = constants;
        let moments = first.iter_mut().zip(second.iter_mut());
        for ((gradient, (first, second)), weight) in gradient.iter().zip(moments).zip(weights) {
            let gradient = *gradient * scale;
            *first = *first * beta1 + gradient * (1.0 - beta1);
            *second = *second * beta2 + gradient * gradient * (1.0 - beta2);
            *weight -= rate * *first / (second.sqrt() + epsilon) + decay * *weight;
        }
    }
}
