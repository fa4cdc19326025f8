// Plant fault: a robot's way with a failing coil, reckoned by the whole force at the currents that
// flow, has that coil named, also where it began to fail within the window; coils that pull alike
// are named together.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/plant_fault.h"

#include "control/robots.h"
#include "control/stability.h"
#include "host/rig/rig.h"
#include "host/servo/field_allocator.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kFrame = 1 / 15.0;  // s
constexpr double kNoise = 4e-6;      // m
constexpr int kFrames = 9;

struct Failing {
  int coil = 0;        // from 1; 0: all
  double carries = 0;  // of its current
  double after = 0;    // s
};

/// Where a robot that is held at the center goes in a window, over what it was told.
std::vector<LeftOver> window(const std::vector<Failing>& failing, double turned = 0) {
  RigModel model;
  model.robot = control::robot_named("coni_2mm");
  FieldAllocator allocator(model, {});
  const Eigen::Vector3d up(0, 0, model.robot.net_weight(model.medium));
  const control::Currents told = allocator.allocate({0, 0, 0}, up).currents;
  const Eigen::Matrix3d mobility =
      control::resistance(model.robot, model.medium, {1, 0, 0}).inverse();
  const PlantForces forces{model.field.matrix({0, 0, 0}), model.field.background({0, 0, 0}), up.z(),
                           mobility};
  const PlantMotions speed = plant_velocities(model.robot, forces, told);
  const auto went = [&](const control::Currents& currents) -> Eigen::Vector3d {
    return mobility *
           control::force_at(model.field, model.robot, model.medium, currents, {0, 0, 0});
  };
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal(0, kNoise);
  std::vector<LeftOver> path;
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(turned, Eigen::Vector3d::UnitX()).toRotationMatrix();
  for (int frame = 0; frame < kFrames; ++frame) {
    const double time = frame * kFrame;
    Eigen::Vector3d left(normal(random), normal(random), normal(random));
    for (const Failing& one : failing) {
      control::Currents flowing = told;
      if (one.coil == 0)
        flowing *= one.carries;
      else
        flowing[one.coil - 1] *= one.carries;
      left += std::max(0.0, time - one.after) * turn * (went(flowing) - went(told));
    }
    path.push_back({time * speed, left});
  }
  return path;
}

std::string named(const std::vector<Failing>& failing) {
  return plant_fault(window(failing), kNoise);
}

bool begins(const std::string& text, const std::string& with) { return text.rfind(with, 0) == 0; }

// Coils that carry too little to be seen within half a second are left out.
const std::vector<int> kCarrying{1, 2, 4, 5, 6, 8};

TEST(PlantFault, half_of_a_coil_is_told_as_half_of_it) {
  for (const int coil : kCarrying)
    EXPECT_TRUE(begins(named({{coil, 0.5}}),
                       "the robot moves as if coil " + std::to_string(coil) + " made 5") ||
                begins(named({{coil, 0.5}}),
                       "the robot moves as if coil " + std::to_string(coil) + " made 4"))
        << coil << ": " << named({{coil, 0.5}});
}

TEST(PlantFault, a_coil_that_was_cut_off_halfway_is_told_as_one_that_makes_nothing) {
  for (const int coil : kCarrying) {
    const std::string text = named({{coil, 0, 4.5 * kFrame}});
    EXPECT_TRUE(begins(text, "the robot moves as if coil " + std::to_string(coil) + " made "))
        << text;
    EXPECT_TRUE(text.find(" made 0 %") != std::string::npos ||
                text.find(" made 1 %") != std::string::npos)
        << text;
  }
}

TEST(PlantFault, exchanged_leads_and_amplifiers_that_give_nothing_are_told) {
  for (const int coil : kCarrying)
    EXPECT_EQ(named({{coil, -1}}), "the robot moves as if the leads of coil " +
                                       std::to_string(coil) + " were exchanged");
  EXPECT_EQ(named({{0, 0, 2 * kFrame}}),
            "the robot moves as if no current flowed: the amplifiers give nothing");
}

// Coils 2 and 4 pull the robot in directions 15 degrees apart.
TEST(PlantFault, a_coil_beside_which_the_next_explains_as_much_is_named_with_it) {
  const std::string text = plant_fault(window({{4, 0.3}}, 0.12), kNoise);
  EXPECT_NE(text.find("coil 4 made"), std::string::npos) << text;
  EXPECT_NE(text.find("coil 2 made"), std::string::npos) << text;
  EXPECT_EQ(named({{4, 0.3}}).find("or as if"), std::string::npos) << named({{4, 0.3}});
}

TEST(PlantFault, a_robot_that_is_pushed_to_and_fro_has_no_coil_to_blame) {
  std::vector<LeftOver> pushed = window({});
  for (std::size_t k = 0; k < pushed.size(); ++k) pushed[k].left.x() += k % 4 < 2 ? 2e-4 : -2e-4;
  EXPECT_EQ(plant_fault(pushed, kNoise), "");
  pushed.resize(1);
  EXPECT_EQ(plant_fault(pushed, kNoise), "");
  EXPECT_EQ(plant_fault({}, kNoise), "");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
