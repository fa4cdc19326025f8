// Insides of the FireWire bus: its nodes, the programs that opened them, their rings of packets.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/devices/firewire/bus.h"

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <functional>
#include <linux/firewire-cdev.h>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {

/// An entry of the ring: room for some packets, one behind the other.
struct IsoSlot {
  std::uint8_t* data = nullptr;
  std::uint32_t room = 0;     ///< bytes of one packet
  std::uint32_t packets = 0;  ///< how many it takes
  std::uint32_t filled = 0;
  bool interrupt = false;  ///< tells the program when it is full
  bool sync = false;       ///< waits for the first packet of an image
};

struct IsoResource {
  int channel = -1;
  int bandwidth = 0;
  std::uint64_t closure = 0;
};

/// One opened node.
struct FireWireClient {
  int end = -1;  ///< the bus' end of its socket; events are its messages
  int node = -1;
  bool wants_resets = false;
  bool receives = false;  ///< has an isochronous context
  bool running = false;
  std::uint32_t channel = 0;
  std::uint32_t header_size = 0;
  std::uint32_t sync = 0;
  std::uint64_t closure = 0;
  std::deque<IsoSlot> ring{};
  std::vector<std::uint32_t> headers{};              ///< of the packets since the last interrupt
  std::map<std::uint32_t, IsoResource> resources{};  ///< by their handles
};

struct FireWireNode {
  FireWireCamera camera;
  std::vector<std::uint32_t> rom;
  int socket = -1;
  bool answers = true;  ///< false: it left the bus
  bool shut = false;    ///< and its node is gone
  int lost_packet = -1;
  std::uint32_t packet_bytes = 0;
  std::uint32_t channel = 0;
  /// What to do with the answers of the double, in their order.
  std::deque<std::function<void(std::int32_t, std::uint32_t)>> asked{};
  std::thread thread{};
};

/// All of it is guarded by `mutex`. The functions of the system return a negative errno.
struct FireWireBus::State {
  State();
  ~State();
  void plug(const FireWireCamera& camera, const std::string& socket);
  int open(const std::string& path);
  void close(int descriptor);
  /// Without the mutex: asked at each call of this process, also by the bus itself.
  bool holds(int descriptor) const {
    return descriptor >= 0 && descriptor < static_cast<int>(held_.size()) &&
           held_[static_cast<std::size_t>(descriptor)];
  }
  int ioctl(int descriptor, unsigned long request, void* argument);

  std::filesystem::path folder;  ///< stands in for /dev
  mutable std::mutex mutex;
  std::vector<std::uint64_t> strays;
  std::vector<std::unique_ptr<FireWireNode>> nodes;
  int bandwidth = 0;

 private:
  void serve(FireWireNode& node);
  bool take_frame(FireWireNode& node);
  void leave(FireWireNode& node);
  void image(FireWireNode& node, std::span<const std::uint8_t> frame);
  void packet(FireWireClient& client, std::span<const std::uint8_t> payload, bool first,
              std::uint32_t cycle);
  void ask(FireWireNode& node, char kind, std::initializer_list<std::uint32_t> words,
           std::function<void(std::int32_t, std::uint32_t)> then);
  void respond(int descriptor, std::uint64_t closure, std::uint32_t rcode,
               std::span<const std::uint32_t> data);
  int request(int descriptor, FireWireClient& client, const fw_cdev_send_request& what);
  void quadlet(int descriptor, FireWireNode& node, const fw_cdev_send_request& what);
  int allocate(FireWireClient& client, fw_cdev_allocate_iso_resource& what);
  int deallocate(FireWireClient& client, std::uint32_t handle);
  int queue(FireWireClient& client, const fw_cdev_queue_iso& what);
  int information(FireWireClient& client, fw_cdev_get_info& what);
  int start(FireWireClient& client, const fw_cdev_start_iso& what);
  void free_resource(const IsoResource& resource);
  void tell_reset();

  std::map<int, FireWireClient> clients_;
  std::uint64_t channels_ = 0;
  std::uint32_t generation_ = 1;
  std::array<std::atomic<bool>, 1024> held_{};
  std::condition_variable changed_;
  bool ending_ = false;
};

/// The bus that the calls of this process meet; null where there is none.
extern std::atomic<FireWireBus::State*> firewire_bus;

}  // namespace vitreo
