//! What a fine-tuned model learned before: the worlds and data of the model that it goes on from.

use crate::commands::evaluate::drives;
use senda_nets::{Imported, Model, Provenance};
use std::path::Path;

/// Puts the worlds and data of the model at `from` before a model's own. Its figures stay behind: they are about other weights.
pub(crate) fn inherit(own: &mut Provenance, from: &Path, base: &Provenance) {
    let mut worlds: Vec<String> = Vec::new();
    for world in base
        .worlds
        .iter()
        .map(|world| as_range(world, base))
        .chain(own.worlds.drain(..))
    {
        if !worlds.contains(&world) {
            worlds.push(world);
        }
    }
    own.worlds = worlds;
    let begun = format!("{} (the model that training began with)", from.display());
    let data = base.data.iter().cloned().chain([begun]);
    own.data = data.chain(own.data.drain(..)).collect();
}

/// What a model, also as an ONNX file, says of itself; nothing for weights of other programs.
pub(crate) fn learned_by(path: &Path) -> Option<Provenance> {
    if let Ok(model) = Model::load(path) {
        return Some(model.provenance);
    }
    let imported = Imported::load(path).ok()?;
    serde_json::from_str(imported.metadata.get("senda.provenance")?).ok()
}

/// Older files say where the seeds begin, and only their rounds how many there are: `family:A..B` says it without those.
fn as_range(world: &str, base: &Provenance) -> String {
    let range = || {
        let (family, first) = world.split_once(", seeds from ")?;
        let first: u64 = first.parse().ok()?;
        let end = first.checked_add(drives(base)).filter(|end| *end > first)?;
        Some(format!("{family}:{first}..{end}"))
    };
    range().unwrap_or_else(|| world.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_base_learned_comes_first_and_older_words_become_ranges() {
        let base = Provenance {
            data: vec!["4000 frames by the expert".into()],
            worlds: vec!["random-circuit, seeds from 1000000".into(), "circuit-1".into()],
            metrics: serde_json::from_str(r#"{"rounds": [{"drives": 8}, {"drives": 16}]}"#).unwrap(),
            ..Provenance::default()
        };
        let mut own = Provenance {
            data: vec!["tub".into()],
            worlds: vec!["circuit-1".into(), "circuit-2".into()],
            ..Provenance::default()
        };
        inherit(&mut own, Path::new("base.senda"), &base);
        assert_eq!(
            own.worlds,
            ["random-circuit:1000000..1000024", "circuit-1", "circuit-2"]
        );
        assert_eq!(
            own.data,
            [
                "4000 frames by the expert",
                "base.senda (the model that training began with)",
                "tub"
            ]
        );
        // Nobody knows where such a range ends: its words are kept.
        let endless = Provenance {
            worlds: base.worlds[..1].to_vec(),
            ..Provenance::default()
        };
        let mut own = Provenance::default();
        inherit(&mut own, Path::new("base.senda"), &endless);
        assert_eq!(own.worlds, endless.worlds);
    }
}
