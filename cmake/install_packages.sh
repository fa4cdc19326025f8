#!/bin/sh
# Installs the packages named in the file $1 that dpkg does not know as installed, those of a line PACKAGE=COMMAND only where
# that command is missing. Quiet when nothing is.
set -eu
missing=""
for line in $(sed 's/#.*//' "$1"); do
  package=${line%%=*}
  [ "$package" = "$line" ] || ! command -v "${line#*=}" >/dev/null || continue
  dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q "ok installed" || missing="$missing $package"
done
[ -z "$missing" ] && exit 0
echo "installing:$missing"
${SUDO:-} apt-get update -q
# shellcheck disable=SC2086
${SUDO:-} env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $missing
