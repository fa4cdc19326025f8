#!/bin/sh
# Runs protocols on the emulated laboratory, behind real links and in real time, and prints how each ended and what it found.
# $1: the program; $2...: NAME RIG ARGUMENTS, each as one word (all of them by default). Twenty minutes; an idle machine.
set -eu
program=$1
shift
answers="--answer eye_fresh=yes --answer photo_eye=none --answer eye_clear=yes --answer opened=yes --answer fixed=yes \
--answer photo_holder=none --answer light=yes --answer biom_in=yes --answer field_of_view=no --answer photo_retina=camera \
--answer clear=yes --answer photo_robot=camera --answer notes=none --answer cleared_up=yes"
[ $# -gt 0 ] || set -- "octomag_lab servo_square" "octomag_lab servo_square --seed 2" "octomag_lab hold hold=5s settle=3s" \
  "octomag_lab drift_test hold=1s settle=1s" "octomag_lab servo_supervised" "octomag_lab porcine_session trials=1 tracked=3 $answers" \
  "octomag_lab_bench calibrate_cameras count=3" "octomag_lab_bench calibrate_coils" "octomag_lab_bench calibrate_latency coils=2" \
  "octomag_lab_focus autofocus_sweep" "octomag_lab_focus localize_by_focus" "octomag_lab_fundus scan_fundus views=4"
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
for words in "$@"; do
  rig=${words%% *}
  protocol=${words#* }
  seed=$(echo "$protocol" | sed -n 's/.*--seed \([0-9]*\).*/\1/p')
  # shellcheck disable=SC2086  # words are arguments
  "$program" emulate "$rig" --seed "${seed:-1}" -- "$program" run $protocol --rig "$rig" --out "$out" --json 2>/dev/null >"$out/told" ||
    true
  echo "$rig $protocol: $(tail -1 "$out/told")"
done
