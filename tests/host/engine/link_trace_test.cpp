// The trace of the links: from the first byte of the opening to the end of the record.
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/link_trace.h"

#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Bytes = std::vector<std::uint8_t>;

void say(LinkTrace& trace, int ns, const Bytes& bytes) {
  trace.passed({"stage", "emulated"}, Time(ns), LinkEvent::to_instrument, bytes);
}

TEST(LinkTraceTest, KeepsWhatPassesBeforeThereIsARecordAndDropsWhatComesAfterIt) {
  const TemporaryFolder folder;
  LinkTrace trace;
  say(trace, 1, {1});
  ASSERT_EQ(trace.waiting().size(), 1U);
  {
    Recorder recorder(folder.path(), start_of_test(1));
    LinkTrace::Recording recording;
    recording = LinkTrace::Recording(trace, recorder);
    EXPECT_TRUE(trace.waiting().empty());
    say(trace, 2, {2});
    recording.end();
    say(trace, 3, {3});
    ASSERT_EQ(recorder.links().size(), 2U);
    EXPECT_EQ(recorder.links()[0].bytes, Bytes{1});
    EXPECT_EQ(recorder.links()[1].bytes, Bytes{2});
  }
  say(trace, 4, {4});  // a rig that is closed after its record
  EXPECT_TRUE(trace.waiting().empty());
}

TEST(LinkTraceTest, IsShownInColumnsAsTextAndInHexadecimal) {
  const std::vector<LinkRow> rows{
      {Time(1'500'000), "stage", "serial:/dev/ttyUSB0", "opened", {}},
      {Time(2'000'000'000), "stage", "serial:/dev/ttyUSB0", "to", {'c', '\r'}},
      {Time(2'013'000'000), "coils", "channel 3, emulated", "from", Bytes(41, 'x')},
      {Time(3'000'000'000), "coils", "channel 3, emulated", "failed", {'g', 'o', 'n', 'e'}}};
  std::string hex;
  for (int i = 0; i < 41; ++i) hex += i == 0 ? "78" : " 78";
  EXPECT_EQ(to_text(rows),
            "     0.001500 s  stage  serial:/dev/ttyUSB0  opened\n"
            "     2.000000 s  stage  serial:/dev/ttyUSB0  to      c\\x0D  63 0D\n"
            "     2.013000 s  coils  channel 3, emulated  from    " +
                std::string(41, 'x') + "  " + hex +
                "\n"
                "     3.000000 s  coils  channel 3, emulated  failed  gone\n");
}

// A whole run: opened, used, made safe, closed; twice with one seed.
std::string traced_run(bool traced) {
  const TemporaryFolder folder;
  const auto clock = virtual_clock();
  LinkTrace trace;
  const auto rig = open_rig(whole_rig(), *clock, 7, {}, traced ? &trace : nullptr);
  Recorder recorder(folder.path(), start_of_test(7));
  LinkTrace::Recording recording(trace, recorder);
  Rig& roles = rig->rig();
  roles.lens_mover->home(std::chrono::seconds(60));
  for (int i = 1; i <= 5; ++i, clock->sleep_for(std::chrono::milliseconds(20)))
    roles.coils->set_currents(std::vector<double>(8, 0.1 * i));
  EXPECT_TRUE(rig->make_safe().empty());
  recording.end();
  return canonical_export(recorder);
}

TEST(LinkTraceTest, HasTheSameBytesForTheSameSeed) {
  const std::string first = traced_run(true);
  EXPECT_EQ(first, traced_run(true));
  EXPECT_NE(first.find("\"coils\""), std::string::npos);
  EXPECT_NE(first.find("\"lens_mover\""), std::string::npos);
  EXPECT_EQ(traced_run(false).find("link "), std::string::npos);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
