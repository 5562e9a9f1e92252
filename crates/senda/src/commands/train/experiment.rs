//! What `senda train` is told, as a file.

use crate::commands::write_file;
use anyhow::{Context, Result};
use senda_drivers::Answer;
use senda_learn::{Split, gather::Selection, learn::network_for, train::Training};
use senda_nets::{Colour, Crop, Edges, InputSpec, Network};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// An experiment as a file; every key has a flag.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Experiment {
    pub(super) network: Option<String>,
    /// A model that goes on, or weights to begin with.
    pub(super) from: Option<PathBuf>,
    pub(crate) data: Vec<PathBuf>,
    pub(super) validation: Vec<PathBuf>,
    pub(crate) split: Split,
    pub(crate) validation_share: f64,
    pub(crate) split_gap: usize,
    pub(crate) allow_leak: bool,
    pub(crate) vehicle: String,
    pub(super) colour: Option<Colour>,
    pub(super) crop: Option<Crop>,
    pub(super) edges: Option<Edges>,
    pub(super) stack: Option<usize>,
    pub(crate) answers: Vec<Answer>,
    /// What full lock is called in degrees: errors are told in degrees too.
    pub(super) full_lock_deg: Option<f64>,
    pub(crate) selection: Selection,
    pub(crate) training: Training,
}

impl Experiment {
    /// Reads an experiment file.
    pub(crate) fn load(path: &Path) -> Result<Self> {
        let text =
            std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        toml::from_str(&text).with_context(|| path.display().to_string())
    }

    /// Writes everything as it was resolved, so that the file alone trains the same again. A network that came with a model and is
    /// no ready one lies beside it.
    pub(super) fn write(&self, folder: &Path, network: &Network, input: &InputSpec) -> Result<()> {
        let mut whole = self.clone();
        whole.colour = Some(input.colour);
        whole.crop = Some(input.crop);
        whole.edges = input.edges;
        whole.stack = Some(input.stack);
        if whole.network.is_none() {
            let text = network.to_toml();
            let is_ready =
                network_for(network.name(), &self.answers).is_ok_and(|ready| ready.to_toml() == text);
            whole.network = Some(if is_ready {
                network.name().to_owned()
            } else {
                let file = folder.join("network.toml");
                write_file(&file, text.as_bytes())?;
                file.display().to_string()
            });
        }
        write_file(
            &folder.join("experiment.toml"),
            toml::to_string(&whole)?.as_bytes(),
        )
    }
}

impl Default for Experiment {
    fn default() -> Self {
        Self {
            network: None,
            from: None,
            data: vec![],
            validation: vec![],
            split: Split::default(),
            validation_share: 0.2,
            split_gap: 0,
            allow_leak: false,
            vehicle: "picar".into(),
            colour: None,
            crop: None,
            edges: None,
            stack: None,
            answers: vec![Answer::Steering],
            full_lock_deg: None,
            selection: Selection::default(),
            training: Training::default(),
        }
    }
}
