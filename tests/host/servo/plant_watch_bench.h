// A bench of the plant watch: beside the watch all that it was told and saw, whose currents and
// motions are summed by other ways.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/robot.h"
#include "control/robots.h"
#include "host/rig/rig.h"
#include "host/servo/field_allocator.h"
#include "host/servo/plant_fault.h"
#include "host/servo/plant_watch.h"

#include <Eigen/Core>
#include <Eigen/LU>

#include <cmath>
#include <random>
#include <vector>

namespace vitreo::plant_watch_bench {

constexpr double kFrame = 0.125;  // s: a binary fraction, so that spans are met exactly

inline double uniform(std::mt19937& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random()) / 4294967296.0;
}

inline Eigen::Vector3d box(std::mt19937& random, double half) {
  Eigen::Vector3d drawn;
  for (double& one : drawn) one = uniform(random, -half, half);
  return drawn;
}

// A slow coil, whose currents anybody's steps of integration follow.
inline RigModel rig_model() {
  RigModel model;
  model.robot = control::robot_named("ndfeb_cylinder_1mm");
  model.command_bandwidth = 3;
  return model;
}

struct Command {
  double time;
  control::Currents currents;
};

/// Each command's step from the one before it, that comes in by 1 - exp(-t / lag).
inline control::Currents flow(const RigModel& model, const std::vector<Command>& told,
                              double time) {
  const double lag = 1 / (2 * M_PI * model.command_bandwidth);
  control::Currents flowing = control::Currents::Zero(model.field.coils());
  control::Currents before = flowing;
  for (const Command& one : told) {
    const double since = time - one.time - model.command_delay;
    if (since > 0) flowing += (1 - std::exp(-since / lag)) * (one.currents - before);
    before = one.currents;
  }
  return flowing;
}

struct Seen {
  double time;
  Eigen::Vector3d position;
  double variance;  // m^2
  PlantMotions moved;
};

/// A watch, and beside it all that was told and seen.
struct Bench {
  RigModel model = rig_model();
  PlantWatch watch{model};
  Eigen::Matrix3d mobility = control::resistance(model.robot, model.medium, {1, 0, 0}).inverse();
  std::vector<Command> told;
  std::vector<Seen> seen;
  double heard = -1e9;  // s
  double delay = 0;     // s

  Bench() = default;
  Bench(const Bench&) = delete;  // the watch borrows the model
  Bench& operator=(const Bench&) = delete;

  void tell(double now, const control::Currents& currents) {
    told.push_back({now, currents});
    watch.commanded(now, currents, mobility);
  }
  void see(double now, const Eigen::Vector3d& position, double sigma) {
    PlantMotions moved = PlantMotions::Zero(3, kPlantCoils + kPlantPerCoil * model.field.coils());
    constexpr int kSteps = 32;
    if (!seen.empty()) {
      moved = seen.back().moved;
      const double step = (now - seen.back().time) / kSteps;
      for (int k = 0; k < kSteps && !told.empty(); ++k)
        moved +=
            step * plant_velocities(model.robot,
                                    {model.field.matrix(position), model.field.background(position),
                                     model.robot.net_weight(model.medium), mobility},
                                    flow(model, told, seen.back().time - delay + (k + 0.5) * step));
    }
    seen.push_back({now, position, sigma * sigma, moved});
    WatchedPlace place{now, position};
    place.noise = Eigen::Vector3d(0.5, 1, 0.2).asDiagonal() * sigma * sigma;
    watch.measured(place, delay);
  }
  void found(double now) {
    seen.clear();
    heard = now + 0.5;  // docs/localization.md: nothing is heard for so long
    watch.found(now);
  }
  void forget() {
    seen.clear();
    watch.forget();
  }
};

inline control::Currents levitation(const Bench& bench, const Eigen::Vector3d& place,
                                    const Eigen::Vector3d& velocity) {
  const FieldAllocator allocator(bench.model, {});
  return allocator.allocate(place, bench.mobility.inverse() * velocity).currents;
}

}  // namespace vitreo::plant_watch_bench
