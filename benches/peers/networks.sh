#!/bin/sh
# Times networks here and in PyTorch and ONNX Runtime (and TensorFlow Lite, where installed) in turns: training (batch 32,
# two threads) and inference (batch 1, one thread).
# Usage: [TURNS=3] benches/peers/networks.sh [NETWORK...]      Needs python3 with torch, onnxruntime and numpy.
set -eu
cd "$(dirname "$0")/../.."
[ $# -gt 0 ] || set -- pilotnet tinypilotnet lstm-tinypilotnet deeperlstm-tinypilotnet deepestlstm-tinypilotnet
folder=$(mktemp -d)
trap 'rm -rf "$folder" "$folder.log"' EXIT
cargo build --quiet --release -p senda_nets --example speed --example parity
examples=$(cargo metadata --format-version 1 --no-deps | python3 -c 'import json, sys; print(json.load(sys.stdin)["target_directory"])')/release/examples
"$examples/parity" "$folder" "$@" > "$folder.log"
python3 benches/peers/networks.py "$folder" "$examples/speed" "${TURNS:-3}"
