// SPDX-License-Identifier: Apache-2.0
#include "control/direction_path.h"

#include "control/constants.h"
#include "control/preconditions.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::control {
namespace {

// Of 3 s^2 - 2 s^3, at its middle.
constexpr double kSteepest = 1.5;
constexpr double kOpposite = 1e-3;  // rad, of 180 degrees

// Of unit vectors; by atan2, as acos loses half of the digits at small angles.
double angle_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

Eigen::Vector3d unit(const Eigen::Vector3d& direction) {
  require(direction.allFinite() && direction.norm() > 1e-9, "direction: must not be zero");
  return direction.normalized();
}

}  // namespace

DirectionPath DirectionPath::hold(const Eigen::Vector3d& direction) {
  return timed({direction}, {0});
}

DirectionPath DirectionPath::through(const std::vector<Eigen::Vector3d>& directions, double rate) {
  require(positive(rate), "turn_speed: must be above 0 rad/s");
  std::vector<double> times;
  for (std::size_t k = 0; k < directions.size(); ++k)
    // The blend's steepest rate is 1.5 of its mean one, so the arc takes 1.5 angle / rate. The same
    // direction twice still takes time, as times have to rise.
    times.push_back(k == 0
                        ? 0
                        : times.back() +
                              kSteepest / rate *
                                  std::max(angle_between(directions[k - 1], directions[k]), 1e-6));
  return timed(directions, times);
}

DirectionPath DirectionPath::timed(const std::vector<Eigen::Vector3d>& directions,
                                   const std::vector<double>& times) {
  require(!directions.empty() && directions.size() == times.size(),
          "directions: one for each time is wanted");
  DirectionPath path;
  for (std::size_t k = 0; k < directions.size(); ++k) {
    require(k == 0 ? times[k] == 0 : times[k] > times[k - 1], "times: must rise from 0 s");
    path.knots_.push_back({times[k], unit(directions[k])});
    // Between opposite directions every great arc is as short: the way would be rounding's choice.
    require(k == 0 || angle_between(path.knots_[k - 1].direction, path.knots_[k].direction) <
                          kPi - kOpposite,
            "direction: opposite to the one before; give one between, the way to turn");
  }
  return path;
}

Eigen::Vector3d DirectionPath::at(double time) const {
  const auto after = std::find_if(knots_.begin(), knots_.end(),
                                  [time](const Knot& knot) { return knot.time > time; });
  if (after == knots_.begin()) return knots_.front().direction;
  if (after == knots_.end()) return knots_.back().direction;
  const Knot& from = *(after - 1);
  const Eigen::Vector3d across = from.direction.cross(after->direction);
  if (!(across.norm() > 1e-12)) return after->direction;
  const double part = (time - from.time) / (after->time - from.time);
  const double angle = angle_between(from.direction, after->direction);
  // Rotated about the arc's normal: unit all the way, and at rest at each knot.
  return Eigen::AngleAxisd(angle * part * part * (3 - 2 * part), across.normalized()) *
         from.direction;
}

double DirectionPath::fastest() const {
  double fastest = 0;
  for (std::size_t k = 1; k < knots_.size(); ++k)
    fastest =
        std::max(fastest, kSteepest * angle_between(knots_[k - 1].direction, knots_[k].direction) /
                              (knots_[k].time - knots_[k - 1].time));
  return fastest;
}

}  // namespace vitreo::control
