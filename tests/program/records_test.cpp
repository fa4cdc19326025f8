// The commands about recorded runs, each checked by another program's reader.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;
using nlohmann::json;

/// A short servo run with the top camera's frames, made once.
class Records : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    place_ = new Workplace;
    place_->write("small.lua", R"(
return {
  title = "Small", needs = { "top_camera", "coils", "sample" },
  run = function(rig, p, run)
    local judge = require "analysis.path_accuracy"
    run:record_frames("side_camera", { every = 4 })
    rig.sample:remove_robot()
    local servo <close> = rig:servo { background = rig:learn_background { frames = 4 } }
    servo:hold(vector(0, 0, 0))
    rig.sample:insert_robot(vector(0, 0, 0))
    run:wait(1.5)
    run:note("said, \"with a comma\"")
  end,
}
)");
    const Spoken spoken =
        place_->vitreo("run ./small.lua --frames top_camera --operator Ada --json");
    if (spoken.exit_code != 0) {
      trouble_ = spoken.err + spoken.out;
      return;
    }
    run_ = json::parse(spoken.out)["run"].get<std::string>();
    if (!fs::path(run_).is_absolute()) run_ = (place_->folder() / run_).string();
  }
  /// Here and not where the run is made: what fails there is counted as skipped.
  void SetUp() override { ASSERT_FALSE(run_.empty()) << trouble_; }
  static void TearDownTestSuite() {
    delete place_;
    place_ = nullptr;
  }
  /// Another program's words, in the work place.
  static std::string ask(const std::string& command) {
    const int status = std::system(
        ("cd '" + place_->folder().string() + "' && (" + command + ") >asked 2>&1").c_str());
    EXPECT_EQ(status, 0) << command << "\n" << place_->read("asked");
    return place_->read("asked");
  }
  static std::string reader(const std::string& name) {
    return "python3 '" VITREO_SOURCE_DIR "/tests/program/readers/" + name + "' ";
  }
  static json shown() { return json::parse(place_->vitreo("show last --json").out); }
  static std::int64_t frames(const std::string& camera) {
    return shown()["frames"][camera]["recorded"];
  }

  static Workplace* place_;
  static std::string run_, trouble_;
};
Workplace* Records::place_ = nullptr;
std::string Records::run_;
std::string Records::trouble_;

TEST_F(Records, SayWhatTheRunWasMadeWith) {
  const json run = shown();
  EXPECT_EQ(run["outcome"], "completed");
  EXPECT_EQ(run["operator"], "Ada");
  EXPECT_TRUE(run["modules"].contains("analysis.path_accuracy"));
  EXPECT_TRUE(run["versions"].contains("commit"));
  EXPECT_TRUE(run["devices"].contains("top_camera") && run["devices"].contains("coils"))
      << run["devices"];
  EXPECT_EQ(run["files"].size(), 1u) << run["files"];  // the rig file
  EXPECT_GT(frames("top_camera"), 20);
  EXPECT_GT(frames("side_camera"), 3);
  EXPECT_EQ(run["frames"]["top_camera"]["dropped"], 0);
  const json listed = json::parse(place_->vitreo("runs --json").out);
  EXPECT_EQ(listed.at(0)["outcome"], "completed");
  EXPECT_EQ(place_->vitreo("verify last").exit_code, 0) << place_->read("out");
}

TEST_F(Records, OpenInPythonsOwnSqliteAndInItsCommandLine) {
  const std::string rows =
      ask("sqlite3 '" + run_ + "/run.sqlite' 'select count(*) from sample_servo'");
  EXPECT_EQ(std::stoll(rows), shown()["samples"]["servo"]);
  EXPECT_EQ(ask("python3 -c \"import sqlite3; c = sqlite3.connect('" + run_ +
                "/run.sqlite'); print(c.execute('select count(*) from frame').fetchone()[0])\""),
            std::to_string(frames("top_camera") + frames("side_camera")) + "\n");
}

TEST_F(Records, KeepFramesThatOtherReadersOfTiffAndNdtiffRead) {
  const fs::path stack = fs::path(run_) / "frames/top_camera";
  const json read = json::parse(ask(reader("ndtiff_read.py") + "'" + stack.string() + "'"));
  EXPECT_EQ(read[0], frames("top_camera"));
  EXPECT_EQ(read[3]["Camera"], "top_camera");
  EXPECT_TRUE(read[2].contains("Exposed-ns"));
  const std::string pages = ask("tiffinfo '" + (stack / "top_camera_NDTiffStack.tif").string() +
                                "' 2>/dev/null | grep -c 'TIFF Directory'");
  EXPECT_EQ(std::stoll(pages), frames("top_camera"));
}

TEST_F(Records, AreExportedAsCsv) {
  ASSERT_EQ(place_->vitreo("export last --csv").exit_code, 0) << place_->read("err");
  const std::string script = "import csv, json; r = list(csv.reader(open('" + run_ +
                             "/export/servo.csv', newline=''))); "
                             "e = list(csv.reader(open('" +
                             run_ +
                             "/export/events.csv', newline=''))); "
                             "print(json.dumps([r[0], len(r) - 1, len(set(len(x) for x in r)), [x "
                             "for x in e if x[1] == 'note'][0][2]]))";
  const json read = json::parse(ask("python3 -c \"" + script + "\""));
  EXPECT_EQ(read[0][0], "t (s)");
  EXPECT_EQ(read[0][1], "x (m)");
  EXPECT_EQ(read[1], shown()["samples"]["servo"]);
  EXPECT_EQ(read[2], 1);
  EXPECT_EQ(read[3], "said, \"with a comma\"");
}

TEST_F(Records, AreExportedAsTiff) {
  ASSERT_EQ(place_->vitreo("export last --tiff --into out_tiff").exit_code, 0)
      << place_->read("err");
  const std::string info = ask("tiffinfo out_tiff/top_camera.tif");
  EXPECT_NE(info.find("ImageJ="), std::string::npos) << info;
  EXPECT_EQ(
      std::stoll(ask("tiffinfo out_tiff/top_camera.tif 2>/dev/null | grep -c 'TIFF Directory'")),
      frames("top_camera"));
  // The same pixels as in the stack, page by page.
  ask("tiffcmp -t out_tiff/top_camera.tif '" + run_ +
      "/frames/top_camera/top_camera_NDTiffStack.tif'");
}

TEST_F(Records, AreExportedAsMatroska) {
  ASSERT_EQ(place_->vitreo("export last --mkv --into out_mkv").exit_code, 0) << place_->read("err");
  const json probed = json::parse(
      ask("ffprobe -v error -count_frames -show_streams -of json out_mkv/top_camera.mkv"));
  EXPECT_EQ(probed["streams"][0]["codec_name"], "ffv1");
  EXPECT_EQ(probed["streams"][0]["nb_read_frames"], std::to_string(frames("top_camera")));
}

TEST_F(Records, AreExportedAsHdf5) {
  ASSERT_EQ(place_->vitreo("export last --hdf5 --into out_h5").exit_code, 0) << place_->read("err");
  const std::string head = ask("h5dump -H -d /frames/top_camera/images out_h5/run.h5");
  EXPECT_NE(head.find("SIMPLE { ( " + std::to_string(frames("top_camera")) + ", 1036, 1384 )"),
            std::string::npos)
      << head;
  const std::string unit = ask("h5dump -a /streams/servo/x/unit out_h5/run.h5");
  EXPECT_NE(unit.find("\"m\""), std::string::npos) << unit;
  const auto unit_of = [](const std::string& column) {
    return ask("h5dump -a /frames/top_camera/" + column + "/unit out_h5/run.h5");
  };
  EXPECT_NE(unit_of("t_ns").find("\"ns\""), std::string::npos) << unit_of("t_ns");
  EXPECT_NE(unit_of("number").find("(0): \"\""), std::string::npos) << unit_of("number");
}

TEST_F(Records, AreReplayedToTheBitByTheSameProgram) {
  const Spoken spoken = place_->vitreo("replay last --json --csv replay.csv");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  const json replayed = json::parse(spoken.out);
  EXPECT_EQ(replayed["background_frames"], 4);
  EXPECT_GT(replayed["compared"], 15) << replayed;
  EXPECT_EQ(replayed["compared"], replayed["same"]) << replayed;
  EXPECT_EQ(replayed["only_recorded"], 0);
  EXPECT_EQ(replayed["only_replayed"], 0);
  EXPECT_NE(place_->read("replay.csv").find("distance (m)"), std::string::npos);
}

// One frame in three: of the nine that were learnt three stand in the record, and the loop's
// frames, which show the robot, are no background.
TEST_F(Records, AreReplayedWithWhatWasRecordedOfTheBackground) {
  std::string text = place_->read("small.lua");
  text.replace(text.find("frames = 4"), 10, "frames = 9");
  place_->write("sparse.lua", text);
  ASSERT_EQ(place_->vitreo("run ./sparse.lua --frames top_camera/3 --out sparse").exit_code, 0);
  const fs::path run = fs::directory_iterator(place_->folder() / "sparse")->path();
  const Spoken spoken = place_->vitreo("replay '" + run.string() + "' --json");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  const json replayed = json::parse(spoken.out);
  EXPECT_EQ(replayed["background_frames"], 3) << replayed;
  EXPECT_GT(replayed["compared"], 5) << replayed;
  EXPECT_EQ(replayed["only_recorded"], 0) << replayed;
}

TEST_F(Records, AreTheSameBytesForTheSameSeedWithFrames) {
  ASSERT_EQ(place_->vitreo("run ./small.lua --frames top_camera --out again").exit_code, 0);
  const auto again = fs::directory_iterator(place_->folder() / "again")->path();
  for (const char* file : {"frames/top_camera/NDTiff.index", "frames/side_camera/NDTiff.index"})
    EXPECT_EQ(ask("sha256sum < '" + (again / file).string() + "'"),
              ask("sha256sum < '" + run_ + "/" + file + "'"));
  const std::string query = " 'select * from sample_servo; select number, t_ns, crc32 from frame'";
  EXPECT_EQ(ask("sqlite3 '" + (again / "run.sqlite").string() + "'" + query),
            ask("sqlite3 '" + run_ + "/run.sqlite'" + query));
}

TEST_F(Records, TellWhatIsWrongWithARequest) {
  EXPECT_EQ(place_->vitreo("show nobody").exit_code, 2);
  EXPECT_NE(place_->read("err").find("nobody"), std::string::npos);
  EXPECT_EQ(place_->vitreo("export last").exit_code, 2);
  EXPECT_EQ(place_->vitreo("run ./small.lua --frames nose_camera --out none").exit_code, 2);
  EXPECT_EQ(place_->vitreo("run ./small.lua --frames top_camera/0 --out none").exit_code, 2);
  EXPECT_FALSE(fs::exists(place_->folder() / "none"));
}

TEST_F(Records, OfAKilledRunAreRecovered) {
  place_->write(
      "long.lua",
      "return { title = 'Long', needs = { 'top_camera' }, run = function(rig, p, run)\n"
      "for i = 1, 100000 do rig.top_camera:grab() run:record('count', { i = i }) end end }\n");
  // Killed once its stack has some twenty frames and a second more.
  ask("'" VITREO_PROGRAM
      "' run ./long.lua --frames top_camera --real-time --out killed >/dev/null 2>&1 & "
      "until [ \"$(cat killed/*/frames/top_camera/NDTiff.index 2>/dev/null | wc -c)\" -gt 1600 ]; "
      "do sleep 0.1; done; "
      "sleep 1.1; kill -9 $!; wait $! || true");
  EXPECT_EQ(json::parse(place_->vitreo("runs --runs killed --json").out).at(0)["outcome"], "lost");
  EXPECT_EQ(place_->vitreo("verify last --runs killed").exit_code, 1);
  ASSERT_EQ(place_->vitreo("recover last --runs killed").exit_code, 0) << place_->read("err");
  EXPECT_EQ(place_->vitreo("verify last --runs killed").exit_code, 0) << place_->read("out");
  const json run = json::parse(place_->vitreo("show last --runs killed --json").out);
  EXPECT_EQ(run["outcome"], "lost");
  EXPECT_GT(run["frames"]["top_camera"]["recorded"], 5);
  EXPECT_EQ(place_->vitreo("report last --runs killed").exit_code, 0);
}

TEST_F(Records, OfARunOntoAFullDiskAreIntactAndItsOutcomeIsAborted) {
  const std::string limited =
      "ulimit -f 6000; '" VITREO_PROGRAM
      "' run ./small.lua --frames top_camera --out full --json >full.json 2>full.err";
  place_->write("limited.sh", "trap '' XFSZ\n" + limited + "\necho $?\n");
  EXPECT_EQ(ask("bash limited.sh"), "4\n") << place_->read("full.err");
  const json result = json::parse(place_->read("full.json"));
  EXPECT_EQ(result["outcome"], "aborted");
  EXPECT_NE(result["reason"].get<std::string>().find("recording failed"), std::string::npos)
      << result;
  const json run = json::parse(place_->vitreo("show last --runs full --json").out);
  EXPECT_EQ(run["outcome"], "aborted");
  EXPECT_GT(run["frames"]["top_camera"]["recorded"], 0);
  EXPECT_EQ(place_->vitreo("verify last --runs full").exit_code, 0) << place_->read("out");
}

TEST(RecordsOfARigWithABase, KeepEveryTextAndAreReplayedWithThem) {
  const Workplace place;
  place.write(
      "bench.lua",
      "return { base = 'simulated', title = 'bench', top_camera = { effective_pixel = 15e-6 } }");
  place.write("mine.lua",
              "return { base = 'bench', title = 'mine', truth = { drawn_as = 'ellipsoid' }, stage "
              "= false }");
  place.write(
      "p.lua",
      R"(return { title = 'p', needs = { 'top_camera', 'coils', 'sample' }, run = function(rig, p, run)
    rig.sample:remove_robot()
    run:record_frames("top_camera")
    local servo <close> = rig:servo { background = rig:learn_background { frames = 4 } }
    servo:hold(vector(0, 0, 0))
    rig.sample:insert_robot(vector(0, 0, 0))
    run:wait(1)
  end })");
  ASSERT_EQ(place.vitreo("run ./p.lua --rig mine.lua").exit_code, 0) << place.read("err");
  fs::path folder;
  for (const auto& entry : fs::directory_iterator(place.folder() / "runs")) folder = entry.path();
  for (const char* kept : {"script/mine.lua", "script/bench.lua", "script/simulated.lua"})
    EXPECT_TRUE(fs::exists(folder / kept)) << kept;
  EXPECT_EQ(place.vitreo("verify last").exit_code, 0) << place.read("out");
  std::ostringstream report;
  report << std::ifstream(folder / "report.html").rdbuf();
  EXPECT_NE(report.str().find("It builds on bench.lua"), std::string::npos);
  const json before = json::parse(place.vitreo("replay last --json").out);
  place.write("bench.lua", "return { nonsense");  // what the files are now does not matter
  const Spoken again = place.vitreo("replay last --json");
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(json::parse(again.out), before);
}

// The focusing stage of the simulated rig is a Zaber behind a link in memory: its bytes are those
// of the protocol, without any file of the system.
TEST(TracedRun, ShowsTheBytesOfOneRoleOrOfAll) {
  const Workplace place;
  place.write("move.lua",
              "return { title = 'move', needs = { 'stage', 'coils' }, run = function(rig, p, run)\n"
              "  rig.stage:move_to({ 1e-3 })\nend }");
  const Spoken spoken = place.vitreo("run move.lua --trace-links --rig simulated");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  const std::string stage = place.vitreo("show last --links --role stage").out;
  EXPECT_NE(stage.find("move abs"), std::string::npos) << stage.substr(0, 400);
  EXPECT_EQ(stage.find("coils"), std::string::npos);
  EXPECT_NE(place.vitreo("show last --links").out.find("coils"), std::string::npos);
  const json rows = json::parse(place.vitreo("show last --links --role stage --json").out);
  ASSERT_GT(rows.size(), 10U);
  EXPECT_EQ(rows[0]["event"], "opened");
  EXPECT_EQ(rows[1]["event"], "to");
  EXPECT_EQ(rows[1]["hex"], "0a") << "the first byte ends what a host that died may have begun";
  EXPECT_NE(place.vitreo("show last").out.find("show "), std::string::npos);
  EXPECT_NE(place.vitreo("show last").out.find("at end    coils "), std::string::npos)
      << "what is known of the coils";
  EXPECT_EQ(place.vitreo("verify last").exit_code, 0);
  const Spoken other = place.vitreo("show last --links --role lamp");
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("lens_mover, stage"), std::string::npos) << other.err;
}

TEST(TracedRun, OfARunThatWasNotTracedIsAnErrorThatNamesTheOption) {
  const Workplace place;
  place.write("idle.lua", "return { title = 'idle', run = function() end }");
  ASSERT_EQ(place.vitreo("run idle.lua --rig simulated").exit_code, 0);
  const Spoken none = place.vitreo("show last --links");
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_NE(none.err.find("--trace-links"), std::string::npos) << none.err;
  EXPECT_EQ(place.vitreo("show last --role stage").exit_code, 2) << "it wants --links";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
