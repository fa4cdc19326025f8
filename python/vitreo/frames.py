"""Recorded frames of one camera: the pixels of its NDTiff stacks, mapped and not copied.
SPDX-License-Identifier: Apache-2.0
"""

import collections.abc
import os

import numpy as np

from .errors import RecordError

# NDTiff's pixel types: bytes of a sample, samples of a pixel. Stacks are little-endian.
_TYPES = {0: (np.dtype("u1"), 1), 1: (np.dtype("<u2"), 1), 2: (np.dtype("u1"), 3)}


class Frames(collections.abc.Sequence):
    """Frames of one camera in their order, as a sequence of read-only arrays.

    frames[i]: (height, width), uint8 or uint16; of a color camera (height, width, 3), uint8, red first. A slice is
    a sequence again. `table` has a row a frame: index t in s and t_ns of the exposure, t_received_ns, t_device_ns,
    number, dropped_before, lost_before and where the pixels are. np.asarray(frames) copies all into one array, where their sizes
    agree.
    """

    def __init__(self, folder, camera, table):
        self._folder = os.fspath(folder)
        self._maps = {}
        self.camera = camera
        self.table = table

    def __repr__(self):
        return f"<{len(self)} frames of {self.camera} in {self._folder}>"

    def __len__(self):
        return len(self.table)

    def __getitem__(self, index):
        if isinstance(index, slice):
            part = Frames(self._folder, self.camera, self.table.iloc[index])
            part._maps = self._maps
            return part
        return self._pixels(self.table.iloc[index])

    def __array__(self, dtype=None, copy=None):
        if not len(self):
            return np.empty((0, 0, 0), dtype or np.uint8)
        return np.asarray(np.stack(list(self)), dtype)

    def _pixels(self, row):
        width, height, offset, size = (int(row[name]) for name in ("width_px", "height_px", "offset", "bytes"))
        dtype, samples = _TYPES.get(int(row["pixel_type"]), (None, 0))
        # Row and pixels are independent witnesses: the size by the row must be that by width, height and type.
        if dtype is None or min(width, height) <= 0 or offset < 0 or width * height * samples * dtype.itemsize != size:
            raise RecordError(f"{self._folder}: the row of frame {row['number']} of {self.camera} is broken")
        mapped = self._map(row["file"], offset + size)
        shape = (height, width) if samples == 1 else (height, width, samples)
        return mapped[offset : offset + size].view(dtype).reshape(shape)

    def _map(self, file, end):
        """The file's bytes, at least `end` of them; mapped anew when it has grown."""
        mapped = self._maps.get(file)
        if mapped is None or len(mapped) < end:
            path = os.path.join(self._folder, self._inside(file))
            try:
                mapped = self._maps[file] = np.memmap(path, dtype=np.uint8, mode="r")
            except (OSError, ValueError) as error:
                raise RecordError(f"{path}: cannot be read: {error}") from error
        if len(mapped) < end:
            raise RecordError(f"{os.path.join(self._folder, file)}: is shorter than its frames")
        return mapped

    def _inside(self, file):
        """A record that came from elsewhere must not name a file of this machine."""
        if not file or os.path.isabs(file) or ".." in file.split("/"):
            raise RecordError(f"{self._folder}: names a file outside itself: {file}")
        return file
