#!/bin/sh
# Times the line extraction (C3 to C5 in SPEC) and the same steps in OpenCV over the same frames, one after the other.
# Usage: benches/peers/line_extraction.sh [WIDTH HEIGHT]      Needs python3 with opencv-python-headless and numpy.
set -eu
cd "$(dirname "$0")/../.."
width=${1:-320}
height=${2:-240}
frames=$(mktemp -d)
trap 'rm -rf "$frames"' EXIT
cargo build --quiet --release -p senda_vision --example line_timing
timing=$(cargo metadata --format-version 1 --no-deps | python3 -c 'import json, sys; print(json.load(sys.stdin)["target_directory"])')/release/examples/line_timing
"$timing" make "$frames" "$width" "$height"
ours=$("$timing" time "$frames")
widths=$(printf '%s' "$ours" | python3 -c 'import json, sys; print(*json.load(sys.stdin)["middle_widths"])')
# shellcheck disable=SC2086
peer=$(python3 benches/peers/line_extraction.py "$frames" $widths)
printf '%s\n%s\n' "$ours" "$peer"
printf '%s\n%s\n' "$ours" "$peer" | python3 -c '
import json, sys
ours, peer = map(json.loads, sys.stdin)
for key in ours:
    if key.endswith("_us") and key in peer:
        print(f"{key:32} {ours[key]:9.1f} {peer[key]:9.1f}   {peer[key] / ours[key]:5.2f} times as fast")
'
