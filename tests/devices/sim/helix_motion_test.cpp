// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/helix_motion.h"

#include "control/robots.h"
#include "control/rotating_field.h"
#include "control/step_out.h"
#include "devices/sim/world.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <numbers>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

using std::chrono::milliseconds;
constexpr double kTurn = 2 * std::numbers::pi;

/// A robot in the nominal machine whose coils have neither lag nor delay, in a field without
/// gradient that turns about `axis`.
class Turned {
 public:
  explicit Turned(const std::string& robot, bool walls = false) {
    settings_.robot = control::robot_named(robot);
    settings_.placement_scatter = 0;
    settings_.wall_drag = walls;
    settings_.coils.bandwidth = 5000;
    settings_.coils.delay = 0;
    settings_.coils.noise = 0;
    world_.emplace(settings_, 1);
  }
  World& world() { return *world_; }
  const WorldSettings& settings() const { return settings_; }
  void insert(const Eigen::Vector3d& place) { world_->insert_robot(time_, place); }

  /// Returns what it went in `span` s, m.
  Eigen::Vector3d go(const Eigen::Vector3d& axis, double frequency, double field, double span) {
    const Eigen::Vector3d from = world_->robot(time_)->position;
    rotation_.turn_to(axis);
    rotation_.frequency = frequency;
    rotation_.field = field;
    const Time end = time_ + milliseconds(std::lround(span * 1e3));
    for (; time_ < end; time_ += milliseconds(1)) {
      phase_ += kTurn * frequency * 1e-3;
      const control::FieldCurrents currents =
          control::uniform_field_currents(settings_.field.matrix(world_->robot(time_)->position),
                                          control::CurrentLimits::Constant(8, 12));
      world_->set_coil_commands(time_,
                                currents * control::commanded_field(rotation_, phase_, 0, 0));
    }
    return world_->robot(time_)->position - from;
  }
  const BodyState& robot() { return *world_->robot(time_); }

 private:
  WorldSettings settings_;
  std::optional<World> world_;
  Time time_{};
  control::Rotation rotation_;
  double phase_ = 0;
};

double step_out(const Turned& turned, double field) {
  return control::step_out_frequency(turned.settings().robot, turned.settings().medium, field);
}

TEST(HelixMotion, SpeedIsLinearUpToTheStepOutAndThenWhatTheSquareRootLeaves) {
  const double field = 1e-3;
  const double advance =
      kTurn * control::helix_resistance(*control::robot_named("helix_2mm").helix, 0.485).advance();
  for (const double frequency : {3.0, 8.0, 11.0, 11.6, 14.0, 20.0}) {
    Turned turned("helix_2mm");
    turned.insert({-2e-3, 0, 0});
    turned.go(Eigen::Vector3d::UnitX(), 5, field, 1.5);
    turned.go(Eigen::Vector3d::UnitX(), frequency, field, 0.3);
    const double so = step_out(turned, field);
    // A whole number of slips, as the rest would be a part of a turn.
    const double slip = frequency > so ? 1 / std::sqrt(frequency * frequency - so * so) : 1;
    const double span = std::max(1.0, std::round(1 / slip)) * slip;
    const double speed = turned.go(Eigen::Vector3d::UnitX(), frequency, field, span).x() / span;
    EXPECT_NEAR(speed / advance, control::mean_rotation(frequency, so), 0.04 * so) << frequency;
  }
}

TEST(HelixMotion, SinksAsItsWeightOverItsDragAndTurnsIntoTheFieldsAxis) {
  Turned turned("helix_2mm");
  turned.insert({0, 0, 0});
  const Eigen::Vector3d still = turned.go(Eigen::Vector3d::UnitX(), 0, 1e-3, 1);
  const auto& settings = turned.settings();
  const double drag = control::helix_resistance(*settings.robot.helix, 0.485).across;
  EXPECT_NEAR(still.z() / (-settings.robot.net_weight(settings.medium) / drag), 1, 0.05);
  const Eigen::Vector3d axis = Eigen::Vector3d(1, 0.5, 0.5).normalized();
  turned.go(axis, 6, 1e-3, 2);
  EXPECT_GT(turned.robot().axis.dot(axis), std::cos(0.05));
}

// The lag of the axis that the loop reckons with: 2 z / (m B) while it turns fast enough.
TEST(HelixMotion, AxisFollowsTheFieldsWithTwiceTheDragOverTheTorque) {
  const double field = 2e-3;
  Turned turned("helix_2mm");
  turned.insert({0, 0, 0});
  turned.go(Eigen::Vector3d::UnitX(), 8, field, 1);
  const Eigen::Vector3d other = Eigen::Vector3d(1, 0.3, 0).normalized();
  const double before = std::acos(turned.robot().axis.dot(other));
  const auto& robot = turned.settings().robot;
  const double lag = 2 * control::rotational_resistance(robot, turned.settings().medium) /
                     (robot.moment(field) * field);
  turned.go(other, 8, field, lag);
  EXPECT_NEAR(std::acos(turned.robot().axis.dot(other)) / before, std::exp(-1.0), 0.1);
}

// Permanent sphere on the retina: it goes over it, less than it would without slip, and the faster
// the faster it turns; the way it goes is w x n.
TEST(HelixMotion, SphereRollsOverTheRetinaWithSlip) {
  Turned turned("ndfeb_sphere_500um");
  turned.insert({0, 0, -4.7e-3});
  turned.go(Eigen::Vector3d::UnitY(), 0, 2e-3, 1);
  const double slow = turned.go(Eigen::Vector3d::UnitY(), 0.05, 2e-3, 4).x() / 4;
  EXPECT_GT(slow, 0.5 * kTurn * 0.05 * 0.25e-3);
  EXPECT_LT(slow, 1.001 * kTurn * 0.05 * 0.25e-3);
  const double fast = turned.go(Eigen::Vector3d::UnitY(), 2, 2e-3, 1).x();
  EXPECT_GT(fast, slow);
  EXPECT_LT(fast, 0.5 * kTurn * 2 * 0.25e-3);
}

// A soft robot end over end. Beyond its step-out, which is that of its anisotropy, it turns on the
// mean by what the square root leaves.
TEST(HelixMotion, SoftRobotStepsOutWhereItsAnisotropyIsTooWeak) {
  const double field = 8e-3;
  for (const double part : {0.5, 0.9, 1.3, 2.0}) {
    Turned turned("coni_2mm");
    turned.insert({0, 0, 3e-3});
    turned.go(Eigen::Vector3d::UnitY(), 0, field, 0.3);
    const double so = step_out(turned, field), frequency = part * so;
    double angle = 0, span = 0;
    Eigen::Vector3d before = turned.robot().axis;
    for (int k = 0; k < 1000; ++k) {
      turned.go(Eigen::Vector3d::UnitY(), frequency, field, 2e-3);
      const Eigen::Vector3d now = turned.robot().axis;
      angle += std::asin(before.cross(now).y());
      span += 2e-3;
      before = now;
    }
    EXPECT_NEAR(angle / kTurn / span, control::mean_rotation(frequency, so), 0.07 * so) << part;
  }
}

TEST(HelixMotion, SoftRobotTumblesOverTheRetina) {
  Turned turned("coni_2mm", true);
  turned.insert({0, 0, -4.5e-3});
  turned.go(Eigen::Vector3d::UnitY(), 0, 8e-3, 0.5);
  // A turn without slip would be 5 mm; friction allows it at this rate about half.
  EXPECT_GT(turned.go(Eigen::Vector3d::UnitY(), 0.05, 8e-3, 10).x(), 0.5e-3);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
