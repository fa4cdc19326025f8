// The registry: a rig file's driver and address become an opener, or an error that names what is
// wrong.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/registry.h"

#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/time/error.h"
#include "host/rig/instruments.h"
#include "host/rig/open_rig.h"
#include "host/rig/opening_error.h"
#include "host/rig/plugged_in.h"
#include "host/rig/rig_settings.h"
#include "host/rig/twin.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/links/real_end.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

RigDescription rig_with(const std::string& role, ConfigTable table) {
  RigDescription description;
  description.file = "rig.lua";
  description.table[role] = ConfigValue{std::move(table)};
  return description;
}
ConfigValue text(const char* value) { return {std::string(value)}; }

void expect_error(const RigDescription& description, const std::string& naming) {
  ConfigReader reader(description);
  try {
    read_rig_settings(reader);
    ADD_FAILURE() << "no error that names " << naming;
  } catch (const ConfigError& error) {
    EXPECT_NE(std::string(error.what()).find(naming), std::string::npos) << error.what();
  }
}

TEST(Registry, TakesTheFirstDriverAndAnEmulatorWhenTheRigFileNamesNone) {
  const RigDescription description = rig_with("coils", {});
  ConfigReader reader(description);
  const RigSettings settings = read_rig_settings(reader);
  EXPECT_TRUE(settings.coils);
  EXPECT_FALSE(settings.stage);
  EXPECT_EQ(reader.resolved()["coils"]["driver"], "usb3103");
  EXPECT_EQ(reader.resolved()["coils"]["address"], "emulated");
}

TEST(Registry, TakesAFootPedalForAPedalAndASpaceMouseForAJoystick) {
  RigDescription description = rig_with("pedal", {});
  description.table["joystick"] = ConfigValue{ConfigTable{}};
  ConfigReader reader(description);
  read_rig_settings(reader);
  EXPECT_EQ(reader.resolved()["pedal"]["driver"], "foot_pedal");
  EXPECT_EQ(reader.resolved()["joystick"]["driver"], "spacemouse");
}

TEST(Registry, ShowsTheDriversThatItTakes) {
  RigDescription description = rig_with("pedal", {});
  for (const char* role : {"joystick", "coils", "lens_mover", "rotation_stage", "field_probe",
                           "lamp", "top_camera", "side_camera", "pose_sensor", "sample"})
    description.table[role] = ConfigValue{ConfigTable{}};
  ConfigReader reader(description);
  read_rig_settings(reader);
  const nlohmann::json rows = examine_rig(description);
  EXPECT_EQ(rows.size(), description.table.size());
  for (const auto& row : rows) {
    EXPECT_EQ(row["driver"], reader.resolved()[row["role"]]["driver"]) << row;
    EXPECT_EQ(row["link"], "emulated") << row;
    EXPECT_TRUE(row["present"]) << row;
  }
}

TEST(Registry, KnowsTheLensMoverByItsDriverAlone) {
  expect_error(rig_with("lens_mover", {{"driver", text("simulated")}}), "lens_mover.driver");
}

ConfigTable camera_at(const char* address) {
  return {{"driver", text("opencv_camera")},
          {"address", text(address)},
          {"width_px", {640.0}},
          {"height_px", {480.0}},
          {"effective_pixel", {20e-6}}};
}

TEST(Registry, TellsACameraFromAVideoByItsNode) {
  EXPECT_TRUE(is_laboratory(rig_with("top_camera", camera_at("video:/dev/video0"))));
  EXPECT_FALSE(is_laboratory(rig_with("top_camera", camera_at("video:eye.avi"))));
  EXPECT_FALSE(is_laboratory(rig_with("top_camera", camera_at("video:0"))));  // a file so named
}

TEST(Registry, LetsTwoRolesShareAVideoAndNoCamera) {
  RigDescription description = rig_with("top_camera", camera_at("video:eye.avi"));
  description.table["side_camera"] = ConfigValue{camera_at("video:eye.avi")};
  EXPECT_NO_THROW(check_rig(description));
  for (const char* role : {"top_camera", "side_camera"})
    description.table[role] = ConfigValue{camera_at("video:/dev/video0")};
  EXPECT_THROW(check_rig(description), ConfigError);
}

TEST(Registry, RefusesOneAddressForTwoChannelsOrForAChannelAndARole) {
  const auto refusal = [](const RigDescription& description) -> std::string {
    try {
      check_rig(description);
    } catch (const ConfigError& error) {
      return error.what();
    }
    return "";
  };
  const auto supplies = [](const char* addresses) {
    return rig_with("coils", {{"driver", text("kepco_bop")}, {"address", text(addresses)}});
  };
  EXPECT_EQ(refusal(supplies("tcp:10.0.0.1:5025, tcp:10.0.0.2:5025")), "");
  EXPECT_NE(refusal(supplies("tcp:10.0.0.1:5025, tcp:10.0.0.2:5025,tcp:10.0.0.1:5025"))
                .find("coils.address, channel 3 is that of coils, channel 1 already: "
                      "tcp:10.0.0.1:5025"),
            std::string::npos);
  RigDescription shared = supplies("serial:/dev/ttyUSB0, serial:/dev/ttyUSB1");
  shared.table["stage"] = ConfigValue{
      ConfigTable{{"driver", text("sutter_mp285")}, {"address", text("serial:/dev/ttyUSB1")}}};
  EXPECT_NE(refusal(shared).find("stage.address is that of coils, channel 2 already"),
            std::string::npos)
      << refusal(shared);
  // One of a list that is no address is the file's error, and not the program's.
  EXPECT_NE(refusal(supplies("tcp:10.0.0.1:5025, ttyUSB0")).find("coils.address"),
            std::string::npos);
  EXPECT_NE(refusal(supplies("tcp:10.0.0.1:5025,,tcp:10.0.0.2:5025")).find("coils.address"),
            std::string::npos);
}

TEST(Registry, NamesADriverThatItDoesNotKnowAndTheNearestOne) {
  expect_error(rig_with("coils", {{"driver", text("usb3104")}}), "did you mean usb3103?");
}

TEST(Registry, NamesAnAddressThatIsNone) {
  expect_error(rig_with("coils", {{"address", text("/dev/ttyUSB0")}}), "coils.address");
  expect_error(rig_with("coils", {{"address", text("serial:")}}), "coils.address");
}

TEST(Registry, NamesASettingThatTheDriverDoesNotKnow) {
  expect_error(rig_with("coils", {{"amperes_per_vlot", {2.0}}}), "did you mean amperes_per_volt?");
}

TEST(Registry, HasEachDriverOnceInARole) {
  const auto expect_unique = [](const auto& entries) {
    std::set<std::string> names;
    for (const auto& entry : entries) EXPECT_TRUE(names.insert(entry.name).second) << entry.name;
  };
  expect_unique(drivers<CoilAmplifier>());
  expect_unique(drivers<Stage>());
  expect_unique(drivers<RotationStage>());
  expect_unique(drivers<FieldProbe>());
}

TEST(Registry, OpensAnEmulatedStageAndRotationStageThroughTheirRealDrivers) {
  RigDescription description = rig_with(
      "stage", {{"x", {ConfigTable{{"device", {2.0}}}}}, {"z", {ConfigTable{{"device", {1.0}}}}}});
  description.table["rotation_stage"] = ConfigValue{ConfigTable{{"max_speed", {0.5}}}};
  const auto clock = virtual_clock();
  const auto rig = open_rig(description, *clock, 1);
  ASSERT_NE(rig->rig().stage, nullptr);
  Stage& stage = *rig->rig().stage;
  EXPECT_EQ(stage.info().axes.size(), 2U);
  EXPECT_EQ(stage.info().axes[0].name, "x");
  EXPECT_NE(stage.info().identity.name.find("Zaber"), std::string::npos);
  move_to(stage, std::vector<double>{1e-3, 2e-3}, 2e-3, std::chrono::seconds(10), *clock);
  EXPECT_NEAR(stage.position()[1], 2e-3, 1e-6);
  EXPECT_EQ(rig->rig().rotation_stage->info().axis.max_speed, 0.5);
  EXPECT_EQ(rig->rig().roles(), (std::vector<std::string>{"rotation_stage", "stage"}));
  stage.start(std::vector<double>{10e-3, 2e-3}, 1e-3);
  EXPECT_TRUE(rig->make_safe().empty());
  EXPECT_FALSE(stage.moving());
}

TEST(Registry, OpensAnMp285ThatTheSimulatedProbeRidesOnThroughTheCoilsField) {
  RigDescription description = rig_with("stage", {{"driver", text("sutter_mp285")}});
  description.table["coils"] = ConfigValue{ConfigTable{{"driver", text("kepco_bop")}}};
  description.table["field_probe"] = ConfigValue{ConfigTable{{"on_stage", {true}}}};
  const auto clock = virtual_clock();
  const auto rig = open_rig(description, *clock, 1);
  Rig& roles = rig->rig();
  ASSERT_EQ(roles.roles(), (std::vector<std::string>{"coils", "field_probe", "stage"}));
  EXPECT_EQ(roles.coils->channels(), 8);
  const auto measured = [&] { return roles.field_probe->measure(std::chrono::seconds(1)).field; };
  const auto strength = [&] {
    const auto field = measured();
    return std::sqrt(field[0] * field[0] + field[1] * field[1] + field[2] * field[2]);
  };
  EXPECT_LT(strength(), 2e-3);  // nothing but the noise of the currents
  std::vector<double> currents(8);
  currents[0] = 10;
  roles.coils->set_currents(currents);
  clock->sleep_for(std::chrono::seconds(1));
  const Eigen::Vector3d expected = rig->laboratory()->field({0, 0, 0}, clock->now());
  EXPECT_GT(expected.norm(), 10e-3);
  EXPECT_NEAR(strength(), expected.norm(), 0.2e-3);  // 10 mA of noise in each coil
  move_to(*roles.stage, std::vector<double>{5e-3, 5e-3, 5e-3}, 1e-3, std::chrono::seconds(30),
          *clock);
  const Eigen::Vector3d there = rig->laboratory()->field({5e-3, 5e-3, 5e-3}, clock->now());
  EXPECT_GT(std::abs(there.norm() - expected.norm()), 0.5e-3);
  EXPECT_NEAR(strength(), there.norm(), 0.2e-3);  // 10 mA of noise in each coil
  EXPECT_TRUE(rig->make_safe().empty());
  clock->sleep_for(std::chrono::seconds(1));
  EXPECT_LT(strength(), 2e-3);
}

TEST(Registry, TheSimulatedStageIsAZaberWhosePlaceTheLaboratoryKnows) {
  RigDescription description = rig_with(
      "stage", {{"driver", text("simulated")}, {"carries", text("probe")}, {"travel", {10e-3}}});
  description.table["field_probe"] =
      ConfigValue{ConfigTable{{"driver", text("simulated")}, {"noise", {0.0}}}};
  description.table["coils"] =
      ConfigValue{ConfigTable{{"transfer_interval", {0.0}}}};  // no USB frames
  const auto clock = virtual_clock();
  const auto rig = open_rig(description, *clock, 1);
  Rig& roles = rig->rig();
  EXPECT_EQ(clock->now(), Time(0))
      << "its link takes no time, so a run begins when it began without it";
  EXPECT_NE(roles.stage->info().identity.name.find("Zaber"), std::string::npos);
  ASSERT_EQ(roles.stage->info().axes.size(), 3U);
  EXPECT_NEAR(roles.stage->info().axes[2].travel_min, -10e-3, 1e-9);
  roles.coils->set_currents(std::vector<double>(8, 5.0));
  const std::vector<double> place{4e-3, -3e-3, 2e-3};
  move_to(*roles.stage, place, 10e-3, std::chrono::seconds(10), *clock);
  clock->sleep_for(std::chrono::seconds(1));
  const auto read = roles.field_probe->measure(std::chrono::seconds(1)).field;
  const Eigen::Vector3d there =
      rig->laboratory()->field({place[0], place[1], place[2]}, clock->now());
  EXPECT_LT((Eigen::Vector3d(read[0], read[1], read[2]) - there).norm(),
            0.2e-3);  // 10 mA of noise in each coil
  EXPECT_GT((rig->laboratory()->field({0, 0, 0}, clock->now()) - there).norm(), 1e-3);
}

TEST(Registry, ThePedalAsADeadManKeepsTheCoilsAtZeroWhileNobodyStandsOnIt) {
  RigDescription description = rig_with("pedal", {{"dead_man", {ConfigList{{2.0}}}}});
  expect_error(description, "pedal.dead_man");
  description.table["coils"] = ConfigValue{ConfigTable{}};
  const auto clock = virtual_clock();
  const auto rig = open_rig(description, *clock, 1);
  try {
    rig->rig().coils->set_currents(std::vector<double>(8, 1.0));
    ADD_FAILURE() << "a current flows";
  } catch (const DeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("the pedal is released"), std::string::npos)
        << error.what();
  }
  EXPECT_EQ(rig->rig().coils->currents(), std::vector<double>(8, 0.0));
}

/// Counts what passes on the links of each role.
struct Counter final : LinkTap {
  void passed(const LinkName& link, Time, LinkEvent event,
              std::span<const std::uint8_t> bytes) override {
    ++events[link.role];
    if (event == LinkEvent::to_instrument || event == LinkEvent::from_instrument)
      moved[link.role] += bytes.size();
    addresses[link.role].insert(link.address);
  }
  std::map<std::string, int> events;
  std::map<std::string, std::size_t> moved;
  std::map<std::string, std::set<std::string>> addresses;
};

/// With the driver's name added; what the driver wants beside it.
template <class Role>
void expect_traced(const std::string& role, const ConfigTable& wanted, Counter& counter) {
  for (const auto& entry : drivers<Role>()) {
    ConfigTable table = wanted;
    table["driver"] = text(entry.name);
    if (std::string(entry.name) == "simulated" && role == "stage") table.erase("x");
    if (std::string(entry.name) == "simulated" && role == "field_probe") continue;  // no link
    if (std::string(entry.name).starts_with("sutter")) table.erase("x");
    const auto clock = virtual_clock();
    Counter its;
    const auto rig = open_rig(rig_with(role, table), *clock, 1, {}, &its);
    EXPECT_GT(its.events[role], 0) << role << " " << entry.name << " is not traced";
    EXPECT_EQ(its.events.size(), 1U) << role;
    counter.moved[role] += its.moved[role];
    counter.addresses[role].merge(its.addresses[role]);
  }
}

TEST(Registry, EveryDriverThatHasALinkIsTracedUnderItsRole) {
  Counter counter;
  expect_traced<CoilAmplifier>("coils", {}, counter);
  expect_traced<LensMover>("lens_mover", {}, counter);
  expect_traced<Lamp>("lamp", {}, counter);
  expect_traced<OperatorInput>("joystick", {}, counter);
  expect_traced<OperatorInput>("pedal", {}, counter);
  expect_traced<Stage>("stage", {{"x", {ConfigTable{}}}}, counter);
  expect_traced<RotationStage>("rotation_stage", {}, counter);
  expect_traced<FieldProbe>("field_probe", {}, counter);
  for (const char* role : {"coils", "lens_mover", "lamp", "stage", "rotation_stage", "field_probe"})
    EXPECT_GT(counter.moved[role], 10U) << role << ": its opening asks it something";
  EXPECT_TRUE(counter.addresses["coils"].contains("channel 8, emulated"));
}

const nlohmann::json kLaboratory = {
    {"title", "a laboratory"},
    {"coils", {{"driver", "kepco_bop"}, {"address", "tcp:10.0.0.11:5025, tcp:10.0.0.12:5025"}}},
    {"stage", {{"driver", "sutter_mp285"}, {"address", "serial:/dev/ttyUSB0"}}},
    {"rotation_stage", {{"driver", "zaber"}, {"address", "serial:/dev/ttyUSB1"}}},
    {"field_probe", {{"driver", "scpi_probe"}, {"address", "tcp:10.0.0.7:7777"}}},
    {"lens_mover", {{"driver", "pololu_tic"}, {"address", "emulated"}}}};

std::string explained_text(const DeviceError& error, const std::string& role,
                           const std::string& address) {
  return opening_error(error, role, address, &kLaboratory).what();
}

TEST(OpeningError, NamesTheOtherInstrumentsOnLinesOfTheSameKind) {
  EXPECT_EQ(explained_text({DeviceErrorKind::timeout, "stage",
                            "serial:/dev/ttyUSB0 at 9600 baud, 8N1 says nothing: is it on?"},
                           "stage", "serial:/dev/ttyUSB0"),
            "stage: serial:/dev/ttyUSB0 at 9600 baud, 8N1 says nothing: is it on? rotation_stage "
            "(zaber) is on serial:/dev/ttyUSB1 (timeout)");
  EXPECT_EQ(explained_text({DeviceErrorKind::not_found, "field_probe", "this is no probe: x"},
                           "field_probe", "tcp:10.0.0.7:7777"),
            "field_probe: this is no probe: x; coils (kepco_bop) is on tcp:10.0.0.11:5025 and 1 "
            "more (not found)");
}

TEST(OpeningError, LeavesThemOutWhereTheLineItselfDoesNotOpenOrIsNoOthers) {
  EXPECT_EQ(explained_text({DeviceErrorKind::not_found, "serial:/dev/ttyUSB0", "no such port"},
                           "stage", "serial:/dev/ttyUSB0"),
            "stage: serial:/dev/ttyUSB0: no such port (not found)");
  EXPECT_EQ(explained_text({DeviceErrorKind::refused, "stage", "it does not keep its settings"},
                           "stage", "serial:/dev/ttyUSB0"),
            "stage: it does not keep its settings (refused)");
  EXPECT_EQ(explained_text({DeviceErrorKind::timeout, "lens_mover", "no answer"}, "lens_mover",
                           "emulated"),
            "lens_mover: no answer (timeout)");
}

TEST(OpeningError, NamesTheAddressOfWhatIsOnUsb) {
  EXPECT_EQ(explained_text({DeviceErrorKind::timeout, "lamp", "no answer within 0.1 s"}, "lamp",
                           "hid:09db:009c:01A2B3C5"),
            "lamp: no answer within 0.1 s; its address is hid:09db:009c:01A2B3C5 (timeout)");
}

TEST(OpeningError, OfCoilsWhoseLinkDoesNotOpenSaysThatNoZeroWasSent) {
  EXPECT_EQ(
      explained_text({DeviceErrorKind::not_found, "hid:09db:009c", "no such device is plugged in"},
                     "coils", "hid:09db:009c"),
      "coils: hid:09db:009c: no such device is plugged in; no zero was sent, so a current "
      "that was set before may still flow (not found)");
}

// A port that nothing listens on: the connection is refused at once.
TEST(Registry, OneSupplyThatCannotBeReachedDoesNotKeepTheOthersFromTheirZero) {
  const auto other = kepco_bop::make_emulator({.network = true}, [](Time, double) {});
  Listener listener(*other);
  RealEnd wire(listener, open_tcp_end());
  const std::string addresses = "tcp:127.0.0.1:1, " + wire.address();
  const RigDescription description = rig_with(
      "coils",
      {{"driver", text("kepco_bop")}, {"address", text(addresses.c_str())}, {"guardian", {false}}});
  const nlohmann::json rows = examine_rig(description);
  ASSERT_EQ(rows.size(), 1U);
  EXPECT_FALSE(rows[0]["present"]);
  EXPECT_EQ(rows[0]["why"],
            "channel 1: tcp:127.0.0.1:1: Connection refused; no zero was sent to it, so a current "
            "that was set before may still flow; every other channel has confirmed its zero (not "
            "found)");
  EXPECT_GE(wire.look([&] { return listener.count("CURR 0"); }), 2);
  EXPECT_FALSE(wire.look([&] { return other->output(); }));
}

TEST(Registry, OpensALampThatLightsTheEye) {
  const RigDescription description = rig_with("lamp", {{"output", {3.0}}});
  const auto clock = virtual_clock();
  const auto rig = open_rig(description, *clock, 1);
  EXPECT_NE(rig->rig().lamp->identity().find("output 3"), std::string::npos);
  rig->rig().lamp->set_level(0.5);
  EXPECT_EQ(rig->rig().lamp->level(), 0.5);
  EXPECT_TRUE(rig->make_safe().empty());
  EXPECT_EQ(rig->rig().lamp->level(), 0);
  expect_error(rig_with("lamp", {{"full_current", {2.0}}}), "lamp");  // more than 10 V ask for
}

TEST(Registry, NamesAStageWithoutAxesAndSettingsThatDoNotFit) {
  expect_error(rig_with("stage", {}), "at least one of the tables x, y and z");
  expect_error(
      rig_with("stage", {{"x", {ConfigTable{{"travel_min", {0.1}}, {"travel_max", {0.05}}}}}}),
      "travel_min");
  expect_error(rig_with("stage", {{"x", {ConfigTable{}}}, {"z", {ConfigTable{{"device", {1.0}}}}}}),
               "are the same one");
  expect_error(rig_with("stage", {{"address", text("hid:1234")}, {"x", {ConfigTable{}}}}),
               "stage.address");
}

TEST(Registry, KnowsARigWhoseInstrumentsAreReal) {
  EXPECT_FALSE(has_real_instruments(rig_with("coils", {})));
  EXPECT_FALSE(has_real_instruments(rig_with("coils", {{"address", text("emulated")}})));
  EXPECT_TRUE(has_real_instruments(rig_with("stage", {{"address", text("serial:/dev/ttyUSB0")}})));
}

TEST(PluggedIn, NamesTheDriverOfAPortWhoseIdentityTellsAndTheCandidatesOfAnother) {
  using Names = std::vector<std::string>;
  const auto drivers = [](const char* maker, const char* name, std::uint16_t vendor,
                          std::uint16_t product) {
    return drivers_for({"/dev/ttyUSB0", UsbIdentity{vendor, product, 0, "", maker, name, ""}});
  };
  EXPECT_EQ(drivers("", "", 0x1342, 0x0001), Names{"sutter_mpc200"});
  EXPECT_EQ(drivers("Zaber Technologies", "X-MCC2", 0x2939, 1), Names{"zaber"});
  EXPECT_EQ(drivers("Sutter", "", 0x0403, 0x6001), (Names{"sutter_mp285", "sutter_mpc200"}));
  const Names any{"kepco_bop", "scpi_logger", "scpi_probe", "sutter_mp285", "zaber"};
  EXPECT_EQ(drivers("FTDI", "FT232R USB UART", 0x0403, 0x6001), any);
  EXPECT_EQ(drivers_for({"/dev/ttyS0", std::nullopt}), any);
}

TEST(PluggedIn, SaysToPeopleThatTheRigFileDecides) {
  const nlohmann::json rows = {
      {{"bus", "serial"},
       {"address", "serial:/dev/ttyUSB0"},
       {"name", "FTDI FT232R USB UART"},
       {"place", "usb 1-2"},
       {"driver", ""},
       {"candidates", {"sutter_mp285", "zaber"}}},
      {{"bus", "usb"}, {"address", "usb:1234:5678"}, {"name", "x"}, {"driver", ""}}};
  const std::string said = to_text(rows);
  EXPECT_NE(said.find("FTDI FT232R USB UART"), std::string::npos) << said;
  EXPECT_NE(said.find("driver one of sutter_mp285, zaber, as the rig file says"), std::string::npos)
      << said;
  EXPECT_NE(said.find("no driver"), std::string::npos) << said;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
