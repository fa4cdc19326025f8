// Stamp watch: a clock that is set, drifts or is ahead is told from frames that are late, jitter,
// or come when they like.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/stamp_watch.h"

#include <gtest/gtest.h>

#include <random>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

constexpr Time kPeriod = 20ms;
constexpr Time kLatency = 80ms;

/// A camera with a true exposure every period.
struct Camera {
  StampWatch watch{to_seconds(kPeriod)};
  std::uint64_t number = 0;
  /// The stamp that much wrong, the arrival that much later.
  std::string next(Time wrong = 0ms, Time late = 0ms) {
    const Time exposed = static_cast<std::int64_t>(++number) * kPeriod;
    const Time received = exposed + kLatency + late;
    return watch.fault({{}, number, exposed + wrong, received}, received);
  }
  void run(int frames) {
    for (int i = 0; i < frames; ++i) ASSERT_EQ(next(), "");
  }
};

TEST(StampWatch, TellsALeapOfTheClockAtTheFirstFrame) {
  for (const Time leap : {-600ms, -300ms, -60ms, -20ms, -12ms, 12ms, 20ms, 60ms}) {
    Camera camera;
    camera.run(100);
    const std::string fault = camera.next(leap);
    EXPECT_NE(fault.find("have moved by"), std::string::npos) << leap.count() << ": " << fault;
  }
}

TEST(StampWatch, TellsThatAFrameIsOfTheFuture) {
  Camera camera;
  camera.run(3);
  EXPECT_NE(camera.next(82ms).find("are 2 ms in the future"), std::string::npos);
  EXPECT_EQ(camera.next(), "") << "the next one is judged by itself";
}

TEST(StampWatch, LetsFramesBeLateAndLost) {
  Camera camera;
  camera.run(10);
  EXPECT_EQ(camera.next(0ms, 60ms), "");
  for (int i = 0; i < 200; ++i) EXPECT_EQ(camera.next(0ms, 100ms), "") << "late for good";
  camera.number += 40;
  EXPECT_EQ(camera.next(), "");
}

TEST(StampWatch, LetsArrivalsJitter) {
  std::mt19937 random(1);
  std::uniform_int_distribution<int> late(0, 18000);
  Camera camera;
  for (int i = 0; i < 3000; ++i)
    ASSERT_EQ(camera.next(0ms, std::chrono::microseconds(late(random))), "") << i;
}

TEST(StampWatch, TellsADriftBeforeItIsThirtyMilliseconds) {
  for (const double rate : {2e-3, 5e-3, 20e-3, -2e-3, -20e-3}) {
    Camera camera;
    double wrong = 0;
    std::string fault;
    while (fault.empty() && std::abs(wrong) < 0.1) {
      fault = camera.next(from_seconds(wrong));
      wrong += rate * to_seconds(kPeriod);
    }
    EXPECT_LT(std::abs(wrong), 0.045) << rate;
    EXPECT_FALSE(fault.empty());
  }
}

TEST(StampWatch, LetsCrystalsBeFarApartForHours) {
  Camera camera;
  for (int i = 0; i < 100'000; ++i)  // 2000 s
    ASSERT_EQ(camera.next(-static_cast<std::int64_t>(i) * kPeriod / 5000), "") << i;
}

TEST(StampWatch, LetsACameraExposeWhenItLikes) {
  StampWatch watch(to_seconds(kPeriod));
  std::mt19937 random(2);
  std::uniform_int_distribution<int> pause(15, 120);
  Time exposed{};
  for (std::uint64_t number = 1; number < 500; ++number) {
    exposed += std::chrono::milliseconds(pause(random));
    ASSERT_EQ(watch.fault({{}, number, exposed, exposed + kLatency}, exposed + kLatency), "");
  }
}

/// Two frames of one number: what the second one's stamp and arrival have moved by is exact.
std::string second(Time stamp, Time arrival) {
  StampWatch watch(to_seconds(kPeriod));
  EXPECT_EQ(watch.fault({{}, 7, 1s, 2s}, 2s), "");
  return watch.fault({{}, 7, 1s + stamp, 2s + arrival}, 3s);
}

// docs/reliability.md: a leap of more than 10 ms is told, by its size.
TEST(StampWatch, LetsTenMillisecondsPassAndNoMore) {
  EXPECT_EQ(second(10ms, 0ms), "");
  EXPECT_EQ(second(-10ms, 0ms), "");
  EXPECT_NE(second(10001us, 0ms), "");
  EXPECT_NE(second(-10001us, 0ms), "");
  EXPECT_NE(second(50ms, 0ms).find("moved by 50 ms"), std::string::npos) << second(50ms, 0ms);
  EXPECT_NE(second(-50ms, 0ms).find("moved by -50 ms"), std::string::npos);
}

// Both must be beyond it: by the arrival and by the number.
TEST(StampWatch, BelievesAStampThatIsNearItsNumberWhateverTheArrival) {
  EXPECT_EQ(second(8ms, -7ms), "") << "15 ms by the arrival, 8 by the number";
  EXPECT_EQ(second(-8ms, 7ms), "");
}

// Where arrivals are no nearer to the numbers than the stamps are, it is not known which is wrong.
TEST(StampWatch, JudgesByArrivalsOnlyWhereTheyKeepToTheNumbers) {
  EXPECT_EQ(second(50ms, -50ms), "") << "as far off";
  EXPECT_NE(second(50ms, -49ms), "");
  EXPECT_EQ(second(20ms, 35ms), "") << "it was exposed late and came later";
}

TEST(StampWatch, BelievesAStampUpToTheMomentOfItsArrival) {
  StampWatch watch(to_seconds(kPeriod));
  EXPECT_EQ(watch.fault({{}, 1, 5s, 5s}, 5s), "");
}

TEST(StampWatch, LetsACameraExposeWhenItLikesWithArrivalsThatJitter) {
  StampWatch watch(to_seconds(kPeriod));
  std::mt19937 random(3);
  std::uniform_int_distribution<int> pause(15, 120), late(0, 9);
  Time exposed{};
  for (std::uint64_t number = 1; number < 500; ++number) {
    exposed += std::chrono::milliseconds(pause(random));
    const Time received = exposed + kLatency + std::chrono::milliseconds(late(random));
    ASSERT_EQ(watch.fault({{}, number, exposed, received}, received), "") << number;
  }
}

// That is another fault, told by the frame validator.
TEST(StampWatch, DoesNotJudgeFramesThatAreOutOfOrder) {
  Camera camera;
  camera.number = 100;
  camera.run(600);
  const Time now = 700 * kPeriod + kLatency;
  EXPECT_EQ(camera.watch.fault({{}, 7, 7 * kPeriod + 5s, now}, now), "") << "before the first";
  EXPECT_EQ(camera.watch.fault({{}, 105, 105 * kPeriod, now}, now), "") << "before the anchor";
  EXPECT_NE(camera.watch.fault({{}, 105, 105 * kPeriod + 40ms, 105 * kPeriod + kLatency}, now), "")
      << "held against the first all the same";
}

// Held against some seconds ago, not against the first alone.
TEST(StampWatch, TellsASlowDriftByTheSecondsBefore) {
  for (const std::uint64_t begun : {0, 50'000}) {  // at once, and 1000 s after the clock's zero
    for (const double rate : {1.5e-3, -1.5e-3, 4e-3}) {
      Camera camera;
      camera.number = begun;
      double wrong = 0;
      while (camera.next(from_seconds(wrong)).empty() && std::abs(wrong) < 0.1)
        wrong += rate * to_seconds(kPeriod);
      EXPECT_LT(std::abs(wrong), 13e-3) << rate << " from " << begun;
    }
  }
}

// Each second on, a quarter of a millisecond: nothing of that is a leap of the seconds before.
TEST(StampWatch, TellsWhatDriftsBelowThatByTheFirstFrame) {
  for (const std::uint64_t begun : {0, 50'000}) {
    Camera camera;
    camera.number = begun;
    double wrong = 0;
    while (camera.next(from_seconds(wrong)).empty() && wrong < 0.5)
      wrong += 0.9e-3 * to_seconds(kPeriod);
    // 30 ms + 0.5 ms/s t = 0.9 ms/s t at t = 75 s
    EXPECT_NEAR(wrong, 67.5e-3, 1e-3) << begun;
  }
}

TEST(StampWatch, OfAnUnknownPeriodJudgesTheFutureAlone) {
  StampWatch watch(0);
  EXPECT_EQ(watch.fault({{}, 1, 0ms, 80ms}, 80ms), "");
  EXPECT_EQ(watch.fault({{}, 2, 90ms, 100ms}, 100ms), "");
  EXPECT_NE(watch.fault({{}, 3, 121ms, 120ms}, 120ms), "");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
