#!/usr/bin/env bash
# Runs the tests that pin bits on aarch64, under emulation: the goldens in them are the ones that x86-64 passes.
#
#   scripts/aarch64-digests.sh [--no-install]
#
# Needs the Rust target aarch64-unknown-linux-gnu, Debian's gcc-aarch64-linux-gnu (to link) and qemu-user (to run). Installs
# what is missing when it may: the target through rustup, the rest through apt as root. Exits with 77, saying what is
# missing, when it cannot; a caller may take that for "not here".
set -euo pipefail
cd "$(dirname "$0")/.."

target=aarch64-unknown-linux-gnu
# Whole test suites of the crates that everything stands on, and of the others every test named for a digest or golden.
whole=(senda_geom senda_core)
pinned=(senda_world senda_vision senda_data senda_sim senda_drivers senda_run)

missing() {
  echo "aarch64-digests: $1; the digests were NOT checked on aarch64" >&2
  exit 77
}

have_tools() { command -v qemu-aarch64 >/dev/null && command -v aarch64-linux-gnu-gcc >/dev/null; }

if ! have_tools && [ "${1:-}" != "--no-install" ]; then
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "aarch64-digests: installing qemu-user and gcc-aarch64-linux-gnu"
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends \
      qemu-user gcc-aarch64-linux-gnu libc6-dev-arm64-cross; } >/dev/null || missing "apt-get could not install the tools"
  fi
fi
have_tools || missing "expected qemu-aarch64 and aarch64-linux-gnu-gcc in the PATH"

libraries="$(rustc --print sysroot)/lib/rustlib/$target"
if [ ! -d "$libraries" ]; then
  rustup target add "$target" >/dev/null 2>&1 || missing "expected the Rust target $target (rustup target add $target)"
fi

export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64 -L /usr/aarch64-linux-gnu"

log=$(mktemp)
trap 'rm -f "$log"' EXIT

packages() { printf -- '-p %s ' "$@"; }

# shellcheck disable=SC2046 # package names have no blanks
cargo test --locked --target "$target" --lib $(packages "${whole[@]}") 2>&1 | tee "$log"
# shellcheck disable=SC2046
cargo test --locked --target "$target" --lib --tests $(packages "${pinned[@]}") -- digest golden 2>&1 | tee -a "$log"

# The whole program: the same runs on both processors, compared byte by byte.
cargo build --locked -p senda
cargo build --locked --target "$target" -p senda
runs=$(mktemp -d)
trap 'rm -rf "$log" "$runs"' EXIT
target_dir=$(cargo metadata --format-version 1 --no-deps | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')

drive() {
  "$target_dir/debug/senda" drive "$@" --record "$runs/x86-64" >/dev/null
  qemu-aarch64 -L /usr/aarch64-linux-gnu "$target_dir/$target/debug/senda" drive "$@" --record "$runs/aarch64" >/dev/null
}

drive --world s-curves --driver line --floor glossy-speckled --light lamp --time-limit 5
drive --world circuit-2 --driver lane --vehicle picar --light bright --time-limit 5
drive --world hard-curves --driver expert --floor wood --time-limit 5
for recording in "$runs"/x86-64/*.mcap; do
  name=$(basename "$recording")
  if ! cmp "$recording" "$runs/aarch64/$name"; then
    echo "aarch64-digests: $name differs between x86-64 and aarch64" >&2
    exit 1
  fi
  echo "aarch64-digests: $name: $(stat -c %s "$recording") bytes, equal on both"
done

passed=$(grep -c '^test .* ok$' "$log" || true)
pinned_passed=$(grep -Ec '^test .*(digest|golden).* ok$' "$log" || true)
if [ "$pinned_passed" = 0 ]; then
  echo "aarch64-digests: expected at least one test named for a digest or golden, none ran" >&2
  exit 1
fi
echo "aarch64-digests: $passed tests passed on aarch64 under qemu-user, $pinned_passed of them digests and goldens"
