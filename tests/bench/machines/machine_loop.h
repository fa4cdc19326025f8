// One simulated machine with one law, without devices: the simulator's own plant (sim::World,
// sampled as a laboratory's is) and a late, noisy position sensor. For the benchmark of the laws
// and for tests of them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/trajectory.h"
#include "devices/sim/laboratory.h"
#include "host/rig/rig.h"
#include "host/servo/servo_controller.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::machines {

/// What is true against what is believed, beyond what is drawn.
struct Mistake {
  std::string name = "nominal";
  double delay = 0;   // s, more than believed
  double drag = 1;    // factor
  double moment = 1;  // factor
  double mass = 1;    // factor
};

/// What the loop believes beyond the rig's nominal model: factors, and s.
struct Belief {
  double drag_along = 1;
  double drag_across = 1;
  double moment = 1;
  double delay = 50e-3;
  std::optional<control::FieldModel> field{};  // in the nominal one's place
};

/// A coil of which from `time` (s) on only `part` of the current flows. 0: none.
struct CoilFault {
  int coil = 0;
  double time = 0;
  double part = 0;
};

struct MachineSetting {
  std::string robot = "coni_2mm";
  Eigen::Vector3d axis{1, 0, 0};
  double field = 10e-3;  // T
  // The stated sigmas of a simulated rig, and walls that the loop knows; else coils and moment
  // alone are drawn, and there are no walls.
  bool drawn = true;
  bool walls = true;           // in the plant
  bool walls_believed = true;  // in the loop
  Mistake mistake;
  double frame_rate = 15;        // 1/s
  double latency = 0.08;         // s, from exposure to the loop
  double noise = 0.3 * 14.3e-6;  // m, each coordinate
  // m/rad: by so much the readings are too low where the axis is pitched against the commanded one,
  // as a camera's are that takes the commanded axis (docs/reliability.md: 2.5 to 5 mm/rad by one).
  double view_lever = 0;
  // rad/s, along great arcs to directions drawn from the seed, one each ten seconds, at most 60
  // degrees steep; 0: the axis stays. So the allocation goes over to other currents.
  double turning = 0;
  std::vector<int> dead;   // coils, from 1
  bool dead_known = true;  // to the loop
  CoilFault fault;         // not known to the loop
  Belief belief;
  double tone = 0.6;         // A: ControllerSettings::tone
  double proportional = 0;   // 1/s, of the law now and of the PD; 0: their own
  double field_max = 30e-3;  // T: the law now may raise the field so far
  std::uint64_t seed = 1;
};

/// before: tests/bench/machines/law_before.h. now: the product's law estimator. pd: the thesis'.
enum class Law { before, now, pd };

struct MachineResult {
  double rms = 0;       // m, of the true place against the reference, in 3-D
  double largest = 0;   // m
  std::string failure;  // what the loop threw
  // Of the filter, while the error counts (law now): normalized squared errors of position and of
  // innovation over their 3 degrees of freedom, and the innovations' correlation from one to the
  // next, mean of the coordinates.
  double consistency = 0;
  double innovation = 0;
  double correlation = 0;
  // Least of the margins with the gains in use, asked for every three seconds (law now).
  double gain_margin = 1e9;   // factor
  double delay_margin = 1e9;  // s
  double gain = 0;            // estimated at the end
  double delay = 0;           // s
  // What the loop watch said, s, first; below 0: never. Of a coil: that one was named, and which.
  double oscillation = -1;
  double oscillating = 0;  // s in all, for which an oscillation was told
  double swing = 0;        // m, the largest amplitude that was told
  double standstill = -1;
  double weak = -1;
  int weak_coil = 0;
  int alarms = 0;  // of all kinds, beginnings
  // m, of the true place about its mean, in the coordinate in which it is the most: root of twice
  // the variance, of each ten seconds from the begin on.
  std::vector<double> swings;
  double limited = 0;   // part of the steps
  double headroom = 1;  // least
  bool lost() const { return !failure.empty() || !(rms < 200e-6); }
};

/// The loop's model, the plant's settings with everything drawn, and s, the readings' latency.
RigModel believed(const MachineSetting& setting);
sim::WorldSettings plant(const MachineSetting& setting, const RigModel& model);
double latency_of(const MachineSetting& setting);
ControllerSettings settings_of(const MachineSetting& setting, ControlLaw law);

/// What the loop watch says now and did not before, in a run's names.
void note_quality(MachineResult& result, LoopQuality& before, const LoopQuality& now, double time);

/// Holds the path's first position for `settle` seconds after the coils were switched on, then goes
/// along; the errors are of the path and of `after` seconds at its end.
MachineResult run_machine(const MachineSetting& setting, Law law, const control::Trajectory& path,
                          double settle, double after);

}  // namespace vitreo::machines
