"""Puts doubles of GigE Vision cameras on the network (UDP port 3956 of an address of the loopback net each).

  gige_serve.py [--camera ADDRESS[,k=v...]]... [--option k=v]... [--wire N:Line1=M:Line2 | N:Line1=clock]...
                [--clock HZ] [--seconds N] [--log FILE]

Prints one line with the cameras' addresses, then answers each JSON command on its standard input with one JSON line.
--option holds for all cameras, k=v behind an address for one. README.md describes the commands.
SPDX-License-Identifier: Apache-2.0
"""

import argparse
import json
import re
import select
import socket
import time

from double import Refused
from ends import OrderInput, book, serving
from gige_camera import GigeCamera
import gige_wire as wire
from serve import Orders, earliest

BROADCAST = "255.255.255.255"
NS = 1_000_000_000


class Clock:
    """A generator of pulses of half a period, at exact times."""

    def __init__(self, rate, now):
        self.rate, self.start, self.edge = rate, now, 0

    def next(self):
        """The time of the next edge, or None."""
        return self.start + (self.edge + 1) / (2 * self.rate) if self.rate > 0 else None


class Bench:
    """Cameras, the wires between them, one lamp in the sight of all and one generator; goes through time in order."""

    def __init__(self, cameras, origin_ns):
        self.cameras, self.origin_ns = cameras, origin_ns
        self.wires = []  # (camera's number, camera's number or "clock")
        self.clock = Clock(0.0, 0.0)
        self.history = []
        epoch = time.time() - (time.monotonic_ns() - origin_ns) / NS
        for number, camera in enumerate(cameras):
            camera.origin_ns, camera.epoch = origin_ns, epoch
            camera.lamp = cameras[0].lamp
            camera.listeners.append(lambda line, level, when, source=number: self._spread(source, level, when))

    def wire(self, text):
        """Lays a wire: "1:Line1=0:Line2" or "1:Line1=clock"."""
        sink, mark, source = text.partition("=")
        number, _, line = sink.partition(":")
        at, _, output = source.partition(":")
        names = [str(each) for each in range(len(self.cameras))]
        if not mark or line != "Line1" or number not in names:
            raise Refused(f"wire '{text}' is not N:Line1=M:Line2 or N:Line1=clock")
        if source != "clock" and (at not in names or output != "Line2"):
            raise Refused(f"wire '{text}': an output is M:Line2 or clock")
        self.wires.append((int(number), "clock" if source == "clock" else int(at)))

    def _spread(self, source, level, when):
        for sink, origin in self.wires:
            if origin == source:
                self.cameras[sink].line(level, when)

    def next(self):
        """When there will be something to do."""
        return earliest(self.clock.next(), *(each.next() for each in self.cameras))

    def advance(self, now):
        """Carries out what is due, in the order of time over all cameras and the generator."""
        while True:
            event = earliest(self.clock.next(), *(each.next_event() for each in self.cameras))
            if event is None or event > now:
                break
            if event == self.clock.next():
                self._tick(event)
                continue
            busy = [each for each in self.cameras if each.next_event() is not None]
            min(busy, key=GigeCamera.next_event).advance(event)
        for camera in self.cameras:
            camera.advance(now)

    def _tick(self, when):
        self.clock.edge += 1
        rising = self.clock.edge % 2 == 1
        if rising:
            self.history.append([when, "pulse", self.origin_ns + round(when * NS)])
        self._spread("clock", rising, when)


class BenchOrders(Orders):
    """The JSON commands; {"camera": 1, ...} beside a command speaks to another camera than the first."""

    def __init__(self, bench):
        self.bench = bench
        super().__init__(bench.cameras[0], None)

    def obey(self, text, now):
        """Picks the camera, then carries out the line."""
        try:
            order = json.loads(text)
        except ValueError as error:
            return {"error": str(error)}
        self.double = self.bench.cameras[0]
        if isinstance(order, dict) and len(order) > 1 and "camera" in order:
            number = order.pop("camera")
            if not isinstance(number, int) or not 0 <= number < len(self.bench.cameras):
                return {"error": f"no camera {number}"}
            self.double = self.bench.cameras[number]
        self.bench.advance(now)
        return super().obey(json.dumps(order), now)

    def do_unplug(self, value, now):
        """Pulls the network cable."""
        self.double.arrange(now, unplugged=True)

    def do_plug(self, value, now):
        """Puts the cable in again."""
        self.double.arrange(now, unplugged=False)
        return {"link": self.double.address}

    def do_lamp(self, value, now):
        """Switches the lamp; tells when."""
        self.bench.cameras[0].lamp.switch(bool(value), now)
        self.bench.history.append([now, "lamp", bool(value)])
        return {"at_ns": self.bench.origin_ns + round(now * NS)}

    def do_flash(self, value, now):
        """Lights the lamp: {"after": seconds, "for": seconds}; tells when it begins."""
        start = now + float(value.get("after", 0.0))
        self.bench.cameras[0].lamp.flash(start, float(value["for"]))
        self.bench.history.append([start, "flash", float(value["for"])])
        return {"at_ns": self.bench.origin_ns + round(start * NS)}

    def do_clock(self, value, now):
        """Sets the generator's rate in Hz; 0 stops it."""
        self.bench.clock = Clock(float(value), now)

    def do_wire(self, value, now):
        """Lays a wire."""
        self.bench.wire(value)

    def do_occupy(self, value, now):
        """Another program takes control and dies; its heartbeat ends after so many seconds."""
        self.double.occupy(now, float(value))

    def do_bench(self, value, now):
        """The lamp's and the generator's history."""
        return {"history": self.bench.history[value if isinstance(value, int) else 0:]}

    def do_now(self, value, now):
        """Tells the server's time, and what CLOCK_MONOTONIC says then, in nanoseconds."""
        return {"now": now, "monotonic_ns": self.bench.origin_ns + round(now * NS)}


def udp(address, port):
    """A bound socket."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 << 20)
    if address == BROADCAST:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((address, port))
    except OSError as error:
        raise Refused(f"{address}:{port}: {error.strerror}") from error
    made.setblocking(False)
    return made


class Network:
    """The sockets: one for broadcast discovery, and two for each camera."""

    def __init__(self, cameras, log):
        self.cameras, self.log = cameras, log
        heard = any(each.discovery for each in cameras)
        self.broadcast = udp(BROADCAST, wire.PORT) if heard else None
        self.control = [udp(each.address, wire.PORT) for each in cameras]
        self.streams = [udp(each.address, 0) for each in cameras]
        for camera, stream in zip(cameras, self.streams):
            camera.stream_port = stream.getsockname()[1]
        self.unsent = 0

    def sockets(self):
        """What to wait for."""
        return self.control + ([self.broadcast] if self.broadcast else [])

    def take(self, ready, clock):
        """Gives what has arrived to the cameras."""
        for link in ready:
            while True:
                try:
                    packet, peer = link.recvfrom(2048)
                except (BlockingIOError, ConnectionError):
                    break
                now = clock()
                self.log(now, "host", packet)
                sinks = self.cameras if link is self.broadcast else [self.cameras[self.control.index(link)]]
                for camera in sinks:
                    camera.receive(packet, peer, now)

    def give(self, clock):
        """Sends what is due."""
        for camera, control, stream in zip(self.cameras, self.control, self.streams):
            for packet, peer in camera.say(clock()):
                self.log(clock(), "camera", packet)
                self._send(control, [packet], peer)
            for buffers, peer in camera.stream(clock()):
                self._send(stream, buffers, peer)

    def _send(self, link, buffers, peer):
        try:
            link.sendmsg(buffers, [], 0, peer)
        except OSError:  # nobody listens, or no room
            self.unsent += 1


def loop(bench, network, orders, seconds):
    """Serves until the time is over or standard input ends."""

    def clock():
        return (time.monotonic_ns() - bench.origin_ns) / NS

    given = OrderInput(seconds)
    while seconds is None or clock() < seconds:
        wait = earliest(bench.next(), seconds)
        timeout = None if wait is None else max(0.0, wait - clock())
        ready, _, _ = select.select(network.sockets() + given.readable(), [], [], timeout)
        if 0 in ready:
            ready.remove(0)
            if not given.take(lambda line: orders.obey(line, clock())):
                return
        network.take(ready, clock)
        bench.advance(clock())
        network.give(clock)


def make(text, common):
    """A camera from ADDRESS,k=v,..."""
    address, *options = text.split(",")
    if not re.fullmatch(r"\d+\.\d+\.\d+\.\d+", address):
        raise Refused(f"camera '{address}': an address is not four numbers")
    pairs = {"address": address, "serial": f"D{int(address.rsplit('.', 1)[-1]):04d}"}
    for option in common + options:
        name, mark, value = option.partition("=")
        if not mark:
            raise Refused(f"option '{option}' is not name=value")
        pairs[name] = value
    return GigeCamera(**pairs)


def main():
    """Reads the arguments and serves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--camera", action="append", metavar="ADDRESS[,K=V...]")
    parser.add_argument("--option", action="append", default=[], metavar="K=V")
    parser.add_argument("--wire", action="append", default=[], metavar="WIRE")
    parser.add_argument("--clock", type=float, default=0.0, metavar="HZ")
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--log", metavar="FILE")
    given = parser.parse_args()
    log = book(given.log, lambda data: bytes(data[:64]).hex(" "))
    try:
        cameras = [make(each, given.option) for each in given.camera or ["127.0.0.1"]]
        bench = Bench(cameras, time.monotonic_ns())
        for each in given.wire:
            bench.wire(each)
        network = Network(cameras, log)
    except Refused as error:
        parser.error(str(error))
    bench.clock = Clock(given.clock, 0.0)
    with serving(None):
        print(" ".join(each.address for each in cameras), flush=True)
        loop(bench, network, BenchOrders(bench), given.seconds)


if __name__ == "__main__":
    main()
