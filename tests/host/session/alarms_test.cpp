// Alarms: latched, acknowledged, raised again; what of it is an event.
// SPDX-License-Identifier: Apache-2.0
#include "host/session/alarms.h"

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct AlarmsTest : testing::Test {
  std::vector<std::string> said() {
    std::vector<std::string> lines;
    for (const Event& event : alarms.drain_events())
      lines.push_back(event.kind + ": " + event.text);
    return lines;
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  std::chrono::steady_clock::time_point wall{};
  Alarms alarms{*clock, [this] { return wall; }};
};

TEST_F(AlarmsTest, StayWhenTheirCauseIsGoneUntilTheyAreAcknowledged) {
  alarms.raise("disk", AlarmPriority::medium, "8 min left");
  alarms.clear("disk");
  ASSERT_EQ(alarms.shown().size(), 1u) << "latched";
  EXPECT_FALSE(alarms.shown()[0].active);
  EXPECT_EQ(alarms.acknowledge("disk", "anna"), 1);
  EXPECT_TRUE(alarms.shown().empty());
  EXPECT_EQ(said(),
            (std::vector<std::string>{"alarm: medium: disk: 8 min left", "alarm cleared: disk",
                                      "alarm acknowledged: disk (anna)"}));
}

TEST_F(AlarmsTest, AcknowledgingDoesNotClearAndSilencesForTwoMinutes) {
  alarms.raise("disk", AlarmPriority::medium, "8 min left");
  alarms.acknowledge("", "anna");
  ASSERT_EQ(alarms.shown().size(), 1u);
  EXPECT_FALSE(alarms.anything_unacknowledged());
  wall += 119s;
  EXPECT_EQ(alarms.shown()[0].acknowledged_by, "anna");
  wall += 2s;
  EXPECT_TRUE(alarms.anything_unacknowledged()) << "the cause is still there";
}

TEST_F(AlarmsTest, AreShownByUrgencyAndOnesThatGrowMustBeAcknowledgedAgain) {
  alarms.raise("age", AlarmPriority::low, "7 days");
  alarms.raise("coils", AlarmPriority::medium, "70 degC");
  alarms.acknowledge("coils", "anna");
  alarms.raise("coils", AlarmPriority::high, "81 degC");
  const auto shown = alarms.shown();
  ASSERT_EQ(shown.size(), 2u);
  EXPECT_EQ(to_string(shown[0]), "high: coils: 81 degC");
  EXPECT_EQ(shown[0].acknowledged_by, "");
  EXPECT_EQ(shown[0].times, 2);
}

TEST_F(AlarmsTest, ThatComeAgainAndAgainWithTheSameWordsAreOneEvent) {
  for (int i = 0; i < 100; ++i) alarms.raise("camera", AlarmPriority::low, "a frame was dropped");
  EXPECT_EQ(said().size(), 1u);
  EXPECT_EQ(alarms.shown()[0].times, 100);
}

TEST_F(AlarmsTest, TheSameWordsMoreUrgentlyAreNews) {
  alarms.raise("coils", AlarmPriority::low, "70 degC");
  alarms.raise("coils", AlarmPriority::high, "70 degC");
  EXPECT_EQ(said(), (std::vector<std::string>{"alarm: low: coils: 70 degC",
                                              "alarm: high: coils: 70 degC"}));
}

TEST_F(AlarmsTest, AnUnknownOneCannotBeAcknowledged) {
  alarms.raise("disk", AlarmPriority::low, "full");
  try {
    alarms.acknowledge("dsik", "anna");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "no alarm 'dsik' stands; there is: disk");
  }
}

TEST_F(AlarmsTest, ACauseThatComesBackIsActiveAgainAndWantsAnotherAcknowledgement) {
  alarms.raise("coils", AlarmPriority::medium, "70 degC");
  alarms.clear("coils");
  alarms.raise("coils", AlarmPriority::medium, "70 degC");
  ASSERT_EQ(alarms.shown().size(), 1u) << "the same one";
  EXPECT_TRUE(alarms.shown()[0].active);
  alarms.acknowledge("coils", "anna");
  EXPECT_FALSE(alarms.anything_unacknowledged());
  alarms.raise("coils", AlarmPriority::medium, "70 degC");
  EXPECT_FALSE(alarms.anything_unacknowledged()) << "no news";
  alarms.clear("coils");
  EXPECT_TRUE(alarms.shown().empty()) << "acknowledged and gone";
  alarms.raise("coils", AlarmPriority::medium, "70 degC");
  EXPECT_TRUE(alarms.anything_unacknowledged()) << "a new one";
  EXPECT_EQ(alarms.history().size(), 2u);
}

TEST_F(AlarmsTest, ACauseThatWentUnacknowledgedAndComesBackIsNotAcknowledgedByTheOldWord) {
  alarms.raise("disk", AlarmPriority::low, "full");
  alarms.clear("disk");
  alarms.raise("disk", AlarmPriority::low, "full");
  EXPECT_EQ(said(), (std::vector<std::string>{"alarm: low: disk: full", "alarm cleared: disk",
                                              "alarm: low: disk: full"}));
}

TEST_F(AlarmsTest, ALowerPriorityDoesNotTakeTheHigherOnesPlace) {
  alarms.raise("coils", AlarmPriority::high, "81 degC");
  alarms.acknowledge("coils", "anna");
  alarms.raise("coils", AlarmPriority::low, "60 degC");
  ASSERT_EQ(alarms.shown().size(), 1u);
  EXPECT_EQ(alarms.shown()[0].priority, AlarmPriority::high);
  EXPECT_EQ(alarms.shown()[0].text, "60 degC");
  EXPECT_EQ(alarms.shown()[0].acknowledged_by, "anna") << "it has not grown";
}

TEST_F(AlarmsTest, OnlyTheNamedOneIsClearedOrAcknowledged) {
  alarms.raise("a", AlarmPriority::low, "one");
  alarms.raise("b", AlarmPriority::low, "two");
  alarms.clear("c");
  alarms.clear("b");
  EXPECT_TRUE(alarms.shown()[0].active);
  EXPECT_FALSE(alarms.shown()[1].active);
  EXPECT_EQ(alarms.acknowledge("b", "anna"), 1);
  ASSERT_EQ(alarms.shown().size(), 1u);
  EXPECT_EQ(alarms.shown()[0].name, "a");
  EXPECT_EQ(alarms.shown()[0].acknowledged_by, "");
  alarms.raise("d", AlarmPriority::low, "three");
  EXPECT_EQ(alarms.acknowledge("", "ben"), 2) << "all that stand";
  EXPECT_EQ(alarms.acknowledge("", "ben"), 2) << "and again";
}

TEST_F(AlarmsTest, TheSilenceCountsFromEachAcknowledgement) {
  alarms.raise("disk", AlarmPriority::low, "full");
  wall += 1000s;
  alarms.acknowledge("disk", "anna");
  wall += 120s;
  EXPECT_FALSE(alarms.anything_unacknowledged()) << "two minutes to the end";
  wall += 1s;
  EXPECT_TRUE(alarms.anything_unacknowledged());
  alarms.acknowledge("disk", "anna");
  EXPECT_FALSE(alarms.anything_unacknowledged());
}

TEST_F(AlarmsTest, FacesAreToldOfEachChangeAndEventsComeOnceWithTheirTime) {
  const unsigned long before = alarms.changes();
  clock->sleep_for(3s);
  alarms.raise("disk", AlarmPriority::low, "full");
  alarms.raise("disk", AlarmPriority::low, "full");
  EXPECT_EQ(alarms.changes(), before + 1);
  alarms.raise("disk", AlarmPriority::low, "fuller");
  alarms.clear("disk");
  alarms.clear("disk");
  alarms.acknowledge("disk", "anna");
  EXPECT_EQ(alarms.changes(), before + 4);
  const auto events = alarms.drain_events();
  ASSERT_EQ(events.size(), 4u);
  EXPECT_EQ(events[0].time, 3s);
  EXPECT_TRUE(alarms.drain_events().empty());
  EXPECT_EQ(alarms.history()[0].raised, 3s);
  EXPECT_EQ(alarms.history()[0].times, 3);
}

TEST_F(AlarmsTest, OfOnePriorityTheOldestIsShownFirst) {
  for (const char* name : {"c", "a", "b"}) alarms.raise(name, AlarmPriority::low, "x");
  alarms.raise("z", AlarmPriority::medium, "x");
  std::string order;
  for (const Alarm& alarm : alarms.shown()) order += alarm.name;
  EXPECT_EQ(order, "zcab");
}

TEST_F(AlarmsTest, WithoutAnyTheMessageNamesNone) {
  EXPECT_EQ(alarms.acknowledge("", "anna"), 0);
  try {
    alarms.acknowledge("disk", "anna");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "no alarm 'disk' stands");
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
