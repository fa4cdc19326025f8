#!/bin/sh
# Prints the figures: Google Benchmark's rows (JSON into $1/bench.json), then whole runs. $1: the build folder.
set -eu
cmake --build "$1" --target vitreo_bench vitreo
"$1/tests/vitreo_bench" --benchmark_out="$1/bench.json" --benchmark_out_format=json
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
for seed in 1 2 3; do
  echo "servo_square, seed $seed:"
  "$1/vitreo" run servo_square --seed "$seed" --out "$out" --json 2>/dev/null
done
python3 "$(dirname "$0")/catalog.py" "$1/vitreo"
