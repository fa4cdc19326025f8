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

/// The least rest between two commands (Lemaire's driver; the same in the MPC-200's manual).
constexpr Time kBetween = 2ms;
/// After which two bytes were a whole answer: 13 of them take 13.5 ms at 9600 baud.
constexpr Time kSilence = 20ms;
/// For the answer to an interrupt.
constexpr Time kSlowest = 1500ms;
/// A motion may take this much longer than distance over speed: it accelerates and decelerates.
constexpr double kMotionFactor = 1.25;
constexpr Time kMotionMargin = 1s;
/// um/s: an odd speed, as the MATLAB class and acq4 send it; no other instrument would return it.
constexpr int kHandshake = 777;
/// m/s: the fastest of high resolution; above it only steps of 0.2 um.
constexpr double kFinestMax = 1310e-6;
/// m/s: of low resolution. navigate and Lemaire allow 3 mm/s, acq4 6.55: the lower one counts.
constexpr double kCoarsestMax = 3000e-6;
/// One coarse step: how far from its target an axis may end.
constexpr int kSlack_usteps = 5;
constexpr double kMicro = 1e-6;

class Mp285 final : public SilentStageProtocol {
 public:
  Mp285(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock)
      : SilentStageProtocol(std::move(link), settings.name, clock,
                            {.ustep = kUstep,
                             .usteps_per_um = kUsteps_per_um,
                             .tolerance = kSlack_usteps,
                             .silence = kSilence,
                             .reply_timeout = settings.reply_timeout,
                             .end = kEnd,
                             .interrupt = kInterrupt}),
        settings_(settings) {}
  StageInfo configure() override;
  void set_off(std::span<const double> target, double speed) override;
  void set_off_home() override {
    fail(DeviceErrorKind::refused, "it has no reference that it could find");
  }

 private:
  Usteps where() override;
  void resynchronize() override;
  [[noreturn]] void fail_for(std::uint8_t answer) const override;
  [[noreturn]] void fail_for(const Fault& fault) const;
  void send(const Command& command);
  void expect_end(Time deadline);
  ByteString block(const Command& question, std::size_t size);
  Status status();
  void set_velocity(double speed);

  const Settings settings_;
  SetVelocity velocity_{};  // as last set
};

/// Several bits may be set; the interrupted motion explains the others (a byte that came in the
/// middle of it).
/// Only an interrupted motion is a refusal; the others say that bytes were lost or not understood.
void Mp285::fail_for(const Fault& fault) const {
  if (fault.interrupted) fail(DeviceErrorKind::refused, "its motion was interrupted");
  if (fault.bad_command) fail(DeviceErrorKind::protocol, "it did not understand the command");
  fail(DeviceErrorKind::protocol, "bytes were lost on their way to it");
}

void Mp285::fail_for(std::uint8_t answer) const {
  if (const auto fault = decode_fault(answer)) fail_for(*fault);
  fail(DeviceErrorKind::protocol, "an answer that is none: " + printable(std::span(&answer, 1)));
}

/// Not during a motion: any byte would interrupt it.
void Mp285::send(const Command& command) {
  if (unsure_) resynchronize();
  clock().sleep_for(kBetween);
  dialogue.discard();
  unsure_ = true;
  dialogue.send(encode(command), name_of(command));
}

/// The CR that acknowledges a command; an error comes in its place.
/// An error is read to its end as well, so the line is sure again before it is thrown.
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
  fail_for(*fault);
}

/// `size` bytes and a CR. An error is told from data by its being alone: data, too, may begin with
/// '4' and CR.
ByteString Mp285::block(const Command& question, std::size_t size) {
  send(question);
  const Time deadline = reply_deadline();
  ByteString reply = dialogue.take(2, deadline);
  // Two bytes that look like an error: it is one when nothing follows within the silence.
  const auto fault = decode_fault(reply[0]);
  if (fault && reply[1] == kEnd) {
    const auto more = dialogue.next(later(clock().now(), kSilence));
    if (!more) {
      unsure_ = false;
      fail_for(*fault);
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

// block() has checked size and end, so the decoding cannot fail.
Usteps Mp285::where() { return *decode_position(block(GetPosition{}, kPositionSize)); }
Status Mp285::status() { return *decode_status(block(GetStatus{}, kStatusSize)); }

/// The MP-285A locks up when an answer is abandoned (navigate), so everything that it may still
/// send is read.
void Mp285::resynchronize() {
  unsure_ = false;
  dialogue.send(encode(Interrupt{}), name_of(Interrupt{}));
  // Of one that stands still nothing may come; of a slow one the answer must not meet the next
  // command, which would lock it up.
  dialogue.await(later(clock().now(), kSlowest));
  dialogue.settle(2 * kSilence);
  moving_ = false;
}

/// In whole um/s, at least 1; of high resolution where that is fast enough. Sent only when it
/// changes: each command costs a rest and an answer.
void Mp285::set_velocity(double speed) {
  const SetVelocity wanted{std::max(1, static_cast<int>(std::lround(speed / kMicro))),
                           speed <= kFinestMax};
  if (wanted.speed == velocity_.speed && wanted.fine == velocity_.fine) return;
  send(wanted);
  expect_end(reply_deadline());
  velocity_ = wanted;
}

/// After power-up nothing works before a first V (MATLAB class, acq4); that the status returns its
/// odd speed identifies an MP-285, which has no command for its identity.
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
    fail(DeviceErrorKind::not_found, "this is no MP-285: " + error.text);
  }
  if (first.velocity.speed != kHandshake || !first.velocity.fine || first.usteps_per_um != 25)
    fail(DeviceErrorKind::not_found,
         "this is no MP-285: its status does not give back what it was told");
  dialogue.identified();
  // Before anything can move: in relative mode a target would be added to the position.
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

/// The velocity counts as that of the axis with the longest way.
void Mp285::set_off(std::span<const double> target, double speed) {
  from_ = where();
  const double longest = aim(target) * kUstep;
  set_velocity(speed);
  speed_ = velocity_.speed * kMicro;
  send(Move{target_});
  begin(from_seconds(kMotionFactor * longest / speed_) + kMotionMargin);
}

}  // namespace

// The travel is about the origin that was set at the panel, so a stage of 25 mm may lie on either
// side of it.
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
