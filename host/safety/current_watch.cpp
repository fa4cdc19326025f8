// SPDX-License-Identifier: Apache-2.0
#include "host/safety/current_watch.h"

#include "devices/time/error.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// From the begin of a measurement that contradicts to that of the one which decides: a step whose
/// set-point is not noted yet is over by then.
constexpr Time kDecide = std::chrono::milliseconds(20);

}  // namespace

void CurrentWatchSettings::check() const {
  if (!(tolerance > 0)) throw std::invalid_argument("tolerance must be above zero");
  if (!(settling >= 0 && settling <= 5))
    throw std::invalid_argument("settling must be in [0, 5] s");
  if (!(period >= 1e-3 && period <= 1))
    throw std::invalid_argument("period must be in [0.001, 1] s");
  if (!(timeout > 0 && timeout <= 5)) throw std::invalid_argument("timeout must be in (0, 5] s");
}

CurrentWatch::CurrentWatch(CurrentSensor& sensor, const CurrentWatchSettings& settings,
                           Clock& clock, std::function<bool()> energized,
                           std::function<void(std::string)> failed)
    : sensor_(sensor),
      period_(from_seconds(settings.period)),
      timeout_(from_seconds(settings.timeout)),
      clock_(clock),
      energized_(std::move(energized)),
      failed_(std::move(failed)),
      read_back_(settings.tolerance, from_seconds(settings.settling)) {
  settings.check();
  task_ = clock_.spawn("current sensor", [this] { run(); });
}

void CurrentWatch::set(Time at, std::span<const double> currents) {
  read_back_.set(at, currents);
  clock_.notify(changed_);
}

void CurrentWatch::run() {
  while (true) {
    clock_.wait(changed_, energized_, kForever);
    const Time began = clock_.now();
    look();
    clock_.sleep_until(later(began, read_back_.doubted() ? std::min(period_, kDecide) : period_));
  }
}

// Judged by what was set from the settling time before the measurement's begin until now: a coil
// was measured somewhere in between.
void CurrentWatch::look() {
  const Time began = clock_.now();
  std::vector<double> measured;
  try {
    measured = measure();
  } catch (const DeviceError& error) {
    if (energized_())
      failed_(std::string("the current sensor does not measure while a current is held: ") +
              error.what());
    return;
  }
  if (!energized_()) return;
  if (const std::string wrong = read_back_.judge(began, measured, coils()); !wrong.empty())
    failed_(wrong + ", by the current sensor");
}

}  // namespace vitreo
