#!/bin/sh
# Runs each fuzz target in the folder $1 from its corpus, for $2 seconds or, where $3 is given, for so many executions; fails
# at the first finding. $4: only the targets whose names match. What to begin with is in corpus/NAME, and what was found to reach
# new code in corpus/NAME.tar.gz, which KEEP=1 makes anew.
set -eu
here=$(dirname "$0")
found=0
bound="-max_total_time=$2"
[ -z "${3:-}" ] || bound="-runs=$3"
for fuzzer in "$1"/${4:-*}_fuzz; do
  name=$(basename "$fuzzer" _fuzz)
  work=$(mktemp -d)
  found=1
  echo "$name"
  corpus="$here/corpus/$name"
  seeds=""
  [ -d "$corpus" ] && seeds="$corpus"
  [ ! -f "$corpus.tar.gz" ] || tar -xzf "$corpus.tar.gz" -C "$work"
  # shellcheck disable=SC2086
  "$fuzzer" "$bound" -timeout=30 -max_len=4096 -verbosity=0 -print_final_stats=1 -artifact_prefix="$1/$name-" "$work" $seeds
  if [ "${KEEP:-}" = 1 ]; then
    least=$(mktemp -d)
    # shellcheck disable=SC2086
    "$fuzzer" -merge=1 -verbosity=0 "$least" "$work" $seeds
    tar --sort=name --mtime=@0 --owner=0 --group=0 --numeric-owner -C "$least" -c . | gzip -9n > "$corpus.tar.gz"
    rm -r "$least"
  fi
  rm -r "$work"
done
[ "$found" = 1 ] || { echo "no fuzz target is built in $1"; exit 1; }
