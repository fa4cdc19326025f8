"""What tifffile, h5py, pandas and ffprobe read of a run's exports, beside what its record says (by sqlite3), as JSON.

    exports_read.py RUN EXPORTS CAMERA tif,ome,h5,csv,mkv
"""
# SPDX-License-Identifier: Apache-2.0
import datetime
import json
import pathlib
import re
import sqlite3
import subprocess
import sys
import xml.etree.ElementTree

import h5py
import numpy
import pandas
import tifffile

run, exports = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
camera = sys.argv[3]
record = sqlite3.connect(f"file:{run}/run.sqlite?mode=ro", uri=True)
frames = record.execute(
    "select t_ns, number, file, offset, bytes from frame where camera = ? order by seq", (camera,)).fetchall()
times = numpy.array([frame[0] for frame in frames]) / 1e9


def worst(found):
    """s between the record's times and those in a file, at the frame where they differ most."""
    found = numpy.array(found, dtype=float)
    return float(numpy.abs(found - times).max()) if found.shape == times.shape else f"{len(found)} frames"


def pixels(i):
    with open(run / frames[i][2], "rb") as stack:
        stack.seek(frames[i][3])
        return stack.read(frames[i][4])


def same(pages):
    """Whether the first, a middle and the last page have the record's bytes."""
    return all(pages(i).tobytes() == pixels(i) for i in (0, len(frames) // 2, len(frames) - 1))


def moment(text):
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()


def imagej():
    with tifffile.TiffFile(exports / f"{camera}.tif") as tiff:
        about = tiff.imagej_metadata
        series = tiff.series[0]
        labels = [re.match(r"t=(\S+) s  (\S+)  frame (\d+)$", label) for label in about["Labels"]]
        unit_px = tiff.pages[0].tags["XResolution"].value
        return {
            "is_imagej": tiff.is_imagej, "axes": series.axes, "frames": len(tiff.pages), "unit": about["unit"],
            "pixel_um": unit_px[1] / unit_px[0], "worst": worst([label[1] for label in labels]),
            "numbers": [int(label[3]) for label in labels] == [frame[1] for frame in frames],
            "utc_off": max(abs(moment(label[2]) - moment(about["t0_utc"]) - t) for label, t in zip(labels, times)),
            "t0": moment(about["t0_utc"]), "clock": about["clock"], "same": same(lambda i: tiff.pages[i].asarray()),
        }


def ome():
    with tifffile.TiffFile(exports / f"{camera}.ome.tif") as tiff:
        root = xml.etree.ElementTree.fromstring(tiff.ome_metadata)
        space = {"o": "http://www.openmicroscopy.org/Schemas/OME/2016-06"}
        size = root.find(".//o:Pixels", space)
        planes = root.findall(".//o:Plane", space)
        return {
            "is_ome": tiff.is_ome, "axes": tiff.series[0].axes, "shape": tiff.series[0].shape,
            "worst": worst([plane.get("DeltaT") for plane in planes]),
            "units": sorted({plane.get("DeltaTUnit") for plane in planes}),
            "order": [int(plane.get("TheT")) for plane in planes] == list(range(len(frames))),
            "pixel_um": float(size.get("PhysicalSizeX")), "pixel_unit": size.get("PhysicalSizeXUnit"),
            "cm": tiff.pages[0].tags["ResolutionUnit"].value == 3,
            "t0": moment(root.find(".//o:AcquisitionDate", space).text),
            "same": same(lambda i: tiff.series[0].pages[i].asarray()),
        }


def hdf5():
    with h5py.File(exports / "run.h5") as file:
        group = file["frames"][camera]
        servo = file["streams/servo"]
        return {
            "worst": worst(group["t_ns"][:] / 1e9), "unit": servo["x"].attrs["unit"], "t0": moment(file.attrs["t0_utc"]),
            "t0_ns": int(file.attrs["t0_utc_ns"]), "clock": file.attrs["clock"], "rows": len(servo["t_ns"]),
            "same": same(lambda i: group["images"][i]),
        }


def csv():
    about = pandas.read_csv(exports / "run.csv", index_col="key")["value"]
    channels = pandas.read_csv(exports / "channels.csv", keep_default_na=False)
    servo = pandas.read_csv(exports / "servo.csv", float_precision="round_trip")
    rows = pandas.read_sql("select * from sample_servo", record)
    of_servo = channels[channels.stream == "servo"]
    return {
        "t0": moment(about["t0_utc"]), "t0_ns": int(about["t0_utc_ns"]), "clock": about["clock"],
        "units": dict(zip(of_servo.channel, of_servo.unit)), "rows": len(servo),
        "worst": float((servo["t (s)"] - rows.t_ns / 1e9).abs().max()),
        "same": bool(((servo["x (m)"] == rows.x) | (servo["x (m)"].isna() & rows.x.isna())).all()),
    }


def film():
    file = exports / f"{camera}.mkv"
    probed = json.loads(subprocess.check_output(
        ["ffprobe", "-v", "error", "-show_streams", "-show_format", "-show_frames", "-show_entries", "frame=pts_time",
         "-of", "json", file]))
    gray = subprocess.check_output(["ffmpeg", "-v", "error", "-i", file, "-fps_mode", "passthrough", "-f", "rawvideo", "-"])
    size = len(gray) // len(frames)
    return {
        "codec": probed["streams"][0]["codec_name"], "worst": worst([frame["pts_time"] for frame in probed["frames"]]),
        "t0": moment(probed["format"]["tags"]["creation_time"]),
        "same": all(gray[i * size:(i + 1) * size] == pixels(i) for i in range(len(frames))),
    }


readers = {"tif": imagej, "ome": ome, "h5": hdf5, "csv": csv, "mkv": film}
# The largest hole says whether there was one.
answer = {"frames": len(frames), "hole": float(numpy.diff(times).max()), "step": float(numpy.diff(times).min())}
answer.update({name: readers[name]() for name in sys.argv[4].split(",")})
print(json.dumps(answer, default=str))
