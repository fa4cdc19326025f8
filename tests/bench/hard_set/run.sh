#!/bin/sh
# Prints the hard set: the tracker over all variants and grounds, then OpenCV's trackers on some of them. $1: the build folder.
# The photographs are python3-skimage's, the peers python3-opencv's; neither is a part of the build, and without them that part is
# left out, with a word.
set -eu
cmake --build "$1" --target hard_set
photos=$(python3 -c 'import importlib.util as u; print(u.find_spec("skimage").submodule_search_locations[0] + "/data")' 2>/dev/null ||
  echo /usr/lib/python3/dist-packages/skimage/data)
if [ -f "$photos/retina.jpg" ]; then
  set -- "$1" --photos "$photos"
else
  echo "no photographs: apt-get install python3-skimage brings them"
  set -- "$1"
fi
build=$1
shift
"$build/tests/hard_set" "$@"
echo "the same without the rim's refinement, which has no measure of itself:"
"$build/tests/hard_set" "$@" --no-rim --until 10
if [ $# -gt 0 ] && /usr/bin/python3 -c 'import cv2' 2>/dev/null; then
  /usr/bin/python3 -B "$(dirname "$0")/peers.py" "$build/tests/hard_set" "$2"
else
  echo "no peers: they want python3-opencv and the photographs"
fi
