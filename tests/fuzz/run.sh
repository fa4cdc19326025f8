#!/bin/sh
# Runs each fuzz target in the folder $1 for $2 seconds, from its corpus; fails at the first finding.
set -eu
here=$(dirname "$0")
found=0
for fuzzer in "$1"/*_fuzz; do
  name=$(basename "$fuzzer" _fuzz)
  work=$(mktemp -d)
  found=1
  echo "$name"
  seeds=""
  [ -d "$here/corpus/$name" ] && seeds="$here/corpus/$name"
  # shellcheck disable=SC2086
  "$fuzzer" -max_total_time="$2" -timeout=5 -max_len=4096 -verbosity=0 -print_final_stats=1 -artifact_prefix="$1/$name-" \
    "$work" $seeds
  rm -r "$work"
done
[ "$found" = 1 ] || { echo "no fuzz target is built in $1"; exit 1; }
