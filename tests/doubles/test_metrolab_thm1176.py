"""The double of a THM1176 against its manual, recordings of a real one, and what python-usbtmc sends.

SPDX-License-Identifier: Apache-2.0
"""

import os
import socket
import struct
import tempfile
import unittest

import serve
from double import STALL
from metrolab_thm1176 import MetrolabThm1176
from test_serve import PATIENCE, Served, exchange, receive_exactly
from usbtmc import UsbtmcLine

OUT, IN, INTERRUPT = 0x02, 0x81, 0x83


class Host:
    """python-usbtmc's write_raw and read_raw, without the USB between."""

    def __init__(self, **options):
        self.probe = MetrolabThm1176(**options)
        self.now = 0.0
        self.tag = 0

    def header(self, kind):
        self.tag = self.tag % 255 + 1
        return struct.pack("BBBx", kind, self.tag, ~self.tag & 0xFF)

    def write(self, text, ended=True):
        data = text.encode() if isinstance(text, str) else text
        packet = self.header(1) + struct.pack("<LBxxx", len(data), ended) + data + bytes(-len(data) % 4)
        return self.probe.bulk_out(OUT, packet, self.now)

    def read(self, most=1024, seconds=0.0, terminator=None):
        """Everything up to the end of the message, or None when none has come by then."""
        self.now += seconds
        whole, sizes = b"", []
        while True:
            attributes = struct.pack("<LBBxx", most, 2 if terminator else 0, terminator or 0)
            assert self.probe.bulk_out(OUT, self.header(2) + attributes, self.now) == 12
            answer = self.probe.bulk_in(IN, most + 15, self.now)
            if answer is None:
                return None
            kind, tag, inverse, zero, size, ended = struct.unpack_from("<BBBBIB", answer)
            assert (kind, tag, inverse, zero) == (2, self.tag, ~self.tag & 0xFF, 0)
            assert len(answer) % 4 == 0
            whole += answer[12:12 + size]
            sizes.append(size)
            self.sizes = sizes
            if ended:
                self.ended = ended
                return whole

    def ask(self, text, seconds=1.0, **more):
        self.write(text)
        answer = self.read(seconds=seconds, **more)
        return None if answer is None else answer.decode().rstrip("\n")

    def control(self, kind, request, value, index, length):
        return self.probe.control(kind, request, value, index, length, self.now)


class UsbtmcTest(unittest.TestCase):
    def test_the_first_bytes_of_a_query(self):
        probe = MetrolabThm1176()
        self.assertEqual(probe.bulk_out(OUT, b"\x01\x01\xfe\x00\x05\x00\x00\x00\x01\x00\x00\x00*IDN?\x00\x00\x00", 0.0), 20)
        self.assertIsNone(probe.bulk_in(IN, 1000, 0.0))  # not asked for
        self.assertEqual(probe.bulk_out(OUT, b"\x02\x02\xfd\x00\x00\x04\x00\x00\x00\x00\x00\x00", 0.0), 12)
        answer = probe.bulk_in(IN, 1000, 0.0)
        self.assertEqual(answer[:12], b"\x02\x02\xfd\x00\x3a\x00\x00\x00\x01\x00\x00\x00")
        self.assertEqual(answer[12:], b"Metrolab Technology SA,THM1176-MF,0000803,elD1-prD0-fw3.1\n\x00\x00")

    def test_a_wrong_header_halts_the_pipe_until_it_is_cleared(self):
        good = b"\x01\x05\xfa\x00\x04\x00\x00\x00\x01\x00\x00\x00*CLS"
        for bad in (b"\x01\x05\xfb\x00" + good[4:], b"\x01\x00\xff\x00" + good[4:], b"\x63\x05\xfa\x00" + good[4:],
                    good[:4] + b"\x09" + good[5:], good[:4] + bytes(4) + good[8:], good[:7], b"\x01\x05\xfa\x01" + good[4:]):
            probe = MetrolabThm1176()
            self.assertEqual(probe.bulk_out(OUT, bad, 0.0), STALL, bad)
            self.assertEqual(probe.bulk_out(OUT, good, 0.0), STALL)
            self.assertEqual(probe.control(0x02, 1, 0, OUT, b"", 0.0), 0)
            self.assertEqual(probe.bulk_out(OUT, b"\x01\x06\xf9\x00" + good[4:], 0.0), len(good))

    def test_a_tag_twice_is_refused_by_a_strict_one(self):
        good = b"\x01\x05\xfa\x00\x04\x00\x00\x00\x01\x00\x00\x00*CLS"
        for strict, second in ((True, STALL), (False, len(good))):
            probe = MetrolabThm1176(strict=strict)
            probe.bulk_out(OUT, good, 0.0)
            self.assertEqual(probe.bulk_out(OUT, good, 0.0), second)

    def test_a_message_in_several_transfers_and_a_transfer_in_several_packets(self):
        host = Host()
        host.write("*ID", ended=False)
        self.assertEqual(host.ask("N?").split(",")[1], "THM1176-MF")
        text = b"*CLS;" * 20 + b"*OPC?"
        whole = host.header(1) + struct.pack("<LBxxx", len(text), 1) + text + bytes(-len(text) % 4)
        self.assertEqual(host.probe.bulk_out(OUT, whole[:64], 0.0), 64)
        self.assertEqual(host.probe.bulk_out(OUT, whole[64:], 0.0), len(whole) - 64)
        self.assertEqual(host.read(), b"1\n")

    def test_an_answer_in_parts(self):
        host = Host()
        identity = host.ask("*IDN?", most=10)
        self.assertEqual(identity, "Metrolab Technology SA,THM1176-MF,0000803,elD1-prD0-fw3.1")
        self.assertEqual(host.sizes, [10, 10, 10, 10, 10, 8])
        host = Host(pieces=7)
        self.assertEqual(host.ask("*IDN?"), identity)
        self.assertEqual(max(host.sizes), 7)
        host = Host()
        host.write("*IDN?")
        self.assertEqual(host.read(terminator=ord("\n")), identity.encode() + b"\n")
        self.assertEqual(host.ended, 3)

    def test_an_answer_that_is_not_read_is_lost_and_a_read_without_a_query_is_an_error(self):
        host = Host()
        host.write("*IDN?")
        self.assertEqual(host.ask("*OPC?"), "1")
        self.assertEqual(host.ask(":SYST:ERR?"), '-410,"Query INTERRUPTED"')
        host = Host()
        self.assertIsNone(host.read())
        self.assertEqual(host.control(0xA2, 3, host.tag, IN, 2), (2, bytes([1, host.tag])))
        self.assertEqual(host.control(0xA2, 3, host.tag, IN, 2), (2, bytes([0x80, 0])))
        self.assertEqual(host.control(0xA2, 4, 0, IN, 8), (8, bytes([1, 0, 0, 0, 0, 0, 0, 0])))
        self.assertEqual(host.ask(":SYST:ERR?"), '-420,"Query UNTERMINATED"')

    def test_capabilities_status_byte_and_clear(self):
        host = Host()
        size, data = host.control(0xA1, 7, 0, 0, 0x18)
        self.assertEqual((size, data[0], data[2:4], data[12:14]), (24, 1, b"\x00\x01", b"\x00\x01"))
        self.assertTrue(data[5] & 1 and data[14] & 4 and data[15] & 8)  # TermChar, 488.2, SCPI
        host.write("*RTS")
        self.assertEqual(host.control(0xA1, 128, 2, 0, 3), (3, b"\x01\x02\x00"))
        self.assertEqual(host.control(0xA1, 128, 3, 0, 3), (3, b"\x20\x03\x00"))  # the first is not read yet
        self.assertEqual(host.probe.bulk_in(INTERRUPT, 2, 0.0), b"\x82\x04")
        plain = Host(interrupt=False)
        self.assertEqual(plain.control(0xA1, 128, 2, 0, 3), (3, b"\x01\x02\x00"))
        host.write("*IDN?")
        self.assertEqual(host.control(0xA1, 5, 0, 0, 1), (1, b"\x01"))
        self.assertEqual(host.write("*OPC?"), STALL)
        self.assertEqual(host.control(0xA1, 6, 0, 0, 2), (2, b"\x01\x00"))
        host.control(0x02, 1, 0, OUT, b"")
        self.assertEqual(host.ask("*OPC?"), "1")
        self.assertEqual(host.control(0xA1, 99, 0, 0, 2), (STALL, b""))
        self.assertEqual(host.probe.bulk_out(0x05, b"x", 0.0), STALL)

    def test_a_transfer_that_is_begun_can_be_taken_back(self):
        host = Host()
        begun = host.header(1) + struct.pack("<LBxxx", 200, 1) + bytes(52)
        self.assertEqual(host.probe.bulk_out(OUT, begun, 0.0), 64)
        self.assertEqual(host.control(0xA2, 1, host.tag, OUT, 2)[1][0], 1)
        host.control(0x02, 1, 0, OUT, b"")
        self.assertEqual(host.ask("*OPC?"), "1")

    def test_a_chatty_one_asks_for_service(self):
        host = Host(chatty=True)
        host.write("*OPC?")
        first = host.probe.bulk_in(INTERRUPT, 2, 0.0)
        self.assertEqual((first[0], first[1] & 0x50), (0x81, 0x50))  # a service request, with MAV
        self.assertEqual(host.read(), b"1\n")


class ThmTest(unittest.TestCase):
    def setUp(self):
        self.host = Host()
        self.ask = self.host.ask

    def field(self, *tesla):
        self.host.probe.arrange(self.host.now, field=list(tesla))

    def errors(self):
        return [int(each.split(",")[0]) for each in iter(lambda: self.ask(":SYST:ERR?"), '0,"No error"')]

    def test_what_was_recorded_with_a_real_one(self):
        self.assertEqual(self.ask(":SENS:ALL?"), "0.1 T,0.3 T,1 T,3 T")
        self.assertEqual((self.ask(":SENS:AUTO?"), self.ask(":CAL:STAT?")), ("ON", "ON"))
        self.host.write(":AVER:COUN 100")
        self.assertEqual(self.ask(":AVER:COUN?"), "100")
        self.field(0.003995, -0.002272, -0.034074)
        self.ask(":READ?")
        self.assertEqual([self.ask(f":FETC:{axis}? 5") for axis in "XYZ"], ["+0.003995 T", "-0.002272 T", "-0.034074 T"])
        self.host.write(":SENS:AUTO OFF;:SENS 0.3 T;:READ?")
        self.assertEqual(self.host.read(seconds=1.0), b"-0.002 T\n")
        self.assertEqual(self.ask(":FETC:Z? 5"), "-0.03407 T")

    def test_the_sequence_of_the_fact_sheet(self):
        self.field(0.01234, -0.2, 0.0)
        self.host.write(":SENS:AUTO OFF;:SENS 0.3 T;:AVER:COUN 100;:UNIT MT;:INIT")
        answer = self.ask(":FETC:X? 5;:FETC:Y? 5;:FETC:Z? 5;:FETC:TIM?;:FETC:TEMP?;*STB?")
        x, y, z, time, temperature, status = answer.split(";")
        self.assertEqual((x, y, z), ("+12.34 MT", "-200.00 MT", "+0.00 MT"))
        self.assertEqual((int(time, 0) % 167, int(temperature), int(status)), (0, 30000, 0))
        self.assertAlmostEqual(int(time, 0) / 1e9, 100 / 6800, places=4)

    def test_an_acquisition_takes_its_time(self):
        self.host.write(":AVER:COUN 6800;:INIT;:FETC:X?")
        self.assertIsNone(self.host.read(seconds=0.9))
        self.assertEqual(self.host.probe.bulk_in(IN, 100, 1.01)[12:20], b"+0.0000 ")

    def test_a_series_follows_the_field(self):
        self.host.write(":TRIG:SOUR TIM;:TRIG:TIM 0.01S;:TRIG:COUN 100;:SENS:AUTO OFF;:SENS 1 T;:INIT")
        self.field(0.1, 0.0, 0.0)
        self.host.now = 0.505
        self.field(0.5, 0.0, 0.0)
        values = self.ask(":FETC:ARR:X? 100,5").split(",")
        self.assertEqual((len(values), values[0], values[-1]), (100, "+0.10000 T", "+0.50000 T"))
        self.assertIn(values.count("+0.10000 T"), (50, 51))
        self.ask(":FETC:ARR:X? 101,5", seconds=0.0)
        self.assertEqual(self.errors(), [-222, -420])

    def test_a_series_that_goes_on(self):
        self.host.write(":TRIG:SOUR TIM;:TRIG:TIM 0.01S;:TRIG:COUN 10;:INIT:CONT ON;:INIT")
        ends = []
        for _ in range(3):
            text = self.ask(":FETC:ARR:X? 10;:FETC:TIM?", seconds=0.101)
            ends.append(int(text.split(";")[1], 0) / 1e9)
        self.assertAlmostEqual(ends[1] - ends[0], 0.1, places=3)
        self.assertAlmostEqual(ends[2] - ends[1], 0.1, places=3)
        self.host.now += 60.0
        self.ask("*OPC?")
        self.assertIn(204, self.host.probe.errors)
        self.host.write(":ABOR")
        self.assertIsNone(self.ask(":FETC:X?"))

    def test_integers_in_blocks(self):
        self.field(0.001, -0.002, 0.05)
        self.host.write(":FORM INT;:INIT")
        self.host.write(":FETC:X?;:FETC:Y?;:FETC:TEMP?")
        answer = self.host.read(seconds=1.0)
        self.assertEqual(answer[:12], b"#6000004" + struct.pack(">i", 1000))
        self.assertEqual(answer[12:], b";   #6000004" + struct.pack(">i", -2000) + b";30000\n")
        self.host.write(":FORM PACK,1;:FETC:Z?")
        self.assertEqual(self.host.read(seconds=1.0), b"#500005" + b"1" + struct.pack(">i", 50000) + b"\n")
        self.host.write(":FORM ASC,1")
        self.assertEqual(self.errors(), [-222])

    def test_over_range_is_an_error_and_stands_in_the_register(self):
        self.field(0.5, 0.0, 0.0)
        self.host.write(":SENS:AUTO OFF;:SENS 0.1 T;:INIT")
        self.assertEqual(self.ask(":FETC:X? 5;*STB?"), "+0.100000 T;4")
        self.assertEqual(self.ask(":STAT:QUES?"), str(1 << 9))
        self.assertEqual(self.errors(), [205])

    def test_measure_resets_the_settings(self):
        self.host.write(":AVER:COUN 50;:TRIG:SOUR BUS")
        self.assertEqual(self.ask(":MEAS:X?"), "+0.0000 T")
        self.assertEqual(self.ask(":AVER:COUN?;:TRIG:SOUR?"), "1;IMM")
        self.assertIsNone(self.ask(":MEAS:X? 21T"))
        self.assertEqual(self.errors(), [-222, -420])

    def test_bus_triggers(self):
        self.host.write(":TRIG:SOUR BUS;:TRIG:COUN 2;:INIT")
        self.assertIsNone(self.ask(":FETC:X?"))
        for tesla in (0.01, 0.02):
            self.field(tesla, 0.0, 0.0)
            self.host.write("*TRG") if tesla == 0.01 else self.host.probe.bulk_out(OUT, self.host.header(128) + bytes(8), 2.0)
        self.assertEqual(self.ask(":FETC:ARR:X? 2,2"), "+0.010 T,+0.020 T")
        self.host.write("*TRG")
        self.assertEqual(self.errors(), [-221, -420, -221])

    def test_refusals_of_the_manual(self):
        for text, code in ((":SENS 0.2 T", -222), (":TRIG:TIM 50US", -222), (":TRIG:COUN 4000", -222), (":INIT:CONT ON", -221),
                           (":UNIT FURLONG", -222), (":NONSENSE", -102), (":SENS 0.1 S", 103), (":AVER:COUN x", -104),
                           (":FETC:X?", -222), (":FETC:X? 3,4", -115)):
            host = Host()
            host.write(text)
            self.assertEqual(host.ask(":SYST:ERR?").split(",")[0], str(code), text)
        self.assertEqual(self.ask(":TRIG:TIM 122US;:TRIG:TIM?"), "0.000122 S")

    def test_nothing_can_be_asked_behind_the_identity(self):
        self.assertEqual(self.ask("*IDN?;*OPC?").split(",")[0], "Metrolab Technology SA")
        self.assertEqual(self.errors(), [-440])

    def test_zeroing_takes_six_seconds_and_lasts(self):
        self.field(5e-4, 0.0, 0.0)
        self.host.write(":CAL:INIT;*OPC?")
        self.assertIsNone(self.host.read(seconds=5.9))
        self.assertEqual(self.host.probe.bulk_in(IN, 100, 6.01)[12:14], b"1\n")
        self.host.now = 6.1
        self.assertEqual(self.ask(":MEAS:X? ,5"), "+0.000000 T")
        self.host.probe.power_cycle(self.host.now)
        self.host.tag = 0
        self.assertEqual(self.ask(":MEAS:X? ,5"), "+0.000000 T")
        self.ask(":CAL:ZERO;*OPC?", seconds=7.0)
        self.assertEqual(self.ask(":MEAS:X? ,5"), "+0.000500 T")

    def test_it_wakes_up_in_a_tenth_of_a_second(self):
        self.host.write(":SYST:SLEE;:READ?")
        self.assertIsNone(self.host.read(seconds=0.09))
        self.assertIsNotNone(self.host.probe.bulk_in(IN, 100, 0.11))


class LineTest(unittest.TestCase):
    QUERY = b"\x01\x01\xfe\x00\x05\x00\x00\x00\x01\x00\x00\x00*OPC?\x00\x00\x00"
    REQUEST = b"\x02\x02\xfd\x00\x00\x04\x00\x00\x00\x00\x00\x00"
    ANSWER = b"\x02\x02\xfd\x00\x02\x00\x00\x00\x01\x00\x00\x001\n\x00\x00"

    def test_messages_one_behind_the_other(self):
        line = UsbtmcLine(MetrolabThm1176())
        for byte in self.QUERY + self.REQUEST[:-1]:
            line.receive(bytes([byte]), 0.0)
            self.assertEqual(line.say(0.0), [])
        line.receive(self.REQUEST[-1:], 0.0)
        self.assertEqual(line.say(0.0), [(0.0, self.ANSWER)])

    def test_a_late_answer_has_a_time(self):
        line = UsbtmcLine(MetrolabThm1176(late=0.5))
        line.receive(self.QUERY + self.REQUEST, 0.0)
        self.assertEqual((line.say(0.4), line.next()), ([], 0.5))
        self.assertEqual(line.say(0.5), [(0.5, self.ANSWER)])

    def test_a_port_carries_whole_messages(self):
        with Served("metrolab_thm1176", "--tcp", "0") as served:
            host, port = served.where.split(":")
            with socket.create_connection((host, int(port)), PATIENCE) as link:
                link.sendall(self.QUERY + self.REQUEST)
                self.assertEqual(receive_exactly(link, len(self.ANSWER)), self.ANSWER)
                self.assertEqual(served.order(set={"field": [0.01, 0, 0]}), {"ok": True})
                text = b":MEAS:X? ,5\n"
                link.sendall(struct.pack("<BBBxIB3x", 1, 3, 0xFC, len(text), 1) + text + b"\x02\x04\xfb\x00" + self.REQUEST[4:])
                self.assertEqual(receive_exactly(link, 24)[12:], b"+0.010000 T\n")

    def test_a_socket_carries_transfers(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "usb")
            with Served("metrolab_thm1176", "--socket", path) as served, socket.socket(socket.AF_UNIX) as link:
                link.settimeout(PATIENCE)
                link.connect(path)
                read = b"R" + struct.pack("<BII", IN, 1024, 100)
                self.assertEqual(exchange(link, read), b"A" + struct.pack("<i", -110))
                self.assertEqual(exchange(link, b"B\x02" + self.QUERY), b"A" + struct.pack("<i", 20))
                self.assertEqual(exchange(link, b"B\x02" + self.REQUEST), b"A" + struct.pack("<i", 12))
                self.assertEqual(exchange(link, read), b"A" + struct.pack("<i", 16) + self.ANSWER)
                self.assertEqual(exchange(link, b"B\x02" + bytes(12)), b"A" + struct.pack("<i", -32))
                clear = b"C" + struct.pack("<BBHHH", 0x02, 1, 0, OUT, 0)
                self.assertEqual(exchange(link, clear), b"A" + struct.pack("<i", 0))
                slow = b":AVER:COUN 1360;:INIT;*OPC?\n"
                head = struct.pack("<BBBxIB3x", 1, 3, 0xFC, len(slow), 1)
                exchange(link, b"B\x02" + head + slow)
                exchange(link, b"B\x02\x02\x04\xfb\x00" + self.REQUEST[4:])
                patient = b"R" + struct.pack("<BII", IN, 1024, 10000)
                self.assertEqual(exchange(link, patient)[17:19], b"1\n")
                self.assertEqual(served.order(get="average"), {"average": 1360})

    def test_the_server_knows_it(self):
        self.assertIsInstance(serve.make("metrolab_thm1176", ["late=0.1"]), MetrolabThm1176)


if __name__ == "__main__":
    unittest.main()
