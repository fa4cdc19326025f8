// Benchmark of the keep-out margin under faults, without devices: the simulator's sampled plant,
// the product's controller and a late, noisy position sensor; a fault or two of amplifiers, coils,
// sensor, latency and fluid each run. Judged by dense samples of the true surface.
// clearance_approaches runs the same through the whole host, a thousand times slower. Usage:
// faulted_machines [first] [runs] [margin in mm] [faults a run] [unwatched: without the plant
// watch]
// SPDX-License-Identifier: Apache-2.0
#include "control/robots.h"
#include "devices/sim/laboratory.h"
#include "host/servo/plant_watch.h"
#include "host/servo/robot_clearance.h"
#include "host/servo/servo_controller.h"
#include "optics/system/prescriptions.h"
#include "tests/control/surface_samples.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <map>
#include <random>
#include <string>
#include <vector>

namespace vitreo::approaches {
namespace {

constexpr Time kStep = std::chrono::milliseconds(1);
const Time kPeriod = from_seconds(1 / 15.0);
constexpr double kSettle = 3;  // s, before anything
constexpr double kEnd = 11;    // s
constexpr double kLost = 1;    // s without a measurement: zero current, as the servo's lost_timeout
constexpr double kNoise = 0.3 * 14.3e-6;  // m
constexpr double kTouch = 3e-6;           // m

enum class Kind {
  coil_open,      // one amplifier gives nothing
  coil_reversed,  // or the wrong sign
  coil_weak,      // or half
  saturated,      // all give a few amperes at most
  orders_lost,    // set-points do not arrive; the last ones stay
  orders_late,    // or later than they did
  sensor_late,    // readings later than they were
  sensor_drops,   // one of a few never comes
  sensor_frozen,  // the same place again under new times
  sensor_silent,  // nothing comes
  clock_jump,     // time stamps that are wrong
  flow,           // the fluid moves towards the retina, from the begin
  weak_robot,     // its moment is less than believed, from the begin
  count
};
const char* const kNames[] = {"coil open",     "coil reversed", "coil weak",   "saturated",
                              "orders lost",   "orders late",   "sensor late", "sensor drops",
                              "sensor frozen", "sensor silent", "clock jump",  "flow",
                              "weak robot"};

struct Fault {
  Kind kind = Kind::coil_open;
  double begin = 0;  // s
  double end = 0;
  double by = 0;
  int coil = 0;
  bool at(double time) const { return time >= begin && time < end; }
};

Fault draw(std::mt19937_64& random) {
  std::uniform_real_distribution<double> part(0, 1);
  Fault fault;
  fault.kind = static_cast<Kind>(random() % static_cast<unsigned>(Kind::count));
  fault.begin = kSettle + 6 * part(random);
  fault.end = part(random) < 0.5 ? 1e9 : fault.begin + 0.05 + 2 * part(random);
  fault.coil = static_cast<int>(random() % 8);
  const double by = part(random);
  switch (fault.kind) {
    case Kind::saturated:
      fault.by = 1 + 5 * by;  // A
      break;
    case Kind::orders_late:
    case Kind::sensor_late:
      fault.by = 0.02 + 0.3 * by;  // s
      break;
    case Kind::sensor_drops:
      fault.by = 2 + std::floor(4 * by);
      break;
    case Kind::clock_jump:
      fault.by = 0.3 * (by - 0.5);  // s
      break;
    case Kind::flow:
    case Kind::weak_robot:
      fault.by = 0.8e-3 * by;  // m/s, towards the retina
      break;
    default:
      fault.by = by;
  }
  return fault;
}

struct Outcome {
  double least = 1;      // m, while the loop was at work
  bool touched = false;  // while it was
  bool sank = false;     // after it had let go
  bool unable = false;  // touched while the coils could not carry the robot, or gave no force asked
  std::string faults;
};

class Run {
 public:
  Run(std::uint64_t seed, double margin, int faults, bool watches)
      : random_(seed * 6364136223846793005U + 1442695040888963407U), watches_(watches) {
    upright_ = seed % 2 == 0;
    model_.eye = optics::model_eye_5_3();
    model_.robot = control::coni_2mm();
    model_.keep_out.margin = margin;
    ClearanceBelief belief;
    belief.axis = upright_ ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX();
    belief.axis_sigma = 0.08;
    belief.through_eye = false;
    surface_.emplace(model_, belief);
    settings_.law = ControlLaw::estimator;
    settings_.axis = belief.axis;
    settings_.field_max = 30e-3;
    settings_.period = to_seconds(kPeriod);
    for (int k = 0; k < faults; ++k) faults_.push_back(draw(random_));
    make_plant(seed);
  }

  Outcome run() {
    ServoController controller(model_, settings_);
    controller.keep_out(&*surface_);
    PlantWatch watch(model_);
    const Eigen::Vector3d high(0.3e-3, 0, -5e-3 + (upright_ ? 1e-3 : 0.5e-3) + 1.5e-3);
    world_->insert_robot(Time(0), high);
    // Down to 1 mm inside of the retina, at 1 mm/s: what no call would take.
    const ReferencePath path{
        control::Trajectory::line(high, high - Eigen::Vector3d(0, 0, 2.5e-3), {1e-3, 5e-3}),
        kSettle};
    Outcome outcome;
    for (const Fault& fault : faults_)
      outcome.faults += std::string(kNames[static_cast<int>(fault.kind)]) + " ";
    Time next{};
    double seen = 0;
    bool let_go = false;
    for (Time now{}; to_seconds(now) < kEnd; now += kStep) {
      const double time = to_seconds(now);
      const sim::BodyState body = *world_->robot(now);
      if (now >= next) {
        read(time, body.position);
        next += kPeriod;
      }
      if (!coming_.empty() && time >= coming_.front().first) {
        const control::PositionMeasurement measured = coming_.front().second;
        coming_.pop_front();
        if (!let_go) {
          const ControlStep step = controller.step(time, measured, path, ControlMode::follow);
          if (!step.passed_over) seen = time;
          if (step.currents.size() > 0) order(time, step.currents);
          let_go = watches_ && doubts(watch, time, measured, step, controller);
          if (let_go) order(time, control::Currents::Zero(8));
        }
      }
      if (!let_go && time - seen > kLost) {
        let_go = true;
        order(time, control::Currents::Zero(8));
      }
      give(now);
      judge(time, body, let_go, outcome);
      if (outcome.touched || outcome.sank) break;
    }
    return outcome;
  }

 private:
  void make_plant(std::uint64_t seed) {
    sim::LaboratorySettings laboratory;
    laboratory.world.robot = model_.robot;
    laboratory.world.cavity.radius = model_.eye.surfaces.front().radius;
    laboratory.world.cavity.lens_depth = model_.eye.vertex(2);
    laboratory.world.placement_scatter = 0;
    laboratory.sigmas = sim::PlantSigmas::stated();
    sim::add_stated_truth(laboratory.world.coils);
    sim::WorldSettings world = sim::sampled_world(laboratory, seed);
    const sim::PlantSample drawn = sim::sample_plant(laboratory.sigmas, seed);
    const double size = drawn.size;
    latency_ = sim::sampled_latency(drawn, 0.08);
    // The eye stands where the loop does not know it to be.
    world.cavity.vertex += drawn.eye;
    eye_.vertex += drawn.eye;
    for (const Fault& fault : faults_)
      if (fault.kind == Kind::flow)
        world.flow.z() -= fault.by;
      else if (fault.kind == Kind::weak_robot)
        world.moment_gain *= 1 - 250 * fault.by;
    body_ =
        samples::spheroid(model_.robot.semi_axis * size, model_.robot.semi_radius * size, 90, 48);
    world_.emplace(world, sim::seed_for(seed, sim::Purpose::world));
  }

  /// As the servo loop's watch_plant: whether what the robot does says that coils or view fail.
  bool doubts(PlantWatch& watch, double time, const control::PositionMeasurement& measured,
              const ControlStep& step, const ServoController& controller) const {
    constexpr double kFree = 0.3e-3;  // m: nearer a wall may hold it, as there
    if (surface_->at(measured.position)->nearest().distance <= kFree)
      watch.forget();
    else
      watch.measured({measured.time, measured.position, measured.covariance},
                     step.estimate ? step.estimate->delay : 0);
    watch.commanded(time, told_, controller.drag_at(measured.position).inverse());
    return !watch.fault().empty() || watch.standing();
  }

  const Fault* active(Kind kind, double time) const {
    for (const Fault& fault : faults_)
      if (fault.kind == kind && fault.at(time)) return &fault;
    return nullptr;
  }

  /// A reading of the sensor, on its way.
  void read(double time, const Eigen::Vector3d& place) {
    ++readings_;
    const Fault* const frozen = active(Kind::sensor_frozen, time);
    if (frozen == nullptr) shown_ = place;
    if (active(Kind::sensor_silent, time) != nullptr) return;
    const Fault* const drops = active(Kind::sensor_drops, time);
    if (drops != nullptr && readings_ % static_cast<int>(drops->by) == 0) return;
    const Fault* const late = active(Kind::sensor_late, time);
    const Fault* const jump = active(Kind::clock_jump, time);
    control::PositionMeasurement measured{time + (jump != nullptr ? jump->by : 0), shown_,
                                          kNoise * kNoise * Eigen::Matrix3d::Identity()};
    for (double& x : measured.position) x += kNoise * normal_(random_);
    const double due = time + latency_ + (late != nullptr ? late->by : 0);
    coming_.emplace_back(std::max(due, coming_.empty() ? 0 : coming_.back().first), measured);
  }

  void order(double time, const control::Currents& currents) {
    told_ = currents;
    if (active(Kind::orders_lost, time) != nullptr) return;
    const Fault* const late = active(Kind::orders_late, time);
    orders_.emplace_back(time + (late != nullptr ? late->by : 0), currents);
  }

  /// What the amplifiers make of the newest order.
  void give(Time now) {
    const double time = to_seconds(now);
    while (!orders_.empty() && time >= orders_.front().first) {
      set_ = orders_.front().second;
      orders_.pop_front();
    }
    if (set_.size() == 0) return;
    control::Currents given = set_;
    for (const Fault& fault : faults_) {
      if (!fault.at(time)) continue;
      if (fault.kind == Kind::coil_open) given[fault.coil] = 0;
      if (fault.kind == Kind::coil_reversed) given[fault.coil] *= -1;
      if (fault.kind == Kind::coil_weak) given[fault.coil] *= 0.5;
      if (fault.kind == Kind::saturated)
        given = given.cwiseMax(-fault.by).cwiseMin(fault.by).eval();
    }
    obeyed_ = (given - told_).norm() < 0.5;
    if (given_.size() == given.size() && given == given_) return;
    given_ = given;
    world_->set_coil_commands(now, given);
  }

  void judge(double time, const sim::BodyState& body, bool let_go, Outcome& outcome) {
    if (time < kSettle || ++judged_ % 5 != 0) return;
    const double clear = samples::least_distance(eye_, body_, body.position, body.axis).nearest();
    if (!let_go) outcome.least = std::min(outcome.least, clear);
    if (clear > kTouch) return;
    outcome.sank = let_go;
    outcome.touched = !let_go;
    outcome.unable = !let_go && !obeyed_;
  }

  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  bool watches_ = true;
  bool upright_ = false;
  RigModel model_;
  ControllerSettings settings_;
  std::optional<RobotClearance> surface_;
  std::vector<Fault> faults_;
  std::optional<sim::World> world_;
  samples::Points body_;
  samples::Eye eye_;
  double latency_ = 0.08;
  std::deque<std::pair<double, control::PositionMeasurement>> coming_;
  std::deque<std::pair<double, control::Currents>> orders_;
  control::Currents told_ = control::Currents::Zero(8);
  control::Currents set_;
  control::Currents given_;
  Eigen::Vector3d shown_{0, 0, 0};
  int readings_ = 0;
  int judged_ = 0;
  bool obeyed_ = true;
};

void study(std::uint64_t first, int count, double margin, int faults, bool watches) {
  int touched = 0;
  int unable = 0;
  int sank = 0;
  int threw = 0;
  std::vector<double> least;
  std::map<std::string, int> by;
  for (int k = 0; k < count; ++k) {
    const std::uint64_t seed = first + static_cast<std::uint64_t>(k);
    try {
      const Outcome one = Run(seed, margin, faults, watches).run();
      touched += one.touched && !one.unable ? 1 : 0;
      unable += one.unable ? 1 : 0;
      sank += one.sank ? 1 : 0;
      least.push_back(one.least);
      if (one.touched) ++by[one.faults + (one.unable ? "(not obeyed)" : "")];
      if (one.sank) ++by[one.faults + "(after the loop had let go)"];
    } catch (const std::exception& error) {
      ++threw;
      ++by[error.what()];
    }
  }
  std::sort(least.begin(), least.end());
  std::printf(
      "seeds %llu to %llu, margin %.2f mm, %d faults a run: touched while the coils did what they "
      "were told %d, while they did not %d; sank after the loop had let go %d; threw %d; least "
      "while at work %.3f mm, 1 %% %.3f, median %.3f\n",
      static_cast<unsigned long long>(first),
      static_cast<unsigned long long>(first) + static_cast<unsigned long long>(count) - 1,
      margin * 1e3, faults, touched, unable, sank, threw, least.front() * 1e3,
      least[least.size() / 100] * 1e3, least[least.size() / 2] * 1e3);
  for (const auto& [what, times] : by) std::printf("  %4d %s\n", times, what.c_str());
  std::fflush(stdout);
}

}  // namespace
}  // namespace vitreo::approaches

int main(int argc, char** argv) {
  const std::uint64_t first = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1;
  const int count = argc > 2 ? std::atoi(argv[2]) : 100;
  const double margin = argc > 3 ? std::atof(argv[3]) * 1e-3 : 0.3e-3;
  const int faults = argc > 4 ? std::atoi(argv[4]) : 1;
  const bool watches = argc <= 5 || std::string(argv[5]) != "unwatched";
  vitreo::approaches::study(first, count, margin, faults, watches);
  return 0;
}
