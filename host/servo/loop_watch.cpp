// SPDX-License-Identifier: Apache-2.0
#include "host/servo/loop_watch.h"

#include "control/coil_lack.h"
#include "control/stability.h"

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

constexpr double kLong = 3;  // s, for which a cap is a fault and not the way to a far target
// 2 ln of the likelihood ratio, and by how much more it explains than the next coil does. 45 is
// seven standard deviations.
constexpr double kEvidence = 45;
constexpr double kMargin = 20;
// Part of a coil's current: below it, gains and places of healthy coils explain as much.
constexpr double kLeastLack = 0.3;
constexpr double kMostLack = 2.45;  // exchanged leads are 2
constexpr double kSure = 0.4;       // s, for which one coil must be the suspect before it is named
// s after the first measurement, in which the filter finds out gain and delay and the robot may
// fall: what coils do is not heard before.
constexpr double kQuiet = 6;
// s before now, of which the loop's delay is taken: a fault moves the filter's estimate of it, by a
// tenth of a second within one, and the oldest begin that is tried is four seconds ago.
constexpr double kBefore = 4;
constexpr double kClears = 5;  // s without suspicion after which its name is taken back

/// s, since when something is so; below 0 where it is not.
void since(bool is, double now, double& begin) {
  if (!is)
    begin = -1;
  else if (begin < 0)
    begin = now;
}

/// T and T/m per rad: B := R B and G := R G R' of a field that is turned about a unit axis.
control::FieldGradient turned(const control::FieldGradient& field, const Eigen::Vector3d& axis) {
  Eigen::Matrix3d across;
  across << 0, -axis.z(), axis.y(), axis.z(), 0, -axis.x(), -axis.y(), axis.x(), 0;
  const Eigen::Matrix3d gradient = control::gradient_matrix(field);
  const Eigen::Matrix3d by = across * gradient - gradient * across;
  control::FieldGradient change;
  change << across * field.head<3>(), by(0, 0), by(0, 1), by(0, 2), by(1, 1), by(1, 2);
  return change;
}

}  // namespace

LoopWatch::LoopWatch(const RigModel& model)
    : model_(model),
      coils_(model.field.coils()),
      given_(
          kHistories * static_cast<std::size_t>(model.field.coils()),
          control::CommandHistory(model.command_delay, 1 / (2 * M_PI * model.command_bandwidth))),
      flowing_(given_.size(), Eigen::Vector3d::Zero()) {}

// The robot's moment lies along its field, which a coil that fails changes too: what a coil does is
// the force with it less the force without it, and not its column of the wrench.
LoopWatch::Velocities LoopWatch::velocities(const WatchedCommand& command) const {
  // Outside of the model's region the field of the nearest place in it is used, as by the
  // allocator.
  const Eigen::Vector3d known = model_.field.nearest_valid(command.position);
  const control::FieldMatrix matrix = model_.field.matrix(known);
  const control::FieldGradient background = model_.field.background(known);
  const control::FieldGradient whole = matrix * command.currents + background;
  const Eigen::Vector3d with_all = control::force_along_field(model_.robot, whole);
  constexpr double kSmall = 0.02;  // rad, over which the force is differenced
  const Eigen::Index coils = command.currents.size();
  Velocities found(3, kHistories * coils);
  for (Eigen::Index k = 0; k < coils; ++k) {
    const control::FieldGradient its = matrix.col(k) * command.currents[k];
    const control::LostForce lost = control::lost_force(model_.robot, whole, its);
    found.col(k) = command.mobility * lost.linear;
    found.col(coils + k) = command.mobility * lost.curved;
    for (int axis = 0; axis < 3; ++axis) {
      const control::FieldGradient change = kSmall * turned(its, Eigen::Vector3d::Unit(axis));
      found.col((2 + axis) * coils + k) =
          command.mobility * (control::force_along_field(model_.robot, whole + change) - with_all) /
          kSmall;
    }
  }
  return found;
}

void LoopWatch::kept_out(double now, bool is) {
  now_ = now;
  since(is, now, kept_out_since_);
}

void LoopWatch::commanded(const WatchedCommand& command) {
  now_ = command.now;
  since(command.capped, now_, capped_since_);
  since(command.clamped, now_, clamped_since_);
  const Velocities speed = velocities(command);
  for (std::size_t k = 0; k < given_.size(); ++k)
    given_[k].add(command.now, speed.col(static_cast<Eigen::Index>(k)));
}

void LoopWatch::measured(double time, const control::PositionEstimator& filter, double delay,
                         bool restarted) {
  // `delay` is the filter's estimate of the delay beyond the believed one: what moved the robot
  // until `time` are commands from that much earlier. No command acts before it is given.
  delays_.emplace_back(time, std::max(delay, -model_.command_delay));
  while (delays_.size() > 1 && delays_[1].first <= time - kBefore) delays_.pop_front();
  const double shift = delays_.front().second;
  const double span = last_ ? time - *last_ : 0;
  const Eigen::Index coils = model_.field.coils();
  Velocities moved(3, kHistories * coils);
  for (std::size_t k = 0; k < given_.size(); ++k) {
    if (!last_) flowing_[k] = given_[k].velocity_at(time - shift);
    const auto motion = given_[k].advance(flowing_[k], time - span - shift, time - shift);
    flowing_[k] = motion.velocity;
    moved.col(static_cast<Eigen::Index>(k)) = motion.moved;
    // The delay may grow by what it is uncertain.
    given_[k].forget_before(time - shift - given_[k].memory() - 0.3);
  }
  if (!last_) heard_from_ = time + kQuiet;
  // The histories go on meanwhile: only the test is kept from hearing.
  if (time < heard_from_ || may_touch_)
    coils_.reset();
  else if (restarted)
    coils_.restart(span);
  else
    coils_.add(*filter.innovation(), filter.last_update(), span,
               {moved.leftCols(coils), moved.middleCols(coils, coils)}, moved.rightCols(3 * coils));
  last_ = time;
  suspect(time);
}

void LoopWatch::let_alone(double now, bool falls) {
  motion_.reset();
  if (!falls) return;
  followed_from_ = now + control::kCaught;
  heard_from_ = std::max(heard_from_, followed_from_);
}

void LoopWatch::suspect(double time) {
  const control::CoilWatch::Finding found = coils_.most_suspect();
  const bool doubtful = found.evidence > kEvidence && found.evidence - found.next > kMargin &&
                        found.lack > kLeastLack && found.lack < kMostLack;
  const int coil = doubtful ? found.coil : 0;
  // One coil must stay the suspect; where the evidence changes from coil to coil none is named yet.
  if (coil != suspected_) suspected_since_ = time;
  suspected_ = coil;
  if (coil != 0 && time - suspected_since_ >= kSure) {
    named_ = coil;
    lack_ = found.lack;
    cleared_ = time;
  }
  if (named_ != 0 && time - cleared_ > kClears) named_ = 0;
}

LoopQuality LoopWatch::quality() const {
  LoopQuality found;
  found.oscillating = motion_.oscillating();
  found.period = motion_.period();
  found.amplitude = motion_.amplitude();
  found.standing = motion_.standing();
  found.off_target = motion_.off_target();
  found.rests_off = motion_.rests_off();
  found.kept_out = kept_out_since_ >= 0 && now_ - kept_out_since_ > kLong;
  found.capped = capped_since_ >= 0 && now_ - capped_since_ > kLong;
  found.clamped = clamped_since_ >= 0 && now_ - clamped_since_ > kLong;
  found.weak_coil = named_;
  found.lack = named_ != 0 ? lack_ : 0;
  return found;
}

void LoopWatch::reset() {
  motion_.reset();
  coils_.reset();
  for (control::CommandHistory& coil : given_) coil.clear();
  delays_.clear();
  last_.reset();
  heard_from_ = 0;
  followed_from_ = -1e9;
  capped_since_ = clamped_since_ = kept_out_since_ = -1;
  suspected_ = named_ = 0;
}

}  // namespace vitreo
