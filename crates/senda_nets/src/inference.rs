//! Running a trained network.

use crate::engine::{Engine, Frame, Mode, Packed, Scratch, State};
use crate::network::Network;
use crate::quantised::Grid;
use crate::weights::Weights;

/// A network with its weights, ready to run. Nothing is allocated after [`Inference::new`].
///
/// A batch gives the same bits as its inputs one by one. A recurrent network carries a state for each place of the
/// batch from call to call.
#[derive(Debug, Clone)]
pub struct Inference {
    engine: Engine,
    weights: Vec<f32>,
    packed: Packed,
    frame: Frame,
    state: State,
    scratch: Scratch,
    /// For every node but the output, where values are to lie on a grid.
    grids: Vec<Grid>,
    forgets: bool,
}

impl Inference {
    /// Prepares a network for batches of at most `max_batch` inputs.
    ///
    /// # Panics
    /// When there are not as many weights as the network has parameters ([`Weights::fits`] tells), or `max_batch` is 0.
    pub fn new(network: &Network, weights: &Weights, max_batch: usize) -> Self {
        assert!(max_batch > 0, "a batch of at least one");
        assert_eq!(
            weights.values.len(),
            network.parameter_count(),
            "weights of another network"
        );
        let engine = Engine::new(network, max_batch, false);
        let mut packed = engine.packed();
        for index in 0..engine.layers.len() {
            engine.pack(index, &weights.values, &mut packed);
        }
        Self {
            frame: engine.frame(),
            state: engine.state(),
            scratch: engine.scratch(),
            weights: weights.values.clone(),
            packed,
            engine,
            grids: Vec::new(),
            forgets: false,
        }
    }

    /// The same with every value but the output moved to a grid.
    pub(crate) fn on_grids(mut self, grids: &[Grid]) -> Self {
        self.grids = grids.to_vec();
        self
    }

    /// The same with a fresh state at every run, or not.
    pub(crate) fn forgetting(mut self, forgets: bool) -> Self {
        self.forgets = forgets;
        self
    }

    /// Values of a node (0 is the input) in the last run of one input.
    pub(crate) fn node_values(&self, node: usize) -> &[f32] {
        match node.checked_sub(1) {
            None => &self.frame.values[0][..self.engine.network.input().len()],
            Some(layer) => &self.activations(layer)[..self.engine.layers[layer].layer.output.len()],
        }
    }

    fn snap(&mut self, node: usize, count: usize) {
        if let Some(grid) = self.grids.get(node) {
            let len = match node.checked_sub(1) {
                None => self.engine.network.input().len(),
                Some(layer) => self.engine.layers[layer].layer.output.len(),
            };
            grid.snap(&mut self.frame.values[node][..count * len]);
        }
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.engine.network
    }

    /// Outputs for one or more inputs (each planar: channel, row, column), one after another.
    ///
    /// # Panics
    /// When `input` is not a whole number of inputs from 1 to `max_batch`.
    pub fn run(&mut self, input: &[f32]) -> &[f32] {
        let len = self.engine.network.input().len();
        let count = input.len() / len;
        assert!(
            count * len == input.len() && (1..=self.engine.chunk).contains(&count),
            "expected 1 to {} inputs of {len} values, but found {} values",
            self.engine.chunk,
            input.len()
        );
        if self.forgets {
            self.reset_state();
        }
        self.frame.values[0][..input.len()].copy_from_slice(input);
        self.snap(0, count);
        for index in 0..self.engine.layers.len() {
            self.engine.forward(
                index,
                Mode::Inference,
                &self.weights,
                &self.packed,
                &mut self.frame,
                &mut self.state,
                &mut self.scratch,
                count,
            );
            self.snap(index + 1, count);
        }
        let last = self.engine.layers.len();
        &self.frame.values[last][..count * self.engine.network.output_len()]
    }

    /// What a layer gave in the last [`Inference::run`], for the whole batch.
    ///
    /// # Panics
    /// When the network has no such layer.
    pub fn activations(&self, layer: usize) -> &[f32] {
        let len = self.engine.layers[layer].layer.output.len();
        &self.frame.values[layer + 1][..self.engine.chunk * len]
    }

    /// Forgets what a recurrent network has seen.
    pub fn reset_state(&mut self) {
        self.state.forget();
    }
}
