"""The adapter's requests as Linux' ftdi_sio.h writes them, and the relay behind RTS.

SPDX-License-Identifier: Apache-2.0
"""

import unittest

from double import Refused, STALL
from ftdi_adapter import FtdiAdapter

RTS_HIGH, RTS_LOW, DTR_HIGH = 0x0202, 0x0200, 0x0101  # FTDI_SIO_SET_RTS_HIGH ...


class Lines(unittest.TestCase):
    """RTS and DTR."""

    def test_each_is_set_by_its_own_mask(self):
        adapter = FtdiAdapter()
        self.assertEqual(adapter.control(0x40, 1, RTS_HIGH, 0, b"", 0.1), 0)
        self.assertEqual((adapter.rts, adapter.dtr), (1, 0))
        adapter.control(0x40, 1, DTR_HIGH, 0, b"", 0.2)
        adapter.control(0x40, 1, RTS_LOW, 0, b"", 0.3)
        self.assertEqual((adapter.rts, adapter.dtr), (0, 1))

    def test_the_relay_is_closed_by_edges_and_opens_after_pulse_and_release(self):
        adapter = FtdiAdapter(one_shot="0.07", relay_release="0.015")
        self.assertFalse(adapter.amplifiers)
        for beat in range(5):
            adapter.control(0x40, 1, RTS_HIGH, 0, b"", 0.02 * beat)
            adapter.control(0x40, 1, RTS_LOW, 0, b"", 0.02 * beat + 0.01)
        self.assertTrue(adapter.state(0.08 + 0.0849)["amplifiers"])
        self.assertFalse(adapter.state(0.08 + 0.0851)["amplifiers"])
        self.assertEqual(adapter.edges, 5)
        opened = [at for at, name, value in adapter.history if name == "amplifiers" and not value][-1]
        self.assertAlmostEqual(opened, 0.165)

    def test_a_level_holds_nothing(self):
        adapter = FtdiAdapter(one_shot=0.07)
        adapter.control(0x40, 1, RTS_HIGH, 0, b"", 0.0)
        adapter.control(0x40, 1, RTS_HIGH, 0, b"", 0.05)
        self.assertFalse(adapter.state(0.08)["amplifiers"])

    def test_with_an_on_delay_longer_than_the_pulse_one_edge_closes_nothing(self):
        adapter = FtdiAdapter(one_shot=0.07, relay_release=0.015, relay_operate=0.1)
        adapter.control(0x40, 1, RTS_HIGH, 0, b"", 0.0)
        self.assertFalse(any(adapter.state(0.01 * at)["amplifiers"] for at in range(30)))
        for beat in range(50):
            adapter.control(0x40, 1, RTS_LOW, 0, b"", 1.0 + 0.02 * beat)
            adapter.control(0x40, 1, RTS_HIGH, 0, b"", 1.01 + 0.02 * beat)
        told = [(round(at, 3), value) for at, name, value in adapter.history if name == "amplifiers"]
        adapter.advance(3.0)
        self.assertEqual(told, [(0.0, False), (1.11, True)])
        self.assertFalse(adapter.amplifiers)

    def test_the_other_line_does_not_matter(self):
        adapter = FtdiAdapter(one_shot=0.07, line="dtr")
        adapter.control(0x40, 1, RTS_HIGH, 0, b"", 0.0)
        self.assertFalse(adapter.amplifiers)
        adapter.control(0x40, 1, DTR_HIGH, 0, b"", 0.0)
        self.assertTrue(adapter.amplifiers)


class Bytes(unittest.TestCase):
    """An instrument at the pins."""

    def setUp(self):
        self.adapter = FtdiAdapter(instrument="kepco_bop")

    def test_a_packet_begins_with_two_status_bytes(self):
        self.adapter.bulk_out(b"*IDN?\n", 1.0)
        got = b""
        for at in range(40):
            packet = self.adapter.bulk_in(512, 1.0 + 0.02 * at)
            while packet:
                self.assertEqual(packet[:2], b"\xb1\x60")
                got, packet = got + packet[2:64], packet[64:]
        self.assertIn(b"KEPCO", got)

    def test_without_data_there_is_one_each_latency(self):
        self.assertEqual(self.adapter.bulk_in(64, 0.0), b"\xb1\x60")
        self.assertIsNone(self.adapter.bulk_in(64, 0.015))
        self.assertEqual(self.adapter.bulk_in(64, 0.0161), b"\xb1\x60")

    def test_the_instruments_state_is_told_and_set(self):
        self.adapter.arrange(0.0, load_ohm=2.0)
        self.assertEqual(self.adapter.state(0.0)["current"], 0)
        self.assertEqual(self.adapter.inner.load_ohm, 2.0)
        with self.assertRaises(Refused):
            self.adapter.arrange(0.0, nothing=1)

    def test_what_is_not_supported_stalls(self):
        self.assertEqual(self.adapter.control(0x40, 0x77, 0, 0, b"", 0.0), STALL)
        self.assertEqual(self.adapter.control(0xC0, 0x90, 0, 0, 2, 0.0), (STALL, b""))
        self.assertEqual(self.adapter.control(0xC0, 10, 0, 0, 1, 0.0), (1, b"\x10"))

    def test_an_instrument_that_there_is_not_is_refused(self):
        with self.assertRaises(Refused):
            FtdiAdapter(instrument="nothing_at_all")


if __name__ == "__main__":
    unittest.main()
