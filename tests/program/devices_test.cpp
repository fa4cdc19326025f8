// `vitreo devices` and `vitreo emulate` as their users start them.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/driver.h"
#include "devices/instruments/zaber/driver.h"
#include "devices/links/serial_link.h"
#include "devices/roles/camera.h"
#include "devices/time/error.h"
#include "tests/long_form.h"
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <map>
#include <spawn.h>
#include <sys/file.h>
#include <thread>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
const std::string kSimulated = "'" VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua'";
const std::string kLaboratory = "'" VITREO_SOURCE_DIR "/scripts/rigs/octomag_lab.lua'";
const std::string kAmongEmulators = "emulate " + kLaboratory + " -- '" VITREO_PROGRAM "' ";

/// The GigE port is fixed and tests run side by side: one at a time.
struct GigePort {
  GigePort() : file(::open("/tmp/vitreo_gige_test.lock", O_CREAT | O_RDWR | O_CLOEXEC, 0666)) {
    flock(file, LOCK_EX);
  }
  ~GigePort() { ::close(file); }
  int file;
};

/// `vitreo emulate RIG`, until Ctrl-C.
class Emulate {
 public:
  Emulate(const Workplace& place, const std::string& rig) : place_(place) {
    std::string shell = "sh", option = "-c",
                script = "cd '" + place.folder().string() +
                         "' && exec '" VITREO_PROGRAM "' emulate " + rig +
                         " >offered 2>told </dev/null";
    char* words[] = {shell.data(), option.data(), script.data(), nullptr};
    posix_spawnp(&child_, "sh", nullptr, nullptr, words, environ);
  }
  ~Emulate() {
    if (child_ > 0) interrupt();
  }
  Emulate(const Emulate&) = delete;
  Emulate& operator=(const Emulate&) = delete;

  /// "stage: serial:/dev/pts/3, 115200 baud" as {"stage", "serial:/dev/pts/3"}, once `role` is
  /// among them.
  std::map<std::string, std::string> offers(const std::string& role) const {
    std::map<std::string, std::string> found;
    for (int i = 0; i < 600 && found.find(role) == found.end(); ++i) {
      std::this_thread::sleep_for(50ms);
      std::istringstream lines(place_.read("offered"));
      for (std::string line; std::getline(lines, line) && !lines.eof();)
        if (const auto colon = line.find(": "); colon != std::string::npos)
          found[line.substr(0, colon)] = line.substr(colon + 2, line.find(',') - colon - 2);
    }
    return found;
  }
  void kill() {
    ::kill(child_, SIGKILL);
    waitpid(std::exchange(child_, 0), nullptr, 0);
  }
  /// Its exit code.
  int interrupt() {
    ::kill(child_, SIGINT);
    int status = 0;
    waitpid(child_, &status, 0);
    child_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  const Workplace& place_;
  pid_t child_ = 0;
};

/// Rows by role.
std::map<std::string, nlohmann::json> roles_of(const Spoken& spoken) {
  std::map<std::string, nlohmann::json> roles;
  for (const auto& row : nlohmann::json::parse(spoken.out)) roles[row["role"]] = row;
  return roles;
}

TEST(Emulate, OffersPortsAndACameraThatAnyProgramCanOpenUntilCtrlC) {
  const GigePort port;
  const Workplace place;
  place.write("rig.lua",
              "return { top_camera = { width_px = 320, height_px = 240 }, coils = {},\n"
              "  stage = { driver = 'zaber', address = 'serial:/dev/ttyUSB7', z = {} } }");
  Emulate emulate(place, "rig.lua");
  const auto offered = emulate.offers("top_camera");
  ASSERT_EQ(offered.count("top_camera"), 1U) << place.read("told");
  ASSERT_EQ(offered.at("stage").rfind("serial:/dev/pts/", 0), 0U);
  const auto clock = wall_clock();
  const std::string node = offered.at("stage").substr(7);
  {
    zaber::Settings settings;
    const auto stage =
        zaber::open(open_serial(node, {.baud_rate = 115200}, *clock), settings, *clock);
    EXPECT_EQ(to_string(stage->info().identity), "Zaber device 50081, serial 12345, firmware 7.14");
    move_to(*stage, std::vector<double>{1e-3}, 5e-3, 10s, *clock);
    EXPECT_NEAR(stage->position()[0], 1e-3, 1e-7);
  }
  genicam::Settings wanted;
  wanted.camera = "127.0.0.1";
  wanted.width_px = 320;
  wanted.height_px = 240;
  wanted.frame_rate = 10;
  EXPECT_EQ(genicam::open(wanted, *clock)->grab(10s).image.cols, 320);
  EXPECT_EQ(emulate.interrupt(), 0);
  EXPECT_FALSE(std::filesystem::exists(node));
}

/// A camera from which a frame has come. The process that is to be the camera must have had its
/// turn by then: on a machine that has no time for it the camera is silent, rightly.
std::unique_ptr<Camera> open_and_grab(const genicam::Settings& wanted, Clock& clock) {
  for (int more = 3;; --more) {
    auto camera = genicam::open(wanted, clock);
    try {
      camera->grab(10s);
      return camera;
    } catch (const DeviceError&) {
      if (more == 0 || !machine_is_busy()) throw;
    }
  }
}

TEST(Emulate, AKilledCameraProcessIsALostCameraAndOneThatIsBackOpensAgain) {
  const GigePort port;
  const Workplace place;
  place.write("rig.lua", "return { top_camera = { width_px = 320, height_px = 240 }, coils = {} }");
  const auto clock = wall_clock();
  genicam::Settings wanted;
  wanted.camera = "127.0.0.1";
  wanted.width_px = 320;
  wanted.height_px = 240;
  wanted.frame_rate = 20;
  auto emulate = std::make_unique<Emulate>(place, "rig.lua");
  ASSERT_EQ(emulate->offers("top_camera").count("top_camera"), 1U) << place.read("told");
  auto camera = open_and_grab(wanted, *clock);
  emulate->kill();
  const Time killed = clock->now();
  try {
    for (;;) camera->grab(10s);
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::lost) << error.what();
    EXPECT_EQ(error.device, "camera");
  }
  EXPECT_LT(clock->now() - killed,
            3s);  // of the ten that a grab may take; the figure of 0.45 s is the bench's
  place.write("offered", "");
  emulate = std::make_unique<Emulate>(place, "rig.lua");
  ASSERT_EQ(emulate->offers("top_camera").count("top_camera"), 1U) << place.read("told");
  camera.reset();
  EXPECT_EQ(open_and_grab(wanted, *clock)->info().height_px, 240);
}

TEST(Devices, ListsTheRolesOfTheSimulatedRigAsJson) {
  const Workplace place;
  const Spoken spoken = place.vitreo("devices --json --rig " + kSimulated);
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  auto roles = roles_of(spoken);
  for (const char* role :
       {"top_camera", "side_camera", "coils", "lens_mover", "stage", "pose_sensor", "sample"}) {
    EXPECT_TRUE(roles[role]["present"].get<bool>()) << role;
    for (const char* key : {"driver", "link", "identity", "state", "limits"})
      EXPECT_TRUE(roles[role].contains(key)) << role << " has no " << key;
  }
  EXPECT_EQ(roles["coils"]["driver"], "usb3103");
  EXPECT_EQ(roles["stage"]["limits"][0]["travel_max"], 15e-3);
  const std::string text = place.vitreo("devices --rig " + kSimulated).out;
  EXPECT_EQ(text.find("missing"), std::string::npos) << text;
  EXPECT_NE(text.find("standing; at 0 mm; z -15 to 15 mm up to 20 mm/s"), std::string::npos)
      << text;
}

TEST(Devices, SaysWhichRoleIsMissingAndWhyAndShowsTheOthers) {
  const Workplace place;
  place.write(
      "rig.lua",
      "return { coils = {}, stage = { driver = 'sutter_mp285', address = 'serial:/dev/none' } }");
  const Spoken spoken = place.vitreo("devices --json --rig rig.lua");
  EXPECT_EQ(spoken.exit_code, 7) << "an instrument is missing";
  auto roles = roles_of(spoken);
  EXPECT_TRUE(roles["coils"]["present"].get<bool>());
  EXPECT_FALSE(roles["stage"]["present"].get<bool>());
  EXPECT_EQ(roles["stage"]["state"], "not found");
  EXPECT_EQ(roles["stage"]["why"], "serial:/dev/none: No such file or directory (not found)");
  const Spoken text = place.vitreo("devices --rig rig.lua");
  EXPECT_EQ(text.exit_code, 7);
  EXPECT_NE(text.out.find("missing: serial:/dev/none: No such file"), std::string::npos)
      << text.out;
}

TEST(Devices, EndsWithSevenWhereEveryRoleIsMissingAndWithZeroWithoutARig) {
  const Workplace place;
  place.write("rig.lua",
              "return { field_probe = { driver = 'scpi_probe', address = 'tcp:127.0.0.1:1', "
              "question = 'MEAS?' } }");
  EXPECT_EQ(place.vitreo("devices --rig rig.lua").exit_code, 7);
  EXPECT_EQ(place.vitreo("devices").exit_code, 0) << "nothing was asked for that could be missing";
}

TEST(Devices, RunsTheContractSuiteOfEachSimulatedRole) {
  const Workplace place;
  for (const char* role : {"coils", "lens_mover", "stage", "top_camera", "side_camera"}) {
    const Spoken spoken =
        place.vitreo(std::string("devices --test ") + role + " --rig " + kSimulated);
    EXPECT_EQ(spoken.out, std::string(role) + ": keeps its contract\n") << spoken.err;
    EXPECT_EQ(spoken.exit_code, 0) << role;
  }
  const Spoken none = place.vitreo("devices --test rotation_stage --rig " + kSimulated);
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_NE(none.err.find("rotation_stage"), std::string::npos) << none.err;
}

TEST(Devices, AsksWhatIsAtAPortAndPrintsATableThatARigFileTakes) {
  const GigePort port;
  const Workplace place;
  place.write("rig.lua",
              "return { stage = { driver = 'sutter_mp285', address = 'serial:/dev/ttyUSB7' } }");
  Emulate emulate(place, "rig.lua");
  const auto offered = emulate.offers("stage");
  ASSERT_EQ(offered.count("stage"), 1U) << place.read("told");
  const std::string node = offered.at("stage").substr(7);
  const Spoken spoken = place.vitreo("devices --ask " + node);
  EXPECT_EQ(spoken.exit_code, 0) << spoken.err;
  EXPECT_NE(spoken.err.find("will be sent"), std::string::npos) << "it is said beforehand";
  EXPECT_LT(spoken.err.find("any byte stops a Sutter MP-285"),
            spoken.err.find("sutter_mp285 at 9600 baud: Sutter MP-285"))
      << spoken.err;
  place.write("asked.lua", "return {\n" + spoken.out + "}\n");
  auto roles = roles_of(place.vitreo("devices --json --rig asked.lua"));
  EXPECT_TRUE(roles["stage"].value("present", false)) << roles["stage"] << spoken.out;
  const auto json = nlohmann::json::parse(place.vitreo("devices --json --ask " + node).out);
  EXPECT_EQ(json["found"][0]["driver"], "sutter_mp285");
  EXPECT_EQ(json["found"][0]["baud_rate"], 9600);
}

TEST(Devices, AskingSaysWhatCannotBeAskedAndWhy) {
  const Workplace place;
  const auto told = [&](const std::string& words, int code, const std::string& text) {
    const Spoken spoken = place.vitreo("devices --ask " + words);
    EXPECT_EQ(spoken.exit_code, code) << words << spoken.err;
    EXPECT_NE(spoken.err.find(text), std::string::npos) << words << ": " << spoken.err;
    EXPECT_EQ(spoken.err.find("will be sent"), std::string::npos) << words;
  };
  told("/dev/none", 7, "there is no such port");
  told("ttyUSB0", 2, "is not BUS:PLACE");
  told("emulated", 2, "there is nothing to be asked on this bus");
  told("hid:09db", 2, "hid:09db");
  told("hid:09db:009c", 7, "nothing with these numbers is plugged in");
  told("/dev/none --rig simulated", 2, "--ask is for an address");
}

#ifndef __SANITIZE_ADDRESS__  // umockdev refuses to run beside it
/// A run among emulated instruments, which answer in real time from a process of their own: a
/// second and a third time where a busy machine kept one from answering.
Spoken run_among_emulators(const Workplace& place, const std::string& words) {
  Spoken spoken = place.vitreo(words);
  for (int again = 0; again < 2; ++again) {
    if (spoken.exit_code == 0 || !machine_is_busy()) break;
    if (spoken.out.find("(timeout)") == std::string::npos) break;
    spoken = place.vitreo(words);
  }
  return spoken;
}

// The whole way of a person's work: question, hands in the emulated world, answer, photograph.
TEST(Laboratory, TheEmulatedTechnicianDoesWhatARunAsksForAndTheRunKnowsNoSimulator) {
  const GigePort port;
  const Workplace place;
  place.write("asks.lua", R"(
return { title = "asks", needs = { "top_camera", "side_camera", "sample" }, run = function(rig, p, run)
  assert(rig.simulation == nil, "a simulator in reach")
  rig.sample:remove_robot()
  run:wait(0.5)
  local empty = rig.top_camera:grab().image
  rig.sample:insert_robot { 0, 0, 0 }
  run:wait(0.5)
  rig.side_camera:grab()
  local seen = rig.top_camera:grab().image
  local middle = { x = 592, y = 418, width = 200, height = 200 }
  run:result("darker", empty:mean(middle).gray - seen:mean(middle).gray)
  assert(run:samples("truth") == nil, "a truth in the record")
end })");
  const Spoken spoken =
      run_among_emulators(place, kAmongEmulators + "run asks.lua --json --rig " + kLaboratory);
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  const auto told = nlohmann::json::parse(spoken.out);
  EXPECT_GT(told["results"]["darker"], 1) << "the robot is there";
  const std::string report = place.read(told["run"].get<std::string>() + "/report.html");
  EXPECT_NE(report.find("yes (the emulated technician)"), std::string::npos);
  EXPECT_NE(report.find("photograph: put the robot in"), std::string::npos);
}

TEST(Laboratory, OpensUnchangedAmongEmulatedInstruments) {
  const GigePort port;
  const Workplace place;
  const Spoken spoken = place.vitreo(kAmongEmulators + "devices --json --rig " + kLaboratory);
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  auto roles = roles_of(spoken);
  for (const char* role : {"top_camera", "coils", "lens_mover", "lamp", "joystick", "pedal",
                           "stage", "rotation_stage", "field_probe"}) {
    EXPECT_TRUE(roles[role].value("present", false)) << roles[role];
    EXPECT_NE(roles[role]["link"], "emulated");
  }
  EXPECT_EQ(roles["stage"]["firmware"], "3.12");
}

// The doctor sees them as the drivers do: below /sys and /dev.
TEST(Laboratory, IsHereForTheDoctor) {
  const GigePort port;
  const Workplace place;
  const Spoken spoken = place.vitreo(kAmongEmulators + "doctor --json --rig " + kLaboratory);
  std::map<std::string, std::string> found;
  for (const auto& finding : nlohmann::json::parse(spoken.out))
    if (finding["check"] == "instruments") found[finding["state"]] += finding["found"];
  EXPECT_EQ(
      found["good"],
      "here: coils, field_probe, joystick, lamp, lens_mover, pedal, rotation_stage and stage");
  EXPECT_EQ(found.count("fault"), 0u) << found["fault"];
  EXPECT_NE(found["unknown"].find("side_camera and top_camera"), std::string::npos);
}

TEST(Laboratory, EightSuppliesWhoseAddressesALoopMadeOpenAsOneAmplifier) {
  const GigePort port;  // its TCP ports are fixed too
  const Workplace place;
  const Spoken spoken =
      place.vitreo("emulate octomag_bop -- '" VITREO_PROGRAM "' devices --json --rig octomag_bop");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  const nlohmann::json coils = roles_of(spoken)["coils"];
  EXPECT_TRUE(coils.value("present", false)) << coils;
  EXPECT_EQ(coils["limits"]["channels"], 8);
  EXPECT_EQ(coils["identity"].get<std::string>().rfind("8 x KEPCO", 0), 0U) << coils;
}

// The links as the system has them: hidraw, libusb, terminals and TCP.
TEST(Laboratory, TracesEveryLinkOfARunWhenItIsAskedTo) {
  const GigePort port;
  const Workplace place;
  place.write("idle.lua",
              "return { title = 'idle', needs = { 'stage' }, run = function(rig, p, run)\n"
              "  rig.stage:position()\nend }");
  const Spoken spoken = run_among_emulators(
      place, kAmongEmulators + "run idle.lua --trace-links --rig " + kLaboratory);
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  std::map<std::string, std::string> to, from, address;
  for (const auto& row : nlohmann::json::parse(place.vitreo("show last --links --json").out)) {
    const std::string role = row["role"];
    address[role] = row["address"];
    if (row["event"] == "to") to[role] += row["hex"];
    if (row["event"] == "from") from[role] += row["hex"];
  }
  for (const char* role :
       {"coils", "lamp", "lens_mover", "stage", "rotation_stage", "field_probe"}) {
    EXPECT_FALSE(to[role].empty()) << role;
    EXPECT_FALSE(from[role].empty()) << role;
  }
  for (const char* role : {"joystick", "pedal"})  // they send when they are touched
    EXPECT_EQ(address[role].rfind("hid:", 0), 0U) << role;
  EXPECT_NE(to["stage"].find("630d"), std::string::npos) << "c, CR: where is it?";
}

TEST(Laboratory, IsListedWithTheDriversThatWouldTakeIt) {
  const GigePort port;
  const Workplace place;
  std::map<std::string, std::string> drivers, taken_as;
  for (const auto& row :
       nlohmann::json::parse(place.vitreo(kAmongEmulators + "devices --json").out)) {
    if (row.contains("address")) drivers[row["address"]] = row["driver"];
    if (row.contains("taken_as")) taken_as[row["address"]] = row["taken_as"];
  }
  EXPECT_EQ(taken_as["usb:05f3:0268"], "hid")
      << "one device, two addresses: only one of them has a driver";
  EXPECT_EQ(drivers["hid:09db:009c:01A2B3C4"], "usb3103");
  EXPECT_EQ(drivers["usb:1ffb:00b3:00123456"], "pololu_tic");
  EXPECT_EQ(drivers["hid:256f:c635:1"], "spacemouse");
  EXPECT_EQ(drivers["hid:05f3:0268:1"], "foot_pedal");
  EXPECT_EQ(drivers["genicam:Aravis-Fake-VITREO01"], "genicam");
}

TEST(Laboratory, AsksForADeviceOnUsbByItsNumbersAndForCamerasByDiscovery) {
  const GigePort port;
  const Workplace place;
  const Spoken hid = place.vitreo(kAmongEmulators + "devices --ask hid:09db:009c:01A2B3C4");
  EXPECT_EQ(hid.exit_code, 0) << hid.err;
  EXPECT_NE(hid.out.find("coils = { -- "), std::string::npos) << hid.out;
  EXPECT_NE(hid.out.find("  address = \"hid:09db:009c:01A2B3C4\",\n"), std::string::npos)
      << hid.out;
  EXPECT_NE(hid.out.find("-- lamp = { -- "), std::string::npos) << "or it is a lamp's: " << hid.out;
  const Spoken cameras = place.vitreo(kAmongEmulators + "devices --json --ask genicam");
  ASSERT_EQ(cameras.exit_code, 0) << cameras.err;
  const auto found = nlohmann::json::parse(cameras.out)["found"];
  ASSERT_EQ(found.size(), 2U) << found;
  EXPECT_NE(found[0]["tables"][0]["text"].get<std::string>().find("width_px = "), std::string::npos)
      << found;
}

TEST(Laboratory, ItsInstrumentsKeepTheirContractsOnTheSystemsOwnPath) {
  const GigePort port;
  const Workplace place;
  std::vector<std::string> roles{"coils"};  // the others wait for real: long
  if (in_long_form())
    roles = {"coils", "lamp",           "lens_mover",  "joystick",  "pedal",
             "stage", "rotation_stage", "field_probe", "top_camera"};
  for (const std::string& role : roles) {
    const Spoken spoken =
        place.vitreo(kAmongEmulators + "devices --test " + role + " --rig " + kLaboratory);
    EXPECT_EQ(spoken.out, role + ": keeps its contract\n") << spoken.err;
  }
}
#endif

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
