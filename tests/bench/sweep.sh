#!/bin/sh
# Efficiency of a sweep on N local cores at 5 s a run: the time that its points take one by one, over N times the time of the
# sweep. Goal: 85 %. $1: the program; $2: N (default: all cores).
set -eu
program=$(realpath "$1")
cores=${2:-$(nproc)}
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
cd "$place"
cat >busy.lua <<'END'
return {
  title = "Busy",
  needs = { "coils" },
  parameters = { turns = { default = 1e6, min = 1, max = 1e10, integer = true }, part = { default = 1, integer = true } },
  run = function(rig, p, run)
    local sum = 0
    for i = 1, p.turns do
      sum = sum + i % 7
    end
    run:result("sum", sum)
  end,
}
END
seconds() { # of a command, wall and CPU of it and its children
  /usr/bin/env python3 - "$@" <<'END'
import os, subprocess, sys, time
began, before = time.monotonic(), os.times()
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
after = os.times()
print(time.monotonic() - began, after.children_user + after.children_system - before.children_user - before.children_system)
END
}
guess=$(seconds "$program" run ./busy.lua turns=20000000 --rig fast --out runs)
turns=$(echo "$guess" | awk '{ printf "%d", 20000000 * 5 / $2 }')
one=$(seconds "$program" run ./busy.lua turns="$turns" --rig fast --out runs)
points=$((4 * cores))
all=$(seconds "$program" sweep ./busy.lua turns="$turns" part=1.."$points":"$points" --rig fast --jobs "$cores" --out swept)
echo "$one $all" | awk -v n="$cores" -v points="$points" '{
  printf "a run alone: %.2f s (%.2f s of CPU); %d on %d cores: %.2f s (%.2f s of CPU)\n", $1, $2, points, n, $3, $4
  printf "efficiency: %.1f %% by the wall clock, %.1f %% by CPU (on a machine with other load the second holds)\n",
    100 * points * $1 / (n * $3), 100 * points * $2 / $4
}'
