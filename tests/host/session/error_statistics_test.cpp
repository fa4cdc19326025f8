// SPDX-License-Identifier: Apache-2.0
#include "host/session/error_statistics.h"

#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using test::servo_start;
using test::TemporaryFolder;

const std::vector<Channel> kPlace = {{"x", "m"}, {"y", "m"}, {"z", "m"}};

class Statistics : public testing::Test {
 protected:
  Statistics() : recorder_(parent_.path(), servo_start()) {
    const int truth = recorder_.add_stream({"truth", "", kPlace});
    const int servo = recorder_.add_stream(
        {"servo",
         "",
         {{"target_x", "m"}, {"target_y", "m"}, {"target_z", "m"}, {"current_1", "A"}}});
    const double nothing = std::numeric_limits<double>::quiet_NaN();
    recorder_.sample(truth, Time{0}, std::array{9.0, 9.0, 9.0});  // before the span
    recorder_.sample(truth, Time{10}, std::array{3.0, 4.0, 0.0});
    recorder_.sample(truth, Time{20}, std::array{1.0, 0.0, -12.0});
    recorder_.sample(truth, Time{25}, std::array{7.0, 7.0, 7.0});  // no row to compare with
    recorder_.sample(truth, Time{30}, std::array{nothing, 0.0, 0.0});
    for (int t : {0, 10, 20, 30})
      recorder_.sample(servo, Time{t}, std::array{t == 20 ? 1.0 : 0.0, 0.0, 0.0, 5.0});
  }
  TemporaryFolder parent_;
  Recorder recorder_;
};

TEST_F(Statistics, AgreeWithTheHand) {
  const ErrorStatistics result =
      error_statistics(recorder_, "truth", "", "servo", "target_", Time{5}, Time{30});
  EXPECT_EQ(result.count, 2u);                         // errors (3, 4, 0) and (0, 0, -12)
  EXPECT_DOUBLE_EQ(result.rms, std::sqrt(169.0 / 2));  // norms 5 and 12
  EXPECT_DOUBLE_EQ(result.mean, 8.5);
  EXPECT_DOUBLE_EQ(result.max, 12);
  EXPECT_DOUBLE_EQ(result.lateral_rms, std::sqrt(12.5));
  EXPECT_DOUBLE_EQ(result.lateral_mean, 2.5);
  EXPECT_DOUBLE_EQ(result.lateral_max, 5);
  EXPECT_DOUBLE_EQ(result.lateral_std, std::sqrt(12.5));  // of two: |5 - 0| / sqrt 2
  EXPECT_DOUBLE_EQ(result.depth_rms, std::sqrt(72.0));
  EXPECT_DOUBLE_EQ(result.depth_mean, 6);
  EXPECT_DOUBLE_EQ(result.depth_max, 12);
  EXPECT_DOUBLE_EQ(result.depth_std, std::sqrt(72.0));
}

// Two cameras that run freely share no moment: straight lines between rows that are near enough.
TEST_F(Statistics, OfStreamsThatShareNoMomentAreInterpolated) {
  const int slow = recorder_.add_stream({"slow", "", kPlace});
  const int fast = recorder_.add_stream({"fast", "", kPlace});
  const auto ms = [](int count) { return Time(std::chrono::milliseconds(count)); };
  for (const int t : {0, 100, 200, 500})
    recorder_.sample(slow, ms(t), std::array{t * 1e-3, 0.0, 0.0});  // 1 m/s along x
  for (const int t : {50, 175, 350})                                // the last in a gap
    recorder_.sample(fast, ms(t), std::array{t * 1e-3, 0.0, t == 50 ? 2.0 : 4.0});
  const ErrorStatistics result =
      error_statistics(recorder_, "fast", "", "slow", "", Time{0}, ms(1000));
  EXPECT_EQ(result.count, 2u);
  EXPECT_NEAR(result.lateral_max, 0, 1e-12);
  EXPECT_DOUBLE_EQ(result.depth_mean, 3);
}

TEST_F(Statistics, OfNothingAreZero) {
  const ErrorStatistics result =
      error_statistics(recorder_, "truth", "", "servo", "target_", Time{100}, Time{200});
  EXPECT_EQ(result.count, 0u);
  EXPECT_EQ(result.rms, 0);
  EXPECT_EQ(result.lateral_std, 0);
}

TEST_F(Statistics, NameWhatIsMissing) {
  const auto error_of = [&](const char* stream, const char* prefix) -> std::string {
    try {
      error_statistics(recorder_, stream, prefix, "servo", "target_", Time{0}, Time{9});
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "no error";
  };
  EXPECT_EQ(error_of("thruth", ""), "stream \"thruth\" is not in the record");
  EXPECT_EQ(error_of("truth", "target_"), "stream \"truth\" has no channel \"target_x\"");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
