// Checks for cameras on the network: the kernel's buffers, and the interface that they are on.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <arpa/inet.h>
#include <bit>
#include <cstdint>
#include <cstdlib>
#include <sstream>

namespace vitreo::machine {
namespace {

const std::string kReceive = "/proc/sys/net/core/rmem_max";
constexpr int kUsualSocketBuffer = 4 << 20;  // bytes: the default of devices/instruments/genicam
constexpr int kJumbo = 9000;                 // bytes: the usual size of a jumbo frame

struct Interface {
  std::string name;
  int mtu = 0;
  double speed = 0;  // bit/s; 0: not told
  bool up = false;
  bool wireless = false;
};

std::optional<Interface> interface(const Machine& machine, const std::string& name) {
  const std::string folder = "/sys/class/net/" + name;
  const int mtu = std::atoi(machine.line(folder + "/mtu").c_str());
  if (mtu <= 0) return std::nullopt;
  const double speed = 1e6 * std::strtod(machine.line(folder + "/speed").c_str(), nullptr);
  return Interface{name, mtu, std::max(speed, 0.0), machine.line(folder + "/operstate") == "up",
                   machine.has(folder + "/wireless") || machine.has(folder + "/phy80211")};
}

/// Those with a device behind them, not the kernel's own (lo, bridges, tunnels).
std::vector<Interface> wired_interfaces(const Machine& machine) {
  std::vector<Interface> found;
  for (const std::string& name :
       machine.list("/sys/class/net").value_or(std::vector<std::string>{})) {
    if (!machine.has("/sys/class/net/" + name + "/device")) continue;
    const auto one = interface(machine, name);
    if (one && !one->wireless) found.push_back(*one);
  }
  return found;
}

/// The interface of the narrowest network that has the address; "" where only a gateway leads there
/// (GigE Vision finds cameras by broadcast, which no gateway passes on). /proc/net/route has
/// numbers in hexadecimal, in the order of the network.
std::string interface_towards(const Machine& machine, std::uint32_t address) {
  std::istringstream lines(machine.read("/proc/net/route").value_or(""));
  std::string line, best;
  std::getline(lines, line);  // the head
  int narrowest = 0;
  while (std::getline(lines, line)) {
    std::istringstream fields(line);
    std::string name, other;
    std::uint32_t destination = 0, gateway = 0, mask = 0;
    fields >> name >> std::hex >> destination >> gateway;
    for (int i = 0; i < 4; ++i) fields >> other;  // flags, counts, metric
    fields >> std::hex >> mask;
    if (!fields || gateway != 0 || (address & mask) != destination) continue;
    if (std::popcount(mask) > narrowest) {
      narrowest = std::popcount(mask);
      best = name;
    }
  }
  return best;
}

std::vector<std::string> set_mtu(const Machine& machine, const std::string& name) {
  if (!runs(machine, "NetworkManager"))
    return {
        fmt::format("sudo ip link set {} mtu {}  # for good: \"mtu {}\" in "
                    "/etc/network/interfaces",
                    shell_word(name), kJumbo, kJumbo)};
  return {fmt::format("sudo nmcli connection modify \"$(nmcli -g GENERAL.CONNECTION device show "
                      "{})\" 802-3-ethernet.mtu {}",
                      shell_word(name), kJumbo),
          "sudo nmcli device reapply " + shell_word(name)};
}

std::string link_speed(double speed) {
  return speed <= 0     ? "speed not told"
         : speed >= 1e9 ? fmt::format("{:g} Gbit/s", speed / 1e9)
                        : fmt::format("{:g} Mbit/s", speed / 1e6);
}

std::string text_of_interface(const Interface& one) {
  return fmt::format("{} (MTU {}, {})", one.name, one.mtu, link_speed(one.speed));
}

/// A camera on an interface that is known. The packet's size counts its headers (GigE Vision,
/// GevSCPSPacketSize), so it may be as large as the MTU.
Finding check_on(const Scene& scene, const Need& camera, const Interface& one) {
  const std::string name =
      fmt::format("{} ({}) is on {}", camera.role, camera.address.place, text_of_interface(one));
  if (!one.up) return said(State::fault, name + ", which is down: no cable, or no camera");
  if (camera.packet_size > one.mtu)
    return said(State::fault,
                fmt::format("{}; packet_size = {} does not pass", name, camera.packet_size),
                set_mtu(scene.machine, one.name));
  if (one.speed > 0 && 8 * camera.bytes_per_second > one.speed)
    return said(State::fault, fmt::format("{}; its frames are {:.0f} Mbit/s", name,
                                          8 * camera.bytes_per_second / 1e6));
  if (one.wireless) return said(State::warning, name + ", which is wireless: frames will be lost");
  return said(State::good, name);
}

/// A camera whose identity does not say where it is.
Finding check_anywhere(const Scene& scene, const Need& camera) {
  std::vector<std::string> fit, small, commands;
  for (const Interface& one : wired_interfaces(scene.machine)) {
    if (!one.up) continue;
    if (camera.packet_size <= one.mtu) {
      fit.push_back(text_of_interface(one));
      continue;
    }
    small.push_back(text_of_interface(one));
    for (const std::string& line : set_mtu(scene.machine, one.name)) commands.push_back(line);
  }
  const std::string name = camera.role + " (" + camera.address.place + ")";
  if (!fit.empty()) return said(State::good, name + " may be on " + listed(fit));
  if (small.empty()) return said(State::fault, name + ": no wired interface of this machine is up");
  return said(
      State::fault,
      fmt::format("{}: packet_size = {} does not pass {}", name, camera.packet_size, listed(small)),
      commands);
}

Finding check_camera_network(const Scene& scene, const Need& camera) {
  in_addr address{};
  if (inet_pton(AF_INET, camera.address.place.c_str(), &address) != 1)
    return check_anywhere(scene, camera);
  const std::string name = camera.role + " (" + camera.address.place + ")";
  if ((ntohl(address.s_addr) >> 24) == 127) return said(State::good, name + " is on this machine");
  if (!scene.machine.read("/proc/net/route"))
    return said(State::unknown, "/proc/net/route cannot be read");
  const std::string towards = interface_towards(scene.machine, address.s_addr);
  if (towards.empty())
    return said(State::fault,
                name +
                    " is in no network of this machine: give the interface with "
                    "its cable an address there",
                {"ip -brief address"});
  const auto one = interface(scene.machine, towards);
  return one ? check_on(scene, camera, *one)
             : said(State::unknown, name + " is on " + towards + ", of which nothing can be seen");
}

}  // namespace

// The driver asks for its socket buffer at each opening; without root the kernel cuts it to this.
Findings check_socket_buffers(const Scene& scene) {
  int wanted = scene.rig() ? 0 : kUsualSocketBuffer;
  for (const Need& camera : network_cameras(scene)) wanted = std::max(wanted, camera.socket_buffer);
  const std::string text = scene.machine.line(kReceive);
  if (text.empty()) return {said(State::unknown, kReceive + " cannot be read")};
  if (std::atoll(text.c_str()) >= wanted)
    return {said(State::good, "net.core.rmem_max is " + text + " bytes")};
  return {said(
      scene.rig() ? State::fault : State::warning,
      fmt::format("net.core.rmem_max is {} bytes: cameras on the network lose frames; {} "
                  "are wanted",
                  text, wanted),
      {fmt::format("echo net.core.rmem_max={} | sudo tee /etc/sysctl.d/60-vitreo.conf", wanted),
       "sudo sysctl --system"})};
}

// Without a rig it is not known on which interface a camera is, or shall be.
Findings check_network(const Scene& scene) {
  if (scene.rig()) {
    Findings found;
    for (const Need& camera : network_cameras(scene))
      found.push_back(check_camera_network(scene, camera));
    return found;
  }
  std::vector<std::string> names;
  bool jumbo = false;
  for (const Interface& one : wired_interfaces(scene.machine)) {
    names.push_back(text_of_interface(one));
    jumbo = jumbo || one.mtu >= kJumbo;
  }
  if (names.empty())
    return {scene.machine.list("/sys/class/net")
                ? said(State::good, "no wired interface, so no camera on it")
                : said(State::unknown, "/sys/class/net cannot be seen")};
  if (jumbo) return {said(State::good, listed(names))};
  return {said(State::unknown, listed(names) +
                                   ": on which one a camera will be is not known; jumbo "
                                   "frames (MTU 9000) cost less processor time")};
}

}  // namespace vitreo::machine
