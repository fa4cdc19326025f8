"""A double as a device on a USB bus: its descriptors, the requests that every device knows, its transfers.

From USB 2.0 chapter 9, HID 1.11 chapter 6, and, of a serial adapter, Linux' ftdi_sio.h.
SPDX-License-Identifier: Apache-2.0
"""

import struct

from double import HidDouble, STALL

INTERRUPT_TYPE, BULK_TYPE = 3, 2  # USB 9.6.6: bmAttributes
HID_IN, HID_OUT = 0x81, 0x01


class UsbDevice:
    """One double; what carries the packets of the bus asks here for the answers."""

    def __init__(self, double, described=b""):
        self.double, self.described = double, described
        self.hid = isinstance(double, HidDouble)
        self.bulk = hasattr(type(double), "bulk_in")
        self.own = hasattr(type(double), "configuration")  # it tells its whole configuration itself
        self.ends = {}  # address: type
        if self.hid:
            self.ends = {HID_IN: INTERRUPT_TYPE, HID_OUT: INTERRUPT_TYPE}
        elif self.bulk and not self.own:
            self.ends = {double.BULK_IN: BULK_TYPE, double.BULK_OUT: BULK_TYPE}
        self.interface = 3 if self.hid else 0xFF  # bInterfaceClass: HID, or the vendor's own
        self.firmware = getattr(double, "firmware", 0x0100)

    def transfer(self, kind, request, value, index, length, sent, now):
        """A control transfer: (bytes moved or negative errno, data of an IN transfer)."""
        if kind & 0x60 == 0x40 or self.own and kind & 0x60 == 0x20:  # the maker's own, or the class'
            if kind & 0x80:
                return self.double.control(kind, request, value, index, length, now)
            return self.double.control(kind, request, value, index, sent, now), b""
        if request == 6 and kind & 0x80:  # GET_DESCRIPTOR
            found = self._descriptor(value >> 8, value & 0xFF)
            return (STALL, b"") if found is None else (min(len(found), length), found[:length])
        if kind == 0x80 and request == 0:  # GET_STATUS: powered by itself
            return 2, b"\x01\x00"
        if kind == 0x21 and self.hid and request in (0x0A, 0x0B):  # SET_IDLE, SET_PROTOCOL
            return 0, b""
        if kind in (0x00, 0x01, 0x02) and request in (1, 3):  # CLEAR_FEATURE, SET_FEATURE
            return 0, b""
        if (kind, request) in ((0x00, 9), (0x01, 11)):  # SET_CONFIGURATION, SET_INTERFACE
            return 0, b""
        return STALL, b""

    def _descriptor(self, kind, number):
        if kind == 1:
            return struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0, 0, 0, 64, self.double.VENDOR, self.double.PRODUCT,
                               self.firmware, 1, 2, 3, 1)
        if kind == 2 and self.own:
            return self.double.configuration
        if kind == 2:
            rest = struct.pack("<BBBBBBBBB", 9, 4, 0, 0, len(self.ends), self.interface, 0, 0, 0)
            if self.hid:
                rest += struct.pack("<BBHBBBH", 9, 0x21, 0x0111, 0, 1, 0x22, len(self.described))
            for address, how in self.ends.items():
                rest += struct.pack("<BBBBHB", 7, 5, address, how, 64, 1 if how == INTERRUPT_TYPE else 0)
            return struct.pack("<BBHBBBBB", 9, 2, 9 + len(rest), 1, 1, 0, 0xC0, 50) + rest
        if kind == 3:
            if number == 0:
                return b"\x04\x03\x09\x04"
            text = {1: "Double", 2: type(self.double).__name__, 3: getattr(self.double, "serial", "1")}.get(number)
            return None if text is None else bytes([2 + 2 * len(text), 3]) + text.encode("utf-16-le")
        return self.described if kind == 0x22 and self.hid else None
