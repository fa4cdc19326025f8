"""The double of an NE-1000 against the manuals' rules and what nesp-lib sends and reads.

SPDX-License-Identifier: Apache-2.0
"""

import unittest

from new_era import NewEra, crc, four


class Line:
    def __init__(self, **options):
        options.setdefault("alarm_at_power_up", False)
        self.pump = NewEra(**options)
        self.now = 0.0

    def raw(self, data=b"", seconds=0.0):
        self.pump.receive(data, self.now)
        self.now += seconds
        return b"".join(each[1] for each in self.pump.say(self.now))

    def ask(self, text, seconds=0.0):
        """Basic mode: the text between STX and ETX."""
        told = self.raw(text.encode() + b"\r", seconds)
        if not told:
            return None
        assert (told[0], told[-1]) == (2, 3), told
        return told[1:-1].decode()

    def safe(self, text, seconds=0.0):
        """Safe mode: the texts of all packets."""
        data = text.encode()
        return self.packets(self.raw(bytes([2, len(data) + 4]) + data + crc(data).to_bytes(2, "big") + b"\x03", seconds))

    def packets(self, told):
        texts = []
        while told:
            assert told[0] == 2 and told[told[1]] == 3, told
            body = told[2:told[1] - 2]
            assert int.from_bytes(told[told[1] - 2:told[1]], "big") == crc(body)
            texts.append(body.decode())
            told = told[told[1] + 1:]
        return texts


class NewEraTest(unittest.TestCase):
    def test_the_packet_that_the_manual_prints(self):
        line = Line()
        line.safe("SAF20")
        self.assertEqual(line.pump.lasting["SAF"], 20)
        self.assertEqual(line.raw(b"\x02\x08SAF0\x55\x43\x03"), b"\x0200S\x03")
        self.assertEqual(line.pump.lasting["SAF"], 0)

    def test_a_status_a_version_and_what_it_does_not_know(self):
        line = Line()
        for text in ("", "0", "00"):
            self.assertEqual(line.ask(text), "00S")
        self.assertEqual(line.ask("VER"), "00SNE1000V3.928")
        self.assertEqual(line.ask(" v\te r"), "00SNE1000V3.928")  # blanks, control characters, lower case
        self.assertEqual(line.ask("FOO"), "00S?")
        self.assertIsNone(line.ask("1VER"))

    def test_the_first_answer_after_power_up_is_the_alarm(self):
        line = Line(alarm_at_power_up=True)
        self.assertEqual(line.ask("DIA20.00"), "00A?R")
        self.assertEqual(line.ask("DIA"), "00S26.59")  # the command that met the alarm was not carried out
        line.ask("DIA20.00")
        line.pump.power_cycle(line.now)
        self.assertEqual((line.ask("DIA"), line.ask("DIA")), ("00A?R", "00S20.00"))

    def test_a_volume_is_pumped_in_its_time(self):
        line = Line()
        for text in ("DIA26.59", "VOLML", "VOL1.5", "RAT5.0MM", "DIRINF"):
            self.assertEqual(line.ask(text), "00S")
        self.assertEqual((line.ask("RAT"), line.ask("VOL"), line.ask("DIR")), ("00S5.000MM", "00S1.500ML", "00SINF"))
        self.assertEqual(line.ask("RUN"), "00I")
        line.raw(seconds=9.0)
        self.assertEqual(line.ask("DIS"), "00II0.750W0.000ML")
        line.raw(seconds=8.99)
        self.assertEqual(line.ask(""), "00I")
        line.raw(seconds=0.02)
        self.assertEqual(line.ask("DIS"), "00SI1.500W0.000ML")
        self.assertAlmostEqual(line.pump.plunger_ml, 1.5)
        line.ask("DIRWDR")
        self.assertEqual(line.ask("RUN", seconds=60.0), "00W")
        self.assertEqual(line.ask("DIS"), "00SI1.500W1.500ML")
        self.assertEqual((line.ask("CLDINF"), line.ask("DIS")), ("00S", "00SI0.000W1.500ML"))

    def test_a_stop_pauses_and_a_second_one_stops(self):
        line = Line()
        line.ask("VOL1.0")
        line.ask("RAT6.0MM")
        line.ask("RUN", seconds=4.0)
        self.assertEqual(line.ask("STP", seconds=100.0), "00P")
        self.assertEqual(line.ask("RUN", seconds=5.9), "00I")
        self.assertEqual(line.ask("", seconds=0.2), "00I")
        self.assertEqual(line.ask("DIS"), "00SI1.000W0.000ML")
        line.ask("RUN", seconds=1.0)
        self.assertEqual((line.ask("STP"), line.ask("STP"), line.ask("STP")), ("00P", "00S", "00S?NA"))
        self.assertEqual(line.ask("RUN", seconds=9.9), "00I")
        self.assertEqual(line.ask(""), "00I")  # from the start again

    def test_what_is_refused_while_it_pumps(self):
        line = Line()
        line.ask("VOL5")
        line.ask("RAT6.0MM")
        line.ask("RUN")
        for text, told in (("DIA20", "00I?NA"), ("DIRWDR", "00I?NA"), ("RAT100MH", "00I?NA"), ("VOL3", "00I?NA"),
                           ("CLDINF", "00I?NA"), ("RUN", "00I?NA"), ("RAT0", "00I?OOR"), ("RAT12", "00I")):
            self.assertEqual(line.ask(text), told, text)
        self.assertAlmostEqual(line.pump.rate_ml_s, 0.2)
        self.assertEqual(line.ask("RAT"), "00I6.000MM")  # not stored

    def test_numbers_and_ranges(self):
        line = Line()
        for text, told in (("DIA26.591", "?OOR"), ("DIA0.05", "?OOR"), ("DIA99", "?OOR"), ("DIA1.2.3", "?OOR"),
                           ("RAT9999MM", "?OOR"), ("RAT0.001UH", "?OOR"), ("RAT5XX", "?OOR"), ("VOL.5", ""), ("SAF300", "?OOR"),
                           ("DIRUP", "?OOR")):
            self.assertEqual(line.ask(text), "00S" + told, text)
        self.assertEqual(Line(strict=False).ask("DIA26.591"), "00S")
        self.assertEqual([four(each) for each in (0, 5, 26.59, 500, 1234)], ["0.000", "5.000", "26.59", "500.0", "1234."])

    def test_small_syringes_have_microliters(self):
        line = Line()
        line.ask("DIA14.00")
        self.assertEqual(line.ask("VOL"), "00S0.000UL")
        line.ask("DIA14.01")
        self.assertEqual(line.ask("VOL"), "00S0.000ML")
        line.ask("VOLUL")
        line.ask("VOL100")
        line.ask("RAT6MM")
        line.ask("RUN", seconds=1.01)
        self.assertEqual(line.ask("DIS"), "00SI100.0W0.000UL")

    def test_a_plunger_that_is_held_is_an_alarm(self):
        line = Line()
        line.ask("RAT1MM")
        line.ask("RUN", seconds=1.0)
        line.pump.arrange(line.now, blocked=True)
        self.assertEqual((line.ask(""), line.ask("")), ("00A?S", "00S"))

    def test_purging(self):
        line = Line()
        self.assertEqual(line.ask("PUR", seconds=60.0), "00X")
        self.assertAlmostEqual(line.pump.plunger_ml, 28.32, delta=0.02)
        self.assertEqual(line.ask("STP"), "00S")

    def test_an_address(self):
        line = Line(address=3)
        self.assertEqual((line.ask("3"), line.ask("03VER"), line.ask("VER")), ("03S", "03SNE1000V3.928", None))
        self.assertEqual((line.ask("*ADR"), line.ask("*ADR 5"), line.ask("5")), ("03S03", "05S", "05S"))
        self.assertEqual(line.ask("*RESET"), "00S")

    def test_safe_mode_stops_when_the_host_is_silent(self):
        line = Line()
        self.assertEqual(line.safe("SAF5"), ["00S"])
        line.safe("RAT1MM")
        self.assertEqual(line.safe("RUN", seconds=4.9), ["00I"])
        self.assertEqual(line.safe("", seconds=4.9), ["00I"])
        self.assertEqual(line.packets(line.raw(seconds=0.2)), ["00A?T"])  # by itself
        at = line.pump.plunger_ml
        self.assertEqual(line.packets(line.raw(seconds=60.0)), [])
        self.assertEqual(line.safe("", seconds=1.0), ["00A?T"])  # the auto alarm has not cleared it
        self.assertEqual(line.safe(""), ["00S"])
        self.assertEqual(line.pump.plunger_ml, at)

    def test_safe_mode_refuses_what_is_garbled(self):
        line = Line()
        line.safe("SAF20")
        self.assertEqual(line.packets(line.raw(b"\x02\x07RUN\x00\x00\x03")), ["00S?COM"])
        self.assertEqual(line.raw(b"RUN\r"), b"")  # not a packet
        self.assertFalse(line.pump.running)
        self.assertEqual(line.raw(b"\x02\x08SA", seconds=0.6), b"")
        self.assertEqual(line.safe(""), ["00S"])  # the beginning was dropped

    def test_safe_mode_lasts_and_its_alarm_comes_by_itself(self):
        line = Line(alarm_at_power_up=True)
        line.ask("")
        line.safe("SAF5")
        line.pump.power_cycle(line.now)
        self.assertEqual(line.packets(line.raw(seconds=100.0)), ["00A?R"])  # and no time-out before a packet
        self.assertEqual(line.safe(""), ["00A?R"])

    def test_an_echo_and_pieces(self):
        line = Line(chatty=True, pieces=2, gap=0.01, late=0.1)
        self.assertEqual(line.raw(b"VER\r", seconds=0.05), b"")
        self.assertEqual(line.raw(seconds=1.0), b"VER\r\x0200SNE1000V3.928\x03")


if __name__ == "__main__":
    unittest.main()
