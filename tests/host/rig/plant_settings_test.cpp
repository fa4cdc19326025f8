// The rig file's `truth` becomes the plant, and what is wrong in it is named.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/plant_settings.h"

#include "host/rig/field_calibration_yaml.h"
#include "host/rig/open_rig.h"
#include "host/rig/rig_settings.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

ConfigValue table(ConfigTable values) { return {std::move(values)}; }
ConfigValue list(std::initializer_list<double> numbers) {
  ConfigList values;
  for (const double number : numbers) {
    values.emplace_back();
    values.back().value = number;
  }
  return {values};
}

RigDescription rig_with(ConfigTable truth) {
  RigDescription description;
  description.file = "test rig";
  description.table["coils"] = table({});
  description.table["sample"] = table({});
  description.table["truth"] = table(std::move(truth));
  return description;
}

RigSettings read(const RigDescription& description) {
  ConfigReader reader(description);
  return read_rig_settings(reader);
}

std::string complaint(const RigDescription& description) {
  try {
    const auto clock = virtual_clock();
    open_rig(description, *clock, 1);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}

TEST(PlantSettings, GelRobotBodiesAndHeatComeThrough) {
  RigDescription description = rig_with(
      {{"gel", table({{"name", {"gel_3"}}, {"yield_strain", {1.5}}})},
       {"heat", table({{"resistance", {1.4}}})},
       {"dead_coils", list({2, 5})},
       {"background", list({20e-6, 0, -40e-6})},
       {"bodies",
        table(
            {{"needle", table({{"shape", {"rod"}}, {"semi_axis", {4e-3}}, {"fixed", {true}}})}})}});
  description.table["model"] = table({{"robot", {"ndfeb_cylinder_1mm"}}});
  const sim::WorldSettings world = read(description).laboratory.world;
  ASSERT_TRUE(world.gel);
  EXPECT_EQ(world.gel->name, "gel_3");
  EXPECT_EQ(world.gel->yield_strain, 1.5);
  EXPECT_EQ(world.coils.resistance, 1.4);
  EXPECT_EQ(world.coils.dead, (std::vector<int>{2, 5}));
  EXPECT_EQ(world.field.uniform_background().z(), -40e-6);
  ASSERT_EQ(world.bodies.size(), 1U);
  EXPECT_EQ(world.bodies[0].name, "needle");
  EXPECT_TRUE(world.bodies[0].fixed);
  EXPECT_TRUE(world.robot.hard);
  EXPECT_EQ(complaint(description), "");
}

TEST(PlantSettings, OfAPlantAllIsDrawnUnlessTheRigNamesTheCoilsOrNothing) {
  const sim::LaboratorySettings coils = read(rig_with({{"machine", {"coils"}}})).laboratory;
  EXPECT_EQ(coils.sigmas.viscosity, 0);
  EXPECT_EQ(coils.moment_sigma, 0.05);
  EXPECT_EQ(coils.field_perturbation.gain, 0.03);
  EXPECT_FALSE(coils.world.wall_drag);
  const sim::LaboratorySettings drawn = read(rig_with({})).laboratory;
  EXPECT_EQ(drawn.sigmas.pixel, 0.005);
  EXPECT_EQ(drawn.sigmas.eye, 50e-6);
  EXPECT_GT(drawn.sigmas.tilt, 0);
  EXPECT_GT(drawn.sigmas.stamp, 0);
  EXPECT_EQ(drawn.sigmas.viscosity, 0.10);
  EXPECT_EQ(drawn.sigmas.background, 50e-6);
  EXPECT_EQ(drawn.moment_sigma, 0.05);
  EXPECT_EQ(drawn.field_perturbation.gain, 0.03);
  EXPECT_GT(drawn.world.coils.saturation, 0);
  EXPECT_TRUE(drawn.world.wall_drag);
  const sim::LaboratorySettings nominal =
      read(rig_with({{"machine", {"nominal"}}, {"mass_sigma", {0.02}}})).laboratory;
  EXPECT_EQ(nominal.sigmas.viscosity, 0);
  EXPECT_EQ(nominal.sigmas.mass, 0.02) << "a single setting beside it counts";
  EXPECT_EQ(nominal.moment_sigma, 0);
  EXPECT_EQ(nominal.field_perturbation.gain, 0);
  EXPECT_EQ(nominal.dac_offset, 0);
  EXPECT_EQ(nominal.world.coils.saturation, 0);
  EXPECT_EQ(nominal.world.coils.remanence, 0);
}

TEST(PlantSettings, TheTruthHasARobotAndAMediumOfItsOwn) {
  const RigSettings settings =
      read(rig_with({{"medium", table({{"kinematic_viscosity", {1e-3}}})},
                     {"robot", table({{"mass", {1.5}}, {"size", {1.1}}, {"moment", {0.7}}})},
                     {"core", table({{"remanence", {0.1}}})},
                     {"heat", table({{"gain_temperature_coefficient", {-1e-3}}})}}));
  const sim::WorldSettings& world = settings.laboratory.world;
  const RigModel& model = settings.model;
  EXPECT_EQ(world.medium.kinematic_viscosity, 1e-3);
  EXPECT_EQ(model.medium.kinematic_viscosity, 500e-6) << "the loop is not told";
  EXPECT_NEAR(world.robot.mass() / model.robot.mass(), 1.5 * 1.331, 1e-9);
  EXPECT_NEAR(world.robot.semi_axis / model.robot.semi_axis, 1.1, 1e-12);
  EXPECT_EQ(world.moment_gain, 0.7);
  EXPECT_EQ(world.coils.remanence, 0.1);
  EXPECT_EQ(world.coils.delay, sim::CoilBankSettings{}.delay) << "the robot's factors leave it";
  EXPECT_EQ(world.coils.bandwidth, sim::CoilBankSettings{}.bandwidth);
  EXPECT_EQ(world.coils.gain_temperature_coefficient, -1e-3);
}

TEST(PlantSettings, WhatIsWrongIsNamed) {
  EXPECT_NE(complaint(rig_with({{"gel", table({{"name", {"jelly"}}})}})).find("truth.gel.name"),
            std::string::npos);
  EXPECT_NE(complaint(rig_with({{"dead_coils", list({1.5})}})).find("truth.dead_coils"),
            std::string::npos);
  EXPECT_NE(complaint(rig_with({{"hand_tuning", table({{"axis", list({0, 0, 0})}})}}))
                .find("truth.hand_tuning.axis"),
            std::string::npos);
  const std::string body =
      complaint(rig_with({{"bodies", table({{"disc", table({{"semi_axis", {2e-3}}})}})}}));
  EXPECT_NE(body.find("body 'disc'"), std::string::npos) << body;
  EXPECT_NE(complaint(rig_with({{"calibration", {"none.yaml"}}})).find("truth.calibration"),
            std::string::npos);
}

class CalibratedPlant : public testing::Test {
 protected:
  CalibratedPlant() {
    std::string name = (std::filesystem::temp_directory_path() / "vitreo_plant_XXXXXX").string();
    folder = mkdtemp(name.data());
  }
  ~CalibratedPlant() override { std::filesystem::remove_all(folder); }
  void write(int coils, double half_size, double off = 0, int turned = 0, double gain = 1) const {
    const control::CoilField dipoles = control::CoilField::octomag();
    std::vector<control::MultipoleField::Sources> sources;
    for (int coil = 0; coil < coils; ++coil) {
      const control::Dipole& dipole =
          dipoles.dipoles()[static_cast<std::size_t>((coil + turned) % 8)];
      const double moment = gain * dipole.moment_per_ampere.norm();
      sources.push_back(
          {{dipole.position, dipole.moment_per_ampere.normalized(), {}, {-1e-7 * moment}}});
    }
    const Eigen::Vector3d size = Eigen::Vector3d::Constant(half_size), shift(off, 0, 0);
    std::ofstream(folder / "machine.yaml")
        << field_calibration_text({"machine", {sources, {}, {shift - size, shift + size}}});
  }
  std::string opened() const {
    RigDescription description = rig_with({{"calibration", {"machine.yaml"}}});
    description.file = (folder / "rig.lua").string();
    return complaint(description);
  }
  std::filesystem::path folder;
};

TEST_F(CalibratedPlant, ItsFileIsFoundBesideTheRigFileAndTakesNoDraws) {
  write(8, 15e-3);
  EXPECT_EQ(opened(), "");
  const RigSettings settings = read(rig_with({{"calibration", {"machine.yaml"}}}));
  EXPECT_EQ(settings.laboratory.field_perturbation.gain, 0);
  EXPECT_EQ(read(rig_with({})).laboratory.field_perturbation.gain, 0.03);
  EXPECT_EQ(read(rig_with({{"calibration", {"x"}}, {"coil_gain_sigma", {0.02}}}))
                .laboratory.field_perturbation.gain,
            0.02);
}

TEST_F(CalibratedPlant, CoilsInAnotherOrderAreWiredByWhereTheyPointAndEachIsCompared) {
  const control::FieldModel model = control::CoilField::octomag();
  write(8, 15e-3, 0, 0, 0.9);
  const MeasuredField straight = read_calibration(folder / "machine.yaml", model);
  EXPECT_EQ(straight.channels, (std::vector<int>{1, 2, 3, 4, 5, 6, 7, 8}));
  ASSERT_EQ(straight.coils.size(), 8U);
  for (const control::CoilComparison& coil : straight.coils) {
    EXPECT_EQ(coil.sign, 1);
    EXPECT_NEAR(coil.gain, 0.9, 1e-9);
    EXPECT_LT(coil.angle, 1e-9);
  }
  write(8, 15e-3, 0, 3);
  const MeasuredField turned = read_calibration(folder / "machine.yaml", model);
  EXPECT_EQ(turned.channels, (std::vector<int>{4, 5, 6, 7, 8, 1, 2, 3}));
  EXPECT_EQ(turned.system_name, "machine");
  for (const control::CoilComparison& coil : turned.coils) {
    EXPECT_EQ(coil.sign, 1);
    EXPECT_NEAR(coil.gain, 1, 1e-9);
    EXPECT_LT(coil.angle, 1e-9);
  }
  const Eigen::Vector3d place(2e-3, -1e-3, 3e-3);
  EXPECT_LT((turned.field.matrix(place) - model.matrix(place)).norm(), 1e-9);
}

// ETH's older OctoMag file is of this kind: one relative difference would be 190 %.
TEST_F(CalibratedPlant, AFileOfOppositeSignIsComparedBySignGainAndAngle) {
  write(8, 15e-3, 0, 0, -0.9);
  const MeasuredField opposite =
      read_calibration(folder / "machine.yaml", control::CoilField::octomag());
  EXPECT_EQ(opposite.channels, (std::vector<int>{1, 2, 3, 4, 5, 6, 7, 8}));
  for (const control::CoilComparison& coil : opposite.coils) {
    EXPECT_EQ(coil.sign, -1);
    EXPECT_NEAR(coil.gain, 0.9, 1e-9);
    EXPECT_LT(coil.angle, 1e-9);
  }
}

TEST_F(CalibratedPlant, WithTheWrongCoilsOrElsewhereItIsRefused) {
  write(7, 15e-3);
  EXPECT_NE(opened().find("7 coils"), std::string::npos) << opened();
  write(8, 5e-3, 0.1);
  EXPECT_NE(opened().find("Workspace_Dimensions"), std::string::npos) << opened();
  std::ofstream(folder / "machine.yaml") << "Coil_List: [A\n";
  EXPECT_NE(opened().find("line 2"), std::string::npos) << opened();
  write(8, 15e-3, 0, 0, 0);
  EXPECT_NE(opened().find("coil 1 makes no field"), std::string::npos) << opened();
  write(8, 15e-3, 0, 0, 1e3);
  EXPECT_NE(opened().find("T per ampere"), std::string::npos) << opened();
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
