// Step-out of a robot in a rotating field: closed forms, and its detection from the speed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/robot.h"

#include <deque>

namespace vitreo::control {

/// Hz: above it the largest torque m B turns a body of the rotational drag `drag` (N m s) no longer
/// with the field: m B / (2 pi drag). `moment` in A m^2, `field` in T.
double step_out_frequency(double moment, double field, double drag);

/// Hz: of a robot in a rotating field of `field` T, by its largest torque there: of a permanent
/// magnet m B, of a soft one that of its anisotropy; a helix turns about its own axis, on which no
/// force acts, any other about one across it.
double step_out_frequency(const Robot& robot, const Medium& medium, double field);

/// Hz, the body's mean rotation in a field of `frequency`: the same up to the step-out, and
/// f - sqrt(f^2 - f_so^2) above it (Adler 1946; McNaughton et al. 2006). Both at least 0.
double mean_rotation(double frequency, double step_out);

/// Hz: the step-out that explains a mean rotation of `part` (below 1) of the field's; the inverse
/// of the above.
double step_out_of(double frequency, double part);

struct StepOutSettings {
  double window = 0.6;      // s over which the speed is measured
  double drop = 0.75;       // of the response before it, below which it has stepped out
  double noise = 4.3e-6;    // m, of one coordinate of one measurement
  double significance = 5;  // standard deviations of the drop, at least
  double memory = 4;        // s, of the response before
  bool known = true;        // the response is believed to be 1; else it is learnt first
  void check() const;       // throws std::invalid_argument naming the setting
};

/// What was seen of the robot's response: its motion along the commanded one over the commanded.
struct RotationResponse {
  double now = 1;     // of the window
  double before = 1;  // of the memory, while it turned with the field
  double sigma = 0;   // of `now`
  bool stepped_out = false;
  double step_out = 0;  // Hz, where it stepped out: what explains the drop
};

/// Compares, measurement by measurement, the way that the robot went along the commanded one with
/// that: while it turns with the field, their ratio changes slowly (fluid, size and slip do), at a
/// step-out at once.
class StepOutWatch {
 public:
  explicit StepOutWatch(const StepOutSettings& settings);
  /// Since the last call: `went`, m, along the commanded direction, and `commanded`, m, that a
  /// robot of the believed response would have gone; `span`, s, and the field's frequency, Hz.
  /// True where the step-out was found now.
  bool add(double went, double commanded, double span, double frequency);
  const RotationResponse& response() const { return response_; }
  /// What comes next does not join what was seen: a window is of one way, whose two ends alone are
  /// uncertain.
  void interrupt() { window_.clear(); }
  /// The frequency was lowered: what comes is judged anew, by the response from before.
  void recovered();
  /// Since recovered() a whole window was judged, and it turned with the field.
  bool settled() const { return settled_; }
  void reset();

 private:
  struct Piece {
    double went, commanded, span;
  };
  void learn(double span);

  StepOutSettings settings_;
  RotationResponse response_;
  std::deque<Piece> window_;
  bool settled_ = false;
  double learnt_ = 0;  // s of response before
};

}  // namespace vitreo::control
