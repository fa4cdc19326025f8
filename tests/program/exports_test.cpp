// Exports of a run, read by the programs that they are for: the reference reader of MCAP with the
// reference schemas (npm), tifffile, h5py, pandas and ffprobe. No reader here is ours.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <map>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kNoReaders = "no npm packages in " VITREO_OPEN_FORMATS_TEST;

/// A short servo run whose top camera loses frames for a while, made once.
class Exports : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    place_ = new Workplace;
    place_->write("small.lua", R"(
return {
  title = "Small", needs = { "top_camera", "coils", "sample" },
  parameters = { speed = { unit = "mm/s", default = 0.5e-3, help = "not used" } },
  run = function(rig, p, run)
    run:record_frames("side_camera", { every = 4 })
    rig.sample:remove_robot()
    local servo <close> = rig:servo { background = rig:learn_background { frames = 4 } }
    servo:hold(vector(0, 0, 0))
    rig.sample:insert_robot(vector(0, 0, 0))
    run:wait(2.5)
    run:note("said, \"with a comma\"")
    run:result("answer", 42e-6, "m")
  end,
}
)");
    const Spoken spoken = place_->vitreo(
        "run ./small.lua --frames top_camera --operator Ada --tag batch=7 --json "
        "--fault top_camera:drops:after=2s,lasting=0.5s,by=2");
    if (spoken.exit_code != 0) {
      trouble_ = spoken.err + spoken.out;
      return;
    }
    run_ = json::parse(spoken.out)["run"].get<std::string>();
    if (!fs::path(run_).is_absolute()) run_ = (place_->folder() / run_).string();
  }
  void SetUp() override { ASSERT_FALSE(run_.empty()) << trouble_; }
  static void TearDownTestSuite() {
    delete place_;
    place_ = nullptr;
  }
  static int shell(const std::string& command) {
    return std::system(
        ("cd '" + place_->folder().string() + "' && (" + command + ") >asked 2>asked.err").c_str());
  }
  /// What another program says, as JSON.
  static json ask(const std::string& command) {
    EXPECT_EQ(shell(command), 0) << command << "\n" << place_->read("asked.err");
    return json::parse(place_->read("asked"), nullptr, false);
  }
  static json mcap(const std::string& file) {
    return ask("node '" VITREO_OPEN_FORMATS_TEST "/mcap_check.mjs' " + file);
  }
  static json shown() { return json::parse(place_->vitreo("show last --json").out); }
  static bool readers_there() { return fs::exists(VITREO_OPEN_FORMATS_TEST "/node_modules/ajv"); }

  static Workplace* place_;
  static std::string run_, trouble_;
};
Workplace* Exports::place_ = nullptr;
std::string Exports::run_;
std::string Exports::trouble_;

TEST_F(Exports, AsMcapHaveNoTopicThatFoxgloveAndLichtblickRefuse) {
  if (!readers_there()) GTEST_SKIP() << kNoReaders;
  ASSERT_EQ(place_->vitreo("export last --as mcap --into mcap").exit_code, 0)
      << place_->read("err");
  const json read = mcap("mcap/run.mcap");
  ASSERT_TRUE(read.is_object());
  EXPECT_GE(read["topics"].size(), 12U);
  for (const auto& [name, topic] : read["topics"].items()) {
    EXPECT_TRUE(topic["faults"].empty()) << name << ": " << topic["faults"];
    EXPECT_TRUE(topic["invalid"].empty()) << name << ": " << topic["invalid"];
    EXPECT_EQ(topic["encodings"], json({"jsonschema", "json"})) << name;
    EXPECT_EQ(topic["stamp_off"], 0) << name << ": a message's own stamp is its log time";
  }
  for (const auto& [name, schema] :
       std::map<std::string, std::string>{{"/top_camera/image", "foxglove.CompressedImage"},
                                          {"/side_camera/image", "foxglove.CompressedImage"},
                                          {"/top_camera/annotations", "foxglove.ImageAnnotations"},
                                          {"/robot/pose", "foxglove.PoseInFrame"},
                                          {"/target/pose", "foxglove.PoseInFrame"},
                                          {"/scene", "foxglove.SceneUpdate"},
                                          {"/tf", "foxglove.FrameTransforms"},
                                          {"/log", "foxglove.Log"},
                                          {"/servo", "vitreo.servo"}})
    EXPECT_EQ(read["topics"][name]["schema"], schema) << name;
}

TEST_F(Exports, AsMcapCountEveryRowOnceAndAreIndexed) {
  if (!readers_there()) GTEST_SKIP() << kNoReaders;
  ASSERT_EQ(place_->vitreo("export last --as mcap --into counted").exit_code, 0);
  const json read = mcap("counted/run.mcap");
  const json run = shown();
  for (const char* stream : {"servo", "currents", "truth"})
    EXPECT_EQ(read["topics"]["/" + std::string(stream)]["count"], run["samples"][stream]);
  for (const char* camera : {"top_camera", "side_camera"})
    EXPECT_EQ(read["topics"]["/" + std::string(camera) + "/image"]["count"],
              run["frames"][camera]["recorded"]);
  std::int64_t messages = 0;
  for (const auto& [name, topic] : read["topics"].items())
    messages += topic["count"].get<std::int64_t>();
  // What a channel is stands in its schema.
  const std::string x = read["topics"]["/servo"]["content"]["properties"]["x"]["description"];
  EXPECT_EQ(x.rfind("[m] ", 0), 0U) << x;
  EXPECT_NE(x.find("axes: world"), std::string::npos) << x;
  const json& statistics = read["statistics"];
  EXPECT_EQ(statistics["messages"], messages);
  EXPECT_EQ(statistics["channels"], read["topics"].size());
  EXPECT_EQ(statistics["chunks"], read["chunks"]);
  EXPECT_GT(read["chunks"], 5);
  // Front to back with every CRC checked there are as many as by the index.
  EXPECT_EQ(read["streamed"]["messages"], messages);
  EXPECT_EQ(read["streamed"]["whole"], true);
}

TEST_F(Exports, AsMcapSayWhenTheyWereAndWhatWasAsked) {
  if (!readers_there()) GTEST_SKIP() << kNoReaders;
  ASSERT_EQ(place_->vitreo("export last --as mcap --into when").exit_code, 0);
  const json read = mcap("when/run.mcap");
  // The run was made a moment ago, by the clock of this machine.
  const double now =
      std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
  EXPECT_NEAR(read["statistics"]["first"].get<double>(), now, 300);
  const json& about = read["metadata"]["run"];
  EXPECT_EQ(about["run"], fs::path(run_).filename().string());
  EXPECT_EQ(about["operator"], "Ada");
  EXPECT_EQ(about["outcome"], "completed");
  const double t0 = std::stod(about["t0_utc_ns"].get<std::string>()) / 1e9;
  EXPECT_NEAR(t0, now, 300);
  EXPECT_GE(read["statistics"]["first"].get<double>(), t0 - 1e-3);
  EXPECT_EQ(read["metadata"]["parameters"]["speed"], "0.5 mm/s");
  EXPECT_EQ(read["metadata"]["results"]["answer"], "4.2e-05 m");
  EXPECT_TRUE(read["metadata"]["versions"].contains("commit"));
  EXPECT_EQ(read["metadata"]["tags"]["batch"], "7");
  EXPECT_TRUE(read["metadata"].contains("sample"));
  EXPECT_EQ(read["attachments"]["report.html"]["type"], "text/html");
  EXPECT_EQ(read["attachments"]["report.html"]["bytes"],
            fs::file_size(fs::path(run_) / "report.html"));
  EXPECT_TRUE(read["attachments"].contains("small.lua"));
}

TEST_F(Exports, AsMcapDrawEyeRetinaRobotAndTarget) {
  if (!readers_there()) GTEST_SKIP() << kNoReaders;
  ASSERT_EQ(place_->vitreo("export last --as mcap --into scene").exit_code, 0);
  const json read = mcap("scene/run.mcap")["topics"];
  const auto ids = [](const json& update) {
    std::vector<std::string> found;
    for (const json& entity : update["entities"]) found.push_back(entity["id"]);
    return found;
  };
  EXPECT_EQ(ids(read["/scene"]["first"]["content"]),
            (std::vector<std::string>{"eye", "retina", "lens"}));
  const json last = read["/scene"]["last"]["content"];
  EXPECT_EQ(ids(last), (std::vector<std::string>{"robot", "target"}));
  // The eye's sphere touches the retina's vertex, 5 mm below the workspace's center (the rig's own
  // default), and the robot was held at that center.
  const json& eye = read["/scene"]["first"]["content"]["entities"][0]["spheres"][0];
  EXPECT_NEAR(eye["pose"]["position"]["z"].get<double>() - eye["size"]["z"].get<double>() / 2,
              -5e-3, 1e-9);
  const json& robot = last["entities"][0]["spheres"][0]["pose"]["position"];
  for (const char* axis : {"x", "y", "z"})
    EXPECT_NEAR(robot[axis].get<double>(), 0, 0.5e-3) << axis;
  // Foxglove counts pixels from the corner of the first one: the outline's middle is 0.5 px beyond
  // the ellipse's center.
  const json outline = read["/top_camera/annotations"]["last"]["content"]["points"][0]["points"];
  double u = 0;
  for (const json& point : outline)
    u += point["x"].get<double>() / static_cast<double>(outline.size());
  EXPECT_NEAR(u - read["/servo"]["last"]["content"]["u_px"].get<double>(), 0.5, 1e-6);
}

TEST_F(Exports, KeepTheTimeOfEveryFrameAlsoWhereFramesAreMissing) {
  if (shell(VITREO_DEBIAN_PYTHON " -c 'import h5py, tifffile, pandas'") != 0)
    GTEST_SKIP() << "python3-h5py, python3-tifffile or python3-pandas is missing";
  const Spoken spoken = place_->vitreo("export last --as csv,tiff,ome,mkv,hdf5 --into all");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  const json read = ask(VITREO_DEBIAN_PYTHON " -B '" VITREO_SOURCE_DIR
                                             "/tests/program/readers/exports_read.py' '" +
                        run_ + "' all top_camera tif,ome,h5,csv,mkv");
  ASSERT_TRUE(read.is_object());
  ASSERT_GT(read["hole"].get<double>(), 1.5 * read["step"].get<double>()) << "no frame is missing";
  for (const char* format : {"tif", "ome", "h5", "csv", "mkv"}) {
    const json& one = read[format];
    ASSERT_TRUE(one["worst"].is_number()) << format << ": " << one["worst"];
    EXPECT_LE(one["worst"].get<double>(), 1e-3) << format;
    EXPECT_EQ(one["same"], true) << format;
    // All say the same zero of the run's clock.
    EXPECT_NEAR(one["t0"].get<double>(), read["csv"]["t0"].get<double>(), 1e-3) << format;
  }
  EXPECT_EQ(read["tif"]["numbers"], true);
  EXPECT_LE(read["tif"]["utc_off"].get<double>(), 1e-3);
  EXPECT_EQ(read["mkv"]["codec"], "ffv1");
  EXPECT_EQ(read["csv"]["units"]["target_x"], "m");
  EXPECT_EQ(read["h5"]["unit"], "m");
  EXPECT_EQ(read["h5"]["t0_ns"], read["csv"]["t0_ns"]);
}

TEST_F(Exports, AsTiffAreWhatImageJAndOmeReadersExpect) {
  if (shell(VITREO_DEBIAN_PYTHON " -c 'import h5py, tifffile, pandas'") != 0)
    GTEST_SKIP() << "python3-h5py, python3-tifffile or python3-pandas is missing";
  ASSERT_EQ(place_->vitreo("export last --as tiff,ome --into tiffs").exit_code, 0);
  const json read = ask(VITREO_DEBIAN_PYTHON " -B '" VITREO_SOURCE_DIR
                                             "/tests/program/readers/exports_read.py' '" +
                        run_ + "' tiffs side_camera tif,ome");
  EXPECT_EQ(read["tif"]["is_imagej"], true);
  EXPECT_EQ(read["tif"]["axes"], "TYX");
  EXPECT_EQ(read["tif"]["unit"], "um");
  EXPECT_EQ(read["ome"]["is_ome"], true);
  EXPECT_EQ(read["ome"]["axes"], "TYX");
  EXPECT_EQ(read["ome"]["shape"][0], read["frames"]);
  EXPECT_EQ(read["ome"]["units"], json({"s"}));
  EXPECT_EQ(read["ome"]["order"], true);
  EXPECT_EQ(read["ome"]["pixel_unit"], "\u00b5m");
  EXPECT_EQ(read["ome"]["cm"], true);
  EXPECT_NEAR(read["ome"]["pixel_um"].get<double>(), 20.4, 1e-6);
  EXPECT_NEAR(read["tif"]["pixel_um"].get<double>(), 20.4, 1e-3);
}

TEST_F(Exports, OfSeveralFormatsAreOneCommandAndAllOrNothing) {
  const Spoken spoken = place_->vitreo("export last --csv --as hdf5,tiff --json --into several");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  const json files = json::parse(spoken.out)["files"];
  const auto made = [&](const std::string& name) {
    return std::count(files.begin(), files.end(), "several/" + name) == 1 &&
           fs::exists(place_->folder() / "several" / name);
  };
  for (const char* name : {"run.csv", "channels.csv", "servo.csv", "run.h5", "top_camera.tif"})
    EXPECT_TRUE(made(name)) << name << " in " << files;
  // A target that is there already, found at the second format: nothing of the first is named.
  fs::create_directory(place_->folder() / "taken");
  place_->write("taken/run.h5", "mine");
  const Spoken refused = place_->vitreo("export last --as csv,hdf5 --into taken");
  EXPECT_NE(refused.exit_code, 0);
  EXPECT_NE(refused.err.find("run.h5: is there already; --replace"), std::string::npos)
      << refused.err;
  EXPECT_EQ(place_->read("taken/run.h5"), "mine");
  EXPECT_EQ(std::distance(fs::directory_iterator(place_->folder() / "taken"), {}), 1);
  EXPECT_EQ(place_->vitreo("export last --as hdf5 --into taken --replace").exit_code, 0);
  EXPECT_NE(place_->read("taken/run.h5"), "mine");
}

TEST_F(Exports, SayWhatIsWrongAndLeaveNothing) {
  EXPECT_EQ(place_->vitreo("export last --as mcp").exit_code, 2);
  EXPECT_NE(place_->read("err").find("--as mcp: is no format; did you mean mcap?"),
            std::string::npos)
      << place_->read("err");
  EXPECT_EQ(place_->vitreo("export last").exit_code, 2);
  place_->write("file", "");
  EXPECT_NE(place_->vitreo("export last --as csv --into file").exit_code, 0);
  EXPECT_NE(place_->read("err").find("file: is a file"), std::string::npos) << place_->read("err");
  // Damaged: the pixels of a frame are not there.
  fs::copy(run_, place_->folder() / "damaged", fs::copy_options::recursive);
  for (const auto& entry : fs::directory_iterator(place_->folder() / "damaged/frames/top_camera"))
    if (entry.path().extension() == ".tif") fs::resize_file(entry.path(), 3000000);
  for (const char* format : {"mcap", "tiff", "ome", "mkv", "hdf5"}) {
    const Spoken spoken =
        place_->vitreo(std::string("export damaged --into broken --as csv,") + format);
    EXPECT_NE(spoken.exit_code, 0) << format;
    EXPECT_FALSE(spoken.err.empty()) << format;
    EXPECT_FALSE(fs::exists(place_->folder() / "broken")) << format;
  }
  // Foreign: some other program's database.
  fs::create_directory(place_->folder() / "foreign");
  shell("sqlite3 foreign/run.sqlite 'create table t(x)'");
  EXPECT_NE(place_->vitreo("export foreign --as mcap --into broken").exit_code, 0);
  EXPECT_NE(place_->read("err").find("run.sqlite"), std::string::npos) << place_->read("err");
  EXPECT_FALSE(fs::exists(place_->folder() / "broken"));
}

// A limit on the size of files stands for the full disk: both fail in the middle of a write.
TEST_F(Exports, ThatFindNoRoomLeaveNothing) {
  for (const auto& [format, file] :
       std::map<std::string, std::string>{{"mcap", "run.mcap"},
                                          {"tiff", "top_camera.tif"},
                                          {"ome", "top_camera.ome.tif"},
                                          {"mkv", "top_camera.mkv"},
                                          {"hdf5", "run.h5"}}) {
    const std::string command =
        "trap '' XFSZ; ulimit -f 4000; '" VITREO_PROGRAM "' export last --into full --as " + format;
    const int status = shell("bash -c \"" + command + "\"");
    EXPECT_EQ(WEXITSTATUS(status), 5) << format << ": an error, not a crash";
    EXPECT_NE(place_->read("asked.err").find("full/" + file + ": "), std::string::npos)
        << format << ": " << place_->read("asked.err");
    EXPECT_FALSE(fs::exists(place_->folder() / "full")) << format;
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
