// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/zaber/driver.h"

#include "devices/instruments/stage_driver.h"
#include "devices/instruments/zaber/wire.h"
#include "devices/links/dialogue.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::zaber {
namespace {

/// Between two questions whether it still moves.
constexpr Time kPoll = std::chrono::milliseconds(20);
/// Before a command that was refused with AGAIN is sent once more.
constexpr Time kAgain = std::chrono::milliseconds(10);
/// A fast stage may need a while to decelerate.
constexpr Time kStopTimeout = std::chrono::seconds(3);
constexpr int kTries = 3;
/// Message ids are of two digits.
constexpr int kIds = 100;
/// How far an axis at rest may be from its target.
constexpr double kSlack_usteps = 2;

/// Settings and state of one axis.
struct Axis {
  AxisSettings settings;
  double unit = 0;    // m or rad per microstep
  double target = 0;  // usteps
  double speed = 0;   // m/s or rad/s, as last set; 0: unknown
};

// Several devices on one line, each of which may have several axes; the stage's axes are any of
// them.
class Chain final : public StageProtocol {
 public:
  Chain(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock, const char* unit)
      : StageProtocol(std::move(link), settings.name, clock), settings_(settings), unit_(unit) {
    for (const AxisSettings& axis : settings.axes) axes_.push_back({axis});
  }
  StageInfo configure() override;
  std::vector<double> position() override;
  void set_off(std::span<const double> target, double speed) override;
  void set_off_home() override;
  bool busy() override;
  void check_arrival(bool homing) override;
  void halt() override;
  void send_halt() override;
  void leave() override;

 private:
  Message ask(int device, int axis, const std::string& data);
  Message ask(const Axis& axis, const std::string& data) {
    return ask(axis.settings.device, axis.settings.axis, data);
  }
  /// What came in an answer's place.
  struct Others {
    std::string unreadable;  // as printable() has it
    bool earlier = false;    // replies to earlier commands
  };
  std::optional<Message> answer(int device, int axis, int id, Others& others);
  double number(const Axis& axis, const std::string& setting);
  void set_and_check(int device, int axis, const std::string& setting, std::int64_t value);
  void keep(int device, int axis, const std::string& setting);
  Identity identify(const AxisSettings& axis);
  StageAxis configure_axis(Axis& axis);
  void set_speed(Axis& axis, double speed);
  double position_to_start(const Axis& axis);

  const Settings settings_;
  const char* const unit_;
  std::vector<Axis> axes_;
  /// Settings that last, as they were found: device, axis, name, value.
  struct Found {
    int device;
    int axis;
    std::string setting;
    std::int64_t value;
  };
  std::vector<Found> found_;
  int id_ = 0;
  bool checksums_ = false;  // replies have one
};

/// For messages.
std::string which(const Axis& axis) { return "axis " + axis.settings.name + ": "; }

/// The reply to the command `id`, or nothing in time. Skipped are replies to other commands (an
/// answer that came too late), informations, alerts, and lines that cannot be read, of which the
/// last is left in `others`.
std::optional<Message> Chain::answer(int device, int axis, int id, Others& others) {
  const Time deadline = later(clock().now(), from_seconds(settings_.reply_timeout));
  for (;;) {
    std::string line;
    try {
      line = dialogue.line('\n', kMaxPacket, deadline);
    } catch (const DeviceError& error) {
      if (error.kind == DeviceErrorKind::lost) throw;
      if (error.kind == DeviceErrorKind::protocol) others.unreadable = error.text;
      return std::nullopt;
    }
    auto message = decode_message(line);
    if (!message || (checksums_ && !message->checked)) {
      others.unreadable = printable(line);
      continue;
    }
    if (message->kind != Kind::reply || message->device != device || message->axis != axis)
      continue;
    if (message->id == id) return message;
    others.earlier = true;
  }
}

/// One exchange. Asking again is safe for all that is asked here: every target is absolute.
/// A refusal by AGAIN means that the device is busy with something else for a moment.
Message Chain::ask(int device, int axis, const std::string& data) {
  Others others;
  for (int i = 1;; ++i) {
    // A new id for each attempt, so that a late answer to the first is not taken for that of the
    // second.
    id_ = (id_ + 1) % kIds;
    dialogue.send(encode(Command{device, axis, id_, data}), data);
    const auto reply = answer(device, axis, id_, others);
    if (!reply && i < kTries) continue;
    if (!reply && !others.unreadable.empty())
      fail(DeviceErrorKind::protocol, "what it says cannot be read: " + others.unreadable);
    if (!reply)
      fail(DeviceErrorKind::timeout,
           "device " + std::to_string(device) + ": " + dialogue.silence() +
               (others.earlier ? "; it answers earlier commands only: is it slow?" : ""));
    if (reply->accepted) return *reply;
    if (reply->data == "AGAIN" && i < kTries) {
      clock().sleep_for(kAgain);
      continue;
    }
    fail(DeviceErrorKind::refused,
         "device " + std::to_string(device) + " refuses \"" + data + "\": " + meaning(reply->data));
  }
}

/// A setting of one axis, in the instrument's unit.
double Chain::number(const Axis& axis, const std::string& setting) {
  const Message reply = ask(axis, "get " + setting);
  const auto numbers = decode_numbers(reply.data);
  if (!numbers || numbers->size() != 1)
    fail(DeviceErrorKind::protocol,
         which(axis) + setting + " is no number: " + printable(reply.data));
  return numbers->front();
}

/// Before it is changed for the first time: the maker's own program must find it as it was.
void Chain::keep(int device, int axis, const std::string& setting) {
  const auto same = [&](const Found& one) {
    return one.device == device && one.axis == axis && one.setting == setting;
  };
  if (std::any_of(found_.begin(), found_.end(), same)) return;
  const auto now = decode_numbers(ask(device, axis, "get " + setting).data);
  if (now && now->size() == 1)
    found_.push_back(
        {device, axis, setting, static_cast<std::int64_t>(std::llround(now->front()))});
}

/// The last that was changed first, so that the checksums of the replies go last.
void Chain::leave() {
  for (auto one = found_.rbegin(); one != found_.rend(); ++one)
    ask(one->device, one->axis, "set " + one->setting + " " + std::to_string(one->value));
  found_.clear();
}

/// A device rounds or clips some settings with a note only, so each is read back.
void Chain::set_and_check(int device, int axis, const std::string& setting, std::int64_t value) {
  ask(device, axis, "set " + setting + " " + std::to_string(value));
  const auto now = decode_numbers(ask(device, axis, "get " + setting).data);
  if (!now || now->size() != 1 || now->front() != static_cast<double>(value))
    fail(DeviceErrorKind::refused,
         "device " + std::to_string(device) + " does not keep its " + setting);
}

/// Checksums are asked for as soon as the devices are known; until then a reply without one is
/// accepted, and one with a wrong checksum never. Alerts are switched off: they come unasked in the
/// middle of an exchange.
StageInfo Chain::configure() {
  checksums_ = false;
  dialogue.send("\n");  // ends what a host that died may have begun
  dialogue.discard();
  StageInfo info;
  for (const Axis& axis : axes_) {
    const Identity identity = identify(axis.settings);
    if (info.identity.name.empty()) info.identity = identity;
  }
  for (const Axis& axis : axes_) {
    for (const auto& [setting, value] : {std::pair{"comm.checksum", 1}, {"comm.alert", 0}}) {
      keep(axis.settings.device, 0, setting);
      set_and_check(axis.settings.device, 0, setting, value);
    }
  }
  checksums_ = true;
  halt();
  for (Axis& axis : axes_) info.axes.push_back(configure_axis(axis));
  return info;
}

/// The setting for the device's model is `device.id` since firmware 7, `deviceid` before. It is a
/// number: the model's name is in Zaber's tables only.
Identity Chain::identify(const AxisSettings& axis) {
  const std::string device = std::to_string(axis.device);
  const auto text = [&](const char* setting) {
    return ask(axis.device, 0, std::string("get ") + setting).data;
  };
  std::string version;
  try {
    version = text("version");
  } catch (const DeviceError& error) {
    if (error.kind != DeviceErrorKind::protocol && error.kind != DeviceErrorKind::refused) throw;
    fail(DeviceErrorKind::not_found, "there is no Zaber device " + device + ": " + error.text);
  }
  const auto firmware = decode_numbers(version);
  if (!firmware || firmware->size() != 1)
    fail(DeviceErrorKind::not_found,
         "there is no Zaber device " + device + ": its version is " + printable(version));
  dialogue.identified();
  if (firmware->front() < 6.06)
    fail(DeviceErrorKind::not_found,
         "firmware " + version + " is too old; 6.06 is the first that numbers its replies");
  const std::string id = text(firmware->front() >= 7 ? "device.id" : "deviceid");
  if (axis.device_id && id != std::to_string(*axis.device_id))
    fail(DeviceErrorKind::not_found, "device " + device + " is a Zaber " + printable(id) +
                                         ", not a " + std::to_string(*axis.device_id));
  return {"Zaber device " + id, text("system.serial"), version};
}

/// Limits are the narrower of the instrument's and the rig file's; its own are in microsteps, of
/// which `resolution` are a full step.
/// Microsteps become m or rad by the size of a full step, which only the data sheet has.
StageAxis Chain::configure_axis(Axis& axis) {
  const AxisSettings& wanted = axis.settings;
  const double resolution = number(axis, "resolution");
  if (!(resolution >= 1))
    fail(DeviceErrorKind::protocol, which(axis) + "its resolution is not positive");
  axis.unit = wanted.step / resolution;
  StageAxis shown;
  shown.name = wanted.name;
  shown.travel_min = std::max(wanted.travel_min, number(axis, "limit.min") * axis.unit);
  shown.travel_max = std::min(wanted.travel_max, number(axis, "limit.max") * axis.unit);
  if (!(shown.travel_min < shown.travel_max))
    fail(DeviceErrorKind::refused, which(axis) + "its travel and the rig file's do not overlap");
  shown.max_speed = wanted.max_speed;
  shown.speed = wanted.speed;
  shown.resolution = axis.unit;
  axis.speed = 0;
  set_speed(axis, wanted.speed);
  return shown;
}

/// Unknown while the exchange goes on: should it fail, the next motion sets it anew.
void Chain::set_speed(Axis& axis, double speed) {
  if (speed == axis.speed) return;
  const std::int64_t data = std::max<std::int64_t>(1, speed_data(speed / axis.unit));
  axis.speed = 0;
  keep(axis.settings.device, axis.settings.axis, "maxspeed");
  set_and_check(axis.settings.device, axis.settings.axis, "maxspeed", data);
  axis.speed = speed;
}

// One question an axis: during a motion the numbers are of moments some milliseconds apart.
std::vector<double> Chain::position() {
  std::vector<double> positions;
  for (const Axis& axis : axes_) positions.push_back(number(axis, "pos") * axis.unit);
  return positions;
}

/// m or rad. Refuses an axis without a reference, or with a fault. A device itself accepts a motion
/// without a reference, and only warns (WR).
double Chain::position_to_start(const Axis& axis) {
  ask(axis, "warnings clear");  // a stall of the last motion would else look like one of this
  const Message status = ask(axis, "get pos");
  const auto here = decode_numbers(status.data);
  if (!here || here->size() != 1)
    fail(DeviceErrorKind::protocol, which(axis) + "its position is no number");
  if (status.warning == kNoReference)
    fail(DeviceErrorKind::refused, which(axis) + "it does not know where it is; home it first");
  if (is_fault(status.warning))
    fail(DeviceErrorKind::refused, which(axis) + meaning(status.warning));
  return here->front() * axis.unit;
}

/// Each axis is a device with a speed of its own: v_i = v |d_i| / max |d|, so that all arrive
/// together and the path is straight.
void Chain::set_off(std::span<const double> target, double speed) {
  double longest = 0;
  std::vector<double> ways;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    ways.push_back(std::abs(target[i] - position_to_start(axes_[i])));
    longest = std::max(longest, ways.back());
  }
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    axes_[i].target = std::round(target[i] / axes_[i].unit);
    // An axis that is at its target keeps its speed: 0 is none.
    if (ways[i] > axes_[i].unit / 2) set_speed(axes_[i], speed * ways[i] / longest);
  }
  for (const Axis& axis : axes_) ask(axis, "move abs " + std::to_string(std::llround(axis.target)));
}

// Flags of an earlier motion are cleared first, or they would look like failures of this one.
void Chain::set_off_home() {
  for (const Axis& axis : axes_) ask(axis, "warnings clear");
  for (const Axis& axis : axes_) ask(axis, "home");
}

/// An empty command only asks for the status. A fault of any axis ends the motion of all.
bool Chain::busy() {
  bool any = false;
  for (const Axis& axis : axes_) {
    const Message status = ask(axis, "");
    if (is_fault(status.warning))
      fail(DeviceErrorKind::refused, which(axis) + meaning(status.warning));
    any = any || status.busy;
  }
  return any;
}

/// IDLE is not arrival: a stop at the panel or a stall ends a motion as well.
void Chain::check_arrival(bool homing) {
  for (const Axis& axis : axes_) {
    if (homing && ask(axis, "").warning == kNoReference)
      fail(DeviceErrorKind::refused, which(axis) + "it has not found its reference");
    if (homing) continue;
    const double here = number(axis, "pos");
    if (std::abs(here - axis.target) > kSlack_usteps)
      fail(DeviceErrorKind::refused,
           which(axis) + "it stands at " + position_text(here * axis.unit, unit_) +
               ", not at its target of " + position_text(axis.target * axis.unit, unit_));
  }
}

/// Stops every axis, whatever the others answer, and waits until all stand still.
/// The first pass does not wait for standstill, so that no axis goes on while another is waited
/// for.
void Chain::halt() {
  std::exception_ptr failure;
  for (const Axis& axis : axes_) {
    try {
      ask(axis, "stop");
    } catch (const DeviceError&) {
      failure = std::current_exception();
    }
  }
  if (failure) std::rethrow_exception(failure);
  const Time deadline = later(clock().now(), kStopTimeout);
  for (const Axis& axis : axes_) {
    while (ask(axis, "").busy) {
      if (clock().now() >= deadline)
        fail(DeviceErrorKind::timeout, which(axis) + "it does not stop");
      clock().sleep_for(kPoll);
    }
  }
}

/// Without an id: no reply is waited for.
void Chain::send_halt() {
  for (const Axis& axis : axes_) {
    try {
      dialogue.send(
          encode(Command{axis.settings.device, axis.settings.axis, std::nullopt, "stop"}));
    } catch (const DeviceError&) {  // the next axis may still hear it
    }
  }
}

// Infinite travel is allowed: the instrument's own limits hold then.
void check(const AxisSettings& axis) {
  const auto positive = [](double value) { return std::isfinite(value) && value > 0; };
  if (axis.name.empty()) throw std::invalid_argument("axes: an axis must have a name");
  if (axis.device < 1 || axis.device > 99) throw std::invalid_argument("device: must be 1 to 99");
  if (axis.axis < 1 || axis.axis > 9) throw std::invalid_argument("axis: must be 1 to 9");
  if (!positive(axis.step)) throw std::invalid_argument("step: must be positive");
  if (!positive(axis.max_speed)) throw std::invalid_argument("max_speed: must be positive");
  if (!positive(axis.speed) || axis.speed > axis.max_speed)
    throw std::invalid_argument("speed: must be positive and at most max_speed");
  if (!(axis.travel_min < axis.travel_max))
    throw std::invalid_argument("travel_min: must be below travel_max");
}

}  // namespace

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (axes.empty()) throw std::invalid_argument("axes: there must be one at least");
  for (const AxisSettings& axis : axes) {
    zaber::check(axis);
    for (const AxisSettings& other : axes)
      if (&other != &axis && other.device == axis.device && other.axis == axis.axis)
        throw std::invalid_argument("device, axis: " + axis.name + " and " + other.name +
                                    " are the same one");
  }
  if (!std::isfinite(reply_timeout) || reply_timeout <= 0)
    throw std::invalid_argument("reply_timeout: must be positive");
}

std::unique_ptr<Stage> open(std::unique_ptr<ByteLink> link, const Settings& settings,
                            Clock& clock) {
  settings.check();
  return make_stage(std::make_unique<Chain>(std::move(link), settings, clock, "m"));
}

std::unique_ptr<RotationStage> open_rotary(std::unique_ptr<ByteLink> link, const Settings& settings,
                                           Clock& clock) {
  settings.check();
  if (settings.axes.size() != 1) throw std::invalid_argument("axes: a rotation stage has one");
  return make_rotation_stage(std::make_unique<Chain>(std::move(link), settings, clock, "rad"));
}

}  // namespace vitreo::zaber
