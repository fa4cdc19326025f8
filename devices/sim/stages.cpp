// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/stages.h"

#include "devices/error.h"
#include "devices/sim/checks.h"

#include <algorithm>
#include <cmath>

namespace vitreo::sim {

AxisMotion::AxisMotion(std::vector<StageAxis> axes, std::string device, const char* unit, Clock& clock)
    : axes_(std::move(axes)), device_(std::move(device)), unit_(unit), clock_(clock) {
  for (const StageAxis& axis : axes_) {
    if (!(axis.travel_min <= axis.travel_max)) throw std::invalid_argument(device_ + ": travel is empty");
    require_positive(axis.max_speed, (device_ + " max_speed").c_str());
    from_.push_back(std::clamp(0.0, axis.travel_min, axis.travel_max));
  }
  target_ = from_;
}

std::vector<double> AxisMotion::at(Time time) const {
  if (time >= arrives_) return target_;
  if (time <= started_) return from_;
  const double part = to_seconds(time - started_) / to_seconds(arrives_ - started_);
  std::vector<double> place = from_;
  for (std::size_t k = 0; k < place.size(); ++k) place[k] += part * (target_[k] - from_[k]);
  return place;
}

void AxisMotion::start(std::span<const double> target, double speed) {
  check_motion(axes_, target, speed, device_, unit_);
  if (moving()) throw DeviceError(DeviceErrorKind::refused, device_, "it is moving");
  const Time now = clock_.now();
  from_ = at(now);
  double longest = 0;
  for (std::size_t k = 0; k < axes_.size(); ++k) {
    const double step = axes_[k].resolution;
    target_[k] = step > 0 ? std::clamp(std::round(target[k] / step) * step, axes_[k].travel_min, axes_[k].travel_max)
                          : target[k];
    longest = std::max(longest, std::abs(target_[k] - from_[k]));
  }
  started_ = now;
  arrives_ = now + from_seconds(longest / speed);
  stopped_ = false;
}

void AxisMotion::wait(Time timeout) {
  const Time deadline = later(clock_.now(), timeout);
  clock_.wait(
      changed_, [this] { return !moving(); }, std::min(arrives_, deadline));
  if (moving()) {
    stop();
    throw DeviceError(DeviceErrorKind::timeout, device_, "not there in time; it was stopped");
  }
  if (stopped_) throw DeviceError(DeviceErrorKind::refused, device_, "it was stopped before it arrived");
}

void AxisMotion::stop() {
  if (!moving()) return;
  from_ = target_ = at(clock_.now());
  arrives_ = started_ = clock_.now();
  stopped_ = true;
  clock_.notify(changed_);
}

void AxisMotion::home() const {
  throw DeviceError(DeviceErrorKind::refused, device_, "it knows its positions: there is no reference to find");
}

SimulatedStage::SimulatedStage(std::string name, const std::vector<StageAxis>& axes, Clock& clock)
    : info_{{"simulated " + name, "", ""}, axes}, clock_(clock), motion_(axes, std::move(name), "m", clock) {}

SimulatedRotationStage::SimulatedRotationStage(std::string name, const StageAxis& axis, Clock& clock)
    : info_{{"simulated " + name, "", ""}, axis}, clock_(clock), motion_({axis}, std::move(name), "rad", clock) {}

void ProbeSettings::check() const {
  require_not_negative(noise, "probe noise");
  require_positive(range, "probe range");
  require_not_negative(integration, "probe integration");
}

SimulatedProbe::SimulatedProbe(const ProbeSettings& settings, World& world, std::function<Eigen::Vector3d()> place,
                               Clock& clock, std::uint64_t seed)
    : info_{{"simulated teslameter", "", ""}, 3, settings.range},
      settings_(settings),
      world_(world),
      place_(std::move(place)),
      clock_(clock),
      random_(seed) {
  settings_.check();
}

FieldReading SimulatedProbe::measure(Time timeout) {
  const Time asked = clock_.now(), needed = from_seconds(settings_.integration);
  if (needed > timeout) {
    clock_.sleep_for(timeout);
    throw DeviceError(DeviceErrorKind::timeout, "field_probe", "a reading takes longer than that");
  }
  clock_.sleep_for(needed);
  const Eigen::Vector3d field = world_.field(clock_.now(), place_()).head<3>();
  FieldReading reading{{}, asked};
  for (int axis = 0; axis < 3; ++axis) reading.field.push_back(field[axis] + settings_.noise * normal_(random_));
  for (const double part : reading.field)
    if (std::abs(part) > settings_.range)
      throw DeviceError(DeviceErrorKind::refused, "field_probe", "the field is beyond its range");
  return reading;
}

}  // namespace vitreo::sim
