// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/zaber/emulator.h"

#include "devices/instruments/zaber/wire.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <limits>
#include <map>
#include <stdexcept>
#include <utility>

namespace vitreo::zaber {
namespace {

/// Numbers of the protocol are whole, without an exponent.
std::string whole(double value) { return std::to_string(std::llround(value)); }

/// One axis: a motion at constant speed from `from` to `to`, begun at `begun`. Its state at a time
/// is computed, not integrated.
struct AxisState {
  explicit AxisState(const EmulatedAxis& its)
      : settings(its), from(its.start), to(its.start), referenced(its.referenced) {
    values = {{"maxspeed", static_cast<double>(speed_data(its.max_speed))},
              {"limit.min", its.limit_min},
              {"limit.max", its.limit_max},
              {"resolution", static_cast<double>(its.resolution)}};
  }
  double speed() const {
    return homing ? settings.home_speed : usteps_per_second(values.at("maxspeed"));
  }
  /// At constant speed: t = |to - from| / v.
  Time arrival() const { return later(begun, from_seconds(std::abs(to - from) / speed())); }
  double at(Time now) const {
    const double gone = std::max(0.0, to_seconds(now - begun)) * speed();
    return gone >= std::abs(to - from) ? to : from + std::copysign(gone, to - from);
  }
  bool moving(Time now) const { return now < arrival() && from != to; }
  /// A blocked position between here and the target ends the motion there, with a stall.
  void set_off(double target, Time now) {
    from = at(now);
    begun = now;
    stalled = held || (jammed && (target - *jammed) * (from - *jammed) < 0);
    to = held ? from : stalled ? *jammed : target;
  }
  /// Without deceleration.
  void stop(Time now) {
    from = to = at(now);
    begun = now;
    homing = false;
  }
  /// The consequences of a motion's end: the stall's flag, the reference of a homing.
  void settle(Time now) {
    if (moving(now)) return;
    if (std::exchange(stalled, false)) flag = "FS";
    if (std::exchange(homing, false) && flag != "FS") {
      from = to = 0;
      begun = now;
      referenced = true;
      flag = "--";
    }
  }
  std::string warning() const { return flag != "--" ? flag : referenced ? "--" : "WR"; }

  EmulatedAxis settings;
  std::map<std::string, double> values;  // the settings that can be written
  double from = 0;                       // usteps
  double to = 0;                         // usteps
  Time begun{};
  bool referenced;
  bool homing = false;
  bool stalled = false;
  bool parked = false;
  std::optional<double> jammed;
  bool held = false;
  std::string flag = "--";
};

/// One device of the chain: its axes, and how it answers.
struct DeviceState {
  explicit DeviceState(const EmulatedDevice& its) : settings(its) {
    for (const EmulatedAxis& axis : its.axes) axes.emplace_back(axis);
  }
  EmulatedDevice settings;
  std::vector<AxisState> axes;
  bool checksum = false;
  bool alert = false;
};

/// Execution of one command by one device: one answer, with the values of all axes that it is for.
/// Ends of motions are settled first: what has ended before the command is seen by it.
class Execution {
 public:
  Execution(DeviceState& device, const Command& command, Time now)
      : device_(device), command_(command), now_(now) {
    for (std::size_t i = 0; i < device.axes.size(); ++i)
      if (command.axis == 0 || command.axis == static_cast<int>(i) + 1)
        axes_.push_back(&device.axes[i]);
  }

  Message run() {
    Message reply;
    reply.device = device_.settings.address;
    reply.axis = command_.axis;
    reply.id = command_.id;
    for (AxisState* const axis : axes_) axis->settle(now_);
    const std::string refusal = axes_.empty() ? "BADAXIS" : execute();
    reply.accepted = refusal.empty();
    reply.data = !refusal.empty() ? refusal : data_.empty() ? "0" : data_;
    for (AxisState* const axis : axes_) {
      reply.busy = reply.busy || axis->moving(now_);
      if (reply.warning == "--") reply.warning = axis->warning();
    }
    return reply;
  }

 private:
  /// The reason for a refusal, or nothing.
  std::string execute() {
    std::string_view rest = command_.data;
    const std::string_view verb = detail::next_word(rest);
    if (verb.empty()) return {};
    if (verb == "get") return get(std::string(detail::next_word(rest)));
    if (verb == "set") return set(rest);
    if (verb == "move") return move(rest);
    if (verb == "home") return each([this](AxisState& axis) { return home(axis); });
    if (verb == "stop" || verb == "estop")
      return each([this](AxisState& axis) {
        if (axis.moving(now_)) axis.flag = "NI";
        axis.stop(now_);
        return "";
      });
    if (verb == "warnings") return warnings(detail::next_word(rest) == "clear");
    if (verb == "tools") return tools(rest);
    return "BADCOMMAND";
  }

  /// `work` returns the reason for a refusal, or nothing; the first refusal ends it.
  template <class Do>
  std::string each(const Do& work) {
    for (AxisState* const axis : axes_)
      if (std::string refusal = work(*axis); !refusal.empty()) return refusal;
    return {};
  }
  void answer(const std::string& value) { data_ += (data_.empty() ? "" : " ") + value; }

  /// Settings of the device are refused with DEVICEONLY when one axis is asked.
  std::string get(const std::string& name) {
    const bool seven = device_.settings.version.rfind("7.", 0) == 0;
    const std::map<std::string, std::string> of_device{
        {"version", device_.settings.version},
        {seven ? "device.id" : "deviceid", std::to_string(device_.settings.device_id)},
        {"system.serial", std::to_string(device_.settings.serial)},
        {"system.axiscount", std::to_string(device_.axes.size())},
        {"comm.checksum", device_.checksum ? "1" : "0"},
        {"comm.alert", device_.alert ? "1" : "0"}};
    if (const auto found = of_device.find(name); found != of_device.end()) {
      if (command_.axis != 0) return "DEVICEONLY";
      answer(found->second);
      return {};
    }
    return each([&](AxisState& axis) -> std::string {
      if (name == "pos") {
        answer(whole(axis.at(now_)));
      } else if (const auto value = axis.values.find(name); value != axis.values.end()) {
        answer(whole(value->second));
      } else {
        return "BADCOMMAND";
      }
      return "";
    });
  }

  /// Communication settings are the device's, all others an axis'.
  std::string set(std::string_view rest) {
    const std::string name(detail::next_word(rest));
    const auto value = decode_numbers(rest);
    if (!value || value->size() != 1) return "BADDATA";
    const double number = value->front();
    if (name == "comm.checksum" || name == "comm.alert") {
      if (command_.axis != 0) return "DEVICEONLY";
      if (number != 0 && number != 1) return "BADDATA";
      (name == "comm.alert" ? device_.alert : device_.checksum) = number == 1;
      return {};
    }
    return each([&](AxisState& axis) -> std::string {
      const auto found = axis.values.find(name);
      if (found == axis.values.end()) return "BADCOMMAND";
      if (name == "maxspeed" && !(number >= 1 && number <= 1e9)) return "BADDATA";
      if (name == "resolution" && !(number >= 1 && number <= 256)) return "BADDATA";
      // What goes on, goes on at another speed from here; what has ended, has ended.
      const bool stalled = axis.stalled;
      axis.set_off(axis.to, now_);
      axis.stalled = stalled;
      found->second = number;
      return "";
    });
  }

  /// abs, rel, min, max. A target outside the limits is BADDATA, and nothing moves; a motion under
  /// way is replaced.
  std::string move(std::string_view rest) {
    const std::string_view how = detail::next_word(rest);
    const auto value = decode_numbers(rest);
    const bool to_end = how == "min" || how == "max";
    if (how != "abs" && how != "rel" && !to_end) return "BADCOMMAND";
    if (!value || value->size() != (to_end ? 0U : 1U)) return "BADDATA";
    return each([&](AxisState& axis) -> std::string {
      const double here = axis.at(now_);
      const double low = axis.values["limit.min"];
      const double high = axis.values["limit.max"];
      const double target = how == "min"   ? low
                            : how == "max" ? high
                            : how == "abs" ? value->front()
                                           : here + value->front();
      if (axis.parked) return "PARKED";
      if (target < low || target > high) return "BADDATA";
      axis.stop(now_);
      axis.flag = "--";
      axis.set_off(target, now_);
      return "";
    });
  }

  /// To 0, which becomes the reference when it is reached; see settle().
  std::string home(AxisState& axis) {
    if (axis.parked) return "PARKED";
    axis.stop(now_);
    axis.flag = "--";
    axis.homing = true;
    axis.set_off(0, now_);
    return {};
  }

  /// "NN F1 F2 ...": a count of two digits, then the flags.
  std::string warnings(bool clear) {
    std::string flags;
    int count = 0;
    for (AxisState* const axis : axes_) {
      if (clear) axis->flag = "--";
      if (axis->warning() == "--") continue;
      ++count;
      flags += " " + axis->warning();
    }
    answer((count < 10 ? "0" : "") + std::to_string(count) + flags);
    return {};
  }

  /// "tools echo" and "tools parking"; a parked axis refuses to move.
  std::string tools(std::string_view rest) {
    const std::string_view which = detail::next_word(rest);
    if (which == "echo") {
      answer(std::string(rest));
      return {};
    }
    const std::string_view what = detail::next_word(rest);
    if (which != "parking" || (what != "park" && what != "unpark")) return "BADCOMMAND";
    return each([&](AxisState& axis) -> std::string {
      if (axis.moving(now_)) return "STATUSBUSY";
      axis.parked = what == "park";
      return "";
    });
  }

  DeviceState& device_;
  const Command& command_;
  const Time now_;
  std::vector<AxisState*> axes_;
  std::string data_;
};

class EmulatedChain final : public Emulator {
 public:
  explicit EmulatedChain(const std::vector<EmulatedDevice>& devices) {
    for (const EmulatedDevice& device : devices) {
      if (device.axes.empty()) throw std::invalid_argument("axes: a device without any");
      for (const DeviceState& other : devices_)
        if (other.settings.address == device.address)
          throw std::invalid_argument("address: two devices have the same");
      devices_.emplace_back(device);
    }
  }

  // A line that is too long is dropped by decode_command(), as by a device.
  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    for (const std::uint8_t byte : bytes) {
      if (byte != '\r' && byte != '\n') {
        if (line_.size() <= kMaxPacket) line_.push_back(static_cast<char>(byte));
        continue;
      }
      if (const auto command = decode_command(line_)) obey(*command, now);
      line_.clear();
    }
  }
  std::vector<TimedBytes> say(Time) override { return std::exchange(said_, {}); }
  Time next() const override { return said_.empty() ? kForever : said_.front().at; }

  double position(std::size_t device, std::size_t axis, Time now) const override {
    return devices_.at(device).axes.at(axis).at(now);
  }
  bool moving(std::size_t device, std::size_t axis, Time now) const override {
    return devices_.at(device).axes.at(axis).moving(now);
  }
  void jam(std::size_t device, std::size_t axis, double at) override {
    devices_.at(device).axes.at(axis).jammed = at;
  }
  void hold(bool held, Time now) override {
    for (DeviceState& device : devices_) {
      for (AxisState& axis : device.axes) {
        const bool moved = axis.moving(now);
        axis.held = held;
        if (!held || !moved) continue;
        axis.stop(now);
        axis.stalled = true;
      }
    }
  }
  /// Communication settings are kept in the device; the reference is lost.
  /// That includes the checksums, so a driver must cope with a device that still sends them.
  void power_cycle(Time now) override {
    for (DeviceState& device : devices_) {
      for (AxisState& axis : device.axes) {
        const double here = axis.at(now);
        axis = AxisState(axis.settings);
        axis.from = axis.to = here;
        axis.referenced = false;
      }
    }
    line_.clear();
    said_.clear();
  }

 private:
  /// Device 0 is every device: each answers once.
  void obey(const Command& command, Time now) {
    for (DeviceState& device : devices_) {
      if (command.device != 0 && command.device != device.settings.address) continue;
      const bool with_checksum = device.checksum;  // the answer to setting it comes as before
      const std::string text = encode(Execution(device, command, now).run(), with_checksum);
      said_.push_back({now, {text.begin(), text.end()}});
    }
  }

  std::vector<DeviceState> devices_;
  std::string line_;
  std::vector<TimedBytes> said_;
};

}  // namespace

std::unique_ptr<Emulator> make_emulator(const std::vector<EmulatedDevice>& devices) {
  if (devices.empty()) throw std::invalid_argument("devices: there is none");
  return std::make_unique<EmulatedChain>(devices);
}

}  // namespace vitreo::zaber
