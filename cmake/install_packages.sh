#!/bin/sh
# Installs the packages named in the file $1 that dpkg does not know as installed. Quiet when nothing is missing.
set -eu
missing=""
for package in $(sed 's/#.*//' "$1"); do
  dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q "ok installed" || missing="$missing $package"
done
[ -z "$missing" ] && exit 0
echo "installing:$missing"
${SUDO:-} apt-get update -q
# shellcheck disable=SC2086
${SUDO:-} env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $missing
