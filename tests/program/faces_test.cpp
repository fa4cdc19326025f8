// The faces of the built program on the command line: help, completion, docs, reports, starting
// points.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"
#include "tests/program/terminal.h"

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

std::string file_text(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(Help, OfEveryCommandIsTheGoldenOne) {
  const Workplace place;
  EXPECT_EQ(place.vitreo("--help").out,
            file_text(VITREO_SOURCE_DIR "/tests/program/golden/vitreo.txt"));
  std::istringstream commands(place.vitreo("complete -- ''").out);
  int count = 0;
  for (std::string command; std::getline(commands, command); ++count) {
    const Spoken spoken = place.vitreo(command + " --help");
    EXPECT_EQ(spoken.exit_code, 0) << command;
    EXPECT_EQ(spoken.out, file_text(VITREO_SOURCE_DIR "/tests/program/golden/" + command + ".txt"))
        << "make reference prints them anew";
    EXPECT_TRUE(contains(spoken.out, "For instance\n  vitreo ")) << command;
  }
  EXPECT_GE(count, 18);
}

TEST(Help, OfARunWithAProtocolIsAboutTheProtocol) {
  const Workplace place;
  const Spoken spoken = place.vitreo("run drift_test --help");
  EXPECT_EQ(spoken.exit_code, 0);
  for (const char* words :
       {"drift_test: ", "needs: ", "hold", "for instance: vitreo run drift_test "})
    EXPECT_TRUE(contains(spoken.out, words)) << words << " in " << spoken.out;
  EXPECT_EQ(place.vitreo("run nothing_like_it --help").exit_code, 2);
}

TEST(Help, EachCommandHasExamplesOfItsOwn) {
  const Workplace place;
  std::istringstream commands(place.vitreo("complete -- ''").out);
  for (std::string command; std::getline(commands, command);) {
    const std::string help = place.vitreo(command + " --help").out;
    const std::size_t examples = help.find("For instance\n");
    ASSERT_NE(examples, std::string::npos) << command;
    EXPECT_NE(help.find("vitreo " + command, examples), std::string::npos) << command;
    EXPECT_EQ(help.find(" in ["), std::string::npos) << command << ": a validator's own words";
  }
}

TEST(Help, WrongWordsGetOneLineWithWhatWasPerhapsMeant) {
  const Workplace place;
  for (const auto& [words, answer] : std::vector<std::pair<std::string, std::string>>{
           {"descrbe x", "there is no command 'descrbe'; did you mean describe?"},
           {"run servo_square --sed 3", "--sed"},
           {"run", "protocol is required; see vitreo run --help"},
           {"new thing x", "'thing' is not understood"},
           {"new protocol ../x", "is not a name"},
           {"docs sefety", "did you mean safety?"},
           {"completion tcsh", "bash, zsh and fish"},
           {"attach", "no run is going on"},
           {"control status", "no run is going on"},
           {"control stp", "'stp' is not understood; did you mean stop?"},
           {"run servo_sqare", "there is no protocol 'servo_sqare'"},
           {"run servo_sqare", "did you mean servo_square?"},
           {"run hello_rig --rig simulatd", "there is no rig 'simulatd'"},
           {"run hello_rig --seed -1",
            "wants a whole number from 0 to 18446744073709551615; got '-1'"},
           {"run hello_rig --seed 18446744073709551616", "got '18446744073709551616'"},
           {"soak hello_rig --seeds 0", "--seeds"},
           {"check hello_rig --limit soon",
            "--limit: wants a time above zero, such as 10s; got 'soon'"},
           {"check hello_rig --limit 5mm", "--limit: wants a time"},
           {"run hello_rig --fault top_camera:drops:after=1s,after=2s", "after is given twice"},
           {"run hello_rig --out /proc/nowhere", "/proc/nowhere"},
           {"runs --since yesterday", "--since: wants a time such as 2026-11-21"},
           {"run hello_rig --rig /dev/zero", "/dev/zero: is a device or a pipe, not a Lua file"},
           {"run hello_rig --out ''", "'': "},
           {"run " + std::string(5000, 'x'), "xxx...': File name too long"},
           {"show nothing_like_it", "nothing_like_it"}}) {
    const Spoken spoken = place.vitreo(words);
    EXPECT_EQ(spoken.exit_code, 2) << words;
    EXPECT_TRUE(contains(spoken.err, answer)) << words << ": " << spoken.err;
    EXPECT_EQ(std::count(spoken.err.begin(), spoken.err.end(), '\n'), 1) << spoken.err;
  }
}

TEST(ShellCompletion, KnowsCommandsOptionsProtocolsParametersAndValues) {
  const Workplace place;
  const auto complete = [&place](const std::string& words) {
    return place.vitreo("complete -- " + words).out;
  };
  EXPECT_EQ(complete("desc"), "describe\n");
  EXPECT_TRUE(contains(complete("run ser"), "servo_square\n"));
  EXPECT_TRUE(contains(complete("run servo_square sp"), "speed=\n"));
  EXPECT_FALSE(contains(complete("run servo_square speed=1mm/s sp"), "speed=\n")) << "it is given";
  EXPECT_TRUE(contains(complete("run --se"), "--seed\n"));
  EXPECT_TRUE(contains(complete("control pa"), "pause\n"));
  EXPECT_EQ(complete("nonsense x"), "");
  EXPECT_EQ(complete("run --seed 3 servo_sq"), "servo_square\n")
      << "an option's value is no protocol";
  EXPECT_EQ(complete("run servo_square --rig calib"), "calibration\n");
  EXPECT_EQ(complete("runs --outcome st"), "stopped\n");
  EXPECT_EQ(complete("export last --as mk"), "mkv\n");
  EXPECT_EQ(complete("docs saf"), "safety\nsafety_bad_input\nsafety_faults\n");
  EXPECT_EQ(complete("test hel"), "hello_rig\n");
  EXPECT_EQ(complete("new driver acme_stage st"), "stage\n");
  place.write("choose.lua",
              "return { title = 'c', parameters = { mode = { default = 'calm', choices = { 'calm', "
              "'brisk' } } },\n"
              "run = function() end }");
  EXPECT_EQ(complete("run choose.lua mode=b"), "mode=brisk\n");
}

TEST(ShellCompletion, WorksInBashAndItsScriptsAreForTheirShells) {
  const Workplace place;
  place.write(
      "try.sh",
      "source <('" VITREO_PROGRAM "' completion bash)\nvitreo() { '" VITREO_PROGRAM
      "' \"$@\"; }\nCOMP_WORDS=(vitreo run servo_square sp); COMP_CWORD=3\n"
      "COMP_LINE='vitreo run servo_square sp'; COMP_POINT=${#COMP_LINE}\n_vitreo 2>/dev/null; echo "
      "\"${COMPREPLY[@]}\"\n");
  ASSERT_EQ(std::system(("cd '" + place.folder().string() + "' && bash try.sh >said 2>&1").c_str()),
            0);
  EXPECT_EQ(place.read("said"), "speed=\n");
  const std::string zsh = place.vitreo("completion zsh").out;
  EXPECT_TRUE(contains(zsh, "#compdef vitreo"));
  EXPECT_TRUE(contains(zsh, "then _vitreo \"$@\""))
      << "loaded by its name it answers the first Tab, too";
  const std::string fish = place.vitreo("completion fish").out;
  EXPECT_TRUE(contains(fish, "complete -c vitreo -f"));
  if (std::system("command -v fish >/dev/null") == 0) {
    place.write("try.fish", fish + "function vitreo\n  '" VITREO_PROGRAM
                                   "' $argv\nend\ncomplete -C 'vitreo run servo_square law='\n");
    EXPECT_EQ(
        std::system(
            ("cd '" + place.folder().string() + "' && HOME=. fish try.fish >said 2>&1").c_str()),
        0);
    EXPECT_EQ(place.read("said"), "law=estimator\nlaw=pd\n");
  }
}

TEST(Docs, TheManPageHasEveryCommandAndTroffTakesIt) {
  const Workplace place;
  const std::string page = place.vitreo("docs man").out;
  std::istringstream commands(place.vitreo("complete -- ''").out);
  for (std::string command; std::getline(commands, command);)
    EXPECT_TRUE(contains(page, ".SS vitreo " + command + "\n")) << command;
  EXPECT_TRUE(contains(page, ".SH EXIT STATUS"));
  if (std::system("command -v man >/dev/null") != 0) GTEST_SKIP() << "no man to read it with";
  place.write("vitreo.1", page);
  EXPECT_EQ(std::system(("cd '" + place.folder().string() +
                         "' && LC_ALL=C.UTF-8 MANROFFSEQ= man --warnings -E UTF-8 -l -Tutf8 -Z "
                         "vitreo.1 2>&1 >/dev/null | grep -q .")
                            .c_str()),
            256)
      << "no warnings";
}

TEST(Docs, PagesAreListedAndPrinted) {
  const Workplace place;
  EXPECT_TRUE(contains(place.vitreo("docs").out, "safety"));
  EXPECT_TRUE(place.vitreo("docs safety").out.starts_with("# "));
  EXPECT_TRUE(contains(place.vitreo("docs api").out, "### `servo:go_to`"));
}

TEST(NewProtocol, RunsAtOnceAndIsWhatTheEditorNeeds) {
  const Workplace place;
  const Spoken made = place.vitreo("new protocol depth_scan");
  EXPECT_EQ(made.exit_code, 0) << made.err;
  for (const char* file :
       {"depth_scan.lua", ".luarc.json", ".luacheckrc", ".vitreo/vitreo.lua", ".vitreo/units.lua"})
    EXPECT_TRUE(std::filesystem::exists(place.folder() / file)) << file;
  const Spoken ran = place.vitreo("run depth_scan.lua wait=0.1s places=2 --quiet");
  EXPECT_EQ(ran.exit_code, 0) << ran.err;
  EXPECT_EQ(ran.out + ran.err, "") << "quiet";
  place.write("fails.lua",
              "return { title = 'x', parameters = {}, run = function() error('no light', 0) end }");
  const Spoken failed = place.vitreo("run fails.lua --quiet");
  EXPECT_EQ(failed.exit_code, 1);
  EXPECT_EQ(failed.err, "vitreo: failed: no light\n") << "why is told all the same";
  EXPECT_TRUE(contains(place.vitreo("run depth_scan.lua wait=0.1s places=1 --verbose").err,
                       "wait = 100 ms"));
  EXPECT_EQ(place.vitreo("new protocol depth_scan").exit_code, 2)
      << "never over a file that is there";
  EXPECT_EQ(place.vitreo("new protocol second_scan --json").out,
            "{\"changed\":[],\"files\":[\"second_scan.lua\"]}\n");
  if (std::system("command -v luacheck >/dev/null") == 0) {
    EXPECT_EQ(
        std::system(
            ("cd '" + place.folder().string() + "' && luacheck -q depth_scan.lua >said").c_str()),
        0)
        << place.read("said");
  }
}

TEST(Report, ShowsEveryKindOfPlotAndTheTimelineAndGivesPlotsAsFiles) {
  const Workplace place;
  place.write("kinds.lua", R"(
local units = require "units"
local plots = require "plotting.kinds"
local mm, um = units.mm, units.um
return { title = "kinds", run = function(rig, p, run)
  local x, y, sigma, rows, points = {}, {}, {}, {}, {}
  for i = 1, 20 do
    x[i], y[i], sigma[i], points[i] = i * mm, i * i * um, 2 * um, vector(i * mm, 0, i * um)
    rows[i] = { i * 1e-3, 2 * i * 1e-3, false }
  end
  local counts = plots.histogram(run, { title = "Histogram", values = x, bins = 4, x = { "x", "mm" } })
  assert(counts[1] == 5 and counts[2] == 5 and counts[3] == 5 and counts[4] == 5)
  plots.error_bars(run, { title = "Bars", x_values = x, y_values = y, sigma = sigma, x = { "x", "mm" }, y = { "y", "um" } })
  plots.heat_map(run, { title = "Heat & more", rows = rows, x_range = { 0, 1 * mm }, y_range = { 0, 1 * mm },
    x = { "x", "mm" }, y = { "y", "mm" }, value = { "field", "mT" } })
  plots.trajectory(run, { title = "Way", paths = { { label = "went", points = points } } })
  assert(not plots.expected(run, { title = "Against", rows = { { "a", 1, 1, 0.1 }, { "b", 2 * mm, 3 * mm, 0.1 * mm, "mm" } } }))
  assert(not pcall(plots.histogram, run, { title = "t" }) and not pcall(plots.heat_map, run, { rows = { { 1 }, { 1, 2 } } }))
  run:picture { title = "Seen", image = rig.top_camera:grab().image, scale_bar_px = 80, scale_bar_label = "1 mm",
    marks = { { label = "way", line = { { 0, 0 }, { 99, 40 } } }, { label = "goals", points = { { 5, 5 } } },
      { label = "robot", dashed = true, ellipse = { x_px = 50, y_px = 50, major_px = 20, minor_px = 9, angle = 1 } } } }
  run:table { title = "Small", header = { "what", "how much" }, rows = { { "umbra", "137 um" }, { "rate", "3.5 um/s" } } }
  run:plot { title = "Counted", x = { "place", "" }, y = { "height", "mm" }, series = { { label = "h", x = { 1, 2, 3 }, y = { 0, 1 * mm, 0 } } } }
  rig:learn_background { frames = 2 }
  run:wait(2) run:note("two seconds") run:wait(2)
end }
)");
  const Spoken ran = place.vitreo("run kinds.lua");
  ASSERT_EQ(ran.exit_code, 0) << ran.err;
  const Spoken files = place.vitreo("report last --plots figures");
  EXPECT_EQ(files.out,
            "figures/01_Heat_more.svg\nfigures/02_Seen.svg\nfigures/03_Histogram.svg\n"
            "figures/04_Bars.svg\nfigures/05_Way_from_above.svg\n"
            "figures/06_Way_from_the_side.svg\nfigures/07_Counted.svg\n")
      << files.err;
  EXPECT_TRUE(contains(place.read("figures/01_Heat_more.svg"), "Heat &amp; more"));
  EXPECT_TRUE(contains(place.read("figures/02_Seen.svg"), ">goals</text>"));
  EXPECT_EQ(place.vitreo("report last --png").exit_code, 2);
  EXPECT_EQ(place.vitreo("report last --plots figures --png").exit_code, 0);
  for (const char* name : {"03_Histogram", "01_Heat_more", "02_Seen"}) {
    const cv::Mat drawn =
        cv::imread((place.folder() / "figures" / (name + std::string(".png"))).string());
    ASSERT_GT(drawn.cols, 700) << name;
    cv::Scalar mean, deviation;
    cv::meanStdDev(drawn, mean, deviation);
    EXPECT_GT(deviation[0], 10) << name << ": something is drawn";
    EXPECT_EQ(drawn.at<cv::Vec3b>(0, 0), cv::Vec3b(255, 255, 255)) << name << ": on white";
  }
  const std::string report = file_text(
      std::filesystem::directory_iterator(place.folder() / "runs")->path() / "report.html");
  for (const char* part :
       {"NOT within", "<title>note: two seconds</title>", "role=\"img\"", ">umbra</td>",
        ">137 \u00b5m<", ">3.5 \u00b5m/s<", "camera = top_camera, count = 2"})
    EXPECT_TRUE(contains(report, part)) << part;
  // As text, not in the attributes from which the page's script draws.
  EXPECT_FALSE(contains(report, ">{&quot;")) << "what devices say is read by people";
  EXPECT_FALSE(contains(report, ">1.5</text>")) << "there is no place one and a half";
}

TEST(Scripts, AreLaidOutByStyLua) {
  if (std::system("command -v node >/dev/null") != 0 ||
      !std::filesystem::exists(VITREO_PAGE_TEST "/node_modules"))
    GTEST_SKIP() << "wants node, and npm when this was built";
  const Workplace place;
  const std::string tool =
      "node " VITREO_SOURCE_DIR "/cmake/format_scripts.cjs " VITREO_PAGE_TEST " ";
  const auto differing = [&](const std::string& files) {
    return std::system(
        (tool + "--check " + files + " >'" + (place.folder() / "said").string() + "' 2>&1")
            .c_str());
  };
  std::string files;
  for (const char* folder : {"protocols", "scripts", "templates"})
    for (const auto& entry :
         std::filesystem::recursive_directory_iterator(VITREO_SOURCE_DIR "/" + std::string(folder)))
      if (entry.path().extension() == ".lua") files += " '" + entry.path().string() + "'";
  EXPECT_EQ(differing(files), 0) << "make format-scripts lays these out: " << place.read("said");
  const std::string odd = place.write("odd.lua", "return   { a=1 }\n");
  EXPECT_NE(differing("'" + odd + "'"), 0);
  EXPECT_EQ(std::system((tool + "'" + odd + "' >/dev/null").c_str()), 0);
  EXPECT_EQ(place.read("odd.lua"), "return { a = 1 }\n");
}

TEST(NewDriver, BeginsAsADriverOfItsRoleUnderItsOwnNameAndCompiles) {
  const Workplace place;
  const std::filesystem::path source = VITREO_SOURCE_DIR;
  for (const char* part : {"devices/instruments/sutter_mp285", "host/rig/drivers"}) {
    std::filesystem::create_directories(place.folder() / part);
    std::filesystem::copy(source / part, place.folder() / part,
                          std::filesystem::copy_options::recursive);
  }
  std::filesystem::create_directories(place.folder() / "tests/devices/instruments");
  std::filesystem::copy(source / "tests/devices/instruments/sutter_mp285_test.cpp",
                        place.folder() / "tests/devices/instruments");
  std::filesystem::copy(source / "host/rig/registry.cpp", place.folder() / "host/rig");
  const Spoken made = place.vitreo("new driver acme_stage stage");
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_TRUE(contains(place.read("host/rig/registry.cpp"),
                       "{\"acme_stage\", read_acme_stage, acme_stage::identification}"));
  EXPECT_TRUE(contains(place.read("host/rig/registry.cpp"),
                       "#include \"devices/instruments/acme_stage/identification.h\""));
  EXPECT_TRUE(contains(place.read("tests/devices/instruments/acme_stage_test.cpp"), "AcmeStage"));
  for (const char* file :
       {"devices/instruments/acme_stage/driver.cpp", "devices/instruments/acme_stage/wire.h"})
    EXPECT_FALSE(contains(place.read(file), "sutter_mp285") || contains(place.read(file), "Mp285"))
        << file;
  EXPECT_EQ(std::system(("cd '" + place.folder().string() +
                         "' && c++ -std=c++20 -fsyntax-only -I . -I '" + source.string() +
                         "' -I /usr/include/eigen3 devices/instruments/acme_stage/driver.cpp "
                         "devices/instruments/acme_stage/emulator.cpp "
                         "devices/instruments/acme_stage/identification.cpp "
                         "tests/devices/instruments/acme_stage_test.cpp 2>said")
                            .c_str()),
            0)
      << place.read("said");
  EXPECT_EQ(place.vitreo("new driver acme_stage stage").exit_code, 2) << "it is there already";
  EXPECT_TRUE(contains(place.vitreo("new driver x_y stag").err, "did you mean stage?"));
}

TEST(Attach, FollowsARunReadsOnlyAndSpeaksToItWithControl) {
  const Workplace place;
  place.write("long.lua",
              "return { title = 'long', run = function(rig, p, run) run:wait(60) end }");
  const std::string run =
      "env XDG_RUNTIME_DIR='" + place.folder().string() + "' '" VITREO_PROGRAM "' ";
  const std::string command =
      "cd '" + place.folder().string() + "' && (" + run +
      "run long.lua --real-time >run.out 2>&1; echo $? >code) & cd '" + place.folder().string() +
      "'; for i in 1 2 3 4 5 6 7 8 9 10; do sleep 0.3; " + run +
      "control status >/dev/null 2>&1 && break; done; echo stop | timeout 3 " + run +
      "attach >looks 2>looks.err; echo stop | timeout 9 " + run +
      "attach --control >speaks 2>&1; wait";
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_TRUE(contains(place.read("looks"), "running, waiting for run:wait"))
      << place.read("looks");
  EXPECT_TRUE(contains(place.read("looks.err"), "this looks on only")) << place.read("looks.err");
  EXPECT_TRUE(contains(place.read("speaks"), "has ended")) << place.read("speaks");
  EXPECT_EQ(place.read("code"), "3\n");
}

TEST(Control, MovesAStageOfARunAndNamesWhatDoesNotFit) {
  const Workplace place;
  place.write("long.lua",
              "return { title = 'long', run = function(rig, p, run) run:wait(60) end }");
  const std::string run =
      "env XDG_RUNTIME_DIR='" + place.folder().string() + "' '" VITREO_PROGRAM "' ";
  const std::string command =
      "cd '" + place.folder().string() + "' && (" + run +
      "run long.lua --rig calibration --real-time >run.out 2>&1; echo $? >code) & cd '" +
      place.folder().string() + "'; for i in $(seq 40); do sleep 0.3; " + run +
      "control status >/dev/null 2>&1 && break; done; " + run + "control adjust 'stage z=3mm'; " +
      run + "control adjust 'stage z=3deg' 2>kind; " + run +
      "control adjust 'stage w=3mm' 2>name; " + run +
      "control adjust 'stage z' 2>form; for i in $(seq 40); do " + run +
      "control adjust >list; grep -q 'stage z *3 mm' list && break; done; " + run +
      "control stop; wait";
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_TRUE(contains(place.read("kind"), "stage z is in m")) << place.read("kind");
  EXPECT_TRUE(contains(place.read("name"), "'stage w' is none of those that can be adjusted"))
      << place.read("name");
  EXPECT_TRUE(contains(place.read("form"), "wants INSTRUMENT=VALUE")) << place.read("form");
  EXPECT_TRUE(contains(place.read("list"), "stage z                      3 mm  -20 mm to 20 mm"))
      << place.read("list") << place.read("run.out");
  EXPECT_EQ(place.read("code"), "3\n");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
