// Simulated camera: exposes at a steady rate, pulled or not; only a frame that is pulled is
// rendered.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/sim/faults.h"
#include "devices/sim/renderer.h"
#include "devices/sim/view.h"

#include <functional>

namespace vitreo::sim {

struct CameraSettings {
  ImageSize size;
  double frame_rate = 15;  // Hz
  double exposure = 5e-3;  // s: what moves meanwhile is smeared
  // s, from the middle of the exposure until the host has the frame, at least
  double latency = 80e-3;
  // s, that come on top: |N(0,1)| times this, below a frame's period; from the seed
  double jitter = 0;
  double stamp = 0;  // s, by which the stamp is later than the exposure's middle
  Sensor sensor;
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// A picture that is exposed and still to be drawn.
using Picture = std::function<cv::Mat()>;

class SimulatedCamera : public Camera {
 public:
  using Draw = std::function<cv::Mat(Time exposed, std::uint64_t number)>;
  /// `faults` outlives the camera.
  SimulatedCamera(CameraInfo info, const CameraSettings& settings, Clock& clock, std::uint64_t seed,
                  Draw draw, const ImagingFaults& faults);
  const CameraInfo& info() const override { return info_; }
  Frame grab(Time timeout) override;
  CameraStatistics statistics() const override { return statistics_; }
  /// "Gain" alone, 0 to 24 dB: it brightens what is seen, the sensor's noise with it.
  std::string feature(const std::string& name) override;
  std::string set_feature(const std::string& name, const std::string& value) override;

 private:
  Time arrival(std::int64_t number) const;
  std::int64_t next() const;
  bool comes(std::int64_t number);
  void wait_until(Time due);
  void expose(Time exposed, std::uint64_t number);
  cv::Mat delivered(std::uint64_t number);

  CameraInfo info_;
  Clock& clock_;
  Draw draw_;
  Time period_;
  Time latency_;
  double jitter_;
  Time stamp_;
  std::uint64_t seed_;
  const ImagingFaults& faults_;
  std::int64_t last_ = -1;
  CameraStatistics statistics_;
  double gain_ = 0;  // dB
  cv::Mat picture_;  // the last one
  cv::Mat before_;   // the one before it
};

}  // namespace vitreo::sim
