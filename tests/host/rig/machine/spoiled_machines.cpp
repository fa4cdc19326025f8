// SPDX-License-Identifier: Apache-2.0
#include "tests/host/rig/machine/spoiled_machines.h"

namespace vitreo::machine {

std::vector<Spoiled> access_and_rivals() {
  return {
      {"the user is in no group", [](FakeMachine& m) { m.user_in(""); }, "groups", State::fault,
       "alice is not in", "sudo usermod -aG"},
      {"the group came after the login",
       [](FakeMachine& m) {
         m.user_in("");
         const std::string group = m.machine().read("/etc/group").value();
         std::string joined;
         for (const char c : group)
           joined += c == '\n' ? std::string("alice\n") : std::string(1, c);
         m.write("/etc/group", joined);
       },
       "groups", State::fault, "log out", "newgrp"},
      {"a node is root's alone", [](FakeMachine& m) { m.node("/dev/hidraw0", "root", 0600); },
       "permissions", State::fault, "/dev/hidraw0 (coils)", kRules},
      {"the rules are not installed",
       [](FakeMachine& m) { m.remove("/usr/lib/udev/rules.d/60-vitreo.rules"); }, "udev_rules",
       State::fault, "not installed", "vitreo docs udev | sudo tee"},
      {"the rules are of another version",
       [](FakeMachine& m) {
         m.write("/etc/udev/rules.d/60-vitreo.rules", "SUBSYSTEM==\"usb\", MODE=\"0666\"\n");
       },
       "udev_rules", State::warning, "not that of this version", "vitreo docs udev"},
      {"the rules are switched off",
       [](FakeMachine& m) { m.link("/etc/udev/rules.d/60-vitreo.rules", "/dev/null"); },
       "udev_rules", State::fault, "switches", "sudo rm /etc/udev/rules.d/60-vitreo.rules"},
      {"the rules came after the plugging",
       [](FakeMachine& m) { m.udev("241:0", "E:ID_VENDOR=x\n"); }, "udev_rules", State::warning,
       "/dev/hidraw0 (coils)", "udevadm trigger"},
      {"udev's records cannot be seen", [](FakeMachine& m) { m.remove("/run/udev/data/c241:0"); },
       "udev_rules", State::unknown, "/dev/hidraw0", ""},
      {"ModemManager may take the stage's port",
       [](FakeMachine& m) {
         m.process(650, "ModemManager");
         m.udev("188:0", "G:uaccess\n");
         m.udev("189:4", "G:uaccess\n");
       },
       "modem_manager", State::warning, "/dev/ttyUSB0 (stage)", "udevadm trigger"},
      {"brltty has a rule for the adapter",
       [](FakeMachine& m) {
         m.write("/usr/lib/udev/rules.d/85-brltty.rules",
                 "ENV{PRODUCT}==\"403/6001/*\", ATTRS{manufacturer}==\"FTDI\", "
                 "ENV{BRLTTY_BRAILLE_DRIVER}=\"hw\"\n");
       },
       "brltty", State::fault, "FT232R", "ln -sf /dev/null /etc/udev/rules.d/85-brltty.rules"},
      {"brltty runs",
       [](FakeMachine& m) {
         m.process(651, "brltty");
         m.write("/usr/lib/systemd/system/brltty.service", "[Unit]\n");
       },
       "brltty", State::warning, "Braille", "systemctl mask --now brltty.service"},
      {"a terminal program has the stage's port",
       [](FakeMachine& m) {
         m.process(812, "picocom");
         m.link("/proc/812/fd/3", "/dev/ttyUSB0");
       },
       "ports_in_use", State::fault, "picocom (812)", ""},
      {"a run has it",
       [](FakeMachine& m) {
         m.process(813, "vitreo");
         m.link("/proc/813/fd/7", "/dev/ttyUSB0");
       },
       "ports_in_use", State::warning, "vitreo (813)", ""},
      {"another user's program cannot be looked into",
       [](FakeMachine& m) {
         m.write("/proc/814/comm", "other\n");  // no fd/ that could be listed
       },
       "ports_in_use", State::unknown, "1 of other users", "fuser"},
  };
}

std::vector<Spoiled> usb_and_network() {
  return {
      {"USB lets the adapter sleep",
       [](FakeMachine& m) {
         m.write("/sys/devices/pci0000:00/0000:00:14.0/usb1/1-3/power/control", "auto\n");
       },
       "usb_power", State::warning, "usb 1-3", "/sys/bus/usb/devices/1-3/power/control"},
      {"a USB 3 webcam is on USB 2",
       [](FakeMachine& m) {
         m.write("/sys/devices/pci0000:00/0000:00:14.0/usb1/1-5/version", " 2.10\n");
       },
       "usb_speed", State::warning, "480 Mbit/s", ""},
      {"the kernel does not tell a speed",
       [](FakeMachine& m) { m.remove("/sys/devices/pci0000:00/0000:00:14.0/usb1/1-2/speed"); },
       "usb_speed", State::unknown, "lens_mover", ""},
      {"the kernel's socket buffers are small",
       [](FakeMachine& m) { m.write("/proc/sys/net/core/rmem_max", "212992\n"); }, "socket_buffers",
       State::fault, "212992", "net.core.rmem_max=4194304"},
      {"the kernel's socket buffers are not told",
       [](FakeMachine& m) { m.remove("/proc/sys/net/core/rmem_max"); }, "socket_buffers",
       State::unknown, "cannot be read", ""},
      {"packets do not pass the interface",
       [](FakeMachine& m) { m.write("/sys/class/net/enp3s0/mtu", "1500\n"); }, "network",
       State::fault, "packet_size = 8000", "ip link set enp3s0 mtu 9000"},
      {"packets do not pass, with NetworkManager",
       [](FakeMachine& m) {
         m.write("/sys/class/net/enp3s0/mtu", "1500\n");
         m.process(660, "NetworkManager");
       },
       "network", State::fault, "packet_size = 8000", "nmcli connection modify"},
      {"the link is too slow for the frames",
       [](FakeMachine& m) { m.write("/sys/class/net/enp3s0/speed", "100\n"); }, "network",
       State::fault, "315 Mbit/s", ""},
      {"no cable", [](FakeMachine& m) { m.write("/sys/class/net/enp3s0/operstate", "down\n"); },
       "network", State::fault, "down", ""},
      {"the camera's network is only behind the gateway",
       [](FakeMachine& m) {
         m.write("/proc/net/route", "head\nenp3s0\t00000000\tFE01A8C0\t0003\t0\t0\t0\t00000000\n");
       },
       "network", State::fault, "in no network", "ip -brief address"},
      {"the routes cannot be seen", [](FakeMachine& m) { m.remove("/proc/net/route"); }, "network",
       State::unknown, "/proc/net/route", ""},
      {"the camera is wireless",
       [](FakeMachine& m) { m.write("/sys/class/net/enp3s0/wireless/x", ""); }, "network",
       State::warning, "wireless", ""},
  };
}

std::vector<Spoiled> instruments() {
  return {
      {"the stage's port is gone",
       [](FakeMachine& m) {
         m.unplug("1-3");
         m.remove("/sys/class/tty/ttyUSB0");
         m.remove("/dev/ttyUSB0");
       },
       "instruments", State::fault, "stage: /dev/ttyUSB0", ""},
      {"the coils' device is gone",
       [](FakeMachine& m) {
         m.unplug("1-1");
         m.remove("/sys/class/hidraw/hidraw0");
       },
       "instruments", State::fault, "coils: hid:09db:009c:01A2B3C4 is not plugged in", ""},
      {"there are two lens movers",
       [](FakeMachine& m) {
         m.plug({"1-6", "1ffb", "00b3", "00777777", "Pololu Corporation", "Tic T825"});
       },
       "instruments", State::fault, ":00123456 or :00777777", ""},
      {"the coils' device has no node",
       [](FakeMachine& m) { m.remove("/sys/class/hidraw/hidraw0"); }, "instruments", State::fault,
       "no hidraw node", "modprobe"},
      {"two adapters can change places",
       [](FakeMachine& m) {
         m.plug({"1-6", "0403", "6001", "B1", "FTDI", "FT232R USB UART"});
         m.give_node("1-6", "tty", "ttyUSB1", "188:1");
         m.link("/dev/serial/by-id/usb-FTDI_A50285BI-if00", "../../ttyUSB0");
         // As udev makes it, before the rename.
         m.link("/dev/serial/by-id/.#usb-FTDI_A50285BI-if0092fe7b42f3e173c0", "../../ttyUSB0");
       },
       "instruments", State::warning, "serial:/dev/serial/by-id/usb-FTDI_A50285BI-if00", ""},
  };
}

std::vector<Spoiled> computer() {
  const auto awake = [](FakeMachine& m) { m.remove("/etc/systemd/sleep.conf.d"); };
  const auto no_lid = [](FakeMachine& m) { m.remove("/sys/class/input"); };
  const std::string mend = "AllowSuspend=no";
  return {
      {"the lid suspends", awake, "sleep", State::fault, "closing the lid", mend},
      {"idleness suspends",
       [=](FakeMachine& m) {
         awake(m);
         no_lid(m);
         m.write("/etc/systemd/logind.conf", "[Login]\nIdleAction=suspend\nIdleActionSec=15min\n");
       },
       "sleep", State::fault, "15min without input", mend},
      {"a desktop may suspend",
       [=](FakeMachine& m) {
         awake(m);
         no_lid(m);
         m.process(1500, "gsd-power");
       },
       "sleep", State::unknown, "GNOME", mend},
      {"a container does not tell", [](FakeMachine& m) { m.remove("/sys/power"); }, "sleep",
       State::unknown, "/sys/power/state", ""},
      {"no systemd",
       [=](FakeMachine& m) {
         awake(m);
         m.remove("/run/systemd");
         m.write("/proc/self/cgroup", "0::/\n");  // nor is there a group to be killed
       },
       "sleep", State::unknown, "systemd does not run", ""},
      {"the clock runs free",
       [](FakeMachine& m) {
         m.clock = false;
         m.remove("/proc/700");
       },
       "clock", State::warning, "no time service", "apt-get install systemd-timesyncd"},
      {"the clock's service is off",
       [](FakeMachine& m) {
         m.clock = false;
         m.remove("/proc/700");
         m.write("/usr/lib/systemd/systemd-timesyncd", "");
       },
       "clock", State::warning, "no time service", "timedatectl set-ntp true"},
      {"the clock does not tell", [](FakeMachine& m) { m.clock.reset(); }, "clock", State::unknown,
       "not known", ""},
      {"no AVX2", [](FakeMachine& m) { m.write("/proc/cpuinfo", "flags\t: fpu sse2\n"); }, "cpu",
       State::warning, "half the speed", ""},
      {"no flags", [](FakeMachine& m) { m.write("/proc/cpuinfo", "Features\t: fp asimd\n"); },
       "cpu", State::unknown, "/proc/cpuinfo", ""},
      {"a governor that saves power",
       [](FakeMachine& m) {
         const std::string policy = "/sys/devices/system/cpu/cpufreq/policy0/";
         m.write(policy + "scaling_governor", "powersave\n");
         m.write(policy + "scaling_driver", "acpi-cpufreq\n");
       },
       "cpu_speed", State::warning, "powersave", "echo performance"},
      {"a preference that saves power",
       [](FakeMachine& m) {
         const std::string policy = "/sys/devices/system/cpu/cpufreq/policy0/";
         m.write(policy + "scaling_governor", "powersave\n");
         m.write(policy + "energy_performance_preference", "power\n");
       },
       "cpu_speed", State::warning, "powersave", "echo performance"},
      {"no governor", [](FakeMachine& m) { m.remove("/sys/devices/system/cpu"); }, "cpu_speed",
       State::unknown, "virtual machine", ""},
      {"no real time",
       [](FakeMachine& m) {
         m.write("/proc/self/limits", "Max realtime priority     0        0\n");
       },
       "priority", State::warning, "real time", "rtprio 10"},
      {"the limit is not told", [](FakeMachine& m) { m.remove("/proc/self/limits"); }, "priority",
       State::unknown, "/proc/self/limits", ""},
      {"no manager that makes a scope", [](FakeMachine& m) { m.remove("/run/user/54321/systemd"); },
       "guardian", State::warning, "session-2.scope", ""},
      {"the control group is not told", [](FakeMachine& m) { m.remove("/proc/self/cgroup"); },
       "guardian", State::unknown, "/proc/self/cgroup", ""},
      {"a full disk", [](FakeMachine& m) { m.free = 900'000'000; }, "disk", State::fault,
       "does not begin", "du -xh"},
      {"a disk for a few minutes", [](FakeMachine& m) { m.free = 10'000'000'000; }, "disk",
       State::warning, "room for 227 s", "du -xh"},  // (10 - 1.064) GB at 39.3 MB/s
      {"a disk that does not tell", [](FakeMachine& m) { m.free.reset(); }, "disk", State::unknown,
       "not known", ""},
      {"a folder of another user", [](FakeMachine& m) { chmod(m.at("/home/alice").c_str(), 0755); },
       "disk", State::fault, "may not be written", "sudo install -d -o \"$USER\" /home/alice/runs"},
      {"a runs' folder of another user",
       [](FakeMachine& m) {
         std::filesystem::create_directories(m.at("/home/alice/runs"));
         chmod(m.at("/home/alice/runs").c_str(), 0755);
       },
       "disk", State::fault, "may not be written", "sudo chown \"$USER\" /home/alice/runs"},
      {"a disk that is read-only",
       [](FakeMachine& m) {
         m.write("/proc/self/mountinfo", "22 1 8:1 / / ro,relatime - ext4 /dev/sda1 ro\n");
       },
       "disk", State::fault, "read-only", ""},
      {"a disk on the network",
       [](FakeMachine& m) {
         m.write("/proc/self/mountinfo", "22 1 8:1 / / rw,relatime shared:1 - nfs4 server:/ rw\n");
       },
       "disk", State::fault, "nfs4", ""},
      {"a disk in memory",
       [](FakeMachine& m) {
         m.write("/proc/self/mountinfo", "22 1 8:1 / / rw - tmpfs tmpfs rw\n");
       },
       "disk", State::warning, "tmpfs", ""},
  };
}

}  // namespace vitreo::machine
