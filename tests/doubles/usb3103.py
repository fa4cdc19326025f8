"""A Measurement Computing USB-3103 (and its relatives 3101 to 3114): voltage outputs by HID reports.

Sources, named by their letters at the lines below:
  WJ   github wjasper/Linux_Drivers USB/mcc-libusb/usb-3100.c and usb-3100.h (its author has the hardware)
  WJP  the same, USB/python/usb_3100.py
  F    the project's fact sheet mcc_usb3103 (wjasper again; counts, memory map)
  one_shot.py has those of what may hang on a digital line.
SPDX-License-Identifier: Apache-2.0
"""

import errno
import struct

from double import HidDouble
from one_shot import OneShot

# WJ usb-3100.h: product ids; F: channels of 3101 and 3103. The even ones of the data sheets are not in WJ.
CHANNELS = {0x009A: 4, 0x009B: 4, 0x009C: 8, 0x009D: 8, 0x009E: 16, 0x009F: 16, 0x00A2: 4, 0x00A3: 8, 0x00A4: 16}

DCONFIG, DCONFIG_BIT, DIN, DOUT, DBIT_IN, DBIT_OUT = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06  # WJ
AOUT, AOUT_SYNC, AOUT_CONFIG = 0x14, 0x15, 0x1C  # WJ
CINIT, CIN, MEM_READ, MEM_WRITE = 0x20, 0x21, 0x30, 0x31  # WJ
BLINK, RESET, SET_SYNC, GET_STATUS = 0x40, 0x41, 0x43, 0x44  # WJ
PREPARE_DOWNLOAD, WRITE_CODE, WRITE_SERIAL = 0x50, 0x51, 0x53  # WJ

# WJ: the bytes of each report with its id; MEM_WRITE and WRITE_CODE have their own length inside.
LENGTHS = {
    DCONFIG: 2, DCONFIG_BIT: 3, DIN: 1, DOUT: 2, DBIT_IN: 2, DBIT_OUT: 3, AOUT: 5, AOUT_SYNC: 1, AOUT_CONFIG: 3,
    CINIT: 1, CIN: 1, MEM_READ: 5, BLINK: 2, RESET: 1, SET_SYNC: 2, GET_STATUS: 1, PREPARE_DOWNLOAD: 2,
    WRITE_SERIAL: 9,
}


class Usb3103(HidDouble):
    """The device and what its terminals carry."""

    OPTIONS = {
        **HidDouble.OPTIONS,
        "product": 0x009C,
        "serial": "01A2B3C4",
        # no source: whether a report longer than its command is taken. WJ never sends one; a HID gadget on a real
        # kernel took two bytes for one (facts/kernel_guest.md).
        "padding": True,
        # no source: the length of an input report. WJ reads exactly what is given here; 64 pads with zeros.
        "reply_size": 0,
        "blank_calibration": False,  # flash as erased: every byte FF, so that slope and offset are no numbers
        "master_at_start": True,  # no source
        "re_enumeration": 1.0,  # no source: seconds away after RESET
        # What the laboratory has wired, not the device: a one-shot on a digital line, seconds of its pulse (0: none,
        # the amplifiers are always on), and seconds in which the relay behind it opens, and closes.
        "one_shot": 0.0,
        "one_shot_line": 0,
        "relay_release": 0.0,
        "relay_operate": 0.0,
    }
    STATE = (
        "ranges", "counts", "latched", "volts", "milliamperes", "port_inputs", "port_latch", "port_pins", "port_wires",
        "sync_master", "sync_input", "counter", "blinks", "unlocked", "updates", "eeprom", "flash",
        "amplifiers", "driven", "edges",
    )
    VENDOR = 0x09DB  # F

    def __init__(self, **options):
        self._shot = None
        self.volts, self.amplifiers, self.edges = [], True, 0
        super().__init__(**options)
        self.PRODUCT = self.product

    @property
    def driven(self):
        """The largest voltage that the amplifiers make a current of: none where they are off."""
        return max(map(abs, self.volts), default=0.0) if self.amplifiers else 0.0

    def advance(self, now):
        """A relay moves by itself."""
        super().advance(now)
        for at, closed in [] if self._shot is None else self._shot.advance(now):
            self.put(at, amplifiers=closed)

    def next_event(self):
        """When the relay moves."""
        return None if self._shot is None else self._shot.next

    def _drive_one_shot(self, now):
        if self._shot is None:
            return
        # An input of the port puts out nothing, which a pull-down makes low.
        high = bool(self.port_latch & ~self.port_inputs & 1 << self.one_shot_line)
        if high and not self._shot.level:
            self.edges += 1
        for at, closed in self._shot.input(high, now):
            self.put(at, amplifiers=closed)

    @property
    def channels(self):
        """Outputs of this model."""
        return CHANNELS[self.product]

    def start(self, now):
        """Power-up. no source but the fact sheet's question mark: 0 V in the 0..10 V range, port as inputs."""
        self._away = 0.0
        self._shot = OneShot(self.one_shot, self.relay_release, self.relay_operate) if self.one_shot > 0 else None
        self.put(now, amplifiers=self._shot is None)
        if not hasattr(self, "eeprom"):
            self.eeprom, self.flash = bytes(256), self._factory()
            self.port_wires = 0xFF  # no source: inputs are pulled up
        self.put(now, ranges=[0] * self.channels, counts=[0] * self.channels, latched={}, port_inputs=0xFF,
                 port_latch=0, sync_master=self.master_at_start, sync_input=False, counter=0, blinks=0,
                 unlocked=False, updates=0)
        # WJ usbAOutConfig: 0 V in the selected range
        self.counts = [self._count_of_zero(channel) for channel in range(self.channels)]
        self._settle(now)

    def _factory(self):
        """Calibration in flash at 0x100..0x2FF; WJ usbAOutConfig: where each channel's slope and offset stand."""
        if self.blank_calibration:
            return b"\xff" * 512
        flash = bytearray(512)
        for channel in range(16):
            for table, (address, step) in enumerate(((0x100, 0x10), (0x108, 0x10), (0x200, 0x08))):
                slope = 1.0 + (channel - 7.5) * 2e-4 + table * 1e-4
                offset = -40.0 + 7.0 * channel if table == 1 else 4.0 + channel
                struct.pack_into("<ff", flash, address - 0x100 + step * channel, slope, offset)
        return bytes(flash)

    def _true(self, channel):
        """What the analog part really does: counts = slope * ideal + offset, as the factory measured it."""
        shift = (0x100, 0x108)[self.ranges[channel]] - 0x100 + 0x10 * channel
        slope, offset = struct.unpack_from("<ff", self._factory_flash(), shift)
        return slope, offset

    def _factory_flash(self):
        blank, self.blank_calibration = self.blank_calibration, False
        flash = self._factory()
        self.blank_calibration = blank
        return flash

    def _count_of_zero(self, channel):
        slope, offset = self._true(channel)
        ideal = 0x8000 if self.ranges[channel] else 0
        return min(max(round(slope * ideal + offset), 0), 0xFFFF)

    def _settle(self, now):
        """Terminals follow the converters. WJ volts_USB31XX and the comment of usbAOut."""
        volts, milliamperes = [], []
        for channel, count in enumerate(self.counts):
            slope, offset = self._true(channel)
            ideal = (count - offset) / slope
            volts.append((ideal - 32768) * 10 / 32768 if self.ranges[channel] else max(0.0, ideal * 10 / 65536))
            milliamperes.append(max(0.0, ideal) * 5 / (249 * 65536) * 1e3)
        self.put(now, volts=volts, milliamperes=milliamperes)
        self.put(now, port_pins=self.port_wires & self.port_inputs | self.port_latch & ~self.port_inputs & 0xFF)
        self._drive_one_shot(now)

    def arranged(self, now):
        """A rising edge on the sync pin of a slave updates the outputs (WJ usbSetSync)."""
        self._settle(now)
        if self.sync_input and not self._had_sync and not self.sync_master:
            self._update(now)
        self._had_sync = self.sync_input

    _had_sync = False

    def _update(self, now):
        for channel, count in self.latched.items():
            self.counts[channel] = count
        self.put(now, latched={}, updates=self.updates + 1)
        self._settle(now)

    def _refuse(self, report, now, why):
        self.tell(now, "refused: " + why, report)
        return len(report)  # the host cannot see it: the interrupt transfer itself went well

    def report_out(self, report, now):
        """One output report of the host."""
        if now < self._away:
            return -errno.ENODEV
        command, length = report[0], LENGTHS.get(report[0])
        self.tell(now, "report", report)
        if command == MEM_WRITE:
            length = 4 + (report[3] if len(report) > 3 else 0)
        if length is None:
            return self._refuse(report, now, "unknown or firmware command")
        if len(report) < length:
            return self._refuse(report, now, "short")
        if len(report) > length and not self.padding:
            return self._refuse(report, now, "long")
        if command in (PREPARE_DOWNLOAD, WRITE_SERIAL):
            return self._refuse(report, now, "firmware command")
        act = {
            DCONFIG: self._port_direction, DCONFIG_BIT: self._bit_direction, DIN: self._read_port,
            DOUT: self._write_port, DBIT_IN: self._read_bit, DBIT_OUT: self._write_bit, AOUT: self._analog,
            AOUT_SYNC: self._sync, AOUT_CONFIG: self._range, CINIT: self._clear_counter, CIN: self._read_counter,
            MEM_READ: self._read_memory, MEM_WRITE: self._write_memory, BLINK: self._blink, RESET: self._reset,
            SET_SYNC: self._set_sync, GET_STATUS: self._status,
        }[command]
        why = act(report, now)
        return self._refuse(report, now, why) if why else len(report)

    def _reply(self, data, now):
        self.report(data.ljust(self.reply_size, b"\0"), now)

    def _port_direction(self, report, now):
        self.put(now, port_inputs=0xFF if report[1] else 0)  # WJ: 0 output, 1 input
        self._settle(now)

    def _bit_direction(self, report, now):
        if report[1] > 7:
            return "bit"
        bit = 1 << report[1]
        self.put(now, port_inputs=self.port_inputs | bit if report[2] else self.port_inputs & ~bit)
        self._settle(now)

    def _read_port(self, report, now):
        self._reply(bytes([DIN, self.port_pins]), now)  # WJ usbDIn: id, value seen at the pins

    def _write_port(self, report, now):
        self.put(now, port_latch=report[1])
        self._settle(now)

    def _read_bit(self, report, now):
        if report[1] > 7:
            return "bit"
        self._reply(bytes([DBIT_IN, self.port_pins >> report[1] & 1]), now)  # WJ usbDBitIn

    def _write_bit(self, report, now):
        if report[1] > 7:
            return "bit"
        bit = 1 << report[1]
        self.put(now, port_latch=self.port_latch | bit if report[2] else self.port_latch & ~bit)
        self._settle(now)

    def _analog(self, report, now):
        """WJ usbAOut: channel, value low byte first, update 0 now or 1 on the sync signal."""
        channel, value, update = report[1], report[2] | report[3] << 8, report[4]
        if channel >= self.channels:
            return "channel"
        if update > 1:
            return "update mode"
        if update == 1:
            self.put(now, latched={**self.latched, channel: value})
            return None
        self.latched.pop(channel, None)
        self.counts[channel] = value
        self.tell(now, "counts", self.counts)
        self._settle(now)
        return None

    def _sync(self, report, now):
        if not self.sync_master:
            return "slave"  # WJ usbAOutSync: no effect if the sync signal is an input
        self._update(now)
        return None

    def _range(self, report, now):
        """WJ usbAOutConfig: the output is set to 0 V in the selected range."""
        channel, selected = report[1], report[2]
        if channel >= self.channels:
            return "channel"
        if selected > 1:
            return "range"
        ranges = list(self.ranges)
        ranges[channel] = selected
        self.put(now, ranges=ranges)
        self.latched.pop(channel, None)  # no source: that a latched value does not outlive the change of range
        self.counts[channel] = self._count_of_zero(channel)
        self._settle(now)
        return None

    def _clear_counter(self, report, now):
        self.put(now, counter=0)

    def _read_counter(self, report, now):
        self._reply(bytes([CIN]) + struct.pack("<I", self.counter), now)  # WJ usbReadCounter: low byte first

    def _read_memory(self, report, now):
        """WJ usbReadMemory: 62 bytes at most; EEPROM 0..0FF, flash 100..2FF. WJ asks for 63 bytes whatever the count."""
        address, count = report[1] | report[2] << 8, report[4]
        if count > 62:
            return "count"
        memory = (self.eeprom + self.flash)[address:address + count]
        self._reply(bytes([MEM_READ]) + memory.ljust(62, b"\0"), now)  # no source: what stands behind the count
        return None

    def _write_memory(self, report, now):
        """WJ usbWriteMemory: EEPROM anywhere, 1 to 59 bytes; flash only when unlocked, in blocks of 32."""
        address, count, data = report[1] | report[2] << 8, report[3], report[4:4 + report[3]]
        if address == 0x500:
            if data in (b"\xaa\x55", b"\x55\xaa"):  # WJ: the value 0xaa55; no source for the order of its bytes
                self.put(now, unlocked=True)
                return None
            return "unlock"
        if not 1 <= count <= 59:
            return "count"
        if address + count <= 0x100:
            memory = bytearray(self.eeprom)
            memory[address:address + count] = data
            self.put(now, eeprom=bytes(memory))
            return None
        if not 0x100 <= address <= 0x2FF:
            return "address"
        if not self.unlocked:
            return "flash is locked"
        start = (address & 0xFFE0) - 0x100
        memory = bytearray(self.flash)
        if not start & 0x20:
            memory[start:start + 64] = b"\xff" * 64  # WJ: the first half of a sector erases it
        memory[start:start + min(count, 32)] = data[:32]
        self.put(now, flash=bytes(memory))
        return None

    def _blink(self, report, now):
        self.put(now, blinks=self.blinks + report[1])

    def _reset(self, report, now):
        """WJ usbReset: disconnects from the bus and resets its microcontroller."""
        self.tell(now, "reset", True)
        self._in.clear()
        self.start(now)
        self._away = now + self.re_enumeration

    def _set_sync(self, report, now):
        if report[1] > 1:
            return "sync type"
        self.put(now, sync_master=report[1] == 0)  # WJ usb-3100.h: SYNC_MASTER 0, SYNC_SLAVE 1
        return None

    def _status(self, report, now):
        # WJ usbGetStatus: bit 0: 0 slave, 1 master (the other way round than in SetSync); others unused
        self._reply(bytes([GET_STATUS, int(self.sync_master)]), now)


DOUBLE = Usb3103
