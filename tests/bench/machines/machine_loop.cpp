// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/machine_loop.h"

#include "control/robots.h"
#include "control/stability.h"
#include "host/servo/field_allocator.h"
#include "optics/system/prescriptions.h"
#include "tests/bench/machines/law_before.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <random>

namespace vitreo::machines {

RigModel believed(const MachineSetting& setting) {
  RigModel model;
  model.eye = optics::model_eye_5_3();
  model.robot = control::robot_named(setting.robot);
  model.robot.drag_along = setting.belief.drag_along;
  model.robot.drag_across = setting.belief.drag_across;
  model.robot.moment_factor = setting.belief.moment;
  model.command_delay = setting.belief.delay;
  if (setting.belief.field) model.field = *setting.belief.field;
  return model;
}

sim::WorldSettings plant(const MachineSetting& setting, const RigModel& model) {
  sim::LaboratorySettings laboratory;
  sim::WorldSettings& world = laboratory.world;
  world.robot = control::robot_named(setting.robot);
  world.cavity.vertex = model.eye_in_world;
  world.cavity.radius = model.eye.surfaces.front().radius;
  world.cavity.lens_depth = model.eye.vertex(2);
  world.wall_drag = setting.walls;
  world.placement_scatter = 0;
  world.coils.dead = setting.dead;
  if (setting.drawn) {
    laboratory.sigmas = sim::PlantSigmas::stated();
    sim::add_stated_truth(world.coils);
  }
  const Mistake& mistake = setting.mistake;
  world.medium.kinematic_viscosity *= mistake.drag;
  world.robot.solid_density *= mistake.mass;
  world.moment_gain *= mistake.moment;
  sim::WorldSettings sampled = sim::sampled_world(laboratory, setting.seed);
  sampled.coils.delay = std::max(0.0, sampled.coils.delay + mistake.delay);
  return sampled;
}

double latency_of(const MachineSetting& setting) {
  if (!setting.drawn) return setting.latency;
  return sim::sampled_latency(sim::sample_plant(sim::PlantSigmas::stated(), setting.seed),
                              setting.latency);
}

ControllerSettings settings_of(const MachineSetting& setting, ControlLaw law) {
  ControllerSettings settings;
  settings.law = law;
  settings.field = setting.field;
  settings.field_max = setting.field_max;
  settings.axis = setting.axis;
  settings.period = 1 / setting.frame_rate;
  settings.wall_drag = setting.walls && setting.walls_believed;
  settings.tone = setting.tone;
  if (setting.proportional > 0) {
    settings.proportional = setting.proportional;
    settings.gains.proportional = setting.proportional;
  }
  if (setting.dead_known)
    for (const int coil : setting.dead) settings.limits[coil - 1] = 0;
  return settings;
}

namespace {

constexpr Time kStep = std::chrono::milliseconds(1);

/// Currents for a measurement or for its absence.
class Controller {
 public:
  virtual ~Controller() = default;
  virtual ControlStep step(double now, const control::PositionMeasurement& measured,
                           const ReferencePath& path) = 0;
  virtual const control::PositionEstimator* estimator() const { return nullptr; }
  virtual std::optional<ServoMargins> margins() const { return std::nullopt; }
  virtual void set_axis(const Eigen::Vector3d&) {}
};

class ProductsController final : public Controller {
 public:
  ProductsController(const RigModel& model, const MachineSetting& setting, ControlLaw law)
      : controller_(model, settings_of(setting, law)) {}
  ControlStep step(double now, const control::PositionMeasurement& measured,
                   const ReferencePath& path) override {
    return controller_.step(now, measured, path, ControlMode::follow);
  }
  const control::PositionEstimator* estimator() const override { return controller_.estimator(); }
  std::optional<ServoMargins> margins() const override { return controller_.margins(); }
  void set_axis(const Eigen::Vector3d& axis) override { controller_.set_axis(axis); }

 private:
  ServoController controller_;
};

/// The law before, coupled as ServoController coupled it: free drag, one cap of 2 mm/s.
class ControllerBefore final : public Controller {
 public:
  ControllerBefore(const RigModel& model, const MachineSetting& setting)
      : settings_(settings_of(setting, ControlLaw::estimator)),
        model_(model),
        allocator_(model_, {settings_.field, settings_.field, settings_.axis, settings_.limits,
                            settings_.total_limit}),
        drag_(control::resistance(model.robot, model.medium, setting.axis)) {}
  ControlStep step(double now, const control::PositionMeasurement& measured,
                   const ReferencePath& path) override {
    if (!estimator_) tune(now, measured);
    estimator_->measure(measured);
    ControlStep step;
    const double then = now + tuning_.horizon;
    const auto ahead = estimator_->at(then);
    if (!ahead) return step;
    const Eigen::Vector3d velocity = control::before::servo_velocity(
        tuning_.gains, control::held_reference(path, then, settings_.period), *ahead);
    const FieldAllocation found = allocator_.allocate(ahead->position, drag_ * velocity);
    step.currents = found.currents;
    step.limited = found.limited;
    step.headroom = found.headroom;
    estimator_->command(now, drag_.inverse() * found.force);
    return step;
  }

 private:
  void tune(double now, const control::PositionMeasurement& first) {
    control::before::LoopIdentity loop;
    loop.measurement_latency = now - first.time;
    loop.command_delay = model_.command_delay;
    loop.command_lag = 1 / (2 * M_PI * model_.command_bandwidth);
    loop.period = settings_.period;
    loop.noise = std::sqrt(first.covariance.trace() / 3);
    loop.drag = drag_.diagonal().minCoeff();
    loop.force_limit = 2e-3 * loop.drag;
    const auto held = allocator_.allocate(Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
    loop.instability = std::max(0.0, control::instability(model_.field, model_.robot, model_.medium,
                                                          held.currents, Eigen::Vector3d::Zero()));
    tuning_ = control::before::tune(loop);
    estimator_.emplace(tuning_.estimator);
  }

  ControllerSettings settings_;
  const RigModel& model_;
  FieldAllocator allocator_;
  Eigen::Matrix3d drag_;
  control::before::ServoTuning tuning_;
  std::optional<control::before::PositionEstimator> estimator_;
};

std::unique_ptr<Controller> controller_of(const RigModel& model, const MachineSetting& setting,
                                          Law law) {
  if (law == Law::before) return std::make_unique<ControllerBefore>(model, setting);
  return std::make_unique<ProductsController>(
      model, setting, law == Law::pd ? ControlLaw::pd : ControlLaw::estimator);
}

/// Sums of what a run is judged by.
struct Judge {
  double squares = 0;
  double largest = 0;
  std::int64_t count = 0;
  double consistency = 0;
  double innovation = 0;
  Eigen::Vector3d products = Eigen::Vector3d::Zero();
  Eigen::Vector3d powers = Eigen::Vector3d::Zero();
  Eigen::Vector3d last = Eigen::Vector3d::Zero();  // innovation
  int steps = 0;
  int limited = 0;
  double headroom = 1;

  void error(double off) {
    squares += off * off;
    largest = std::max(largest, off);
    ++count;
  }
  void step(const ControlStep& step, const control::PositionEstimator* estimator,
            const Eigen::Vector3d& truth) {
    ++steps;
    limited += step.limited ? 1 : 0;
    headroom = std::min(headroom, step.headroom);
    if (!step.estimate || estimator == nullptr || !estimator->innovation()) return;
    const Eigen::Vector3d wrong = truth - step.estimate->position;
    consistency +=
        wrong.dot(step.estimate->covariance.topLeftCorner<3, 3>().llt().solve(wrong)) / 3;
    innovation += estimator->innovation()->normalized / 3;
    const Eigen::Vector3d& value = estimator->innovation()->value;
    products += value.cwiseProduct(last);
    powers += value.cwiseProduct(value);
    last = value;
  }
};

/// The commanded axis: MachineSetting::turning.
class TurningAxis {
 public:
  TurningAxis(const MachineSetting& setting, double begin)
      : speed_(setting.turning),
        next_(begin),
        axis_(setting.axis),
        target_(setting.axis),
        random_(sim::seed_for(setting.seed, sim::Purpose::probe) + 1) {}
  Eigen::Vector3d after(double time, double span) {
    if (time >= next_) {
      std::uniform_real_distribution<double> azimuth(-M_PI, M_PI), pitch(-M_PI / 3, M_PI / 3);
      const double a = azimuth(random_), p = pitch(random_);
      target_ = {std::cos(p) * std::cos(a), std::cos(p) * std::sin(a), std::sin(p)};
      next_ += 10;
    }
    const Eigen::Vector3d across = axis_.cross(target_);
    const double left = std::atan2(across.norm(), axis_.dot(target_));
    if (left > 1e-6)
      axis_ = Eigen::AngleAxisd(std::min(left, speed_ * span), across.normalized()) * axis_;
    return axis_;
  }

 private:
  double speed_;
  double next_;  // s
  Eigen::Vector3d axis_;
  Eigen::Vector3d target_;
  std::mt19937_64 random_;
};

/// Swings of the true place, ten seconds each (MachineResult::swings).
class Swings {
 public:
  void add(double time, const Eigen::Vector3d& place) {
    if (time >= end_) close();
    sum_ += place;
    squares_ += place.cwiseAbs2();
    ++count_;
  }
  std::vector<double> found;

 private:
  void close() {
    const Eigen::Vector3d mean = sum_ / count_;
    const double variance = (squares_ / count_ - mean.cwiseAbs2()).maxCoeff();
    found.push_back(std::sqrt(2 * std::max(0.0, variance)));
    end_ += 10;
    count_ = 0;
    sum_ = squares_ = Eigen::Vector3d::Zero();
  }
  double end_ = 10;  // s
  double count_ = 0;
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d squares_ = Eigen::Vector3d::Zero();
};

control::Currents flowing(const CoilFault& fault, double time, control::Currents commands) {
  if (fault.coil > 0 && time >= fault.time) commands[fault.coil - 1] *= fault.part;
  return commands;
}

}  // namespace

void note_quality(MachineResult& result, LoopQuality& before, const LoopQuality& now, double time) {
  const auto note = [&](bool is, bool was, double& first) {
    if (!is || was) return;
    ++result.alarms;
    if (first < 0) first = time;
  };
  note(now.oscillating, before.oscillating, result.oscillation);
  if (now.oscillating) result.swing = std::max(result.swing, now.amplitude);
  note(now.standing, before.standing, result.standstill);
  note(now.weak_coil != 0, before.weak_coil == now.weak_coil, result.weak);
  if (now.weak_coil != 0 && result.weak_coil == 0) result.weak_coil = now.weak_coil;
  double ignored = -1;
  note(now.capped, before.capped, ignored);
  note(now.clamped, before.clamped, ignored);
  before = now;
}

MachineResult run_machine(const MachineSetting& setting, Law law, const control::Trajectory& path,
                          double settle, double after) {
  const RigModel model = believed(setting);
  sim::World world(plant(setting, model), sim::seed_for(setting.seed, sim::Purpose::world));
  const std::unique_ptr<Controller> controller = controller_of(model, setting, law);
  std::mt19937_64 random(sim::seed_for(setting.seed, sim::Purpose::probe));
  std::normal_distribution<double> normal;
  const ReferencePath reference{path, settle};
  const Time latency = from_seconds(latency_of(setting));
  const Time period = from_seconds(1 / setting.frame_rate);
  const Time end = from_seconds(settle + path.duration() + after);
  world.insert_robot(Time(0), path.at(0).position);
  std::deque<control::PositionMeasurement> coming;
  Time next{};
  double margins_due = settle + 1;
  Judge judge;
  Swings swings;
  TurningAxis axis(setting, settle);
  LoopQuality quality;
  MachineResult result;
  const Eigen::Matrix3d covariance = setting.noise * setting.noise * Eigen::Matrix3d::Identity();
  try {
    for (Time now{}; now < end; now += kStep) {
      const double seconds = to_seconds(now);
      const sim::BodyState body = *world.robot(now);
      const Eigen::Vector3d& place = body.position;
      swings.add(seconds, place);
      if (now >= next) {
        control::PositionMeasurement measured{seconds, place, covariance};
        const double sense = body.axis.dot(setting.axis) < 0 ? -1 : 1;
        measured.position.z() -= setting.view_lever * (sense * body.axis.z() - setting.axis.z());
        for (double& coordinate : measured.position) coordinate += setting.noise * normal(random);
        coming.push_back(measured);
        next += period;
      }
      if (!coming.empty() && now >= from_seconds(coming.front().time) + latency) {
        if (setting.turning > 0 && seconds > settle)
          controller->set_axis(axis.after(seconds, to_seconds(period)));
        const ControlStep step = controller->step(seconds, coming.front(), reference);
        coming.pop_front();
        if (step.currents.size() > 0)
          world.set_coil_commands(now, flowing(setting.fault, seconds, step.currents));
        note_quality(result, quality, step.quality, seconds);
        result.oscillating += step.quality.oscillating ? to_seconds(period) : 0;
        if (seconds >= margins_due) {
          margins_due += 3;
          if (const auto found = controller->margins()) {
            result.gain_margin = std::min(result.gain_margin, found->margins.gain_up);
            result.delay_margin = std::min(result.delay_margin, found->margins.delay_more);
          }
        }
        if (seconds >= settle) judge.step(step, controller->estimator(), place);
        if (step.estimate) {
          result.gain = step.estimate->gain;
          result.delay = step.estimate->delay;
        }
      }
      if (seconds >= settle) judge.error((place - reference.at(seconds).position).norm());
    }
  } catch (const std::exception& error) {
    result.failure = error.what();
  }
  const double count = std::max<double>(1, static_cast<double>(judge.count));
  const double steps = std::max(1, judge.steps);
  result.rms = std::sqrt(judge.squares / count);
  result.largest = judge.largest;
  result.consistency = judge.consistency / steps;
  result.innovation = judge.innovation / steps;
  if (judge.powers.minCoeff() > 0)
    result.correlation = judge.products.cwiseQuotient(judge.powers).mean();
  result.limited = judge.limited / steps;
  result.headroom = judge.headroom;
  result.swings = std::move(swings.found);
  return result;
}

}  // namespace vitreo::machines
