#!/bin/sh
# Prints the hard set: the tracker over 48 variants and ten seeds, each seed before two of the twelve grounds, the same with learned
# evidence, then OpenCV's trackers on some of them. $1: the build folder. About ten minutes a set on one idle core; what was judged
# is kept in the build folder, by the program's own digest, so that a run that was broken off goes on where it was.
# The photographs are python3-skimage's, the peers python3-opencv's; neither is a part of the build, and without them that part is
# left out, with a word.
set -eu
build=$1
cmake --build "$build" --target hard_set
program=$build/tests/hard_set
kept=$build/hard_set_$(sha256sum "$program" | cut -c1-12)
photos=$(python3 -c 'import importlib.util as u; print(u.find_spec("skimage").submodule_search_locations[0] + "/data")' 2>/dev/null ||
  echo /usr/lib/python3/dist-packages/skimage/data)
set -- --seeds 1-10 --each 2
if [ -f "$photos/retina.jpg" ]; then
  set -- "$@" --photos "$photos"
else
  echo "no photographs: apt-get install python3-skimage brings them"
fi
"$program" "$@" --into "$kept.csv"
echo "with learned evidence:"
network=scripts/networks/evidence.onnx
"$program" "$@" --network $network --into "$kept-$(sha256sum $network | cut -c1-12).csv"
echo "without the rim's refinement, which has no measure of itself:"
"$program" "$@" --no-rim --until 10 --into "$kept-no-rim.csv"
if [ -f "$photos/retina.jpg" ] && /usr/bin/python3 -c 'import cv2' 2>/dev/null; then
  /usr/bin/python3 -B "$(dirname "$0")/peers.py" "$program" "$photos" --seeds 3
else
  echo "no peers: they want python3-opencv and the photographs"
fi
