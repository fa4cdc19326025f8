"""The double of a GigE Vision camera: its packets against the layouts that Wireshark and Aravis know, its behaviour
against what its modules promise. try_aravis.py lets Aravis itself judge.

SPDX-License-Identifier: Apache-2.0
"""

import json
import pathlib
import re
import select
import socket
import struct
import subprocess
import sys
import unittest
import xml.etree.ElementTree as tree

from double import Refused
import gige_features as gf
import gige_scene as scene
import gige_serve
import gige_wire as wire
from gige_camera import GigeCamera

HOST, OTHER = ("127.0.0.9", 5000), ("127.0.0.9", 6000)
STREAM = ("127.0.0.9", 7000)


class Rig:
    """A camera and a host without a network between them."""

    def __init__(self, **options):
        self.camera, self.now, self.request = GigeCamera(**options), 0.0, 0

    def ask(self, number, payload=b"", peer=HOST, flags=wire.FLAG_ACK):
        """One command; returns (status, number, payload) of the answer, or None."""
        self.request = self.request % 65535 + 1
        self.camera.receive(wire.order(number, self.request, payload, flags), peer, self.now)
        answers = [each for each, _ in self.camera.say(self.now + self.camera.late)]
        if not answers:
            return None
        status, told, length, request = struct.unpack_from(">HHHH", answers[-1])
        assert (length, request) == (len(answers[-1]) - 8, self.request)
        return status, told, answers[-1][8:]

    def read(self, address, peer=HOST):
        """A register's value, or its status as a negative number."""
        status, _, payload = self.ask(wire.READ_REGISTER, struct.pack(">I", address), peer)
        return struct.unpack(">I", payload)[0] if status == 0 else -status

    def write(self, address, value, peer=HOST):
        """Writes a register; returns the status."""
        return self.ask(wire.WRITE_REGISTER, struct.pack(">II", address, value), peer)[0]

    def memory(self, address, count, peer=HOST):
        """Bytes of memory, or a status as a negative number."""
        status, _, payload = self.ask(wire.READ_MEMORY, struct.pack(">IHH", address, 0, count), peer)
        return payload[4:] if status == 0 else -status

    def place(self, name, slot=0):
        """A feature's address."""
        feature = self.camera.features_by_name[name]
        return feature, feature.address + slot * feature.size()

    def put(self, name, value, slot=0):
        """Writes a feature as Aravis does, through memory; returns the status."""
        feature, address = self.place(name, slot)
        if feature.entries and isinstance(value, str):
            value = feature.entries[value]
        data = struct.pack(">d", value) if feature.kind == "float" else int(value).to_bytes(feature.size(), "big")
        return self.ask(wire.WRITE_MEMORY, struct.pack(">I", address) + data)[0]

    def get(self, name, slot=0):
        """Reads a feature."""
        feature, address = self.place(name, slot)
        data = self.memory(address, feature.size())
        return struct.unpack(">d", data)[0] if feature.kind == "float" else int.from_bytes(data, "big")

    def control(self):
        """Takes control and opens the stream."""
        self.write(wire.CCP, wire.CCP_CONTROL)
        self.write(wire.SC_ADDRESS, 0x7F000009)
        self.write(wire.SC_PORT, STREAM[1])
        return self

    def manual(self, exposure=5000.0):
        """Control, and nothing automatic."""
        self.control()
        for name, value in (("ExposureAuto", "Off"), ("GainAuto", "Off"), ("Gamma", 1.0), ("ExposureTime", exposure)):
            assert self.put(name, value) == 0, name
        return self

    def run(self, until, step=0.25):
        """Lets time pass with a heartbeat; returns the stream's packets as bytes."""
        packets = []
        while self.now < until:
            self.now = min(self.now + step, until)
            packets += [b"".join(bytes(part) for part in parts) for parts, _ in self.camera.stream(self.now)]
            self.read(wire.CCP)
        return packets

    def told(self, name):
        """The history's values of that name."""
        return [value for _, told, value in self.camera.history if told == name]


def parted(packet):
    """(status, block, kind, packet id, rest) of a stream packet with short ids."""
    status, block, infos = struct.unpack_from(">HHI", packet)
    return status, block, infos >> 24, infos & 0xFFFFFF, packet[8:]


def blocks(packets):
    """block -> kind -> the packets' contents in order."""
    found = {}
    for packet in packets:
        _, block, kind, _, rest = parted(packet)
        found.setdefault(block, {}).setdefault(kind, []).append(rest)
    return found


def pictures(packets):
    """block -> the picture's bytes."""
    return {block: b"".join(kinds.get(wire.PAYLOAD, [])) for block, kinds in blocks(packets).items()}


class ControlTest(unittest.TestCase):
    def test_discovery_as_wireshark_reads_it(self):
        rig = Rig(address="127.0.0.2", serial="S1")
        status, number, data = rig.ask(wire.DISCOVERY, peer=OTHER)
        self.assertEqual((status, number, len(data)), (0, 3, 0xF8))
        self.assertEqual(data[:8].hex(), "0002000080000001")
        self.assertEqual(data[0x24:0x28], bytes([127, 0, 0, 2]))
        self.assertEqual(data[0x48:0x68], b"Vitreo Doubles".ljust(32, b"\0"))
        self.assertEqual(data[0xD8:0xE8], b"S1".ljust(16, b"\0"))

    def test_an_answer_byte_for_byte(self):
        camera = GigeCamera()
        camera.receive(bytes.fromhex("42010080 0004 1234 00000938"), HOST, 0.0)
        self.assertEqual(camera.say(0.0), [(bytes.fromhex("00000081 0004 1234 00000bb8"), HOST)])
        camera.receive(bytes.fromhex("42010080 0004 1235 00000939"), HOST, 0.0)
        self.assertEqual(camera.say(0.0), [(bytes.fromhex("80050081 0000 1235"), HOST)])

    def test_what_is_no_command_is_not_answered(self):
        camera = GigeCamera()
        for packet in ("", "4201", "00000080 0004 1234 00000938", "42010080 0008 1234 0938"):
            camera.receive(bytes.fromhex(packet), HOST, 0.0)
        self.assertEqual(camera.say(1.0), [])

    def test_statuses(self):
        rig = Rig()
        self.assertEqual(rig.ask(0x0100)[0], wire.NOT_IMPLEMENTED)
        self.assertEqual(rig.read(0x0A01), -wire.BAD_ALIGNMENT)
        self.assertEqual(rig.read(0x0500 + 0x7F000000), -wire.INVALID_ADDRESS)
        self.assertEqual(rig.memory(0x200, 510), -wire.BAD_ALIGNMENT)
        self.assertEqual(rig.write(wire.SC_PORT, 1), wire.ACCESS_DENIED)
        rig.control()
        self.assertEqual(rig.write(wire.VERSION, 1), wire.WRITE_PROTECT)
        self.assertEqual(rig.write(gf.XML_ADDRESS, 1), wire.WRITE_PROTECT)
        self.assertEqual(rig.put("PayloadSize", 1), wire.WRITE_PROTECT)
        self.assertEqual(rig.put("PixelFormat", 77), wire.INVALID_PARAMETER)

    def test_registers_together(self):
        rig = Rig().control()
        status, _, data = rig.ask(wire.READ_REGISTER, struct.pack(">II", wire.HEARTBEAT, wire.SC_PORT))
        self.assertEqual((status, data), (0, struct.pack(">II", 3000, 7000)))
        status, _, data = rig.ask(wire.WRITE_REGISTER, struct.pack(">IIII", wire.HEARTBEAT, 1000, wire.VERSION, 0))
        self.assertEqual((status, data), (wire.WRITE_PROTECT, bytes([0, 0, 0, 1])))
        self.assertEqual(rig.read(wire.HEARTBEAT), 1000)

    def test_the_url_leads_to_the_text(self):
        rig = Rig()
        scheme, name = rig.memory(wire.URL_FIRST, 512).split(b"\0")[0].decode().split(":")
        name, address, size = name.split(";")
        self.assertEqual(scheme, "Local")
        address, size = int(address, 16), int(size, 16)
        whole = b"".join(rig.memory(at, min(512, address + size - at)) for at in range(address, address + size, 512))
        tree.fromstring(whole)
        self.assertEqual(rig.memory(address + size, 4), -wire.INVALID_ADDRESS)

    def test_privilege_is_one_host_s_until_its_heartbeat_ends(self):
        rig = Rig()
        rig.write(wire.CCP, wire.CCP_CONTROL)
        self.assertEqual(rig.write(wire.CCP, wire.CCP_CONTROL, OTHER), wire.ACCESS_DENIED)
        self.assertEqual(rig.read(wire.CCP, OTHER), wire.CCP_CONTROL)
        rig.now = 2.9
        self.assertEqual(rig.read(wire.CCP, OTHER), 2)  # another's reading is no heartbeat
        rig.now = 3.1
        self.assertEqual(rig.read(wire.CCP, OTHER), 0)
        self.assertEqual(rig.write(wire.CCP, wire.CCP_EXCLUSIVE, OTHER), 0)
        self.assertEqual(rig.read(wire.CCP), -wire.ACCESS_DENIED)

    def test_a_heartbeat_keeps_the_privilege_and_its_end_stops_the_stream(self):
        rig = Rig().manual()
        rig.put("AcquisitionStart", 1)
        rig.run(8.0)
        self.assertEqual(rig.camera.controller, HOST)
        before = rig.camera.exposures
        list(rig.camera.stream(20.0))
        self.assertEqual((rig.camera.acquiring, rig.camera.heartbeats_lost), (False, 1))
        self.assertLess(rig.camera.exposures - before, 3.1 / 0.00505)
        self.assertEqual(rig.camera._word(wire.SC_PORT), 0)

    def test_a_repeated_request_is_not_carried_out_again(self):
        rig = Rig().manual()
        rig.put("TriggerMode", "On", 1)
        rig.put("AcquisitionStart", 1)
        _, address = rig.place("TriggerSoftware", 1)
        packet = wire.order(wire.WRITE_REGISTER, 999, struct.pack(">II", address, 1))
        for _ in range(3):
            rig.camera.receive(packet, HOST, 0.1)
        self.assertEqual(len(rig.camera.say(0.1)), 3)
        self.assertEqual((rig.camera.triggers_ignored, rig.camera.exposures), (0, 0 if rig.camera.triggers == 0 else 1))
        rig.camera.advance(0.2)
        self.assertEqual((rig.camera.triggers, rig.camera.triggers_ignored), (1, 0))

    def test_a_late_answer_is_announced(self):
        camera = GigeCamera(late=1.0, pending_after=0.2)
        camera.receive(wire.order(wire.READ_REGISTER, 7, struct.pack(">I", 0)), HOST, 0.0)
        self.assertEqual(camera.say(0.5), [(bytes.fromhex("00000089 0004 0007 0000 044c"), HOST)])
        self.assertEqual(camera.say(1.0)[0][0].hex(), "00000081000400070002" + "0000")

    def test_control_packets_may_be_lost_and_ask_again(self):
        rig = Rig(control_loss=0.3, seed=2)
        answers = [rig.ask(wire.READ_REGISTER, struct.pack(">I", wire.HEARTBEAT)) for _ in range(200)]
        self.assertAlmostEqual(sum(each is None for each in answers) / 200, 1 - 0.7 * 0.7, delta=0.1)

    def test_test_packets_have_the_size_that_is_asked_for(self):
        rig = Rig(path_mtu=4000).control()
        for size, come in ((1400, 1), (3996, 1), (8192, 0)):
            rig.write(wire.SC_SIZE, wire.FIRE_TEST | wire.DO_NOT_FRAGMENT | size)
            packets = list(rig.camera.stream(rig.now))
            self.assertEqual(len(packets), come)
            for parts, peer in packets:
                self.assertEqual((sum(map(len, parts)), peer), (size - 28, STREAM))
            self.assertEqual(rig.read(wire.SC_SIZE), wire.DO_NOT_FRAGMENT | size)


class FeatureTest(unittest.TestCase):
    def test_the_text_names_only_what_there_is(self):
        for options in ({}, {"names": "old"}, {"color": True}):
            with self.subTest(options):
                camera = GigeCamera(**options)
                root = tree.fromstring(camera.xml)
                nodes = {each.get("Name") for each in root.iter()
                         if each.tag.split("}")[1] not in ("EnumEntry", "pVariable")}
                for each in root.iter():
                    tag = each.tag.split("}")[1]
                    if re.fullmatch("p[A-Z].*", tag):
                        self.assertIn(each.text, nodes, tag)
                names = {each.text for each in root.iter() if each.tag.endswith("}pFeature")}
                self.assertEqual("GainRaw" in names, camera.names == "old")
                self.assertEqual("TimestampLatch" in names, camera.names == "new")
                self.assertEqual("BalanceWhiteAuto" in names, camera.color)

    def test_limits_depend_on_each_other(self):
        rig = Rig().control()
        self.assertEqual(rig.put("OffsetX", 1), wire.INVALID_PARAMETER)
        self.assertEqual(rig.put("Width", 320), 0)
        self.assertEqual(rig.put("OffsetX", 321), wire.INVALID_PARAMETER)
        self.assertEqual(rig.put("OffsetX", 320), 0)
        self.assertEqual(rig.put("Width", 324), wire.INVALID_PARAMETER)
        self.assertEqual(rig.put("Width", 318), wire.INVALID_PARAMETER)
        self.assertEqual((rig.get("Width"), rig.get("OffsetX"), rig.get("PayloadSize")), (320, 320, 320 * 480))

    def test_a_camera_that_clamps(self):
        rig = Rig(out_of_range="clamp").control()
        self.assertEqual((rig.put("Width", 321), rig.get("Width")), (0, 320))
        self.assertEqual((rig.put("OffsetX", 9999), rig.get("OffsetX")), (0, 320))

    def test_automatic_modes_are_on_at_power_up_and_lock(self):
        rig = Rig().control()
        self.assertEqual((rig.get("ExposureAuto"), rig.get("GainAuto")), (2, 2))
        self.assertEqual(rig.put("ExposureTime", 1000.0), wire.WRITE_PROTECT)
        rig.put("ExposureAuto", "Off")
        self.assertEqual(rig.put("ExposureTime", 1000.4), 0)
        self.assertEqual(rig.get("ExposureTime"), 1000.0)
        ignoring = Rig(locked_write="ignore").control()
        self.assertEqual((ignoring.put("Gain", 3.0), ignoring.get("Gain")), (0, 0.0))

    def test_automatic_exposure_never_rests(self):
        rig = Rig().control()
        rig.put("AcquisitionStart", 1)
        rig.run(1.0)
        times = [each["exposure_us"] for each in rig.told("frame")]
        self.assertEqual(times[0], 5000.0)
        self.assertAlmostEqual(times[-1], 8000.0, delta=600)
        self.assertNotEqual(times[-1], times[-2])
        rig.put("ExposureAuto", "Off")
        rig.put("GainAuto", "Off")
        rig.run(2.0)
        times = [each["exposure_us"] for each in rig.told("frame")]
        self.assertEqual(len(set(times[-20:])), 1)

    def test_automatic_white_balance_moves_the_colours(self):
        rig = Rig(color=True).manual()
        self.assertEqual(rig.put("BalanceRatio", 2.0, 2), wire.WRITE_PROTECT)
        rig.put("AcquisitionStart", 1)
        rig.run(0.5)
        self.assertAlmostEqual(rig.get("BalanceRatio", 2), 2.0, delta=0.1)  # blue is half of green in the scene
        rig.put("BalanceWhiteAuto", "Off")
        self.assertEqual((rig.put("BalanceRatio", 1.5, 2), rig.get("BalanceRatio", 2)), (0, 1.5))
        self.assertNotIn("BalanceWhiteAuto", GigeCamera().features_by_name)

    def test_lines(self):
        rig = Rig().control()
        self.assertEqual(rig.put("LineMode", "Output", 0), wire.INVALID_PARAMETER)
        rig.put("LineSource", "UserOutput0", 1)
        rig.put("UserOutputValue", 1)
        self.assertEqual((rig.get("LineStatus", 1), rig.get("LineStatusAll")), (1, 2))
        rig.put("LineInverter", 1, 1)
        rig.camera.line(True, 0.0)
        self.assertEqual(rig.get("LineStatusAll"), 1)

    def test_once_ends_by_itself(self):
        rig = Rig().control()
        rig.put("ExposureAuto", "Once")
        rig.put("AcquisitionStart", 1)
        rig.run(1.0)
        self.assertEqual(rig.get("ExposureAuto"), 0)

    def test_what_is_fixed_while_it_acquires(self):
        rig = Rig().manual()
        rig.put("AcquisitionStart", 1)
        for name, value in (("Width", 320), ("PixelFormat", "Mono12"), ("ChunkModeActive", 1), ("UserSetLoad", 1)):
            self.assertEqual(rig.put(name, value), wire.WRITE_PROTECT, name)
        self.assertEqual(rig.write(wire.SC_SIZE, 8192), wire.WRITE_PROTECT)
        self.assertEqual(rig.put("ExposureTime", 900.0), 0)

    def test_user_sets(self):
        rig = Rig().manual(777.0)
        rig.put("UserSetSelector", "Default")
        self.assertEqual(rig.put("UserSetSave", 1), wire.WRITE_PROTECT)
        rig.put("UserSetSelector", "UserSet1")
        rig.put("UserSetSave", 1)
        rig.put("UserSetSelector", "Default")
        rig.put("UserSetLoad", 1)
        self.assertEqual((rig.get("ExposureAuto"), rig.get("Gamma")), (2, 0.8))
        rig.put("UserSetSelector", "UserSet1")
        rig.put("UserSetLoad", 1)
        self.assertEqual((rig.get("ExposureAuto"), rig.get("ExposureTime")), (0, 777.0))

    def test_old_names_are_the_same_settings(self):
        rig = Rig(names="old").manual()
        self.assertEqual(rig.put("GainRaw", 105), 0)
        self.assertEqual((rig.get("Gain"), rig.get("GainRaw")), (10.5, 105))
        rig.put("ExposureTimeAbs", 2500.0)
        self.assertEqual(rig.get("ExposureTime"), 2500.0)
        self.assertEqual(rig.put("GainRaw", 241), wire.INVALID_PARAMETER)

    def test_options_that_are_none(self):
        with self.assertRaises(Refused):
            GigeCamera(jitter="sometimes")
        camera = GigeCamera()
        with self.assertRaises(Refused):
            camera.mode(resend="never")
        self.assertEqual(camera.resend, "works")
        for name in ("names", "drift_ppm", "sensor_width"):
            with self.assertRaisesRegex(Refused, name):
                camera.mode(**{name: getattr(camera, name)})


class ClockTest(unittest.TestCase):
    def test_latch(self):
        rig = Rig(drift_ppm=50.0, clock_offset=2.0).control()
        self.assertEqual((rig.read(wire.TICKS_HIGH), rig.read(wire.TICKS_LOW)), (0, 125_000_000))
        rig.now = 100.0
        rig.control()
        rig.write(wire.TIME_CONTROL, wire.TIME_LATCH)
        rig.now = 101.0
        ticks = rig.read(wire.TIME_HIGH) << 32 | rig.read(wire.TIME_LOW)
        self.assertAlmostEqual(ticks / 125e6, 102.005, places=7)
        self.assertEqual(rig.get("TimestampTicks") if rig.place("TimestampTicks")[1] > 0xFFF else ticks, ticks)
        rig.write(wire.TIME_CONTROL, wire.TIME_RESET)
        rig.write(wire.TIME_CONTROL, wire.TIME_LATCH)
        self.assertEqual(rig.read(wire.TIME_LOW), 0)

    def test_no_clock(self):
        rig = Rig(tick_frequency=0).manual()
        rig.put("AcquisitionStart", 1)
        packets = rig.run(0.1)
        self.assertEqual(rig.read(wire.TICKS_LOW), 0)
        self.assertEqual(blocks(packets)[1][wire.LEADER][0][4:12], bytes(8))

    def test_stamps_are_of_the_start_or_of_what_the_option_says(self):
        for option, late in (("start", 0.0), ("end", 0.005), ("readout", 0.0098)):
            rig = Rig(stamp_at=option, tick_frequency=1_000_000_000, drift_ppm=-100.0).manual()
            rig.put("AcquisitionStart", 1)
            packets = rig.run(0.1)
            _, _, ticks = struct.unpack_from(">HHQ", blocks(packets)[1][wire.LEADER][0])
            start = rig.told("frame")[0]["start_ns"]
            self.assertAlmostEqual(ticks, (start + late * 1e9) * 0.9999, delta=2)

    def test_ptp_steps_the_clock(self):
        rig = Rig(ptp_error=2e-6).control()
        rig.camera.epoch = 1.7e9
        rig.put("PtpEnable", 1)
        rig.run(2.0)
        self.assertEqual((rig.get("PtpStatus"), rig.read(wire.TICKS_LOW)), (7, 1_000_000_000))
        rig.run(3.5)
        self.assertEqual((rig.get("PtpStatus"), rig.get("PtpOffsetFromMaster")), (8, 2000))
        self.assertAlmostEqual(rig.camera.clock(rig.now), 1.7e9 + 3.5 + 37.0, places=5)


class StreamTest(unittest.TestCase):
    def test_leader_payload_and_trailer_byte_for_byte(self):
        rig = Rig(ambient=0.0, strip=False, dot_period=0.0, lamp_side=0).manual()
        rig.put("Width", 8), rig.put("Height", 2), rig.put("OffsetX", 3), rig.put("OffsetY", 5)
        rig.put("AcquisitionMode", "SingleFrame")
        rig.put("AcquisitionStart", 1)
        packets = rig.run(1.0)
        ticks = rig.told("frame")[0]["ticks"]
        self.assertEqual(ticks, 125_000)  # a millisecond after the start
        self.assertEqual(packets, [
            bytes.fromhex("0000 0001 01000000" "0000 0001 000000000001e848 01080001"
                          "00000008 00000002 00000003 00000005 0000 0000"),
            bytes.fromhex("0000 0001 03000001") + bytes([4] * 16),
            bytes.fromhex("0000 0001 02000002 0000 0001 00000002"),
        ])
        self.assertFalse(rig.camera.acquiring)

    def test_packets_are_as_large_as_agreed(self):
        rig = Rig().manual()
        rig.write(wire.SC_SIZE, 8192)
        rig.put("AcquisitionMode", "SingleFrame")
        rig.put("AcquisitionStart", 1)
        sizes = [len(each) for each in rig.run(1.0)]
        self.assertEqual(sizes[1:-2], [8164] * 37)
        self.assertEqual(sum(sizes[1:-1]) - 8 * 38, 640 * 480)

    def test_block_ids_skip_zero(self):
        rig = Rig(first_block=65534).manual()
        rig.put("AcquisitionStart", 1)
        rig.run(0.1)
        self.assertEqual([each["block"] for each in rig.told("frame")][:4], [65534, 65535, 1, 2])

    def test_wide_ids(self):
        rig = Rig(wide_ids=True, first_block=1 << 33, strip=False).manual()
        rig.put("AcquisitionMode", "SingleFrame")
        rig.put("AcquisitionStart", 1)
        packet = rig.run(0.1)[1]
        self.assertEqual(packet[:20].hex(), "00000000" "83000000" "0000000200000000" "00000001")
        request = struct.pack(">HHIIQ", 0, 0, 1, 1, 1 << 33)
        rig.ask(wire.RESEND, request, ("127.0.0.9", 9), wire.FLAG_EXTENDED)
        parts, _ = next(iter(rig.camera.stream(rig.now)))
        self.assertEqual(parts[0].hex(), "01000000" "83000000" "0000000200000000" "00000001")

    def test_resend(self):
        rig = Rig(packet_loss=0.3, seed=3, resend_depth=4).manual()
        rig.put("AcquisitionMode", "SingleFrame")
        rig.put("AcquisitionStart", 1)
        packets = rig.run(1.0)
        total = rig.camera.packets_lost + rig.camera.packets_sent
        self.assertEqual(total, -(-640 * 480 // 1364) + 2)
        self.assertAlmostEqual(rig.camera.packets_lost / total, 0.3, delta=0.1)
        missing = sorted(set(range(total)) - {parted(each)[3] for each in packets})
        for number in missing:
            rig.ask(wire.RESEND, struct.pack(">HHII", 0, 1, number, number), ("127.0.0.9", 9), 0)
        again = [b"".join(map(bytes, parts)) for parts, _ in rig.camera.stream(rig.now)]
        self.assertEqual([parted(each)[3] for each in again], missing)
        self.assertEqual({parted(each)[0] for each in again}, {wire.PACKET_RESENT})
        whole = sorted(packets + again, key=lambda each: parted(each)[3])
        self.assertEqual(len(pictures(whole)[1]), 640 * 480)

    def test_a_resend_that_cannot_be(self):
        rig = Rig(resend_depth=1).manual()
        rig.put("AcquisitionStart", 1)
        rig.run(0.1)
        rig.put("AcquisitionStop", 1)
        rig.run(0.2)
        rig.ask(wire.RESEND, struct.pack(">HHII", 0, 1, 5, 9), ("127.0.0.9", 9), 0)
        self.assertEqual([b"".join(parts).hex() for parts, _ in rig.camera.stream(rig.now)], ["800c000103000005"])
        rig.camera.mode(resend="silent")
        rig.ask(wire.RESEND, struct.pack(">HHII", 0, 1, 5, 9), ("127.0.0.9", 9), 0)
        self.assertEqual(list(rig.camera.stream(rig.now)), [])
        self.assertEqual(Rig(resend="absent").read(wire.CAPABILITY) & wire.CAN_RESEND, 0)

    def test_lost_frames_leave_a_gap(self):
        rig = Rig().manual()
        rig.camera.arrange(0.0, lose_frames=2)
        rig.put("AcquisitionStart", 1)
        packets = rig.run(0.05)
        self.assertEqual(min(blocks(packets)), 3)
        self.assertEqual([each["lost"] for each in rig.told("frame")][:3], [True, True, False])

    def test_reordered_and_doubled_packets(self):
        rig = Rig(reorder=0.2, duplicate=0.1).manual()
        rig.put("AcquisitionMode", "SingleFrame")
        rig.put("AcquisitionStart", 1)
        numbers = [parted(each)[3] for each in rig.run(1.0)]
        self.assertNotEqual(numbers, sorted(numbers))
        self.assertGreater(len(numbers), len(set(numbers)))
        self.assertEqual(set(numbers), set(range(228)))

    def test_arrival_jitter(self):
        for jitter, mean in (("uniform", 0.010), ("exponential", 0.002), ("mostly", 0.0011)):
            rig = Rig(jitter=jitter, jitter_time=0.002 if jitter == "exponential" else 0.02).manual()
            rig.put("Height", 4)
            rig.put("AcquisitionFrameRateEnable", 1), rig.put("AcquisitionFrameRate", 20.0)
            rig.put("AcquisitionStart", 1)
            rig.run(20.0, 0.001)
            ends = {each["block"]: each["end_ns"] for each in rig.told("frame")}
            delays = [each["due_ns"] - ends[each["block"]] - 40_000 for each in rig.told("sent")]
            self.assertGreater(len(delays), 390)
            self.assertGreaterEqual(min(delays), -1)
            self.assertAlmostEqual(sum(delays) / len(delays) * 1e-9, mean, delta=mean / 4)

    def test_a_link_takes_its_time(self):
        rig = Rig(link_rate=1e8).manual()
        rig.put("AcquisitionMode", "SingleFrame")
        rig.put("AcquisitionStart", 1)
        rig.run(1.0, 0.0005)
        sent = rig.told("sent")[0]
        self.assertAlmostEqual((sent["last_ns"] - sent["due_ns"]) * 1e-9, 228 * 1400 * 8 / 1e8, delta=0.001)

    def test_packet_delay_in_ticks(self):
        rig = Rig().manual()
        rig.put("Height", 22)  # 14080 bytes: 11 packets and two
        rig.write(wire.SC_DELAY, 125_000)  # a millisecond
        rig.put("AcquisitionMode", "SingleFrame")
        rig.put("AcquisitionStart", 1)
        rig.run(1.0, 0.0005)
        sent = rig.told("sent")[0]
        self.assertEqual(sent["packets"], 13)
        self.assertAlmostEqual((sent["last_ns"] - sent["due_ns"]) * 1e-9, 0.013, delta=0.001)

    def test_chunks(self):
        for option, kind, tail in (("image", 0x4001, 16), ("extended", 0x0005, 16), ("chunk", 0x0004, 8)):
            rig = Rig(chunk_payload=option).manual(3000.0)
            rig.put("ChunkModeActive", 1)
            for slot in (0, 1):
                rig.put("ChunkEnable", 1, slot)
            size = rig.get("PayloadSize")
            rig.put("AcquisitionMode", "SingleFrame")
            rig.put("AcquisitionStart", 1)
            found = blocks(rig.run(1.0))[1]
            payload = b"".join(found[wire.PAYLOAD])
            self.assertEqual(len(payload), size)
            self.assertEqual(struct.unpack_from(">HH", found[wire.LEADER][0]), (0, kind))
            self.assertEqual(len(found[wire.LEADER][0]), 12 if option == "chunk" else 36)
            end = found[wire.TRAILER][0]
            self.assertEqual((len(end), struct.unpack_from(">HH", end)), (tail, (0, kind)))
            read = {}
            while payload:
                number, length = struct.unpack(">II", payload[-8:])
                read[number] = payload[-8 - length:-8]
                payload = payload[:-8 - length]
            self.assertEqual(struct.unpack(">d", read[0xA02])[0], 3000.0)
            self.assertEqual(struct.unpack(">Q", read[0xA01])[0], rig.told("frame")[0]["ticks"])
            self.assertEqual(len(read[0xA00]), 640 * 480)


class TriggerTest(unittest.TestCase):
    def armed(self, source="Software", **options):
        rig = Rig(**options).manual()
        rig.put("TriggerMode", "On", 1)
        rig.put("TriggerSource", source, 1)
        rig.put("AcquisitionStart", 1)
        return rig

    def test_software(self):
        rig = self.armed()
        rig.run(1.0)
        self.assertEqual(rig.camera.exposures, 0)
        rig.put("TriggerSoftware", 1, 1)
        rig.put("TriggerSoftware", 1, 1)  # comes while it exposes
        rig.run(1.5)
        self.assertEqual((rig.camera.exposures, rig.camera.triggers_ignored), (1, 1))
        frame = rig.told("frame")[0]
        times = frame["start_ns"], frame["end_ns"]
        self.assertEqual((*times, frame["cause"]), (1_000_000_000, 1_005_000_000, "Software"))

    def test_delay_and_the_wrong_source(self):
        rig = self.armed("Line1")
        rig.put("TriggerDelay", 2000.0, 1)
        rig.put("TriggerSoftware", 1, 1)
        rig.camera.line(True, 0.1)
        rig.camera.line(False, 0.11)
        rig.run(1.0)
        self.assertEqual([each["start_ns"] for each in rig.told("frame")], [102_000_000])
        self.assertEqual(rig.told("trigger ignored"), ["source"])

    def test_activation(self):
        for activation, count in (("RisingEdge", 1), ("FallingEdge", 1), ("AnyEdge", 2)):
            rig = self.armed("Line1")
            rig.put("TriggerActivation", activation, 1)
            rig.camera.line(True, 0.1)
            rig.camera.line(False, 0.2)
            rig.run(1.0)
            self.assertEqual(rig.camera.exposures, count, activation)

    def test_a_forgotten_trigger_of_the_acquisition_stops_it(self):
        rig = Rig().manual()
        rig.put("TriggerMode", "On", 0)
        rig.put("AcquisitionStart", 1)
        rig.run(1.0)
        self.assertEqual(rig.camera.exposures, 0)
        rig.put("TriggerSoftware", 1, 0)
        rig.run(2.0)
        self.assertGreater(rig.camera.exposures, 100)

    def test_free_running_ends_when_the_trigger_is_switched_on(self):
        rig = Rig().manual()
        rig.put("AcquisitionStart", 1)
        rig.run(0.5)
        rig.put("TriggerMode", "On", 1)
        before = rig.camera.exposures
        rig.run(1.0)
        self.assertLessEqual(rig.camera.exposures - before, 1)
        rig.put("TriggerMode", "Off", 1)
        rig.run(1.5)
        self.assertGreater(rig.camera.exposures - before, 50)

    def test_rates_and_counts(self):
        rig = Rig().manual(1000.0)
        rig.put("AcquisitionFrameRateEnable", 1), rig.put("AcquisitionFrameRate", 40.0)
        rig.put("AcquisitionMode", "MultiFrame"), rig.put("AcquisitionFrameCount", 7)
        rig.put("AcquisitionStart", 1)
        rig.run(1.0)
        starts = [each["start_ns"] for each in rig.told("frame")]
        self.assertEqual(len(starts), 7)
        self.assertEqual({round((b - a) / 1e3) for a, b in zip(starts, starts[1:])}, {25_000})
        self.assertAlmostEqual(rig.get("AcquisitionFrameRateMax"), 1 / 0.0048)  # reading out takes longer than exposing
        self.assertEqual(rig.put("AcquisitionFrameRate", 250.0), wire.INVALID_PARAMETER)


class SceneTest(unittest.TestCase):
    def test_packings(self):
        values = [0x123, 0xABC, 0xFFF, 0x001]
        for kind, told in (("8", "12abff00"), ("12", "2301bc0aff0f0100"), ("16", "3012c0abf0ff1000"),
                           ("12packed", "12c3abff1f00"), ("12p", "23c1abff1f00"), ("10", "4800af02ff030000"),
                           ("10p", "48bcfa3f00")):
            self.assertEqual(scene.PACK[kind](values).hex(), told, kind)

    def view(self, name="Mono12", region=(0, 0, 16, 8), flips=(False, False), sensor=(64, 48)):
        return scene.View(sensor, region, name, flips)

    def picture(self, view, **look):
        settings = {"ambient": 50.0, "exposure": 0.01, "gain": 1.0, "black": 0.0, "gamma": 1.0, **look}
        image = scene.Painter().picture(view, scene.Look(**settings), None, None, None)
        words = struct.unpack(f"<{len(image) // 2}H", image)
        return [list(words[row * view.width:(row + 1) * view.width]) for row in range(view.height)]

    def test_ramps_stand_in_sensor_coordinates(self):
        rows = self.picture(self.view(region=(8, 4, 16, 4)))
        self.assertEqual(rows[0], [int(4096 * 0.5 * (x + 0.5) / 64) for x in range(8, 24)])
        self.assertEqual(rows[1], rows[0])
        self.assertEqual(rows[2], [int(4096 * 0.5 * 6.5 / 48)] * 16)
        self.assertEqual(rows[3], [int(4096 * 0.5 * 7.5 / 48)] * 16)

    def test_exposure_and_gain_are_light_and_full_scale_is_full_scale(self):
        once, twice = self.picture(self.view()), self.picture(self.view(), exposure=0.02)
        gained = self.picture(self.view(), gain=2.0)
        self.assertEqual(twice, gained)
        self.assertTrue(all(abs(b - 2 * a) <= 1 for a, b in zip(once[0], twice[0])))
        self.assertEqual(self.picture(self.view(), exposure=10.0)[0][-1], 4095)
        self.assertEqual(self.picture(self.view(), exposure=0.0, black=64.0)[0][0], 64)

    def test_flips(self):
        plain = self.picture(self.view(region=(0, 0, 64, 48)))
        flipped = self.picture(self.view(region=(0, 0, 64, 48), flips=(True, True)))
        self.assertEqual(flipped, [row[::-1] for row in plain[::-1]])

    def test_the_phase_of_the_filters_follows_odd_offsets(self):
        for x, y, phase in ((0, 0, "RGGB"), (1, 0, "GRBG"), (0, 1, "GBRG"), (1, 1, "BGGR")):
            view = self.view("BayerRG12", (x, y, 16, 8))
            self.assertEqual("".join(view.filter(view.columns[c], view.rows[r]) for r in (0, 1) for c in (0, 1)), phase)
            self.assertEqual(view.true_format(), "Bayer" + phase[:2] + "12")
        for name in ("BayerGR12", "BayerGB12", "BayerBG12", "BayerRG8"):
            self.assertEqual(self.view(name).true_format(), name)
        rows = self.picture(self.view("BayerGB12", (32, 2, 16, 2)))
        level = 4096 * 0.5 / 48
        for value, wanted in zip(rows[0][:2] + rows[1][:2], (2.5 * 0.6, 2.5 * 0.3, 3.5, 3.5 * 0.6)):  # G B, R G
            self.assertAlmostEqual(value, level * wanted, delta=1)
        rows = self.picture(self.view("BayerRG12", (33, 2, 16, 2)))
        level = 4096 * 0.5 * 2.5 / 48
        self.assertEqual(rows[0][:2], [int(level * 0.6), int(level)])

    def test_marks_land_where_they_belong_in_every_format(self):
        for name in ("Mono8", "Mono10p", "Mono12p", "Mono12Packed", "Mono16"):
            view = scene.View((640, 480), (101, 50, 320, 200), name)
            look = scene.Look(0.0, 0.01, 1.0, 0.0, 1.0)
            image = bytes(scene.Painter().picture(view, look, (203, 90, 30, 0.5), (301, 200), 0xA5A5F00D))
            expected = [[0] * 320 for _ in range(200)]
            for row in range(40, 70):
                expected[row][102:132] = [2048] * 30
            for row in range(150, 158):
                expected[row][200:208] = [4095] * 8
            for row in range(4):
                expected[row][:128] = [4095 if 0xA5A5F00D >> (31 - x // 4) & 1 else 0 for x in range(128)]
            self.assertEqual(image, b"".join(view.pack(row) for row in expected), name)

    def test_the_lamp_measures_overlap(self):
        lamp = scene.Lamp()
        lamp.switch(True, 1.0)
        lamp.switch(False, 1.5)
        lamp.flash(2.0, 0.25)
        self.assertAlmostEqual(lamp.overlap(1.2, 2.1), 0.4)
        lamp.switch(True, 3.0)
        self.assertAlmostEqual(lamp.overlap(2.9, 3.2), 0.2)


class BenchTest(unittest.TestCase):
    def bench(self, *wires, **options):
        rigs = [Rig(**options).manual(), Rig(drift_ppm=40.0, **options).manual()]
        bench = gige_serve.Bench([each.camera for each in rigs], 5_000_000_000)
        for text in wires:
            bench.wire(text)
        return bench, rigs

    def run_bench(self, bench, rigs, until):
        for step in range(1, round(until * 10) + 1):
            now = step / 10
            bench.advance(now)
            for rig in rigs:
                rig.now = now
                list(rig.camera.stream(now))
                rig.read(wire.CCP)

    def line1(self, rig):
        rig.put("TriggerMode", "On", 1)
        rig.put("TriggerSource", "Line1", 1)
        rig.put("AcquisitionStart", 1)

    def test_one_camera_triggers_the_other_only_when_its_output_says_so(self):
        for source, count in ((0, 0), (1, 20)):
            bench, rigs = self.bench("1:Line1=0:Line2")
            rigs[0].put("LineSource", source, 1)
            rigs[0].put("AcquisitionFrameRateEnable", 1), rigs[0].put("AcquisitionFrameRate", 20.0)
            self.line1(rigs[1])
            rigs[0].put("AcquisitionStart", 1)
            self.run_bench(bench, rigs, 1.0)
            self.assertEqual(rigs[1].camera.exposures, count)
            starts = [[each["start_ns"] for each in rig.told("frame")][:count] for rig in rigs]
            self.assertEqual(starts[1], starts[0][:len(starts[1])])

    def test_the_generator(self):
        bench, rigs = self.bench("0:Line1=clock", "1:Line1=clock")
        bench.clock = gige_serve.Clock(25.0, 0.0)
        for rig in rigs:
            self.line1(rig)
        self.run_bench(bench, rigs, 1.0)
        starts = [[each["start_ns"] for each in rig.told("frame")] for rig in rigs]
        self.assertEqual(starts[0], starts[1])
        self.assertEqual(starts[0][0], 5_020_000_000)
        self.assertEqual(len(starts[0]), 25)

    def test_commands(self):
        bench, rigs = self.bench()
        orders = gige_serve.BenchOrders(bench)

        def order(**command):
            return orders.obey(json.dumps(command), 0.5)

        self.assertEqual(order(now=True), {"now": 0.5, "monotonic_ns": 5_500_000_000})
        self.assertEqual(order(get="exposures", camera=1), {"exposures": 0})
        self.assertIn("error", order(get="exposures", camera=2))
        self.assertIn("error", order(wire="0:Line1=elsewhere"))
        self.assertIn("error", order(set={"acquired": 3}))
        self.assertEqual(order(set={"packet_loss": 0.1, "lose_frames": 3}, camera=1), {"ok": True})
        self.assertEqual((rigs[1].camera.packet_loss, rigs[0].camera.packet_loss), (0.1, 0.0))
        self.assertEqual(order(lamp=True), {"at_ns": 5_500_000_000})
        self.assertEqual(order(unplug=True, camera=1), {"ok": True})
        rigs[1].now = 0.6
        self.assertIsNone(rigs[1].ask(wire.READ_REGISTER, bytes(4)))
        self.assertEqual(order(plug=True, camera=1), {"link": "127.0.0.1"})
        self.assertIsNotNone(rigs[1].ask(wire.READ_REGISTER, bytes(4)))

    def test_power_cycle(self):
        rig = Rig(boot_time=1.0, clock_offset=7.0).manual()
        rig.put("AcquisitionStart", 1)
        rig.run(0.5)
        rig.camera.power_cycle(0.5)
        self.assertIsNone(rig.ask(wire.READ_REGISTER, bytes(4)))
        rig.now = 1.6
        self.assertEqual(rig.read(wire.CCP), 0)
        self.assertEqual((rig.camera.acquiring, rig.get("ExposureAuto")), (False, 2))
        self.assertAlmostEqual(rig.camera.clock(1.6), 8.1)

    def test_a_dead_client_holds_the_camera(self):
        rig = Rig()
        rig.camera.occupy(0.0, 2.0)
        self.assertEqual((rig.read(wire.CCP), rig.write(wire.CCP, 2)), (2, wire.ACCESS_DENIED))
        rig.now = 2.1
        self.assertEqual(rig.write(wire.CCP, 2), 0)


class ServerArgumentsTest(unittest.TestCase):
    def complaint(self, program, *arguments):
        here = pathlib.Path(gige_serve.__file__).parent
        done = subprocess.run([sys.executable, str(here / program), *arguments], stdin=subprocess.DEVNULL,
                              capture_output=True, text=True, timeout=20, check=False)
        self.assertEqual(done.returncode, 2)
        return done.stderr

    def test_what_is_wrong_is_named(self):
        self.assertIn("'focus'", self.complaint("gige_serve.py", "--camera", "127.77.19.6,focus=1"))
        self.assertIn("'x'", self.complaint("gige_serve.py", "--camera", "127.77.19.6", "--wire", "x"))
        self.assertIn("203.0.113.9", self.complaint("gige_serve.py", "--camera", "203.0.113.9"))
        self.assertIn("not four numbers", self.complaint("gige_serve.py", "--camera", "localhost"))
        self.assertIn("gige_serve.py", self.complaint("serve.py", "gige_camera", "--tcp", "0"))


class NetworkTest(unittest.TestCase):
    """The server, on an address that no other camera uses; it does not answer discovery here."""

    ADDRESS = "127.77.19.5"

    def test_over_sockets(self):
        here = pathlib.Path(gige_serve.__file__)
        server = subprocess.Popen([sys.executable, str(here), "--camera", f"{self.ADDRESS},discovery=0"],
                                  stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        host, stream = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        try:
            self.assertEqual(server.stdout.readline().strip(), self.ADDRESS)
            for each in (host, stream):
                each.bind(("127.0.0.1", 0))
                each.settimeout(10.0)
            values = ((wire.CCP, 2), (wire.SC_ADDRESS, 0x7F000001), (wire.SC_PORT, stream.getsockname()[1]))
            for request, (address, value) in enumerate(values, 1):
                host.sendto(wire.order(wire.WRITE_REGISTER, request, struct.pack(">II", address, value)),
                            (self.ADDRESS, wire.PORT))
                self.assertEqual(host.recvfrom(600)[0][:8], struct.pack(">HHHH", 0, 0x83, 4, request))
            start = GigeCamera().features_by_name["AcquisitionStart"].address
            host.sendto(wire.order(wire.WRITE_REGISTER, 9, struct.pack(">II", start, 1)), (self.ADDRESS, wire.PORT))
            packet, peer = stream.recvfrom(9000)
            self.assertEqual((parted(packet)[1:4], peer[0]), ((1, wire.LEADER, 0), self.ADDRESS))
            server.stdin.write('{"get": "exposures"}\n')
            server.stdin.flush()
            self.assertTrue(select.select([server.stdout], [], [], 10.0)[0])
            self.assertGreater(json.loads(server.stdout.readline())["exposures"], 0)
        finally:
            host.close()
            stream.close()
            server.stdin.close()
            server.wait(10)
            server.stdout.close()


if __name__ == "__main__":
    unittest.main()
