// SPDX-License-Identifier: Apache-2.0
#include "host/safety/watched_lamp.h"

#include "devices/time/error.h"

#include <fmt/format.h>

#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

using namespace std::chrono_literals;

constexpr Time kTurn = 50ms;         // of the watch
constexpr Time kListenPeriod = 5ms;  // between two looks at the lamp's link
constexpr Time kAskPeriod = 150ms;   // between two questions to a lamp that burns
constexpr Time kWatchStuck = 250ms;  // without a turn no edge is given
constexpr Time kRest = 2s;           // of darkness, after which the line rests

}  // namespace

WatchedLamp::WatchedLamp(Lamp& lamp, Clock& clock, std::function<void(const std::string&)> failed)
    : lamp_(lamp), clock_(clock), failed_(std::move(failed)) {
  watch_ = clock_.spawn("lamp", [this] { watch(); });
}

void WatchedLamp::beat(const HeartbeatSettings& settings) {
  EnableLine* const line = lamp_.enable_line();
  if (line == nullptr) throw std::logic_error("a heartbeat wants a line");
  answer_within_ = from_seconds(settings.answer_within);
  line_ = std::make_unique<HeartbeatLine>(
      *line, settings, clock_, [this] { return beat_forbidden(); },
      [this](const std::string& why) { fail(why); });
}

// `lit_` is set before the lamp is commanded and cleared after it, so that an error in between
// leaves the watch at work on a lamp that may burn.
void WatchedLamp::set_level(double level) {
  if (level == 0) return make_safe();
  const int before = darkenings_;
  if (line_) start_beat();
  told_.clear();
  lit_ = true;
  watched_at_ = asked_at_ = clock_.now();
  clock_.notify(changed_);
  try {
    lamp_.set_level(level);
  } catch (const std::invalid_argument&) {
    lit_ = lamp_.level() > 0;  // nothing was sent
    throw;
  }
  if (darkenings_ == before) return;
  // Darkened by another task while this level was on its way.
  make_safe();
  throw DeviceError(DeviceErrorKind::refused, "lamp", "it was darkened meanwhile");
}

void WatchedLamp::start_beat() {
  if (line_->beating()) return;
  dark_since_ = clock_.now();
  clock_.notify(changed_);
  line_->start();
  if (!line_->beating())
    throw DeviceError(DeviceErrorKind::refused, "lamp", "its heartbeat line has stopped");
}

// The driver's zero leaves the line low; the next edge finds it so. It goes on beating for a while,
// so that a lamp that blinks does not wear the relay.
void WatchedLamp::make_safe() {
  ++darkenings_;
  lamp_.make_safe();
  lit_ = false;
  dark_since_ = clock_.now();
}

/// Asked at each edge.
std::string WatchedLamp::beat_forbidden() const {
  if (!lit_) return "";
  if (clock_.now() - watched_at_ > kWatchStuck) return "the watch of the lamp is stuck";
  const LinkState link = lamp_.link_state();
  if (std::string gone = gone_text(link); !gone.empty()) return gone;
  if (link.owed <= answer_within_) return "";
  return fmt::format("it has owed an answer for {:.0f} ms", to_seconds(link.owed) * 1e3);
}

void WatchedLamp::watch() {
  while (true) {
    clock_.wait(
        changed_, [this] { return lit_ || (line_ && line_->beating()); }, kForever);
    const std::string hung_up = listen_for(kTurn);
    watched_at_ = clock_.now();
    try {
      if (!hung_up.empty())
        fail(hung_up);
      else
        look();
    } catch (const DeviceError&) {
      // The line's: without edges any level is off. The next turn tries again.
    }
  }
}

/// Waits, and returns at once, with the reason, when the link of a lamp that burns hangs up. What
/// has failed already is not told again.
std::string WatchedLamp::listen_for(Time period) {
  for (Time waited{}; waited < period; waited += kListenPeriod) {
    clock_.sleep_for(kListenPeriod);
    if (!lit_ || !told_.empty()) continue;
    if (std::string why = gone_text(lamp_.link_state()); !why.empty()) return why;
  }
  return "";
}

void WatchedLamp::look() {
  if (!lit_) {
    if (line_ && line_->beating() && clock_.now() - dark_since_ >= kRest) line_->stop();
    return;
  }
  // A zero that did not get through is sent again until it does.
  if (!told_.empty() || lamp_.level() == 0) return make_safe();
  if (line_ && (!line_->beating() || line_->late()))
    return fail("its heartbeat line does not beat");
  if (clock_.now() - asked_at_ < kAskPeriod) return;
  asked_at_ = clock_.now();
  try {
    lamp_.ask();
  } catch (const DeviceError& error) {
    fail(std::string("it does not answer while it burns: ") + error.what());
  }
}

void WatchedLamp::fail(const std::string& why) {
  std::string told = "the lamp is darkened: " + why;
  try {
    if (line_) line_->stop();
  } catch (const DeviceError&) {
    // As in watch().
  }
  try {
    make_safe();
  } catch (const DeviceError& error) {
    told += std::string("; and it does not take the zero: ") + error.what();
  }
  if (!std::exchange(told_, told).empty()) return;
  failed_(told);
}

}  // namespace vitreo
