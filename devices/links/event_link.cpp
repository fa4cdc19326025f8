// SPDX-License-Identifier: Apache-2.0
#include "devices/links/event_link.h"

#include "devices/time/error.h"

#include <algorithm>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>

namespace vitreo {
namespace {

/// How often a reader checks whether a test has pulled the cable: faults are set without a signal.
constexpr Time kEventCheck = std::chrono::milliseconds(50);

class MemoryEventLink final : public EventLink {
 public:
  MemoryEventLink(EventPeer& peer, Clock& clock, const LinkFaults* faults)
      : peer_(peer), clock_(clock), faults_(faults), device_(peer.device()) {
    reopen();
  }
  const std::string& address() const override { return address_; }
  const EventDevice& device() const override { return device_; }

  const EventState& state() override {
    check_cable();
    for (collect(); !coming_.empty() && coming_.front().at <= clock_.now(); coming_.pop_front()) {
      const TimedEvent& event = coming_.front();
      state_.at = event.at;
      if (event.button)
        state_.pressed.at(event.place) = event.value != 0;
      else
        state_.axes.at(event.place) = event.value;
    }
    return state_;
  }

  bool wait(Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      check_cable();
      collect();
      if (!coming_.empty() && coming_.front().at <= clock_.now()) return true;
      if (clock_.now() >= deadline) return false;
      clock_.sleep_until(std::min({deadline, peer_.next(), later(clock_.now(), kEventCheck),
                                   coming_.empty() ? kForever : coming_.front().at}));
    }
  }

  void reopen() override {
    check_cable();
    peer_.say(clock_.now());
    coming_.clear();
    state_ = peer_.state(clock_.now());
  }

 private:
  void check_cable() const {
    if (faults_ != nullptr && faults_->unplugged)
      throw DeviceError(DeviceErrorKind::lost, address_, "is gone");
  }
  void collect() {
    for (TimedEvent event : peer_.say(clock_.now())) {
      if (faults_ != nullptr && faults_->silent) continue;
      if (faults_ != nullptr) event.at = later(event.at, faults_->late);
      if (!coming_.empty()) event.at = std::max(event.at, coming_.back().at);
      coming_.push_back(event);
    }
  }

  const std::string address_ = "emulated";
  EventPeer& peer_;
  Clock& clock_;
  const LinkFaults* const faults_;
  const EventDevice device_;
  EventState state_;
  std::deque<TimedEvent> coming_;
};

namespace fs = std::filesystem;

std::string sysfs_line(const fs::path& file) {
  std::ifstream stream(file);
  std::string line;
  std::getline(stream, line);
  return line;
}
std::uint16_t sysfs_number(const fs::path& file) {
  return static_cast<std::uint16_t>(std::strtoul(sysfs_line(file).c_str(), nullptr, 16));
}

/// Bits of a capability: words of 64 in hexadecimal, the highest first, as the kernel lists them.
bool has_any(const fs::path& file, unsigned first, unsigned last) {
  std::istringstream stream(sysfs_line(file));
  std::vector<std::uint64_t> words;
  for (std::string word; stream >> word;)
    words.insert(words.begin(), std::strtoull(word.c_str(), nullptr, 16));
  for (unsigned bit = first; bit <= last; ++bit)
    if (bit / 64 < words.size() && (words[bit / 64] >> bit % 64 & 1) != 0) return true;
  return false;
}

}  // namespace

std::unique_ptr<EventLink> memory_event_link(EventPeer& peer, Clock& clock,
                                             const LinkFaults* faults) {
  return std::make_unique<MemoryEventLink>(peer, clock, faults);
}

std::vector<EventNode> list_event_nodes(const std::string& listing) {
  // linux/input-event-codes.h: BTN_JOYSTICK to BTN_THUMBR, ABS_X and ABS_Y.
  constexpr unsigned kFirstButton = 0x120, kLastButton = 0x13E, kLastAxis = 1;
  std::vector<EventNode> nodes;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(listing, none)) {
    const std::string name = entry.path().filename();
    if (!name.starts_with("event")) continue;
    const fs::path device = entry.path() / "device";
    nodes.push_back({"/dev/input/" + name, sysfs_line(device / "name"),
                     sysfs_number(device / "id/vendor"), sysfs_number(device / "id/product"),
                     sysfs_line(device / "uniq"),
                     has_any(device / "capabilities/abs", 0, kLastAxis) &&
                         has_any(device / "capabilities/key", kFirstButton, kLastButton)});
  }
  std::sort(nodes.begin(), nodes.end(),
            [](const EventNode& a, const EventNode& b) { return a.node < b.node; });
  return nodes;
}

}  // namespace vitreo
