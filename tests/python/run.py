"""Runs the tests of the package `vitreo` (python/); exits with 77, skipped, where numpy or pandas is not there.

    python3 -B tests/python/run.py build/release/vitreo [TEST...]
SPDX-License-Identifier: Apache-2.0
"""

import importlib.util
import os
import pathlib
import sys
import unittest

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent


def main(program, *names):
    missing = [module for module in ("numpy", "pandas") if importlib.util.find_spec(module) is None]
    if missing:
        print(f"{sys.executable} has no {' and no '.join(missing)}: the package vitreo is not tested "
              "(apt-get install python3-numpy python3-pandas)")
        return 77
    os.environ["VITREO"] = os.path.abspath(program)
    sys.path[:0] = [str(ROOT / "python"), str(HERE)]
    loader = unittest.defaultTestLoader
    suite = loader.loadTestsFromNames(names) if names else loader.discover(str(HERE), pattern="*_test.py")
    return 0 if unittest.TextTestRunner(verbosity=2).run(suite).wasSuccessful() else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
