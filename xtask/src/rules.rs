//! The rules as data. `DESIGN.md` says why.

/// Rank of every crate. A crate uses only crates of strictly lower rank; its tests may also use crates of its own rank.
/// Crates that do not exist yet keep their place here, so that the first commit of one is already checked.
pub(crate) const RANKS: &[(&str, u8)] = &[
    ("senda_geom", 0),
    ("senda_toml", 0),
    ("senda_core", 1),
    ("senda_world", 2),
    ("senda_vision", 2),
    ("senda_nets", 2),
    ("senda_data", 2),
    ("senda_sim", 3),
    ("senda_drivers", 3),
    ("senda_eval", 3),
    ("senda_hw", 3),
    ("senda_bridge", 3),
    ("senda_run", 4),
    ("senda_web", 4),
    ("senda_learn", 5),
    ("senda_compare", 6),
    ("senda", 7),
    ("senda_py", 7),
    // Stands beside the ranks: nothing uses it and it uses none of them.
    ("xtask", 0),
];

/// A dependency that only some crates may use.
pub(crate) struct Reserved {
    /// Name on crates.io.
    pub(crate) dependency: &'static str,
    /// The crates that may use it.
    pub(crate) users: &'static [&'static str],
    /// Why.
    pub(crate) reason: &'static str,
}

const EDGES: &[&str] = &["senda_web", "senda_bridge"];
const HARDWARE: &[&str] = &["senda_hw"];
const BINARY: &[&str] = &["senda"];

const fn reserved(
    dependency: &'static str,
    users: &'static [&'static str],
    reason: &'static str,
) -> Reserved {
    Reserved {
        dependency,
        users,
        reason,
    }
}

/// Dependencies with a home.
pub(crate) const RESERVED: &[Reserved] = &[
    reserved(
        "anyhow",
        &["senda", "xtask"],
        "libraries name their errors (thiserror)",
    ),
    reserved("clap", BINARY, "only the command line parses arguments"),
    reserved("indicatif", BINARY, "only the command line draws on a terminal"),
    reserved(
        "rustix",
        BINARY,
        "only the command line reads single keys of a terminal",
    ),
    reserved("ctrlc", BINARY, "only the command line handles signals"),
    reserved(
        "miette",
        &["senda", "senda_toml", "senda_world", "senda_nets"],
        "pretty errors are for files that people write",
    ),
    reserved(
        "rayon",
        &["senda_run", "senda_nets", "senda_learn", "senda"],
        "threads stay where a fixed order of results is tested",
    ),
    reserved(
        "tokio",
        EDGES,
        "threads, not a framework: only network edges are asynchronous",
    ),
    reserved("axum", &["senda_web"], "only the dashboard serves pages"),
    reserved("tungstenite", EDGES, "only network edges speak protocols"),
    reserved(
        "rumqttc-next",
        &["senda_bridge"],
        "only bridges speak other people's protocols",
    ),
    reserved("v4l", HARDWARE, "only senda_hw opens devices"),
    reserved("evdev", HARDWARE, "only senda_hw opens devices"),
    reserved("linux-embedded-hal", HARDWARE, "only senda_hw opens devices"),
    reserved("pwm-pca9685", HARDWARE, "only senda_hw opens devices"),
    reserved("pyo3", &["senda_py"], "only the Python package knows Python"),
    reserved(
        "mcap",
        &["senda_data"],
        "one crate knows how recordings lie in a file",
    ),
    // Nobody: weighed and left out.
    reserved(
        "rand_distr",
        &[],
        "its samples differ between platforms; draw from ChaCha8Rng and senda_geom::trig",
    ),
    reserved("opencv", &[], "C++, cannot be linked statically"),
    reserved("lazy_static", &[], "no global stores"),
    reserved(
        "once_cell",
        &[],
        "no global stores; std has OnceLock where one is unavoidable",
    ),
];

/// Dependencies that belong in tests and benchmarks only.
pub(crate) const TESTS_ONLY: &[&str] = &[
    "proptest",
    "insta",
    "criterion",
    "assert_cmd",
    "predicates",
    "tempfile",
];

/// Packages with a `links` key that link nothing native: the key only forbids two versions at once.
pub(crate) const LINKS_NOTHING: &[&str] =
    &["rayon-core", "wasm-bindgen-shared", "prettyplease", "serde_core"];

/// A source file longer than this is listed: look for two ideas in it.
pub(crate) const LONG_FILE_LINES: usize = 500;
