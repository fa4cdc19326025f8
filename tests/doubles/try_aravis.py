#!/usr/bin/python3
"""Lets Aravis 0.8 judge the double of a GigE Vision camera, and prints what it measured.

Not part of ctest: it takes half a minute. It needs arv-tool-0.8 and arv-camera-test-0.8 (Debian: aravis-tools-cli,
aravis-tools), and for all but the first two trials Debian's own Python with python3-gi and gir1.2-aravis-0.8. It runs
in a network namespace of its own (unshare), so that it meets no other camera. Ends with 1 if something was not as it
should be. Arguments: names of trials (tool, stream_program, truth, latch, formats, ...); without any, all.
SPDX-License-Identifier: Apache-2.0
"""

import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
FIRST, SECOND = "Vitreo Doubles-D0001", "Vitreo Doubles-D0002"
sys.path.insert(0, str(HERE))
failures = []


def check(what, good, measured=""):
    """Prints a line; remembers what failed."""
    print(f"{'ok    ' if good else 'FAILED'} {what}{': ' if measured != '' else ''}{measured}", flush=True)
    if not good:
        failures.append(what)


class Served:
    """The running server."""

    def __init__(self, *arguments):
        self.process = subprocess.Popen([sys.executable, str(HERE / "gige_serve.py"), *arguments], text=True,
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.where = self.process.stdout.readline().split()

    def order(self, **order):
        """Gives a command and returns its answer."""
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def frames(self, camera=0):
        """The history's frames by block id."""
        history = self.order(history=True, camera=camera)["history"]
        return {value["block"]: value for _, name, value in history if name == "frame"}

    def seconds_used(self):
        """Seconds of processor time so far."""
        fields = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait(10)


def run(*command):
    """The output of a program."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return done.stdout + done.stderr


def try_tool():
    """Lists, reads, writes; limits are refused; the old names are there."""
    with Served("--camera", "127.0.0.1", "--camera", "127.0.0.2,names=old,color=1"):
        listed = run("arv-tool-0.8")
        both = "D0001 (127.0.0.1)" in listed and "D0002 (127.0.0.2)" in listed
        check("both are listed without aliases of the interface", both)
        told = run("arv-tool-0.8", "-n", FIRST, "control", "Width=320", "OffsetX=101", "OffsetX", "Width")
        check("a region is set", "OffsetX = 101 min:0 max:320" in told and "Width = 320 min:4 max:539" in told)
        told = run("arv-tool-0.8", "-n", FIRST, "control", "OffsetX=321", "Width=99999", "Width=322")
        check("limits and steps are refused", told.count("invalid-parameter") == 3)
        told = run("arv-tool-0.8", "-n", FIRST, "control", "ExposureTime=1000")
        check("an exposure under automatic control is refused", "write-protect" in told)
        told = run("arv-tool-0.8", "-n", SECOND, "control", "GainAuto=Off", "GainRaw=105", "GainRaw", "ExposureTimeAbs")
        check("old names", "GainRaw = 105" in told and "ExposureTimeAbs = 5000" in told)
        told = run("arv-tool-0.8", "-n", SECOND, "control", "ExposureTime")
        check("new names are not there then", "not found" in told)


def try_stream_program():
    """Two arv-camera-test at 50 frames a second."""
    with Served("--camera", "127.0.0.1", "--camera", "127.0.0.2") as served:
        for name in (FIRST, SECOND):
            run("arv-tool-0.8", "-n", name, "control", "ExposureAuto=Off", "GainAuto=Off", "GevSCPSPacketSize=8192",
                "AcquisitionFrameRateEnable=true", "AcquisitionFrameRate=50")
        before, start = served.seconds_used(), time.monotonic()
        runs = [subprocess.Popen(["arv-camera-test-0.8", "-n", name, "--duration", "6", "-j", "never"], text=True,
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT) for name in (FIRST, SECOND)]
        told = [each.communicate(timeout=60)[0] for each in runs]
        share = (served.seconds_used() - before) / (time.monotonic() - start)
        for text in told:
            counts = dict(line.split("=", 1) for line in text.splitlines() if line.startswith("n_"))
            counts = {name.strip(): int(value) for name, value in counts.items()}
            good = counts.get("n_completed_buffers", 0) + counts.get("n_underruns", 0) > 270
            check("640x480 at 50 frames/s", good and counts["n_failures"] == 0,
                  {name: counts.get(name) for name in ("n_completed_buffers", "n_failures", "n_underruns")})
        check("two cameras take less than 40 % of a processor", share < 0.4, f"{100 * share:.0f} %")


class Host:
    """A camera opened through Aravis' library."""

    def __init__(self, name=FIRST):
        import gi
        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis
        self.aravis = Aravis
        Aravis.update_device_list()
        self.camera = Aravis.Camera.new(name)
        self.device = self.camera.get_device()
        self.stream = None

    def put(self, **features):
        """Sets features by name."""
        for name, value in features.items():
            if isinstance(value, str):
                self.device.set_string_feature_value(name, value)
            elif isinstance(value, bool):
                self.device.set_boolean_feature_value(name, value)
            elif isinstance(value, float):
                self.device.set_float_feature_value(name, value)
            else:
                self.device.set_integer_feature_value(name, value)

    def manual(self, exposure=5000.0, rate=50.0):
        """Everything automatic off, gamma 1."""
        self.put(ExposureAuto="Off", GainAuto="Off", Gamma=1.0, ExposureTime=exposure, Gain=0.0, GevSCPSPacketSize=8192,
                 AcquisitionFrameRateEnable=True, AcquisitionFrameRate=rate)

    def open(self, buffers=10):
        """Makes the stream and starts the acquisition."""
        self.device.set_packet_size_adjustment(self.aravis.GvPacketSizeAdjustment.NEVER)
        self.stream = self.camera.create_stream(None, None)
        for _ in range(buffers):
            self.stream.push_buffer(self.aravis.Buffer.new_allocate(self.camera.get_payload()))
        self.camera.start_acquisition()

    def take(self, count, patience=5.0):
        """A list of (status, frame id, stamp in ns, data, pixel format, buffer's chunks by the parser's function)."""
        taken, until = [], time.monotonic() + patience
        while len(taken) < count and time.monotonic() < until:
            buffer = self.stream.timeout_pop_buffer(100000)
            if buffer is None:
                continue
            good = buffer.get_status() == self.aravis.BufferStatus.SUCCESS
            taken.append({"good": good, "id": buffer.get_frame_id(), "stamp": buffer.get_timestamp(),
                          "data": bytes(buffer.get_data()) if good else b"", "buffer": buffer,
                          "chunks": self.chunks(buffer) if good and buffer.has_chunks() else {}})
            self.stream.push_buffer(buffer)
        return taken

    def chunks(self, buffer):
        """Exposure, stamp and frame id out of the chunks."""
        parser = self.camera.create_chunk_parser()
        return {"exposure": parser.get_float_value(buffer, "ChunkExposureTime"),
                "ticks": parser.get_integer_value(buffer, "ChunkTimestamp"),
                "id": parser.get_integer_value(buffer, "ChunkFrameID")}

    def close(self):
        """Gives everything back."""
        self.camera.stop_acquisition()
        self.stream = self.camera = self.device = None


def strip_of(data):
    """The number in a Mono8 picture's strip."""
    return int("".join("1" if data[at * 4] > 127 else "0" for at in range(32)), 2)


def try_truth():
    """Stamps, strips and pictures agree with the history."""
    with Served("--option", "drift_ppm=50", "--option", "clock_offset=1000") as served:
        host = Host()
        host.manual()
        host.open()
        taken = host.take(60)
        host.close()
        frames = served.frames()
        check("60 pictures, all whole", len(taken) == 60 and all(each["good"] for each in taken))
        stamps = [abs(each["stamp"] - frames[each["id"]]["ticks"] * 8) for each in taken]
        check("Aravis' stamps are the camera's ticks of 8 ns", max(stamps) == 0, f"{max(stamps)} ns off")
        own = all(strip_of(each["data"]) == frames[each["id"]]["strip"] for each in taken)
        check("the strip in each picture is its own", own)
        period = [frames[b]["start_ns"] - frames[a]["start_ns"] for a, b in zip(list(frames), list(frames)[1:])]
        check("exposures come each 20 ms", max(abs(each - 20_000_000) for each in period) < 2000)


def try_latch():
    """Latched stamps against the truth, by the exchange with the shortest way."""
    with Served("--option", "drift_ppm=50") as served:
        host, exchanges = Host(), []
        for _ in range(50):
            before = time.monotonic_ns()
            host.device.execute_command("TimestampLatch")
            after = time.monotonic_ns()
            value = host.device.get_integer_feature_value("TimestampLatchValue")
            exchanges.append((after - before, (before + after) // 2, value))
        trip, middle, value = min(exchanges)
        truth = {round(each["ticks"] * 8): each["at_ns"] for _, name, each in served.order(history=True)["history"]
                 if name == "latch"}
        check("a latched stamp lies within its exchange", abs(truth[value] - middle) <= trip / 2,
              f"{trip / 1000:.0f} us to and fro, {abs(truth[value] - middle) / 1000:.0f} us off the middle")


def unpack(data, packing):
    """12-bit values by a reading of the formats that is not the double's."""
    if packing in ("Mono12", "Mono10", "Mono16"):
        values = struct.unpack(f"<{len(data) // 2}H", data)
        return [each << 2 if packing == "Mono10" else each >> 4 if packing == "Mono16" else each for each in values]
    if packing == "Mono12Packed":
        threes = zip(data[::3], data[1::3], data[2::3])
        return [value for a, b, c in threes for value in (a << 4 | b & 15, c << 4 | b >> 4)]
    width = 10 if packing == "Mono10p" else 12
    whole = int.from_bytes(data, "little")
    mask = (1 << width) - 1
    return [(whole >> at & mask) << (12 - width) for at in range(0, 8 * len(data), width)]


def try_formats():
    """Each format's values, on the ramp of one row."""
    with Served("--option", "strip=0", "--option", "dot_period=0"):
        for name in ("Mono10", "Mono12", "Mono16", "Mono10p", "Mono12p", "Mono12Packed"):
            host = Host()
            host.manual(10000.0)
            host.put(PixelFormat=name, Height=8)
            host.open()
            taken = host.take(2)
            host.close()
            row = unpack(taken[-1]["data"], name)[:640]
            wanted = [int(64 + 4096 * 0.5 * (x + 0.5) / 640) for x in range(640)]
            wanted = [each & ~3 for each in wanted] if "10" in name else wanted
            off = sum(a != b for a, b in zip(row, wanted))
            check(f"{name} carries its low bits", row == wanted, f"{off} of 640 differ")


def try_loss():
    """Lost packets come again where they are asked for."""
    for resend, option in (("works", "works"), ("absent", "absent")):
        with Served("--option", "packet_loss=0.02", "--option", f"resend={option}") as served:
            host = Host()
            host.manual()
            host.open()
            taken = host.take(100, 8.0)
            host.close()
            whole = sum(each["good"] for each in taken)
            state = served.order(get="state")
            check(f"resend {resend}", whole >= 97 if resend == "works" else 10 < whole < 80,
                  f"{whole} of {len(taken)} whole, {state['packets_lost']} lost, {state['packets_resent']} resent")


def try_chunks():
    """Exposure, stamp and number of each picture out of its chunks."""
    with Served() as served:
        host = Host()
        host.manual(3000.0)
        host.camera.set_chunks("Timestamp,ExposureTime,FrameID")
        host.open()
        taken = host.take(10)
        host.close()
        frames = served.frames()
        good = all(each["chunks"].get("exposure") == 3000.0 and each["chunks"]["id"] == each["id"] and
                   each["chunks"]["ticks"] == frames[each["id"]]["ticks"] for each in taken)
        check("chunks", good and len(taken) == 10)


def try_lamp():
    """A flash of 2 ms within an exposure shows in that picture alone, as bright as it was long."""
    with Served("--option", "strip=0") as served:
        host = Host()
        host.manual(15000.0)
        host.open()
        host.take(5)
        at = served.order(flash={"after": 0.2, "for": 0.002})["at_ns"]
        taken = host.take(30)
        host.close()
        frames = served.frames()
        middle = (96 + 16) * 640 + 448 + 16
        lit = [each["id"] for each in taken if each["good"] and each["data"][middle] > 8]
        truth = [block for block, each in frames.items() if each["start_ns"] < at + 2_000_000 and at < each["end_ns"]]
        check("the lamp lights the pictures that were exposed then", lit == truth, f"{lit}")


def try_wire():
    """The second camera triggered by the first one's exposure."""
    with Served("--camera", "127.0.0.1", "--camera", "127.0.0.2,drift_ppm=-30", "--wire", "1:Line1=0:Line2") as served:
        first, second = Host(FIRST), Host(SECOND)
        for host in (first, second):
            host.manual()
        first.put(LineSelector="Line2", LineMode="Output", LineSource="ExposureActive")
        second.camera.set_trigger("Line1")
        second.open(60)
        first.open(60)
        pairs = list(zip(first.take(40), second.take(40)))
        first.close()
        second.close()
        a, b = served.frames(0), served.frames(1)
        skew = [b[y["id"]]["start_ns"] - a[x["id"]]["start_ns"] for x, y in pairs]
        worst = max(map(abs, skew), default=None)
        check("exposures by wire are in step", len(pairs) == 40 and worst < 1000, f"{worst} ns")


def try_bad_days():
    """A second client, a dead client, a reboot."""
    with Served("--option", "boot_time=1") as served:
        served.order(occupy=1.5)
        host = Host()
        check("a camera held by a dead client is opened without control", not host.device.is_controller())
        time.sleep(1.7)
        host.device.take_control()
        check("and taken when its heartbeat has ended", host.device.is_controller())
        host.manual()
        host.open()
        host.take(5)
        served.order(power_cycle=True)
        check("after a loss of power no picture comes", not host.take(3, 1.5))
        state = served.order(get="state")
        fresh = state["features"]["ExposureAuto"] == 2 and state["controller"] is None
        check("and the camera is as it was at first", fresh)


def main():
    """Runs all trials in a namespace of their own."""
    if shutil.which("arv-tool-0.8") is None or shutil.which("arv-camera-test-0.8") is None:
        sys.exit("arv-tool-0.8 and arv-camera-test-0.8 are needed (Debian: aravis-tools-cli, aravis-tools)")
    if "VITREO_OWN_NET" not in os.environ:
        os.environ["VITREO_OWN_NET"] = "1"
        os.execvp("unshare", ["unshare", "-rn", "sh", "-c", 'ip link set lo up && exec "$@"', "sh",
                              sys.executable, str(HERE / "try_aravis.py"), *sys.argv[1:]])
    trials = [try_tool, try_stream_program, try_truth, try_latch, try_formats, try_loss, try_chunks, try_lamp, try_wire,
              try_bad_days]
    for trial in trials:
        if not sys.argv[1:] or trial.__name__[4:] in sys.argv[1:]:
            trial()
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
