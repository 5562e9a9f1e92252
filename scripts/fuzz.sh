#!/usr/bin/env bash
# Hostile bytes for every reader.
#
#   scripts/fuzz.sh check               compile the targets' functions and try each on its seeds, with any compiler
#   scripts/fuzz.sh run TARGET [SECONDS]  libFuzzer with coverage on a stable compiler (needs a C++ compiler)
#
# cargo-fuzz and a nightly compiler add the address sanitiser: cargo +nightly fuzz run TARGET.
set -euo pipefail
cd "$(dirname "$0")/../fuzz"

case "${1:-}" in
  check)
    # One target folder for both workspaces: most packages are shared.
    export CARGO_TARGET_DIR=../target
    cargo test --quiet --no-default-features --lib
    cargo run --quiet --no-default-features --bin seeds
    ;;
  run)
    target=${2:?expected the name of a target: world, vehicle, calibration, tub, udacity, archive, edits, recording, image, waypoints, network, model, onnx, darknet, labels, codes}
    cargo run --quiet --no-default-features --bin seeds
    # What cargo-fuzz passes, but for the sanitiser, which only nightly compilers have.
    export RUSTFLAGS="--cfg fuzzing -Cpasses=sancov-module -Ccodegen-units=1 -Cdebug-assertions \
      -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-inline-8bit-counters \
      -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares"
    # A target triple keeps these flags from build scripts.
    host=$(rustc -vV | sed -n 's/^host: //p')
    cargo build --quiet --release --bin "$target" --target "$host"
    mkdir -p "corpus/$target" "artifacts/$target"
    exec "target/$host/release/$target" -artifact_prefix="artifacts/$target/" -max_total_time="${3:-60}" \
      -timeout=10 -rss_limit_mb=2048 "corpus/$target"
    ;;
  *)
    sed -n '2,7p' ../scripts/fuzz.sh | sed 's/^# \{0,1\}//' >&2
    exit 2
    ;;
esac
