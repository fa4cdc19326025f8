// SPDX-License-Identifier: Apache-2.0
#include "host/servo/attitude_loop.h"

#include "host/record/meaning.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace vitreo {
namespace {

/// Made with the first turn, as other loops have no use of it; a second loop of the run shares it.
int attitude_stream(Recorder& recorder) {
  const char* const kWanted = "reference of the robot's axis";
  const char* const kMeasured = "the robot's axis, measured";
  const char* const kField = "direction of the field for it";
  const StreamInfo info{"attitude",
                        "the robot's axis: wanted, measured, and the field's direction for it",
                        {{"wanted_x", "1", kWanted, kWorld},
                         {"wanted_y", "1", kWanted, kWorld},
                         {"wanted_z", "1", kWanted, kWorld},
                         {"x", "1", kMeasured, kWorld},
                         {"y", "1", kMeasured, kWorld},
                         {"z", "1", kMeasured, kWorld},
                         {"sigma", "rad", "standard deviation of the measured direction"},
                         {"field_x", "1", kField, kWorld},
                         {"field_y", "1", kField, kWorld},
                         {"field_z", "1", kField, kWorld}},
                        kExposure};
  for (std::size_t i = 0; i < recorder.streams().size(); ++i)
    if (recorder.streams()[i].info.name == info.name) return static_cast<int>(i);
  return recorder.add_stream(info);
}

}  // namespace

AttitudeLoop::AttitudeLoop(Recorder& recorder, const Eigen::Vector3d& axis,
                           const control::AttitudeGains& gains)
    : recorder_(recorder),
      path_(control::DirectionPath::hold(axis)),
      law_(gains),
      either_end_(gains.either_end) {}

void AttitudeLoop::turn(const control::DirectionPath& path) {
  if (stream_ < 0) stream_ = attitude_stream(recorder_);
  path_ = path;
  active_ = starting_ = true;
}

void AttitudeLoop::begin(double now) {
  if (!starting_) return;
  begin_ = now;
  starting_ = false;
}

Eigen::Vector3d AttitudeLoop::wanted(double time) const {
  return path_.at(starting_ ? 0 : time - begin_);
}

bool AttitudeLoop::turned(double time) const {
  return !starting_ && time - begin_ >= path_.duration();
}

/// While the reference turns by more than a little, the coils' delay is an error of the axis that
/// is not the field's: it is not learnt from.
void AttitudeLoop::observe(Time exposed, const Observation& observation) {
  measured_ = observation.axis;
  sigma_ = observation.axis_sigma;
  if (!active_) return;
  const double time = to_seconds(exposed);
  const Eigen::Vector3d now = wanted(time);
  // The axis of a soft robot has no sense: of both ends the one that is nearer to the reference is
  // meant.
  if (measured_ && either_end_ && measured_->dot(now) < 0) measured_ = -*measured_;
  constexpr double kStill = 1e-3;  // rad, in the time that the axis is behind the command
  constexpr double kBehind = 0.1;  // s
  const bool still = (wanted(time - kBehind) - now).norm() < kStill;
  // A gap in the measurements is no time for which the last error is known to have held.
  constexpr double kLongest = 0.2;  // s, of a measurement's weight
  if (measured_ && still)
    law_.update(*measured_, observation.axis_sigma, now,
                last_ ? std::min(time - *last_, kLongest) : 0);
  if (measured_) last_ = time;
  record(exposed, now);
}

Eigen::Vector3d AttitudeLoop::field_direction(double time) const {
  return law_.field_direction(wanted(time));
}

void AttitudeLoop::record(Time exposed, const Eigen::Vector3d& wanted) {
  const double nan = std::nan("");
  const Eigen::Vector3d axis = measured_.value_or(Eigen::Vector3d::Constant(nan));
  const Eigen::Vector3d field = law_.field_direction(wanted);
  // A row a frame, observed or not.
  recorder_.sample(stream_, exposed,
                   std::array{wanted.x(), wanted.y(), wanted.z(), axis.x(), axis.y(), axis.z(),
                              measured_ ? sigma_ : nan, field.x(), field.y(), field.z()});
}

}  // namespace vitreo
