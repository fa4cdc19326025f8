"""The double of a Harvard Pump 11 against what pumpy sends and cuts out of the answers.

SPDX-License-Identifier: Apache-2.0
"""

import unittest

from harvard_pump11 import HarvardPump11


class Line:
    def __init__(self, **options):
        self.pump = HarvardPump11(**options)
        self.now = 0.0

    def ask(self, text, seconds=0.0):
        self.pump.receive(text.encode() + b"\r", self.now)
        self.now += seconds
        return b"".join(each[1] for each in self.pump.say(self.now)).decode()


class HarvardPump11Test(unittest.TestCase):
    def test_lengths_that_pumpy_reads(self):
        line = Line()
        version = line.ask("00VER")
        self.assertEqual((len(version), version[-3:]), (17, "00:"))
        self.assertEqual(line.ask("00MMD10.3"), "\r\n00:")
        diameter = line.ask("00DIA")
        self.assertEqual((len(diameter), diameter[3:9].strip().rstrip("0")), (15, "10.3"))
        line.ask("00ULM2000")
        self.assertEqual(line.ask("00RAT")[2:8].rstrip("0").rstrip("."), "2000")

    def test_a_target_volume_is_reached_in_its_time(self):
        line = Line()
        line.ask("MMD10")
        line.ask("ULM600")
        line.ask("MLT200")
        self.assertEqual(line.ask("RUN", seconds=10.0), "\r\n00>")
        self.assertEqual(line.ask("VOL", seconds=9.9), "\r\n 100.000\r\n00>")
        self.assertEqual(line.ask("", seconds=0.2), "\r\n00>")
        self.assertEqual(line.ask("VOL"), "\r\n 200.000\r\n00:")
        self.assertAlmostEqual(line.pump.plunger_ul, 200.0)

    def test_withdrawing_as_pumpy_does_it(self):
        line = Line()
        line.ask("ULM60")
        self.assertEqual((line.ask("REV"), line.ask("RUN", seconds=5.0)), ("\r\n00:", "\r\n00<"))
        self.assertAlmostEqual(line.pump.plunger_ul, -5.0)
        self.assertEqual((line.ask("REV"), line.ask("STP")), ("\r\n00>", "\r\n00:"))
        self.assertEqual(Line(reverses=False).ask("REV"), "\r\nNA\r\n00:")

    def test_refusals(self):
        line = Line()
        for text, told in (("MMD40", "OOR"), ("ULM99999", "OOR"), ("FOO", "?"), ("MMDx", "?"), ("ULM", "?"), ("!", "?")):
            self.assertEqual(line.ask(text), f"\r\n{told}\r\n00:", text)
        self.assertTrue(line.ask("00ULM99999").startswith("\r\nOOR"))  # the five bytes that pumpy reads
        line.ask("ULM60")
        line.ask("RUN")
        self.assertEqual(line.ask("MMD5"), "\r\nNA\r\n00>")

    def test_a_diameter_forgets_the_rate(self):
        line = Line()
        line.ask("ULM60")
        line.ask("MMD12")
        self.assertEqual(line.ask("RUN"), "\r\nOOR\r\n00:")

    def test_a_stall_is_a_star(self):
        line = Line()
        line.ask("ULM60")
        line.ask("RUN", seconds=1.0)
        line.pump.arrange(line.now, blocked=True)
        self.assertEqual((line.ask(""), line.ask("STP")), ("\r\n00*", "\r\n00:"))

    def test_addresses_and_a_milliliter_pump(self):
        line = Line(address=3, target_unit="ml")
        self.assertEqual((line.ask("03"), line.ask("3"), line.ask("04VER")), ("\r\n03:", "\r\n03:", ""))
        line.ask("3MLT1.5")
        self.assertEqual(line.pump.target_ul, 1500.0)
        self.assertEqual(Line(address=4, address_digits=1).ask("04"), "\r\n4:")

    def test_precision_is_cut(self):
        line = Line()
        line.ask("ULM12.3456")
        self.assertEqual(line.pump.rate, 12.34)
        line = Line(strict=False)
        line.ask("ULM12.3456")
        self.assertEqual(line.pump.rate, 12.3456)

    def test_pieces_and_a_second_prompt(self):
        line = Line(pieces=3, gap=0.01, late=0.05, chatty=True)
        self.assertEqual(line.ask("", seconds=0.051), "\r\n0")
        line.now += 1.0
        self.assertEqual(b"".join(each[1] for each in line.pump.say(line.now)), b"0:\r\n00:")


if __name__ == "__main__":
    unittest.main()
