#!/bin/sh
# Prints what the program says about itself anew: the golden help texts of the tests, and docs/reference/api.md. $1: the program.
set -eu
cd "$(dirname "$0")/../.."
"$1" --help >tests/program/golden/vitreo.txt
for command in $("$1" complete -- ""); do
  "$1" "$command" --help >"tests/program/golden/$command.txt"
done
"$1" docs api >docs/reference/api.md
