// What the links of a rig file take: of its emulated instruments on the virtual clock, and in the
// arithmetic that `vitreo check` is given.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/link_load.h"

#include "host/engine/loop_rate.h"
#include "host/rig/open_rig.h"
#include "host/rig/rig_settings.h"
#include "host/rig/twin.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

ConfigValue quoted(const std::string& value) { return {value}; }

RigDescription rig_of(const std::string& role, ConfigTable table) {
  RigDescription description;
  description.file = "rig.lua";
  description.table[role] = ConfigValue{std::move(table)};
  return description;
}

/// s on the virtual clock, of a set point of all coils of the rig that begins with a USB frame.
double set_point_time(const RigDescription& description) {
  const auto clock = virtual_clock();
  const auto rig = open_rig(description, *clock, 1);
  clock->sleep_until(clock->now() / std::chrono::seconds(1) * std::chrono::seconds(1) +
                     std::chrono::seconds(2));
  const Time before = clock->now();
  rig->rig().coils->set_currents(std::vector<double>(8, 0.5));
  return to_seconds(clock->now() - before);
}

TEST(LinkLoads, AnEmulatedUsb3103TakesElevenFrames) {
  EXPECT_NEAR(set_point_time(rig_of("coils", {})), 11e-3, 1e-9);
  EXPECT_NEAR(set_point_time(rig_of("coils", {{"transfer_interval", {2e-3}}})), 22e-3, 1e-9);
  EXPECT_EQ(set_point_time(rig_of("coils", {{"transfer_interval", {0.0}}})), 0);
}

// By hand: "CURR 0.50000;MEAS:CURR?;SYST:ERR?" and LF are 34 bytes, and a colon more for each
// question where the driver writes one; "5.00000E-01;0,"No error"" with CR LF is 26. Hence the
// range of a tenth.
TEST(LinkLoads, EmulatedBopsTakeTheTimeOfTheRigFilesBaudRate) {
  for (const double baud_rate : {9600., 19200., 115200.}) {
    const double took = set_point_time(
        rig_of("coils", {{"driver", quoted("kepco_bop")}, {"baud_rate", {baud_rate}}}));
    EXPECT_NEAR(took, 60 * 10 / baud_rate, 6 * 10 / baud_rate) << baud_rate << " baud";
    EXPECT_GT(took, 0);
  }
  EXPECT_EQ(
      set_point_time(rig_of("coils", {{"driver", quoted("kepco_bop")}, {"baud_rate", {0.0}}})), 0);
}

TEST(LinkLoads, ABaudRateOfZeroIsForEmulatedInstrumentsAlone) {
  const RigDescription real = rig_of("stage", {{"driver", quoted("sutter_mp285")},
                                               {"address", quoted("serial:/dev/ttyS0")},
                                               {"baud_rate", {0.0}}});
  EXPECT_THROW(check_rig(real), ConfigError);
  EXPECT_THROW(check_rig(rig_of(
                   "coils", {{"address", quoted("hid:09db:009c")}, {"transfer_interval", {0.0}}})),
               ConfigError);
}

// Else the twin of a supply on the network would be one on a serial line.
TEST(LinkLoads, TheTwinOfAnInstrumentOnTheNetworkTakesNoTime) {
  const RigDescription lan =
      rig_of("coils", {{"driver", quoted("kepco_bop")},
                       {"address", quoted("tcp:10.0.0.11:5025, tcp:10.0.0.12:5025")}});
  EXPECT_EQ(set_point_time(twin_of(lan)), 0);
  const RigDescription serial =
      rig_of("coils", {{"driver", quoted("kepco_bop")},
                       {"address", quoted("serial:/dev/ttyS0, serial:/dev/ttyS1")},
                       {"baud_rate", {19200.}}});
  EXPECT_NEAR(set_point_time(twin_of(serial)), 60 * 10 / 19200., 6 * 10 / 19200.);
}

LinkLoads loads_of_bops(double camera_rate, const std::string& address, double baud_rate) {
  RigDescription rig = rig_of("top_camera", {{"frame_rate", {camera_rate}}});
  ConfigTable coils{{"driver", quoted("kepco_bop")}, {"address", quoted(address)}};
  if (baud_rate > 0) coils["baud_rate"] = ConfigValue{baud_rate};
  rig.table["coils"] = ConfigValue{std::move(coils)};
  return link_loads(rig);
}
std::string eight(const std::string& place) {
  std::string all;
  for (char i = '0'; i < '8'; ++i) all += (all.empty() ? "" : ", ") + place + i;
  return all;
}

TEST(LoopRates, EightBopsAt9600BaudHoldNoLoopOf15Hz) {
  for (const double rate : {15., 30.}) {
    const auto problems =
        beyond_links(loads_of_bops(rate, eight("serial:/dev/ttyS"), 9600), {"top_camera"});
    ASSERT_EQ(problems.size(), 1U) << rate << " Hz";
    EXPECT_EQ(problems.front().find("coils: their link cannot hold a servo loop of"), 0U)
        << problems.front();
    EXPECT_NE(problems.front().find("at 9600 baud"), std::string::npos) << problems.front();
  }
}

TEST(LoopRates, EightBopsAt115200BaudOrOnTheNetworkHoldIt) {
  for (const double rate : {15., 30.}) {
    EXPECT_TRUE(beyond_links(loads_of_bops(rate, eight("serial:/dev/ttyS"), 115200), {"top_camera"})
                    .empty());
    EXPECT_TRUE(
        beyond_links(loads_of_bops(rate, eight("tcp:10.0.0.1:502"), 0), {"top_camera"}).empty());
  }
}

TEST(LoopRates, SaysWhichLinkLimitsTheLoop) {
  const LoopRate slow = loop_rate(loads_of_bops(15, eight("serial:/dev/ttyS"), 19200));
  EXPECT_EQ(slow.limit, "coils");
  EXPECT_EQ(slow.source, "top_camera");
  EXPECT_EQ(slow.asked, 15);
  // At 19200 baud twice the rate at 9600, where 36 bytes out and 25 to 29 back take 64 to 68 ms; up
  // to three bytes more where the driver writes colons.
  EXPECT_NEAR(slow.held, 2 / 0.067, 2);
  const LoopRate fast = loop_rate(loads_of_bops(15, eight("tcp:10.0.0.1:502"), 0));
  EXPECT_EQ(fast.held, 0) << "no link takes any time";
}

TEST(LoopRates, NamesACameraWhoseLinkCannotHoldItsOwnFrameRate) {
  RigDescription rig = rig_of("top_camera", {{"driver", quoted("genicam")},
                                             {"address", quoted("genicam:10.0.0.5")},
                                             {"width_px", {1384.}},
                                             {"height_px", {1036.}},
                                             {"exposure", {1e-3}},
                                             {"effective_pixel", {20e-6}},
                                             {"frame_rate", {100.}}});
  const auto problems = beyond_links(link_loads(rig), {"top_camera"});
  ASSERT_EQ(problems.size(), 1U);
  EXPECT_NE(problems.front().find("top_camera: its link cannot hold frame_rate = 100 Hz"),
            std::string::npos)
      << problems.front();
  EXPECT_NE(problems.front().find("GigE"), std::string::npos) << problems.front();
  std::get<ConfigTable>(rig.table["top_camera"].value)["link_rate"] = ConfigValue{1e10};
  EXPECT_TRUE(beyond_links(link_loads(rig), {"top_camera"}).empty());
}

TEST(LoopRates, AskNothingWhereNoLoopTurns) {
  EXPECT_TRUE(beyond_links(loads_of_bops(30, eight("serial:/dev/ttyS"), 9600), {}).empty());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
