// Record listener: interface to follow a run while it is recorded, as the live view does.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "host/record/run_data.h"

#include <span>
#include <string>

namespace vitreo {

/// Called by the run's own threads, in the middle of their work: must be quick, and must not throw.
class RecordListener {
 public:
  virtual ~RecordListener() = default;
  /// Each frame that was taken from a camera.
  virtual void seen(const std::string& camera, const Frame& frame) = 0;
  virtual void sample(const StreamInfo& stream, Time time, std::span<const double> values) = 0;
  virtual void event(Time time, const std::string& kind, const std::string& text) = 0;
};

}  // namespace vitreo
