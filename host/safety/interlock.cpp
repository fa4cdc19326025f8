// SPDX-License-Identifier: Apache-2.0
#include "host/safety/interlock.h"

#include "devices/time/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

// Period of the watch while the coils are energized: a fifth of the default dead-man time.
constexpr Time kWatchPeriod = std::chrono::milliseconds(50);
// Between two looks at the amplifier's links, which need no question.
constexpr Time kListenPeriod = std::chrono::milliseconds(5);
// Between two questions to an amplifier whose current is held: a set-point is a question too. With
// a heartbeat line, whose edges an answer that is owed withholds, at each turn of the watch.
constexpr Time kAskPeriod = std::chrono::milliseconds(100);
// s: set-points closer than this count as that far apart, or the slew of two at once is infinite.
constexpr double kShortest = 1e-3;
constexpr Time kRamp = std::chrono::milliseconds(500);
constexpr Time kRampStep = std::chrono::milliseconds(20);
// Without a turn for so long the watch is stuck; an amplifier's answer takes half of it at most.
constexpr Time kWatchStuck = std::chrono::milliseconds(600);
// After so long at zero the amplifiers are switched off: a relay is not for each passing of zero.
constexpr Time kRest = std::chrono::seconds(2);
// Until a current that was set to zero is read back as zero, and between two readings.
constexpr Time kRestPatience = std::chrono::milliseconds(500);
constexpr Time kRestPeriod = std::chrono::milliseconds(25);
// Of a push against a wall: m below the margin, and m/s, that are no push; m by which it got away;
// how long it is let.
constexpr double kMarginSlack = 50e-6;
constexpr double kPushed = 20e-6;
constexpr double kGotAway = 10e-6;
constexpr Time kPushPatience = std::chrono::seconds(1);

// Exactly zero: a small current is a current, and keeps the dead-man at work.
bool is_zero(std::span<const double> currents) {
  return std::all_of(currents.begin(), currents.end(), [](double current) { return current == 0; });
}

/// Any rate towards zero is safe; a change of sign is not towards it.
bool towards_zero(double from, double to) {
  return from * to >= 0 && std::abs(to) <= std::abs(from);
}

}  // namespace

// A dead-man shorter than the period of the watch, 50 ms, would promise what cannot be noticed;
// beyond 5 s it guards nothing.
void InterlockLimits::check() const {
  if (!(current > 0)) throw std::invalid_argument("current limit must be above zero");
  if (!(total_current > 0)) throw std::invalid_argument("total_current limit must be above zero");
  if (!(slew > 0)) throw std::invalid_argument("slew limit must be above zero");
  if (!(read_back > 0)) throw std::invalid_argument("read_back tolerance must be above zero");
  if (!(dead_man >= 0.05 && dead_man <= 5))
    throw std::invalid_argument("dead_man must be in [0.05, 5] s");
  heat.check();
}

// The watch is a task of the run's clock, under the baton like all others: nothing here is locked,
// except energized_, which the guardian's and the watchdog's threads read.
Interlock::Interlock(CoilAmplifier& amplifier, const InterlockLimits& limits, Clock* clock)
    : amplifier_(amplifier),
      limits_(limits),
      clock_(clock),
      temperature_(limits.heat, amplifier.channels()),
      sent_(static_cast<std::size_t>(amplifier.channels()), 0.0),
      read_back_(limits.read_back) {
  limits_.check();
  if (clock_ == nullptr) return;
  warmed_at_ = clock_->now();
  forget_slew();
  note_set(warmed_at_);
  watch_ = clock_->spawn("interlock", [this] { watch(); });
}

// watch_ is the last member, so its task has ended before what it uses is destroyed.
Interlock::~Interlock() = default;

// The lower one of the rig's limit and of what the amplifier can give at all.
double Interlock::current_limit() const {
  return std::min(limits_.current, amplifier_.current_limit());
}

// A command beyond a limit is a fault of the loop that gave it, so its outputs are not merely left
// as they are: they go to zero, and stay there until enable().
void Interlock::refuse(const std::string& why) {
  trip(why);
  throw DeviceError(DeviceErrorKind::refused, "coils", why + "; the coils are at zero");
}

// Limits of each channel and of the sum of magnitudes, which is what the supplies share.
void Interlock::check(std::span<const double> currents) {
  double total = 0;
  for (std::size_t channel = 0; channel < currents.size(); ++channel) {
    const double magnitude = std::abs(currents[channel]);
    // Negated, so that NaN is refused too. 1e-9: a limit that was computed is not passed by
    // rounding.
    if (!(magnitude <= current_limit() * (1 + 1e-9)))
      refuse(fmt::format("coil {}: {:.3g} A is beyond the limit of {:.3g} A", channel + 1,
                         currents[channel], current_limit()));
    total += magnitude;
  }
  if (total > limits_.total_current)
    refuse(fmt::format("{:.3g} A in all are beyond the limit of {:.3g} A", total,
                       limits_.total_current));
}

/// A: the slew limit times the time since the last set-point.
double Interlock::largest_step() const {
  return limits_.slew * std::max(to_seconds(clock_->now() - sent_at_), kShortest);
}

// |I - I_before| of each channel is at most the slew limit times dt, the time since the last
// set-point.
void Interlock::check_slew(std::span<const double> currents) {
  const double most = largest_step();
  for (std::size_t channel = 0; channel < currents.size(); ++channel) {
    const double from = sent_[channel], to = currents[channel];
    if (std::abs(to - from) > most && !towards_zero(from, to))
      refuse(fmt::format(
          "coil {}: from {:.3g} A to {:.3g} A within {:.3g} ms is beyond the limit of {:.3g} A/s",
          channel + 1, from, to, most / limits_.slew * 1e3, limits_.slew));
  }
}

std::vector<double> Interlock::reachable(std::span<const double> currents) const {
  std::vector<double> near(currents.begin(), currents.end());
  if (clock_ == nullptr || sent_.size() != currents.size()) return near;
  // Off the limit by more than rounding.
  const double most = largest_step() * (1 - 1e-9);
  for (std::size_t channel = 0; channel < near.size(); ++channel)
    if (!towards_zero(sent_[channel], near[channel]))
      near[channel] = std::clamp(near[channel], sent_[channel] - most, sent_[channel] + most);
  return near;
}

// In this order: open, limits, paused, slew, conditions. A set-point beyond a limit trips even
// while paused; the slew of one that is dropped has no meaning.
void Interlock::set_currents(std::span<const double> currents) {
  if (!enabled_)
    throw DeviceError(DeviceErrorKind::refused, "coils",
                      "the interlock is open" + (tripped_.empty() ? "" : " (" + tripped_ + ")") +
                          "; rig.coils:enable() closes it again");
  check(currents);
  if (paused_) return;
  if (clock_ != nullptr && currents.size() == sent_.size()) check_slew(currents);
  if (!energized_ && !is_zero(currents))
    if (const std::string why = unmet(); !why.empty()) refuse("dead-man: " + why);
  send(currents);
}

void Interlock::hold_for(Time duration) {
  if (clock_ == nullptr) return;  // the rules of time rest
  hold_ = Hold{clock_->now(), duration};
}

/// Why currents that no loop sets may not stand any longer; empty: they may.
std::string Interlock::outlived() const {
  if (!hold_ || has_loop() || clock_->now() - hold_->since <= hold_->duration) return "";
  return fmt::format("dead-man: the currents were to be held for {:g} s, and were not set again",
                     to_seconds(hold_->duration));
}

// Conditions are added by the rig's opening and outlive every loop; they are asked in their order.
void Interlock::require(std::string why, std::function<bool()> holds) {
  conditions_.push_back({std::move(why), std::move(holds)});
}

// A disturbance that the loop corrects is away within a second, and a loop that gives way gets
// away: what is left is a push that nobody wants.
void Interlock::near(const std::optional<Nearness>& now) {
  const bool pushes =
      now && now->bound < now->margin - kMarginSlack && now->push > kPushed && clock_ != nullptr;
  if (!pushes) return pushed_.reset();
  if (!pushed_ || now->bound > pushed_->bound + kGotAway) pushed_ = {clock_->now(), now->bound};
  if (clock_->now() - pushed_->since < kPushPatience) return;
  pushed_.reset();
  refuse(
      fmt::format("keep-out margin: the robot is pushed against the {} at {:.2f} mm/s, {:.2f} mm "
                  "from it or less, where {:.2f} mm must be left",
                  now->wall, now->push * 1e3, std::max(0.0, now->bound) * 1e3, now->margin * 1e3));
}

/// Why no current may flow; empty: it may.
std::string Interlock::unmet() const {
  for (const Condition& condition : conditions_)
    if (!condition.holds()) return condition.why;
  return "";
}

// `energized_` is set and the watch woken before the amplifier is commanded, and it is cleared
// after that: an error in between leaves the watch at work on coils that may carry current.
void Interlock::send(std::span<const double> currents) {
  warm_up();
  if (line_ && !is_zero(currents)) start_beat();
  energized_ = energized_ || !is_zero(currents);
  if (energized_ && clock_ != nullptr) clock_->notify(energized_changed_);
  try {
    amplifier_.set_currents(currents);
  } catch (const DeviceError&) {
    if (enabled_) throw;  // else the amplifier was made safe under the set-point's feet
  }
  // Opened by another task while this set-point was on its way: it is taken back.
  if (!enabled_) {
    make_safe();
    throw DeviceError(DeviceErrorKind::refused, "coils",
                      "the interlock was opened meanwhile" +
                          (tripped_.empty() ? "" : " (" + tripped_ + ")") +
                          "; the coils are at zero");
  }
  sent_.assign(currents.begin(), currents.end());
  energized_ = !is_zero(currents);
  if (!energized_) hold_.reset();
  count(currents);
  if (clock_ == nullptr) return;
  sent_at_ = clock_->now();
  note_set(sent_at_);
}

// Statistics for the record and the preflight's report: what was sent, not what was asked for.
void Interlock::count(std::span<const double> currents) {
  use_.peak.resize(currents.size());
  double total = 0;
  for (std::size_t channel = 0; channel < currents.size(); ++channel) {
    use_.peak[channel] = std::max(use_.peak[channel], std::abs(currents[channel]));
    total += std::abs(currents[channel]);
  }
  use_.peak_total = std::max(use_.peak_total, total);
}

/// Advances the thermal model by the time since the last call, at the currents that flowed in it.
void Interlock::warm_up() {
  if (clock_ == nullptr) return;
  if (energized_) use_.energized += to_seconds(clock_->now() - warmed_at_);
  temperature_.advance(to_seconds(clock_->now() - warmed_at_), sent_);
  warmed_at_ = clock_->now();
}

std::vector<double> Interlock::temperatures() {
  if (clock_ == nullptr) return {};
  warm_up();
  return temperature_.temperatures();
}

// Opened before the amplifier is commanded: where that throws, set-points are refused all the same,
// and the watch, for which `energized_` still holds, sends the zero again.
// The line first: one report, and from then on the hardware counts, whatever the amplifier does.
void Interlock::make_safe() {
  enabled_ = false;
  warm_up();
  std::exception_ptr failure;
  try {
    stop_beat();
  } catch (const DeviceError&) {
    failure = std::current_exception();
  }
  rest_due_ = rest_due_ || energized_;
  amplifier_.make_safe();
  std::fill(sent_.begin(), sent_.end(), 0.0);
  energized_ = false;
  hold_.reset();
  if (clock_ != nullptr) {
    zeroed_at_ = clock_->now();
    note_set(zeroed_at_);
  }
  if (failure) std::rethrow_exception(failure);
}

/// Before a current flows: the amplifiers are on when it returns.
void Interlock::start_beat() {
  if (line_->beating()) return;
  zero_since_ = clock_->now();
  line_->start();
  zero_since_ = watched_at_ = clock_->now();
  clock_->notify(energized_changed_);
  if (!enabled_)
    throw DeviceError(DeviceErrorKind::refused, "coils",
                      "the interlock was opened meanwhile (" + tripped_ + ")");
}

void Interlock::stop_beat() {
  if (line_ && line_->beating()) line_->stop();
}

/// Lets the first set-point after a rest be a step: as if the last one were a second ago.
void Interlock::forget_slew() {
  if (clock_ != nullptr) sent_at_ = clock_->now() - std::chrono::seconds(1);
}

// Loops beat anew: while the interlock was open they may have rested for longer than the dead-man's
// time. The slew begins from rest, and nothing is energized by enabling.
void Interlock::enable() {
  enabled_ = true;
  forget_slew();
  tripped_.clear();
  for (Heartbeat* heartbeat : heartbeats_) heartbeat->beat();
}

// The same reason again, at every turn of the watch, is counted and reported once.
// A device that fails to take the zero does not hide the trip: the listener hears of it first, then
// the failure goes on to the caller.
void Interlock::trip(const Trip& trip) {
  const std::string before = std::exchange(tripped_, trip.why);
  std::exception_ptr failure;
  try {
    make_safe();
  } catch (const DeviceError& error) {
    tripped_ += std::string("; and the amplifier does not answer: ") + error.what();
    failure = std::current_exception();
  }
  if (tripped_ != before) use_.trips.push_back(tripped_);
  if (on_trip_ && tripped_ != before) on_trip_({tripped_, trip.broken});
  if (failure) std::rethrow_exception(failure);
}

// The ramp is linear in time and leaves off where the interlock opens meanwhile.
void Interlock::pause(PausePolicy policy) {
  if (policy == PausePolicy::hold) return;
  paused_ = true;
  // The set-points of loops are dropped from here on (paused_), so the ramp is the only one that
  // sends; it gives up the baton at each step.
  if (policy == PausePolicy::ramp && clock_ != nullptr) {
    const std::vector<double> from = sent_;
    const Time began = clock_->now();
    while (enabled_ && clock_->now() - began < kRamp) {
      clock_->sleep_for(kRampStep);
      const double left = 1 - std::min(1.0, to_seconds(clock_->now() - began) / to_seconds(kRamp));
      std::vector<double> now = from;
      for (double& current : now) current *= left;
      if (enabled_) send(now);
    }
  }
  if (enabled_) send(std::vector<double>(sent_.size(), 0.0));
}

// An amplifier that does not read zero after a pause at zero has been changed by something else:
// its state is not known, so it trips instead of going on.
void Interlock::resume() {
  if (!paused_) return;
  const std::vector<double> read = amplifier_.currents();
  for (std::size_t channel = 0; channel < read.size(); ++channel)
    if (std::abs(read[channel]) > kZeroCurrent)
      refuse(fmt::format("coil {} carries {:.3g} A after a pause at zero", channel + 1,
                         read[channel]));
  paused_ = false;
  forget_slew();
}

// Task of its own: sleeps until the coils are energized, then checks every kWatchPeriod what no
// set-point would bring to light: heat, conditions, heartbeats, a zero that was not taken.
void Interlock::watch() {
  while (true) {
    clock_->wait(
        energized_changed_,
        [this] { return energized_ || rest_due_ || (line_ && line_->beating()); }, kForever);
    const std::string hung_up = listen_for(kWatchPeriod);
    watched_at_ = clock_->now();
    warm_up();
    try {
      if (!hung_up.empty())
        trip(Trip{hung_up, true});
      else if (energized_)
        look();
      else if (rest_due_)
        report_rest();
      else if (watched_at_ - zero_since_ >= kRest)
        stop_beat();
    } catch (const DeviceError&) {
      // Reported by trip(); the next turn tries again.
    }
    if (energized_) zero_since_ = clock_->now();
  }
}

/// Waits, and returns at once, with the reason, when a link of an amplifier that carries a current
/// hangs up. What has tripped already is not told again.
std::string Interlock::listen_for(Time period) {
  for (Time waited{}; waited < period; waited += kListenPeriod) {
    clock_->sleep_for(kListenPeriod);
    if (!energized_ || !enabled_) continue;
    if (std::string why = gone_text(amplifier_.link_state()); !why.empty()) return why;
  }
  return "";
}

/// For those who compare what flows with it.
void Interlock::note_set(Time at) {
  read_back_.set(at, sent_);
  if (sensed_) sensed_->set(at, sent_);
}

/// The currents' own time to fall is in the reading's patience.
void Interlock::report_rest() {
  const CoilRest rest = read_rest();
  if (on_rest_ && !energized_) on_rest_(rest);
}

// Without a clock once: nothing to wait by.
CoilRest Interlock::read_rest() {
  rest_due_ = false;
  const Time began = clock_ == nullptr ? Time{} : clock_->now();
  try {
    for (;;) {
      CoilRest rest{zeroed_at_, energized_ ? "the amplifier did not take the zero" : "",
                    currents_now()};
      if (!rest.measured) return rest;
      rest.failure.clear();
      if (clock_ == nullptr) return rest;
      rest.at = clock_->now();
      if (at_zero(rest) || rest.at - began >= kRestPatience) return rest;
      clock_->sleep_for(kRestPeriod);
    }
  } catch (const DeviceError& error) {
    return {clock_ == nullptr ? Time{} : clock_->now(), error.what(), std::nullopt};
  }
}

/// By the sensor, where there is one; a coil that it does not measure is not a number.
std::optional<std::vector<double>> Interlock::currents_now() {
  if (!sensed_) return amplifier_.measured_currents();
  const std::vector<double> read = sensed_->measure();
  std::vector<double> all(sent_.size(), std::nan(""));
  for (std::size_t i = 0; i < read.size(); ++i)
    all[static_cast<std::size_t>(sensed_->coils()[i])] = read[i];
  return all;
}

void Interlock::watch_by(CurrentSensor& sensor, const CurrentWatchSettings& settings) {
  if (clock_ == nullptr) throw std::logic_error("a current sensor wants a clock");
  for (const int coil : sensor.info().coils)
    if (coil < 0 || coil >= amplifier_.channels())
      throw std::invalid_argument(
          fmt::format("current_sensor.coils: there is no coil {}, only 1 to {}", coil + 1,
                      amplifier_.channels()));
  sensed_ = std::make_unique<CurrentWatch>(
      sensor, settings, *clock_, [this] { return energized_.load(); },
      [this](const std::string& why) { trip_quietly(why); });
  note_set(clock_->now());
}

/// A trip out of a task of its own: an instrument is broken, and what fails beside is in the trip's
/// own text; the watch tries again.
void Interlock::trip_quietly(const std::string& why) {
  try {
    trip(Trip{why, true});
  } catch (const DeviceError&) {
  }
}

void Interlock::look() {
  if (!enabled_)
    make_safe();  // a zero that did not get through is sent again until it does
  else if (const std::string why = fault(); !why.empty())
    trip(why);
  else if (line_ && (!line_->beating() || line_->late()))
    // The amplifiers are off, or soon: a run that only holds would wait on without a current.
    trip(Trip{"the heartbeat line does not beat", true});
  else
    ask_amplifier();
}

/// Why the coils must be at zero; empty where nothing is wrong.
std::string Interlock::fault() const {
  if (temperature_.hottest() > limits_.heat.limit)
    return fmt::format(
        "a coil is at {:.0f} \u00b0C by the estimate from its currents, beyond the limit of {:.0f} "
        "\u00b0C",
        temperature_.hottest() - 273.15, limits_.heat.limit - 273.15);
  if (const std::string why = unmet(); !why.empty()) return "dead-man: " + why;
  if (std::string why = outlived(); !why.empty()) return why;
  return late_heartbeat();
}

// What is held is watched: between two set-points a supply may be cut off, another program may set
// its outputs, a cable may be pulled, and nothing else would ask.
void Interlock::ask_amplifier() {
  const Time now = clock_->now();
  if (now - std::max(sent_at_, asked_at_) < (line_ ? kWatchPeriod : kAskPeriod)) return;
  asked_at_ = now;
  std::optional<std::vector<double>> measured;
  try {
    measured = amplifier_.measured_currents();
  } catch (const DeviceError& error) {
    trip(
        Trip{fmt::format("the amplifier does not answer while a current is held: {}", error.what()),
             true});
    return;
  }
  // A set-point that came meanwhile is judged by the next answer.
  if (!measured || sent_at_ > now) return;
  if (const std::string wrong = read_back_.judge(clock_->now(), *measured); !wrong.empty())
    trip(Trip{wrong, true});
}

/// The first that is late is named; one trip opens the coils for all. Empty: none is.
std::string Interlock::late_heartbeat() const {
  for (const Heartbeat* heartbeat : heartbeats_) {
    const double since = to_seconds(clock_->now() - heartbeat->last_);
    if (since <= limits_.dead_man) continue;
    return fmt::format("dead-man: {} has not moved for {:.0f} ms", heartbeat->name_, since * 1e3);
  }
  return "";
}

void Interlock::beat_on(EnableLine& line, const HeartbeatSettings& settings) {
  if (clock_ == nullptr) throw std::logic_error("a heartbeat line wants a clock");
  answer_within_ = from_seconds(settings.answer_within);
  line_ = std::make_unique<HeartbeatLine>(
      line, settings, *clock_, [this] { return beat_forbidden(); },
      [this](const std::string& why) { trip_quietly(why); });
}

/// Asked at each edge; the same rules as the watch's, and that the watch itself is alive.
std::string Interlock::beat_forbidden() const {
  if (!enabled_) return "the interlock is open";
  if (const std::string why = unmet(); !why.empty()) return "dead-man: " + why;
  if (!energized_) return "";
  if (const std::string late = late_heartbeat(); !late.empty()) return late;
  const LinkState links = amplifier_.link_state();
  if (const std::string gone = gone_text(links); !gone.empty()) return gone;
  if (links.owed > answer_within_)
    return fmt::format("the amplifier has owed an answer for {:.0f} ms",
                       to_seconds(links.owed) * 1e3);
  if (clock_->now() - watched_at_ > kWatchStuck) return "the watch of the coils is stuck";
  return "";
}

// Registered for its lifetime: a loop that ends leaves no heartbeat behind that would be missed.
Interlock::Heartbeat::Heartbeat(Interlock& interlock, std::string name)
    : interlock_(interlock), name_(std::move(name)), last_{} {
  beat();
  interlock_.heartbeats_.push_back(this);
  // The loop before may have ended at zero this very moment: its last step is not this one's slew.
  if (!interlock_.energized_) interlock_.forget_slew();
}

Interlock::Heartbeat::~Heartbeat() { std::erase(interlock_.heartbeats_, this); }

void Interlock::Heartbeat::beat() {
  if (interlock_.clock_ != nullptr) last_ = interlock_.clock_->now();
}

}  // namespace vitreo
