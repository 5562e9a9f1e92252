#!/bin/sh
# Times networks here and in PyTorch and ONNX Runtime (and TensorFlow Lite, where installed), one after the other: training
# (batch 32, two threads) and inference (batch 1, one thread).
# Usage: benches/peers/networks.sh [NETWORK...]      Needs python3 with torch, onnxruntime and numpy.
set -eu
cd "$(dirname "$0")/../.."
[ $# -gt 0 ] || set -- pilotnet tinypilotnet lstm-tinypilotnet deeperlstm-tinypilotnet deepestlstm-tinypilotnet
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cargo build --quiet --release -p senda_nets --example speed --example parity
examples=$(cargo metadata --format-version 1 --no-deps | python3 -c 'import json, sys; print(json.load(sys.stdin)["target_directory"])')/release/examples
"$examples/speed" "$@"
"$examples/parity" "$folder" "$@" > "$folder.log"
rm -f "$folder.log"
python3 benches/peers/networks.py "$folder"
