// Bench of the loop's calculations: field, allocation, estimate, law, and one tick of all of them.
// SPDX-License-Identifier: Apache-2.0
#include "control/allocation.h"
#include "control/box_allocation.h"
#include "control/coil_watch.h"
#include "control/multipole_field.h"
#include "control/pd.h"
#include "control/robot.h"
#include "control/servo_law.h"
#include "control/trajectory.h"

#include <benchmark/benchmark.h>

#include <random>
#include <stdexcept>
#include <vector>

namespace {

using namespace vitreo::control;

void field_matrix(benchmark::State& state) {
  const CoilField field = CoilField::octomag();
  Eigen::Vector3d p(1e-3, 2e-3, -1e-3);
  for (auto _ : state) {
    benchmark::DoNotOptimize(p);
    benchmark::DoNotOptimize(field.matrix(p));
  }
}
BENCHMARK(field_matrix)->Name("control/field_matrix");

// `limit` in tenths of an ampere: far away, or so low that the force is cut.
void allocation(benchmark::State& state) {
  const double limit = 0.1 * static_cast<double>(state.range(0));
  const FieldMatrix matrix = CoilField::octomag().matrix({1e-3, 2e-3, -1e-3});
  const Robot robot = coni_2mm();
  const Eigen::Vector3d field(10e-3, 0, 0);
  Eigen::Vector3d moment(robot.moment(10e-3), 0, 0);
  const FieldAndForce wanted{field, {0, 0, robot.net_weight(Medium{})}, {20e-6, 5e-6, 0}};
  for (auto _ : state) {
    benchmark::DoNotOptimize(moment);
    benchmark::DoNotOptimize(allocate(matrix, moment, wanted, limit));
  }
}
BENCHMARK(allocation)->Name("control/allocate")->Arg(1000);
BENCHMARK(allocation)->Name("control/allocate_at_limit")->Arg(50);

void pd_update(benchmark::State& state) {
  PdController control({});
  const Trajectory path = Trajectory::rectangle({-4e-3, 0, -3e-3}, {8e-3, 0, 0}, {0, 0, 6e-3}, {});
  double time = 0;
  Eigen::Vector3d p(0, 0, 0);
  for (auto _ : state) {
    time += 1e-3;
    benchmark::DoNotOptimize(p);
    benchmark::DoNotOptimize(control.update(time, p, path.at(time)));
  }
}
BENCHMARK(pd_update)->Name("control/trajectory_and_pd");

void multipole_matrix(benchmark::State& state) {
  std::vector<MultipoleField::Sources> coils;
  const CoilField octomag = CoilField::octomag();
  for (const Dipole& dipole : octomag.dipoles()) {
    const double size = dipole.moment_per_ampere.norm();
    const MultipoleSource one{dipole.position, dipole.moment_per_ampere / size, {}, {-1e-7 * size}};
    coils.emplace_back(static_cast<std::size_t>(state.range(0)), one);
  }
  const MultipoleField field(coils, {},
                             {Eigen::Vector3d::Constant(-0.01), Eigen::Vector3d::Constant(0.01)});
  Eigen::Vector3d p(1e-3, 2e-3, -1e-3);
  for (auto _ : state) {
    benchmark::DoNotOptimize(p);
    benchmark::DoNotOptimize(field.matrix(p));
  }
}
BENCHMARK(multipole_matrix)->Name("control/multipole_matrix_sources")->Arg(1)->Arg(4);

// The wrench that needs the most iterations of `draws` random ones at limits that bite.
struct HardestWrench {
  FieldMatrix matrix;
  Eigen::Vector3d moment;
  FieldAndForce wanted;
  CurrentLimits limits = CurrentLimits::Constant(8, 1);
  int iterations = 0;

  explicit HardestWrench(int draws) {
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> one(-1, 1), limit(0.5, 8);
    const CoilField octomag = CoilField::octomag();
    const Robot robot = coni_2mm();
    const auto draw = [&](double size) {
      const double x = one(random), y = one(random), z = one(random);
      return Eigen::Vector3d(size * Eigen::Vector3d(x, y, z));
    };
    for (int k = 0; k < draws; ++k) {
      const FieldMatrix field_matrix = octomag.matrix(draw(8e-3));
      const Eigen::Vector3d axis = draw(1).normalized();
      const FieldAndForce wrench{20e-3 * axis, {0, 0, robot.net_weight(Medium{})}, draw(60e-6)};
      const CurrentLimits bound = CurrentLimits::Constant(8, limit(random));
      try {
        const BoxAllocation got =
            allocate_within(field_matrix, robot.moment(20e-3) * axis, wrench, bound);
        if (got.iterations <= iterations) continue;
        iterations = got.iterations;
      } catch (const std::domain_error&) {
        continue;
      }
      matrix = field_matrix, moment = robot.moment(20e-3) * axis, wanted = wrench, limits = bound;
    }
  }
};

void box_worst(benchmark::State& state) {
  HardestWrench hardest(200000);
  for (auto _ : state) {
    benchmark::DoNotOptimize(hardest.moment);
    benchmark::DoNotOptimize(
        allocate_within(hardest.matrix, hardest.moment, hardest.wanted, hardest.limits));
  }
  state.counters["iterations"] = hardest.iterations;
}
BENCHMARK(box_worst)->Name("control/allocate_within_worst_of_200000");

void box_free(benchmark::State& state) {
  HardestWrench hardest(2000);
  hardest.limits.setConstant(1e3);
  for (auto _ : state) {
    benchmark::DoNotOptimize(hardest.moment);
    benchmark::DoNotOptimize(
        allocate_within(hardest.matrix, hardest.moment, hardest.wanted, hardest.limits));
  }
}
BENCHMARK(box_free)->Name("control/allocate_within_unconstrained");

// A frame comes in: measure, predict, law, field, the hardest allocation, command.
void tick(benchmark::State& state) {
  HardestWrench hardest(200000);
  const ServoTuning tuning = tune({});
  PositionEstimator estimator(tuning.estimator);
  const CoilField octomag = CoilField::octomag();
  const Trajectory path = Trajectory::rectangle({-4e-3, 0, -3e-3}, {8e-3, 0, 0}, {0, 0, 6e-3}, {});
  double time = 0;
  for (auto _ : state) {
    time += 1.0 / 15;
    estimator.measure({time - 0.13, {1e-5, 0, 0}, 1e-11 * Eigen::Matrix3d::Identity()});
    const auto now = estimator.at(time);
    const auto estimate = estimator.at(time + tuning.horizon + now->delay);
    const ServoSchedule planned = schedule(tuning, *estimate, {});
    estimator.set_disturbance_walk(planned.disturbance_walk);
    const Reference reference = held_reference(path, time + tuning.horizon, 1.0 / 15);
    const Eigen::Vector3d u = servo_velocity(tuning.gains, reference, *estimate);
    const FieldMatrix matrix = octomag.matrix(estimate->position);
    benchmark::DoNotOptimize(matrix);
    benchmark::DoNotOptimize(
        allocate_within(hardest.matrix, hardest.moment, hardest.wanted, hardest.limits));
    estimator.command(time, u);
  }
}
BENCHMARK(tick)->Name("control/tick");

// What the loop's watch adds to each frame that the filter used: which coil lacks its current, four
// errors a coil allowed. `dead`: coil 3 carries nothing, so that the dear form is asked for too.
void coil_watch(benchmark::State& state) {
  const bool dead = state.range(0) != 0;
  constexpr int kFrames = 4096;
  constexpr double kSpan = 1.0 / 15;
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const auto draw = [&](Eigen::Index columns, double sigma) {
    return Eigen::MatrixXd::NullaryExpr(3, columns, [&] { return sigma * normal(random); }).eval();
  };
  std::vector<CoilMotions> given(kFrames);
  std::vector<CoilTurns> turned(kFrames);
  std::vector<Innovation> innovations(kFrames);
  for (int i = 0; i < kFrames; ++i) {
    const auto at = static_cast<std::size_t>(i);
    given[at] = {draw(8, 20e-6), draw(8, 5e-6)};
    turned[at] = draw(24, 20e-6);
    innovations[at].value = draw(1, 5e-6) - (dead ? 1.0 : 0.0) * given[at].linear.col(2);
    innovations[at].covariance = 25e-12 * Eigen::Matrix3d::Identity();
  }
  EstimatorUpdate update;
  update.gain.topRows<3>() = update.gain.middleRows<3>(3) = 0.3 * Eigen::Matrix3d::Identity();
  CoilWatch watch(8);
  std::size_t i = 0;
  for (auto _ : state) {
    watch.add(innovations[i], update, kSpan, given[i], turned[i]);
    benchmark::DoNotOptimize(watch.most_suspect());
    i = (i + 1) % kFrames;
  }
}
BENCHMARK(coil_watch)->Name("control/coil_watch_dead")->Arg(0)->Arg(1);

}  // namespace
