"""The VXI-11 and HiSLIP servers against calls as their specifications and two public clients have them.

SPDX-License-Identifier: Apache-2.0
"""

import json
import pathlib
import socket
import struct
import subprocess
import sys
import time
import unittest

import hislip as hs
from double import Refused
from lan_instrument import LanInstrument
from scpi_supply import ScpiSupply
from spacemouse import Spacemouse
from test_serve import PATIENCE, receive_exactly
from vxi11 import ASYNC, CORE, MOST, PMAP, Vxi11, opaque, uints

SERVER = pathlib.Path(__file__).resolve().parent / "lan_serve.py"
IDENTITY = b"VITREO DOUBLES,SUPPLY 30-5,0,1.0\n"
PORTS = {"core": 4001, "abort": 4002, "portmap": 111}


def record(xid, program, version, procedure, arguments=b"", rpc=2):
    """RFC 5531: a call without credentials, in one fragment."""
    body = uints(xid, 0, rpc, program, version, procedure, 0, 0, 0, 0) + arguments
    return uints(0x80000000 | len(body)) + body


class Rpc:
    """A client of the server without sockets."""

    def __init__(self, **options):
        self.double = ScpiSupply(measuring=0.0, **options)
        self.server = Vxi11(LanInstrument(self.double), PORTS)
        self.now, self.xid = 0.0, 0
        for channel, kind in (("a", "core"), ("b", "core"), ("x", "abort"), ("p", "portmap"), ("u", "datagram")):
            self.server.connected(channel, kind)

    def send(self, channel, program, procedure, arguments=b"", version=None):
        self.xid += 1
        version = (2 if program == PMAP else 1) if version is None else version
        data = record(self.xid, program, version, procedure, arguments)
        self.server.receive(channel, data[4:] if channel == "u" else data, self.now)

    def say(self, seconds=0.0):
        self.now += seconds
        return [(channel, data if channel == "u" else data[4:]) for channel, data in self.server.say(self.now)]

    def call(self, channel, program, procedure, arguments=b"", seconds=0.0, **more):
        """The body of an accepted reply, None when there is none yet."""
        self.send(channel, program, procedure, arguments, **more)
        told = self.say(seconds)
        if not told:
            return None
        ((back, reply),) = told
        assert back == channel
        assert struct.unpack(">6I", reply[:24]) == (self.xid, 1, 0, 0, 0, 0), reply
        return reply[24:]

    def link(self, channel="a", lock=0, timeout=0, name=b"inst0"):
        told = struct.unpack(">4I", self.call(channel, CORE, 10, uints(7, lock, timeout) + opaque(name)))
        return told

    def write(self, link, data, channel="a", flags=8, lock_timeout=0):
        return struct.unpack(">2I", self.call(channel, CORE, 11, uints(link, 1000, lock_timeout, flags) + opaque(data)))

    def read(self, link, channel="a", size=1000, timeout=1000, flags=0, letter=0, seconds=0.0):
        told = self.call(channel, CORE, 12, uints(link, size, timeout, 0, flags, letter), seconds)
        if told is None:
            return None
        error, reason, length = struct.unpack_from(">3I", told)
        return error, reason, told[12:12 + length]

    def generic(self, procedure, link, channel="a", flags=0, lock_timeout=0):
        return struct.unpack(">I", self.call(channel, CORE, procedure, uints(link, flags, lock_timeout, 1000))[:4])[0]


class Vxi11Test(unittest.TestCase):
    def test_the_bytes_of_a_query(self):
        double = ScpiSupply()
        server = Vxi11(LanInstrument(double), PORTS)
        server.connected(1, "core")
        server.receive(1, b"\x80\x00\x00\x40" + uints(1, 0, 2, 0x607AF, 1, 10, 0, 0, 0, 0, 9, 0, 0, 5) + b"inst0\0\0\0", 0.0)
        ((_, told),) = server.say(0.0)
        self.assertEqual(told, b"\x80\x00\x00\x28" + uints(1, 1, 0, 0, 0, 0, 0, 1, 4002, 1024))
        call = uints(2, 0, 2, 0x607AF, 1, 11, 0, 0, 0, 0, 1, 1000, 0, 8, 5) + b"*IDN?\0\0\0"
        server.receive(1, uints(0x80000000 | len(call)) + call, 0.0)
        self.assertEqual(server.say(0.0)[0][1][28:], uints(0, 5))
        call = uints(3, 0, 2, 0x607AF, 1, 12, 0, 0, 0, 0, 1, 100, 1000, 0, 0, 0)
        server.receive(1, uints(10) + call[:10] + uints(0x80000000 | len(call) - 10) + call[10:], 0.0)  # two fragments
        self.assertEqual(server.say(0.0)[0][1][28:], uints(0, 4, 33) + IDENTITY + b"\0\0\0")

    def test_the_port_mapper_by_tcp_and_udp(self):
        rpc = Rpc()
        for channel in ("p", "u"):
            self.assertEqual(rpc.call(channel, PMAP, 3, uints(CORE, 1, 6, 0)), uints(4001))
            self.assertEqual(rpc.call(channel, PMAP, 3, uints(CORE, 1, 17, 0)), uints(0))
            self.assertEqual(rpc.call(channel, PMAP, 3, uints(12345, 1, 6, 0)), uints(0))
            self.assertEqual(rpc.call(channel, PMAP, 0), b"")
        rows = rpc.call("p", PMAP, 4)
        self.assertIn(uints(1, CORE, 1, 6, 4001), rows)
        self.assertEqual(rows[-4:], uints(0))

    def test_errors_of_rpc(self):
        rpc = Rpc()
        for arguments, status in (((12345, 1), 1), ((CORE, 99), 3)):
            rpc.send("a", arguments[0], arguments[1])
            self.assertEqual(struct.unpack(">6I", rpc.say()[0][1][:24])[5], status)
        rpc.send("a", CORE, 10, version=2)
        self.assertEqual(struct.unpack(">8I", rpc.say()[0][1])[5:], (2, 1, 1))
        rpc.send("a", CORE, 10, uints(1))
        self.assertEqual(struct.unpack(">6I", rpc.say()[0][1])[5], 4)
        rpc.server.receive("a", record(9, CORE, 1, 0, rpc=3), 0.0)
        self.assertEqual(rpc.say()[0][1], uints(9, 1, 1, 0, 2, 2))

    def test_a_link_of_another_device_is_refused(self):
        rpc = Rpc()
        self.assertEqual(rpc.link(name=b"gpib0,5")[0], 3)
        self.assertEqual(rpc.link(), (0, 1, 4002, MOST))
        self.assertEqual(rpc.write(99, b"*IDN?")[0], 4)
        self.assertEqual((rpc.generic(23, 1), rpc.generic(23, 1)), (0, 4))

    def test_a_read_in_parts_says_why_it_ended(self):
        rpc = Rpc()
        link = rpc.link()[1]
        rpc.write(link, b"*ID", flags=0)
        self.assertEqual(rpc.write(link, b"N?"), (0, 2))
        self.assertEqual(rpc.read(link, size=6), (0, 1, b"VITREO"))
        self.assertEqual(rpc.read(link, flags=128, letter=ord(",")), (0, 2, b" DOUBLES,"))
        self.assertEqual(rpc.read(link), (0, 4, IDENTITY[15:]))
        self.assertEqual(rpc.write(link, b"x" * (MOST + 1)), (5, 0))

    def test_a_read_waits_and_gives_up(self):
        rpc = Rpc(late=0.5)
        link = rpc.link()[1]
        rpc.write(link, b"*OPC?")
        self.assertIsNone(rpc.read(link, timeout=2000, seconds=0.4))
        self.assertEqual(struct.unpack(">3I", rpc.say(0.2)[0][1][24:36]), (0, 4, 2))
        self.assertIsNone(rpc.read(link, timeout=300, seconds=0.2))
        self.assertAlmostEqual(rpc.server.next(), rpc.now + 0.1)
        self.assertEqual(rpc.say(0.2)[0][1][24:], uints(15, 0, 0))

    def test_calls_behind_a_read_wait_their_turn(self):
        rpc = Rpc(late=0.5)
        link = rpc.link()[1]
        rpc.write(link, b"*OPC?")
        rpc.send("a", CORE, 12, uints(link, 10, 1000, 0, 0, 0))
        rpc.send("a", CORE, 13, uints(link, 0, 0, 0))
        self.assertEqual(rpc.say(0.4), [])
        self.assertEqual([reply[:4] for _, reply in rpc.say(0.2)], [uints(rpc.xid - 1), uints(rpc.xid)])

    def test_an_abort_ends_a_read(self):
        rpc = Rpc()
        link = rpc.link()[1]
        self.assertIsNone(rpc.read(link, timeout=60000))
        rpc.send("x", ASYNC, 1, uints(link))
        told = dict(rpc.say())
        self.assertEqual((told["a"][24:], told["x"][24:]), (uints(23, 0, 0), uints(0)))

    def test_locks(self):
        rpc = Rpc()
        one, two = rpc.link("a")[1], rpc.link("b")[1]
        self.assertEqual(struct.unpack(">I", rpc.call("a", CORE, 18, uints(one, 0, 0)))[0], 0)
        self.assertEqual(rpc.write(two, b"OUTP ON", channel="b")[0], 11)
        self.assertFalse(rpc.double.output)
        self.assertIsNone(rpc.call("b", CORE, 11, uints(two, 1000, 500, 9) + opaque(b"OUTP ON"), seconds=0.3))
        self.assertIsNone(rpc.call("b", CORE, 19, uints(two)))  # behind the one that waits
        rpc.send("a", CORE, 19, uints(one))
        told = dict(rpc.say())
        self.assertEqual(told["a"][24:], uints(0))
        rest = rpc.say(0.01)
        self.assertTrue(rpc.double.output)
        self.assertEqual(rest[-1][1][24:] if rest else told["b"][24:], uints(12))  # and only then: no lock held
        rpc.call("a", CORE, 18, uints(one, 0, 0))
        rpc.server.closed("a")
        self.assertEqual(rpc.write(two, b"OUTP OFF", channel="b"), (0, 8))  # a connection that is gone has no lock

    def test_a_link_that_wants_the_lock_at_once(self):
        rpc = Rpc()
        rpc.link("a", lock=1)
        self.assertEqual(rpc.link("b", lock=1)[0], 11)
        self.assertIsNone(rpc.call("b", CORE, 10, uints(1, 1, 400) + opaque(b"inst0"), seconds=0.3))
        self.assertEqual(rpc.say(0.2)[0][1][24:28], uints(11))

    def test_status_clear_trigger_and_what_is_not_there(self):
        rpc = Rpc()
        link = rpc.link()[1]
        rpc.write(link, b"*IDN?")
        self.assertEqual(rpc.call("a", CORE, 13, uints(link, 0, 0, 0)), uints(0, 16))
        self.assertEqual(rpc.generic(15, link), 0)
        self.assertEqual(rpc.call("a", CORE, 13, uints(link, 0, 0, 0)), uints(0, 0))
        self.assertEqual([rpc.generic(each, link) for each in (14, 16, 17)], [0, 0, 0])
        self.assertEqual(rpc.double.errors, [-211])
        self.assertEqual(rpc.call("a", CORE, 22, uints(link, 0, 0, 0, 0, 0, 0, 0)), uints(8, 0))
        self.assertEqual(rpc.call("a", CORE, 25, uints(1, 2, 3, 4, 5)), uints(8))

    def test_only_text_instruments(self):
        with self.assertRaises(Refused):
            LanInstrument(Spacemouse())


class Client:
    """A HiSLIP client of the server without sockets."""

    def __init__(self, server, name="1"):
        self.server, self.sync, self.other = server, name + "s", name + "a"
        self.number, self.now = 0xFFFFFF00, 0.0
        server.connected(self.sync, "hislip")
        told, *_ = self.send(self.sync, 0, 0, 0x01007878, b"hislip0")
        assert told[0] == self.sync
        self.start = told
        server.connected(self.other, "hislip")
        self.second = self.send(self.other, hs.ASYNC_INITIALIZE, 0, told[3] & 0xFFFF) if told[1] == 1 else None

    def parse(self, told):
        messages = []
        for channel, data in told:
            while data:
                mark, kind, control, parameter, length = hs.HEADER.unpack_from(data)
                assert mark == b"HS"
                messages.append((channel, kind, control, parameter, data[16:16 + length]))
                data = data[16 + length:]
            if data is None:
                messages.append((channel, None, 0, 0, b""))
        return messages

    def send(self, channel, kind, control=0, parameter=0, payload=b"", seconds=0.0):
        self.server.receive(channel, hs.HEADER.pack(b"HS", kind, control, parameter, len(payload)) + payload, self.now)
        self.now += seconds
        return self.parse(self.server.say(self.now))

    def write(self, text, delivered=0, kind=hs.DATA_END, seconds=0.0):
        number, self.number = self.number, self.number + 2 & 0xFFFFFFFF
        return self.send(self.sync, kind, delivered, number, text, seconds)


class HislipTest(unittest.TestCase):
    def setUp(self):
        self.double = ScpiSupply(measuring=0.0)
        self.server = hs.Hislip(LanInstrument(self.double))
        self.client = Client(self.server)

    def test_the_first_bytes(self):
        server = hs.Hislip(LanInstrument(ScpiSupply()))
        server.connected(1, "hislip")
        server.receive(1, b"HS\x00\x00\x01\x00xx\x00\x00\x00\x00\x00\x00\x00\x07hislip0", 0.0)
        self.assertEqual(server.say(0.0), [(1, b"HS\x01\x00\x01\x00\x00\x01" + bytes(8))])
        server.connected(2, "hislip")
        server.receive(2, b"HS\x11\x00\x00\x00\x00\x01" + bytes(8), 0.0)
        self.assertEqual(server.say(0.0), [(2, b"HS\x12\x00\x00\x00VD" + bytes(8))])
        server.receive(1, b"HS\x07\x00\xff\xff\xff\x00\x00\x00\x00\x00\x00\x00\x00\x06*IDN?\n", 0.0)
        self.assertEqual(server.say(0.0), [(1, b"HS\x07\x00\xff\xff\xff\x00" + b"\0" * 7 + b"\x21" + IDENTITY)])

    def test_a_query_in_parts_is_answered_with_the_number_of_its_end(self):
        self.assertEqual(self.client.write(b"*ID", kind=hs.DATA), [])
        self.assertEqual(self.client.write(b"N?\n"), [("1s", hs.DATA_END, 0, 0xFFFFFF02, IDENTITY)])

    def test_an_answer_is_cut_to_what_the_client_takes(self):
        told = self.client.send("1a", hs.MOST_SIZE, 0, 0, struct.pack(">Q", 26))
        self.assertEqual(told, [("1a", hs.MOST_SIZE_RESPONSE, 0, 0, struct.pack(">Q", hs.MOST))])
        parts = self.client.write(b"*IDN?\n")
        self.assertEqual([each[1] for each in parts], [hs.DATA] * 3 + [hs.DATA_END])
        self.assertEqual(b"".join(each[4] for each in parts), IDENTITY)

    def test_a_message_before_the_answer_was_taken_interrupts(self):
        self.client.write(b"*IDN?\n")
        told = self.client.write(b"*OPC?\n", delivered=0)
        self.assertEqual([(each[0], each[1], each[3]) for each in told[:2]],
                         [("1s", hs.INTERRUPTED, 0xFFFFFF02), ("1a", hs.ASYNC_INTERRUPTED, 0xFFFFFF02)])
        self.assertEqual(told[2][4], b"1\n")
        self.assertEqual(self.double.errors, [-410])
        self.assertEqual(self.client.write(b"*OPC?\n", delivered=1), [("1s", hs.DATA_END, 0, 0xFFFFFF04, b"1\n")])

    def test_the_status_byte_and_its_mav(self):
        self.client.write(b"*IDN?\n")
        self.assertEqual(self.client.send("1a", hs.STATUS_QUERY, 0, 0), [("1a", hs.STATUS_RESPONSE, 16, 0, b"")])
        self.assertEqual(self.client.send("1a", hs.STATUS_QUERY, 1, 0), [("1a", hs.STATUS_RESPONSE, 0, 0, b"")])
        self.assertEqual(len(self.client.write(b"*OPC?\n")), 1)  # delivered was told with the status query

    def test_a_service_request_comes_by_itself(self):
        told = self.client.write(b"*CLS;*ESE 32;*SRE 32;FOO\n")
        self.assertEqual(told, [("1a", hs.SERVICE_REQUEST, 4 + 32 + 64, 0, b"")])
        self.assertEqual(self.client.write(b"FOO\n"), [])

    def test_a_device_clear(self):
        self.client.write(b"*IDN?\n")
        self.assertEqual(self.client.send("1a", hs.ASYNC_CLEAR), [("1a", hs.ASYNC_CLEAR_ACKNOWLEDGE, 0, 0, b"")])
        self.assertEqual(self.client.write(b"OUTP ON\n"), [])
        self.assertFalse(self.double.output)
        self.assertEqual(self.client.send("1s", hs.CLEAR_COMPLETE), [("1s", hs.CLEAR_ACKNOWLEDGE, 0, 0, b"")])
        self.assertEqual(len(self.client.write(b"*OPC?\n")), 1)
        self.assertEqual(self.double.errors, [])

    def test_locks_of_two_clients(self):
        second = Client(self.server, "2")
        self.assertEqual(self.client.send("1a", hs.LOCK, 1, 1000)[0][2], 1)
        self.assertEqual(second.send("2a", hs.LOCK, 1, 300, seconds=0.2), [])
        self.assertEqual(second.send("2a", hs.LOCK_INFO)[0][2:4], (1, 1))
        self.assertEqual(second.write(b"OUTP ON\n")[0][1], hs.ERROR)
        self.assertFalse(self.double.output)
        second.now = 0.31
        self.assertEqual(second.send("2a", hs.REMOTE, 2)[-1][1:3], (hs.LOCK_RESPONSE, 0))  # the time is over
        second.send("2a", hs.LOCK, 1, 60000)
        told = self.client.send("1a", hs.LOCK, 0)
        self.assertEqual([(each[0], each[2]) for each in told], [("1a", 1), ("2a", 1)])
        self.assertEqual(self.client.send("1a", hs.LOCK, 0)[0][2], 3)

    def test_fatal_and_other_errors(self):
        self.server.receive("1s", b"XX" + bytes(14), 0.0)
        self.assertEqual([each[1:3] for each in self.client.parse(self.server.say(0.0))][:2], [(hs.FATAL, 1), (None, 0)])
        server = hs.Hislip(LanInstrument(ScpiSupply()), clients=1)
        server.connected("s", "hislip")
        server.receive("s", hs.HEADER.pack(b"HS", 0, 0, 0x01000000, 0), 0.0)
        server.say(0.0)
        server.receive("s", hs.HEADER.pack(b"HS", hs.DATA_END, 0, 0, 0), 0.0)
        self.assertEqual(server.say(0.0)[0][1][2:4], bytes([hs.FATAL, hs.NOT_BOTH]))
        first = Client(server, "1")
        self.assertEqual(first.send("1s", 99)[0][1:3], (hs.ERROR, hs.BAD_TYPE))
        self.assertEqual(first.send("1a", hs.REMOTE, 9)[0][1:3], (hs.ERROR, hs.BAD_CONTROL))
        self.assertEqual(Client(server, "2").start[1:3], (hs.FATAL, hs.TOO_MANY))
        server.connected("q", "hislip")
        server.receive("q", hs.HEADER.pack(b"HS", hs.ASYNC_INITIALIZE, 0, 77, 0), 0.0)
        self.assertEqual(server.say(0.0)[0][1][2:4], bytes([hs.FATAL, hs.WRONG_START]))

    def test_a_channel_that_is_gone_takes_the_other_along(self):
        self.server.closed("1s")
        self.assertEqual(self.server.say(0.0), [("1a", None)])
        self.assertEqual(self.server.sessions, {})

    def test_a_stale_answer_has_another_number(self):
        server = hs.Hislip(LanInstrument(ScpiSupply(pieces=3, gap=0.1, late=0.1)), chatty=True)
        client = Client(server)
        self.assertEqual(client.write(b"*OPC?\n", seconds=0.05), [])
        client.now = 5.0
        told = client.parse(server.say(5.0))
        self.assertEqual([(each[1], each[3], each[4]) for each in told],
                         [(hs.DATA_END, 0xFFFFFEFE, b"stale\n"), (hs.DATA_END, 0xFFFFFF00, b"1\n")])


class Served:
    """A running server."""

    def __init__(self, *arguments):
        self.process = subprocess.Popen([sys.executable, str(SERVER), *arguments], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)
        line = self.process.stdout.readline().split()
        self.ports = {each.split("=")[0]: int(each.rsplit(":", 1)[1]) for each in line}

    def order(self, **order):
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.stdout.close()
        self.code = self.process.wait(PATIENCE)


def call(link, data):
    link.sendall(data)
    (size,) = struct.unpack(">I", receive_exactly(link, 4))
    return receive_exactly(link, size & 0x7FFFFFFF)[24:]


class ServedTest(unittest.TestCase):
    def test_vxi11_on_sockets(self):
        with Served("scpi_supply", "--vxi11", "0", "--portmap", "0") as served:
            ask = record(1, PMAP, 2, 3, uints(CORE, 1, 6, 0))
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
                link.settimeout(PATIENCE)
                link.sendto(ask[4:], ("127.0.0.1", served.ports["portmap"]))
                self.assertEqual(link.recv(100)[24:], uints(served.ports["core"]))
            with socket.create_connection(("127.0.0.1", served.ports["portmap"]), PATIENCE) as link:
                self.assertEqual(call(link, ask), uints(served.ports["core"]))
            with socket.create_connection(("127.0.0.1", served.ports["core"]), PATIENCE) as link:
                told = call(link, record(2, CORE, 1, 10, uints(1, 0, 0) + opaque(b"inst0")))
                error, number, abort, _ = struct.unpack(">4I", told)
                self.assertEqual((error, abort), (0, served.ports["abort"]))
                text = b"VOLT 5;CURR 1;OUTP ON;:MEAS:VOLT?"
                told = call(link, record(3, CORE, 1, 11, uints(number, 1000, 0, 8) + opaque(text)))
                self.assertEqual(told, uints(0, len(text)))
                told = call(link, record(4, CORE, 1, 12, uints(number, 100, 5000, 0, 0, 0)))
                self.assertEqual(struct.unpack_from(">2I", told), (0, 4))
                begun = time.monotonic()
                told = call(link, record(5, CORE, 1, 12, uints(number, 100, 200, 0, 0, 0)))
                self.assertEqual(struct.unpack_from(">I", told), (15,))
                self.assertGreaterEqual(time.monotonic() - begun, 0.2)
                self.assertEqual(served.order(get="output"), {"output": True})
                self.assertEqual(served.order(unplug=True), {"ok": True})
                self.assertEqual(link.recv(1), b"")
            served.order(plug=True)
            socket.create_connection(("127.0.0.1", served.ports["core"]), PATIENCE).close()
        self.assertEqual(served.code, 0)

    def test_hislip_on_sockets(self):
        with Served("scpi_supply", "--hislip", "0") as served:
            where = ("127.0.0.1", served.ports["hislip"])
            with socket.create_connection(where, PATIENCE) as sync, socket.create_connection(where, PATIENCE) as other:
                sync.sendall(hs.HEADER.pack(b"HS", 0, 0, 0x01007878, 7) + b"hislip0")
                session = hs.HEADER.unpack(receive_exactly(sync, 16))[3] & 0xFFFF
                other.sendall(hs.HEADER.pack(b"HS", hs.ASYNC_INITIALIZE, 0, session, 0))
                self.assertEqual(hs.HEADER.unpack(receive_exactly(other, 16))[1], hs.ASYNC_INITIALIZE_RESPONSE)
                sync.sendall(hs.HEADER.pack(b"HS", hs.DATA_END, 0, 0xFFFFFF00, 6) + b"*IDN?\n")
                self.assertEqual(hs.HEADER.unpack(receive_exactly(sync, 16))[1:], (hs.DATA_END, 0, 0xFFFFFF00, len(IDENTITY)))
                self.assertEqual(receive_exactly(sync, len(IDENTITY)), IDENTITY)
                sync.sendall(b"garbage, garbage")
                self.assertEqual(hs.HEADER.unpack(receive_exactly(sync, 16))[1], hs.FATAL)
                self.assertEqual((receive_exactly(sync, 5), sync.recv(1), other.recv(1)), (b"fatal", b"", b""))

    def test_an_instrument_without_text_is_refused(self):
        done = subprocess.run([sys.executable, str(SERVER), "spacemouse", "--hislip", "0"], capture_output=True, text=True,
                              stdin=subprocess.DEVNULL, timeout=PATIENCE)
        self.assertEqual(done.returncode, 2)
        self.assertNotIn("Traceback", done.stderr)


if __name__ == "__main__":
    unittest.main()
