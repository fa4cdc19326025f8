// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/simulated_camera.h"

#include "devices/error.h"
#include "devices/sim/hardware_draw.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::sim {

void CameraSettings::check() const {
  if (!(frame_rate > 0 && frame_rate <= 10000)) throw std::invalid_argument("frame_rate must be in (0, 10000] Hz");
  if (!(exposure >= 0 && exposure <= 0.1 && exposure <= 1 / frame_rate))
    throw std::invalid_argument("exposure must be in [0, 1 / frame_rate] s, and at most 0.1 s");
  if (!(latency >= exposure / 2 && latency < 0.4))
    throw std::invalid_argument("latency must be in [exposure / 2, 0.4) s");
  if (!(jitter >= 0 && jitter <= 0.1)) throw std::invalid_argument("jitter must be in [0, 0.1] s");
  sensor.check();
}

SimulatedCamera::SimulatedCamera(CameraInfo info, const CameraSettings& settings, Clock& clock, std::uint64_t seed,
                                 Draw draw)
    : info_(std::move(info)),
      clock_(clock),
      draw_(std::move(draw)),
      period_(from_seconds(1 / settings.frame_rate)),
      latency_(from_seconds(settings.latency)),
      jitter_(settings.jitter),
      seed_(seed) {}

Time SimulatedCamera::arrival(std::int64_t number) const {
  const Time steady = number * period_ + latency_;
  if (!(jitter_ > 0)) return steady;
  std::mt19937_64 random(mix(seed_, static_cast<std::uint64_t>(number), 7));
  const double late = jitter_ * std::abs(std::normal_distribution<double>()(random));
  const double most = std::min(0.9 * to_seconds(period_), 0.09);  // frames come in their order, and within the history
  return steady + from_seconds(std::min(late, most));
}

Frame SimulatedCamera::grab(Time timeout) {
  const Time now = clock_.now(), deadline = later(now, timeout);
  // The newest that has arrived, if it was not yet returned; else the next one to arrive.
  std::int64_t arrived = now < latency_ ? -1 : (now - latency_) / period_;
  if (arrived >= 0 && arrival(arrived) > now) --arrived;
  const std::int64_t number = std::max(arrived, last_ + 1);
  const Time exposed = number * period_, arrives = arrival(number);
  if (arrives > deadline) {
    clock_.sleep_until(deadline);
    throw DeviceError(DeviceErrorKind::timeout, info_.identity, "no frame in time");
  }
  clock_.sleep_until(arrives);
  last_ = number;
  const auto count = static_cast<std::uint64_t>(number);
  return {draw_(exposed, count), count, exposed, arrives};
}

}  // namespace vitreo::sim
