// The live view as its user meets it: the real program, and headless Chromium with real clicks
// (tests/page/live_view.mjs).
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <regex>
#include <sys/stat.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

bool there(const std::string& what) {
  return std::system(("command -v " + what + " >/dev/null 2>&1").c_str()) == 0;
}

bool browser_there() {
  const bool has_page = !std::filesystem::exists(VITREO_PAGE_TEST "/../../page/notice");
  return has_page && there("node") && there("chromium") &&
         std::filesystem::exists(VITREO_PAGE_TEST "/node_modules");
}

/// A loop that is held up for 250 ms trips its dead-man, rightly; on a busy machine that says
/// nothing of the page.
bool held_up(const Workplace& place) {
  const std::string said = place.read("out") + place.read("err");
  return said.find("dead-man: the host has not moved") != std::string::npos && machine_is_busy();
}

/// Runs `vitreo WORDS` beside the browser, which does `task`, a second and a third time where the
/// machine held it up; what the browser saw. The program's exit code is in "code".
nlohmann::json watched(const Workplace& place, const std::string& words, const std::string& task) {
  // When the browser is done the program may still write its report.
  place.write("work.sh",
              "'" VITREO_PROGRAM "' " + words +
                  " >out 2>err &\n"
                  "program=$!\n"
                  "for i in $(seq 150); do\n"
                  "  address=$(cat out err | grep -o 'http://127.0.0.1:[0-9]*/?token=[0-9a-f]*' | "
                  "head -n 1)\n"
                  "  [ -n \"$address\" ] && break\n"
                  "  sleep 0.1\n"
                  "done\n"
                  "timeout 150 node " VITREO_PAGE_TEST
                  "/live_view.mjs \"$address\" . \"$(command -v chromium)\" " +
                  task +
                  " >seen 2>seen.err\n"
                  "for i in $(seq 100); do kill -0 $program 2>/dev/null || break; sleep 0.1; done\n"
                  "kill -INT $program 2>/dev/null\n"
                  "wait $program\n"
                  "echo $? >code\n");
  const std::string work = "cd '" + place.folder().string() + "' && rm -rf runs && sh work.sh";
  EXPECT_EQ(std::system(work.c_str()), 0);
  for (int again = 0; again < 2 && held_up(place); ++again) EXPECT_EQ(std::system(work.c_str()), 0);
  if (const char* keep = std::getenv("VITREO_KEEP_PICTURES"))
    std::system(("cp '" + place.folder().string() + "'/*.png '" + keep + "'").c_str());
  const auto seen = nlohmann::json::parse(place.read("seen"), nullptr, false);
  EXPECT_TRUE(seen.is_object()) << place.read("seen") << place.read("seen.err")
                                << place.read("err");
  if (!seen.is_object()) return nlohmann::json::object();
  EXPECT_FALSE(seen.contains("failed")) << seen << place.read("err");
  EXPECT_TRUE(seen["errors"].empty()) << seen["errors"];
  return seen;
}

/// Under a sanitizer.
constexpr bool too_slow() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  return true;
#else
  return false;
#endif
}

/// "target z 0.35 mm"
double millimeters(const nlohmann::json& text) {
  std::smatch number;
  const std::string words = text;
  return std::regex_search(words, number, std::regex("target z (-?[0-9.]+) mm"))
             ? std::stod(number[1])
             : std::nan("");
}

/// "8.4 um" or "-0.87 mm" in mm.
double quantity_mm(const std::string& text) {
  const double number = std::stod(text);
  return text.ends_with(" \u00b5m") ? number / 1000 : text.ends_with(" nm") ? number / 1e6 : number;
}

TEST(LiveView, ShowsSteersAndStopsARun) {
  if (too_slow())
    GTEST_SKIP() << "a loop that cannot keep the pace of the clock trips its dead-man, rightly";
  if (!browser_there()) GTEST_SKIP() << "wants node, chromium, and npm when this was built";
  const Workplace place;
  std::string rig = place.read(VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua");
  const std::size_t last = rig.rfind('}');
  ASSERT_NE(last, std::string::npos);
  // A push of 0.6 of full deflection for 1 s at 0.5 mm/s, up by 0.3 mm, again and again: the
  // browser may be slow to begin.
  rig.insert(last,
             "  joystick = { driver = \"spacemouse\", address = \"emulated\", pushed = { 0, 0, 0.6 "
             "}, pushed_from = 6 * s,\n"
             "    pushed_for = 1 * s, pushed_every = 6 * s },\n");
  place.write("rig.lua", rig);
  auto seen = watched(place, "view --operator 'Eve <b>Bold</b>' --rig rig.lua", "steer");
  ASSERT_TRUE(seen.contains("state")) << seen;
  EXPECT_EQ(seen["addressAfter"].get<std::string>().find("token"), std::string::npos);
  EXPECT_NE(seen["withoutControl"].get<std::string>().find("take control first"),
            std::string::npos);
  EXPECT_EQ(seen["note"].get<std::string>().rfind("target ", 0), 0U) << seen["note"];
  const double rise = millimeters(seen["aimAfter"]) - millimeters(seen["aimBefore"]);
  EXPECT_GT(rise, 0) << seen;
  EXPECT_LT(rise, 0.38) << "one push, and a look of 0.1 s at either end";
  EXPECT_EQ(seen["whiteBefore"], 0);
  EXPECT_GT(seen["whiteDrawing"], 2) << "the path shows while it is drawn";
  EXPECT_NE(seen["distance"].get<std::string>().find("mm"), std::string::npos);
  EXPECT_EQ(seen["markup"], false) << "the operator's name is text";
  EXPECT_EQ(seen["secondVisit"], 403);
  EXPECT_EQ(seen["state"], "Stopped");
  EXPECT_EQ(seen["rest"].get<std::string>().rfind("Coils set to 0 A", 0), 0U)
      << "and not the last set-points";
  EXPECT_EQ(seen["acting"], 0) << "dead buttons are off";
  EXPECT_EQ(seen["report"], "Steering by hand: stopped");
  for (const auto& shown : seen["coils"]) EXPECT_EQ(shown, "–");
  EXPECT_EQ(place.read("code"), "3\n") << place.read("out") << place.read("err");
  const std::string said = place.read("out") + place.read("err");
  EXPECT_NE(said.find("target 1:"), std::string::npos);
  EXPECT_TRUE(std::regex_search(said, std::regex("target 2: .*, the first of [0-9]{2}"))) << said;
}

/// "target 1.30, 0.43, 0.00 mm" as the report's table has it.
std::vector<std::string> coordinates(const std::string& note) {
  std::smatch parts;
  if (!std::regex_search(note, parts, std::regex("target (\\S+), (\\S+), (\\S+) mm"))) return {};
  return {parts[1], parts[2], parts[3]};
}

TEST(LiveView, SupervisedServoingVisitsWhatIsClickedAndEndsWhenItIsEnough) {
  if (too_slow())
    GTEST_SKIP() << "a loop that cannot keep the pace of the clock trips its dead-man, rightly";
  if (!browser_there()) GTEST_SKIP() << "wants node, chromium, and npm when this was built";
  const Workplace place;
  auto seen = watched(place, "view servo_supervised points=view speed=2mm/s", "supervise");
  ASSERT_TRUE(seen.contains("stopInSight")) << seen;
  EXPECT_EQ(seen["stopInSight"], true) << "on a tablet, at the page's end";
  EXPECT_EQ(seen["bar"]["level"], "free");
  EXPECT_GE(seen["bar"]["spread"], 3);
  EXPECT_GT(seen["bar"]["body"], 10);
  EXPECT_EQ(seen["bar"]["near"], 0) << "further than 2 mm";
  EXPECT_NE(seen["near"]["text"].get<std::string>().find("near"), std::string::npos)
      << seen["near"];
  EXPECT_NE(seen["near"]["clearance"].get<std::string>().find("±"), std::string::npos);
  EXPECT_EQ(seen["near"]["bar"]["level"], "near");
  EXPECT_GT(seen["near"]["bar"]["near"], 20) << "in the last 2 mm";
  EXPECT_NE(seen["refused"].get<std::string>().find("mm must be left"), std::string::npos)
      << seen["refused"];
  EXPECT_EQ(place.read("code"), "0\n") << place.read("out") << place.read("err");
  const std::string said = place.read("err");
  const auto shown = nlohmann::json::parse(place.vitreo("show last --json").out);
  EXPECT_GE(shown["results"]["points_reached"], 3) << shown["results"];
  ASSERT_EQ(seen["places"].size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    const auto clicked = coordinates(seen["places"][i]);
    ASSERT_EQ(clicked.size(), 3U) << seen["places"];
    std::smatch visited;
    const std::string pattern = " at ([^,]+), ([^,]+), ([^:]+): reached";
    ASSERT_TRUE(
        std::regex_search(said, visited, std::regex("point " + std::to_string(i + 1) + pattern)))
        << said;
    for (std::size_t axis = 0; axis < 3;
         ++axis)  // with other digits: 0.00 mm here, 8.4 \u00b5m there
      EXPECT_NEAR(quantity_mm(visited[axis + 1]), std::stod(clicked[axis]), 0.006) << visited[0];
  }
}

TEST(LiveView, QuestionsAreAnsweredByButtonsAndARunPausesAndGoesOn) {
  if (!browser_there()) GTEST_SKIP() << "wants node, chromium, and npm when this was built";
  const Workplace place;
  place.write(
      "asks.lua",
      "local units = require 'units'\n"
      "return { title = 'Asks', run = function(rig, p, run)\n"
      "  run:note('fixed: ' .. tostring(run:confirm('Is the eye fixed?')))\n"
      "  run:note('height: ' .. format_quantity(run:ask('How high?', { unit = 'mm', min = 0, max "
      "= 5 * units.mm }), 'm'))\n"
      "  run:note('eye: ' .. run:ask('Which eye?', { choices = { 'left', 'right' } }))\n"
      "  local step, last = 0, 600\n"  // until it was paused, however slowly the page works
      "  while step < last do\n"
      "    local before = run:now()\n"
      "    run:checkpoint('step')\n"
      "    step = step + 1\n"
      "    if run:now() - before > 0.8 then last = step + 20 end\n"
      "    run:note('step ' .. step)\n"
      "    run:wait(0.1)\n"
      "  end\n"
      "  run:note('enough')\n"
      "end }\n");
  auto seen = watched(place, "view asks.lua", "answer");
  EXPECT_EQ(seen["lookingOn"], true) << "who looks on answers nothing";
  EXPECT_NE(seen["wrong"].get<std::string>().find("Refused: "), std::string::npos) << seen["wrong"];
  EXPECT_LE(seen["whilePaused"], 0);
  EXPECT_GT(seen["afterPause"], 2);
  EXPECT_EQ(place.read("code"), "0\n") << place.read("out") << place.read("err");
  const std::string said = place.read("out") + place.read("err");
  for (const char* words : {"fixed: true", "height: 1.5 mm", "eye: left", "enough"})
    EXPECT_NE(said.find(words), std::string::npos) << words << " in " << said;
}

// Of a suite of its own: no run is behind this page, so other tests may run beside it.
TEST(PageLayout, FitsSixSizesAndSaysWhatStandsInEveryState) {
  if (!browser_there()) GTEST_SKIP() << "wants node, chromium, and npm when this was built";
  const Workplace place;
  ASSERT_EQ(std::system(("timeout 880 node " VITREO_PAGE_TEST "/layout.mjs '" VITREO_PAGE_TEST
                         "/../../page/dist' - \"$(command -v chromium)\" >'" +
                         (place.folder() / "seen").string() + "' 2>'" +
                         (place.folder() / "seen.err").string() + "'")
                            .c_str()),
            0)
      << place.read("seen.err");
  const auto seen = nlohmann::json::parse(place.read("seen"), nullptr, false);
  ASSERT_TRUE(seen.is_object()) << place.read("seen");
  for (const auto& sentence : seen["failed"]) ADD_FAILURE() << sentence.get<std::string>();
  EXPECT_GE(seen["shares"]["1366x768"], 0.45) << "of the screen for the eye";
  EXPECT_GE(seen["shares"]["1920x1080"], 0.45);
}

TEST(LiveView, IsServedToOtherMachinesOnlyWithATokenFileOfOnesOwn) {
  const Workplace place;
  place.write("short", "1234\n");
  place.write("open", std::string(32, 'a') + "\n");
  std::filesystem::permissions(place.folder() / "short", std::filesystem::perms(0600));
  std::filesystem::permissions(place.folder() / "open", std::filesystem::perms(0644));
  std::filesystem::create_symlink("short", place.folder() / "link");
  const auto refused = [&place](const std::string& words, const std::string& why) {
    const Spoken spoken = place.vitreo("run hello_rig " + words);
    EXPECT_EQ(spoken.exit_code, 2) << words;
    EXPECT_NE(spoken.err.find(why), std::string::npos) << words << ": " << spoken.err;
  };
  refused("--view --listen 192.168.7.7",
          "can be reached from other machines, so it wants --token-file");
  refused("--view --listen fd00::5", "so it wants --token-file");
  refused("--view --listen 0.0.0.0 --token-file mine", "is every address at once");
  refused("--view --listen :: --token-file mine", "is every address at once");
  refused("--view --listen laboratory", "wants an IP address");
  refused("--view --token-file short", "32 or more hexadecimal digits");
  refused("--view --token-file open", "others may read or write it; chmod 600 open");
  refused("--view --token-file link", "is a link");
  refused("--view --token-file .", "is no plain file");
  refused("--view --token-file no/such/folder/token", "cannot be made");
  refused("--listen 127.0.0.2", "wants --view");
  EXPECT_EQ(place.runs(), 0) << "nothing was opened";
  const Spoken spoken =
      place.vitreo("run hello_rig --quiet --view --listen 127.0.0.2 --token-file made");
  EXPECT_EQ(spoken.exit_code, 0) << spoken.err;
  const std::string said = spoken.out + spoken.err, token = place.read("made");
  EXPECT_NE(said.find("http://127.0.0.2:"), std::string::npos) << said;
  EXPECT_EQ(token.size(), 33U);
  EXPECT_EQ(said.find(token.substr(0, 32)), std::string::npos) << "the token stays in its file";
  struct stat about = {};
  ASSERT_EQ(stat((place.folder() / "made").c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777, 0600U);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
