#!/bin/sh
# in_shards.sh N COMMAND...: the tests of a GoogleTest program in N processes at once; fails where one of them fails. For
# tests that wait far more than they compute, and beside which nothing else may run.
shards=$1
shift
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
k=0
while [ "$k" -lt "$shards" ]; do
  (GTEST_TOTAL_SHARDS=$shards GTEST_SHARD_INDEX=$k "$@" >"$out/$k" 2>&1; echo $? >"$out/$k.code") &
  k=$((k + 1))
done
wait
code=0
k=0
while [ "$k" -lt "$shards" ]; do
  cat "$out/$k"
  [ "$(cat "$out/$k.code")" = 0 ] || code=1
  k=$((k + 1))
done
exit $code
