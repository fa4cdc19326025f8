"""Puts a double of text messages on the network by VXI-11 or by HiSLIP.

  lan_serve.py INSTRUMENT (--vxi11 PORT | --hislip PORT) [--portmap PORT] [--address ADDRESS] [--option k=v ...]
               [--clients N] [--chatty] [--seconds N] [--log FILE]

Port 0 takes a free one. The standards' are 111 for the port mapper (TCP and UDP) and 4880 for HiSLIP. Prints one line:
core=ADDRESS:PORT abort=ADDRESS:PORT portmap=ADDRESS:PORT, or hislip=ADDRESS:PORT; then answers each JSON command on its
standard input with one JSON line, as serve.py.
SPDX-License-Identifier: Apache-2.0
"""

import argparse
import json
import signal
import socket
import sys

from double import Refused
from hislip import Hislip
from lan_instrument import LanInstrument
from serve import Orders, loop, make
from vxi11 import Vxi11


class Network:
    """Listening sockets and their clients; as a link of serve.py it can be unplugged."""

    def __init__(self, address, wanted):
        self.address, self.wanted = address, wanted  # kind -> port
        self.listeners, self.clients, self.datagrams = {}, {}, None
        self.plug()

    def plug(self):
        """Listens; returns the addresses."""
        for kind, port in self.wanted.items():
            listener = socket.socket(socket.AF_INET)
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((self.address, port))
            listener.listen(8)
            self.wanted[kind] = listener.getsockname()[1]
            self.listeners[listener.fileno()] = (listener, kind)
        if "portmap" in self.wanted:
            self.datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.datagrams.bind((self.address, self.wanted["portmap"]))
        return self.name()

    def unplug(self):
        """Closes everything."""
        for each, _ in self.listeners.values():
            each.close()
        for each in list(self.clients.values()):
            each.close()
        if self.datagrams is not None:
            self.datagrams.close()
        self.listeners, self.clients, self.datagrams = {}, {}, None

    def name(self):
        """The addresses, kind by kind."""
        return " ".join(f"{kind}={self.address}:{port}" for kind, port in self.wanted.items())

    def readable(self):
        """File descriptors to wait for."""
        others = [self.datagrams.fileno()] if self.datagrams is not None else []
        return list(self.listeners) + list(self.clients) + others


class LanServer:
    """The protocol between sockets and instrument."""

    def __init__(self, protocol, network, log):
        self.protocol, self.network, self.log = protocol, network, log

    def step(self, now, readable):
        """Takes what has come and gives what is due."""
        network = self.network
        gone = [each for each in self.protocol_channels() if each not in network.clients]
        for each in gone:  # unplugged
            self.protocol.closed(each)
        for descriptor in readable:
            if descriptor in network.listeners:
                listener, kind = network.listeners[descriptor]
                client, _ = listener.accept()
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                network.clients[client.fileno()] = client
                self.protocol.connected(client.fileno(), kind)
            elif descriptor in network.clients:
                self._take(descriptor, now)
            elif network.datagrams is not None and descriptor == network.datagrams.fileno():
                data, peer = network.datagrams.recvfrom(65536)
                self.protocol.connected(peer, "datagram")
                self.protocol.receive(peer, data, now)
        for channel, data in self.protocol.say(now):
            self._give(channel, data, now)

    def protocol_channels(self):
        """Channels on TCP that the protocol knows."""
        return [each for each in self.protocol.buffers if isinstance(each, int)]

    def _take(self, descriptor, now):
        try:
            data = self.network.clients[descriptor].recv(65536)
        except OSError:
            data = b""
        if not data:
            self._close(descriptor)
            return
        self.log(now, "host", data)
        self.protocol.receive(descriptor, data, now)

    def _close(self, descriptor):
        client = self.network.clients.pop(descriptor, None)
        if client is not None:
            client.close()
        self.protocol.closed(descriptor)

    def _give(self, channel, data, now):
        if data is not None:
            self.log(now, "instrument", data)
        if isinstance(channel, tuple):
            if self.network.datagrams is not None:
                self.network.datagrams.sendto(data, channel)
            self.protocol.closed(channel)
        elif data is None:
            self._close(channel)
        elif channel in self.network.clients:
            try:
                self.network.clients[channel].sendall(data)
            except OSError:
                self._close(channel)

    def next(self):
        """When there will be something to do."""
        return self.protocol.next()


def main():
    """Reads the arguments and serves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("instrument")
    parser.add_argument("--option", action="append", default=[], metavar="K=V")
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument("--vxi11", type=int, metavar="PORT")
    kind.add_argument("--hislip", type=int, metavar="PORT")
    parser.add_argument("--portmap", type=int, default=111, metavar="PORT")
    parser.add_argument("--address", default="127.0.0.1")
    parser.add_argument("--clients", type=int, default=2)
    parser.add_argument("--chatty", action="store_true")
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--log", metavar="FILE")
    given = parser.parse_args()
    wanted = {"hislip": given.hislip} if given.vxi11 is None else {"core": given.vxi11, "abort": 0, "portmap": given.portmap}
    try:
        instrument = LanInstrument(make(given.instrument, given.option))
        network = Network(given.address, wanted)
    except (Refused, OSError) as error:
        parser.error(str(error))
    book = open(given.log, "w", encoding="utf-8") if given.log else None

    def log(when, side, data):
        if book:
            print(json.dumps([round(when, 6), side, data[:256].hex(" ")]), file=book, flush=True)

    if given.vxi11 is None:
        protocol = Hislip(instrument, given.clients, given.chatty)
    else:
        protocol = Vxi11(instrument, network.wanted)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    print(network.name(), flush=True)
    try:
        loop(LanServer(protocol, network, log), Orders(instrument.double, network), network, given.seconds)
    except KeyboardInterrupt:
        pass
    finally:
        network.unplug()


if __name__ == "__main__":
    main()
