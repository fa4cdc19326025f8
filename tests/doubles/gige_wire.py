"""Packets of GigE Vision: the control protocol GVCP and the stream protocol GVSP, as bytes. Everything is big-endian.

Sources, named by their letters at the lines below:
  WC    Wireshark's epan/dissectors/packet-gvcp.c, given by the AIA, who keep the standard
  WS    Wireshark's epan/dissectors/packet-gvsp.c, likewise
  ARV   Aravis 0.8.26, src/arvgvcp*.h, arvgvsp*.h, arvgvstream.c, arvgvdevice.c: what the host sends and takes
SPDX-License-Identifier: Apache-2.0
"""

import struct

PORT = 3956  # WC global_gvcp_port
KEY = 0x42  # ARV ARV_GVCP_PACKET_TYPE_CMD; WC message key code
HEADER = struct.Struct(">BBHHH")  # key, flags, command, length of the payload, request id

# WC "Command and acknowledge IDs"; the acknowledge of a command is the next number
DISCOVERY, FORCE_IP, RESEND = 0x0002, 0x0004, 0x0040
READ_REGISTER, WRITE_REGISTER, READ_MEMORY, WRITE_MEMORY = 0x0080, 0x0082, 0x0084, 0x0086
PENDING_ACK = 0x0089

FLAG_ACK = 0x01  # ARV ACK_REQUIRED
FLAG_EXTENDED = 0x10  # ARV EXTENDED_IDS: block ids of 64 bits in a resend request

# WC "GVCP statuses"
SUCCESS = 0x0000
PACKET_RESENT = 0x0100
NOT_IMPLEMENTED = 0x8001
INVALID_PARAMETER = 0x8002
INVALID_ADDRESS = 0x8003
WRITE_PROTECT = 0x8004
BAD_ALIGNMENT = 0x8005
ACCESS_DENIED = 0x8006
BUSY = 0x8007
PACKET_UNAVAILABLE = 0x800C
INVALID_HEADER = 0x800E

# WC bootstrap registers
VERSION, DEVICE_MODE, MAC_HIGH, MAC_LOW = 0x0000, 0x0004, 0x0008, 0x000C
IP_SUPPORTED, IP_CURRENT = 0x0010, 0x0014
IP_ADDRESS, IP_MASK, IP_GATEWAY = 0x0024, 0x0034, 0x0044
VENDOR, MODEL, DEVICE_VERSION, VENDOR_INFO = 0x0048, 0x0068, 0x0088, 0x00A8
SERIAL, USER_NAME = 0x00D8, 0x00E8
DISCOVERY_SIZE = 0xF8  # ARV ARV_GVBS_DISCOVERY_DATA_SIZE
URL_FIRST, URL_SECOND, URL_SIZE = 0x0200, 0x0400, 512
INTERFACES = 0x0600
PERSISTENT_IP, PERSISTENT_MASK, PERSISTENT_GATEWAY, LINK_SPEED = 0x064C, 0x065C, 0x066C, 0x0670
MESSAGE_CHANNELS, STREAM_CHANNELS = 0x0900, 0x0904
STREAM_CAPABILITY, CAPABILITY = 0x092C, 0x0934
HEARTBEAT = 0x0938
TICKS_HIGH, TICKS_LOW, TIME_CONTROL, TIME_HIGH, TIME_LOW = 0x093C, 0x0940, 0x0944, 0x0948, 0x094C
CONFIGURATION, PENDING_TIMEOUT = 0x0954, 0x0958
PTP_STATUS = 0x096C
CCP, OWNER_PORT, OWNER_ADDRESS = 0x0A00, 0x0A04, 0x0A14
SC_PORT, SC_SIZE, SC_DELAY, SC_ADDRESS = 0x0D00, 0x0D04, 0x0D08, 0x0D18
SC_SOURCE, SC_CAPABILITY, SC_CONFIGURATION = 0x0D1C, 0x0D20, 0x0D24

CCP_EXCLUSIVE, CCP_CONTROL = 1, 2  # ARV CONTROL_CHANNEL_PRIVILEGE_*
CAN_CONCATENATE, CAN_WRITE_MEMORY, CAN_RESEND, CAN_PENDING = 1, 2, 4, 32  # ARV GVCP_CAPABILITY_*
CAN_PTP = 1 << 19  # no source: the bit of IEEE 1588 among the capabilities, from memory
HAS_SERIAL, HAS_NAME = 1 << 30, 1 << 31  # ARV
FIRE_TEST, DO_NOT_FRAGMENT = 1 << 31, 1 << 30  # ARV STREAM_CHANNEL_0_PACKET_*
TIME_RESET, TIME_LATCH = 1, 2  # WC hf_gvcp_timestamp_control_reset, _latch

MOST_BYTES = 536  # no source: the most that one READMEM or WRITEMEM moves, from memory; Aravis asks for 512 at most


class NotGvcp(ValueError):
    """Bytes that are no GVCP command; a device does not answer them."""


def command(packet):
    """Takes a command apart: (flags, command, request id, payload)."""
    if len(packet) < HEADER.size:
        raise NotGvcp("shorter than a header")
    key, flags, number, length, request = HEADER.unpack_from(packet)
    if key != KEY:
        raise NotGvcp(f"key {key:#x}")
    if length > len(packet) - HEADER.size:
        raise NotGvcp("shorter than it says")
    return flags, number, request, bytes(packet[HEADER.size:HEADER.size + length])


def order(number, request, payload=b"", flags=FLAG_ACK):
    """A command as a host makes it."""
    return HEADER.pack(KEY, flags, number, len(payload), request) + payload


def answer(number, request, payload=b"", status=SUCCESS):
    """An acknowledge; number is the acknowledge's own."""
    return struct.pack(">HHHH", status, number, len(payload), request) + payload


# -- GVSP ------------------------------------------------------------------------------------------------------

LEADER, TRAILER, PAYLOAD = 1, 2, 3  # WS GVSP_PACKET_*
IMAGE, CHUNK, EXTENDED_CHUNK = 0x0001, 0x0004, 0x0005  # WS GVSP_PAYLOAD_*
IMAGE_WITH_CHUNKS = 0x4001  # WS "IMAGE (v2.0 chunks)"
UDP_OVERHEAD = 28  # ARV ARV_GVSP_PACKET_UDP_OVERHEAD: the packet size counts IP and UDP headers

_SHORT = struct.Struct(">HHI")
_LONG = struct.Struct(">HHIQI")


def stream_header(status, block, kind, packet, wide=False):
    """The head of a GVSP packet. ARV ArvGvspHeader, ArvGvspExtendedHeader: bit 31 says that the ids are wide."""
    if wide:
        return _LONG.pack(status, 0, 1 << 31 | kind << 24, block, packet)
    return _SHORT.pack(status, block, kind << 24 | packet & 0xFFFFFF)


def header_size(wide=False):
    """Bytes of the head."""
    return _LONG.size if wide else _SHORT.size


def data_size(packet_size, wide=False):
    """Bytes of picture in a packet of this size."""
    return packet_size - UDP_OVERHEAD - header_size(wide)


def image_leader(payload_type, ticks, pixel_format, width, height, x, y):
    """WS dissect_image_leader, dissect_extended_chunk_data_leader: 36 bytes; without padding."""
    return struct.pack(">HHQIIIIIHH", 0, payload_type, ticks, pixel_format, width, height, x, y, 0, 0)


def chunk_leader(ticks):
    """WS dissect_chunk_data_leader: 12 bytes; says nothing of the picture."""
    return struct.pack(">HHQ", 0, CHUNK, ticks)


def trailer(payload_type, height, length, layout):
    """The trailer of each payload type; length: bytes of payload; layout: a number that changes with the chunks."""
    head = struct.pack(">HH", 0, payload_type)
    if payload_type == IMAGE:
        return head + struct.pack(">I", height)  # WS dissect_image_trailer
    if payload_type == IMAGE_WITH_CHUNKS:
        return head + struct.pack(">III", height, length, layout)  # WS dissect_extra_chunk_info behind it
    if payload_type == CHUNK:
        return head + struct.pack(">I", length)  # WS dissect_chunk_data_trailer
    return head + struct.pack(">III", length, height, layout)  # WS dissect_extended_chunk_data_trailer


def chunk(number, data):
    """A chunk: its data, then its id and length. ARV arv_buffer_get_chunk_data reads them from the end."""
    return bytes(data) + struct.pack(">II", number, len(data))
