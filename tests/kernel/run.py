"""`make test-kernel`: the project's programs on a real kernel, with instruments by another hand behind its nodes.

  run.py --build build/release --folder build/kernel [--only REGEX]

Makes the guest (image.py), starts one for each group of cases, two at a time, and prints what each case found. Exit
code 0 only when every case of every group reported that it passed, and each guest ended as it should.
SPDX-License-Identifier: Apache-2.0
"""

import argparse
import json
import os
import pathlib
import re
import resource
import socket
import subprocess
import sys
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import image  # noqa: E402
from redirected import Redirected  # noqa: E402

MEMORY = "768"  # MB of a guest
PATIENCE = 150  # s without a word of a guest; the slowest case takes 40 s, on a machine that has other things to do too
PASSED, FAILED = "PASSED", "FAILED"


class Case:
    """One case: its verdict, and what it measured."""

    def __init__(self, name):
        self.name, self.verdict, self.seconds, self.rows, self.said = name, "NOT RUN", 0.0, [], []


class Guest:
    """One machine: QEMU, its devices outside, and the port on which its cases report."""

    def __init__(self, group, groups, given, kernel, disk, early):
        self.group, self.kernel, self.disk, self.early = group, kernel, disk, early
        self.suites = [group, *WITH.get(group, [])]
        cases = [case for suite in self.suites for case in groups[suite]]
        self.cases = {name: Case(name) for name in cases}
        self.folder = given.folder / "guests" / group
        self.devices, self.process, self.problem, self.took = {}, None, "", 0.0
        self.left = None  # with what words the cases left the rest to the judge
        self.judge = PANICKING.get(group)

    def pace(self):
        """A nanosecond an instruction: times are those of a machine that does a billion a second, whatever else this
        one has to do. Not with devices outside, whose time is this machine's."""
        return [] if self.devices else ["-icount", "shift=0"]

    def words(self):
        """QEMU's command line."""
        boot = self.kernel.compressed if self.group in COMPRESSED else self.kernel.elf
        words = [
            "qemu-system-x86_64", "-accel", "tcg", *self.pace(), "-M", "pc", "-cpu", "max", "-m", MEMORY, "-smp", "1", "-nodefaults",
            "-no-user-config", "-display", "none", "-nic", "none", "-no-reboot", "-kernel", boot, "-initrd", self.early,
            "-append", f"console=ttyS0 quiet panic={PANIC.get(self.group, -1)} oops=panic nokaslr mitigations=off no_timer_check "
                       f"suites={':'.join(suite + '.*' for suite in self.suites)}",
            "-serial", f"file:{self.folder / 'console'}", "-device", "isa-debug-exit,iobase=0x501,iosize=1",
            "-drive", f"file={self.disk},format=raw,if=none,id=root,readonly=on", "-device", "virtio-blk-pci,drive=root",
            "-device", "virtio-serial-pci", "-chardev", f"socket,id=port,path={self.port}",
            "-device", "virtserialport,chardev=port,name=cases",
        ]
        if self.devices:
            words += ["-device", "qemu-xhci"]
        for number, device in enumerate(self.devices.values()):
            words += ["-chardev", f"socket,id=usb{number},path={device.path}", "-device", f"usb-redir,chardev=usb{number}"]
        return [str(word) for word in words]

    def run(self):
        """The whole life of the machine."""
        began = time.monotonic()
        try:
            self._run()
        except (OSError, RuntimeError, ValueError, subprocess.SubprocessError) as error:
            self.problem = f"{type(error).__name__}: {error}"
        finally:
            if self.process is not None and self.process.poll() is None:
                self.process.kill()
                self.process.wait()
            for device in self.devices.values():
                device.close()
        self.took = time.monotonic() - began

    def _run(self):
        self.folder.mkdir(parents=True)
        sockets = pathlib.Path(os.path.relpath(self.folder))  # the name of a socket has 107 bytes
        for name, (instrument, options) in OUTSIDE.get(self.group, {}).items():
            self.devices[name] = Redirected(instrument, options, sockets / name)
        self.port = sockets / "port"
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(str(self.port))
        listener.listen(1)
        listener.settimeout(20)
        with open(self.folder / "qemu", "w", encoding="utf-8") as log:
            self.process = subprocess.Popen(self.words(), stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        port, _ = listener.accept()
        listener.close()
        self._listen(port)
        if self.judge:
            if self.left is not None:
                self.judge(self)
            else:
                self.problem = self.problem or "ended before its last case"
            return
        code = self.process.wait(timeout=60)
        if code != 1:  # 2 v + 1 for the verdict v of the cases
            self.problem = f"ended with {code}: " + ("no verdict, the machine stopped" if code == 0 else
                                                     f"the cases' program said {(code - 1) // 2}")

    def _listen(self, port):
        """Takes the lines of the cases, and answers their orders to the devices outside, until the machine ends."""
        port.settimeout(PATIENCE)
        lines = port.makefile("r", encoding="utf-8", errors="replace")
        case = None
        try:
            for line in lines:
                kind, _, text = line.rstrip("\n").partition("\t")
                if kind == "CASE":
                    case = self.cases.setdefault(text, Case(text))
                    case.verdict = "NOT ENDED"
                elif kind in (PASSED, FAILED) and case:
                    case.verdict, case.seconds = kind, float(text)
                elif kind == "ROW" and case:
                    case.rows.append(text)
                elif kind == "SAID" and case:
                    case.said.append(text)
                elif kind == "ORDER":
                    name, _, order = text.partition("\t")
                    answer = self.devices[name].obey(order) if name in self.devices else {"error": f"no device {name}"}
                    port.sendall((json.dumps(answer) + "\n").encode())
                elif kind == "LEAVE":  # what follows is judged from outside
                    self.left = text
                    return
        except TimeoutError:
            self.problem = f"silent for {PATIENCE} s"
        except ConnectionError:
            pass

    def console(self):
        """What the machine printed."""
        return (self.folder / "console").read_text(errors="replace")

    def passed(self):
        """Whether all is as it should be."""
        return not self.problem and self.cases and all(case.verdict == PASSED for case in self.cases.values())


def wait_for_panic(guest, case):
    """Whether the machine's kernel has panicked within 60 s."""
    began = time.monotonic()
    while "Kernel panic" not in guest.console():
        if guest.left is None or time.monotonic() - began > 60:
            case.verdict = FAILED
            case.said.append("no panic within 60 s")
            return False
        time.sleep(0.01)
    return True


def level(guest):
    """What the amplifier outside is set to, V or A."""
    if "supply" in guest.devices:
        return abs(guest.devices["supply"].obey('{"get": "current"}')["current"])
    return max(abs(volts) for volts in guest.devices["usb3103"].obey('{"get": "volts"}')["volts"])


def switch_off(guest):
    """The computer loses its power."""
    guest.process.kill()
    guest.process.wait()
    time.sleep(0.5)


def judge_panic(guest):
    """The machine panics with its output energized; the amplifier outside goes on without it."""
    case = next(case for case in guest.cases.values() if case.name.endswith("OfTheKernelWhileACurrentFlows"))
    if not wait_for_panic(guest, case):
        return
    seen = []
    for wait in (0.2, 0.8, 1.0):
        time.sleep(wait)
        seen.append(level(guest))
    switch_off(guest)
    seen.append(level(guest))
    unit = "A" if "supply" in guest.devices else "V"
    case.rows.append("0.2, 1, 2 s after the panic, and with the computer off: " + ", ".join(f"{each:.2f} {unit}" for each in seen))
    # The documented limit (docs/safety.md): a kernel that stands still zeroes nothing. That it panicked with the output
    # on is what makes the row worth printing; an output that is off by itself would be news.
    if not all(each > 0.4 for each in seen):
        case.verdict = FAILED
        case.said.append("the output went off by itself: docs/safety.md says that it stays on; correct the page")
    else:
        case.verdict = PASSED


def judge_heartbeat_panic(guest):
    """The same with a heartbeat line: the relay of its double opens, and stays open with the computer off."""
    case = guest.cases[f"{guest.group}.PanicOfTheKernel"]
    if not wait_for_panic(guest, case):
        return
    device, line = (guest.devices["line"], "rts") if "line" in guest.devices else (guest.devices["usb3103"], "port_latch")
    began, bound = map(float, guest.left.split())
    time.sleep(1.0)
    switch_off(guest)
    history = device.obey('{"history": true}')["history"]
    relay = [(at, closed) for at, name, closed in history if name == "amplifiers" and at > began]
    edges = [at for at, name, high in history if name == line and high & 1]
    if len(relay) != 1 or relay[0][1]:
        case.verdict = FAILED
        case.said.append(f"the relay after {began}: {relay}")
        return
    off = (relay[0][0] - began) * 1e3
    case.rows.append(f"kernel panic: off after {off:.0f} ms ({(relay[0][0] - edges[-1]) * 1e3:.0f} ms after "
                     f"the last edge), and with the computer off; set to {level(guest):.2f}")
    case.verdict = PASSED if off < bound else FAILED
    if case.verdict == FAILED:
        case.said.append(f"off after {off:.0f} ms; less than {bound:.0f} ms are wanted")


USB3103 = {"usb3103": ("usb3103", ["reply_size=64"])}
BOP = {"supply": ("ftdi_adapter", ["instrument=kepco_bop", "serial=BOP"])}
LINE = {"line": ("ftdi_adapter", ["serial=LINE"])}
OUTSIDE = {
    "TicGuest": {"tic": ("pololu_tic", [])},
    "PanicGuest": USB3103,
    "BopOutsideGuest": BOP,
    "SleepGuest": USB3103,
    "HeartbeatOutsideGuest": USB3103,
    "HeartbeatBopOutsideGuest": {**BOP, **LINE},
}
PANICKING = {"PanicGuest": judge_panic, "BopOutsideGuest": judge_panic, "HeartbeatOutsideGuest": judge_heartbeat_panic,
             "HeartbeatBopOutsideGuest": judge_heartbeat_panic}
PANIC = {group: 0 for group in PANICKING}  # the kernel stands still for ever, as a laboratory's computer does
# Resume from S3 resets a machine that was started from the bare ELF file.
COMPRESSED = {"SleepGuest", "BopOutsideGuest", "HeartbeatOutsideGuest", "HeartbeatBopOutsideGuest"}
# Suites that share the machine of another one: starting one costs as much as several cases.
WITH = {"HeartbeatGuest": ["HeartbeatLampGuest"], "HeartbeatBopGuest": ["ModemLinesGuest"], "CameraGuest": ["UvcGuest"], "Usb3103Guest": ["SerialGuest", "OperatorGuest"]}
# The longest.
FIRST = ["RescueUsb3103Guest", "RescueBopGuest", "RescueLampGuest", "HeartbeatBopOutsideGuest", "HeartbeatOutsideGuest", "BopOutsideGuest",
         "SleepGuest", "HeartbeatGuest", "HeartbeatBopGuest"]


def cases_of(program):
    """Groups and their cases, as the test program lists them."""
    groups, group = {}, None
    for line in image.run(program, "--gtest_list_tests").splitlines():
        if not line.startswith(" "):
            group = line.split()[0].rstrip(".")
        else:
            groups.setdefault(group, []).append(f"{group}.{line.split()[0]}")
    return groups


def make_guest(given):
    """(kernel, disk image, initramfs, seconds of each step)."""
    marks = [("start", time.monotonic())]

    def mark(name):
        marks.append((name, time.monotonic()))

    packages = image.Packages(given.folder / "packages")
    kernel_file, *others = packages.fetch([image.kernel_package(), *image.PACKAGES])
    mark("download")
    kernel = image.Kernel(kernel_file, given.folder / "kernel")
    mark("unpack the kernel")
    disk = image.Disk(given.folder, others, kernel)
    disk.modules()
    for name in ("vitreo", "vitreo_guardian"):
        disk.program(given.build / name, f"/opt/vitreo/{name}")
    disk.program(given.build / "tests/kernel_guest_tests", "/opt/vitreo/kernel_guest_tests")
    source = HERE.parent.parent
    for name in ("scripts", "protocols"):
        disk.add(source / name, str(source / name))
    disk.add(HERE.parent / "doubles", "/opt/vitreo/doubles")
    for name in ("gadget.py", "usb_device.py"):
        disk.add(HERE / name, f"/opt/vitreo/kernel/{name}")
    disk.add(HERE / "guest_start", "/sbin/start")
    disk.add(HERE / "guest_cases", "/sbin/cases")
    disk.add(HERE / "systemd-inhibit", "/usr/local/bin/systemd-inhibit")
    disk.add(source / "packaging/60-vitreo.rules", "/etc/udev/rules.d/60-vitreo.rules")
    disk.write()
    early = image.initramfs(given.folder, kernel)
    mark("disk")
    steps = [(name, at - before) for (_, before), (name, at) in zip(marks, marks[1:])]
    return kernel, disk.image, early, steps


def run_all(guests):
    """Two at a time, in order."""
    todo, lock = list(guests), threading.Lock()

    def work():
        while True:
            with lock:
                if not todo:
                    return
                guest = todo.pop(0)
            guest.run()
            show(guest)

    workers = [threading.Thread(target=work) for _ in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()


def show(guest):
    """What one machine found."""
    text = [f"\n{guest.group}: {guest.took:.1f} s" + (f"; {guest.problem}" if guest.problem else "")]
    for case in guest.cases.values():
        name = case.name if len(guest.suites) > 1 else case.name.split(".")[1]
        text.append(f"  {case.verdict:9} {name} ({case.seconds:.1f} s)")
        text += [f"            {row}" for row in case.rows]
        if case.verdict != PASSED:
            text += [f"          | {line}" for line in case.said]
    if not guest.passed() and (guest.folder / "console").exists():
        text += [f"  console| {line}" for line in guest.console().splitlines()[-25:]]
    print("\n".join(text), flush=True)


def main():
    """Makes the guest, runs the groups, prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--folder", type=pathlib.Path, required=True)
    parser.add_argument("--only", help="groups whose names match this regular expression")
    given = parser.parse_args()
    given.build, given.folder = given.build.resolve(), given.folder.resolve()
    began = time.monotonic()
    try:
        kernel, disk, early, steps = make_guest(given)
    except (RuntimeError, OSError) as error:
        print(f"test-kernel: the guest cannot be made: {error}", file=sys.stderr)
        return 2
    print(f"{kernel.name} ({kernel.release}); disk {disk.stat().st_size >> 20} MB; " +
          ", ".join(f"{name} {seconds:.1f} s" for name, seconds in steps), flush=True)
    image.shutil.rmtree(given.folder / "guests", ignore_errors=True)
    groups = cases_of(given.build / "tests/kernel_guest_tests")
    guided = {suite for suites in WITH.values() for suite in suites}
    names = [name for name in groups if name not in guided and (not given.only or re.search(given.only, name))]
    names.sort(key=lambda name: FIRST.index(name) if name in FIRST else len(FIRST))
    guests = [Guest(name, groups, given, kernel, disk, early) for name in names]
    run_all(guests)
    cases = [case for guest in guests for case in guest.cases.values()]
    passed = sum(case.verdict == PASSED for case in cases)
    good = bool(guests) and all(guest.passed() for guest in guests)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"\ntest-kernel: {passed} of {len(cases)} cases in {len(guests)} guests passed on {kernel.name}; "
          f"{time.monotonic() - began:.0f} s in all, {used.ru_utime + used.ru_stime:.0f} s of processors" +
          ("" if good else "; FAILED"))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
