"""The guest of `make test-kernel`: Debian's kernel, unpacked and never installed, and a disk with the programs under test.

Everything stands in one folder, which may be thrown away; packages come by apt-get download, whose sums are those of
the signed lists.
SPDX-License-Identifier: Apache-2.0
"""

import hashlib
import lzma
import os
import pathlib
import re
import shutil
import subprocess

HERE = pathlib.Path(__file__).resolve().parent
# Beside the kernel: what the guest has of Debian's own and the machine that builds need not have.
PACKAGES = ["python3.11-minimal", "libpython3.11-minimal", "libpython3.11-stdlib", "udev"]
# Loaded before there is a root; the order is modprobe's.
EARLY = ["virtio_pci", "virtio_blk", "virtio_console", "crc32c_generic", "ext4"]
# On the disk, loaded by the case that needs them.
LATER = [
    "usbhid", "hid-generic", "hid-logitech", "uhid", "dummy_hcd", "libcomposite", "usb_f_hid", "usb_f_acm", "cdc-acm", "xhci-pci", "vivid",
    "vhci-hcd", "ftdi_sio", "uvcvideo",
]
KERNEL_PARTS = ["./boot/vmlinuz*", "./lib/modules/*/kernel/*", "./lib/modules/*/modules.*"]
LEFT_OUT = ["gpu", "net", "infiniband", "scsi", "staging", "iio", "sound", "nvme", "md", "target", "hwmon"]


def run(*words, **more):
    """A program that must succeed; what it says comes with the error."""
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False, **more)
    if done.returncode:
        raise RuntimeError(f"{words[0]} failed: {' '.join(map(str, words))}\n{done.stdout}{done.stderr}")
    return done.stdout


class Packages:
    """Debian packages in a folder, as files."""

    def __init__(self, folder):
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def fetch(self, names):
        """The files of these packages, of the versions in apt's lists."""
        try:
            return self._fetch(names)
        except RuntimeError:  # old lists name what the archive has no more
            run(*os.environ.get("SUDO", "").split(), "apt-get", "update", "-q")
            return self._fetch(names)

    def _fetch(self, names):
        told = run("apt-get", "download", "--print-uris", *names, cwd="/")  # it says nothing of a file that is there
        found = re.findall(r"^'\S+' (\S+) (\d+) SHA256:([0-9a-f]{64})", told, re.MULTILINE)
        if len(found) != len(names):
            raise RuntimeError(f"apt tells no file with a SHA-256 for each of {', '.join(names)}: {told}")
        files = {name: (self.folder / name, digest) for name, _, digest in found}
        if any(not file.exists() or sha256(file) != digest for file, digest in files.values()):
            run("apt-get", "download", "-q", "-o", "APT::Sandbox::User=root", *names, cwd=self.folder)
        for file, digest in files.values():
            if sha256(file) != digest:
                raise RuntimeError(f"{file.name} is not the package that apt's lists name")
        return [next(file for file, _ in files.values() if file.name.startswith(name + "_")) for name in names]


def sha256(path):
    """Of the file's bytes, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def kernel_package():
    """The package that linux-image-amd64 stands for today."""
    found = re.search(r"Depends: (linux-image-\d\S+)", run("apt-cache", "depends", "linux-image-amd64"))
    if not found:
        raise RuntimeError("apt's lists name no kernel for linux-image-amd64")
    return found[1]


class Kernel:
    """Image and modules of one package."""

    def __init__(self, package, folder):
        self.folder = folder / package.stem
        self.elf = self.folder / "vmlinux"
        if not self.elf.exists():  # written last
            self._unpack(package)
        self.release = next((self.folder / "lib/modules").iterdir()).name
        self.compressed = next((self.folder / "boot").glob("vmlinuz*"))
        self.name = package.name.split("_")[0] + " " + package.name.split("_")[1]

    def _unpack(self, package):
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        leave = [f"--exclude=*/drivers/{name}/*" for name in LEFT_OUT]
        with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE) as parts:
            run("tar", "x", "-C", self.folder, "--wildcards", *leave, *KERNEL_PARTS, stdin=parts.stdout)
        if parts.returncode:
            raise RuntimeError(f"{package} cannot be unpacked")
        release = next((self.folder / "lib/modules").iterdir()).name
        run("/sbin/depmod", "-b", self.folder, release)
        # The image unpacks itself slowly where each instruction is interpreted: it is given unpacked.
        image = next((self.folder / "boot").glob("vmlinuz*")).read_bytes()
        start = image.index(b"\xfd7zXZ\0")
        self.elf.write_bytes(lzma.LZMADecompressor(lzma.FORMAT_XZ).decompress(image[start:]))

    def modules(self, names):
        """Files of these modules and of what they need, in the order of loading."""
        files = []
        for name in names:
            told = run("/sbin/modprobe", "-d", self.folder, "-S", self.release, "--show-depends", name)
            for file in re.findall(r"^insmod (\S+)", told, re.MULTILINE):
                if pathlib.Path(file) not in files:
                    files.append(pathlib.Path(file))
        return files


def libraries(programs):
    """What these programs and their libraries load, at the start and, by name, later."""
    known = dict(re.findall(r"^\s+(\S+) \(libc6,x86-64[^)]*\) => (\S+)", run("/sbin/ldconfig", "-p"), re.MULTILINE))
    found, todo = set(), list(programs)
    while todo:
        told = run("ldd", todo.pop())
        if missing := re.findall(r"(\S+) => not found", told):
            raise RuntimeError(f"no library {', '.join(missing)}")
        found.update(re.findall(r"(?:=> )?(/\S+) \(0x", told))
    # docs/decisions/0005-lazy-libraries.md: opened at the first call of one of their functions.
    for program in programs:
        for name in set(re.findall(rb"lib(?:opencv_|aravis)[\w.+-]+\.so\.[\d.]+", pathlib.Path(program).read_bytes())):
            if name.decode() in known and known[name.decode()] not in found:
                later = known[name.decode()]
                found.add(later)
                found.update(re.findall(r"(?:=> )?(/\S+) \(0x", run("ldd", later)))
    return found


def copy(file, root):
    """To its own path below the root, links followed."""
    target = root / str(file).lstrip("/")
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(file, target)


class Disk:
    """The root of the guest: what is tested, what tests it, and as little of a system as that needs."""

    def __init__(self, folder, packages, kernel):
        self.root, self.image, self.kernel = folder / "root", folder / "root.img", kernel
        shutil.rmtree(self.root, ignore_errors=True)
        for name in ("bin", "sbin", "dev", "proc", "sys", "run", "tmp", "etc", "var", "home"):
            (self.root / name).mkdir(parents=True)
        for package in packages:
            run("dpkg-deb", "-x", package, folder / "system")
        self._system(folder / "system")

    def _system(self, system):
        for name in ("usr/lib/python3.11", "usr/lib/udev", "lib/udev"):
            if (system / name).is_dir():
                shutil.copytree(system / name, self.root / name, dirs_exist_ok=True, ignore_dangling_symlinks=True,
                                ignore=shutil.ignore_patterns("__pycache__", "hwdb.d", "test", "distutils", "sysconfig"))
        self.programs = {"/usr/bin/python3": system / "usr/bin/python3.11", "/bin/udevadm": system / "bin/udevadm",
                         "/bin/busybox": pathlib.Path("/bin/busybox")}
        # Of the machine that builds (tests/kernel/packages.txt), where it need not be the first process.
        for name in ("/lib/systemd/systemd", "/usr/bin/systemd-run", "/usr/bin/systemctl"):
            self.programs[name] = pathlib.Path(name)
        # The Python of the guest compiles its own library here: there each module would cost a tenth of a second.
        run(system / "usr/bin/python3.11", "-I", "-S", "-m", "compileall", "-q", "--invalidation-mode", "unchecked-hash",
            "-s", self.root, "-p", "/", self.root / "usr/lib/python3.11", env={"PYTHONHOME": str(system / "usr")})
        etc = self.root / "etc"
        (etc / "machine-id").write_text("")  # systemd makes one for as long as it runs
        (etc / "passwd").write_text("root:x:0:0:root:/tmp:/bin/sh\noperator:x:1000:1000:operator:/tmp:/bin/sh\n")
        (etc / "group").write_text("root:x:0:\ntty:x:5:\ndisk:x:6:\nkmem:x:15:\ndialout:x:20:operator\n"
                                   "video:x:44:operator\nplugdev:x:46:operator\noperator:x:1000:\n")

    def modules(self):
        """Those of LATER, with an index of their own."""
        base = self.root / "lib/modules" / self.kernel.release
        for file in self.kernel.modules(LATER):
            copy(file, base / "kernel")
            (base / "kernel" / str(file).lstrip("/")).rename(base / "kernel" / file.name)
        shutil.rmtree(base / "kernel" / str(self.kernel.folder).split("/")[1], ignore_errors=True)
        for name in ("modules.order", "modules.builtin"):
            shutil.copy(self.kernel.folder / "lib/modules" / self.kernel.release / name, base)
        run("/sbin/depmod", "-b", self.root, self.kernel.release)

    def add(self, source, place):
        """A file or a folder, by its place in the guest; programs lose their debug symbols."""
        target = self.root / place.lstrip("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "test_*.py"))
        else:
            shutil.copy(source, target)

    def program(self, source, place):
        """A program, with all the libraries that it loads."""
        self.programs[place] = source

    def write(self):
        """The file system, a third larger than what is on it."""
        for place, source in self.programs.items():
            self.add(source, place)
            if source.suffix == "" and source.name != "busybox":
                run("strip", "--strip-unneeded", self.root / place.lstrip("/"))
        for library in libraries([p for p in self.programs.values() if p.name != "busybox"]):
            copy(library, self.root)
        size = sum(f.lstat().st_size + 4096 for f in self.root.rglob("*"))
        self.image.unlink(missing_ok=True)
        run("/sbin/mke2fs", "-q", "-t", "ext4", "-O", "^has_journal", "-d", self.root, self.image, f"{size * 4 // 3 // 1024}k")


def initramfs(folder, kernel):
    """What finds the disk: busybox, five modules with theirs, and guest_init."""
    root, image = folder / "early", folder / "early.gz"
    shutil.rmtree(root, ignore_errors=True)
    for name in ("bin", "dev", "proc", "sys", "root", "modules"):
        (root / name).mkdir(parents=True)
    shutil.copy("/bin/busybox", root / "bin/busybox")
    shutil.copy(HERE / "guest_init", root / "init")
    files = kernel.modules(EARLY)
    for file in files:
        shutil.copy(file, root / "modules")
    (root / "modules/order").write_text("".join(f"{file.name}\n" for file in files))
    run("sh", "-c", f"cd {root} && find . | cpio --quiet -o -H newc -R 0:0 | gzip -1 > {image}")
    return image
