"""The double of the data loggers against the examples of their manuals.

SPDX-License-Identifier: Apache-2.0
"""

import unittest

from scpi_logger import ScpiLogger


class Line:
    def __init__(self, **options):
        self.logger = ScpiLogger(**options)
        self.now = 0.0

    def send(self, text, wait=1.0):
        self.now += 0.1
        self.logger.receive(text.encode() + b"\n", self.now)
        self.now += wait
        return b"".join(each[1] for each in self.logger.say(self.now)).decode("latin-1").rstrip("\r\n")


class ScpiLoggerTest(unittest.TestCase):
    def test_scan_list_of_the_manual(self):
        line = Line()
        self.assertEqual(line.send("ROUT:SCAN?"), "#13(@)")
        line.send("ROUT:SCAN (@101:103)")
        self.assertEqual(line.send("ROUT:SCAN?"), "#214(@101,102,103)")
        self.assertEqual(line.send("ROUT:SCAN:SIZE?"), "3")
        line.send("ROUT:SCAN (@)")
        self.assertEqual(line.send("ROUT:SCAN?"), "#13(@)")

    def test_a_sweep_gives_the_voltages_upwards(self):
        line = Line()
        line.send("CONF:VOLT:DC 10,(@102,101)")
        line.logger.arrange(0.0, volts={"101": 0.00427150, "102": -2.5})
        self.assertEqual(line.send("READ?"), "+4.27150000E-03,-2.50000000E+00")
        line.send("FORM:READ:CHAN ON")
        self.assertEqual(line.send("READ?"), "+4.27150000E-03,101,-2.50000000E+00,102")

    def test_configuring_switches_the_channel_field_off(self):
        line = Line()
        line.send("FORM:READ:CHAN ON")
        line.send("CONF:VOLT:DC 10,(@101)")
        self.assertEqual(line.send("READ?"), "+0.00000000E+00")

    def test_a_sweep_takes_its_time(self):
        line = Line()
        line.send("CONF:VOLT:DC 10,(@101:108)")
        self.assertEqual(line.send("READ?", wait=0.18), "")
        self.assertNotEqual(line.send("*OPC?", wait=0.5), "")
        line.send("VOLT:DC:NPLC 0.02,(@101:108)")
        self.assertNotEqual(line.send("READ?", wait=0.04), "")

    def test_what_somebody_left_on_is_told(self):
        line = Line(left="UNIT TIME")
        line.send("CONF:VOLT:DC 10,(@101)")
        self.assertEqual(line.send("READ?"), "+0.00000000E+00 VDC,000000000.017")
        line.send("FORM:READ:UNIT OFF;TIME OFF")
        self.assertEqual(line.send("READ?"), "+0.00000000E+00")

    def test_errors_are_told_in_order_and_once(self):
        line = Line()
        for wrong in ("READ?", "ROUT:SCAN (@401)", "NONSENSE"):
            self.assertEqual(line.send(wrong), "")
        for code in (-221, -222, -113, 0):
            self.assertEqual(int(line.send("SYST:ERR?").split(",")[0]), code)
        line.send("NONSENSE")
        line.send("*CLS")
        self.assertEqual(line.send("SYST:ERR?"), '+0,"No error"')

    def test_without_a_colon_the_path_stays(self):
        line = Line()
        line.send("ROUT:SCAN (@101);READ?")
        self.assertEqual(int(line.send("SYST:ERR?").split(",")[0]), -113)
        self.assertEqual(line.send("ROUT:SCAN (@101);:READ?"), "+0.00000000E+00")

    def test_overload(self):
        line = Line()
        line.send("CONF:VOLT:DC 10,(@101)")
        line.logger.arrange(0.0, volts={"101": -13.0})
        self.assertEqual(line.send("READ?"), "-9.90000000E+37")

    def test_identity(self):
        self.assertTrue(Line(model="daq970a").send("*IDN?").startswith("Keysight Technologies,DAQ970A,"))


if __name__ == "__main__":
    unittest.main()
