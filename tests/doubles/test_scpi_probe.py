"""The doubles of field meters against their manuals' formats and other people's programs.

SPDX-License-Identifier: Apache-2.0
"""

import unittest

from scpi_probe import ScpiProbe


class Line:
    def __init__(self, **options):
        self.meter = ScpiProbe(**options)
        self.now = 0.0

    def raw(self, data, pause=0.1):
        self.now += pause
        self.meter.receive(data, self.now)
        return b"".join(each[1] for each in self.meter.say(self.now))

    def ask(self, text):
        return self.raw(text.encode() + b"\r\n").decode("latin-1").rstrip("\r\n")


class ScpiProbeTest(unittest.TestCase):
    def test_identities_of_the_manuals(self):
        for model, text in (("421", "LSCI,MODEL421,0,070199"), ("425", "LSCI,MODEL425,4250022,1.0"),
                            ("460", "LSCI,MODEL460,0,032406")):
            self.assertEqual(Line(model=model).ask("*IDN?"), text)

    def test_a_421_tells_number_and_multiplier_apart(self):
        line = Line(model="421")
        line.meter.arrange(0.0, field=[0, 0, 0.12345])
        self.assertEqual((line.ask("FIELD?"), line.ask("FIELDM?"), line.ask("UNIT?")), ("+1.2345", "k", "G"))
        line.ask("UNIT T")
        self.assertEqual((line.ask("FIELD?"), line.ask("FIELDM?")), ("+123.45", "m"))
        line.meter.arrange(0.0, field=[0, 0, -0.0025])
        self.assertEqual((line.ask("FIELD?"), line.ask("FIELDM?")), ("-2.5000", "m"))
        line.ask("UNIT G")
        self.assertEqual((line.ask("FIELD?"), line.ask("FIELDM?")), ("-25.000", " "))

    def test_an_overloaded_421_says_ol(self):
        line = Line(model="421")
        line.meter.arrange(0.0, field=[0, 0, 0.05])
        line.ask("RANGE 3")
        self.assertEqual((line.ask("FIELD?"), line.ask("RANGE?"), line.ask("AUTO?")), ("OL", "3", "0"))
        line.ask("AUTO 1")
        self.assertEqual((line.ask("FIELD?"), line.ask("RANGE?")), ("+0.5000", "1"))

    def test_a_421_loses_what_comes_too_fast(self):
        line = Line(model="421")
        line.ask("UNIT?")
        self.assertEqual(line.raw(b"FIELD?\r\n", pause=0.01), b"")
        self.assertEqual(line.meter.lost, 1)

    def test_a_475_tells_the_present_unit_with_an_exponent(self):
        line = Line(model="475")
        line.meter.arrange(0.0, field=[0, 0, 0.02])
        for unit, text in (("1", "+200.000E+00"), ("2", "+020.000E-03"), ("3", "+200.000E+00"), ("4", "+015.915E+03")):
            line.ask("UNIT " + unit)
            self.assertEqual((line.ask("UNIT?"), line.ask("RDGFIELD?")), (unit, text))

    def test_a_425_takes_its_ranges(self):
        line = Line(model="425")
        line.ask("RANGE 2")
        self.assertEqual(line.ask("RANGE?"), "2")
        line.ask("RANGE 9")
        self.assertEqual(line.ask("RANGE?"), "2")

    def test_a_460_has_channels(self):
        line = Line(model="460")
        line.meter.arrange(0.0, field=[0.0003, -0.02, 0.1])
        line.ask("UNIT T")
        told = []
        for channel in "XYZV":
            line.ask("CHNL " + channel)
            told.append((line.ask("FIELD?"), line.ask("FIELDM?")))
        self.assertEqual(told, [("+0.3000", "m"), ("-20.000", "m"), ("+100.00", "m"), ("+0.1020", " ")])
        self.assertEqual(line.ask("ALLF?"), "+0.3000,-20.000,+100.00,+0.1020")
        self.assertEqual(line.ask("*TST?"), "0")

    def test_several_commands_on_a_line(self):
        line = Line(model="475")
        self.assertEqual(line.ask("UNIT 2;UNIT?;*OPC?"), "2;1")

    def test_terminators_and_parity(self):
        self.assertEqual(Line(model="475").raw(b"UNIT?\n"), b"1\r\n")
        self.assertEqual(Line(model="475", terminator="lf").raw(b"UNIT?\n"), b"1\n")
        seven = Line(model="475", parity=True)
        odd = bytes(each | (0x80 if bin(each).count("1") % 2 == 0 else 0) for each in b"UNIT?\r\n")
        self.assertEqual(bytes(each & 0x7F for each in seven.raw(odd)), b"1\r\n")
        self.assertEqual(seven.raw(b"UNIT?\r\n"), b"")

    def test_zeroing(self):
        line = Line(model="475")
        line.meter.arrange(0.0, field=[0, 0, 5e-5])
        line.ask("ZPROBE")
        self.assertEqual(line.ask("RDGFIELD?"), "+000.000E+00")

    def test_zeroing_takes_its_time_and_opc_waits_for_it(self):
        line = Line(model="475", zeroing=3.0)
        line.meter.arrange(0.0, field=[0, 0, 5e-5])
        line.ask("ZPROBE")
        self.assertEqual(line.ask("RDGFIELD?"), "+500.000E-03")
        self.assertEqual(line.raw(b"*OPC?\r\n", pause=2.0), b"")
        self.assertEqual(line.raw(b"", pause=0.95), b"1\r\n")
        self.assertEqual(line.ask("RDGFIELD?"), "+000.000E+00")

    def test_a_wrong_command_is_silent_and_stands_in_the_register(self):
        for model in ("425", "475"):
            line = Line(model=model)
            self.assertEqual(line.ask("*ESR?"), "128")  # power on
            self.assertEqual(line.ask("FELD?"), "")
            self.assertEqual((line.ask("*ESR?"), line.ask("*ESR?")), ("32", "0"))
            self.assertEqual(line.ask("UNIT 7;UNIT?"), "1")
            self.assertEqual(line.ask("*ESR?"), "16")
            line.ask("RANGE 9;*CLS")
            self.assertEqual(line.ask("*ESR?"), "0")

    def test_a_hurried_line_is_lost_where_the_flow_is_kept(self):
        for model in ("425", "475"):
            line = Line(model=model, flow=True)
            self.assertEqual(line.ask("UNIT?"), "1")
            self.assertEqual((line.raw(b"UNIT?\r\n", pause=0.02), line.meter.lost), (b"", 1))
            self.assertEqual(Line(model=model).raw(b"UNIT?\r\nUNIT?\r\n"), b"1\r\n1\r\n")

    def test_peaks_and_the_temperature_of_a_475(self):
        line = Line(model="475")
        line.meter.arrange(0.0, field=[0, 0, 0.01])
        line.meter.arrange(0.0, field=[0, 0, -0.002])
        self.assertEqual(line.ask("RDGPEAK?"), "-020.000E+00,+100.000E+00")
        self.assertEqual(line.ask("RDGTEMP?"), "+025.000E+00")
        line.ask("PKRST")
        self.assertEqual(line.ask("RDGPEAK?"), "-020.000E+00,-020.000E+00")

    def test_an_overload_where_it_is_said(self):
        line = Line(model="425", overload="OL")
        line.meter.arrange(0.0, field=[0, 0, 0.05])
        self.assertEqual(line.ask("RDGFIELD?"), "+500.000E+00")
        self.assertEqual(line.ask("RANGE 2;RDGFIELD?"), "OL")
        self.assertEqual(line.ask("AUTO;RDGFIELD?"), "+500.000E+00")

    def test_a_reply_in_pieces_behind_an_empty_line(self):
        line = Line(model="475", pieces=4, gap=0.02, chatty=True, terminator="lf")
        self.assertEqual(line.raw(b"RDGFIELD?\n"), b"\n+00")
        self.assertEqual(line.raw(b"", pause=0.021), b"0.00")
        self.assertEqual(line.raw(b"", pause=1.0), b"0E+00\n")

    def test_a_teslameter_speaks_scpi(self):
        line = Line(model="f71")
        line.meter.arrange(0.0, field=[0.003, 0.0, 0.004])
        line.ask("UNIT:FIELD TESLA")
        self.assertEqual([float(each) for each in line.ask("FETCh:DC? ALL").split(",")], [0.005, 0.003, 0.0, 0.004])
        self.assertEqual(float(line.ask("FETC:DC? Z")), 0.004)
        self.assertEqual(line.ask("FETCH:DC? X;:SYST:ERR:ALL?"), '+3.000000E-03;0,"No error"')
        line.ask("UNIT:FIELD TESLA;FETC:DC?")
        self.assertEqual(line.ask("SYST:ERR?"), '-113,"Undefined header"')
        line.ask("UNIT FURLONG")
        self.assertEqual(line.ask("SYST:ERR?"), '-141,"Invalid character data"')

    def test_a_meter_that_is_not_there(self):
        self.assertEqual(Line(silent=True).ask("*IDN?"), "")


if __name__ == "__main__":
    unittest.main()
