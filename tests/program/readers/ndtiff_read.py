# Reads an NDTiff 3.3 stack by its index alone, as the format's own readers do, while or after it grows; prints
# [images, sum of the last one's bytes, its metadata, the stack's summary, bits of its samples that count].
# SPDX-License-Identifier: Apache-2.0
import json, os, struct, sys

# micro-manager/NDStorage, IndexEntryData.java and ndtiff_file.py: bytes of a pixel, bits of a sample that count.
TYPES = {0: (1, 8), 1: (2, 16), 2: (3, 8), 3: (2, 10), 4: (2, 12), 5: (2, 14), 6: (2, 11)}
folder = sys.argv[1]
index = open(os.path.join(folder, "NDTiff.index"), "rb").read()
at, count, last = 0, 0, None
while at < len(index):
    (size,) = struct.unpack_from("<I", index, at)
    axes = json.loads(index[at + 4 : at + 4 + size])
    at += 4 + size
    (size,) = struct.unpack_from("<I", index, at)
    name = index[at + 4 : at + 4 + size].decode()
    at += 4 + size
    pixels, width, height, kind, packed, metadata, length, metadata_packed = struct.unpack_from("<8I", index, at)
    at += 32
    assert axes == {"time": count} and packed == metadata_packed == 0
    with open(os.path.join(folder, name), "rb") as file:
        head = struct.unpack("<HHIIIIII", file.read(28))
        assert head[:2] == (0x4949, 42) and head[3:6] == (483729, 3, 3) and head[6] == 2355492
        summary = json.loads(file.read(head[7]))
        file.seek(pixels)
        image = file.read(width * height * TYPES[kind][0])
        assert len(image) == width * height * TYPES[kind][0]
        file.seek(metadata)
        last = (sum(image), json.loads(file.read(length)))
    count += 1
print(json.dumps([count, last[0], last[1], summary, TYPES[kind][1]]))
