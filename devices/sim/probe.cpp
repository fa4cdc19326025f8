// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/probe.h"

#include "devices/sim/checks.h"
#include "devices/time/error.h"

#include <cmath>
#include <utility>

namespace vitreo::sim {

void ProbeSettings::check() const {
  require_not_negative(noise, "probe noise");
  require_positive(range, "probe range");
  require_not_negative(integration, "probe integration");
}

SimulatedProbe::SimulatedProbe(const ProbeSettings& settings, Field field,
                               std::function<Eigen::Vector3d()> position, Clock& clock,
                               std::uint64_t seed)
    : info_{{"simulated teslameter", "", ""}, 3, settings.range},
      settings_(settings),
      field_(std::move(field)),
      position_(std::move(position)),
      clock_(clock),
      random_(seed) {
  settings_.check();
}

// The field at the end of the integration time, with white Gaussian noise on each axis. Beyond the
// range of one axis there is no reading, as a saturated teslameter shows none.
// That end is its moment, and nothing about it is uncertain.
FieldReading SimulatedProbe::measure(Time timeout) {
  const Time needed = from_seconds(settings_.integration);
  if (needed > timeout) {
    clock_.sleep_for(timeout);
    throw DeviceError(DeviceErrorKind::timeout, "field_probe", "a reading takes longer than that");
  }
  clock_.sleep_for(needed);
  const Eigen::Vector3d field = field_(clock_.now(), position_());
  FieldReading reading{{}, clock_.now()};
  for (int axis = 0; axis < 3; ++axis)
    reading.field.push_back(field[axis] + settings_.noise * normal_(random_));
  for (const double part : reading.field)
    if (std::abs(part) > settings_.range)
      throw DeviceError(DeviceErrorKind::refused, "field_probe", "the field is beyond its range");
  return reading;
}

}  // namespace vitreo::sim
