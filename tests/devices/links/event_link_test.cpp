// The event link in memory and its faults; the kernel's listing of input nodes.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/event_link.h"

#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <deque>
#include <filesystem>
#include <fstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

struct Pad final : EventPeer {
  const EventDevice& device() const override { return own; }
  EventState state(Time) override { return present; }
  std::vector<TimedEvent> say(Time now) override {
    std::vector<TimedEvent> said;
    for (; !coming.empty() && coming.front().at <= now; coming.pop_front())
      said.push_back(coming.front());
    return said;
  }
  Time next() const override { return coming.empty() ? kForever : coming.front().at; }
  EventDevice own{"pad", 1, 2, "", {{"ABS_X", -100, 100, 5}}, {"BTN_SOUTH", "BTN_EAST"}};
  EventState present{{}, {7}, {false, true}};
  std::deque<TimedEvent> coming;
};

struct MemoryEventLink : ::testing::Test {
  std::unique_ptr<Clock> clock = virtual_clock();
  LinkFaults faults;
  Pad pad;
  std::unique_ptr<EventLink> link = memory_event_link(pad, *clock, &faults);
};

TEST_F(MemoryEventLink, TellsTheStateAndWhatChanges) {
  EXPECT_EQ(link->device(), pad.own);
  EXPECT_EQ(link->state().axes, std::vector<int>{7});
  EXPECT_EQ(link->state().pressed, (std::vector<bool>{false, true}));
  pad.coming = {{3ms, false, 0, 42}, {5ms, true, 0, 1}, {5ms, true, 1, 0}};
  EXPECT_TRUE(link->wait(1s));
  EXPECT_EQ(clock->now(), 3ms);
  EXPECT_EQ(link->state().axes, std::vector<int>{42});
  EXPECT_EQ(link->state().at, 3ms);
  EXPECT_TRUE(link->wait(1s));
  EXPECT_EQ(link->state().pressed, (std::vector<bool>{true, false}));
  EXPECT_FALSE(link->wait(1s));
  EXPECT_EQ(clock->now(), 1005ms);
}

TEST_F(MemoryEventLink, HasTheFaultsOfALink) {
  faults.late = 10ms;
  pad.coming = {{3ms, false, 0, 42}};
  EXPECT_TRUE(link->wait(1s));
  EXPECT_EQ(clock->now(), 13ms);
  faults = {.silent = true};
  pad.coming = {{20ms, false, 0, 43}};
  link->state();
  EXPECT_FALSE(link->wait(1s));
  faults = {.unplugged = true};
  EXPECT_THROW(link->state(), DeviceError);
  EXPECT_THROW(link->wait(1s), DeviceError);
  EXPECT_THROW(link->reopen(), DeviceError);
  faults = {};
  pad.present.axes = {1};
  link->reopen();
  EXPECT_EQ(link->state().axes, std::vector<int>{1});
}

TEST(EventNodes, AreListedWithTheirNumbers) {
  std::string name = (fs::temp_directory_path() / "vitreo_input_XXXXXX").string();
  const fs::path root = mkdtemp(name.data());
  const auto write = [&](const std::string& file, const std::string& text) {
    fs::create_directories((root / file).parent_path());
    std::ofstream(root / file) << text << "\n";
  };
  // As a DualShock's three nodes and a keyboard's.
  const std::tuple<const char*, const char*, const char*, const char*> nodes[] = {
      {"event3", "Pad", "3003f", "7fdb000000000000 0 0 0 0"},
      {"event4", "Pad Motion Sensors", "3f", "0"},
      {"event5", "Pad Touchpad", "260800000000003", "2420 10000 0 0 0 0"},
      {"event6", "Keyboard", "0", "10000 7 ff9f207ac14057ff febeffdfffefffff fffffffffffffffe"}};
  for (const auto& [node, called, abs, key] : nodes) {
    const std::string device = std::string(node) + "/device/";
    write(device + "name", called);
    write(device + "uniq", "40:1b");
    write(device + "id/vendor", "054c");
    write(device + "id/product", "09cc");
    write(device + "capabilities/abs", abs);
    write(device + "capabilities/key", key);
  }
  fs::create_directories(root / "js0");
  const auto found = list_event_nodes(root);
  ASSERT_EQ(found.size(), 4U);
  EXPECT_EQ(found[0].node, "/dev/input/event3");
  EXPECT_EQ(found[0].name, "Pad");
  EXPECT_EQ(found[0].vendor, 0x054C);
  EXPECT_EQ(found[0].product, 0x09CC);
  EXPECT_EQ(found[0].serial, "40:1b");
  EXPECT_TRUE(found[0].pad);
  for (const std::size_t i : {1, 2, 3}) EXPECT_FALSE(found[i].pad) << found[i].name;
  EXPECT_TRUE(list_event_nodes(root / "nowhere").empty());
  fs::remove_all(root);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
