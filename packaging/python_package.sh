#!/bin/sh
# Makes the Debian package python3-vitreo of the folder python/, as `make deb` does: python_package.sh FOLDER VERSION
set -eu
source=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM
chmod 755 "$work"
place=$work/usr/lib/python3/dist-packages
install -d "$work/DEBIAN" "$place/vitreo" "$work/usr/share/doc/python3-vitreo"
install -m 644 "$source"/python/vitreo/*.py "$place/vitreo"
install -m 644 "$source/packaging/copyright" "$source/docs/python.md" "$work/usr/share/doc/python3-vitreo"
sed 's/^vitreo (/python3-vitreo (/' "$source/packaging/changelog" | gzip -9nc > "$work/usr/share/doc/python3-vitreo/changelog.gz"
cat > "$work/DEBIAN/control" <<END
Package: python3-vitreo
Version: $2
Architecture: all
Maintainer: Vitreo's developers <developers@vitreo.invalid>
Section: python
Priority: optional
Installed-Size: $(du -sk "$work/usr" | cut -f1)
Depends: python3 (>= 3.9), python3-numpy, python3-pandas
Recommends: vitreo
Suggests: python3-matplotlib
Description: records and runs of Vitreo from Python
 Reads the records of Vitreo, which steers magnetic microrobots inside the eye,
 as tables of pandas and arrays of numpy; starts, follows, answers, pauses and
 stops runs.
END
(cd "$work" && find usr -type f | LC_ALL=C sort | xargs md5sum > DEBIAN/md5sums)
dpkg-deb --root-owner-group --build "$work" "$1/python3-vitreo_$2_all.deb" >/dev/null
echo "$1/python3-vitreo_$2_all.deb"
