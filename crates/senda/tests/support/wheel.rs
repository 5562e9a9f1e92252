//! A network at the wheel.

/// The command that lets a model drive; further arguments may follow.
pub(crate) fn at_the_wheel<'a>(world: &'a str, vehicle: &'a str, model: &'a str) -> [&'a str; 9] {
    [
        "drive",
        "--world",
        world,
        "--vehicle",
        vehicle,
        "--driver",
        "neural",
        "--model",
        model,
    ]
}
