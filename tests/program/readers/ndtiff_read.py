# Reads an NDTiff 3.3 stack by its index alone, as the format's own readers do, while or after it grows; prints
# [images, sum of the last one's pixels, its metadata].
# SPDX-License-Identifier: Apache-2.0
import json, os, struct, sys

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
        image = file.read(width * height * (1, 2, 3)[kind])
        assert len(image) == width * height * (1, 2, 3)[kind]
        file.seek(metadata)
        last = (sum(image), json.loads(file.read(length)))
    count += 1
print(json.dumps([count, last[0], last[1], summary]))
