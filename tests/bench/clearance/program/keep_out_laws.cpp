// Benchmark of two forms of the keep-out margin, the projection (control/keep_out) and a predictive
// program, on a plant that is not the model: perturbed coils, a moment and a drag that are off,
// later coils than believed, a dead coil, a flow towards the retina. Usage: keep_out_laws [first]
// [machines]
// SPDX-License-Identifier: Apache-2.0
#include "control/allocation.h"
#include "control/box_allocation.h"
#include "control/robots.h"
#include "control/servo_law.h"
#include "control/trajectory.h"
#include "tests/bench/clearance/predictive.h"
#include "tests/control/surface_samples.h"

#include <Eigen/LU>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <random>
#include <string>
#include <vector>

namespace vitreo::approaches {
namespace {

using control::Currents;

enum class Form { none, projection, predictive };

struct Case {
  std::string name;
  double late = 0;  // s, of the coils beyond what is believed
  double drag = 1;  // true over believed
  double moment = 1;
  double flow = 0;    // m/s, towards the retina
  int dead = 0;       // a coil, from 1, that the loop does not know of
  double limit = 12;  // A
  double heat = 0;    // K, of the coils over ambient
};

struct Outcome {
  double least = 1;  // m, true clearance
  double time = 0;   // s, until within 50 um of the margin; 1e9: never
  double end = 0;    // m, true clearance of the last second, mean
  double cost = 0;   // s a call
  double violation = 0;
};

constexpr double kStep = 1e-3;
constexpr double kPeriod = 1 / 15.0;
constexpr double kMargin = 0.3e-3;

class Loop {
 public:
  Loop(const Case& one, Form form, std::uint64_t seed)
      : one_(one), form_(form), random_(seed), truth_(model_.perturbed({}, random_)) {
    moment_error_ = one.moment * (1 + 0.05 * normal_(random_));
    identity_.measurement_latency = 0.08;
    identity_.drag = drag_(0, 0);
    identity_.weight = robot_.net_weight(medium_);
  }

  /// Down from 2 mm over the retina at 1 mm/s, to a reference 1 mm inside of it.
  Outcome run() {
    const control::Trajectory path =
        control::Trajectory::line({0.5e-3, 0, -2.5e-3}, {0.5e-3, 0, -5.5e-3}, {1e-3, 5e-3});
    const control::ServoTuning tuning = control::tune(identity_);
    control::PositionEstimator estimator(tuning.estimator);
    position_ = path.at(0).position;
    Outcome outcome;
    outcome.time = 1e9;
    double next = 0;
    double last_second = 0;
    int last_count = 0;
    std::deque<control::PositionMeasurement> coming;
    constexpr double kSettle = 3;
    constexpr double kEnd = 14;
    for (double t = 0; t < kEnd; t += kStep) {
      if (t >= next) {
        coming.push_back({t, position_, 1.8e-11 * Eigen::Matrix3d::Identity()});
        for (double& x : coming.back().position) x += 4.3e-6 * normal_(random_);
        next += kPeriod;
      }
      if (!coming.empty() && t >= coming.front().time + 0.08) {
        estimator.measure(coming.front());
        coming.pop_front();
        servo(t, t < kSettle ? control::Trajectory::hold_at(path.at(0).position) : path,
              t < kSettle ? 0 : kSettle, tuning, estimator);
      }
      advance(t);
      const double clear = clearance_of_truth();
      if (t > kSettle) outcome.least = std::min(outcome.least, clear);
      if (outcome.time > 1e8 && t > kSettle && clear < kMargin + 50e-6) outcome.time = t - kSettle;
      if (clear < 3e-6) return outcome;
      if (t > kEnd - 1) last_second += clear, ++last_count;
    }
    outcome.end = last_second / last_count;
    outcome.cost = calls_ > 0 ? spent_ / calls_ : 0;
    outcome.violation = violation_;
    return outcome;
  }

 private:
  double clearance_of_truth() const {
    return samples::least_distance({}, body_, position_, {1, 0, 0}).nearest();
  }

  void servo(double t, const control::Trajectory& path, double begin,
             const control::ServoTuning& tuning, control::PositionEstimator& estimator) {
    const auto now = estimator.at(t);
    if (!now) return;
    const double then = t + std::max(0.0, tuning.horizon + now->delay);
    const auto ahead = estimator.at(then);
    if (!ahead) return;
    control::Reference reference = path.at(then - begin);
    reference.velocity = (path.at(then - begin + kPeriod).position - reference.position) / kPeriod;
    changes_.reference_speed =
        std::max(reference.velocity.norm(), changes_.reference_speed * std::exp(-kPeriod / 0.92));
    changes_.command = (ahead->commanded - commanded_).norm();
    commanded_ = ahead->commanded;
    const control::ServoSchedule planned = control::schedule(tuning, *ahead, changes_);
    estimator.set_disturbance_walk(planned.disturbance_walk);
    const control::ServoGains gains{planned.proportional, tuning.gains.max_speed};
    const Eigen::Vector3d wanted = control::servo_velocity(gains, reference, *ahead);
    const Eigen::Vector3d velocity = limited(*ahead, wanted);
    estimator.command(t, command(t, ahead->position, velocity));
  }

  Eigen::Vector3d limited(const control::PositionEstimate& ahead, const Eigen::Vector3d& wanted) {
    if (form_ == Form::none) return wanted;
    control::UncertainPose pose{
        ahead.position, ahead.covariance.topLeftCorner<3, 3>(), {1, 0, 0}, 0.08};
    const auto began = std::chrono::steady_clock::now();
    const control::Clearance clearance = control::clearance(surface_, {}, pose);
    const double response = 1 + ahead.gain;
    Eigen::Vector3d velocity = wanted;
    if (form_ == Form::projection) {
      control::KeepOut settings;
      settings.margin = kMargin;
      settings.rate = 0.25 / identity_.dead_time();
      velocity =
          (control::keep_out(settings, clearance, ahead.disturbance + response * wanted).velocity -
           ahead.disturbance) /
          response;
    } else {
      PredictiveSettings settings;
      settings.margin = kMargin;
      settings.frames = 10;  // 1 / (10 frames) is the projection's rate
      settings.current = one_.limit;
      settings.temperature = one_.heat;
      const PredictiveResult found = predictive_keep_out(
          settings, clearance, wanted, ahead.disturbance, response, map_at(ahead.position));
      velocity = found.velocity;
      violation_ = std::max(violation_, found.violation);
    }
    spent_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
    ++calls_;
    return velocity;
  }

  /// By the pseudo-inverse of [B; F] = A I.
  CurrentMap map_at(const Eigen::Vector3d& where) const {
    const control::FieldMatrix matrix = model_.matrix(where);
    const Eigen::Vector3d moment(robot_.moment(kField), 0, 0);
    Eigen::Matrix<double, 6, Eigen::Dynamic> rows(6, matrix.cols());
    rows.topRows<3>() = matrix.topRows<3>() / kField;
    rows.bottomRows<3>() = control::force_from_field(moment) * matrix / identity_.weight;
    const Eigen::MatrixXd inverse = rows.completeOrthogonalDecomposition().pseudoInverse();
    Eigen::Matrix<double, 6, 1> rest;
    rest << 1, 0, 0, 0, 0, 1;
    CurrentMap map;
    map.rest = inverse * rest;
    map.slope = inverse.rightCols<3>() * drag_ / identity_.weight;
    return map;
  }

  Eigen::Vector3d command(double t, const Eigen::Vector3d& where, const Eigen::Vector3d& velocity) {
    const Eigen::Vector3d moment(robot_.moment(kField), 0, 0);
    const control::BoxAllocation got = control::allocate_within(
        model_.matrix(where), moment, {{kField, 0, 0}, {0, 0, identity_.weight}, drag_ * velocity},
        control::CurrentLimits::Constant(8, one_.limit));
    pending_.emplace_back(t + 0.05 + one_.late, got.currents);
    return drag_.inverse() * (got.force - Eigen::Vector3d(0, 0, identity_.weight));
  }

  void advance(double t) {
    while (!pending_.empty() && t >= pending_.front().first) {
      wanted_ = pending_.front().second;
      pending_.pop_front();
      if (currents_.size() == 0) currents_ = wanted_;
    }
    if (currents_.size() == 0) return;
    currents_ += (1 - std::exp(-kStep / 0.0106)) * (wanted_ - currents_);
    Currents flowing = currents_;
    if (one_.dead > 0 && t > 3) flowing[one_.dead - 1] = 0;
    const control::FieldGradient f = truth_.matrix(position_) * flowing;
    const Eigen::Vector3d b = f.head<3>();
    const Eigen::Vector3d moment = moment_error_ * robot_.moment(b.norm()) * b.normalized();
    const Eigen::Vector3d force =
        control::force_from_field(moment) * f - Eigen::Vector3d(0, 0, identity_.weight);
    position_ += kStep * (control::resistance(robot_, medium_, b).inverse() * force / one_.drag -
                          Eigen::Vector3d(0, 0, t > 3 ? one_.flow : 0));
  }

  static constexpr double kField = 10e-3;  // T
  const Case one_;
  const Form form_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  const control::Robot robot_ = control::coni_2mm();
  const control::Medium medium_;
  const control::CoilField model_ = control::CoilField::octomag();
  const control::CoilField truth_;
  const control::BodySurface surface_ = control::surface_of(robot_);
  const samples::Points body_ = samples::spheroid(1e-3, 0.5e-3, 40, 24);
  const Eigen::Matrix3d drag_ = control::resistance(robot_, medium_, Eigen::Vector3d::UnitX());
  double moment_error_ = 1;
  control::LoopIdentity identity_;
  control::ServoChanges changes_;
  Eigen::Vector3d commanded_{0, 0, 0};
  Eigen::Vector3d position_{0, 0, 0};
  std::deque<std::pair<double, Currents>> pending_;
  Currents wanted_;
  Currents currents_;
  double spent_ = 0;
  double violation_ = 0;
  int calls_ = 0;
};

void row(const Case& one, Form form, std::uint64_t first, int count) {
  std::vector<double> least;
  std::vector<double> time;
  double cost = 0;
  double end = 0;
  double violation = 0;
  int touched = 0;
  int crossed = 0;
  for (int k = 0; k < count; ++k) {
    const Outcome outcome = Loop(one, form, first + static_cast<std::uint64_t>(k)).run();
    least.push_back(outcome.least);
    time.push_back(outcome.time);
    touched += outcome.least < 3e-6 ? 1 : 0;
    crossed += outcome.least < kMargin - 50e-6 ? 1 : 0;
    end += outcome.end / count;
    cost = std::max(cost, outcome.cost);
    violation = std::max(violation, outcome.violation);
  }
  std::sort(least.begin(), least.end());
  std::sort(time.begin(), time.end());
  const char* const names[] = {"none", "projection", "predictive"};
  std::printf("| %-34s | %-10s | %3d | %3d | %.3f, %.3f | %5.2f | %.3f | %7.1f | %.2f |\n",
              one.name.c_str(), names[static_cast<int>(form)], touched, crossed,
              least.front() * 1e3, least[least.size() / 2] * 1e3,
              std::min(time[time.size() / 2], 99.0), end * 1e3, cost * 1e6, violation);
  std::fflush(stdout);
}

}  // namespace
}  // namespace vitreo::approaches

int main(int argc, char** argv) {
  using namespace vitreo::approaches;
  const std::uint64_t first = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1;
  const int count = argc > 2 ? std::atoi(argv[2]) : 20;
  std::printf(
      "| case | form | touched | crossed by 0.05 mm | least, median of the least, mm | s to the "
      "margin | end, mm | us a call | left of the constraints |\n");
  for (const Case& one :
       {Case{.name = "nominal"}, Case{.name = "coils 60 ms later", .late = 60e-3},
        Case{.name = "drag x 0.5", .drag = 0.5},
        Case{.name = "drag x 2, moment -30 %", .drag = 2, .moment = 0.7},
        Case{.name = "moment +30 %, drag x 0.5", .drag = 0.5, .moment = 1.3},
        Case{.name = "flow of 0.5 mm/s begins", .flow = 0.5e-3},
        Case{.name = "coil 1 dies", .dead = 1}, Case{.name = "coil 5 dies", .dead = 5},
        Case{.name = "5 A a coil", .limit = 5},
        Case{.name = "coils 1 K below their limit", .heat = 79}})
    for (const Form form : {Form::none, Form::projection, Form::predictive})
      row(one, form, first, count);
  return 0;
}
