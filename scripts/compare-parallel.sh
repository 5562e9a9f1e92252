#!/bin/sh
# A comparison in N parts with GNU parallel, joined at the end.
#   scripts/compare-parallel.sh 4 plan.toml out
# Over ssh: add `--sshlogin host1,host2 --workdir ... --return part-{}` and give each host the plan (see `man parallel`).
set -eu
parts=$1
plan=$2
out=$3
mkdir -p "$out"
# Each part takes one core; --resume-failed of parallel is not needed, since senda itself goes on where it stopped.
seq "$parts" | parallel --halt now,fail=1 --joblog "$out/parallel.log" \
  senda compare "$plan" --shard "{}/$parts" --folder "$out/part-{}" --jobs 1
# shellcheck disable=SC2046 # one word for each part
senda merge $(seq -f "$out/part-%.0f" "$parts") --out "$out/whole" \
  --report "$out/report.html" --markdown "$out/report.md"
