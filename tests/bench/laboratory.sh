#!/bin/sh
# Runs protocols on the emulated laboratory, behind real links and in real time, and prints how each ended, what it found, and,
# where a path was followed, its error by the world's own truth, which the run never sees.
# $1: the program; $2...: "RIG PROTOCOL ARGUMENTS", each as one word (all of them by default). Forty minutes; an idle machine.
set -eu
program=$1
shift
here=$(dirname "$0")
answers="--answer eye_fresh=yes --answer photo_eye=none --answer eye_clear=yes --answer opened=yes --answer fixed=yes \
--answer photo_holder=none --answer light=yes --answer biom_in=yes --answer field_of_view=no --answer photo_retina=camera \
--answer vitrectome_in=yes --answer dyed=yes --answer vitrectomy=yes --answer photo_vitrectomy=none \
--answer clear=yes --answer photo_robot=camera --answer notes=none --answer cleared_up=yes"
[ $# -gt 0 ] || set -- "octomag_lab servo_square" "octomag_lab servo_square --seed 2" "octomag_lab servo_square --seed 3" \
  "octomag_lab hold hold=5s settle=3s" "octomag_lab drift_test hold=1s settle=1s" "octomag_lab servo_supervised" \
  "octomag_lab porcine_session trials=1 tracked=3 $answers" \
  "octomag_lab_bench calibrate_cameras count=3" "octomag_lab_bench calibrate_coils" "octomag_lab_bench calibrate_latency coils=2" \
  "octomag_lab_focus autofocus_sweep" "octomag_lab_focus localize_by_focus" "octomag_lab_fundus scan_fundus views=4" \
  "octomag_lab hello_rig"
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
for words in "$@"; do
  rig=${words%% *}
  protocol=${words#* }
  seed=$(echo "$protocol" | sed -n 's/.*--seed \([0-9]*\).*/\1/p')
  begun=$(date +%s)
  rm -rf "$out"/*
  # shellcheck disable=SC2086  # words are arguments
  "$program" emulate "$rig" --seed "${seed:-1}" --truth "$out/truth.csv" -- \
    "$program" run $protocol --rig "$rig" --out "$out" --json 2>"$out/trouble" >"$out/told" || tail -3 "$out/trouble"
  echo "$rig $protocol ($(($(date +%s) - begun)) s): $(tail -1 "$out/told")"
  newest=$(find "$out" -name run.sqlite -printf '%T@ %h\n' | sort -n | tail -1 | cut -d' ' -f2-)
  case $protocol in
    servo_* | hold* | drift_test* | steer* | motion_in_gels* | localize_spiral*)
      [ -z "$newest" ] || python3 "$here/judge_by_truth.py" "$newest" "$out/truth.csv" 2>&1 || true ;;
  esac
done
