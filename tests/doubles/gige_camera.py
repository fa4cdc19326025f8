"""A GigE Vision camera: its registers, its clock, its exposures and its packets, without I/O. gige_serve.py puts it on
the network; gige_wire.py has the packets' layouts, gige_features.py the features, gige_scene.py what the sensor sees.

Time is in seconds of the host's monotonic clock, less an origin. Exposures happen at exactly computed times; the
history tells each with its start and end in nanoseconds of CLOCK_MONOTONIC (`origin_ns` is added), so that a judge can
compare.

Sources, named by their letters at the lines below:
  WC, WS, ARV   as in gige_wire.py
  FL    FLIR's Grasshopper3 technical reference, 2.4.4: heartbeat 500 ms to 10 s, 3000 ms by default; when nothing is
        heard for longer, the connection is shut down
  F     the project's fact sheet on cameras (Aravis 0.8 and V4L2)
  SFNC  the GenICam naming convention, from memory: what a feature means
  CT    the same, 24.31 ChunkTimestamp, as public headers and manuals quote it: "the Timestamp of the image included in
        the payload at the time of the FrameStart internal event"; without a unit
  BA    Basler, user's manuals of pioneer (14.4) and ace GigE (11.4): the time stamp chunk counts ticks of the Gev
        Timestamp Tick Frequency
SPDX-License-Identifier: Apache-2.0
"""

import collections
import heapq
import itertools
import math
import random
import struct

from double import Double, Refused
import gige_features as gf
import gige_scene as scene
import gige_wire as wire

NS = 1_000_000_000
TAI_MINUS_UTC = 37.0  # F: PTP stamps are TAI


class Refusal(Exception):
    """A command that is answered by a status other than success."""

    def __init__(self, status):
        super().__init__(f"{status:#06x}")
        self.status = status


class Frame:
    """One exposure and what becomes of it."""

    def __init__(self, start, exposure, cause):
        self.start, self.exposure, self.cause = start, exposure, cause
        self.end = start + exposure
        self.block = self.ticks = self.start_ticks = self.lines = 0
        self.leader = self.payload = self.trailer = b""
        self.packet_size = 0

    def packets(self, wide):
        """How many packets it takes, with leader and trailer."""
        return -(-len(self.payload) // wire.data_size(self.packet_size, wide)) + 2


class Transmission:
    """Packets of one frame on their way."""

    def __init__(self, frame, order, due, spacing, status=wire.SUCCESS):
        self.frame, self.order, self.due, self.spacing, self.status = frame, order, due, spacing, status
        self.at, self.dropped, self.began = 0, 0, None


class GigeCamera(Double):
    """The camera. receive() takes control packets, say() gives answers, stream() gives stream packets."""

    OPTIONS = {
        **Double.OPTIONS,
        "address": "127.0.0.1", "vendor": "Vitreo Doubles", "model": "GV640", "serial": "D0001",
        "sensor_width": 640, "sensor_height": 480, "color": False,
        "width_step": 4, "height_step": 2,
        "offset_step": 1,  # no source: many colour cameras allow even offsets only
        "names": "new",  # or "old": ExposureTimeAbs, GainRaw, GevTimestampControlLatch (F: names differ by age)
        "locked_write": "refuse",  # or "ignore": a write to what an automatic mode or the acquisition locks; no source
        "out_of_range": "refuse",  # or "clamp"; no source: makers differ
        "exposure_step": 1.0, "gain_step": 0.1,  # us, dB: values are rounded to these; no source
        # clock
        "tick_frequency": 125_000_000,  # 1000000000, or 0: unknown, stamps are 0 then (F: 1 GHz or 125 MHz)
        "drift_ppm": 0.0, "clock_offset": 0.0,  # F: 20 to 50 ppm; seconds on the clock at power-up
        "stamp_at": "start",  # or "end" of the exposure, or "readout": its end (F: the maker's choice)
        "ptp_lock_time": 3.0, "ptp_error": 0.0,  # seconds until Slave, seconds that the clock is then off the master
        # sensor
        "line_time": 10e-6,  # seconds to read a row out
        "start_latency": 0.001, "exposure_gap": 50e-6,  # seconds; no source
        "ambient": 50.0,  # full scales a second at 0 dB at the ramp's bright end
        "strip": True, "dot_period": 1.0,  # of device time; 0: no dot
        "lamp_left": 448, "lamp_top": 96, "lamp_side": 32, "lamp_level": 25.0,  # full scales a second while it burns
        "bayer_name": "sensor",  # or "picture": odd offsets change the leader's format; no source (F: phase shifts)
        "auto_target": 0.4,  # the mean that automatic exposure and gain steer the ramp's bright end to
        # stream
        "mtu": 9000, "path_mtu": 0,  # largest packet size; packets over path_mtu vanish, 0: none do
        "wide_ids": False,  # 64-bit block ids
        "first_block": 1,  # F: fakes start at 65401 to meet the wrap
        # When block ids begin anew: when the stream is opened, or "start": at AcquisitionStart. no source but memory
        "restart_ids": "open",
        "chunk_payload": "image",  # 0x4001; or "extended" 0x0005, "chunk" 0x0004 of GigE Vision 1
        "link_rate": 0.0,  # bits a second; 0: as fast as the host can
        "jitter": "none",  # or "uniform" 0 to jitter_time, "exponential" of that mean, "mostly": 90 % below 0.2 ms
        "jitter_time": 0.02, "seed": 1,
        "packet_loss": 0.0, "frame_loss": 0.0, "reorder": 0.0, "duplicate": 0.0,  # ratios
        "resend": "works",  # or "silent", "refuses" (status in place of data), "absent" (no such capability)
        "resend_loss": 0.0, "resend_delay": 0.0, "resend_depth": 8,  # ratio, seconds, frames that are kept
        # control
        "boot_time": 2.0,  # seconds without an answer after power comes back; no source
        "pending_after": 0.0,  # seconds after which a late answer is announced by PENDING_ACK; 0: never
        "discovery": True,  # answers discovery
        "control_loss": 0.0,  # ratio of control packets that vanish, commands and answers alike
    }
    # Options that stand in the camera's text or clock.
    FIXED = ("address", "vendor", "model", "serial", "sensor_width", "sensor_height", "color", "width_step",
             "height_step", "offset_step", "names", "mtu", "tick_frequency", "drift_ppm", "clock_offset")
    STATE = (
        "acquiring", "controller", "exposures", "triggers", "triggers_ignored", "frames_sent", "frames_lost",
        "packets_sent", "packets_lost", "resend_requests", "packets_resent", "refusals", "commands", "unplugged",
        "features", "lose_frames", "line1", "device_time", "ticks", "ptp_state", "boot_until", "heartbeats_lost",
    )

    def __init__(self, **options):
        self.origin_ns = 0  # CLOCK_MONOTONIC at time 0
        self.epoch = 0.0  # CLOCK_REALTIME at time 0, for PTP
        self.lamp = scene.Lamp()
        self.listeners = []  # called with (line name, level, time) when an output changes
        self.sets = {}
        self.user_name, self.user_set_default = b"", 0
        self.stream_port = 0  # the port the stream leaves by
        self.line1 = False
        self.unplugged = False
        self.powered = 0.0
        self.painter = scene.Painter()
        self._out, self._events, self._count = [], [], itertools.count()
        super().__init__(**options)
        self._check_options()

    def _check_options(self):
        choices = {
            "names": ("new", "old"), "locked_write": ("refuse", "ignore"), "out_of_range": ("refuse", "clamp"),
            "stamp_at": ("start", "end", "readout"), "bayer_name": ("sensor", "picture"),
            "restart_ids": ("open", "start"), "chunk_payload": ("image", "extended", "chunk"),
            "jitter": ("none", "uniform", "exponential", "mostly"),
            "resend": ("works", "silent", "refuses", "absent"),
        }
        for name, allowed in choices.items():
            if getattr(self, name) not in allowed:
                raise Refused(f"{name}: '{getattr(self, name)}' is none of {', '.join(allowed)}")

    def mode(self, **options):
        """Also refuses a value that is none of an option's choices, and what cannot change in a running camera."""
        running = hasattr(self, "values")
        fixed = sorted(set(options) & set(self.FIXED)) if running else []
        if fixed:
            raise Refused(f"{', '.join(fixed)}: given at the start, not later")
        before = {name: getattr(self, name) for name in options if name in self.OPTIONS}
        super().mode(**options)
        if running:
            try:
                self._check_options()
            except Refused:
                for name, value in before.items():
                    setattr(self, name, value)
                raise

    # -- power -------------------------------------------------------------------------------------------------

    def start(self, now):
        """Power-up: the set that UserSetDefault names; the clock begins at its offset."""
        self.random = random.Random(self.seed)
        self.powered, self._offset, self.boot_until = now, self.clock_offset, 0.0
        self.categories = gf.table(self)
        self.features_by_name = gf.lay_out(self.categories, self)
        self.xml = gf.text(self.categories, self.features_by_name, self)
        self.values = {each.name: [each.value] * each.slots for each in self.features_by_name.values()}
        self.values["LineMode"] = [0, 1]
        if "Default" not in self.sets:
            self.sets["Default"] = {name: list(value) for name, value in self.values.items()}
        self.values["UserSetDefault"] = [self.user_set_default]
        self._load(gf.SETS[self.user_set_default])
        self._by_address = {}
        for feature in self.features_by_name.values():
            if feature.address is not None and feature.address >= gf.BASE:
                for slot in range(feature.slots):
                    self._by_address[feature.address + slot * feature.size()] = (feature, slot)
        self._make_bootstrap()
        self.acquiring, self.controller, self._exclusive = False, None, False
        self._last_heard, self._last_answer = now, None
        self._out.clear()
        self._events.clear()
        self._queue = collections.deque()
        self._kept = collections.OrderedDict()
        self._round, self._ready_at, self._last_due = 0, now, now
        self._block, self._frames_left, self._waits_for_start = 0, None, False
        self._exposing = 0
        self._hunt, self._once = 1.0, {}
        self.lose_frames = 0
        self.exposures = self.triggers = self.triggers_ignored = self.frames_sent = self.frames_lost = 0
        self.packets_sent = self.packets_lost = self.resend_requests = self.packets_resent = 0
        self.refusals = self.commands = self.heartbeats_lost = 0
        self.ptp_state, self._ptp_step = "Disabled", None
        self._latched = 0

    def power_cycle(self, now):
        """Takes the power away and gives it back; answers nothing until it has booted."""
        super().power_cycle(now)
        self.boot_until = now + self.boot_time

    def _make_bootstrap(self):
        put = struct.pack
        words = {
            wire.VERSION: 2 << 16,  # WC: major, minor; 2.0 for PTP and chunks beside a picture
            wire.DEVICE_MODE: 1 << 31 | 1,  # WC: big-endian, a transmitter, UTF-8
            wire.MAC_HIGH: 0x0200, wire.MAC_LOW: self._address(),
            wire.IP_SUPPORTED: 7, wire.IP_CURRENT: 5,  # ARV: persistent 1, DHCP 2, link local 4
            wire.IP_ADDRESS: self._address(), wire.IP_MASK: 0xFF000000, wire.IP_GATEWAY: 0,
            wire.INTERFACES: 1, wire.PERSISTENT_IP: self._address(), wire.PERSISTENT_MASK: 0xFF000000,
            wire.PERSISTENT_GATEWAY: 0, wire.LINK_SPEED: 1000,
            wire.MESSAGE_CHANNELS: 0, wire.STREAM_CHANNELS: 1, wire.STREAM_CAPABILITY: 0,
            wire.CAPABILITY: self._capability(),
            wire.HEARTBEAT: 3000,  # FL
            wire.TICKS_HIGH: 0, wire.TICKS_LOW: 0, wire.TIME_CONTROL: 0, wire.TIME_HIGH: 0, wire.TIME_LOW: 0,
            wire.CONFIGURATION: 0, wire.PENDING_TIMEOUT: 1000, wire.PTP_STATUS: 0,
            wire.CCP: 0, wire.OWNER_PORT: 0, wire.OWNER_ADDRESS: 0,
            wire.SC_PORT: 0, wire.SC_SIZE: 1400, wire.SC_DELAY: 0, wire.SC_ADDRESS: 0, wire.SC_SOURCE: 0,
            wire.SC_CAPABILITY: 0, wire.SC_CONFIGURATION: 0,
        }
        self._boot = bytearray(0x1000)
        self._known = bytearray(0x1000)  # 1: can be read, 3: can be written as well
        writable = (wire.IP_CURRENT, wire.PERSISTENT_IP, wire.PERSISTENT_MASK, wire.PERSISTENT_GATEWAY, wire.HEARTBEAT,
                    wire.TIME_CONTROL, wire.CONFIGURATION, wire.CCP, wire.SC_PORT, wire.SC_SIZE, wire.SC_DELAY,
                    wire.SC_ADDRESS)
        for address, value in words.items():
            self._boot[address:address + 4] = put(">I", value)
            self._known[address:address + 4] = bytes([3 if address in writable else 1]) * 4
        # no source: the words between these registers in the first 0x48 bytes are reserved and read 0
        for low in range(0, wire.VENDOR, 4):
            self._known[low:low + 4] = bytes([max(self._known[low], 1)]) * 4
        url = f"Local:vitreo_double.xml;{gf.XML_ADDRESS:X};{len(self.xml):X}"  # ARV arv_parse_genicam_url: hex
        for address, size, value in (
                (wire.VENDOR, 32, self.vendor), (wire.MODEL, 32, self.model), (wire.DEVICE_VERSION, 32, "1.0"),
                (wire.VENDOR_INFO, 48, "test double"), (wire.SERIAL, 16, self.serial),
                (wire.USER_NAME, 16, self.user_name.decode()), (wire.URL_FIRST, 512, url), (wire.URL_SECOND, 512, "")):
            self._boot[address:address + size] = value.encode().ljust(size, b"\0")[:size]
            self._known[address:address + size] = bytes([3 if address == wire.USER_NAME else 1]) * size

    def _address(self):
        return int.from_bytes(bytes(int(each) for each in self.address.split(".")), "big")

    def _capability(self):
        can = wire.CAN_CONCATENATE | wire.CAN_WRITE_MEMORY | wire.CAN_PENDING | wire.CAN_PTP
        can |= wire.HAS_SERIAL | wire.HAS_NAME
        return can | (0 if self.resend == "absent" else wire.CAN_RESEND)

    def _word(self, address, value=None):
        """A bootstrap register, or sets it."""
        if value is not None:
            self._boot[address:address + 4] = struct.pack(">I", value & 0xFFFFFFFF)
        return struct.unpack_from(">I", self._boot, address)[0]

    # -- clock -------------------------------------------------------------------------------------------------

    def frequency(self):
        """Ticks a second. GigE Vision 2: 1 GHz while PTP is on; no source at hand but memory."""
        return NS if self.values["PtpEnable"][0] else self.tick_frequency

    def clock(self, when):
        """Seconds on the device's clock at a time of the host."""
        if self.ptp_state == "Slave" and when >= self._ptp_step:
            return self.epoch + when + TAI_MINUS_UTC + self.ptp_error
        return (when - self.powered) * (1 + self.drift_ppm * 1e-6) + self._offset

    def clock_ticks(self, when):
        """Ticks on the device's clock."""
        return int(self.clock(when) * self.frequency()) & (1 << 64) - 1

    device_time = property(lambda self: self.clock(self.now))
    ticks = property(lambda self: self.clock_ticks(self.now))
    features = property(lambda self: {name: value[0] if len(value) == 1 else value
                                      for name, value in self.values.items()
                                      if name in self.features_by_name and not self.features_by_name[name].local})

    def _ns(self, when):
        return self.origin_ns + round(when * NS)

    # -- events ------------------------------------------------------------------------------------------------

    def _at(self, when, name, *arguments):
        heapq.heappush(self._events, (when, next(self._count), name, arguments))

    def next_event(self):
        """The next exposure, trigger or end of a heartbeat."""
        times = [each[0] for each in self._events[:1]]
        if self.controller and not self._word(wire.CONFIGURATION) & 1:
            times.append(self._heartbeat_end())
        return min(times, default=None)

    def next(self):
        """The time of the next event or packet, or None."""
        times = [each[0] for each in self._out[:1]]
        if self._queue:
            first = self._queue[0]
            times.append(first.due + first.at * first.spacing)
        event = self.next_event()
        return min(times + ([] if event is None else [event]), default=None)

    def advance(self, now):
        """Carries out what is due, each thing at its own time."""
        while (due := self.next_event()) is not None and due <= now:
            if self._events and self._events[0][0] <= due:
                when, _, name, arguments = heapq.heappop(self._events)
                super().advance(when)
                getattr(self, "_event_" + name)(when, *arguments)
            else:
                self._lose_heartbeat(due)
        super().advance(now)

    def arranged(self, now):
        """A knob that was turned from outside: the wire on Line1 or the plug."""
        if self.unplugged:
            self._queue.clear()

    # -- control channel ---------------------------------------------------------------------------------------

    def receive(self, packet, peer, now):
        """Takes one packet from the control port; peer: (address, port)."""
        self.advance(now)
        if self.unplugged or now < self.boot_until or self._control_lost():
            return
        try:
            flags, number, request, payload = wire.command(packet)
        except wire.NotGvcp as error:
            self.tell(now, "no GVCP", str(error))
            return
        if number == wire.DISCOVERY:
            if self.discovery:
                self._reply(wire.answer(number + 1, request, bytes(self._boot[:wire.DISCOVERY_SIZE])), peer, now)
            return
        self.commands += 1
        if self.controller == peer:
            self._last_heard = now
        if number == wire.RESEND:
            self._resend(flags, payload, peer, now)
            return
        # A repeated request is answered again, not carried out again. no source at hand but memory
        if self._last_answer and self._last_answer[0] == (peer, bytes(packet)):
            self._reply(self._last_answer[1], peer, now)
            return
        answer = wire.answer(number + 1, request, *self._obey(number, payload, peer, now))
        self._last_answer = ((peer, bytes(packet)), answer)
        if flags & wire.FLAG_ACK:
            self._announce(request, peer, now)
            self._reply(answer, peer, now)

    def _obey(self, number, payload, peer, now):
        """Carries out a command; returns the answer's payload and status."""
        acts = {wire.READ_REGISTER: self._read_registers, wire.WRITE_REGISTER: self._write_registers,
                wire.READ_MEMORY: self._read_memory, wire.WRITE_MEMORY: self._write_memory}
        if number not in acts:
            return b"", wire.NOT_IMPLEMENTED
        payload, status = acts[number](payload, peer, now)
        if status != wire.SUCCESS:
            self.refusals += 1
            self.tell(now, "refused", {"command": number, "status": status})
        return payload, status

    def _control_lost(self):
        return self.control_loss > 0 and self.random.random() < self.control_loss

    def _announce(self, request, peer, now):
        """PENDING_ACK: two reserved bytes and the milliseconds until the answer. ARV get_pending_ack_timeout"""
        if self.pending_after and self.late > self.pending_after:
            pending = wire.answer(wire.PENDING_ACK, request, struct.pack(">HH", 0, round(self.late * 1000) + 100))
            heapq.heappush(self._out, (now + self.pending_after, next(self._count), pending, peer))

    def _reply(self, packet, peer, now):
        if not self._control_lost():
            heapq.heappush(self._out, (now + self.late, next(self._count), packet, peer))

    def say(self, now):
        """The answers that are due: (packet, peer)."""
        self.advance(now)
        told = []
        while self._out and self._out[0][0] <= now:
            _, _, packet, peer = heapq.heappop(self._out)
            if not self.unplugged:
                told.append((packet, peer))
        return told

    def _may_read(self, peer):
        if self._exclusive and self.controller not in (None, peer):
            raise Refusal(wire.ACCESS_DENIED)

    def _may_write(self, peer, address, now):
        if address == wire.CCP:
            if self.controller not in (None, peer):
                raise Refusal(wire.ACCESS_DENIED)
        elif self.controller != peer:
            raise Refusal(wire.ACCESS_DENIED)

    def _read_registers(self, payload, peer, now):
        """READREG: addresses; answered by their values up to the first that failed. WC: may be several."""
        values = b""
        if not payload or len(payload) % 4:
            return values, wire.INVALID_HEADER  # no source
        try:
            self._may_read(peer)
            for (address,) in struct.iter_unpack(">I", payload):
                values += self._read(address, 4, now)
        except Refusal as refusal:
            return values, refusal.status
        return values, wire.SUCCESS

    def _write_registers(self, payload, peer, now):
        """WRITEREG: pairs of address and value; answered by how many succeeded. WC data index"""
        done = 0
        if not payload or len(payload) % 8:
            return struct.pack(">HH", 0, 0), wire.INVALID_HEADER  # no source
        try:
            for address, value in struct.iter_unpack(">II", payload):
                self._may_write(peer, address, now)
                self._write(address, struct.pack(">I", value), now, peer)
                done += 1
        except Refusal as refusal:
            return struct.pack(">HH", 0, done), refusal.status
        return struct.pack(">HH", 0, done), wire.SUCCESS

    def _read_memory(self, payload, peer, now):
        """READMEM: address, two reserved bytes, count; answered by the address and the bytes."""
        if len(payload) != 8:
            return b"", wire.INVALID_HEADER  # no source
        address, count = struct.unpack(">IxxH", payload)
        try:
            self._may_read(peer)
            return payload[:4] + self._read(address, count, now), wire.SUCCESS
        except Refusal as refusal:
            return payload[:4], refusal.status

    def _write_memory(self, payload, peer, now):
        """WRITEMEM: address and bytes; answered by two reserved bytes and the bytes written."""
        if len(payload) < 8:
            return b"", wire.INVALID_HEADER  # no source
        (address,) = struct.unpack_from(">I", payload)
        try:
            self._may_write(peer, address, now)
            self._write(address, payload[4:], now, peer)
        except Refusal as refusal:
            return struct.pack(">HH", 0, 0), refusal.status
        return struct.pack(">HH", 0, len(payload) - 4), wire.SUCCESS

    # -- memory ------------------------------------------------------------------------------------------------

    def _aligned(self, address, count):
        if address % 4 or count % 4:
            raise Refusal(wire.BAD_ALIGNMENT)
        if not 0 < count <= wire.MOST_BYTES:
            raise Refusal(wire.INVALID_PARAMETER)

    def _read(self, address, count, now):
        self._aligned(address, count)
        offset = address - gf.XML_ADDRESS
        if 0 <= offset and offset + count <= len(self.xml):
            return self.xml[offset:offset + count]
        if address + count <= len(self._boot):
            if 0 in self._known[address:address + count:4]:
                raise Refusal(wire.INVALID_ADDRESS)
            self._refresh()
            return bytes(self._boot[address:address + count])
        whole = b""
        while len(whole) < count:
            place = self._by_address.get(address + len(whole))
            half = self._by_address.get(address + len(whole) - 4)
            if place is None and half is not None and half[0].size() == 8:
                whole += self._encoded(*half, now)[4:]
            elif place is None:
                raise Refusal(wire.INVALID_ADDRESS)
            else:
                whole += self._encoded(*place, now)
        return whole[:count]

    def _refresh(self):
        """Brings the bootstrap registers that change by themselves up to date."""
        frequency = self.frequency()
        for high, low, value in ((wire.TICKS_HIGH, wire.TICKS_LOW, frequency),
                                 (wire.TIME_HIGH, wire.TIME_LOW, self._latched)):
            self._word(high, value >> 32)
            self._word(low, value)
        self._word(wire.CCP, (wire.CCP_EXCLUSIVE if self._exclusive else wire.CCP_CONTROL) if self.controller else 0)
        self._word(wire.SC_SOURCE, self.stream_port)
        self._word(wire.CAPABILITY, self._capability())
        self._word(wire.TIME_CONTROL, 0)

    def _write(self, address, data, now, peer):
        self._aligned(address, len(data))
        if address < len(self._boot):
            marks = self._known[address:address + len(data):4]
            if 0 in marks:
                raise Refusal(wire.INVALID_ADDRESS)
            if set(marks) != {3}:
                raise Refusal(wire.WRITE_PROTECT)
            if address == wire.USER_NAME:
                self.user_name = data.split(b"\0")[0][:15]
                self._boot[address:address + 16] = self.user_name.ljust(16, b"\0")
                return
            for offset in range(0, len(data), 4):
                self._write_bootstrap(address + offset, struct.unpack_from(">I", data, offset)[0], now, peer)
            return
        if gf.XML_ADDRESS <= address < gf.XML_ADDRESS + len(self.xml):
            raise Refusal(wire.WRITE_PROTECT)
        place = self._by_address.get(address)
        if place is None:
            raise Refusal(wire.INVALID_ADDRESS)
        feature, slot = place
        if len(data) != feature.size():
            raise Refusal(wire.INVALID_PARAMETER)  # no source: half of a long register
        self._write_feature(feature, slot, self._decoded(feature, data), now)

    def _write_bootstrap(self, address, value, now, peer):
        if address == wire.CCP:
            self._privilege(value, now, peer)
        elif address == wire.TIME_CONTROL:
            if value & wire.TIME_LATCH:
                self._latched = self.clock_ticks(now) if self.frequency() else 0
                self.tell(now, "latch", {"ticks": self._latched, "at_ns": self._ns(now)})
            if value & wire.TIME_RESET and self.ptp_state != "Slave":
                self.powered, self._offset = now, 0.0
                self.tell(now, "clock", "reset")
        elif address == wire.SC_SIZE:
            self._stream_size(value, now)
        elif address == wire.HEARTBEAT:
            self._word(address, min(max(value, 500), 10000))  # FL
        elif address == wire.SC_PORT:
            if value & 0xFFFF and not self._word(address) & 0xFFFF and self.restart_ids == "open":
                self._block = 0
            self._word(address, value & 0xFFFF)
            self.tell(now, "stream port", value & 0xFFFF)
        else:
            self._word(address, value)

    def _stream_size(self, value, now):
        old = self._word(wire.SC_SIZE) & 0xFFFF
        size = value & 0xFFFF
        if size != old:
            if self.acquiring:
                raise Refusal(wire.WRITE_PROTECT)
            size = min(max(size & ~3, 576), self.mtu)  # no source: a size between is taken down to the next
        self._word(wire.SC_SIZE, value & wire.DO_NOT_FRAGMENT | size)
        if value & wire.FIRE_TEST:
            frame = Frame(now, 0.0, "test")
            frame.leader, frame.packet_size = bytes(size - wire.UDP_OVERHEAD), size
            self._queue.append(Transmission(frame, [0], now, 0.0))

    def _privilege(self, value, now, peer):
        wanted = value & (wire.CCP_CONTROL | wire.CCP_EXCLUSIVE)
        if wanted:
            if self.controller is None:
                self.tell(now, "controller", list(peer))
            self.controller, self._exclusive = peer, bool(wanted & wire.CCP_EXCLUSIVE)
            self._last_heard = now
            self._word(wire.OWNER_PORT, peer[1])
        elif self.controller:
            self._release(now, "released")

    def _heartbeat_end(self):
        return self._last_heard + self._word(wire.HEARTBEAT) * 1e-3

    def _lose_heartbeat(self, now):
        self.heartbeats_lost += 1
        self._release(now, "heartbeat lost")

    def _release(self, now, why):
        """The privilege falls; the stream ends with it. no source at hand but memory that the acquisition stops too"""
        self.controller, self._exclusive = None, False
        self.tell(now, "controller", why)
        self._stop(now, True)
        self._word(wire.SC_PORT, 0)
        self._word(wire.OWNER_PORT, 0)

    def occupy(self, now, seconds):
        """As if another program, which dies at once, had taken control; its heartbeat ends after these seconds."""
        self.advance(now)
        if self.controller is not None:
            raise Refused("the camera is controlled already")
        self.controller = ("203.0.113.1", 1)
        self._last_heard = now + seconds - self._word(wire.HEARTBEAT) * 1e-3
        self.tell(now, "controller", list(self.controller))

    # -- features ----------------------------------------------------------------------------------------------

    def get(self, name, slot=0):
        """The value of a feature, whatever its age."""
        return self.values[name][slot]

    def _encoded(self, feature, slot, now):
        reader = getattr(self, "_read_" + feature.name, None)
        if feature.name in gf.OLD:
            name, factor = gf.OLD[feature.name]
            reader = getattr(self, "_read_" + name, None)
            value = reader(slot, now) if reader else self.values[name][slot]
            value = value if feature.kind == "float" else round(value * factor)
        else:
            value = reader(slot, now) if reader else self.values[feature.name][slot]
        if feature.kind == "float":
            return struct.pack(">d", value)
        return struct.pack(">Q" if feature.size() == 8 else ">I", int(value) & (1 << 8 * feature.size()) - 1)

    @staticmethod
    def _decoded(feature, data):
        if feature.kind == "float":
            return struct.unpack(">d", data)[0]
        return int.from_bytes(data, "big")

    def limits(self, name):
        """(least, most, step) of a feature as it is now."""
        feature = self.features_by_name[name]
        spans = {
            "Width": lambda: (self.width_step, self.sensor_width - self.get("OffsetX")),
            "Height": lambda: (self.height_step, self.sensor_height - self.get("OffsetY")),
            "OffsetX": lambda: (0, self.sensor_width - self.get("Width")),
            "OffsetY": lambda: (0, self.sensor_height - self.get("Height")),
            "AcquisitionFrameRate": lambda: (0.1, 1 / self._least_period()),
        }
        least, most = spans[name]() if name in spans else (feature.least, feature.most)
        return least, most, feature.step

    def _write_feature(self, feature, slot, value, now):
        """Checks a value and takes it."""
        if feature.access == "RO":
            raise Refusal(wire.WRITE_PROTECT)
        if feature.kind == "command":
            if feature.still and self.acquiring:
                raise Refusal(wire.WRITE_PROTECT)
            self.tell(now, "command", feature.name)
            getattr(self, "_command_" + feature.name)(slot, now)
            return
        if feature.name in gf.OLD:
            name, factor = gf.OLD[feature.name]
            feature, value = self.features_by_name[name], value / factor
        if feature.still and self.acquiring or feature.auto and self.get(feature.auto):
            if self.locked_write == "ignore":
                return
            raise Refusal(wire.WRITE_PROTECT)  # no source: which status a locked feature gives
        value = self._checked(feature, value)
        if feature.name in ("LineMode", "LineSource") and slot == 0 and value != 0:
            raise Refusal(wire.INVALID_PARAMETER)  # Line1 is an input and nothing else
        self._take(feature.name, slot, value, now)

    def _checked(self, feature, value):
        least, most, step = self.limits(feature.name)
        if feature.kind == "enum" and value not in feature.entries.values():
            raise Refusal(wire.INVALID_PARAMETER)
        if feature.kind == "bool" and value not in (0, 1):
            raise Refusal(wire.INVALID_PARAMETER)
        if feature.kind == "float" and not math.isfinite(value):
            raise Refusal(wire.INVALID_PARAMETER)
        beyond = least is not None and value < least or most is not None and value > most
        between = step and (value - least) % step
        if (beyond or between) and self.out_of_range == "refuse":
            raise Refusal(wire.INVALID_PARAMETER)
        if beyond or between:
            value = min(max(value, least), most)
            value -= (value - least) % step if step else 0
        steps = {"ExposureTime": self.exposure_step, "Gain": self.gain_step}
        if feature.name in steps:
            value = round(round(value / steps[feature.name]) * steps[feature.name], 6)
        return value

    def _take(self, name, slot, value, now):
        if self.values[name][slot] != value:
            self.values[name][slot] = value
            self.tell(now, name, value if len(self.values[name]) == 1 else [slot, value])
        if name in ("ExposureAuto", "GainAuto", "BalanceWhiteAuto"):
            self._once[name] = 8  # no source: pictures that "Once" takes
        if name == "PtpEnable":
            self._set_ptp(value, now)
        if name in ("LineSource", "LineInverter", "LineMode", "UserOutputValue"):
            self._outputs(now)
        if name in ("TriggerMode", "TriggerSource") and self.acquiring:
            self._continue(now)

    # What is computed when it is read

    def _read_PayloadSize(self, _, now):
        return self._payload_size()

    def _read_AcquisitionFrameRateMax(self, _, now):
        return 1 / self._least_period()

    def _read_ResultingFrameRate(self, _, now):
        return 1 / self._period()

    def _read_PtpStatus(self, _, now):
        return gf.PTP_STATES.index(self.ptp_state)

    def _read_PtpOffsetFromMaster(self, _, now):
        return round(self.ptp_error * NS) if self.ptp_state == "Slave" else 0

    def _read_LineStatus(self, slot, now):
        return self._levels() >> slot & 1

    def _read_LineStatusAll(self, _, now):
        return self._levels()

    # Commands

    def _command_DeviceReset(self, _, now):
        answers = self._out  # the answer to this command still goes out
        self._out = []
        self.power_cycle(now)
        self._out = answers

    def _command_UserSetLoad(self, _, now):
        self._load(gf.SETS[self.get("UserSetSelector")])

    def _command_UserSetSave(self, _, now):
        name = gf.SETS[self.get("UserSetSelector")]
        if name == "Default":
            raise Refusal(wire.WRITE_PROTECT)  # SFNC: the factory's set can only be read
        self.sets[name] = {each: list(value) for each, value in self.values.items()}

    def _load(self, name):
        self.user_set_default = self.values["UserSetDefault"][0]
        for each, value in self.sets.get(name, self.sets["Default"]).items():
            feature = self.features_by_name.get(each)
            if feature is not None and feature.lasting and feature.access != "RO" and each in self.values:
                self.values[each] = list(value)

    def _command_AcquisitionStart(self, _, now):
        if self.acquiring:
            return
        self.acquiring = True
        self._round += 1
        if self.restart_ids == "start":
            self._block = 0
        mode = self.get("AcquisitionMode")
        self._frames_left = None if mode == 0 else 1 if mode == 1 else self.get("AcquisitionFrameCount")
        self._waits_for_start = True
        self.tell(now, "acquiring", True)
        self._continue(now)

    def _command_AcquisitionStop(self, _, now):
        self._stop(now, False)

    def _command_AcquisitionAbort(self, _, now):
        self._stop(now, True)

    def _command_TriggerSoftware(self, slot, now):
        if self.get("TriggerSource", slot) == 0:
            self._trigger(slot, "Software", now)
        else:
            self._ignore(now, "source")

    # -- exposures ---------------------------------------------------------------------------------------------

    def _stop(self, now, abort):
        if self.acquiring:
            self.tell(now, "acquiring", False)
        self.acquiring = False
        self._round += 1
        # What was exposed is still read out and sent, unless the acquisition is aborted.
        kept = ("ptp",) if abort else ("ptp", "finish")
        self._events = [each for each in self._events if each[2] in kept]
        heapq.heapify(self._events)
        if abort:
            self._exposing = 0
            self._queue.clear()
            self._outputs(now)

    def _least_period(self):
        exposure = self.get("ExposureTime") * 1e-6
        return max(exposure + self.exposure_gap, self.get("Height") * self.line_time)

    def _period(self):
        least = self._least_period()
        if self.get("AcquisitionFrameRateEnable"):
            return max(least, 1 / self.get("AcquisitionFrameRate"))
        return least

    def _continue(self, now):
        """Starts what may start: the acquisition, or free running."""
        if self._waits_for_start:
            if self.get("TriggerMode", 0):
                return
            self._waits_for_start = False
        self._round += 1
        if not self.get("TriggerMode", 1):
            self._at(max(now + self.start_latency, self._ready_at), "expose", self._round)

    def _event_expose(self, now, round_number):
        if self.acquiring and round_number == self._round:
            self._expose(now, "free")
            if self.acquiring:
                self._at(now + self._period(), "expose", self._round)

    def _trigger(self, slot, cause, now):
        """An edge of a trigger's source; slot 0 starts the acquisition, slot 1 a frame."""
        if not self.acquiring or not self.get("TriggerMode", slot):
            self._ignore(now, "not armed")
            return
        self._at(now + self.get("TriggerDelay", slot) * 1e-6, "trigger", slot, cause)

    def _event_trigger(self, now, slot, cause):
        if not self.acquiring:
            return
        if slot == 0:
            if self._waits_for_start:
                self._waits_for_start = False
                self._continue(now)
            return
        if self._waits_for_start or now < self._ready_at:
            self._ignore(now, "busy")
            return
        self.triggers += 1
        self._expose(now, cause)

    def _ignore(self, now, why):
        self.triggers_ignored += 1
        self.tell(now, "trigger ignored", why)

    def _expose(self, now, cause):
        frame = Frame(now, self.get("ExposureTime") * 1e-6, cause)
        self._ready_at = now + self._least_period()
        self.exposures += 1
        self._exposing += 1
        self._outputs(now)
        frame.lines = self._levels()
        frame.view = self._view()
        frame.gain = self.get("Gain")
        frame.settings = (self.get("BlackLevel"), self.get("Gamma"), self._balance())
        frame.clock = self.clock(now)
        if self._frames_left is not None:
            self._frames_left -= 1
            if self._frames_left == 0:
                self.tell(now, "acquiring", False)
                self.acquiring = False
        self._at(frame.end, "finish", frame)

    def _balance(self):
        return tuple(self.values["BalanceRatio"]) if self.color else (1.0, 1.0, 1.0)

    def _view(self):
        region = tuple(self.get(name) for name in ("OffsetX", "OffsetY", "Width", "Height"))
        flips = bool(self.get("ReverseX")), bool(self.get("ReverseY"))
        sensor = self.sensor_width, self.sensor_height
        return scene.View(sensor, region, scene.NUMBERS[self.get("PixelFormat")], flips)

    def _event_finish(self, now, frame):
        """The end of an exposure."""
        self._exposing = max(self._exposing - 1, 0)
        self._outputs(now)
        lit = self.lamp.overlap(frame.start, frame.end)
        read_out = now + frame.view.height * self.line_time
        stamped = {"start": frame.start, "end": frame.end, "readout": read_out}[self.stamp_at]
        frame.ticks = self.clock_ticks(stamped) if self.frequency() else 0
        frame.start_ticks = self.clock_ticks(frame.start) if self.frequency() else 0
        self._block = self._next_block()
        frame.block = self._block
        lost = self._frame_lost()
        self.tell(now, "frame", {
            "block": frame.block, "start_ns": self._ns(frame.start), "end_ns": self._ns(frame.end),
            "ticks": frame.ticks, "exposure_us": frame.exposure * 1e6, "gain_db": frame.gain, "cause": frame.cause,
            "lit": lit, "lost": lost, "strip": int(frame.clock * 1e6) & 0xFFFFFFFF,
        })
        if lost:
            self.frames_lost += 1
        elif self._word(wire.SC_PORT) and not self.unplugged:
            self._make_picture(frame, lit)
            self._send(frame, read_out)
        self._automatics(frame, now)

    def _next_block(self):
        if self._block == 0:
            return self.first_block
        if self.wide_ids:
            return self._block + 1
        return self._block % 65535 + 1  # F: 1 to 65535, never 0

    def _frame_lost(self):
        if self.lose_frames > 0:
            self.lose_frames -= 1
            return True
        return self.frame_loss > 0 and self.random.random() < self.frame_loss

    def _automatics(self, frame, now):
        """Automatic exposure, gain and white balance, which never come quite to rest. no source: makers' own laws"""
        factor = 10 ** (self.get("Gain") / 20)
        bright = self.ambient * self.get("ExposureTime") * 1e-6 * factor
        self._hunt = 1.03 if self._hunt < 1 else 0.97
        push = (self.auto_target / max(bright, 1e-6)) ** 0.5 * self._hunt
        if self.get("ExposureAuto"):
            wanted = round(self.get("ExposureTime") * push / self.exposure_step) * self.exposure_step
            self.values["ExposureTime"][0] = min(max(wanted, 20.0), 3e4)
        elif self.get("GainAuto"):
            wanted = self.get("Gain") + 20 * math.log10(push)
            self.values["Gain"][0] = min(max(round(wanted, 2), 0.0), 24.0)
        if self.color and self.get("BalanceWhiteAuto"):
            for slot, letter in enumerate("RGB"):
                ratio = self.values["BalanceRatio"][slot]
                wanted = scene.COLORS["G"] / scene.COLORS[letter]
                self.values["BalanceRatio"][slot] = ratio + 0.2 * (wanted * self._hunt - ratio)
        for name in ("ExposureAuto", "GainAuto", "BalanceWhiteAuto"):
            if name in self.values and self.get(name) == 1:
                self._once[name] = self._once.get(name, 8) - 1
                if self._once[name] <= 0:
                    self.put_feature(name, 0, now)

    def put_feature(self, name, value, now):
        """Changes a feature from within the camera."""
        self.values[name][0] = value
        self.tell(now, name, value)

    # -- lines -------------------------------------------------------------------------------------------------

    def _levels(self):
        """Levels of Line1 (bit 0) and Line2 (bit 1)."""
        second = False
        if self.get("LineMode", 1) == 1:
            source = self.get("LineSource", 1)
            second = source == 1 and self._exposing > 0 or source == 2 and bool(self.get("UserOutputValue"))
        first = bool(self.line1) != bool(self.get("LineInverter", 0))
        return int(first) | int(bool(second) != bool(self.get("LineInverter", 1))) << 1

    def _outputs(self, now):
        """Tells the wires on Line2 when its level has changed."""
        level = bool(self._levels() & 2)
        if level != getattr(self, "_line2", None):
            self._line2 = level
            for listener in self.listeners:
                listener("Line2", level, now)

    def line(self, level, now):
        """The level on the wire at Line1."""
        self.advance(now)
        before = self._levels() & 1
        self.line1 = bool(level)
        after = self._levels() & 1
        if before == after:
            return
        for slot in range(len(gf.TRIGGERS)):
            edges = ((1,), (0,), (0, 1))[self.get("TriggerActivation", slot)]
            if self.get("TriggerMode", slot) and self.get("TriggerSource", slot) == 1 and after in edges:
                self._trigger(slot, "Line1", now)

    # -- PTP ---------------------------------------------------------------------------------------------------

    def _set_ptp(self, on, now):
        self._events = [each for each in self._events if each[2] != "ptp"]
        heapq.heapify(self._events)
        self.ptp_state = "Listening" if on else "Disabled"
        if on:
            self._at(now + self.ptp_lock_time / 2, "ptp", "Uncalibrated")
            self._at(now + self.ptp_lock_time, "ptp", "Slave")

    def _event_ptp(self, now, state):
        self.ptp_state = state
        self._ptp_step = now
        self.tell(now, "ptp", state)

    # -- pictures and packets ----------------------------------------------------------------------------------

    def _chunks(self):
        return [name for slot, name in enumerate(gf.CHUNKS) if self.get("ChunkEnable", slot)]

    def _payload_size(self):
        view = self._view()
        size = view.pitch * view.height
        if self.get("ChunkModeActive"):
            size += -size % 4 + 8 + sum(gf.CHUNKS[name][1] + 8 for name in self._chunks())
        return size

    def _make_picture(self, frame, lit):
        """The bytes of a frame: picture, chunks, leader and trailer."""
        view, (black, gamma, balance) = frame.view, frame.settings
        gain = 10 ** (frame.gain / 20)
        look = scene.Look(self.ambient, frame.exposure, gain, black, gamma, balance)
        lamp = (self.lamp_left, self.lamp_top, self.lamp_side, self.lamp_level * lit * gain) if self.lamp_side else None
        dot = None
        if self.dot_period > 0:
            turn = frame.clock / self.dot_period % 1.0
            dot = int(turn * (self.sensor_width - scene.DOT)), self.sensor_height // 2
        strip = int(frame.clock * 1e6) & 0xFFFFFFFF if self.strip else None
        image = self.painter.picture(view, look, lamp, dot, strip)
        shown = view.true_format() if self.bayer_name == "picture" else view.format
        place = (scene.FORMATS[shown][0], view.width, view.height, view.region[0], view.region[1])
        kind, layout = wire.IMAGE, 0
        if self.get("ChunkModeActive"):
            kind = {"image": wire.IMAGE_WITH_CHUNKS, "extended": wire.EXTENDED_CHUNK,
                    "chunk": wire.CHUNK}[self.chunk_payload]
            image, layout = self._with_chunks(image, frame)
        frame.payload = memoryview(image)
        leader = wire.chunk_leader(frame.ticks) if kind == wire.CHUNK else wire.image_leader(kind, frame.ticks, *place)
        frame.leader = leader
        frame.trailer = wire.trailer(kind, view.height, len(image), layout)
        frame.packet_size = self._word(wire.SC_SIZE) & 0xFFFF

    def _with_chunks(self, image, frame):
        """The picture as the first chunk, then the others. no source: the picture's chunk is filled up to four bytes"""
        names = self._chunks()
        values = {
            # CT: of the frame's start, whatever the leader's stamp is of; BA: in ticks
            "Timestamp": struct.pack(">Q", frame.start_ticks), "ExposureTime": struct.pack(">d", frame.exposure * 1e6),
            "FrameID": struct.pack(">Q", frame.block), "Gain": struct.pack(">d", frame.gain),
            "LineStatusAll": struct.pack(">I", frame.lines),
        }
        whole = wire.chunk(gf.CHUNK_IMAGE, bytes(image) + bytes(-len(image) % 4))
        for name in names:
            whole += wire.chunk(gf.CHUNKS[name][0], values[name])
        return whole, sum(1 << slot for slot, name in enumerate(gf.CHUNKS) if name in names)

    def _delay(self):
        if self.jitter == "uniform":
            return self.random.uniform(0.0, self.jitter_time)
        if self.jitter == "exponential":
            return self.random.expovariate(1 / self.jitter_time)
        if self.jitter == "mostly":
            return self.random.uniform(0.0, 0.2e-3 if self.random.random() < 0.9 else self.jitter_time)
        return 0.0

    def _send(self, frame, when):
        """Queues a frame's packets, in order behind those before."""
        order = list(range(frame.packets(self.wide_ids)))
        if self.reorder or self.duplicate:
            for at in range(len(order) - 1):
                if self.random.random() < self.reorder:
                    order[at], order[at + 1] = order[at + 1], order[at]
            order = [each for number in order
                     for each in [number] * (2 if self.random.random() < self.duplicate else 1)]
        due = max(when + self._delay(), self._last_due)
        self._last_due = due
        frequency = self.frequency() or NS
        spacing = self._word(wire.SC_DELAY) / frequency
        if self.link_rate > 0:
            spacing = max(spacing, frame.packet_size * 8 / self.link_rate)
        self._queue.append(Transmission(frame, order, due, spacing))
        self._kept[frame.block] = frame
        while len(self._kept) > self.resend_depth:
            self._kept.popitem(last=False)

    def stream(self, now):
        """The stream's packets that are due: (list of buffers, peer)."""
        self.advance(now)
        while self._queue:
            sent = self._queue[0]
            if sent.due + sent.at * sent.spacing > now:
                return
            if sent.at >= len(sent.order):
                self._queue.popleft()
                self._sent(sent, now)
                continue
            if sent.began is None:
                sent.began = now
            number = sent.order[sent.at]
            sent.at += 1
            if self._passes(sent):
                self.packets_sent += 1
                yield self._packet(sent.frame, number, sent.status), self._peer()
            else:
                sent.dropped += 1
                self.packets_lost += 1

    def _passes(self, sent):
        if self.unplugged or not self._word(wire.SC_PORT):
            return False
        if 0 < self.path_mtu < sent.frame.packet_size:
            return False
        if sent.frame.cause == "test":
            return True
        loss = self.packet_loss if sent.status == wire.SUCCESS else self.resend_loss
        return loss <= 0 or self.random.random() >= loss

    def _sent(self, sent, now):
        if sent.status == wire.SUCCESS and sent.frame.cause != "test":
            self.frames_sent += 1
            self.tell(now, "sent", {"block": sent.frame.block, "first_ns": self._ns(sent.began or now),
                                    "last_ns": self._ns(now), "due_ns": self._ns(sent.due),
                                    "packets": len(sent.order), "dropped": sent.dropped})

    def _peer(self):
        address = self._word(wire.SC_ADDRESS)
        return ".".join(str(address >> shift & 0xFF) for shift in (24, 16, 8, 0)), self._word(wire.SC_PORT) & 0xFFFF

    def _packet(self, frame, number, status):
        """One packet of a frame as buffers to be sent together."""
        if frame.cause == "test":
            return [frame.leader]  # ARV test_packet_check: only its size counts
        if status not in (wire.SUCCESS, wire.PACKET_RESENT):
            return [wire.stream_header(status, frame.block, wire.PAYLOAD, number, self.wide_ids)]
        if number == 0:
            return [wire.stream_header(status, frame.block, wire.LEADER, 0, self.wide_ids), frame.leader]
        size = wire.data_size(frame.packet_size, self.wide_ids)
        start = (number - 1) * size
        if start >= len(frame.payload):
            return [wire.stream_header(status, frame.block, wire.TRAILER, number, self.wide_ids), frame.trailer]
        head = wire.stream_header(status, frame.block, wire.PAYLOAD, number, self.wide_ids)
        return [head, frame.payload[start:start + size]]

    def _resend(self, flags, payload, peer, now):
        """PACKETRESEND: channel, block, first, last; wide ids: the block of 64 bits at the end. ARV, WC"""
        wide = bool(flags & wire.FLAG_EXTENDED)
        if len(payload) < (20 if wide else 12):
            return
        _, block, first, last = struct.unpack_from(">HHII", payload)
        if wide:
            (block,) = struct.unpack_from(">Q", payload, 12)
        else:
            first, last = first & 0xFFFFFF, last & 0xFFFFFF
        self.resend_requests += 1
        self.tell(now, "resend", [block, first, last])
        frame = self._kept.get(block)
        if self.resend in ("silent", "absent") or peer[0] != self._peer()[0]:
            return
        status = wire.PACKET_RESENT  # WC; no source: many cameras resend with status 0
        if frame is None or self.resend == "refuses":
            frame = frame or Frame(now, 0.0, "gone")
            frame.block, status = block, wire.PACKET_UNAVAILABLE
            frame.packet_size = self._word(wire.SC_SIZE) & 0xFFFF
            last = first
        else:
            last = min(last, frame.packets(self.wide_ids) - 1)
        order = list(range(first, last + 1))
        self.packets_resent += len(order) if status == wire.PACKET_RESENT else 0
        self._insert(Transmission(frame, order, now + self.resend_delay, 0.0, status))

    def _insert(self, resent):
        """Puts a resent packet before frames that have not begun."""
        at = 0
        while at < len(self._queue) and (self._queue[at].at or self._queue[at].due <= resent.due):
            at += 1
        self._queue.insert(at, resent)


DOUBLE = GigeCamera
