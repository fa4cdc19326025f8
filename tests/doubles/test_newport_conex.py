"""The double of a CONEX-CC against what Micro-Manager, QMI and yaq send to one and cut out of its answers.

SPDX-License-Identifier: Apache-2.0
"""

import unittest

from newport_conex import NewportConex


class Line:
    def __init__(self, **options):
        options.setdefault("ready_lag", 0.0)
        self.axis = NewportConex(**options)
        self.now = 0.0

    def ask(self, text, seconds=0.0, end="\r\n"):
        self.axis.receive((text + end).encode(), self.now)
        self.now += seconds
        return b"".join(each[1] for each in self.axis.say(self.now)).decode().removesuffix("\r\n")

    def refused(self, text):
        assert self.ask(text) == "", text
        return self.ask("1TE")

    def home(self):
        self.ask("1OR", seconds=50.0)


class NewportConexTest(unittest.TestCase):
    def test_the_version_has_words(self):
        words = Line().ask("1VE")[1:].strip().split()
        self.assertEqual(words, ["VE", "CONEX-CC", "1.0.6"])

    def test_it_has_to_be_homed_first(self):
        line = Line()
        self.assertEqual(line.ask("1TS"), "1TS00000A")
        self.assertEqual(line.refused("1PA5"), "1TEH")
        self.assertEqual(line.ask("1TE"), "1TE@")
        self.assertEqual(line.ask("1OR"), "")
        self.assertEqual(line.ask("1TS", seconds=36.0), "1TS00001E")
        self.assertEqual((line.refused("1OR"), line.refused("1PA1")), ("1TEE", "1TEL"))
        self.assertEqual(line.ask("1TS", seconds=5.0), "1TS00001E")  # 7.5 mm at 0.2 mm/s
        self.assertEqual((line.ask("1TS"), line.ask("1TP")), ("1TS000032", "1TP0"))

    def test_a_move_takes_its_time(self):
        line = Line()
        line.home()
        line.ask("1VA0.4")
        self.assertEqual(line.ask("1VA?"), "1VA0.4")
        self.assertEqual(line.ask("1PA3.141", seconds=2.0), "")
        self.assertEqual(line.ask("1TS"), "1TS000028")
        self.assertAlmostEqual(float(line.ask("1TP")[3:]), 0.4 * (2.0 - 0.125), places=2)
        self.assertEqual(line.ask("1TH"), "1TH3.141")
        self.assertEqual(line.refused("1PA5"), "1TEM")
        line.ask("", seconds=7.0)
        self.assertEqual((line.ask("1TS"), line.ask("1TP")), ("1TS000033", "1TP3.141"))
        line.ask("1PR-0.1", seconds=2.0)
        self.assertEqual(line.ask("1TP"), "1TP3.041")

    def test_ready_may_still_be_read_after_a_move_was_begun(self):
        line = Line(ready_lag=0.05)
        line.home()
        line.ask("1PA5")
        self.assertEqual(line.ask("1TS", seconds=0.06), "1TS000032")
        self.assertEqual(line.ask("1TS"), "1TS000028")

    def test_a_stop(self):
        line = Line()
        line.home()
        line.ask("1PA5", seconds=2.0)
        at = float(line.ask("1TP")[3:])
        line.ask("1ST", seconds=1.0)
        self.assertEqual(line.ask("1TS"), "1TS000033")
        self.assertAlmostEqual(float(line.ask("1TP")[3:]) - at, 0.4**2 / 2 / 1.6, places=2)

    def test_what_it_refuses(self):
        line = Line()
        line.home()
        for text, letter in (("1PA26", "G"), ("1PA-0.1", "G"), ("1PA", "C"), ("1PAx", "C"), ("1XX", "A"), ("PA1", "A"),
                             ("1OR", "K"), ("1PW1", "K"), ("1MM2", "C"), ("1TP5", "C"), ("1OT5", "K")):
            self.assertEqual(line.refused(text), "1TE" + letter, text)
        self.assertEqual(line.ask("1TBG"), "1TBG Displacement out of limits")
        self.assertEqual(line.ask("2TP"), "")

    def test_disabled_it_does_not_move(self):
        line = Line()
        line.home()
        line.ask("1MM0")
        self.assertEqual((line.ask("1TS"), line.refused("1PA1")), ("1TS00003C", "1TEJ"))
        line.ask("1MM1")
        self.assertEqual(line.ask("1TS"), "1TS000034")

    def test_an_actuator_that_is_held(self):
        line = Line()
        line.home()
        line.ask("1PA5", seconds=1.0)
        line.axis.arrange(line.now, blocked=True)
        line.now += 0.01
        self.assertEqual(line.ask("1TS"), "1TS00203D")
        line.axis.arrange(line.now, blocked=False)
        line.ask("1MM1")
        self.assertEqual(line.ask("1TS"), "1TS000034")

    def test_a_homing_that_is_too_late(self):
        line = Line()
        line.ask("1PW1")
        line.ask("1OT2")
        line.ask("1PW0", seconds=3.0)
        line.ask("1OR", seconds=3.0)
        self.assertEqual(line.ask("1TS"), "1TS00400B")

    def test_the_configuration_is_written_and_it_is_deaf_meanwhile(self):
        line = Line()
        line.ask("1PW1")
        self.assertEqual((line.ask("1TS"), line.refused("1OR")), ("1TS000014", "1TEI"))
        line.ask("1VA0.3")
        line.ask("1PW0")
        self.assertEqual((line.ask("1TE", seconds=2.1), line.axis.writes), ("", 1))
        self.assertEqual(line.ask("1TS"), "1TS00000C")
        line.axis.power_cycle(line.now)
        self.assertEqual((line.ask("1VA?"), line.ask("1TS")), ("1VA0.3", "1TS00000A"))

    def test_a_setting_in_ready_is_forgotten_and_a_reset_takes_time(self):
        line = Line()
        line.home()
        line.ask("1VA0.1")
        line.ask("1RS", seconds=1.0)
        self.assertEqual(line.ask("1TS", seconds=2.1), "")
        self.assertEqual((line.ask("1TS"), line.ask("1VA?")), ("1TS00000A", "1VA0.4"))

    def test_lines_end_with_both(self):
        self.assertEqual(Line().ask("1TE", end="\n"), "")
        self.assertEqual(Line().ask("1TE", end="\r"), "")
        self.assertEqual(Line(strict=False).ask("1TE", end="\r"), "1TE@")

    def test_limits(self):
        line = Line()
        self.assertEqual((line.ask("1SL?"), line.ask("1SR?")), ("1SL0", "1SR25"))
        line.home()
        line.ask("1SR2")
        self.assertEqual(line.refused("1PA3"), "1TEG")

    def test_an_end_of_run(self):
        line = Line(travel=10.0)
        line.home()
        line.ask("1SR25")
        line.ask("1PA20", seconds=60.0)
        self.assertEqual(line.ask("1TS"), "1TS00023D")

    def test_pieces_and_empty_lines(self):
        line = Line(chatty=True, pieces=3, gap=0.1, late=0.2)
        self.assertEqual(line.ask("1TS", seconds=0.21), "\r\n1")
        self.assertEqual(line.ask("", seconds=2.0), "TS00000A")


if __name__ == "__main__":
    unittest.main()
