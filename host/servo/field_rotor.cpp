// SPDX-License-Identifier: Apache-2.0
#include "host/servo/field_rotor.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

namespace vitreo {

FieldRotor::FieldRotor(Clock& clock, Interlock& coils, const RotorSettings& settings)
    : clock_(clock), coils_(coils), settings_(settings), interval_(settings.interval) {
  task_ = clock_.spawn("field rotor", [this] { run(); });
}

// Joined while all members are alive, and with a stop of the caller deferred: this runs in its
// clean-up.
FieldRotor::~FieldRotor() {
  const StopShield shield(clock_);
  task_->request_stop();
  task_->join();
}

void FieldRotor::turn(const control::Rotation& rotation, const control::FieldCurrents& currents,
                      const control::Currents& constant) {
  rotation_ = rotation;
  currents_ = currents;
  constant_ = constant;
  if (turning_) return;
  turning_ = true;
  // The task goes to its inner wait by itself; only one that rests has to be woken.
  clock_.notify(changed_);
}

void FieldRotor::stop() {
  turning_ = false;
  clock_.notify(changed_);
  clock_.wait(
      changed_, [this] { return !busy_; }, kForever);
}

void FieldRotor::check() const {
  if (error_) std::rethrow_exception(error_);
}

/// Nothing leaves this function, as it is a task's body: an error is kept for check().
void FieldRotor::run() {
  try {
    while (true) {
      clock_.wait(
          changed_, [this] { return turning_; }, kForever);
      heartbeat_.emplace(coils_, "the rotating field");
      last_.reset();
      while (turning_) {
        // An amplifier that takes longer than the interval sets the pace itself.
        const Time due = clock_.now() + from_seconds(settings_.interval);
        send();
        if (clock_.now() < due)
          clock_.wait(
              changed_, [this] { return !turning_; }, due);
      }
      heartbeat_.reset();
    }
  } catch (const Stopped&) {
  } catch (...) {
    error_ = std::current_exception();
  }
  heartbeat_.reset();
  turning_ = busy_ = false;
  clock_.notify(changed_);
}

/// One set-point: the field of the moment at which it acts, which is a delay and half of its hold
/// ahead. The phase advances by the time since the last one, so that no change of the frequency
/// makes it leap.
void FieldRotor::send() {
  // stop() waits for this: no set-point may come after the zeros that its caller sends.
  struct Busy {
    FieldRotor& rotor;
    explicit Busy(FieldRotor& its) : rotor(its) { rotor.busy_ = true; }
    ~Busy() {
      rotor.busy_ = false;
      rotor.clock_.notify(rotor.changed_);
    }
  } const busy(*this);
  const Time now = clock_.now();
  const double rate = 2 * M_PI * rotation_.frequency;
  if (last_) {
    constexpr double kNewest = 0.1;  // weight, of the mean interval
    const double since = to_seconds(now - *last_);
    phase_ = std::remainder(phase_ + rate * since, 2 * M_PI);
    interval_ += kNewest * (since - interval_);
  }
  last_ = now;
  const double ahead = phase_ + rate * (settings_.delay + interval_ / 2);
  const Eigen::Vector3d field =
      control::commanded_field(rotation_, ahead, settings_.lag, interval_);
  const control::Currents wanted = currents_ * field + constant_;
  const std::vector<double> reached = coils_.reachable(
      std::span<const double>(wanted.data(), static_cast<std::size_t>(wanted.size())));
  limited_ = false;
  for (std::size_t coil = 0; coil < reached.size(); ++coil)
    limited_ = limited_ || std::abs(reached[coil] - wanted[static_cast<int>(coil)]) > 1e-6;
  coils_.set_currents(reached);
  heartbeat_->beat();
}

}  // namespace vitreo
