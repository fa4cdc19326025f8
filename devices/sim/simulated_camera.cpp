// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/simulated_camera.h"

#include "devices/sim/checks.h"
#include "devices/sim/hardware_sample.h"
#include "devices/sim/spoiled_picture.h"
#include "devices/time/error.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace vitreo::sim {

void CameraSettings::check() const {
  require(frame_rate > 0 && frame_rate <= 10000, "frame_rate must be in (0, 10000] Hz");
  require(exposure >= 0 && exposure <= 0.1 && exposure <= 1 / frame_rate,
          "exposure must be in [0, 1 / frame_rate] s, and at most 0.1 s");
  require(latency >= exposure / 2 && latency < 0.4, "latency must be in [exposure / 2, 0.4) s");
  require(jitter >= 0 && jitter <= 0.1, "jitter must be in [0, 0.1] s");
  require(std::abs(stamp) <= latency, "stamp must be at most the latency");
  sensor.check();
}

SimulatedCamera::SimulatedCamera(CameraInfo info, const CameraSettings& settings, Clock& clock,
                                 std::uint64_t seed, Draw draw, const ImagingFaults& faults)
    : info_(std::move(info)),
      clock_(clock),
      draw_(std::move(draw)),
      period_(from_seconds(1 / settings.frame_rate)),
      latency_(from_seconds(settings.latency)),
      jitter_(settings.jitter),
      stamp_(from_seconds(settings.stamp)),
      seed_(seed),
      faults_(faults) {}

// Exposure at k period, arrival after the latency and a half-normal jitter that is seeded with the
// frame's number: a frame arrives at the same time whether or not others are pulled.
Time SimulatedCamera::arrival(std::int64_t number) const {
  const Time steady = number * period_ + latency_;
  if (!(jitter_ > 0)) return steady;
  std::mt19937_64 random(mix(seed_, static_cast<std::uint64_t>(number), 7));
  const double late = jitter_ * std::abs(std::normal_distribution<double>()(random));
  // Below a period, so that frames come in their order, and within the world's history.
  const double most = std::min(0.9 * to_seconds(period_), 0.09);
  return steady + from_seconds(std::min(late, most));
}

// The newest that has arrived, if it was not yet returned; else the next one to arrive.
// By the latency alone; where its own jitter still holds that frame, the one before it is the
// newest.
std::int64_t SimulatedCamera::next() const {
  const Time now = clock_.now() - faults_.late;
  std::int64_t arrived = now < latency_ ? -1 : (now - latency_) / period_;
  if (arrived >= 0 && arrival(arrived) > now) --arrived;
  return std::max(arrived, last_ + 1);
}

// Whether a frame gets through; counts those that do not as lost or torn.
bool SimulatedCamera::comes(std::int64_t number) {
  const auto each = [number](int n) { return n > 0 && number % n == 0; };
  const bool dropped = each(faults_.drops) || faults_.silent;
  const bool torn = !dropped && each(faults_.torn);
  statistics_.lost += dropped ? 1 : 0;
  statistics_.torn += torn ? 1 : 0;
  return !dropped && !torn;
}

// The cable may be pulled before the wait or during it.
void SimulatedCamera::wait_until(Time due) {
  if (faults_.unplugged) throw DeviceError(DeviceErrorKind::lost, info_.identity, "is gone");
  clock_.sleep_until(due);
  if (faults_.unplugged) throw DeviceError(DeviceErrorKind::lost, info_.identity, "is gone");
}

std::string SimulatedCamera::feature(const std::string& name) {
  if (name != "Gain")
    throw DeviceError(DeviceErrorKind::refused, info_.identity,
                      "feature " + name + ": a simulated camera has Gain alone");
  return std::to_string(gain_);
}

std::string SimulatedCamera::set_feature(const std::string& name, const std::string& value) {
  constexpr double kMost = 24;               // dB
  if (name != "Gain") return feature(name);  // throws
  char* end = nullptr;
  const double wanted = std::strtod(value.c_str(), &end);
  if (value.empty() || *end != '\0' || !(wanted >= 0 && wanted <= kMost))
    throw DeviceError(DeviceErrorKind::refused, info_.identity,
                      "feature Gain: '" + value + "' is not in [0, 24] dB");
  gain_ = wanted;
  return feature(name);
}

// Two pictures are kept, for a fault that repeats them.
void SimulatedCamera::expose(Time exposed, std::uint64_t number) {
  const bool old = faults_.frozen || faults_.stale || (faults_.alternating && !before_.empty());
  if (old && !picture_.empty()) return;
  before_ = picture_;
  picture_ = spoiled(draw_(exposed, number), faults_.picture, exposed);
  if (gain_ > 0) picture_.convertTo(picture_, -1, std::pow(10, gain_ / 20));
}

// An old picture with noise of its own is as a stuck buffer behind a converter, or a film of it.
cv::Mat SimulatedCamera::delivered(std::uint64_t number) {
  constexpr double kNoise = 2;  // gray levels, standard deviation
  if (faults_.alternating && !faults_.frozen && number % 2 == 0) return before_;
  if (!faults_.stale) return picture_;
  cv::Mat noise(picture_.size(), CV_MAKETYPE(CV_16S, picture_.channels()));
  cv::RNG random(mix(seed_, number, 11));
  random.fill(noise, cv::RNG::NORMAL, 0, kNoise);
  cv::Mat seen;
  cv::add(picture_, noise, seen, cv::noArray(), picture_.type());
  return seen;
}

// Pulls the newest frame, and renders only that one. Its time stamp is the middle of the exposure.
Frame SimulatedCamera::grab(Time timeout) {
  const Time deadline = later(clock_.now(), timeout);
  for (;;) {
    const std::int64_t number = next();
    const Time exposed = number * period_;
    const Time arrives = arrival(number);
    if (later(arrives, faults_.late) > deadline) {
      wait_until(deadline);
      throw DeviceError(DeviceErrorKind::timeout, info_.identity, "no frame in time");
    }
    wait_until(arrives);
    last_ = number;
    if (!comes(number)) continue;
    const auto count = static_cast<std::uint64_t>(number);
    expose(exposed, count);
    if (faults_.late > Time::zero()) wait_until(later(arrives, faults_.late));
    ++statistics_.delivered;
    return {delivered(count), count, exposed + stamp_ + faults_.stamp_error(exposed),
            std::max(arrives, later(arrives, faults_.late))};
  }
}

}  // namespace vitreo::sim
