// SPDX-License-Identifier: Apache-2.0
#include "control/command_history.h"

#include "control/preconditions.h"

#include <algorithm>
#include <cmath>

namespace vitreo::control {

// Both from a command to its effect on the field, s; 0 is allowed.
CommandHistory::CommandHistory(double delay, double lag) : delay_(delay), lag_(lag) {
  require(not_negative(delay), "command_delay: must be at least 0 s");
  require(not_negative(lag), "command_lag: must be at least 0 s");
}

// Commands come in the order of time. Two at one moment are one: only the later was sent.
void CommandHistory::add(double time, const Eigen::Vector3d& velocity) {
  require(std::isfinite(time), "command time: not finite");
  require(velocity.allFinite(), "commanded velocity: not finite");
  const double effect = time + delay_;
  if (size_ > 0) {
    Entry& last = ring_[(first_ + size_ - 1) % kCapacity];
    require(effect >= last.effect, "command time: runs backwards");
    if (effect == last.effect) {
      last.velocity = velocity;
      return;
    }
  }
  // Full: the oldest is dropped.
  if (size_ == kCapacity) {
    first_ = (first_ + 1) % kCapacity;
    --size_;
  }
  ring_[(first_ + size_) % kCapacity] = {effect, velocity};
  ++size_;
}

// Over `span` of one held command u, T v' = u - v has v(t) = u + (v0 - u) e^(-t/T), whose
// integral is u t + (v0 - u) T (1 - e^(-t/T)): exact, so the steps may be of any length.
void CommandHistory::pass(Motion& motion, const Eigen::Vector3d& commanded, double span) const {
  if (lag_ > 0) {
    const double decay = std::exp(-span / lag_);
    motion.moved += commanded * span + (motion.velocity - commanded) * (lag_ * (1 - decay));
    motion.velocity = commanded + (motion.velocity - commanded) * decay;
  } else {
    motion.moved += commanded * span;
    motion.velocity = commanded;
  }
}

// Piecewise: from one command's effect to the next, each span by pass().
CommandHistory::Motion CommandHistory::advance(const Eigen::Vector3d& velocity, double from,
                                               double to) const {
  Motion motion;
  motion.velocity = velocity;
  Eigen::Vector3d acting = before_;
  double now = from;
  for (std::size_t k = 0; k < size_ && now < to; ++k) {
    const Entry& next = entry(k);
    if (next.effect > now) {
      const double until = std::min(next.effect, to);
      pass(motion, acting, until - now);
      now = until;
    }
    acting = next.velocity;
  }
  if (now < to) pass(motion, acting, to - now);
  return motion;
}

// From the command that acted twenty lags before: what is wrong of the velocity there has decayed
// to e^-20, two parts in a billion.
Eigen::Vector3d CommandHistory::velocity_at(double time) const {
  const double start = time - memory();
  Eigen::Vector3d acting = before_;
  for (std::size_t k = 0; k < size_ && entry(k).effect <= start; ++k) acting = entry(k).velocity;
  return advance(acting, start, time).velocity;
}

// What is forgotten cannot be asked for again: `time` is that of the estimator's state, less its
// own memory, which never goes back.
void CommandHistory::forget_before(double time) {
  // The command that acts at `time` stays: the newest that took effect by then.
  while (size_ > 1 && entry(1).effect <= time) {
    first_ = (first_ + 1) % kCapacity;
    --size_;
  }
}

}  // namespace vitreo::control
