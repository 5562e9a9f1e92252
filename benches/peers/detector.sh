#!/bin/sh
# Tiny YOLOv3 and the small detector in senda, OpenCV's dnn and ONNX Runtime, one thread, on files with random values that senda
# writes: agreement and speed. Usage: benches/peers/detector.sh
# Needs python3 with opencv-python-headless, numpy and onnxruntime.
set -eu
cd "$(dirname "$0")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cargo run --quiet --release -p senda_nets --example darknet -- "$folder"
python3 crates/senda_nets/parity/darknet_parity.py "$folder"
