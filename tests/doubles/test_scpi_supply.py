"""The doubles of a SCPI supply and of Lake Shore's thermometers against the standards, manuals and a laboratory's notes.

SPDX-License-Identifier: Apache-2.0
"""

import math
import socket
import time
import unittest

from double import Refused
from lakeshore_monitor import LakeshoreMonitor
from scpi_supply import ScpiSupply
from test_serve import PATIENCE, Served, receive_exactly


class Line:
    def __init__(self, double):
        self.double = double
        self.now = 0.0

    def raw(self, data=b"", seconds=0.1):
        self.double.receive(data, self.now)
        self.now += seconds
        return b"".join(each[1] for each in self.double.say(self.now))

    def ask(self, text, seconds=0.1):
        return self.raw(text.encode() + b"\n", seconds).decode().rstrip("\r\n")


class ScpiSupplyTest(unittest.TestCase):
    def setUp(self):
        self.line = Line(ScpiSupply())
        self.ask = self.line.ask

    def test_constant_voltage_and_constant_current(self):
        self.ask("*RST;VOLT 12;CURR 2;OUTP ON", seconds=1.0)
        self.assertEqual([float(each) for each in self.ask("MEAS:VOLT?;CURR?").split(";")], [12.0, 1.2])
        self.ask("curr 500 mA", seconds=1.0)
        self.assertEqual([float(self.ask(f"MEAS:{each}?")) for each in ("VOLT", "CURR")], [5.0, 0.5])
        self.assertEqual(self.ask("OUTP?;:SOUR:VOLT:LEV:IMM:AMPL?"), "1;1.2000E+01")

    def test_the_voltage_slews_and_a_measurement_takes_time(self):
        self.ask("VOLT 20;CURR 5;OUTP 1", seconds=0.05)
        self.assertEqual(self.line.raw(b"MEAS:VOLT?\n", seconds=0.019), b"")
        self.assertAlmostEqual(float(self.line.raw(seconds=0.002)), 5.0, places=3)

    def test_the_heater_warms(self):
        self.ask("VOLT 20;CURR 5;OUTP ON", seconds=200.0)
        # 40 W at 2 K/W, tau = 200 s
        self.assertAlmostEqual(float(self.ask("MEAS:TEMP?")), 22 + 80 * (1 - math.exp(-1)), delta=0.2)
        self.line.double.arrange(self.line.now, broken_sensor=True)
        self.assertEqual(self.ask("MEAS:TEMP?"), "9.91E+37")

    def test_errors(self):
        for text, code in (("VOLT 31", -222), ("VOLT", -109), ("VOLT x", -120), ("FOO 1", -113), ("OUTP MAYBE", -141)):
            self.ask(text)
            self.assertEqual(int(self.ask("SYST:ERR?").split(",")[0]), code, text)
        self.assertEqual(self.ask("SYST:ERR?"), '0,"No error"')
        self.assertEqual(self.ask("*ESR?"), str(0x80 | 0x20 | 0x10))
        for _ in range(15):
            self.ask("FOO")
        told = [int(self.ask("SYST:ERR?").split(",")[0]) for _ in range(11)]
        self.assertEqual(told, [-113] * 9 + [-350, 0])

    def test_a_message_that_is_too_long(self):
        self.ask("OUTP ON" + " " * 300 + ";VOLT 3")
        self.assertEqual((self.ask("SYST:ERR?"), self.ask("OUTP?")), ('-363,"Input buffer overrun"', "0"))
        loose = Line(ScpiSupply(strict=False))
        self.assertEqual(loose.ask("OUTP ON" + " " * 300 + ";VOLT 3;OUTP?;VOLT?"), "1;3.0000E+00")

    def test_a_load_that_cannot_be(self):
        with self.assertRaises(Refused):
            self.line.double.arrange(0.0, load_ohm=0.0)

    def test_the_status_byte_asks_for_service(self):
        self.ask("*CLS;*ESE 32;*SRE 32")
        self.assertEqual(self.ask("*STB?"), "0")
        self.ask("FOO")
        self.assertEqual(self.ask("*STB?"), str(4 + 32 + 64))

    def test_datagrams(self):
        line = Line(ScpiSupply(wire="udp", lose=3, twice=2))
        self.assertEqual(line.raw(b"*OPC?"), b"1\n")  # without a line feed
        told = [line.raw(b"*OPC?\n") for _ in range(5)]
        self.assertEqual(told, [b"1\n1\n", b"", b"1\n1\n", b"1\n", b""])
        self.assertEqual(line.double.lost, 2)
        plain = Line(ScpiSupply(lose=3, twice=2))
        self.assertEqual([plain.raw(b"*OPC?\n") for _ in range(4)], [b"1\n"] * 4)

    def test_an_echo_a_header_and_pieces(self):
        line = Line(ScpiSupply(chatty=True, header=True, pieces=4, gap=0.5, late=0.2, terminator="crlf"))
        self.assertEqual(line.raw(b"OUTP?\n", seconds=0.21), b"OUTP")
        self.assertEqual(line.raw(seconds=5.0), b"?\r\nOUTP 0\r\n")

    def test_a_port_and_datagrams_served(self):
        with Served("scpi_supply", "--tcp", "0") as served:
            host, port = served.where.split(":")
            with socket.create_connection((host, int(port)), PATIENCE) as link:
                link.sendall(b"VOLT 1;OUTP ON;*IDN?\n")
                self.assertEqual(receive_exactly(link, 33), b"VITREO DOUBLES,SUPPLY 30-5,0,1.0\n")
                self.assertEqual(served.order(get="output"), {"output": True})
        with Served("scpi_supply", "--udp", "0", "--option", "wire=udp") as served, \
                socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            host, port = served.where.split(":")
            link.settimeout(PATIENCE)
            link.sendto(b"*IDN?", (host, int(port)))
            self.assertEqual(link.recv(100), b"VITREO DOUBLES,SUPPLY 30-5,0,1.0\n")
            served.order(unplug=True)
            served.order(plug=True)
            link.sendto(b"*OPC?", (host, int(port)))
            self.assertEqual(link.recv(100), b"1\n")
            begun = time.monotonic()
            served.order(mode={"late": 0.3})
            link.sendto(b"*OPC?", (host, int(port)))
            self.assertEqual(link.recv(100), b"1\n")
            self.assertGreater(time.monotonic() - begun, 0.3)


class LakeshoreMonitorTest(unittest.TestCase):
    def test_answers_of_a_real_218(self):
        line = Line(LakeshoreMonitor())
        line.double.arrange(0.0, kelvin=[500.0] * 4 + [1.4] * 4, open_inputs=[1])
        self.assertEqual(line.raw(b"*IDN?\r\n"), b"LSCI,MODEL218E,21EA4F,042109\r\n")
        self.assertEqual(line.ask("KRDG?"), ",".join(["+480.00"] * 4 + ["+01.400"] * 4))
        self.assertEqual((line.ask("KRDG? 5"), line.ask("CRDG? 1")), ("+01.400", "+206.85"))
        self.assertEqual([line.ask(f"RDGST? {each}") for each in (1, 2, 5)], ["032", "033", "000"])
        self.assertEqual((line.ask("KRDG? 9"), line.ask("FOO?"), line.double.unknown), ("", "", 1))

    def test_a_218_loses_what_comes_too_soon(self):
        line = Line(LakeshoreMonitor())
        line.ask("KRDG? 1", seconds=0.02)
        self.assertEqual((line.ask("KRDG? 1"), line.double.lost), ("", 1))
        line = Line(LakeshoreMonitor(strict=False))
        line.ask("KRDG? 1", seconds=0.02)
        self.assertEqual(line.ask("KRDG? 1"), "+295.00")

    def test_a_336_controls(self):
        line = Line(LakeshoreMonitor(model="336"))
        line.ask("SETP 1,310;RANGE 1,3", seconds=900.0)
        self.assertAlmostEqual(float(line.ask("KRDG? A")), 310.0, delta=0.5)
        self.assertEqual((line.ask("SETP? 1"), line.ask("RANGE? 1"), line.ask("KRDG? D")), ("+310.00", "3", "+295.00"))
        self.assertGreater(float(line.ask("HTR? 1")), 1.0)
        line.ask("RANGE 1,0", seconds=900.0)
        self.assertEqual((line.ask("HTR? 1"), line.ask("KRDG? A")), ("+000.0", "+295.01"))
        line.ask("SETP 1,x;RANGE 1,9;SETP 7,300")
        self.assertEqual((line.ask("SETP? 1"), line.ask("RANGE? 1")), ("+310.00", "0"))

    def test_a_ramp_takes_its_minutes(self):
        line = Line(LakeshoreMonitor(model="336"))
        line.ask("RAMP 1,1,5.0;RANGE 1,3")
        line.ask("SETP 1,305", seconds=60.0)
        self.assertEqual((line.ask("RAMPST? 1"), round(line.double.aim)), ("1", 300))
        line.ask("", seconds=61.0)
        self.assertEqual(line.ask("RAMPST? 1"), "0")

    def test_pieces(self):
        line = Line(LakeshoreMonitor(chatty=True, pieces=3, gap=0.1))
        self.assertEqual(line.raw(b"KRDG? 1\n", seconds=0.05), b"\r\n+")


if __name__ == "__main__":
    unittest.main()
