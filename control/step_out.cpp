// SPDX-License-Identifier: Apache-2.0
#include "control/step_out.h"

#include "control/constants.h"
#include "control/preconditions.h"
#include "control/robots.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::control {

double step_out_frequency(double moment, double field, double drag) {
  require(not_negative(moment) && not_negative(field), "moment and field: must be at least 0");
  require(positive(drag), "drag: must be above 0 N m s");
  return moment * field / (2 * kPi * drag);
}

// By the torque m x B over the angle from the field to the axis; the lag of a soft body, whose
// torque goes as sin 2d, obeys the same equation in 2d.
double step_out_frequency(const Robot& robot, const Medium& medium, double field) {
  require(positive(field), "field: must be above 0 T");
  if (robot.helix)
    return step_out_frequency(
        robot.moment(field), field,
        helix_resistance(*robot.helix, medium.dynamic_viscosity()).free_spin());
  // One quadrant of the angle from the axis to the field, in steps of a degree: the torque of an
  // axially symmetric body has the period of half a turn and is odd.
  constexpr int kAngles = 90;
  const Eigen::Vector3d along(field, 0, 0);
  double torque = 0;
  for (int k = 1; k <= kAngles; ++k) {
    const double angle = kPi / 2 * k / kAngles;
    const Eigen::Vector3d axis(std::cos(angle), std::sin(angle), 0);
    torque = std::max(torque, robot_moment(robot, axis, along).cross(along).norm());
  }
  return torque / (2 * kPi * rotational_resistance(robot, medium));
}

// The lag d of the body behind the field obeys d' = w - w_so sin d: at rest below w_so; above it
// the mean of the body's rate w - d' over one slip is w - sqrt(w^2 - w_so^2).
double mean_rotation(double frequency, double step_out) {
  require(not_negative(frequency) && not_negative(step_out),
          "frequency and step_out: must be at least 0 Hz");
  if (frequency <= step_out) return frequency;
  return frequency - std::sqrt((frequency - step_out) * (frequency + step_out));
}

// With part = 1 - sqrt(1 - (f_so / f)^2) of mean_rotation(): f_so = f sqrt(1 - (1 - part)^2).
double step_out_of(double frequency, double part) {
  require(not_negative(frequency), "frequency: must be at least 0 Hz");
  const double slip = 1 - std::clamp(part, 0.0, 1.0);
  return frequency * std::sqrt(1 - slip * slip);
}

void StepOutSettings::check() const {
  require(positive(window), "step_out window: must be above 0 s");
  require(positive(drop) && drop < 1, "step_out drop: must be within 0 and 1");
  require(positive(noise), "step_out noise: must be above 0 m");
  require(positive(significance), "step_out significance: must be above 0");
  require(positive(memory), "step_out memory: must be above 0 s");
}

StepOutWatch::StepOutWatch(const StepOutSettings& settings) : settings_(settings) {
  settings_.check();
}

// The ratio of sums over the window, whose ends are two measurements: sigma = noise sqrt(2) / way.
// Found where the ratio is below `drop` of what it was before, by more than its noise, in a window
// that is full: turning the axis alone takes shorter.
bool StepOutWatch::add(double went, double commanded, double span, double frequency) {
  window_.push_back({went, commanded, span});
  double time = 0, way = 0, asked = 0;
  // From the newest backwards, until the window is full: older pieces are dropped, so the deque
  // stays as long as the window and the piece that crosses its begin.
  for (auto piece = window_.rbegin(); piece != window_.rend(); ++piece) {
    time += piece->span;
    way += piece->went;
    asked += piece->commanded;
    if (time < settings_.window) continue;
    window_.erase(window_.begin(), piece.base() - 1);
    break;
  }
  // A drop of (1 - drop) of the response must be `significance` sigma, and sigma falls with the
  // way: below this way no ratio is taken.
  const double shortest = std::sqrt(2.0) * settings_.noise * settings_.significance /
                          ((1 - settings_.drop) * response_.before);
  if (time < settings_.window || asked < shortest) return false;
  response_.now = way / asked;
  response_.sigma = std::sqrt(2.0) * settings_.noise / asked;
  // A response that is not known beforehand is learnt over two windows before it is compared with.
  const bool judged = settings_.known || learnt_ >= 2 * settings_.window;
  const bool low = response_.now < settings_.drop * response_.before;
  if (response_.stepped_out || !judged || !low) {
    if (!response_.stepped_out) learn(span);
    settled_ = !response_.stepped_out && !low;
    return false;
  }
  response_.stepped_out = true;
  settled_ = false;
  response_.step_out = step_out_of(frequency, response_.now / response_.before);
  return true;
}

// A mean at first, where nothing is known, then one that forgets.
void StepOutWatch::learn(double span) {
  learnt_ += span;
  const double memory = settings_.known ? settings_.memory : std::min(learnt_, settings_.memory);
  response_.before += (response_.now - response_.before) * std::min(1.0, span / memory);
  response_.before = std::max(response_.before, 1e-3);
}

void StepOutWatch::recovered() {
  settled_ = false;
  window_.clear();
  response_.stepped_out = false;
}

void StepOutWatch::reset() {
  settled_ = false;
  window_.clear();
  response_ = {};
  learnt_ = 0;
}

}  // namespace vitreo::control
