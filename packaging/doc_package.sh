#!/bin/sh
# Makes the Debian package vitreo-doc, the docs as a site with search, as `make deb` does: doc_package.sh FOLDER VERSION
set -eu
source=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM
chmod 755 "$work"
about=$work/usr/share/doc/vitreo-doc
install -d "$work/DEBIAN" "$about" "$work/usr/share/doc-base"
python3 "$source/cmake/docs_site.py" "$source" "$about/html" >/dev/null
chmod -R u=rwX,go=rX "$about/html"
install -m 644 "$source/packaging/copyright" "$about"
sed 's/^vitreo (/vitreo-doc (/' "$source/packaging/changelog" | gzip -9nc > "$about/changelog.gz"
cat > "$work/usr/share/doc-base/vitreo-doc" <<END
Document: vitreo-doc
Title: Vitreo
Author: Vitreo's developers
Abstract: How to steer magnetic microrobots inside the eye with Vitreo: tutorial,
 recipes, troubleshooting, reference and the reasons behind it.
Section: Science/Engineering

Format: HTML
Index: /usr/share/doc/vitreo-doc/html/index.html
Files: /usr/share/doc/vitreo-doc/html/*.html
END
chmod 644 "$work/usr/share/doc-base/vitreo-doc"
cat > "$work/DEBIAN/control" <<END
Package: vitreo-doc
Version: $2
Architecture: all
Maintainer: Vitreo's developers <developers@vitreo.invalid>
Section: doc
Priority: optional
Installed-Size: $(du -sk "$work/usr" | cut -f1)
Suggests: vitreo, www-browser
Description: instrument control for magnetic microrobots - documentation
 Vitreo steers magnetic microrobots inside the eye: coils, cameras, stages, the
 optics between them, and a simulated laboratory.
 .
 This package has its documentation as web pages with a search, to be read
 without a network.
END
(cd "$work" && find usr -type f | LC_ALL=C sort | xargs md5sum > DEBIAN/md5sums)
dpkg-deb --root-owner-group --build "$work" "$1/vitreo-doc_$2_all.deb" >/dev/null
echo "$1/vitreo-doc_$2_all.deb"
