"""The code of docs/python.md, run as it stands there.
SPDX-License-Identifier: Apache-2.0
"""

import importlib.util
import os
import re
import unittest

import support

PAGE = support.ROOT / "docs/python.md"


class Docs(unittest.TestCase):
    def test_the_page_s_code_runs_and_the_figure_shows_the_stream(self):
        place = support.PLACE / "page"
        place.mkdir()
        before = os.getcwd()
        os.chdir(place)
        self.addCleanup(os.chdir, before)
        os.environ["MPLBACKEND"] = "Agg"
        os.environ["MPLCONFIGDIR"] = str(place)
        blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        self.assertEqual(len(blocks), 6)
        drawn = importlib.util.find_spec("matplotlib") is not None
        names = {}
        for number, block in enumerate(blocks):
            if "matplotlib" in block:
                self.assertLessEqual(len(block.splitlines()), 5, "from run to figure")
                if not drawn:
                    print("\nmatplotlib is not there (apt-get install python3-matplotlib): the page's figure is not drawn")
                    continue
            exec(compile(block, f"{PAGE}, block {number + 1}", "exec"), names)
            if "matplotlib" in block:
                self.check_figure(names, place / "away.png")
        self.assertEqual(names["live"].wait().outcome, "stopped")

    def check_figure(self, names, file):
        import matplotlib.pyplot as plt
        self.assertEqual(file.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        servo = names["servo"]
        line = plt.gca().get_lines()[0]
        seen = servo.x.notna().to_numpy()
        self.assertGreater(seen.sum(), 20)
        # Matplotlib leaves out what is no number, or keeps it: compare where there is one.
        drawn = dict(zip(line.get_xdata(), line.get_ydata()))
        for time, x, target in zip(servo.index[seen], servo.x[seen], servo.target_x[seen]):
            self.assertEqual(drawn[time], (x - target) * 1e6)
        plt.close("all")


if __name__ == "__main__":
    unittest.main()
