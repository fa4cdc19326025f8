#!/bin/sh
# Proves the README's two commands on a machine that has nothing: a Debian 12 folder made by debootstrap. Needs root, a
# network and half an hour; WORK names where the folder is made (it is removed afterwards, unless KEEP is set).
set -eu
[ "$(id -u)" = 0 ] || { echo "fresh: debootstrap and chroot want root" >&2; exit 2; }
command -v debootstrap >/dev/null || { echo "fresh: apt-get install debootstrap" >&2; exit 2; }
work=$(mktemp -d "${WORK:-/var/tmp}/vitreo_fresh.XXXXXX")
chmod 755 "$work"  # an ordinary user is to live in it
clean() {
  for folder in dev/pts dev/shm proc; do umount "$work/$folder" 2>/dev/null || true; done
  [ -n "${KEEP:-}" ] || rm -rf --one-file-system "$work" "$work.log"
}
trap clean EXIT INT TERM
debootstrap --variant=minbase --include=ca-certificates,git,make bookworm "$work" >"$work.log" 2>&1 || { tail "$work.log"; exit 1; }
cp /etc/apt/sources.list "$work/etc/apt/" 2>/dev/null || true
cp "$HOME/.npmrc" "$work/root/" 2>/dev/null || true
cp -r /usr/local/share/ca-certificates "$work/usr/local/share/" 2>/dev/null || true
chroot "$work" update-ca-certificates >>"$work.log" 2>&1
cp -r /etc/apt/apt.conf.d /etc/apt/sources.list.d "$work/etc/apt/" 2>/dev/null || true
mount -t proc proc "$work/proc"
mkdir -p "$work/dev/pts" "$work/dev/shm"  # the tests type at terminals of their own
mount -t devpts -o newinstance,ptmxmode=0666,mode=0620 devpts "$work/dev/pts"
mount -t tmpfs tmpfs "$work/dev/shm"
mkdir "$work/vitreo"
git archive HEAD | tar -x -C "$work/vitreo"
begin=$(date +%s)
chroot "$work" sh -ec "apt-get update -q; cd /vitreo; git init -q; make run"
ran=$(date +%s)
chroot "$work" sh -ec "cd /vitreo; make test"
echo "fresh: both commands work: make run took $((ran - begin)) s, make test $(($(date +%s) - ran)) s"
