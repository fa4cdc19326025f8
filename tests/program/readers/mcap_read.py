# Reads an MCAP file by the published specification, checks its CRCs and indexes, and prints {topic: [messages, first, last]}.
# SPDX-License-Identifier: Apache-2.0
import base64, json, struct, sys, zlib

MAGIC = b"\x89MCAP0\r\n"
data = open(sys.argv[1], "rb").read()
assert data[:8] == MAGIC and data[-8:] == MAGIC, "magic"


def records(buffer, at, end):
    while at < end:
        kind, size = struct.unpack_from("<BQ", buffer, at)
        yield at, kind, buffer[at + 9 : at + 9 + size]
        at += 9 + size
    assert at == end, "records do not end where they should"


def text(body, at):
    (size,) = struct.unpack_from("<I", body, at)
    return body[at + 4 : at + 4 + size].decode(), at + 4 + size


footer_at = len(data) - 8 - 20 - 9
kind, size, summary_at, offsets_at, summary_crc = struct.unpack_from("<BQQQI", data, footer_at)
assert (kind, size) == (2, 20), "footer"
assert zlib.crc32(data[summary_at : len(data) - 12]) == summary_crc, "summary CRC"

schemas, channels, messages, chunks, indexed = {}, {}, {}, {}, 0
for at, kind, body in records(data, 8, summary_at):
    if kind == 3:
        (number,) = struct.unpack_from("<H", body)
        name, place = text(body, 2)
        encoding, place = text(body, place)
        assert encoding == "jsonschema"
        schemas[number] = (name, json.loads(text(body, place)[0]))
    elif kind == 4:
        number, schema = struct.unpack_from("<HH", body)
        topic, place = text(body, 4)
        assert text(body, place)[0] == "json"
        channels[number] = (topic, schema)
        messages[topic] = []
    elif kind == 6:
        start, end, plain, crc = struct.unpack_from("<QQQI", body)
        compression, place = text(body, 28)
        (length,) = struct.unpack_from("<Q", body, place)
        inner = body[place + 8 : place + 8 + length]
        assert compression == "" and length == plain and zlib.crc32(inner) == crc, "chunk"
        chunks[at] = inner
        chunk = inner
        for _, what, message in records(inner, 0, len(inner)):
            assert what == 5
            channel, sequence, log, publish = struct.unpack_from("<HIQQ", message)
            assert start <= log <= end
            topic = channels[channel][0]
            assert sequence == len(messages[topic]), "sequence"
            messages[topic].append((log, json.loads(message[22:])))
    elif kind == 7:
        channel, size = struct.unpack_from("<HI", body)
        for i in range(size // 16):
            log, offset = struct.unpack_from("<QQ", body, 6 + 16 * i)
            what, _, found, _, time = struct.unpack_from("<BQHIQ", chunk, offset)
            assert (what, found, time) == (5, channel, log), "message index"
            indexed += 1
    elif kind == 15:
        (crc,) = struct.unpack_from("<I", body)
        assert zlib.crc32(data[:at]) == crc, "data CRC"
count = sum(len(one) for one in messages.values())
assert indexed == count
for at, kind, body in records(data, summary_at, footer_at):
    if kind == 11:
        assert struct.unpack_from("<Q", body)[0] == count, "statistics"
    if kind == 8:
        assert struct.unpack_from("<QQQ", body)[2] in chunks, "chunk index"
for topic, rows in messages.items():
    for _, row in rows:
        if "format" in row:
            assert base64.b64decode(row["data"])[:4] == b"\x89PNG"
print(json.dumps({topic: [len(rows), rows[0][1], rows[-1][1]] for topic, rows in messages.items() if rows}))
