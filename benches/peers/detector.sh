#!/bin/sh
# Tiny YOLOv3 and the small detector in senda, OpenCV's dnn and ONNX Runtime, one thread, on files with random values that senda
# writes: agreement and speed. Usage: benches/peers/detector.sh
# Needs python3 with numpy, onnxruntime and 'opencv-python-headless<5' (OpenCV 5 reads no darknet files).
set -eu
cd "$(dirname "$0")/../.."
# Before anything is built.
python3 crates/senda_nets/parity/darknet_parity.py --check
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cargo run --quiet --release -p senda_nets --example darknet -- "$folder"
python3 crates/senda_nets/parity/darknet_parity.py "$folder"
