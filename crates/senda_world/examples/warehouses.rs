//! Writes the library's warehouses: `cargo run -p senda_world --example warehouses -- worlds`.

use senda_world::{Floor, WarehouseLayout, World};
use std::path::Path;

fn main() -> std::io::Result<()> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "worlds".to_owned());
    let document = WarehouseLayout::default();
    let mut second = WarehouseLayout {
        depots: vec![1, 0, 2],
        mirrored: true,
        straight_m: 0.6,
        signs_m: vec![[0.40, 0.21], [0.36, 0.25]],
        light_m: [0.46, 0.22],
        package: "I1".to_owned(),
        ..document.clone()
    };
    second.lights[0].1.offset_s = 8.0;
    let mut third = WarehouseLayout {
        depots: vec![3, 1, 4, 0, 2],
        across_m: 1.6,
        package: "I4".to_owned(),
        ..document.clone()
    };
    let mut later = third.lights[0];
    (later.0, later.1.offset_s) = (2, 4.0);
    third.lights.push(later);
    let worlds = [
        (
            "warehouse",
            "Document D's test track, 220 x 320 cm: three depots, two junctions, one light",
            "Document D's test track as its text describes it; what it leaves open (heights, colours, where boards stand) is a guess.\n\
             # Tuned on: results are reported on made-up warehouses with seeds from 10000.",
            World::warehouse("warehouse", &document),
        ),
        (
            "warehouse-2",
            "The test track mirrored and longer, depots 0 and 1 exchanged, on wood",
            "Document D's track mirrored, with longer streets and its first two depots exchanged. For tuning.",
            World {
                floor: Floor::preset("wood").expect("a preset"),
                ..World::warehouse("warehouse-2", &second)
            },
        ),
        (
            "warehouse-3",
            "A warehouse of five depots in the order 3, 1, 4, 0, 2 with two lights",
            "Five depots, digits beyond document D's 0 and 1, a second light. For tuning.",
            World::warehouse("warehouse-3", &third),
        ),
    ];
    for (name, description, about, mut world) in worlds {
        world.description = description.to_owned();
        let text = format!(
            "# {about}\n# Made by: cargo run -p senda_world --example warehouses -- worlds\n{}",
            world.to_toml()
        );
        std::fs::write(Path::new(&folder).join(format!("{name}.toml")), text)?;
    }
    Ok(())
}
