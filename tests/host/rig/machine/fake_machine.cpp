// SPDX-License-Identifier: Apache-2.0
#include "tests/host/rig/machine/fake_machine.h"

#include "host/rig/machine/udev_rules.h"

namespace vitreo::machine {
namespace {

const std::string kHub = "/sys/devices/pci0000:00/0000:00:14.0/usb1/";
const std::string kRecord = "E:ID_VENDOR=x\nE:ID_MM_DEVICE_IGNORE=1\nG:uaccess\nQ:uaccess\n";

}  // namespace

void FakeMachine::user_in(const std::string& groups) const {
  std::string numbers;
  for (const std::string group : {"dialout", "plugdev", "video"})
    if (groups.find(group) != std::string::npos)
      numbers += fmt::format("{} ", own_group_ ? getegid() : number_of(group));
  // No user of this machine: so the files' owner, who runs the test, is somebody else.
  write("/proc/self/status",
        fmt::format("Name:\tvitreo\nPid:\t900\nUid:\t{0}\t{0}\t{0}\t{0}\nGid:\t{0}\t{0}\t{0}\t{0}\n"
                    "Groups:\t{1}\nCapEff:\t0000000000000000\n",
                    54321, numbers));
}

void FakeMachine::plug(const Usb& usb) const {
  const std::string folder = kHub + usb.place;
  const int number = usb.place.back() - '0' + 1;
  const auto attribute = [&](const char* name, const std::string& text) {
    if (!text.empty()) write(folder + "/" + name, text + "\n");
  };
  attribute("idVendor", usb.vendor);
  attribute("idProduct", usb.product);
  attribute("bcdDevice", "0600");
  attribute("bDeviceClass", "00");
  attribute("serial", usb.serial);
  attribute("manufacturer", usb.maker);
  attribute("product", usb.name);
  attribute("speed", usb.speed);
  attribute("version", usb.version);
  attribute("busnum", "1");
  attribute("devnum", std::to_string(number));
  attribute("dev", fmt::format("189:{}", number));
  attribute("power/control", "on");
  const std::string part = folder + "/" + usb.place + ":1.0/";
  write(part + "bInterfaceClass", usb.interface.substr(0, 2) + "\n");
  write(part + "bInterfaceSubClass", usb.interface.substr(2, 2) + "\n");
  write(part + "bInterfaceProtocol", usb.interface.substr(4, 2) + "\n");
  const std::string up = "../../../devices/pci0000:00/0000:00:14.0/usb1/" + usb.place;
  link("/sys/bus/usb/devices/" + usb.place, up);
  link("/sys/bus/usb/devices/" + usb.place + ":1.0", up + "/" + usb.place + ":1.0");
  udev(fmt::format("189:{}", number), kRecord);
  node(fmt::format("/dev/bus/usb/001/{:03}", number), "plugdev");
}

void FakeMachine::unplug(const std::string& place) const {
  remove("/sys/bus/usb/devices/" + place);
  remove("/sys/bus/usb/devices/" + place + ":1.0");
  remove(kHub + place);
}

void FakeMachine::give_node(const std::string& place, const std::string& kind,
                            const std::string& name, const std::string& numbers) const {
  const std::string folder = place + "/" + place + ":1.0/" + kind + "/" + name;
  write(kHub + folder + "/dev", numbers + "\n");
  link("/sys/class/" + kind + "/" + name, "../../devices/pci0000:00/0000:00:14.0/usb1/" + folder);
  udev(numbers, kRecord);
  node((kind == "input" ? "/dev/input/" : "/dev/") + name, kind == "tty"           ? "dialout"
                                                           : kind == "video4linux" ? "video"
                                                                                   : "plugdev");
}

// A Debian 12 desktop: eight cores, one wired interface, what octomag_lab names.
FakeMachine::FakeMachine() {
  for (const char* const file : {"idVendor", "idProduct"}) write(kHub + file, "1d6b\n");
  write(kHub + "bDeviceClass", "09\n");
  link("/sys/bus/usb/devices/usb1", "../../../devices/pci0000:00/0000:00:14.0/usb1");
  plug({"1-1", "09db", "009c", "01A2B3C4", "MCC", "USB-3103", "030000"});
  give_node("1-1", "hidraw", "hidraw0", "241:0");
  plug({"1-2", "1ffb", "00b3", "00123456", "Pololu Corporation", "Tic T825"});
  plug({"1-3", "0403", "6001", "A50285BI", "FTDI", "FT232R USB UART"});
  give_node("1-3", "tty", "ttyUSB0", "188:0");
  plug({"1-4", "2676", "ba02", "21731234", "Basler", "acA1300-60gm", "ef0500", "5000", " 3.00"});
  plug({"1-5", "046d", "0825", "", "Logitech", "Webcam C270", "0e0100", "480"});
  give_node("1-5", "video4linux", "video0", "81:0");
  user_in("dialout plugdev video");
  const unsigned own = getegid();
  const auto group = [&](const char* name, unsigned usual) {
    return fmt::format("{}:x:{}:\n", name, own_group_ ? own : usual);
  };
  write("/etc/group",
        "root:x:0:\n" + group("dialout", 1020) + group("plugdev", 1046) + group("video", 1044));
  write("/etc/passwd", "root:x:0:0::/root:/bin/sh\nalice:x:54321:54321::/home/alice:/bin/sh\n");
  write("/usr/lib/udev/rules.d/60-vitreo.rules", udev_rules());
  write("/usr/bin/udevadm", "");
  write("/usr/lib/udev/rules.d/50-udev-default.rules", "SUBSYSTEM==\"tty\", GROUP=\"dialout\"\n");
  write("/proc/sys/net/core/rmem_max", "16777216\n");
  write("/sys/class/net/enp3s0/mtu", "9000\n");
  write("/sys/class/net/enp3s0/speed", "1000\n");
  write("/sys/class/net/enp3s0/operstate", "up\n");
  write("/sys/class/net/enp3s0/device/vendor", "0x8086\n");
  write("/sys/class/net/lo/mtu", "65536\n");
  // 192.168.1.0/24 on enp3s0, and a gateway.
  write("/proc/net/route",
        "Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT\n"
        "enp3s0\t00000000\tFE01A8C0\t0003\t0\t0\t100\t00000000\t0\t0\t0\n"
        "enp3s0\t0001A8C0\t00000000\t0001\t0\t0\t100\t00FFFFFF\t0\t0\t0\n");
  write("/sys/module/usbcore/parameters/usbfs_memory_mb", "1000\n");
  write("/sys/power/state", "freeze mem disk\n");
  write("/run/systemd/system/unit", "");
  write("/run/user/54321/systemd/private", "");
  write("/usr/bin/systemd-run", "");
  write("/proc/self/cgroup", "0::/user.slice/user-54321.slice/session-2.scope\n");
  write("/etc/systemd/sleep.conf.d/60-vitreo.conf", "[Sleep]\nAllowSuspend=no\n");
  write("/sys/class/input/input1/capabilities/sw", "1\n");
  write("/sys/devices/system/cpu/cpufreq/policy0/scaling_governor", "performance\n");
  write("/sys/devices/system/cpu/cpufreq/policy0/scaling_driver", "intel_pstate\n");
  write("/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu sse2 avx avx2\n");
  write("/proc/self/limits",
        "Limit                     Soft Limit           Hard Limit           Units     \n"
        "Max nice priority         0                    0                    \n"
        "Max realtime priority     10                   10                   \n");
  write("/proc/self/mountinfo",
        "22 1 8:1 / / rw,relatime shared:1 - ext4 /dev/sda1 rw\n"
        "30 22 0:40 / /srv rw,relatime shared:2 - nfs4 server:/srv rw\n");
  process(1, "systemd");
  process(700, "systemd-timesyn");
  process(900, "vitreo");  // the doctor itself
  std::filesystem::create_directories(at("/home/alice"));
  chmod(at("/home/alice").c_str(), 0777);
}

RigNeeds laboratory_needs() {
  constexpr double kFrames = 1280.0 * 1024 * 30;  // bytes/s
  return {"lab",
          {{"coils", "usb3103", {"hid", "09db:009c:01A2B3C4"}},
           {"lens_mover", "pololu_tic", {"usb", "1ffb:00b3"}},
           {"stage", "sutter_mp285", {"serial", "/dev/ttyUSB0"}},
           {"side_camera", "opencv_camera", {"video", "/dev/video0"}},
           {"top_camera", "genicam", {"genicam", "192.168.1.7"}, kFrames, 8000, 4 << 20}}};
}

Wanted wanted_without_rig() {
  Wanted wanted;
  wanted.rules = udev_rules();
  wanted.runs = "/home/alice/runs";
  wanted.least_bytes = 1'064'000'000;
  wanted.least_time = 600;
  return wanted;
}

Wanted wanted_for_laboratory() {
  Wanted wanted = wanted_without_rig();
  wanted.rig = laboratory_needs();
  return wanted;
}

}  // namespace vitreo::machine
