// Requests, bus resets and packets, as Linux' drivers/firewire has them.
// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/firewire/bus.h"

#include "tests/devices/firewire/rom.h"
#include "tests/devices/firewire/state.h"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <stdexcept>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

namespace vitreo {

std::atomic<FireWireBus::State*> firewire_bus{nullptr};

namespace {

using namespace std::chrono_literals;

constexpr std::uint64_t kSpace = 0xFFFFF0000000;  // where a node's registers begin
constexpr std::uint64_t kRom = kSpace + 0x400;    // IEEE 1212
constexpr std::uint64_t kRegisters = kSpace + 0xF00000;
constexpr std::uint32_t kIsoData = 0x60C;            // channel << 28
constexpr std::uint32_t kBytePerPacket = 0x1000044;  // of Format 7, mode 0, << 16
constexpr std::uint32_t kNodeId = 0xFFC0;
constexpr std::uint32_t kAbi = 5;          // of Linux 6.1
constexpr auto kShutdownDelay = 2s;        // core-device.c, SHUTDOWN_DELAY
constexpr std::size_t kHeaderRoom = 4096;  // core-cdev.c: a page; an old client loses the rest
constexpr int kBandwidth = 4915;           // IEEE 1394, BANDWIDTH_AVAILABLE
constexpr std::int64_t kCycle = 125000;    // ns

std::int64_t bus_time() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1000000000LL + now.tv_nsec;
}
/// 7 bits of seconds, 13 of cycles, 12 of an offset in 1/3072.
std::uint32_t cycle_timer(std::int64_t time) {
  const auto seconds = static_cast<std::uint32_t>(time / 1000000000 % 128);
  const auto within = time % 1000000000;
  return seconds << 25 | static_cast<std::uint32_t>(within / kCycle) << 12 |
         static_cast<std::uint32_t>(within % kCycle * 3072 / kCycle);
}

template <typename Event>
void send_event(int end, const Event& event, std::span<const std::uint32_t> words = {}) {
  // The words follow the fixed part at once; the structure's own padding is behind it.
  const std::size_t head = words.empty() ? sizeof event : offsetof(fw_cdev_event_response, data);
  std::vector<std::uint8_t> bytes(head + words.size_bytes());
  std::memcpy(bytes.data(), &event, head);
  if (!words.empty()) std::memcpy(bytes.data() + head, words.data(), words.size_bytes());
  ::send(end, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}
// Both kinds of event that carry words have them at the same place.
static_assert(offsetof(fw_cdev_event_response, data) ==
              offsetof(fw_cdev_event_iso_interrupt, header));

bool receive(int socket, void* into, std::size_t size) {
  return ::recv(socket, into, size, MSG_WAITALL) == static_cast<ssize_t>(size);
}

int connect_to(const std::string& path) {
  sockaddr_un where{};
  where.sun_family = AF_UNIX;
  path.copy(where.sun_path, sizeof where.sun_path - 1);
  const int socket = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (::connect(socket, reinterpret_cast<const sockaddr*>(&where), sizeof where) != 0)
    throw std::runtime_error("the double's socket: " + std::string(std::strerror(errno)));
  return socket;
}

}  // namespace

FireWireBus::FireWireBus() : state_(std::make_unique<State>()) { firewire_bus = state_.get(); }
FireWireBus::~FireWireBus() { firewire_bus = nullptr; }
void FireWireBus::plug(const FireWireCamera& camera, const std::string& socket) {
  state_->plug(camera, socket);
}
int FireWireBus::bandwidth() const {
  const std::scoped_lock lock(state_->mutex);
  return state_->bandwidth;
}
std::vector<std::uint64_t> FireWireBus::strays() const {
  const std::scoped_lock lock(state_->mutex);
  return state_->strays;
}
void FireWireBus::lose_packet(std::uint64_t guid, int packet) {
  const std::scoped_lock lock(state_->mutex);
  for (const auto& node : state_->nodes)
    if (node->camera.guid == guid) node->lost_packet = packet;
}

FireWireBus::State::State() {
  std::string name = (std::filesystem::temp_directory_path() / "vitreo_fw_XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no folder for the bus");
  folder = name;
}
FireWireBus::State::~State() {
  {
    const std::scoped_lock lock(mutex);
    ending_ = true;
    for (const auto& node : nodes)
      if (node->socket >= 0) ::shutdown(node->socket, SHUT_RDWR);
  }
  changed_.notify_all();
  for (const auto& node : nodes)
    if (node->thread.joinable()) node->thread.join();
  for (auto& [descriptor, client] : clients_) ::close(client.end);
  std::filesystem::remove_all(folder);
}

// A node that is found again within the delay is the one that it was ("rediscovered device").
void FireWireBus::State::plug(const FireWireCamera& camera, const std::string& socket) {
  std::unique_lock lock(mutex);
  FireWireNode* found = nullptr;
  for (const auto& node : nodes)
    if (node->camera.guid == camera.guid && !node->shut) found = node.get();
  if (found == nullptr) {
    nodes.push_back(std::make_unique<FireWireNode>());
    found = nodes.back().get();
    found->camera = camera;
    found->rom = configuration_rom(camera);
    std::ofstream(folder / ("fw" + std::to_string(nodes.size() - 1)));
  } else if (!changed_.wait_for(lock, kShutdownDelay, [&] { return !found->answers; })) {
    throw std::runtime_error("it is plugged in");
  }
  found->socket = connect_to(socket);
  found->answers = true;
  tell_reset();
  if (!found->thread.joinable()) found->thread = std::thread([this, found] { serve(*found); });
  changed_.notify_all();
}

// Each device that comes or goes resets the bus.
void FireWireBus::State::tell_reset() {
  ++generation_;
  for (auto& [descriptor, client] : clients_)
    if (client.wants_resets && nodes[static_cast<std::size_t>(client.node)]->answers)
      send_event(client.end,
                 fw_cdev_event_bus_reset{0, FW_CDEV_EVENT_BUS_RESET, kNodeId, kNodeId + 1,
                                         kNodeId + 1, kNodeId + 1, kNodeId + 1, generation_});
}

// A camera that leaves the bus is waited for before its node goes.
void FireWireBus::State::serve(FireWireNode& node) {
  for (;;) {
    while (take_frame(node)) {
    }
    std::unique_lock lock(mutex);
    leave(node);
    changed_.wait_for(lock, kShutdownDelay, [&] { return ending_ || node.answers; });
    if (node.answers && !ending_) continue;
    node.shut = true;
    const auto at = std::find_if(nodes.begin(), nodes.end(),
                                 [&](const auto& each) { return each.get() == &node; });
    const auto number = static_cast<int>(at - nodes.begin());
    std::error_code ignored;
    std::filesystem::remove(folder / ("fw" + std::to_string(number)), ignored);
    for (auto& [descriptor, client] : clients_)
      if (client.node == number) ::shutdown(client.end, SHUT_RDWR);
    return;
  }
}

// What was asked and not answered fails; the bus has another generation.
void FireWireBus::State::leave(FireWireNode& node) {
  ::close(node.socket);
  node.socket = -1;
  node.answers = false;
  node.packet_bytes = 0;
  tell_reset();
  auto asked = std::move(node.asked);
  node.asked.clear();
  for (auto& then : asked) then(-EIO, 0);
  changed_.notify_all();
}

bool FireWireBus::State::take_frame(FireWireNode& node) {
  std::uint32_t size = 0;
  if (!receive(node.socket, &size, sizeof size)) return false;
  std::vector<std::uint8_t> frame(size);
  if (size == 0 || !receive(node.socket, frame.data(), size)) return false;
  const std::scoped_lock lock(mutex);
  if (frame[0] == 'P') {
    image(node, frame);
  } else if (frame[0] == 'A' && size >= 5 && !node.asked.empty()) {
    std::int32_t result = 0;
    std::uint32_t value = 0;
    std::memcpy(&result, &frame[1], 4);
    if (size >= 9) std::memcpy(&value, &frame[5], 4);
    auto then = std::move(node.asked.front());
    node.asked.pop_front();
    then(result, value);
  }
  return true;
}

void FireWireBus::State::ask(FireWireNode& node, char kind,
                             std::initializer_list<std::uint32_t> words,
                             std::function<void(std::int32_t, std::uint32_t)> then) {
  std::vector<std::uint8_t> frame(5 + 4 * words.size());
  const auto size = static_cast<std::uint32_t>(1 + 4 * words.size());
  std::memcpy(frame.data(), &size, 4);
  frame[4] = static_cast<std::uint8_t>(kind);
  std::memcpy(frame.data() + 5, words.begin(), 4 * words.size());
  node.asked.push_back(std::move(then));
  ::send(node.socket, frame.data(), frame.size(), MSG_NOSIGNAL);
}

// The double says when an image is whole: its last packet is there now, the others came before.
void FireWireBus::State::image(FireWireNode& node, std::span<const std::uint8_t> frame) {
  constexpr std::size_t kHead = 1 + 4 + 8 + 2 + 2;
  if (frame.size() <= kHead || node.packet_bytes == 0) return;
  const std::span<const std::uint8_t> pixels = frame.subspan(kHead);
  const std::size_t size = node.packet_bytes;
  const std::size_t count = (pixels.size() + size - 1) / size;
  const std::int64_t now = bus_time();
  for (std::size_t i = 0; i < count; ++i) {
    if (static_cast<int>(i) == node.lost_packet) continue;
    // The last one is filled up to the size of all.
    std::vector<std::uint8_t> payload(size);
    const auto part = pixels.subspan(i * size, std::min(size, pixels.size() - i * size));
    std::copy(part.begin(), part.end(), payload.begin());
    const auto when = now - static_cast<std::int64_t>(count - i) * kCycle;
    for (auto& [descriptor, client] : clients_)
      if (client.running && client.channel == node.channel)
        packet(client, payload, i == 0, cycle_timer(when) >> 12 & 0xFFFF);
  }
}

// linux/firewire-cdev.h, fw_cdev_iso_packet and fw_cdev_event_iso_interrupt.
void FireWireBus::State::packet(FireWireClient& client, std::span<const std::uint8_t> payload,
                                bool first, std::uint32_t cycle) {
  if (client.ring.empty()) return;
  IsoSlot& slot = client.ring.front();
  const std::uint32_t sy = first ? 1 : 0;
  if (slot.sync && slot.filled == 0 && sy != client.sync) return;
  std::memcpy(slot.data + std::size_t{slot.filled} * slot.room, payload.data(),
              std::min<std::size_t>(slot.room, payload.size()));
  if (client.headers.size() * 4 + client.header_size <= kHeaderRoom) {
    const auto length = static_cast<std::uint32_t>(payload.size());
    client.headers.push_back(htonl(length << 16 | client.channel << 8 | 0xA0 | sy));
    if (client.header_size >= 8) client.headers.push_back(htonl(cycle));
  }
  if (++slot.filled < slot.packets) return;
  if (slot.interrupt) {
    fw_cdev_event_iso_interrupt event{};
    event.closure = client.closure;
    event.type = FW_CDEV_EVENT_ISO_INTERRUPT;
    event.cycle = cycle;
    event.header_length = static_cast<std::uint32_t>(client.headers.size() * 4);
    send_event(client.end, event, client.headers);
    client.headers.clear();
  }
  client.ring.pop_front();
}

int FireWireBus::State::open(const std::string& path) {
  const std::scoped_lock lock(mutex);
  const std::string name = path.substr(std::strlen("/dev/fw"));
  const std::size_t number = std::strtoul(name.c_str(), nullptr, 10);
  if (number >= nodes.size()) return -ENOENT;
  if (nodes[number]->shut) return -ENODEV;
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) != 0) return -errno;
  if (ends[0] >= static_cast<int>(held_.size())) return -EMFILE;
  held_[static_cast<std::size_t>(ends[0])] = true;
  FireWireClient& client = clients_[ends[0]];
  client.end = ends[1];
  client.node = static_cast<int>(number);
  return ends[0];
}

void FireWireBus::State::close(int descriptor) {
  const std::scoped_lock lock(mutex);
  const auto found = clients_.find(descriptor);
  if (found == clients_.end()) return;
  for (const auto& [handle, resource] : found->second.resources) free_resource(resource);
  ::close(found->second.end);
  clients_.erase(found);
  held_[static_cast<std::size_t>(descriptor)] = false;
}

void FireWireBus::State::free_resource(const IsoResource& resource) {
  if (resource.channel >= 0) channels_ &= ~(std::uint64_t{1} << resource.channel);
  bandwidth -= resource.bandwidth;
}

int FireWireBus::State::ioctl(int descriptor, unsigned long request_code, void* argument) {
  const std::scoped_lock lock(mutex);
  FireWireClient& client = clients_.at(descriptor);
  if (nodes[static_cast<std::size_t>(client.node)]->shut) return -ENODEV;
  switch (request_code) {
    case FW_CDEV_IOC_GET_INFO:
      return information(client, *static_cast<fw_cdev_get_info*>(argument));
    case FW_CDEV_IOC_SEND_REQUEST:
      return request(descriptor, client, *static_cast<fw_cdev_send_request*>(argument));
    case FW_CDEV_IOC_ALLOCATE_ISO_RESOURCE:
      return allocate(client, *static_cast<fw_cdev_allocate_iso_resource*>(argument));
    case FW_CDEV_IOC_DEALLOCATE_ISO_RESOURCE:
      return deallocate(client, static_cast<fw_cdev_deallocate*>(argument)->handle);
    case FW_CDEV_IOC_CREATE_ISO_CONTEXT: {
      auto& what = *static_cast<fw_cdev_create_iso_context*>(argument);
      if (client.receives) return -EBUSY;
      if (what.type != FW_CDEV_ISO_CONTEXT_RECEIVE || what.header_size % 4 != 0) return -EINVAL;
      client.receives = true;
      client.header_size = what.header_size;
      client.channel = what.channel;
      client.closure = what.closure;
      what.handle = 0;
      return 0;
    }
    case FW_CDEV_IOC_QUEUE_ISO:
      return queue(client, *static_cast<fw_cdev_queue_iso*>(argument));
    case FW_CDEV_IOC_START_ISO:
      return start(client, *static_cast<fw_cdev_start_iso*>(argument));
    case FW_CDEV_IOC_STOP_ISO:
      client.running = false;
      return 0;
    case FW_CDEV_IOC_GET_CYCLE_TIMER: {
      auto& what = *static_cast<fw_cdev_get_cycle_timer*>(argument);
      timespec now{};
      ::clock_gettime(CLOCK_REALTIME, &now);
      what.local_time =
          static_cast<__u64>(now.tv_sec) * 1000000 + static_cast<__u64>(now.tv_nsec / 1000);
      what.cycle_timer = cycle_timer(bus_time());
      return 0;
    }
    default:
      return -ENOTTY;
  }
}

int FireWireBus::State::information(FireWireClient& client, fw_cdev_get_info& what) {
  const std::vector<std::uint32_t>& rom = nodes[static_cast<std::size_t>(client.node)]->rom;
  const auto bytes = static_cast<std::uint32_t>(rom.size() * 4);
  if (what.rom != 0)
    std::memcpy(reinterpret_cast<void*>(what.rom), rom.data(), std::min(what.rom_length, bytes));
  what.rom_length = bytes;
  what.version = kAbi;
  what.card = 0;
  client.wants_resets = true;
  if (what.bus_reset != 0) {
    const fw_cdev_event_bus_reset reset{what.bus_reset_closure,
                                        FW_CDEV_EVENT_BUS_RESET,
                                        kNodeId,
                                        kNodeId + 1,
                                        kNodeId + 1,
                                        kNodeId + 1,
                                        kNodeId + 1,
                                        generation_};
    std::memcpy(reinterpret_cast<void*>(what.bus_reset), &reset, sizeof reset);
  }
  return 0;
}

void FireWireBus::State::respond(int descriptor, std::uint64_t closure, std::uint32_t rcode,
                                 std::span<const std::uint32_t> data) {
  const auto client = clients_.find(descriptor);
  if (client == clients_.end()) return;
  fw_cdev_event_response event{};
  event.closure = closure;
  event.type = FW_CDEV_EVENT_RESPONSE;
  event.rcode = rcode;
  event.length = static_cast<std::uint32_t>(data.size_bytes());
  send_event(client->second.end, event, data);
}

int FireWireBus::State::request(int descriptor, FireWireClient& client,
                                const fw_cdev_send_request& what) {
  FireWireNode& node = *nodes[static_cast<std::size_t>(client.node)];
  if (!node.answers || what.generation != generation_)
    respond(descriptor, what.closure, RCODE_GENERATION, {});
  else if (what.length != 4 ||
           (what.tcode != TCODE_READ_QUADLET_REQUEST && what.tcode != TCODE_WRITE_QUADLET_REQUEST))
    respond(descriptor, what.closure, RCODE_TYPE_ERROR, {});
  else
    quadlet(descriptor, node, what);
  return 4;
}

// The ROM is the bus' own, the registers are the double's. Both are big-endian on the wire.
void FireWireBus::State::quadlet(int descriptor, FireWireNode& node,
                                 const fw_cdev_send_request& what) {
  const bool reads = what.tcode == TCODE_READ_QUADLET_REQUEST;
  const std::uint64_t closure = what.closure;
  if (what.offset >= kRegisters) {
    const auto offset = static_cast<std::uint32_t>(what.offset - kRegisters);
    const auto then = [=, this](std::int32_t result, std::uint32_t value) {
      const std::uint32_t data = htonl(value);
      const std::span<const std::uint32_t> words(&data, reads && result >= 0 ? 1 : 0);
      respond(descriptor, closure, result >= 0 ? RCODE_COMPLETE : RCODE_NO_ACK, words);
    };
    std::uint32_t data = 0;
    if (!reads) std::memcpy(&data, reinterpret_cast<const void*>(what.data), 4);
    if (reads)
      ask(node, 'Q', {offset}, then);
    else
      ask(node, 'W', {offset, ntohl(data)}, then);
    return;
  }
  const std::uint64_t at = (what.offset - kRom) / 4;
  if (!reads) {
    strays.push_back(what.offset);
    respond(descriptor, closure, RCODE_COMPLETE, {});
  } else if (what.offset >= kRom && at < node.rom.size()) {
    const std::uint32_t data = htonl(node.rom[at]);
    respond(descriptor, closure, RCODE_COMPLETE, {&data, 1});
  } else {
    respond(descriptor, closure, RCODE_ADDRESS_ERROR, {});
  }
}

// What does not fit is told by the event, not by the call. Handles count from 0 in each client.
int FireWireBus::State::allocate(FireWireClient& client, fw_cdev_allocate_iso_resource& what) {
  IsoResource resource{-1, 0, what.closure};
  for (int i = 0; i < 64 && resource.channel < 0; ++i)
    if ((what.channels & ~channels_ & std::uint64_t{1} << i) != 0) resource.channel = i;
  const auto units = static_cast<int>(what.bandwidth);
  if (resource.channel >= 0 && bandwidth + units <= kBandwidth) {
    channels_ |= std::uint64_t{1} << resource.channel;
    bandwidth += resource.bandwidth = units;
  } else {
    resource.channel = -1;
  }
  what.handle = 0;
  while (client.resources.count(what.handle) != 0) ++what.handle;
  client.resources[what.handle] = resource;
  send_event(client.end,
             fw_cdev_event_iso_resource{what.closure, FW_CDEV_EVENT_ISO_RESOURCE_ALLOCATED,
                                        what.handle, resource.channel, resource.bandwidth});
  return 0;
}

int FireWireBus::State::deallocate(FireWireClient& client, std::uint32_t handle) {
  const auto found = client.resources.find(handle);
  if (found == client.resources.end()) return -EINVAL;
  const IsoResource resource = found->second;
  free_resource(resource);
  client.resources.erase(found);
  send_event(client.end,
             fw_cdev_event_iso_resource{resource.closure, FW_CDEV_EVENT_ISO_RESOURCE_DEALLOCATED,
                                        handle, resource.channel, resource.bandwidth});
  return 0;
}

int FireWireBus::State::queue(FireWireClient& client, const fw_cdev_queue_iso& what) {
  if (!client.receives) return -EINVAL;
  auto* data = reinterpret_cast<std::uint8_t*>(what.data);
  const auto* controls = reinterpret_cast<const std::uint32_t*>(what.packets);
  for (std::size_t i = 0; i < what.size / 4; ++i) {
    const std::uint32_t control = controls[i];
    const std::uint32_t headers = control >> 24;
    const std::uint32_t payload = control & 0xFFFF;
    if (headers == 0 || headers % client.header_size != 0 || payload == 0) return -EINVAL;
    IsoSlot slot;
    slot.data = data;
    slot.packets = headers / client.header_size;
    slot.room = payload / slot.packets;
    slot.interrupt = (control & FW_CDEV_ISO_INTERRUPT) != 0;
    slot.sync = (control & FW_CDEV_ISO_SYNC) != 0;
    client.ring.push_back(slot);
    data += payload;
  }
  return 0;
}

// How the camera sends is its own affair: it is asked, not told.
int FireWireBus::State::start(FireWireClient& client, const fw_cdev_start_iso& what) {
  FireWireNode& node = *nodes[static_cast<std::size_t>(client.node)];
  if (!client.receives || client.ring.empty()) return -EINVAL;
  client.running = true;
  client.sync = what.sync;
  if (!node.answers) return 0;
  ask(node, 'Q', {kBytePerPacket},
      [&node](std::int32_t, std::uint32_t value) { node.packet_bytes = value >> 16; });
  ask(node, 'Q', {kIsoData},
      [&node](std::int32_t, std::uint32_t value) { node.channel = value >> 28; });
  return 0;
}

}  // namespace vitreo
