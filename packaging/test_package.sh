#!/bin/sh
# Makes the Debian packages of the build folder $1, installs them in a Debian 12 folder made by debootstrap and runs the program
# there as an ordinary user; with node and chromium on this machine a browser points at a place and sees the robot move. Prints how
# long it took from `apt-get install` to there: three minutes at most. Root and network; exits with 77 (skipped) without them.
set -eu
[ "$(id -u)" = 0 ] && command -v debootstrap >/dev/null || { echo "wants root and debootstrap"; exit 77; }
source=$(cd "$(dirname "$0")/.." && pwd)
build=$(cd "$1" && pwd)
version=$(sed -n 's/^project(vitreo VERSION \([0-9.]*\).*/\1/p' "$source/CMakeLists.txt")
rm -f "$build"/*.deb
(cd "$build" && cpack -G DEB >/dev/null)
sh "$source/packaging/doc_package.sh" "$build" "$version"
sh "$source/packaging/python_package.sh" "$build" "$version"
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
cp "$build"/*.deb "$work/tmp"
chroot "$work" sh -ec '
  export DEBIAN_FRONTEND=noninteractive
  apt-get update -q >/dev/null
  useradd -m lab
'
begin=$(date +%s)
chroot "$work" sh -ec 'DEBIAN_FRONTEND=noninteractive apt-get install -y -q /tmp/*.deb >/dev/null'
echo "installed after $(($(date +%s) - begin)) s"
page=$build/tests/page
if [ -d "$page/node_modules" ] && command -v node >/dev/null && command -v chromium >/dev/null; then
  cp "$source/tests/page/moving.mjs" "$page"
  chroot "$work" su lab -c 'cd && vitreo view steer >view.log 2>&1' &
  for _ in $(seq 300); do
    address=$(grep -oE 'http://[^ ]+token=[^ ]+' "$work/home/lab/view.log" 2>/dev/null) && break
    sleep 0.2
  done
  node "$page/moving.mjs" "$address" "$(command -v chromium)"
  took=$(($(date +%s) - begin))
  echo "the robot moved in a browser $took s after the installation began"
  [ "$took" -le 180 ] || { echo "that is more than three minutes" >&2; exit 1; }
  wait
fi
chroot "$work" sh -ec '
  test -s /lib/udev/rules.d/60-vitreo.rules
  test -s /usr/share/man/man1/vitreo.1.gz
  test -s /usr/share/man/man1/vitreo_guardian.1.gz
  test -s /usr/share/bash-completion/completions/vitreo
  test -s /usr/share/zsh/vendor-completions/_vitreo
  test -s /usr/share/fish/vendor_completions.d/vitreo.fish
  test -s /usr/share/doc/vitreo/copyright
  dpkg --verify vitreo python3-vitreo vitreo-doc
  test -s /usr/share/doc/vitreo-doc/html/index.html
  su lab -c "cd && vitreo --version && vitreo list && vitreo run hello_rig && vitreo show last"
  su lab -c "cd && vitreo new protocol first_one && vitreo run first_one.lua wait=0.1s && echo \"1 + 1\" | vitreo"
  su lab -c "cd && echo \"check(\\\"hello_rig\\\")\" | vitreo | grep passed"
  echo "import vitreo; print(vitreo.open_run().outcome)" | su lab -c "cd && python3 -" | grep completed
  su lab -c "cd && vitreo export last --csv && vitreo docs safety | head -1"
'
# What a packager would say, where the tool is there.
if command -v lintian >/dev/null; then
  lintian --allow-root --fail-on error,warning "$build"/*.deb
fi
echo "the packages install and run"
