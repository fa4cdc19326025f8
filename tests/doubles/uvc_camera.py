"""A camera of the USB video class: exposure, gain and their automatics by requests, pictures by bulk transfers.

The pictures are of one gray, which grows with the exposure and the gain that the camera really has.

Sources, named by their letters at the lines below:
  UVC  USB Device Class Definition for Video Devices 1.0a/1.1: terminals, units, requests, probe and commit, payload headers
  LX   Linux include/uapi/linux/usb/video.h: the same numbers as code
  UNC  USB Video Payload Uncompressed 1.1: format and frame descriptors, the GUID of YUY2
SPDX-License-Identifier: Apache-2.0
"""

import struct

from double import STALL, UsbDouble

SET_CUR, GET_CUR, GET_MIN, GET_MAX, GET_RES, GET_LEN, GET_INFO, GET_DEF = 0x01, *range(0x81, 0x88)  # UVC table A-8
CAMERA, PROCESSING, OUTPUT = 1, 2, 3  # numbers of the terminals and of the unit, this camera's own
MANUAL, APERTURE = 1, 8  # UVC 4.2.2.1.2: bits of the auto-exposure mode
AE_MODE, AE_PRIORITY, EXPOSURE, FOCUS_AUTO = 0x02, 0x03, 0x04, 0x08  # UVC table A-12
GAIN, WHITE_BALANCE, WHITE_BALANCE_AUTO = 0x04, 0x0A, 0x0B  # UVC table A-13
PROBE, COMMIT = 1, 2  # UVC table A-14
HEADER = 2  # bytes of a payload's header without time stamps (UVC 2.4.3.3)
PAYLOAD = 2048  # bytes, header and all
INTERVAL = 1000000  # UVC: of 100 ns

# (unit, selector): name, bytes, least, largest, step, default
CONTROLS = {
    (CAMERA, AE_MODE): ("ae_mode", 1, 1, 8, MANUAL | APERTURE, APERTURE),  # UVC: GET_RES tells the modes
    (CAMERA, AE_PRIORITY): ("ae_priority", 1, 0, 1, 1, 1),
    (CAMERA, EXPOSURE): ("exposure", 4, 3, 2047, 1, 250),  # UVC 4.2.2.1.4: in units of 100 us
    (CAMERA, FOCUS_AUTO): ("focus_auto", 1, 0, 1, 1, 1),
    (PROCESSING, GAIN): ("gain", 2, 0, 100, 1, 10),
    (PROCESSING, WHITE_BALANCE): ("white_balance", 2, 2800, 6500, 1, 4000),
    (PROCESSING, WHITE_BALANCE_AUTO): ("white_balance_auto", 1, 0, 1, 1, 1),
}
# What may not be set while an automatic has it (UVC 2.4.4: the control is in a state that does not allow it).
AUTOMATIC = {"exposure": lambda camera: camera.ae_mode != MANUAL, "white_balance": lambda camera: camera.white_balance_auto}


class UvcCamera(UsbDouble):
    """One camera, one format, one size; strict: what is out of its range or state stalls."""

    OPTIONS = {**UsbDouble.OPTIONS, "serial": "UVC1", "width": 80, "height": 60}
    STATE = ("ae_mode", "ae_priority", "exposure", "focus_auto", "gain", "white_balance", "white_balance_auto", "streaming", "frames", "gray")
    VENDOR, PRODUCT = 0x1D6B, 0x0102  # no source: numbers of nobody's camera
    BULK_IN = 0x81
    firmware = 0x0100

    def start(self, now):
        """Power-up: everything automatic, as cameras for conversations are."""
        self.put(now, streaming=False, frames=0, gray=0, **{each[0]: each[5] for each in CONTROLS.values()})
        self._probe = self._settings()
        self._payloads, self._due = [], None

    # -- descriptors -----------------------------------------------------------------------------------------

    @property
    def configuration(self):
        """UVC 3: association, control interface with terminals and unit, streaming interface with one bulk endpoint."""
        camera = struct.pack("<BBBBHBBHHHB", 18, 0x24, 2, CAMERA, 0x0201, 0, 0, 0, 0, 0, 3) + (0x0E | 1 << 17).to_bytes(3, "little")
        unit = struct.pack("<BBBBBHBHB", 11, 0x24, 5, PROCESSING, CAMERA, 0, 2, 0x1240, 0)
        output = struct.pack("<BBBBHBBB", 9, 0x24, 3, OUTPUT, 0x0101, 0, PROCESSING, 0)
        head = struct.pack("<BBBHHIBB", 13, 0x24, 1, 0x0100, 13 + len(camera + unit + output), 6000000, 1, 1)
        size = self.width * self.height * 2
        rate = size * 8 * 10
        shape = struct.pack("<BBBBBHHIIIIBI", 30, 0x24, 5, 1, 0, self.width, self.height, rate, rate, size, INTERVAL, 1, INTERVAL)
        form = struct.pack("<BBBBB", 27, 0x24, 4, 1, 1) + b"YUY2\0\0\x10\0\x80\0\0\xaa\0\x38\x9b\x71" + struct.pack("<6B", 16, 1, 0, 0, 0, 0)
        stream = struct.pack("<BBBBHBBBBBBBB", 14, 0x24, 1, 1, 14 + len(form + shape), self.BULK_IN, 0, OUTPUT, 0, 0, 0, 1, 0)
        rest = (struct.pack("<8B", 8, 0x0B, 0, 2, 0x0E, 3, 0, 0) +
                struct.pack("<9B", 9, 4, 0, 0, 0, 0x0E, 1, 0, 0) + head + camera + unit + output +
                struct.pack("<9B", 9, 4, 1, 0, 1, 0x0E, 2, 0, 0) + stream + form + shape +
                struct.pack("<BBBBHB", 7, 5, self.BULK_IN, 2, 64, 0))
        return struct.pack("<BBHBBBBB", 9, 2, 9 + len(rest), 2, 1, 0, 0x80, 250) + rest

    # -- requests --------------------------------------------------------------------------------------------

    def control(self, request_type, request, value, index, length_or_data, now):
        """UVC 4: of the class, to a unit (index high) of the control interface, or to the streaming interface."""
        self.advance(now)
        towards_host = bool(request_type & 0x80)
        refused = (STALL, b"") if towards_host else STALL
        if request_type & 0x7F != 0x21:
            return refused
        selector, unit, interface = value >> 8, index >> 8, index & 0xFF
        if interface == 1:
            return self._negotiate(request, selector, length_or_data, now) if unit == 0 else refused
        control = CONTROLS.get((unit, selector))
        if control is None:
            self.tell(now, "refused", [request, value, index])
            return refused
        if towards_host:
            data = self._told(request, control)
            return refused if data is None else (min(len(data), length_or_data), data[:length_or_data])
        return self._set(control, length_or_data, now) if request == SET_CUR else STALL

    def _told(self, request, control):
        name, size, least, largest, step, default = control
        if request == GET_INFO:  # UVC table 4-3: bits GET, SET, disabled by an automatic
            return bytes([3 | (4 if name in AUTOMATIC and AUTOMATIC[name](self) else 0)])
        if request == GET_LEN:
            return struct.pack("<H", size)
        number = {GET_CUR: getattr(self, name), GET_MIN: least, GET_MAX: largest, GET_RES: step, GET_DEF: default}.get(request)
        return None if number is None else int(number).to_bytes(size, "little")

    def _set(self, control, data, now):
        name, size, least, largest, step, _ = control
        number = int.from_bytes(data, "little")
        modes = name == "ae_mode" and number & step != number
        if len(data) != size or not least <= number <= largest or modes or (name in AUTOMATIC and AUTOMATIC[name](self)):
            self.tell(now, "refused", [name, number])
            return STALL
        self.put(now, **{name: number})
        return size

    def _settings(self):
        """UVC 4.3.1.1, 26 bytes of version 1.0."""
        return struct.pack("<HBBIHHHHHII", 1, 1, 1, INTERVAL, 0, 0, 0, 0, 0, self.width * self.height * 2, PAYLOAD)

    def _negotiate(self, request, selector, length_or_data, now):
        if selector not in (PROBE, COMMIT):
            return STALL if request == SET_CUR else (STALL, b"")
        if request == SET_CUR:
            if selector == COMMIT:
                self.put(now, streaming=True)
                self._payloads, self._due = [], now
            return len(length_or_data)
        data = {GET_LEN: struct.pack("<H", 26), GET_INFO: b"\x03"}.get(request, self._settings())
        return min(len(data), length_or_data), data[:length_or_data]

    # -- pictures --------------------------------------------------------------------------------------------

    def _picture(self, now):
        """YUY2: luminance by exposure and gain, no color. Automatic exposure finds a gray of its own."""
        light = self.exposure * (1 + self.gain / 10) / 4 if self.ae_mode == MANUAL else 118
        self.put(now, gray=int(min(235, 16 + light)))
        self.frames += 1
        return bytes([self.gray, 128]) * (self.width * self.height)

    def bulk_in(self, size, now):
        """One payload, or None where the next picture is not due. UVC 2.4.3.2: a short packet ends it."""
        self.advance(now)
        if not self._payloads:
            if not self.streaming or self._due is None or now < self._due:
                return None
            self._due = max(self._due + INTERVAL * 1e-7, now)
            picture, step = self._picture(now), PAYLOAD - HEADER
            for start in range(0, len(picture), step):
                # UVC 2.4.3.3: end of header, the frame's parity, end of frame in its last payload
                info = 0x80 | self.frames & 1 | (2 if start + step >= len(picture) else 0)
                self._payloads.append(bytes([HEADER, info]) + picture[start:start + step])
        return self._payloads.pop(0)[:size]

    def bulk_out(self, data, now):
        """It has no such endpoint."""

    def next_event(self):
        """The next picture."""
        return self._due if self.streaming else None


DOUBLE = UvcCamera
