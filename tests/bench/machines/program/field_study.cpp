// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/field_machine.h"
#include "tests/bench/machines/program/studies.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace vitreo::machines {
namespace {

constexpr double kDegree = 0.01745329252;

/// Of all machines, before and after.
struct Column {
  std::string name;
  double unit;
  std::vector<double> before, after;

  void print() const {
    std::printf("  %-52s", name.c_str());
    for (const auto* values : {&before, &after}) {
      std::vector<double> sorted = *values;
      std::sort(sorted.begin(), sorted.end());
      if (sorted.empty()) continue;
      std::printf(" %9.2f / %9.2f", sorted[sorted.size() / 2] / unit, sorted.back() / unit);
    }
    std::printf("\n");
  }
};

}  // namespace

void field_study(const MachineSetting& setting, std::uint64_t first, int count) {
  const auto square =
      control::Trajectory::rectangle({-4e-3, 0, -3e-3}, {8e-3, 0, 0}, {0, 0, 6e-3}, {});
  const auto place = control::Trajectory::hold_at({2e-3, 0, 1e-3});
  Column drift{"drift of a robot that is to stand, um/s", 1e-6, {}, {}};
  Column direction{"direction of the field, rms, degrees", kDegree, {}, {}};
  Column largest{"the same, largest", kDegree, {}, {}};
  Column steep{"of directions pitched by 60 degrees and more, rms", kDegree, {}, {}};
  Column steepest{"the same, largest", kDegree, {}, {}};
  Column held{"hold of the thesis' PD, um", 1e-6, {}, {}};
  Column around{"square of the law estimator, um", 1e-6, {}, {}};
  Column other{"hold of the law estimator, um", 1e-6, {}, {}};
  double duration = 0;
  for (int k = 0; k < count; ++k) {
    MachineSetting one = setting;
    one.seed = first + static_cast<std::uint64_t>(k);
    const FieldMachine made = calibrate_field(one);
    if (!made.found) {
      std::printf("  failed: %s\n", made.failure.c_str());
      continue;
    }
    duration = made.duration;
    std::printf(
        "  seed %llu: %d displacements, left over %.1f um/s (%.1f before), response %.3f +- %.3f\n",
        static_cast<unsigned long long>(one.seed), made.found->fitted.rows,
        made.found->fitted.after * 1e6, made.found->fitted.before * 1e6, made.found->response.value,
        made.found->response.sigma);
    for (const bool after : {false, true}) {
      if (after) one.belief = made.belief;
      const auto put = [after](Column& column, double value) {
        (after ? column.after : column.before).push_back(value);
      };
      const FieldErrors errors = field_errors(one, believed(one), 15e-3);
      put(drift, errors.drift);
      put(direction, errors.direction);
      put(largest, errors.largest);
      put(steep, errors.steep);
      put(steepest, errors.steep_largest);
      put(held, run_machine(one, Law::pd, place, 8, 20).rms);
      put(around, run_machine(one, Law::now, square, 8, 0).rms);
      put(other, run_machine(one, Law::now, place, 8, 20).rms);
    }
  }
  std::printf(
      "\nField by the robot's motion, %d machines, %.0f s each: median / worst before, after\n",
      count, duration);
  for (const Column* column :
       {&drift, &direction, &largest, &steep, &steepest, &held, &around, &other})
    column->print();
  std::fflush(stdout);
}

}  // namespace vitreo::machines
