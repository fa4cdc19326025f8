// Plant watch: the robot's measured motion held against what the currents that were set would make
// of it, and against what they would make with an amplifier or a coil that fails.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "host/rig/rig.h"
#include "host/servo/plant_fault.h"

#include <Eigen/Core>

#include <deque>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// A measurement that a loop took: m, world, at `time` (s).
struct WatchedPlace {
  double time = 0;
  Eigen::Vector3d position{0, 0, 0};
  Eigen::Matrix3d noise = Eigen::Matrix3d::Zero();        // m^2
  Eigen::Matrix3d systematic = Eigen::Matrix3d::Zero();   // m^2: of what stays from frame to frame
  Eigen::Matrix3d by_attitude = Eigen::Matrix3d::Zero();  // m^2: of it, by how the robot lies
};

/// A test of hypotheses over windows of 0.1 to 1 s, of any control law: the motion that is left
/// over when the believed one is taken off, and what the seconds before left over, as a drift or as
/// another response. It is a fault where it is beyond what noise, drag and gain explain, and a
/// failing amplifier or coil explains it. Slow deviations are not its business (LoopWatch), nor is
/// a robot that touches a wall.
class PlantWatch {
 public:
  /// The model is borrowed.
  explicit PlantWatch(const RigModel& model);
  /// What the coils were told at `now` (s), A; the robot's mobility then, m/(N s).
  void commanded(double now, const control::Currents& currents, const Eigen::Matrix3d& mobility);
  /// `delay`: s, by which the loop's delay is found to be longer than believed.
  void measured(const WatchedPlace& seen, double delay);
  /// A, what flows at `time` (s, not before the last measurement), by delay and lag of the coils.
  control::Currents flowing_at(double time) const;
  /// What the robot's motion says of amplifiers and coils; empty: they obey.
  const std::string& fault() const { return fault_; }
  /// The robot was told to go and its measured position stood: held fast, or an old picture.
  bool standing() const { return standing_; }
  /// What is left over, of the window that says most, over what is let pass. For figures.
  double excess() const { return excess_; }
  /// The robot was found at `time` (s), for the first time or again: it turns into the field, and
  /// its first outlines are of another attitude.
  void found(double time);
  /// The robot is not seen, beside a wall, or let go: what it did until now says nothing.
  void forget();

 private:
  struct Sample {
    double time = 0;
    Eigen::Vector3d position{0, 0, 0};
    double variance = 0;                                    // m^2, the largest of a direction
    PlantMotions moved;                                     // since the first sample
    Eigen::Matrix3d by_attitude = Eigen::Matrix3d::Zero();  // m^2
    double place_sigma = 0;                                 // m, of a coordinate: systematic
    Eigen::VectorXd shares;                                 // T, of the field, each coil's
    control::FieldGradient field = control::FieldGradient::Zero();
  };
  struct Told {
    double acts = 0;  // s
    control::Currents currents;
  };
  struct Flow {
    control::Currents currents;
    double time = 0;       // s, to which they are known
    std::size_t last = 0;  // of told_, that acts
  };
  struct Verdict {  // of a window
    const Sample* then = nullptr;
    double response = 1;  // part of what was told that is expected
    double excess = 0;
    bool doubtful = false;
    bool standing = false;
  };
  struct Before {  // the seconds before a window, and m/s, their means
    const Sample& first;
    const Sample& last;
    Eigen::Vector3d told{0, 0, 0}, went{0, 0, 0};
  };
  void advance(Flow& flow, double time) const;
  void flow_to(double time);
  void note_field(Sample& sample) const;  // of the currents that flow
  PlantMotions velocities(const Eigen::Vector3d& position) const;
  std::optional<Before> before() const;
  void look_back(const Before& slow);
  bool unanswered() const;
  static double by_turn(const Sample& then, const Sample& now, const Eigen::Vector3d& along);
  static Eigen::Vector3d expected_by(double response, const Before& slow, const Sample& then,
                                     const Sample& now);
  std::string cause(const Verdict& verdict, const Before& slow) const;
  Verdict judge(const Sample& then, const Sample& now, const Before& slow, double farthest) const;

  const RigModel& model_;
  const double lag_;  // s, of the coils
  std::deque<Told> told_;
  Flow flow_;
  Eigen::Matrix3d mobility_ = Eigen::Matrix3d::Zero();
  std::deque<Sample> samples_;  // the newest at the end
  double heard_from_ = -1e9;    // s
  double flows_from_ = 1e9;     // s: before, a robot may rest on what holds it
  int doubtful_ = 0;            // measurements in a row
  int stood_ = 0;
  int unanswered_ = 0;
  std::string fault_;
  bool standing_ = false;
  double excess_ = 0;
};

}  // namespace vitreo
