#!/usr/bin/env python3
"""The live view's pictures in the docs, of a real run of the simulated rig at the wall clock's pace.

    python3 cmake/live_pictures.py BUILD FOLDER     wants node, chromium and BUILD/tests/page
"""
# SPDX-License-Identifier: Apache-2.0
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

RUN = "view steer --operator Eve --seed 3"


def main() -> int:
    build, folder = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
    with tempfile.TemporaryDirectory() as place:
        program = subprocess.Popen([build / "vitreo", *RUN.split()], cwd=place, stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        address = next((found[0] for line in program.stdout if (found := re.search(r"http://\S+token=\S+", line))), None)
        if address is None:
            print("the program gave no address", file=sys.stderr)
            return 1
        browser = subprocess.Popen(["node", build / "tests/page/pictures.mjs", address, folder, shutil.which("chromium")])
        program.stdout.read()
        browser.wait()
        program.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main())
