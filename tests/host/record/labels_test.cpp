// Labels and paths of a record: what is given is kept or refused with its reason, and no folder of
// the machine is passed on.
// SPDX-License-Identifier: Apache-2.0
#include "host/record/portable_paths.h"
#include "host/record/record_schema.h"
#include "host/record/run_labels.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <set>
#include <stdexcept>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

std::string refusal(const std::string& field, const std::string& value) {
  nlohmann::json sample;
  try {
    set_sample_field(sample, field, value);
    return "";
  } catch (const std::invalid_argument& problem) {
    return problem.what();
  }
}

std::string removed(const std::string& text) {
  nlohmann::json sample;
  set_sample_field(sample, "removed", text);
  return sample["removed"];
}

TEST(RunLabels, KeepTheTimeOfRemovalAsUtc) {
  EXPECT_EQ(removed("2026-11-24T08:10+02:00"), "2026-11-24T06:10:00Z");
  EXPECT_EQ(removed("2026-11-24 08:10:30-0130"), "2026-11-24T09:40:30Z");
  EXPECT_EQ(removed("2026-03-01T00:30+01:00"), "2026-02-28T23:30:00Z");
  EXPECT_EQ(removed("2026-11-24T08:10Z"), "2026-11-24T08:10:00Z");
}

TEST(RunLabels, KeepTheTimeOfDeathAsUtcAndNameItWhenItIsNone) {
  nlohmann::json sample;
  set_sample_field(sample, "died", "2026-11-24T05:40+01:00");
  set_sample_field(sample, "pipette", "24 G, glass");
  EXPECT_EQ(sample["died"], "2026-11-24T04:40:00Z");
  EXPECT_EQ(sample["pipette"], "24 G, glass");
  EXPECT_NE(refusal("died", "at dawn").find("died: wants a time such as"), std::string::npos);
}

TEST(RunLabels, RefuseATimeThatIsNone) {
  for (const char* text : {"today", "2026-11-24", "2026-13-24T08:10Z", "2026-02-31T08:10Z",
                           "2026-11-24T08:70Z", "2026-11-24T08:10+25:00", "2026-11-24T08:10 noon"})
    EXPECT_NE(refusal("removed", text).find("removed: wants a time such as"), std::string::npos)
        << text;
}

TEST(RunLabels, RefuseWhatWouldNotBeFoundAgain) {
  EXPECT_EQ(refusal("colour", "x"),
            "sample: has no 'colour', only eye, species, age, died, removed, pipette, light, "
            "robot");
  EXPECT_EQ(refusal("eye", ""), "sample eye: wants a text, got an empty one");
  EXPECT_EQ(refusal("eye", "a\nb"), "sample eye: wants a text of one line");
  nlohmann::json tags;
  for (const char* key : {"", "1st", "a b", "a=b", "µ"})
    EXPECT_THROW(set_tag(tags, key, "x"), std::invalid_argument) << key;
  EXPECT_THROW(set_tag(tags, "a", std::string(1001, 'x')), std::invalid_argument);
  set_tag(tags, "paper.fig-3", "µ and spaces");
  EXPECT_EQ(tags.dump(), R"({"paper.fig-3":"µ and spaces"})");
  EXPECT_THROW(key_and_value("batch"), std::invalid_argument);
  EXPECT_EQ(key_and_value("a=b=c").second, "b=c");
}

TEST(PortablePaths, KnowThePresentFolderAndTheHome) {
  PortablePaths paths;
  const std::string here = std::filesystem::current_path().string();
  EXPECT_EQ(paths.text("cannot open " + here + "/rigs/x.lua: no"), "cannot open rigs/x.lua: no");
  EXPECT_EQ(paths.file(here + "/protocols/hold.lua"), "protocols/hold.lua");
  EXPECT_EQ(paths.text("serial:/dev/ttyUSB0"), "serial:/dev/ttyUSB0");
  EXPECT_EQ(paths.file("protocols/hold.lua"), "protocols/hold.lua");
}

TEST(PortablePaths, LearnTheFolderOfAFileThatIsElsewhere) {
  PortablePaths paths;
  EXPECT_EQ(paths.file("/opt/laboratory/protocols/drift.lua"), "protocols/drift.lua");
  EXPECT_EQ(paths.text("/opt/laboratory/protocols/drift.lua:12: error"),
            "protocols/drift.lua:12: error");
  EXPECT_EQ(paths.file("/opt/laboratory/scripts/places.lua"), "scripts/places.lua");
  EXPECT_EQ(paths.text("at x/opt/laboratory/y"), "at x/opt/laboratory/y") << "the middle of a path";
}

TEST(PortablePaths, LeaveTextsOfScriptsAsTheyAreForTheirHashes) {
  RunStart start;
  start.protocol_file = "/opt/laboratory/protocols/drift.lua";
  start.protocol_text = "-- /opt/laboratory/notes";
  start.rig = {{"file", "/opt/laboratory/rigs/own.lua"},
               {"text", "calibration = '/opt/laboratory/field.yaml'"},
               {"resolved", {{"calibration", "/opt/laboratory/field.yaml"}}}};
  start.files = {{"/opt/laboratory/rigs/field.yaml", "00"}};
  PortablePaths paths;
  const RunStart portable = paths.start(start);
  EXPECT_EQ(portable.protocol_text, start.protocol_text);
  EXPECT_EQ(portable.rig["text"], start.rig["text"]);
  EXPECT_EQ(portable.rig["file"], "rigs/own.lua");
  EXPECT_EQ(portable.rig["resolved"]["calibration"], "field.yaml");
  EXPECT_TRUE(portable.files.contains("rigs/field.yaml"));
}

TEST(RecordSchema, ExplainsEachTableAndColumnOnce) {
  std::set<std::string> tables;
  for (const RecordTable& table : record_tables()) {
    EXPECT_TRUE(tables.insert(table.name).second) << table.name;
    EXPECT_STRNE(table.help, "") << table.name;
    EXPECT_NE(create_table(table.name), "");
  }
  std::set<std::string> columns;
  for (const RecordColumn& column : record_columns()) {
    EXPECT_TRUE(tables.contains(column.table)) << column.table;
    EXPECT_TRUE(columns.insert(std::string(column.table) + "." + column.name).second);
    EXPECT_STRNE(column.help, "") << column.name;
  }
  EXPECT_THROW(create_table("songs"), std::logic_error);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
