"""The Debian package python3-vitreo, as packaging/python_package.sh makes it, and what it says of itself.
SPDX-License-Identifier: Apache-2.0
"""

import os
import re
import shutil
import subprocess
import sys
import unittest

import support
import vitreo


class Package(unittest.TestCase):
    def test_versions_agree(self):
        of_program = re.search(r"^project\(vitreo VERSION ([0-9.]+)", (support.ROOT / "CMakeLists.txt").read_text(), re.MULTILINE)[1]
        of_project = re.search(r'^version = "(.*)"', (support.ROOT / "python/pyproject.toml").read_text(), re.MULTILINE)[1]
        self.assertEqual((vitreo.__version__, of_project), (of_program, of_program))

    @unittest.skipUnless(shutil.which("dpkg-deb"), "dpkg-deb is not there: no Debian package is made")
    def test_what_the_debian_package_installs_reads_a_record(self):
        place = support.PLACE / "package"
        place.mkdir()
        made = subprocess.run(["sh", support.ROOT / "packaging/python_package.sh", place, "0.1.0"], check=True, capture_output=True, text=True)
        subprocess.run(["dpkg-deb", "-x", made.stdout.strip(), place / "installed"], check=True)
        code = ("import sys, vitreo; run = vitreo.open_run(sys.argv[1]); "
                "print(vitreo.__file__, len(run.laps), run.outcome, run.verify())")
        modules = place / "installed/usr/lib/python3/dist-packages"
        said = subprocess.run([sys.executable, "-B", "-c", code, support.recorded().folder], check=True, capture_output=True, text=True,
                              env={**os.environ, "PYTHONPATH": str(modules)}, cwd="/")
        self.assertEqual(said.stdout.strip(), f"{modules}/vitreo/__init__.py 8 completed []")
        control = subprocess.run(["dpkg-deb", "-f", made.stdout.strip(), "Depends", "Architecture"], check=True, capture_output=True, text=True).stdout
        self.assertIn("python3-numpy, python3-pandas", control)
        self.assertIn("Architecture: all", control)


if __name__ == "__main__":
    unittest.main()
