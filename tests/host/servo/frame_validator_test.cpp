// Frame validation: what stands still to the bit ends the loop at its third occurrence.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/frame_validator.h"

#include "devices/time/error.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace {

class FrameValidatorTest : public testing::Test {
 protected:
  /// Whether it is taken for a device that stands still.
  template <class What>
  bool refused(const What& what) {
    try {
      validator_.must_change(what);
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::protocol);
      EXPECT_EQ(error.device, "top_camera");
      return true;
    }
    return false;
  }
  test::TemporaryFolder parent_;
  Recorder recorder_{parent_.path(), test::servo_start()};
  const std::unique_ptr<Clock> clock_ = virtual_clock();
  FrameValidator validator_{*clock_, recorder_, "top_camera"};
};

TEST_F(FrameValidatorTest, TheThirdEqualPictureEndsTheLoop) {
  const cv::Mat one(4, 6, CV_8UC1, cv::Scalar(7));
  const cv::Mat other(4, 6, CV_8UC1, cv::Scalar(8));
  for (const cv::Mat& picture : {one, one, other, other, one, one})
    EXPECT_FALSE(refused(picture.clone()));
  EXPECT_TRUE(refused(one.clone()));
}

TEST_F(FrameValidatorTest, TheThirdEqualPositionEndsTheLoopAndNoneIsNone) {
  using Position = std::optional<Eigen::Vector3d>;
  const Position one(Eigen::Vector3d(1e-3, 0, 0));
  const Position other(Eigen::Vector3d(1e-3, 0, 1e-9));
  const Position none;
  for (const Position& position : {one, one, other, other, none, none, none, one, one})
    EXPECT_FALSE(refused(position));
  EXPECT_TRUE(refused(one));
}

TEST_F(FrameValidatorTest, PicturesThatComeBackToTheBitEndTheLoop) {
  for (const int cycle : {2, 3, 7, 16}) {
    FrameValidator validator(*clock_, recorder_, "top_camera");
    const auto picture = [&](int k) { return cv::Mat(4, 6, CV_8UC1, cv::Scalar(k % cycle)); };
    for (int k = 0; k < cycle + 5; ++k) ASSERT_NO_THROW(validator.must_change(picture(k))) << k;
    EXPECT_THROW(validator.must_change(picture(cycle + 5)), DeviceError) << cycle;
  }
}

TEST_F(FrameValidatorTest, AClockThatLeapsIsNamedBeforeTheDeadManActs) {
  using namespace std::chrono_literals;
  FrameValidator validator(*clock_, recorder_, "top_camera", 0.02);
  std::uint64_t number = 0;
  const auto next = [&](Time wrong) {
    clock_->sleep_for(20ms);
    const Time now = clock_->now();
    return validator.plausible({{}, ++number, now - 80ms + wrong, now});
  };
  for (int k = 0; k < 50; ++k) ASSERT_TRUE(next(0ms));
  const Time leapt = clock_->now();
  try {
    for (;;) EXPECT_FALSE(next(60ms));
  } catch (const DeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("its clock was set, or drifts"), std::string::npos)
        << error.what();
  }
  EXPECT_LT(clock_->now() - leapt, 250ms);
}

/// A frame that has just come, of a camera whose clock is `ahead` of the host's and has taken
/// `delay` to bring it.
Frame arrived(const Clock& clock, std::uint64_t number, Time ahead, Time delay) {
  const Time now = clock.now();
  return {{}, number, now, now, now - delay + ahead};
}

TEST_F(FrameValidatorTest, AFrameThatTheCamerasOwnClockCallsOldIsPassedOverThoughItHasJustCome) {
  using namespace std::chrono_literals;
  std::uint64_t number = 0;
  const Time ahead = 1000s;  // whatever its zero is
  const auto plausible = [&](Time delay) {
    clock_->sleep_for(66ms);
    return validator_.plausible(arrived(*clock_, ++number, ahead, delay));
  };
  for (int i = 0; i < 30; ++i) EXPECT_TRUE(plausible(30ms));
  EXPECT_TRUE(plausible(230ms)) << "late, and young enough";
  EXPECT_FALSE(plausible(830ms));
  EXPECT_TRUE(plausible(30ms));
  EXPECT_THROW(
      {
        for (int i = 0; i < 30; ++i) plausible(830ms);
      },
      DeviceError)
      << "after a second of these the camera has failed";
}

TEST_F(FrameValidatorTest, ACamerasClockMayDriftAsQuartzDoes) {
  using namespace std::chrono_literals;
  std::uint64_t number = 0;
  for (int i = 0; i < 3600 * 3; ++i) {  // an hour; 200 ppm make 0.7 s of it
    clock_->sleep_for(333ms);
    const Time drift = clock_->now() / 5000;
    ASSERT_TRUE(validator_.plausible(arrived(*clock_, ++number, -drift, 30ms))) << i;
  }
}

}  // namespace
}  // namespace vitreo
