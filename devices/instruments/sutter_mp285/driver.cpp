// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mp285/driver.h"

#include "devices/instruments/stage_driver.h"
#include "devices/instruments/sutter_mp285/wire.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::sutter_mp285 {
namespace {

using namespace std::chrono_literals;

constexpr Time kBetween = 2ms;  // it wants a rest between commands
constexpr Time kSilence =
    20ms;  // after which two bytes were all: 13 of them take 13.5 ms at 9600 baud
constexpr Time kMotionMargin = 1s;
constexpr double kMotionFactor =
    1.25;                        // how much longer than distance over speed a motion may take
constexpr int kHandshake = 777;  // um/s: what no other instrument would say back
constexpr double kFinestMax = 1310e-6;  // m/s: above it only steps of 0.2 um
constexpr double kCoarsestMax = 3000e-6;
constexpr int kSlack_usteps = 5;  // one coarse step
constexpr double kMicro = 1e-6;

class Mp285 final : public StageProtocol {
 public:
  Mp285(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock)
      : StageProtocol(std::move(link), settings.name, clock), settings_(settings) {}
  StageInfo configure() override;
  std::vector<double> position() override;
  void set_off(std::span<const double> target, double speed) override;
  void set_off_home() override {
    fail(DeviceErrorKind::refused, "it has no reference that it could find");
  }
  bool busy() override;
  void check_arrival(bool homing) override;
  void halt() override;
  void tell_to_halt() override;

 private:
  Time reply_deadline() const {
    return later(clock().now(), from_seconds(settings_.reply_timeout));
  }
  void send(const Command& command);
  void expect_end(Time deadline);
  ByteString block(const Command& question, std::size_t size);
  Usteps where();
  Status status();
  void set_velocity(double speed);
  void resynchronize();
  Clock& clock() const { return dialogue.clock(); }
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    dialogue.fail(kind, what);
  }
  [[noreturn]] void fail(const Fault& fault) const;

  const Settings settings_;
  bool unsure_ = false;  // an exchange was broken off: something of it may still come
  SetVelocity velocity_{};
  bool moving_ = false;
  Usteps from_{}, target_{};
  double speed_ = 0;  // m/s
  Time begun_{}, deadline_{};
};

void Mp285::fail(const Fault& fault) const {
  if (fault.interrupted) fail(DeviceErrorKind::refused, "its motion was interrupted");
  if (fault.bad_command) fail(DeviceErrorKind::protocol, "it did not understand the command");
  fail(DeviceErrorKind::protocol, "bytes were lost on their way to it");
}

/// Nobody talks to it while it moves.
void Mp285::send(const Command& command) {
  if (unsure_) resynchronize();
  clock().sleep_for(kBetween);
  dialogue.discard();
  unsure_ = true;
  dialogue.send(encode(command));
}

/// The CR that says that a command was obeyed; an error comes in its place.
void Mp285::expect_end(Time deadline) {
  const std::uint8_t first = dialogue.take(1, deadline).front();
  if (first == kEnd) {
    unsure_ = false;
    return;
  }
  const auto fault = decode_fault(first);
  if (!fault || dialogue.take(1, deadline).front() != kEnd)
    fail(DeviceErrorKind::protocol, "an answer that is none: " + printable(std::span(&first, 1)));
  unsure_ = false;
  fail(*fault);
}

/// `size` bytes and a CR. An error is told from data by its being alone: data, too, may begin with
/// '4' and CR.
ByteString Mp285::block(const Command& question, std::size_t size) {
  send(question);
  const Time deadline = reply_deadline();
  ByteString reply = dialogue.take(2, deadline);
  const auto fault = decode_fault(reply[0]);
  if (fault && reply[1] == kEnd) {
    const auto more = dialogue.next(later(clock().now(), kSilence));
    if (!more) {
      unsure_ = false;
      fail(*fault);
    }
    reply.push_back(*more);
  }
  const ByteString rest = dialogue.take(size + 1 - reply.size(), deadline);
  reply.insert(reply.end(), rest.begin(), rest.end());
  if (reply.back() != kEnd)
    fail(DeviceErrorKind::protocol, "an answer without its end: " + printable(reply));
  unsure_ = false;
  return reply;
}

Usteps Mp285::where() { return *decode_position(block(GetPosition{}, kPositionSize)); }
Status Mp285::status() { return *decode_status(block(GetStatus{}, kStatusSize)); }

/// After an answer that did not come or could not be read. The interrupt ends whatever it was at;
/// it locks up when an answer is abandoned, so everything it may still say is heard out.
void Mp285::resynchronize() {
  unsure_ = false;
  dialogue.send(encode(Interrupt{}));
  dialogue.settle(2 * kSilence);
  moving_ = false;
}

void Mp285::set_velocity(double speed) {
  const SetVelocity wanted{std::max(1, static_cast<int>(speed / kMicro + 0.5)),
                           speed <= kFinestMax};
  if (wanted.speed == velocity_.speed && wanted.fine == velocity_.fine) return;
  send(wanted);
  expect_end(reply_deadline());
  velocity_ = wanted;
}

/// After power-up nothing works before a first V; that the status gives its odd speed back tells an
/// MP-285 from others.
StageInfo Mp285::configure() {
  clock().sleep_for(from_seconds(settings_.opening_pause));
  velocity_ = {};
  resynchronize();
  Status first;
  try {
    send(SetVelocity{kHandshake, true});
    expect_end(reply_deadline());
    first = status();
  } catch (const DeviceError& error) {
    if (error.kind == DeviceErrorKind::lost || error.kind == DeviceErrorKind::timeout) throw;
    fail(DeviceErrorKind::not_found, std::string("this is no MP-285: ") + error.what());
  }
  if (first.velocity.speed != kHandshake || !first.velocity.fine || first.usteps_per_um != 25)
    fail(DeviceErrorKind::not_found,
         "this is no MP-285: its status does not give back what it was told");
  send(Absolute{});
  expect_end(reply_deadline());
  set_velocity(settings_.speed);
  const Status now = status();
  if (!now.absolute || now.velocity.speed != velocity_.speed || now.velocity.fine != velocity_.fine)
    fail(DeviceErrorKind::refused, "it does not keep its settings");
  send(Refresh{});
  expect_end(reply_deadline());
  where();
  std::string version = std::to_string(first.version / 100) + "." +
                        (first.version % 100 < 10 ? "0" : "") + std::to_string(first.version % 100);
  StageInfo info{{"Sutter MP-285", "", std::move(version)}, {}};
  for (std::size_t i = 0; i < 3; ++i)
    info.axes.push_back({std::string(1, "xyz"[i]), settings_.travel_min[i], settings_.travel_max[i],
                         settings_.max_speed, settings_.speed, kUstep});
  return info;
}

std::vector<double> Mp285::position() {
  std::vector<double> place(3);
  if (!moving_) {
    const Usteps at = where();
    std::transform(at.begin(), at.end(), place.begin(),
                   [](std::int32_t axis) { return axis * kUstep; });
    return place;
  }
  double longest = 0;
  for (std::size_t i = 0; i < 3; ++i)
    longest = std::max(longest, std::abs(target_[i] - from_[i]) * kUstep);
  const double gone =
      longest > 0 ? std::min(1., to_seconds(clock().now() - begun_) * speed_ / longest) : 1;
  for (std::size_t i = 0; i < 3; ++i)
    place[i] = (from_[i] + gone * (target_[i] - from_[i])) * kUstep;
  return place;
}

void Mp285::set_off(std::span<const double> target, double speed) {
  from_ = where();
  double longest = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    target_[i] = static_cast<std::int32_t>(std::lround(target[i] / kUstep));
    longest = std::max(longest, std::abs(target_[i] - from_[i]) * kUstep);
  }
  set_velocity(speed);
  speed_ = velocity_.speed * kMicro;
  send(Move{target_});
  begun_ = clock().now();
  deadline_ = later(begun_, from_seconds(kMotionFactor * longest / speed_) + kMotionMargin);
  moving_ = true;
}

/// Listens for the CR at the end of the motion, and says nothing.
bool Mp285::busy() {
  if (!moving_) return false;
  const auto first = dialogue.next(clock().now());
  if (!first && clock().now() < deadline_) return true;
  moving_ = false;
  if (!first) fail(DeviceErrorKind::timeout, "it was silent when its motion should have ended");
  unsure_ = false;
  if (*first == kEnd) return false;
  unsure_ = true;
  const auto fault = decode_fault(*first);
  if (!fault)
    fail(DeviceErrorKind::protocol, "an answer that is none: " + printable(std::span(&*first, 1)));
  fail(*fault);
}

void Mp285::check_arrival(bool) {
  const Usteps at = where();
  for (std::size_t i = 0; i < 3; ++i)
    if (std::abs(at[i] - target_[i]) > kSlack_usteps)
      fail(DeviceErrorKind::refused, std::string("axis ") + "xyz"[i] + ": it stands " +
                                         std::to_string((at[i] - target_[i]) * 40 / 1000) +
                                         " um from its target");
}

/// The interrupt is the only byte that may be sent during a motion. Whether the motion's own CR
/// comes as well is not known, so all is heard out; that it answers then shows that it stands.
void Mp285::halt() {
  if (!moving_ && !unsure_) return;
  resynchronize();
  const Usteps first = where();
  clock().sleep_for(kSilence);
  if (where() != first) fail(DeviceErrorKind::timeout, "it does not stop");
}

void Mp285::tell_to_halt() {
  unsure_ = true;
  try {
    dialogue.send(encode(Interrupt{}));
  } catch (const DeviceError&) {  // it was told what could be told
  }
}

}  // namespace

void Settings::check() const {
  const auto positive = [](double value) { return std::isfinite(value) && value > 0; };
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(travel_min[i] < travel_max[i]))
      throw std::invalid_argument("travel_min: must be below travel_max");
    if (!(std::abs(travel_min[i]) <= 50e-3 && std::abs(travel_max[i]) <= 50e-3))
      throw std::invalid_argument("travel_min, travel_max: must lie within 50 mm of the origin");
  }
  if (!positive(max_speed) || max_speed > kCoarsestMax)
    throw std::invalid_argument("max_speed: must be 3 mm/s at most");
  if (!(speed >= kMicro) || speed > max_speed)
    throw std::invalid_argument("speed: must be 1 um/s at least and max_speed at most");
  if (!(opening_pause >= 0 && opening_pause <= 10))
    throw std::invalid_argument("opening_pause: must be 0 to 10 s");
  if (!positive(reply_timeout)) throw std::invalid_argument("reply_timeout: must be positive");
}

std::unique_ptr<Stage> open(std::unique_ptr<ByteLink> link, const Settings& settings,
                            Clock& clock) {
  settings.check();
  return make_stage(std::make_unique<Mp285>(std::move(link), settings, clock));
}

}  // namespace vitreo::sutter_mp285
