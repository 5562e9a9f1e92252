#!/bin/sh
# Times reading codes (D1 in SPEC) with senda, zbar and OpenCV over the same frames: every ninth of a delivery's first half minute.
# Usage: benches/peers/codes.sh [FOLDER OF JPEG FRAMES]      Needs python3 with opencv-python-headless, numpy, pyzbar; libzbar0.
set -eu
cd "$(dirname "$0")/../.."
cargo build --quiet --release -p senda
cargo build --quiet --release -p senda_vision --example codes_timing
built=$(cargo metadata --format-version 1 --no-deps | python3 -c 'import json, sys; print(json.load(sys.stdin)["target_directory"])')/release
frames=${1:-}
if [ -z "$frames" ]; then
  frames=$(mktemp -d)
  trap 'rm -rf "$frames"' EXIT
  "$built/senda" deliver --time-limit 30 --record "$frames/run" > "$frames/outcome.txt"
  "$built/senda" data export "$frames/run" --format tub --out "$frames/tub" > /dev/null
  find "$frames/tub/images" -name '*.jpg' | sort -V | awk 'NR % 9 == 0' | while read -r path; do cp "$path" "$frames/"; done
fi
"$built/examples/codes_timing" "$frames"
python3 benches/peers/codes.py "$frames"
