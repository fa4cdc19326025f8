#!/bin/sh
# Makes the Debian package of the build folder $1, installs it in a Debian 12 folder made by debootstrap and runs it there as an
# ordinary user. Root and network; exits with 77 (skipped) without them.
set -eu
[ "$(id -u)" = 0 ] && command -v debootstrap >/dev/null || { echo "wants root and debootstrap"; exit 77; }
(cd "$1" && rm -f vitreo_*.deb && cpack -G DEB >/dev/null)
package=$(ls "$1"/vitreo_*.deb)
work=$(mktemp -d /var/tmp/vitreo_package.XXXXXX)
chmod 755 "$work"  # an ordinary user is to live in it
trap 'umount "$work/dev/pts" "$work/proc" 2>/dev/null || true; rm -rf --one-file-system "$work"' EXIT INT TERM
debootstrap --variant=minbase --include=ca-certificates bookworm "$work" >"$work.log" 2>&1 || { tail "$work.log"; exit 1; }
rm -f "$work.log"
cp /etc/apt/sources.list "$work/etc/apt/" 2>/dev/null || true
cp -r /etc/apt/apt.conf.d /etc/apt/sources.list.d "$work/etc/apt/" 2>/dev/null || true
mount -t proc proc "$work/proc"
mkdir -p "$work/dev/pts"
mount -t devpts -o newinstance,ptmxmode=0666,mode=0620 devpts "$work/dev/pts"
cp "$package" "$work/tmp/vitreo.deb"
chroot "$work" sh -ec '
  export DEBIAN_FRONTEND=noninteractive
  apt-get update -q >/dev/null
  apt-get install -y -q --no-install-recommends /tmp/vitreo.deb >/dev/null
  useradd -m lab
  test -s /lib/udev/rules.d/60-vitreo.rules
  test -s /usr/share/man/man1/vitreo.1.gz
  test -s /usr/share/man/man1/vitreo_guardian.1.gz
  test -s /usr/share/bash-completion/completions/vitreo
  test -s /usr/share/zsh/vendor-completions/_vitreo
  test -s /usr/share/fish/vendor_completions.d/vitreo.fish
  test -s /usr/share/doc/vitreo/copyright
  dpkg --verify vitreo
  su lab -c "cd && vitreo --version && vitreo list && vitreo run hello_rig && vitreo show last"
  su lab -c "cd && vitreo new protocol first_one && vitreo run first_one.lua wait=0.1s && echo \"1 + 1\" | vitreo"
  su lab -c "cd && echo \"check(\\\"hello_rig\\\")\" | vitreo | grep passed"
  su lab -c "cd && vitreo export last --csv && vitreo docs safety | head -1"
'
# What a packager would say, where the tool is there; there is no address to write to, and no older version.
if command -v lintian >/dev/null; then
  lintian --allow-root --fail-on error --suppress-tags bogus-mail-host,bogus-mail-host-in-debian-changelog "$package"
fi
echo "the package installs and runs"
