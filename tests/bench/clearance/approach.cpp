// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/clearance/approach.h"

#include "devices/sim/bench_sample.h"
#include "host/rig/rig_settings.h"
#include "host/trials/soak_plan.h"
#include "optics/system/tolerance.h"
#include "tests/control/surface_samples.h"
#include "tests/host/rig/fake_rig.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

namespace vitreo::approaches {
namespace {

constexpr double kTouch = 3e-6;  // m: as near as samples tell
constexpr double kRed = 0.4e-3;  // m: the page's "very close"
constexpr double kGap = 1.6e-3;  // m, of the surface where an approach begins
constexpr double kPoll = 5e-3;   // s
// A, root of the sum of squares: the coils do what they are told, noise, ramps and calibration
// apart.
constexpr double kObeys = 1.0;

RigDescription rig_of(const ApproachSetting& setting) {
  RigDescription description = whole_rig();
  ConfigTable truth{{"machine", {"sampled"}}};
  // Crossed plates on end are a cross that the tracker does not take for the robot. What is drawn
  // as an ellipsoid is believed to be one, as by the rig "ellipsoid".
  if (setting.upright) {
    truth["drawn_as"] = ConfigValue{std::string("ellipsoid")};
    description.table["model"] = ConfigValue{ConfigTable{{"shape", {"ellipsoid"}}}};
  }
  if (setting.sampled_bench) {
    truth["optics"] = ConfigValue{ConfigTable{{"bench", {std::string("sampled")}}}};
    ConfigTable model;
    if (setting.upright) model["shape"] = ConfigValue{std::string("ellipsoid")};
    const ConfigTable places{{"places", {std::string(setting.told ? "by_hand" : "known")}}};
    model["uncertainty"] = ConfigValue{ConfigTable{{"bench", {places}}}};
    description.table["model"] = ConfigValue{model};
  }
  description.table["truth"] = ConfigValue{truth};
  ConfigTable keep_out{{"margin", {setting.margin}}};
  if (setting.perturbed_eye) keep_out["eye"] = ConfigValue{std::string("table_5_1")};
  description.table["keep_out"] = ConfigValue{keep_out};
  return description;
}

double named(const sim::Laboratory& laboratory, const std::string& name, double else_value) {
  for (const auto& [key, value] : laboratory.drawn())
    if (key == name) return value;
  return else_value;
}

/// Where the plant's eye stands, which is not where the loop believes it; of a bench that is drawn
/// its retina's depth and sag (thesis 4.3): r^2 / (2 R) changes by -r^2 dR / (2 R^2).
samples::Eye eye_of(const sim::Laboratory& laboratory, const ApproachSetting& setting) {
  samples::Eye eye;
  if (setting.sampled_bench) {
    const RigDescription description = rig_of(setting);
    ConfigReader reader(description);
    const sim::LaboratorySettings believed = read_rig_settings(reader).laboratory;
    const auto bench = sim::sample_bench(believed, sim::OpticsSigmas::stated(), setting.seed);
    eye.vertex.z() += bench.retina_depth;
    eye.lens += bench.axial_length - bench.retina_depth;
    // Of which the simulator takes three tenths at most.
    eye.radius -= std::clamp(2 * bench.retina_curvature * std::pow(eye.radius / 4e-3, 2),
                             -0.3 * eye.radius, 0.3 * eye.radius);
  }
  eye.vertex += Eigen::Vector3d(named(laboratory, "eye_x_m", 0), named(laboratory, "eye_y_m", 0),
                                named(laboratory, "eye_z_m", 0));
  return eye;
}

/// The truth beside the loop.
class Judge {
 public:
  Judge(const TestBench& bench, const ApproachSetting& setting)
      : laboratory_(*bench.rig->laboratory()),
        coils_(*bench.rig->rig().coils),
        eye_(eye_of(laboratory_, setting)) {
    const control::Robot& robot = bench.rig->rig().model.robot;
    const double size = named(laboratory_, "size_factor", 1);
    half_ = (setting.upright ? robot.semi_axis : robot.semi_radius) * size;
    body_ = samples::spheroid(robot.semi_axis * size, robot.semi_radius * size, 120, 60);
  }
  double clearance_at(Time time) const {
    const auto truth = laboratory_.truth(time);
    if (!truth) return 1;
    return samples::least_distance(eye_, body_, truth->position, truth->axis).nearest();
  }
  /// The currents that flow are those that were set a little while ago: nothing holds them up, cuts
  /// them off, or zeroed them.
  bool obeyed(Time now) {
    const sim::CoilTruth coils = laboratory_.coils(now);
    set_.push_back({now, coils.set_points});
    while (set_.size() > 2 && set_.front().first < now - std::chrono::milliseconds(150))
      set_.erase(set_.begin());
    double least = 1e9;
    for (const auto& [time, currents] : set_)
      least = std::min(least, (coils.currents - currents).norm());
    const std::vector<double> told = coils_.currents();
    const Eigen::Map<const Eigen::VectorXd> wanted(told.data(),
                                                   static_cast<Eigen::Index>(told.size()));
    return coils_.energized() && least < kObeys && (wanted - set_.back().second).norm() < kObeys;
  }
  double half() const { return half_; }

 private:
  sim::Laboratory& laboratory_;
  const Interlock& coils_;
  const samples::Eye eye_;
  samples::Points body_;
  double half_ = 0;  // m, downwards
  std::vector<std::pair<Time, control::Currents>> set_;
};

ServoSettings settings_of(const ApproachSetting& setting) {
  ServoSettings settings;
  settings.feedback = setting.feedback;
  settings.law = setting.law;
  if (setting.upright) settings.axis = {0, 0, 1};
  return settings;
}

void perturb_eye(const TestBench& bench, std::uint64_t seed) {
  std::mt19937_64 random(seed * 7919 + 3);
  const optics::Prescription eye = optics::prescription("model_eye_5_3");
  bench.rig->rig().simulation->set_eye(
      optics::monte_carlo(eye, optics::applicable(optics::table_5_1(), eye), 1, random)[0]
          .prescription.system);
}

/// The deepest place over (x, y) that the loop takes, to 5 um.
Eigen::Vector3d deepest(const RigModel& model, const ServoSettings& settings, double x) {
  const RobotClearance surface(model, settings.clearance_belief());
  double above = 0;
  double below = -5e-3;
  while (above - below > 5e-6) {
    const double middle = (above + below) / 2;
    try {
      surface.check(control::Trajectory::hold_at({x, 0, middle}));
      above = middle;
    } catch (const std::invalid_argument&) {
      below = middle;
    }
  }
  return {x, 0, above};
}

/// The soak's plans of coils and sensor, and amplifiers that are cut off.
class Faults {
 public:
  Faults(TestBench& bench, const ApproachSetting& setting, double horizon)
      : injector_({*bench.clock, bench.rig->laboratory(), *bench.recorder, bench.session->control,
                   disk_,
                   simulated_roles(nlohmann::json{
                       {"coils", {{"driver", "usb3103"}}},
                       {setting.feedback == Feedback::pose_sensor ? "pose_sensor" : "top_camera",
                        {{"driver", "simulated"}}}})}) {
    for (std::uint64_t draw = 0; count_ < setting.faults; ++draw)
      for (const Fault& fault :
           draw_plan(setting.seed * 131 + draw * 1000003, roles(setting), horizon).faults) {
        if (count_ >= setting.faults || fault.role == "disk" || fault.kind == "slow") continue;
        injector_.add(fault);
        plan_ += (plan_.empty() ? "" : "; ") + to_string(fault);
        ++count_;
      }
  }
  const std::string& plan() const { return plan_; }

 private:
  static SimulatedRoles roles(const ApproachSetting& setting) {
    return {{"coils", {true, false}},
            {setting.feedback == Feedback::pose_sensor ? "pose_sensor" : "top_camera", {}}};
  }
  DiskFaults disk_;
  FaultInjector injector_;
  std::string plan_;
  int count_ = 0;
};

/// Until `end`, or until the loop has ended and the robot had time to sink.
void watch(TestBench& bench, const Servo& servo, Judge& judge, Time end, ApproachResult& result) {
  Time shown{};
  bool red = false;
  std::vector<double> below;
  for (Time now = bench.clock->now(); now < end; now = bench.clock->now()) {
    bench.clock->sleep_for(from_seconds(kPoll));
    const double truth = judge.clearance_at(now);
    const ServoStatus status = servo.status();
    const bool ended = status.state == ServoState::failed || status.state == ServoState::lost;
    const bool obeyed = judge.obeyed(now) && !ended;
    result.least_true = std::min(result.least_true, truth);
    if (obeyed) result.least_driven = std::min(result.least_driven, truth);
    result.end_true = truth;
    if (truth < kTouch && !result.touched) {
      result.touched = true;
      result.driven = obeyed;
      result.ended = ended;
      result.red_first = red;
    }
    if (status.time == shown || !status.clearance) continue;
    shown = status.time;
    const control::WallClearance& wall = status.clearance->nearest();
    result.end_bound = std::max(0.0, wall.bound());
    result.uncertainty = wall.uncertainty;
    const double then = judge.clearance_at(shown);
    result.bias = wall.distance - then;
    result.excess = std::max(result.excess, result.bias / wall.uncertainty);
    below.push_back(then - wall.bound());
    red = red || result.end_bound < kRed;
    // The page shows no negative number.
    result.optimism = std::max(result.optimism, result.end_bound - then);
  }
  std::sort(below.begin(), below.end());
  if (!below.empty()) result.below = below[below.size() / 2];
  result.ending = to_string(servo.status().state);
  if (!servo.status().failure.empty()) result.ending += ": " + servo.status().failure;
}

}  // namespace

ApproachResult run_approach(const ApproachSetting& setting) {
  TestBench bench(setting.seed, {}, rig_of(setting));
  if (setting.perturbed_eye) perturb_eye(bench, setting.seed);
  ApproachResult result;
  const ServoSettings settings = settings_of(setting);
  Judge judge(bench, setting);
  bench.rig->rig().sample->remove_robot();
  const auto servo =
      std::make_unique<Servo>(*bench.clock, bench.roles(), *bench.recorder, bench.eyes(), settings);
  std::mt19937_64 random(setting.seed);
  const double aside = std::uniform_real_distribution<double>(-1.5e-3, 1.5e-3)(random);
  // What a bench that was set up by hand keeps of its retina is 0.5 mm more.
  const double gap = kGap + (setting.sampled_bench ? 0.6e-3 : 0);
  const Eigen::Vector3d begin(aside, 0, -5e-3 + judge.half() + gap);
  servo->hold(begin);
  bench.rig->rig().sample->insert_robot(begin);
  bench.clock->sleep_for(from_seconds(2));
  const Time now = bench.clock->now();
  std::optional<Faults> faults;
  if (setting.faults > 0) faults.emplace(bench, setting, 4.0);
  if (faults) result.plan = faults->plan();
  try {
    if (setting.sink) {
      servo->set_trim(servo->trim() + servo->force_for({0, 0, -0.6e-3}));
      servo->release(false, true);
    } else {
      const Eigen::Vector3d low = deepest(bench.roles().model, settings, aside);
      // Down, and along the retina at the margin.
      const Eigen::Vector3d along = deepest(bench.roles().model, settings, aside / 2);
      servo->follow(control::Trajectory::waypoints({begin, low, along}, {1e-3, 5e-3}));
    }
  } catch (const std::exception& error) {
    result.ending = error.what();
    return result;
  }
  watch(bench, *servo, judge, now + from_seconds(setting.sink ? 6 : 7), result);
  for (const Event& event : bench.recorder->events())
    if (event.kind == "alarm" && (event.text.find("margin") != std::string::npos ||
                                  event.text.find("wall") != std::string::npos))
      result.alarm = true;
  return result;
}

}  // namespace vitreo::approaches
