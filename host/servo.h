// The servo loop: frame -> ellipse -> position -> velocity wanted -> field and force -> currents, once a frame, in C++.
// A script starts it, steers it, listens to it. Nothing in here can reach the simulator's truth.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/path.h"
#include "control/pd.h"
#include "devices/camera.h"
#include "devices/clock.h"
#include "devices/coil_amplifier.h"
#include "host/recorder.h"
#include "host/rig.h"
#include "vision/background.h"

#include <Eigen/Core>

#include <exception>
#include <memory>
#include <optional>
#include <string>

namespace vitreo {

struct ServoSettings {
  double field = 10e-3;           // T, magnitude of the field
  Eigen::Vector3d axis{1, 0, 0};  // the robot's axis wanted, world
  control::PdGains gains;
  double lost_timeout = 1.0;  // s without a measurement before the loop lets go: zero current until told again
  void check() const;         // throws std::invalid_argument naming the setting
};

enum class ServoState { searching, holding, following, released, lost, failed, closed };
const char* to_string(ServoState state);

struct ServoStatus {
  ServoState state = ServoState::searching;
  Time time{};                              // exposure of the frame behind it
  std::optional<Eigen::Vector3d> position;  // m, world: estimated
  Eigen::Vector3d target{0, 0, 0};          // m, world: the reference at `time`
  double progress = 1;                      // of the path that is being followed, 0 to 1
  double headroom = 1;                      // 1 - largest |current| / limit
  std::string failure;                      // what ended it, in state failed
  std::exception_ptr error;                 // the same as it was thrown
};

/// The calls return at once; `changed()` is notified at each tick. The loop runs as a task of the clock; destruction
/// ends it with the coils at zero.
class Servo {
 public:
  Servo(Clock& clock, Rig& rig, Recorder& recorder, vision::Background background, const ServoSettings& settings);
  ~Servo();
  ServoStatus status() const;
  Signal& changed();
  /// Goes along a path, then holds its end. The path's time starts at the next tick. `pictures`: so many snapshots
  /// evenly along the way.
  void follow(const control::Path& path, int pictures = 0);
  void hold(const Eigen::Vector3d& position);
  /// The field still follows the robot and carries its weight; its place is left alone.
  void release();
  /// The constant force that is added to the weight compensation (the thesis' hand trim), N, world.
  void set_trim(const Eigen::Vector3d& force);
  Eigen::Vector3d trim() const;
  /// Mean over the last `duration` of the velocity the position controller asked for, turned into a force, N: what the
  /// model lacks at this place. Throws std::logic_error when it was not holding that long.
  Eigen::Vector3d mean_correction(double duration) const;
  /// Puts the next frame, with the tracked ellipse, the trail and the target drawn on it, into the record.
  void snapshot(const std::string& caption);
  void close();  // zero current, ends the loop; idempotent

 private:
  struct Loop;
  std::unique_ptr<Loop> loop_;
};

}  // namespace vitreo
