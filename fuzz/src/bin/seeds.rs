//! Writes every target's seeds into `corpus/TARGET/`, where the fuzzers begin.

use std::path::Path;

fn main() -> std::io::Result<()> {
    for (target, _) in senda_fuzz::TARGETS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
        std::fs::create_dir_all(&folder)?;
        for (name, bytes) in senda_fuzz::seeds(target) {
            std::fs::write(folder.join(name), bytes)?;
        }
    }
    Ok(())
}
