// Frame validation: what stands still to the bit ends the loop at its third occurrence.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/frame_validator.h"

#include "devices/time/error.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

namespace vitreo {
namespace VITREO_TEST_FILE {

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

TEST_F(FrameValidatorTest, StampsAndNumbersMustBothGoOn) {
  using namespace std::chrono_literals;
  clock_->sleep_for(10s);
  const auto plausible = [&](std::uint64_t number, Time exposed) {
    return validator_.plausible({{}, number, exposed, clock_->now()});
  };
  EXPECT_TRUE(plausible(5, 9900ms));
  EXPECT_FALSE(plausible(6, 9900ms)) << "the same moment";
  EXPECT_FALSE(plausible(6, 9890ms));
  EXPECT_FALSE(plausible(5, 9950ms)) << "the same number";
  EXPECT_FALSE(plausible(4, 9950ms));
  EXPECT_TRUE(plausible(6, 9901ms)) << "what was refused is not remembered";
  ASSERT_EQ(recorder_.events().size(), 1u) << "told once";
  EXPECT_EQ(recorder_.events()[0].text,
            "top_camera: a frame is passed over: its time stamps are out of order");
  validator_.report_count();
  ASSERT_EQ(recorder_.events().size(), 2u);
  EXPECT_EQ(recorder_.events()[1].text,
            "top_camera: 4 frames were passed over for their time stamps");
}

TEST_F(FrameValidatorTest, WithoutAFrameThatWasPassedOverNothingIsReported) {
  validator_.report_count();
  EXPECT_TRUE(recorder_.events().empty());
}

// 0.2 s: docs/reliability.md says how far off a robot is by then.
TEST_F(FrameValidatorTest, AFrameMayBeAFifthOfASecondOldAndNoOlder) {
  using namespace std::chrono_literals;
  clock_->sleep_for(10s);
  EXPECT_TRUE(validator_.plausible({{}, 1, 9800ms, 10s}));
  clock_->sleep_for(20ms);
  EXPECT_FALSE(validator_.plausible({{}, 2, 9819ms, 10020ms}));
  EXPECT_NE(recorder_.events().at(0).text.find(" old: its clock is wrong"), std::string::npos);
}

// Also of a camera that begins with what cannot be believed, whenever it begins.
TEST_F(FrameValidatorTest, AFifthOfASecondWithoutABelievableFrameIsAFault) {
  using namespace std::chrono_literals;
  clock_->sleep_for(10s);
  FrameValidator validator(*clock_, recorder_, "top_camera");
  std::uint64_t number = 0;
  const auto old = [&] {
    const Time now = clock_->now();
    return validator.plausible({{}, ++number, now - 500ms, now});
  };
  const auto fails = [&] {
    for (int i = 0; i < 10; ++i) {
      EXPECT_FALSE(old()) << i;
      clock_->sleep_for(20ms);
    }
    EXPECT_FALSE(old()) << "0.2 s since the last one";
    clock_->sleep_for(1ms);
    EXPECT_THROW(old(), DeviceError);
  };
  fails();
  clock_->sleep_for(1s);
  EXPECT_TRUE(validator.plausible({{}, ++number, clock_->now(), clock_->now()}));
  fails();
}

TEST_F(FrameValidatorTest, APositionThatIsNoNumberCountsAsNotSeenAndIsToldOnce) {
  using Position = std::optional<Eigen::Vector3d>;
  const Position good(Eigen::Vector3d(1e-3, 0, 0));
  const Position bad(Eigen::Vector3d(1e-3, std::nan(""), 0));
  EXPECT_EQ(validator_.finite(good), good);
  EXPECT_EQ(validator_.finite(std::nullopt), std::nullopt);
  EXPECT_TRUE(recorder_.events().empty());
  EXPECT_EQ(validator_.finite(bad), std::nullopt);
  EXPECT_EQ(validator_.finite(bad), std::nullopt);
  EXPECT_EQ(recorder_.events().size(), 1u);
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(refused(bad)) << "not seen is no standstill";
}

TEST_F(FrameValidatorTest, PlacesThatComeBackToTheBitEndTheLoopAndOthersDoNot) {
  using Position = std::optional<Eigen::Vector3d>;
  for (int k = 0; k < 40; ++k)
    ASSERT_FALSE(refused(Position(Eigen::Vector3d(0, 0, 1e-9 * k)))) << k;
  const auto alternating = [](int k) { return Position(Eigen::Vector3d(k % 2, 1, 0)); };
  for (int k = 0; k < 7; ++k) ASSERT_FALSE(refused(alternating(k))) << k;
  EXPECT_TRUE(refused(alternating(7)));
}

TEST_F(FrameValidatorTest, SixInARowAreARepetitionAndOnlyOfTheLastSixteen) {
  const auto picture = [](int k) { return cv::Mat(2, 2, CV_32SC1, cv::Scalar(k)); };
  for (int k = 0; k < 60; ++k) ASSERT_FALSE(refused(picture(k % 17))) << k << ": 17 apart";
  FrameValidator validator(*clock_, recorder_, "top_camera");
  const auto five_again = [&](int first) {
    for (int k : {0, 1, 0, 1, 0, 1, 0}) EXPECT_NO_THROW(validator.must_change(picture(first + k)));
  };
  five_again(100);
  five_again(200);  // its first two are new: the count begins again
  EXPECT_THROW(validator.must_change(picture(201)), DeviceError);
}

// One bit anywhere, another shape or another type is another picture; also of one that is a part of
// a larger one.
TEST_F(FrameValidatorTest, OnlyWhatIsTheSameToTheLastBitStandsStill) {
  const cv::Mat large(8, 9, CV_8UC3, cv::Scalar(7, 7, 7));
  const auto part = [&large](int changed_row, int changed_column) {
    cv::Mat copy = large.clone();
    if (changed_row >= 0) copy.at<cv::Vec3b>(changed_row, changed_column)[2] ^= 1;
    return copy(cv::Rect(1, 1, 7, 6));
  };
  EXPECT_FALSE(refused(part(-1, 0)));
  EXPECT_FALSE(refused(part(-1, 0)));
  for (const auto& [row, column] : {std::pair{1, 1}, {6, 7}, {1, 7}, {6, 1}})
    EXPECT_FALSE(refused(part(row, column))) << row << " " << column;
  FrameValidator validator(*clock_, recorder_, "top_camera");
  const cv::Mat bytes(4, 6, CV_8UC1, cv::Scalar(7));
  for (const cv::Mat& other : {bytes, bytes.reshape(1, 6), bytes, bytes.reshape(2, 4), bytes})
    EXPECT_NO_THROW(validator.must_change(other.clone()));
  EXPECT_FALSE(refused(part(0, 0))) << "a change outside of the part is none";
  EXPECT_FALSE(refused(part(7, 8)));
  EXPECT_TRUE(refused(part(-1, 0)));
}

// Each begins as the one before does, and is larger, or of more channels, or there is none.
TEST_F(FrameValidatorTest, APictureThatBeginsAsTheLastOneIsAnother) {
  for (const cv::Mat& picture :
       {cv::Mat(2, 3, CV_8UC1, cv::Scalar(7)), cv::Mat(4, 3, CV_8UC1, cv::Scalar(7)),
        cv::Mat(8, 3, CV_8UC1, cv::Scalar(7)), cv::Mat(8, 9, CV_8UC1, cv::Scalar(7))})
    EXPECT_FALSE(refused(picture));
  for (const int channels : {1, 2, 3, 4})
    EXPECT_FALSE(refused(cv::Mat(5, 5, CV_8UC(channels), cv::Scalar::all(7))));
  for (int k = 0; k < 3; ++k) EXPECT_FALSE(refused(cv::Mat())) << "nothing is nothing's equal";
}

TEST_F(FrameValidatorTest, PicturesThatDifferInTheirFirstRowAloneAreNoRepetition) {
  for (int k = 0; k < 40; ++k) {
    cv::Mat picture(4, 6, CV_8UC1, cv::Scalar(7));
    picture.row(0).setTo(k);
    EXPECT_FALSE(refused(picture)) << k;
  }
}

TEST_F(FrameValidatorTest, OneFrameThatWasPassedOverIsReported) {
  clock_->sleep_for(std::chrono::seconds(10));
  EXPECT_TRUE(validator_.plausible({{}, 1, clock_->now(), clock_->now()}));
  EXPECT_FALSE(validator_.plausible({{}, 2, std::chrono::seconds(9), clock_->now()}));
  validator_.report_count();
  EXPECT_EQ(recorder_.events().back().text,
            "top_camera: 1 frames were passed over for their time stamps");
}

TEST(ArrivalDelay, IsHeldAgainstTheLeastOfTheLastTenToTwentySeconds) {
  using namespace std::chrono_literals;
  ArrivalDelay delay;
  EXPECT_EQ(delay.excess(30ms, 100s), 0ms);
  EXPECT_EQ(delay.excess(50ms, 101s), 20ms);
  EXPECT_EQ(delay.excess(-30ms, 102s), 0ms) << "the clocks' zeros are any";
  EXPECT_EQ(delay.excess(50ms, 110s), 80ms);
  EXPECT_EQ(delay.excess(50ms, 110s + 1ms), 80ms) << "of the ten seconds before";
  EXPECT_EQ(delay.excess(60ms, 120s), 90ms);
  EXPECT_EQ(delay.excess(60ms, 121s), 10ms) << "the least is twenty seconds old";
  EXPECT_EQ(delay.excess(40ms, 122s), 0ms);
  EXPECT_EQ(delay.excess(45ms, 123s), 5ms);
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

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
