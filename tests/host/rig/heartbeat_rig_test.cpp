// Rigs with a heartbeat line and a current sensor: from the rig file's keys to currents that flow,
// or do not, in the simulated laboratory; and what is wrong is named.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/error.h"
#include "host/rig/open_rig.h"
#include "host/rig/rig_settings.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

ConfigValue text(const char* value) { return {std::string(value)}; }
ConfigValue numbers(const std::vector<double>& values) {
  ConfigList list;
  for (const double value : values) list.push_back({value});
  return {list};
}
RigDescription rig_of(const ConfigTable& roles) {
  RigDescription description;
  description.file = "rig.lua";
  description.table = roles;
  return description;
}
void expect_error(const ConfigTable& roles, const std::string& naming) {
  const RigDescription description = rig_of(roles);
  ConfigReader reader(description);
  try {
    read_rig_settings(reader);
    ADD_FAILURE() << "no error that names " << naming;
  } catch (const ConfigError& error) {
    EXPECT_NE(std::string(error.what()).find(naming), std::string::npos) << error.what();
  }
}

const ConfigTable kBeating{{"enable_line", {3.0}}, {"heartbeat", {50.0}}};

/// A rig on the virtual clock, with 1 A set on all coils for a second.
struct EnergizedRig {
  explicit EnergizedRig(const ConfigTable& roles) : rig(open_rig(rig_of(roles), *clock, 1)) {
    coils().set_currents(std::vector<double>(8, 1.0));
    clock->sleep_for(1s);
  }
  Interlock& coils() { return *rig->rig().coils; }
  double flows() { return rig->laboratory()->coils(clock->now()).currents.cwiseAbs().maxCoeff(); }
  std::unique_ptr<Clock> clock = virtual_clock();
  std::unique_ptr<OpenRig> rig;
};

TEST(HeartbeatRig, CurrentsFlowThroughTheRelayOfTheDevicesOwnLine) {
  EnergizedRig on({{"coils", {kBeating}}});
  EXPECT_NEAR(on.flows(), 1, 0.05);
  ASSERT_NE(on.rig->rig().enable_line, nullptr);
  EXPECT_EQ(on.rig->rig().enable_line->identity().find("digital line 3 of "), 0U);
  // The interface goes on holding its volts; its line is toggled by nobody any more.
  on.rig->laboratory()->faults().links["coils"].deaf = true;
  on.clock->sleep_for(500ms);
  EXPECT_LT(on.flows(), 0.01);
}

TEST(HeartbeatRig, AStaticLineGoesOnHoldingTheCurrents) {
  EnergizedRig on({{"coils", {ConfigTable{{"enable_line", {3.0}}}}}});
  EXPECT_EQ(on.rig->rig().enable_line, nullptr);
  on.rig->laboratory()->faults().links["coils"].deaf = true;
  on.clock->sleep_for(500ms);
  EXPECT_NEAR(on.flows(), 1, 0.05);
}

TEST(HeartbeatRig, ALineOfItsOwnServesSuppliesThatHaveNone) {
  EnergizedRig on({{"coils", {ConfigTable{{"driver", text("kepco_bop")}}}},
                   {"enable_line", {ConfigTable{{"driver", text("serial_line")}}}}});
  EXPECT_TRUE(on.coils().enabled()) << on.coils().tripped();
  EXPECT_NEAR(on.flows(), 1, 0.05);
  on.rig->laboratory()->set_enable_line(true);  // stuck high from now on, whatever the host does
  EXPECT_TRUE(on.rig->make_safe().empty());
  on.clock->sleep_for(200ms);
  EXPECT_LT(on.flows(), 0.01);
}

TEST(HeartbeatRig, ASensorOnALoggerSeesASupplyThatGivesNothing) {
  EnergizedRig on({{"coils", {ConfigTable{}}},
                   {"current_sensor",
                    {ConfigTable{{"channels", numbers({101, 102, 103, 104, 105, 106, 107, 108})},
                                 {"amperes_per_volt", numbers({2, 2, -2, 2, 2, 2, 2, 2})},
                                 {"line_cycles", {0.02}},
                                 {"baud_rate", {57600.0}}}}}});
  EXPECT_TRUE(on.coils().enabled()) << on.coils().tripped();
  on.rig->laboratory()->faults().cut_off.insert(3);
  on.rig->laboratory()->apply_coil_faults();
  const Time began = on.clock->now();
  while (on.coils().enabled() && on.clock->now() - began < 2s) on.clock->sleep_for(5ms);
  // Beside the simulated coils' own 50 ms and 11 ms of lag.
  EXPECT_LT(to_seconds(on.clock->now() - began), 0.3);
  EXPECT_NE(on.coils().tripped().find("coil 3: "), std::string::npos) << on.coils().tripped();
  const CoilRest rest = on.coils().read_rest();
  EXPECT_TRUE(at_zero(rest)) << to_text(rest, "now");
}

TEST(HeartbeatRig, WhatIsWrongIsNamed) {
  expect_error({{"coils", {ConfigTable{{"heartbeat", {50.0}}}}}}, "coils.heartbeat");
  expect_error({{"coils", {ConfigTable{{"enable_line", {0.0}}, {"heartbeat", {500.0}}}}}},
               "coils.heartbeat");
  expect_error(
      {{"coils",
        {ConfigTable{{"enable_line", {0.0}}, {"heartbeat", {50.0}}, {"one_shot", {0.03}}}}}},
      "too short");
  expect_error({{"enable_line", {ConfigTable{}}}}, "only with the role coils");
  expect_error({{"coils", {kBeating}}, {"enable_line", {ConfigTable{}}}}, "second line");
  expect_error({{"coils", {ConfigTable{}}},
                {"enable_line", {ConfigTable{{"address", text("tcp:10.0.0.1:5")}}}}},
               "enable_line.address");
  expect_error({{"coils", {ConfigTable{}}}, {"current_sensor", {ConfigTable{}}}},
               "current_sensor.channels");
  expect_error({{"coils", {ConfigTable{}}},
                {"current_sensor", {ConfigTable{{"channels", numbers({101, 101})}}}}},
               "101 twice");
  expect_error({{"coils", {ConfigTable{}}},
                {"current_sensor",
                 {ConfigTable{{"channels", numbers({101, 102})}, {"coils", numbers({1})}}}}},
               "current_sensor.coils");
  expect_error({{"current_sensor", {ConfigTable{{"channels", numbers({101})}}}}},
               "only with the role coils");
}

TEST(HeartbeatRig, ASensorOfACoilThatTheMachineHasNotIsRefused) {
  const auto clock = virtual_clock();
  EXPECT_THROW(
      open_rig(rig_of({{"coils", {ConfigTable{}}},
                       {"current_sensor",
                        {ConfigTable{{"channels", numbers({101})}, {"coils", numbers({9})}}}}}),
               *clock, 1),
      ConfigError);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
