// docs/how-to/first_day.md, typed at a terminal among emulated instruments, and `vitreo new rig`
// without one.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"
#include "tests/program/terminal.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <fcntl.h>
#include <map>
#include <sys/file.h>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// A rig without hardware that needs no answer but these.
const char* const kSupplies =
    "# two supplies\n"
    "title = Two supplies\n"
    "top_camera = genicam\ntop_camera.address = genicam:192.168.1.7\n"
    "top_camera.width_px = 1384\ntop_camera.height_px = 1036\n"
    "top_camera.effective_pixel = 14.3 um\ntop_camera.frame_rate = 15 Hz\n"
    "side_camera = genicam\nside_camera.address = genicam:192.168.1.8\n"
    "side_camera.width_px = 656\nside_camera.height_px = 490\n"
    "side_camera.effective_pixel = 20.4 um\n"
    "coils = kepco_bop\ncoils.supplies = 8\ncoils.supply 1 = tcp:10.0.0.11:5025\n"
    "coils.current_limit = 12 A\ncoils.voltage_limit = 20 V\n";

TEST(NewRigCommand, AnswersInAFileMakeARigThatPassesTheCheck) {
  const Workplace place;
  place.write("answers", kSupplies);
  const Spoken made = place.vitreo("new rig bench --answers answers --json");
  ASSERT_EQ(made.exit_code, 0) << made.out << made.err;
  EXPECT_EQ(nlohmann::json::parse(made.out)["files"][0], "bench.lua");
  EXPECT_TRUE(has(place.read("bench.lua"), "tcp:10.0.0.11:5025, tcp:10.0.0.12:5025"))
      << place.read("bench.lua");
  const Spoken checked = place.vitreo("check hold --rig bench.lua");
  EXPECT_EQ(checked.exit_code, 0) << checked.out << checked.err;
  EXPECT_TRUE(has(checked.out, "passed")) << checked.out;
}

TEST(NewRigCommand, WithoutATerminalOrAnswersItSaysWhatItWants) {
  const Workplace place;
  const Spoken none = place.vitreo("new rig bench");
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_TRUE(has(none.err, "give --answers FILE")) << none.err;
  const Spoken some = place.vitreo("new rig bench", "A title\n");
  EXPECT_EQ(some.exit_code, 2);
  EXPECT_TRUE(has(some.err, "the answers end before ")) << some.err;
  EXPECT_FALSE(fs::exists(place.folder() / "bench.lua"));
}

TEST(NewRigCommand, AnAnswerThatIsMissingWrongOrNotAskedForIsNamedAndNothingIsWritten) {
  const Workplace place;
  const auto refused = [&](const std::string& answers, const std::string& text) {
    place.write("answers", answers);
    const Spoken spoken = place.vitreo("new rig bench --answers answers --json");
    EXPECT_EQ(spoken.exit_code, 2) << answers;
    EXPECT_TRUE(has(spoken.err, text)) << spoken.err;
    EXPECT_FALSE(fs::exists(place.folder() / "bench.lua"));
  };
  const std::string all = kSupplies;
  refused(all + "coils.amperes_per_volt = 2\n",
          "answers:19: coils.amperes_per_volt: was not asked for");
  refused(all.substr(0, all.find("coils.voltage_limit")), "has no answer to coils.voltage_limit");
  refused(all.substr(0, all.find("12 A")) + "30 A\ncoils.voltage_limit = 20 V\n",
          "coils.current_limit is 30 A; it must be 0.1 to 20 A");
  refused("coils\n", "answers:1: wants key = answer");
  EXPECT_EQ(place.vitreo("new rig bench --answers nowhere").exit_code, 2);
}

TEST(NewRigCommand, NoFileIsWrittenOverAndNoNameIsGivenTwice) {
  const Workplace place;
  place.write("answers", kSupplies);
  place.write("bench.lua", "return {}");
  const auto refused = [&](const std::string& words, const std::string& text) {
    const Spoken spoken = place.vitreo("new rig " + words + " --answers answers");
    EXPECT_EQ(spoken.exit_code, 2) << words;
    EXPECT_TRUE(has(spoken.err, text)) << words << ": " << spoken.err;
  };
  refused("bench", "bench.lua: is there already");
  refused("bench.lua", "bench.lua: is there already");
  EXPECT_EQ(place.read("bench.lua"), "return {}");
  refused("octomag_lab", "a rig named octomag_lab is among the program's own");
  refused("nowhere/bench", "nowhere: there is no such folder");
  refused("'My Bench'", "is not a name");
  refused("bench stage", "takes a name and no role");
  EXPECT_FALSE(fs::exists(place.folder() / "octomag_lab.lua"));
  const Spoken protocol = place.vitreo("new protocol x --answers answers");
  EXPECT_TRUE(has(protocol.err, "--answers is for new rig alone")) << protocol.err;
  EXPECT_TRUE(has(place.vitreo("new protocol").err, "a name is missing"));
}

TEST(NewRigCommand, AtATerminalAWrongAnswerIsAskedAgainAndQuitWritesNothing) {
  const Workplace place;
  Terminal terminal(place.folder(), "new rig");
  ASSERT_TRUE(terminal.sees("Name of the rig"));
  terminal.type("My Bench\n");
  ASSERT_TRUE(terminal.sees("is not a name"));
  ASSERT_TRUE(terminal.sees("Name of the rig"));
  terminal.type("bench\n");
  ASSERT_TRUE(terminal.sees("Title"));
  terminal.type("?\n");
  ASSERT_TRUE(terminal.sees("each report"));
  terminal.type("back\n");
  ASSERT_TRUE(terminal.sees("[bench]"));
  terminal.type("\n");
  ASSERT_TRUE(terminal.sees("Title"));
  terminal.type("quit\n");
  EXPECT_TRUE(terminal.sees("nothing is written"));
  EXPECT_EQ(terminal.end(), 3);
  EXPECT_FALSE(fs::exists(place.folder() / "bench.lua"));
}

TEST(NewRigCommand, TheEndOfInputAtATerminalLeavesLikeQuit) {
  const Workplace place;
  Terminal terminal(place.folder(), "new rig bench");
  ASSERT_TRUE(terminal.sees("Title"));
  terminal.type("\x04");
  EXPECT_EQ(terminal.end(), 3);
  EXPECT_FALSE(fs::exists(place.folder() / "bench.lua"));
}

#ifndef __SANITIZE_ADDRESS__  // umockdev refuses to run beside it

/// The page's blocks, by the word behind the three strokes.
std::map<std::string, std::string> page_blocks() {
  std::ifstream page(VITREO_SOURCE_DIR "/docs/how-to/first_day.md");
  std::map<std::string, std::string> blocks;
  std::string* block = nullptr;
  for (std::string line; std::getline(page, line);) {
    if (line.starts_with("```"))
      block = block == nullptr ? &blocks[line.substr(3)] : nullptr;
    else if (block != nullptr)
      *block += line + "\n";
  }
  return blocks;
}

/// The answers of the page, in its order, by their keys.
std::vector<std::pair<std::string, std::string>> page_answers(const std::string& block) {
  std::vector<std::pair<std::string, std::string>> answers;
  std::istringstream lines(block);
  for (std::string line; std::getline(lines, line);)
    if (const auto at = line.find(" = "); at != std::string::npos)
      answers.emplace_back(line.substr(0, at), line.substr(at + 3));
  return answers;
}

/// The GigE ports are fixed and tests run side by side: one at a time.
struct FirstDay : ::testing::Test {
  FirstDay() : file_(::open("/tmp/vitreo_gige_test.lock", O_CREAT | O_RDWR | O_CLOEXEC, 0666)) {
    flock(file_, LOCK_EX);
    const std::string path = std::getenv("PATH") == nullptr ? "" : std::getenv("PATH");
    setenv("PATH", (fs::path(VITREO_PROGRAM).parent_path().string() + ":" + path).c_str(), 1);
    setenv("PS1", "# ", 1);
  }
  ~FirstDay() override { ::close(file_); }

 private:
  int file_;
};

/// How the question of a key begins on the screen.
std::string question_of(const std::string& key) {
  if (key == "another") return "Another address";
  if (key.starts_with("ask ")) return "Ask what is at " + key.substr(4) + "?";
  return "\n" + key + ": ";
}

/// Types the page's answers, and Enter for what the page has no answer to, until the file is there.
void be_interviewed(Terminal& terminal, const std::string& block) {
  std::size_t asked = 0;
  for (const auto& [key, answer] : page_answers(block)) {
    for (;; ++asked) {
      ASSERT_LT(asked, 200U) << key << " was never asked\n" << terminal.unseen();
      // A question ends in a colon and a blank, and then the program waits.
      ASSERT_TRUE(terminal.sees_end(": ", 60s)) << key << "\n" << terminal.screen();
      const std::string shown = terminal.take_unseen();
      if (has(shown, question_of(key))) break;
      terminal.type("\n");
    }
    terminal.type(answer + "\n");
  }
  for (; asked < 200; ++asked) {
    ASSERT_TRUE(terminal.sees_end(": ", 60s)) << terminal.screen();
    const bool last = has(terminal.take_unseen(), "Write this to bench.lua?");
    terminal.type("\n");
    if (last) return;
  }
}

TEST_F(FirstDay, TheFiveStepsWorkAtATerminalAmongEmulatedInstruments) {
  const Workplace place;
  auto blocks = page_blocks();
  Terminal terminal(place.folder(), "emulate octomag_lab -- sh", 200);
  ASSERT_TRUE(terminal.sees("# ", 30s)) << terminal.screen();
  std::istringstream commands(blocks["sh"]);
  std::map<std::string, std::string> shown;
  int count = 0;
  for (std::string command; std::getline(commands, command); ++count) {
    terminal.take_unseen();
    terminal.type(command + "; echo \"code $?.\"\n");
    ASSERT_TRUE(terminal.sees("\"\r\n"));  // its own echo
    if (command == "vitreo new rig bench") be_interviewed(terminal, blocks["text"]);
    if (HasFatalFailure()) return;
    ASSERT_TRUE(terminal.sees_end("# ", 60s)) << command << "\n" << terminal.screen();
    shown[command] = terminal.take_unseen();
  }
  EXPECT_EQ(count, 6);
  EXPECT_TRUE(has(shown["vitreo doctor"], "USB speed")) << shown["vitreo doctor"];
  EXPECT_TRUE(has(shown["vitreo devices"], "driver usb3103")) << shown["vitreo devices"];
  EXPECT_TRUE(has(shown["vitreo devices --ask /dev/ttyUSB0"], "driver = \"sutter_mp285\""));
  EXPECT_TRUE(has(shown["vitreo new rig bench"], "bench.lua is written"))
      << shown["vitreo new rig bench"];
  const std::string devices = shown["vitreo devices --rig bench.lua"];
  EXPECT_TRUE(has(devices, "code 0.")) << devices;
  EXPECT_FALSE(has(devices, "missing")) << devices;
  for (const char* role : {"top_camera", "side_camera", "coils", "stage", "lens_mover", "lamp",
                           "joystick", "pedal", "field_probe", "sample"})
    EXPECT_TRUE(has(devices, "\n" + std::string(role) + " ") || devices.starts_with(role)) << role;
  EXPECT_TRUE(has(shown["vitreo check hold --rig bench.lua"], "passed"))
      << shown["vitreo check hold --rig bench.lua"];
  terminal.type("exit\n");
  EXPECT_EQ(terminal.end(), 0);
  EXPECT_TRUE(has(place.read("bench.lua"), "dead_man") == false) << "none was typed";
}

// As a script would: the same answers, from the page, as a file.
TEST_F(FirstDay, ThePagesAnswersAreAFileOfAnswers) {
  const Workplace place;
  place.write("answers", page_blocks()["text"]);
  const Spoken made = place.vitreo("emulate octomag_lab -- '" VITREO_PROGRAM
                                   "' new rig bench --answers answers --json");
  ASSERT_EQ(made.exit_code, 0) << made.out << made.err;
  EXPECT_TRUE(has(place.read("bench.lua"), "driver = \"scpi_probe\""));
}
#endif

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
