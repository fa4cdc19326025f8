// What the record's writer leaves on the disk, read back with a plain reader, against its header
// and docs/records.md.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/record/record_writer_reference.h"

#include "host/record/record_writer.h"

#include <gtest/gtest.h>
#include <opencv2/core/mat.hpp>

#include <chrono>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using reference::add_stream;
using reference::Folder;
using reference::Rows;
using reference::small_limits;
namespace fs = std::filesystem;

RunStart start() {
  RunStart start;
  start.protocol_file = "protocols/it's.lua";
  start.protocol_title = "A \"quoted\" title; drop table run";
  start.protocol_text = "a\nb";
  start.parameters = {{"speed", 0.1}};
  start.parameter_units = {{"speed", "mm/s"}};
  start.rig = {{"file", "r"}};
  start.versions = {{"program", "1.2"}};
  start.seed = 0xFFFFFFFFFFFFFFFEU;
  start.operator_name = "O'Neil \u00b5";
  start.devices = {{"coils", "eight"}};
  start.files = {{"map", "0a"}};
  start.t0_utc_ns = 1234567890123456789;
  start.clock = "virtual";
  start.tags = {{"batch", "a1"}};
  start.sample = {{"eye", "pig 7"}};
  return start;
}

std::set<std::string> files_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) names.insert(fs::relative(entry.path(), folder).string());
  return names;
}

TEST(RecordWriterReference, the_start_record_is_there_when_the_writer_is) {
  const Folder folder;
  const RecordWriter writer(folder.path(), start(), small_limits());
  const Rows run = folder.rows(
      "select protocol, title, script, script_hash, rig_hash, operator, parameters, "
      "parameter_units, seed, "
      "versions, rig, devices, files, t0_utc_ns, clock, tags, sample from run");
  EXPECT_EQ(run, (Rows{{"protocols/it's.lua", "A \"quoted\" title; drop table run", "a\nb",
                        "7e18f737311b2dc3b2f269dd78396b0351f14fb66efa879f768cb23181883c78",
                        "9bb93a5f939a8710ef3efe8e7dcbe657c45cfd591d271f120e6a43900f8c15fb",
                        "O'Neil \u00b5", R"({"speed":0.1})", R"({"speed":"mm/s"})",
                        "18446744073709551614", R"({"program":"1.2"})", R"({"file":"r"})",
                        R"({"coils":"eight"})", R"({"map":"0a"})", "1234567890123456789", "virtual",
                        R"({"batch":"a1"})", R"({"eye":"pig 7"})"}}));
  EXPECT_EQ(folder.rows("pragma user_version"), (Rows{{"5"}}));
  EXPECT_EQ(folder.rows("pragma journal_mode"), (Rows{{"wal"}}));
  EXPECT_NE(folder.rows("select count(*) from meaning"), (Rows{{"0"}}));
  EXPECT_EQ(fs::file_size(folder.path() / "reserve.room"), 12345U);
  // Of a run that has not ended there is no end, and of links that are not traced no table.
  EXPECT_EQ(folder.rows("select count(*) from stop"), (Rows{{"0"}}));
  EXPECT_EQ(folder.rows("select name from sqlite_master where name = 'link'"), Rows{});
}

TEST(RecordWriterReference, a_folder_that_is_not_there_is_named) {
  const Folder folder;
  try {
    const RecordWriter writer(folder.path() / "none", start(), small_limits());
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find((folder.path() / "none").string()), std::string::npos);
  }
}

TEST(RecordWriterReference, samples_come_back_to_the_bit_in_tables_of_any_name) {
  const Folder folder;
  RecordWriter writer(folder.path(), start(), small_limits());
  const StreamInfo first{"ser vo\"x",
                         "src 'a'",
                         {{"x", "m", "along", "world"}, {"sel\"ect", "1"}, {"n", "px"}},
                         "middle of the exposure"};
  const StreamInfo second{"other", "the rig", {{"seq_", "A"}}, "host"};
  add_stream(writer, first);
  add_stream(writer, second);
  std::mt19937_64 random(5);
  std::normal_distribution<double> value(0, 1e3);
  constexpr std::size_t kRows = 2300;  // more than two commits of 1000
  Rows expected, expected_other;
  for (std::size_t i = 0; i < kRows; ++i) {
    const auto time = static_cast<std::int64_t>(987654321012 + 1000003 * i);
    const double none = std::numeric_limits<double>::quiet_NaN();
    const std::vector<double> values{
        value(random), i % 3 == 0 ? none : value(random) * 1e-12,
        i % 5 == 0 ? -std::numeric_limits<double>::infinity() : value(random) * 1e200};
    writer.sample(0, i, Time(time), values);
    std::vector<std::string> row{std::to_string(i + 1), std::to_string(time)};
    for (const double v : values) row.push_back(std::isnan(v) ? "NULL" : fmt::format("{:.17g}", v));
    expected.push_back(row);
    if (i % 7 != 0) continue;
    const std::vector<double> current{0.1 * static_cast<double>(i)};
    writer.sample(1, i / 7, Time(time + 1), current);
    expected_other.push_back(
        {std::to_string(i / 7 + 1), std::to_string(time + 1), fmt::format("{:.17g}", current[0])});
  }
  RunData data;
  data.streams = {{first, {}, {}}, {second, {}, {}}};
  writer.stop();
  writer.finish({}, data);
  EXPECT_EQ(folder.rows("select * from \"sample_ser vo\"\"x\" order by rowid"), expected);
  EXPECT_EQ(folder.rows("select * from sample_other order by rowid"), expected_other);
  EXPECT_EQ(folder.rows("select name, source, sample_table, clock from stream order by id"),
            (Rows{{"ser vo\"x", "src 'a'", "sample_ser vo\"x", "middle of the exposure"},
                  {"other", "the rig", "sample_other", "host"}}));
  EXPECT_EQ(folder.rows("select s.name, position, c.name, unit, help, axes from channel c join "
                        "stream s on s.id = c.stream order by s.id, position"),
            (Rows{{"ser vo\"x", "0", "x", "m", "along", "world"},
                  {"ser vo\"x", "1", "sel\"ect", "1", "", ""},
                  {"ser vo\"x", "2", "n", "px", "", ""},
                  {"other", "0", "seq_", "A", "", ""}}));
}

TEST(RecordWriterReference, what_is_given_is_in_the_files_within_a_second) {
  const Folder folder, cut;
  RecordWriter writer(folder.path(), start(), small_limits());
  add_stream(writer, {"s", "x", {{"v", "m"}}, "c"});
  const auto after = [&](const auto& there) {
    const auto begun = std::chrono::steady_clock::now();
    while (!there() && std::chrono::steady_clock::now() - begun < 3s) {
      std::this_thread::sleep_for(2ms);
    }
    return std::chrono::steady_clock::now() - begun;
  };
  for (std::size_t i = 0; i < 3; ++i) writer.sample(0, i, Time(i), std::vector<double>{1.5});
  EXPECT_LT(after([&] { return folder.rows("select 1 from sample_s").size() == 3; }), 1s);
  // The files as a program leaves them that is killed now.
  for (const char* name : {"run.sqlite", "run.sqlite-wal"})
    fs::copy(folder.path() / name, cut.path() / name);
  EXPECT_EQ(cut.rows("select v from sample_s").size(), 3U);
  writer.post([](RecordFile& file) { file.event(4, {Time(77), "note", "it's"}); }, true);
  EXPECT_LT(after([&] { return !folder.rows("select 1 from event").empty(); }), 1s);
  EXPECT_EQ(folder.rows("select * from event"), (Rows{{"5", "77", "note", "it's"}}));
}

TEST(RecordWriterReference, samples_and_rows_are_written_in_the_order_in_which_they_came) {
  const Folder folder;
  RecordWriter writer(folder.path(), start(), small_limits());
  add_stream(writer, {"s", "x", {{"v", "m"}}, "c"});
  std::vector<std::size_t> before;  // samples that were there, as each row is written
  const auto look = [&](RecordFile& file) {
    file.commit();
    before.push_back(folder.rows("select 1 from sample_s").size());
  };
  std::size_t row = 0;
  const auto give = [&](int count) {
    for (int i = 0; i < count; ++i, ++row) writer.sample(0, row, Time(row), std::vector<double>{2});
  };
  give(7);
  writer.post(look, false);
  give(5);
  writer.offer(look);
  give(1);
  writer.post(look, true);
  give(3);
  writer.stop();
  EXPECT_EQ(before, (std::vector<std::size_t>{7, 12, 13}));
}

TEST(RecordWriterReference, what_is_there_under_a_number_stays) {
  const Folder folder;
  RecordWriter writer(folder.path(), start(), small_limits());
  for (const char* text : {"first", "second"}) {
    writer.post([text](RecordFile& file) { file.event(0, {Time(5), "note", text}); }, true);
    writer.offer([text](RecordFile& file) {
      file.link(2, {Time(6), "stage", "tcp:a", text, {0x00, 0x7F, 0xFF}});
    });
  }
  writer.stop();
  writer.late_event(0, {Time(7), "note", "third"});
  writer.late_event(1, {Time(8), "note", "late"});
  static_assert(noexcept(writer.late_event(1, {})));
  EXPECT_EQ(folder.rows("select * from event"),
            (Rows{{"1", "5", "note", "first"}, {"2", "8", "note", "late"}}));
  EXPECT_EQ(folder.rows("select * from link"),
            (Rows{{"3", "6", "stage", "tcp:a", "first", "007fff"}}));
}

TEST(RecordWriterReference, the_end_record_says_all_and_one_plain_file_is_left) {
  const Folder folder;
  RecordWriter writer(folder.path(), start(), small_limits());
  const StreamInfo stream{"s", "x", {{"v", "m"}}, "c"};
  add_stream(writer, stream);
  writer.add_camera(reference::camera_of("top"));
  RunData data;
  data.streams = {{stream, {Time(1), Time(2)}, {3, 4}}};
  for (std::size_t i = 0; i < 2; ++i) writer.sample(0, i, Time(i + 1), std::vector<double>{3});
  data.cameras = {reference::camera_of("top")};
  data.dropped = {3};
  data.lost = {4};
  data.held = 1.25;
  writer.stop();
  writer.finish({Outcome::stopped,
                 "why 'so'",
                 12.5,
                 2.25,
                 "a.lua:3",
                 {"person", "Ann", "the terminal", "SIGTERM"}},
                data);
  EXPECT_EQ(folder.rows("select exit_status, reason, script_line, experiment_time, wall_time, "
                        "counts, dropped, held, lost, ended_by, ended_name, ended_face, "
                        "ended_signal from stop"),
            (Rows{{"stopped", "why 'so'", "a.lua:3", "12.5", "2.25", R"({"s":2})", R"({"top":3})",
                   "1.25", R"({"top":4})", "person", "Ann", "the terminal", "SIGTERM"}}));
  writer.close();
  EXPECT_EQ(files_in(folder.path()), std::set<std::string>{"run.sqlite"});
  EXPECT_EQ(folder.rows("pragma journal_mode"), (Rows{{"delete"}}));
  EXPECT_EQ(folder.rows("pragma integrity_check"), (Rows{{"ok"}}));
  // What was written stays as it was given, though the data in memory are others.
  EXPECT_EQ(folder.rows("select v from sample_s"), (Rows{{"3"}, {"3"}}));
}

TEST(RecordWriterReference, what_is_left_is_in_the_file_after_stop) {
  for (const bool destroyed : {false, true}) {
    const Folder folder;
    auto writer = std::make_unique<RecordWriter>(folder.path(), start(), small_limits());
    add_stream(*writer, {"s", "x", {{"v", "m"}}, "c"});
    std::this_thread::sleep_for(300ms);
    for (std::size_t i = 0; i < 5; ++i) writer->sample(0, i, Time(i), std::vector<double>{1});
    if (destroyed) {
      writer.reset();
    } else {
      writer->stop();
    }
    EXPECT_EQ(folder.rows("select 1 from sample_s").size(), 5U) << destroyed;
  }
}

// docs/conventions.md: broken preconditions throw std::invalid_argument. A row goes through the
// queue: one of another width faults the record by name, and none of it is written.
TEST(RecordWriterReference, a_row_of_another_width_and_a_camera_that_is_none_are_refused) {
  for (const std::vector<double>& row : {std::vector<double>{1}, std::vector<double>{1, 2, 3}}) {
    const Folder folder;
    RecordWriter writer(folder.path(), start(), small_limits());
    add_stream(writer, {"s", "x", {{"v", "m"}, {"w", "m"}}, "c"});
    Frame frame;
    frame.image = cv::Mat(5, 10, CV_8UC1, cv::Scalar(7));
    EXPECT_THROW(writer.frame(0, frame, 2), std::invalid_argument);
    writer.add_camera({});
    EXPECT_THROW(writer.frame(1, frame, 2), std::invalid_argument);
    EXPECT_THROW(writer.frame(0, Frame{}, 2), std::invalid_argument);
    EXPECT_EQ(writer.lost(), std::vector<std::uint64_t>{0});
    writer.sample(0, 0, Time(1), std::vector<double>{4, 5});
    writer.sample(0, 1, Time(2), row);
    writer.stop();
    EXPECT_NE(writer.fault().find("stream 0 has 2 channels, not " + std::to_string(row.size())),
              std::string::npos)
        << writer.fault();
    EXPECT_LE(folder.rows("select 1 from sample_s where v = 1").size(), 0U);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
