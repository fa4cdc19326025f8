// Live topics of a run by the Foxglove WebSocket protocol, with the reference client of npm: what
// it is shown, who is kept out, and that a slow client does not hold up the run.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kProtocol = R"(
return {
  title = "Small", needs = { "top_camera", "coils", "sample" },
  parameters = { hold = { unit = "s", default = 2.5, help = "how long it is held" } },
  run = function(rig, p, run)
    rig.sample:remove_robot()
    local servo <close> = rig:servo { background = rig:learn_background { frames = 4 } }
    servo:hold(vector(0, 0, 0))
    rig.sample:insert_robot(vector(0, 0, 0))
    run:note("begun")
    run:wait(p.hold)
    run:note("held")
  end,
}
)";

struct Foxglove : testing::Test {
  void SetUp() override {
    if (!fs::exists(VITREO_OPEN_FORMATS_TEST "/node_modules/ws"))
      GTEST_SKIP() << "no npm packages in " VITREO_OPEN_FORMATS_TEST;
    place.write("small.lua", kProtocol);
  }
  /// A run in real time beside clients: "ADDRESS TASK ..." each, in the order given, whose words
  /// stand in client1, client2 ... afterwards. `words` are further ones of the run.
  void watched(const std::string& words, const std::vector<std::string>& tasks) {
    std::string script =
        "'" VITREO_PROGRAM "' run ./small.lua --real-time --foxglove --foxglove-port 0 --json " +
        words +
        " >out 2>err &\nprogram=$!\n"
        "for i in $(seq 300); do\n"
        "  address=$(grep -o 'ws://127.0.0.1:[0-9]*/?token=[0-9a-f]*' err | head -1)\n"
        "  [ -n \"$address\" ] && break\n  sleep 0.05\ndone\n";
    int number = 0;
    for (const std::string& task : tasks) {
      const std::string to = "client" + std::to_string(++number);
      script += "timeout 100 node " VITREO_OPEN_FORMATS_TEST "/live_client.mjs \"$address\" " +
                task + " >" + to + " 2>" + to + ".err &\n";
    }
    script += "wait $program\necho $? >code\nwait\n";
    place.write("work.sh", script);
    EXPECT_EQ(std::system(("cd '" + place.folder().string() +
                           "' && XDG_RUNTIME_DIR=. VITREO_LOG=host.log sh work.sh")
                              .c_str()),
              0);
    EXPECT_EQ(place.read("code"), "0\n") << place.read("err");
  }
  json seen(int client) const {
    const std::string name = "client" + std::to_string(client);
    json words = json::parse(place.read(name), nullptr, false);
    EXPECT_TRUE(words.is_object()) << place.read(name) << place.read(name + ".err");
    return words;
  }
  Workplace place;
};

TEST_F(Foxglove, ShowsTheReferenceClientTheTopicsOfTheExport) {
  watched("--operator Ada", {"watch 20 foxglove.sdk.v1", "watch 20"});
  for (const int client : {1, 2}) {
    const json read = seen(client);
    ASSERT_TRUE(read.is_object());
    EXPECT_EQ(read["subprotocol"], client == 1 ? "foxglove.sdk.v1" : "foxglove.websocket.v1");
    EXPECT_EQ(read["infos"].back()["metadata"]["operator"], "Ada");
    EXPECT_EQ(read["infos"].back()["capabilities"], json({"time"}));
    for (const auto& [name, topic] : read["topics"].items()) {
      EXPECT_TRUE(topic["faults"].empty()) << name << ": " << topic["faults"];
      EXPECT_TRUE(topic["invalid"].empty()) << name << ": " << topic["invalid"];
      EXPECT_EQ(topic["encodings"], json({"jsonschema", "json"})) << name;
      EXPECT_EQ(topic["backwards"], 0) << name;
    }
    for (const char* name : {"/servo", "/currents", "/robot/pose", "/target/pose", "/scene", "/tf",
                             "/log", "/top_camera/annotations", "/top_camera/image"})
      EXPECT_GT(read["topics"].value(name, json::object()).value("count", 0), 0) << name;
    EXPECT_FALSE(read["topics"].contains("/truth")) << "of the simulator alone";
    EXPECT_EQ(read["topics"]["/top_camera/image"]["magic"], "ffd8ff") << "JPEG";
    const double now =
        std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    EXPECT_NEAR(read["topics"]["/servo"]["last_time"].get<double>(), now, 120);
    EXPECT_EQ(read["closed"], true) << "the connection ends with the run";
    std::string said;
    for (const json& status : read["statuses"]) said += status["message"].get<std::string>() + "\n";
    EXPECT_NE(said.find("the run has ended: completed"), std::string::npos) << said;
  }
  // The same topics with the same schemas stand in the export.
  ASSERT_EQ(place.vitreo("export last --as mcap --into exported").exit_code, 0)
      << place.read("err");
  ASSERT_EQ(
      std::system(("cd '" + place.folder().string() +
                   "' && node " VITREO_OPEN_FORMATS_TEST "/mcap_check.mjs exported/run.mcap >file")
                      .c_str()),
      0);
  const json file = json::parse(place.read("file"))["topics"];
  for (const auto& [name, topic] : seen(1)["topics"].items()) {
    if (name.ends_with("/image")) continue;  // the run recorded no frames
    ASSERT_TRUE(file.contains(name)) << name;
    EXPECT_EQ(file[name]["schema"], topic["schema"]) << name;
    EXPECT_EQ(file[name].value("content", json()), topic.value("content", json())) << name;
  }
}

TEST_F(Foxglove, CannotSteerTheRun) {
  watched("hold=4s", {"watch 6"});
  const json read = seen(1);
  int refused = 0;
  for (const json& status : read["statuses"])
    refused += status["level"] == 2 &&
               status["message"].get<std::string>().find("can be read only") != std::string::npos;
  EXPECT_EQ(refused, 2) << read["statuses"];
}

TEST_F(Foxglove, KeepsStrangersOut) {
  watched("hold=4s", {"strangers"});
  const json read = seen(1);
  for (const char* stranger :
       {"without_token", "wrong_token", "token_of_another_length", "other_subprotocol",
        "rebound_name", "page_of_another_site", "plain_get"})
    EXPECT_EQ(read[stranger], 403) << stranger;
  EXPECT_EQ(read["admitted"], 101);
  EXPECT_EQ(read["admitted_by_the_later_name"], 101);
}

// A loop that waited for the client would see other frames than the same run that is served to no
// client.
TEST_F(Foxglove, ClientsChangeNothingToTheBitAlsoOneThatDoesNotRead) {
  watched("hold=5s --out watched", {"slow 6", "watch 30"});
  const json read = seen(2);
  // Served as well, which takes each camera's frames from the begin.
  ASSERT_EQ(
      place.vitreo("run ./small.lua hold=5s --foxglove --foxglove-port 0 --out alone").exit_code,
      0);
  const auto rows = [this](const std::string& out, const std::string& stream) {
    const fs::path run = fs::directory_iterator(place.folder() / out)->path();
    EXPECT_EQ(
        std::system(("sqlite3 '" + (run / "run.sqlite").string() + "' 'select * from sample_" +
                     stream + "' >'" + (place.folder() / "rows").string() + "'")
                        .c_str()),
        0);
    return place.read("rows");
  };
  for (const char* stream : {"servo", "currents", "truth"}) {
    const std::string alone = rows("alone", stream);
    EXPECT_GT(std::count(alone.begin(), alone.end(), '\n'), 60) << stream;
    EXPECT_TRUE(rows("watched", stream) == alone) << stream;
  }
  EXPECT_GT(read["topics"]["/servo"]["count"].get<int>(), 5) << "the other client is served";
  EXPECT_TRUE(read["topics"]["/servo"]["invalid"].empty());
}

TEST_F(Foxglove, WantsATokenFileWhereOtherMachinesReachIt) {
  const Spoken open = place.vitreo("run ./small.lua --foxglove --listen 192.0.2.7");
  EXPECT_EQ(open.exit_code, 2);
  EXPECT_NE(open.err.find("--token-file"), std::string::npos) << open.err;
  const Spoken lone = place.vitreo("run ./small.lua --foxglove-port 9000");
  EXPECT_EQ(lone.exit_code, 2);
  EXPECT_NE(lone.err.find("--foxglove-port: wants --foxglove"), std::string::npos) << lone.err;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
