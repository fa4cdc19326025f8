// `vitreo doctor` as a technician starts it: exit codes, JSON, and commands that do what they say.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cstdlib>
#include <fstream>
#include <set>
#include <sstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

const char* const kStage = R"(
return {
  base = "simulated",
  stage = { driver = "zaber", address = "serial:/dev/ttyUSB7", z = { device = 1 } },
}
)";

std::string packaged_rules() {
  std::ostringstream text;
  text << std::ifstream(VITREO_SOURCE_DIR "/packaging/60-vitreo.rules").rdbuf();
  return text.str();
}

TEST(DoctorCommand, ItsCodeIsThatOfWhatItFound) {
  const Workplace place;
  place.write("bench.lua", kStage);
  const Spoken here = place.vitreo("doctor --json");
  bool fault = false;
  for (const auto& finding : nlohmann::json::parse(here.out))
    fault = fault || finding["state"] == "fault";
  EXPECT_EQ(here.exit_code, fault ? 8 : 0) << here.out << here.err;
  // A machine that tells nothing: only what the rig names can be a fault there.
  std::filesystem::create_directory(place.folder() / "silent");
  const Spoken missing = place.vitreo("doctor --rig bench.lua --root silent");
  EXPECT_EQ(missing.exit_code, 7) << missing.out;
  EXPECT_NE(missing.out.find("stage: /dev/ttyUSB7 is not there"), std::string::npos);
  EXPECT_EQ(place.vitreo("doctor --rig simulated --root silent").exit_code, 0);
  EXPECT_EQ(place.vitreo("doctor --root silent").exit_code, 8) << "no rules";
}

TEST(DoctorCommand, NamesWhatTheRigsFileSaysInVain) {
  const Workplace place;
  place.write("odd.lua", R"(return {
    base = "plain_sight",
    model = { uncertainty = { bench = { lens_tilt = 0.01 } } },
  })");
  const auto finding_of = [&place](const std::string& rig) {
    const Spoken spoken = place.vitreo("doctor --json --root / --rig " + rig);
    for (auto finding : nlohmann::json::parse(spoken.out))
      if (finding["check"] == "rig") return finding;
    return nlohmann::json{{"state", "none"}, {"found", ""}};
  };
  EXPECT_EQ(finding_of("plain_sight")["state"], "none");
  const auto odd = finding_of("odd.lua");
  EXPECT_EQ(odd["state"], "warning");
  EXPECT_NE(odd["found"].get<std::string>().find("lens_tilt: nothing reads it"), std::string::npos)
      << odd;
}

TEST(DoctorCommand, RefusesARigOrARootThatIsNotThere) {
  const Workplace place;
  for (const char* const words : {"--rig nowhere", "--root nowhere"}) {
    const Spoken spoken = place.vitreo(std::string("doctor ") + words);
    EXPECT_EQ(spoken.exit_code, 2);
    EXPECT_NE(spoken.err.find("nowhere"), std::string::npos) << spoken.err;
    EXPECT_EQ(spoken.out, "");
  }
}

TEST(DoctorCommand, TheJsonHasWhatTheTextHas) {
  const Workplace place;
  const auto findings = nlohmann::json::parse(place.vitreo("doctor --json").out);
  const std::string text = place.vitreo("doctor").out;
  const std::set<std::string> states{"good", "unknown", "warning", "fault"};
  for (const auto& finding : findings) {
    EXPECT_TRUE(states.contains(finding["state"])) << finding;
    EXPECT_FALSE(finding["found"].get<std::string>().empty()) << finding;
    for (const std::string command : finding["mend"])
      EXPECT_NE(text.find(command + "\n"), std::string::npos) << command;
  }
}

// The command ends in `sudo tee`: what comes before the bar is run as it is printed.
TEST(DoctorCommand, ItsCommandForTheRulesPrintsThePackagedOnes) {
  const Workplace place;
  std::filesystem::create_directory(place.folder() / "silent");
  std::string printed;
  for (const auto& finding : nlohmann::json::parse(place.vitreo("doctor --json --root silent").out))
    if (finding["check"] == "udev_rules") printed = finding["mend"][0];
  const auto bar = printed.find(" | sudo tee /etc/udev/rules.d/60-vitreo.rules");
  ASSERT_NE(bar, std::string::npos) << printed;
  const std::string into = (place.folder() / "rules").string();
  ASSERT_EQ(std::system((printed.substr(0, bar) + " >'" + into + "'").c_str()), 0) << printed;
  EXPECT_EQ(place.read("rules"), packaged_rules());
}

TEST(DoctorCommand, RulesPutInPlaceAreFoundThere) {
  const Workplace place;
  const auto folder = place.folder() / "silent/etc/udev/rules.d";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "60-vitreo.rules") << packaged_rules();
  std::string state;
  for (const auto& finding : nlohmann::json::parse(place.vitreo("doctor --json --root silent").out))
    if (finding["check"] == "udev_rules") state = finding["state"];
  EXPECT_EQ(state, "good");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
