// Color tracker through views that jump: the eye turned or the microscope was moved, between two
// frames and farther than any robot swims. Truth and view are windows cut out of a larger scene.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/sequence_generator.h"
#include "vision/color_tracker.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using Eigen::Vector2d;

const cv::Size kView(640, 480), kScene(960, 720);
const Vector2d kMiddle(160, 120);  // a window's corner

/// Of the way of a view; the ground goes the other way in the image.
std::vector<Vector2d> ways(double length) {
  std::vector<Vector2d> all;
  for (int k = 0; k < 9; ++k)
    if (k != 4) all.push_back(length * Vector2d(k % 3 - 1, k / 3 - 1));
  return all;
}
const std::vector<double> kLengths{20, 40, 60, 100};

struct Seen {
  cv::Mat image;
  Ellipse truth;  ///< in the window
};

/// A ground with a robot, of which a window is seen. Lamp and noise go with the ground.
class Scene {
 public:
  explicit Scene(std::uint64_t seed, bool dark_vessels = false)
      : sequence_({.seed = seed,
                   .size = kScene,
                   .dark_vessels = dark_vessels,
                   .path = [this](int) { return robot_; },
                   .lamp = [this](int) { return cv::Vec3f::all(light_); }}) {}

  /// Where the robot is in the scene; nothing: nowhere.
  void put(const std::optional<Ellipse>& robot) {
    robot_ = robot.value_or(Ellipse{{-400, -400}, 30, 15, 0});
  }
  void light(float factor) { light_ = factor; }
  generated::Frame whole(int k) { return sequence_.frame(k); }
  Seen window(int k, const Vector2d& corner) { return cut(whole(k), corner); }
  static Seen cut(const generated::Frame& whole, const Vector2d& corner) {
    const cv::Point at(static_cast<int>(corner.x()), static_cast<int>(corner.y()));
    Seen out{whole.image(cv::Rect(at, kView)).clone(), whole.truth};
    out.truth.center_px -= Vector2d(at.x, at.y);
    return out;
  }

 private:
  Ellipse robot_{{480, 360}, 30, 15, 0.4};
  float light_ = 1;
  generated::Sequence sequence_;
};

/// Up to 2 px and a degree a frame, about the scene's middle.
Ellipse swimming(int k) {
  return {{480 + 22 * std::sin(0.09 * k), 360 + 15 * std::cos(0.11 * k)},
          30,
          15,
          0.4 + 0.3 * std::sin(0.05 * k)};
}

const ObjectModel& model(std::uint64_t seed, bool dark_vessels = false) {
  static std::map<std::pair<std::uint64_t, bool>, ObjectModel> trained;
  auto found = trained.find({seed, dark_vessels});
  if (found == trained.end()) {
    generated::Sequence sequence({.seed = seed, .dark_vessels = dark_vessels});
    const ObjectModel fresh = ObjectModel::train(sequence.training(12), {}, {});
    found = trained.emplace(std::pair(seed, dark_vessels), fresh).first;
  }
  return found->second;
}

constexpr std::uint64_t kSeeds[] = {3901, 3902, 3903};
constexpr int kBefore = 9;  // frames until the view jumps

/// A tracker that follows the robot, which swims before a window that stands still.
struct Followed {
  Scene scene;
  ColorTracker tracker;
  explicit Followed(std::uint64_t seed, bool dark_vessels = false, int frames = kBefore)
      : scene(seed, dark_vessels), tracker(model(seed, dark_vessels), {}) {
    Track last;
    for (int k = 0; k < frames; ++k) {
      scene.put(swimming(k));
      last = tracker.update(scene.window(k, kMiddle).image);
    }
    EXPECT_EQ(last.state, TrackState::tracking) << seed;
  }
};

double off_px(const Track& track, const Ellipse& truth) {
  return (track.measured->ellipse.center_px - truth.center_px).norm();
}

/// Tracked in this very frame, within 3 px and five of its own deviations.
void expect_tracked(const Track& track, const Ellipse& truth) {
  ASSERT_EQ(track.state, TrackState::tracking);
  ASSERT_TRUE(track.measured);
  EXPECT_LT(off_px(track, truth), 3);
  const Vector2d off = track.measured->ellipse.center_px - truth.center_px;
  const Eigen::Matrix2d covariance = track.measured->covariance.topLeftCorner<2, 2>();
  EXPECT_LT(off.dot(covariance.inverse() * off), 25);
  EXPECT_LE(track.work, ColorTracker::kMostWork);
}

/// The robot goes on being tracked in the very frame in which the view jumps, by each way apart.
void expect_kept(const std::vector<Vector2d>& jumps) {
  for (const std::uint64_t seed : kSeeds) {
    Followed followed(seed);
    const TrackMemory before = followed.tracker.memory();
    followed.scene.put(swimming(kBefore));
    const generated::Frame whole = followed.scene.whole(kBefore);
    for (const Vector2d& way : jumps) {
      SCOPED_TRACE(testing::Message() << seed << " view by " << way.transpose());
      followed.tracker.restore(before);
      const Seen seen = Scene::cut(whole, kMiddle + way);
      expect_tracked(followed.tracker.update(seen.image), seen.truth);
    }
  }
}

TEST(DisplacedView, keeps_the_robot_in_the_frame_in_which_the_view_jumps) {
  for (const double length : kLengths) {
    const auto all = ways(length);
    expect_kept({all.begin(), all.end()});
  }
}

// Neither by as far along u and v nor by whole cells of a thumbnail, or by odd numbers of them.
TEST(DisplacedView, keeps_the_robot_whatever_the_view_jumps_by) {
  expect_kept({Vector2d(-60, -30), Vector2d(50, 50), Vector2d(30, -70), Vector2d(-90, 10),
               Vector2d(34, -46), Vector2d(-16, 12), Vector2d(74, 108), Vector2d(-110, 90)});
}

TEST(DisplacedView, goes_on_as_if_nothing_had_been_after_a_jump) {
  for (const std::uint64_t seed : kSeeds) {
    Followed followed(seed);
    for (int k = kBefore; k < kBefore + 8; ++k) {
      SCOPED_TRACE(testing::Message() << seed << ' ' << k);
      followed.scene.put(swimming(k));
      const Seen seen = followed.scene.window(k, kMiddle + Vector2d(-60, 40));
      expect_tracked(followed.tracker.update(seen.image), seen.truth);
    }
  }
}

TEST(DisplacedView, keeps_the_robot_through_two_jumps_in_a_row) {
  for (const std::uint64_t seed : kSeeds) {
    Followed followed(seed);
    const TrackMemory before = followed.tracker.memory();
    followed.scene.put(swimming(kBefore));
    const generated::Frame one = followed.scene.whole(kBefore);
    followed.scene.put(swimming(kBefore + 1));
    const generated::Frame two = followed.scene.whole(kBefore + 1);
    for (const double length : {40.0, 60.0})
      for (const Vector2d& way : ways(length))
        for (const Vector2d& then :
             {Vector2d(0, 0), Vector2d(2 * way), Vector2d(-way.y(), way.x())}) {
          SCOPED_TRACE(testing::Message()
                       << seed << " view by " << way.transpose() << ", at " << then.transpose());
          followed.tracker.restore(before);
          const Seen first = Scene::cut(one, kMiddle + way),
                     second = Scene::cut(two, kMiddle + then);
          expect_tracked(followed.tracker.update(first.image), first.truth);
          expect_tracked(followed.tracker.update(second.image), second.truth);
        }
  }
}

// The view wanders by 2 px a frame before it jumps, in any of the frames since the first track.
TEST(DisplacedView, keeps_the_robot_when_a_wandering_view_jumps_whenever_it_does) {
  for (const std::uint64_t seed : kSeeds) {
    Scene scene(seed);
    ColorTracker tracker(model(seed), {});
    for (int k = 0; k < 26; ++k) {
      scene.put(swimming(k));
      const generated::Frame whole = scene.whole(k);
      const Vector2d corner = kMiddle + Vector2d(2 * k - 26, 26 - 2 * k);
      const TrackMemory before = tracker.memory();
      if (k > 3) {
        for (const Vector2d& way : {Vector2d(60, 40), Vector2d(-40, 60), Vector2d(-60, -30)}) {
          SCOPED_TRACE(testing::Message() << seed << ' ' << k << " by " << way.transpose());
          const Seen jumped = Scene::cut(whole, corner + way);
          expect_tracked(tracker.update(jumped.image), jumped.truth);
          tracker.restore(before);
        }
      }
      tracker.update(Scene::cut(whole, corner).image);
    }
  }
}

TEST(DisplacedView, is_never_wrong_when_view_and_light_change_at_once) {
  int tracked = 0, asked = 0;
  for (const std::uint64_t seed : kSeeds)
    for (const float light : {0.7F, 1.3F}) {
      Followed followed(seed);
      const TrackMemory before = followed.tracker.memory();
      followed.scene.light(light);
      std::vector<generated::Frame> later;
      for (int k = kBefore; k < kBefore + 4; ++k) {
        followed.scene.put(swimming(k));
        later.push_back(followed.scene.whole(k));
      }
      for (const Vector2d& way : ways(60)) {
        followed.tracker.restore(before);
        for (const generated::Frame& whole : later) {
          const Seen seen = Scene::cut(whole, kMiddle + way);
          const Track track = followed.tracker.update(seen.image);
          ++asked;
          if (track.state != TrackState::tracking) continue;
          ++tracked;
          EXPECT_LT(off_px(track, seen.truth), 5) << seed << ' ' << light << ' ' << way.transpose();
        }
      }
    }
  EXPECT_GT(tracked, asked / 2);  // or it would be never wrong for being silent
}

// It is out of sight while the view is turned away; what is kept of the ground tells when it is
// back.
TEST(DisplacedView, keeps_the_robot_when_the_view_that_lost_it_comes_back_displaced) {
  for (const std::uint64_t seed : kSeeds) {
    Followed followed(seed);
    for (int k = kBefore; k < kBefore + 2; ++k) {
      followed.scene.put({});
      const Track track = followed.tracker.update(followed.scene.window(k, {60, 200}).image);
      EXPECT_EQ(track.state, TrackState::coasting) << seed;
    }
    followed.scene.put(swimming(kBefore + 1));
    const Seen seen = followed.scene.window(kBefore + 2, kMiddle + Vector2d(40, -60));
    SCOPED_TRACE(seed);
    expect_tracked(followed.tracker.update(seen.image), seen.truth);
  }
}

// Found anew, and where the ground has come meanwhile: what was kept of it before is of no use.
TEST(DisplacedView, keeps_a_robot_that_was_found_again_in_a_view_that_had_wandered_on) {
  for (const std::uint64_t seed : kSeeds) {
    Followed followed(seed);
    Vector2d corner = kMiddle;
    TrackState state = TrackState::tracking;
    int k = kBefore;
    for (; k < kBefore + 20 && (k < kBefore + 9 || state != TrackState::tracking); ++k) {
      const bool hidden = k < kBefore + 8;
      followed.scene.put(hidden ? std::nullopt : std::optional(swimming(k)));
      if (hidden) corner += Vector2d(-8, 6);
      state = followed.tracker.update(followed.scene.window(k, corner).image).state;
    }
    ASSERT_EQ(state, TrackState::tracking) << seed;
    followed.scene.put(swimming(k));
    const Seen seen = followed.scene.window(k, corner + Vector2d(60, 40));
    SCOPED_TRACE(seed);
    expect_tracked(followed.tracker.update(seen.image), seen.truth);
  }
}

// What an operator points at has nothing to do with the ground that was seen before.
TEST(DisplacedView, forgets_the_ground_when_it_is_told_where_the_robot_is) {
  Followed followed(kSeeds[0]);
  const cv::Mat seen = followed.scene.window(kBefore, kMiddle).image;
  ASSERT_TRUE(followed.tracker.memory().ground.jump_to(seen));
  followed.tracker.place({{100, 100}, 30, 15, 0});
  EXPECT_FALSE(followed.tracker.memory().ground.jump_to(seen));
}

/// What is shown from the jump on has no robot: nothing may be tracked, then and afterwards.
void expect_none(Followed& followed, const Vector2d& way, int frames) {
  for (int k = 0; k < frames; ++k) {
    const Seen seen = followed.scene.window(kBefore + k, kMiddle + way);
    const Track track = followed.tracker.update(seen.image);
    EXPECT_NE(track.state, TrackState::tracking) << k << " after " << way.transpose();
    EXPECT_FALSE(track.measured) << k;
  }
}

TEST(DisplacedView, tracks_nothing_when_the_robot_vanishes_as_the_view_jumps) {
  for (const std::uint64_t seed : kSeeds)
    for (const bool dark_vessels : {false, true}) {
      SCOPED_TRACE(testing::Message() << seed << (dark_vessels ? " dark vessels" : ""));
      Followed followed(seed, dark_vessels);
      const TrackMemory before = followed.tracker.memory();
      followed.scene.put({});
      const generated::Frame whole = followed.scene.whole(kBefore);
      for (const double length : kLengths)
        for (const Vector2d& way : ways(length)) {
          followed.tracker.restore(before);
          const Track track = followed.tracker.update(Scene::cut(whole, kMiddle + way).image);
          EXPECT_NE(track.state, TrackState::tracking) << way.transpose();
          EXPECT_FALSE(track.measured);
          EXPECT_LE(track.work, ColorTracker::kMostWork);
        }
      followed.tracker.restore(before);
      expect_none(followed, {60, -40}, 10);
    }
}

TEST(DisplacedView, tracks_nothing_when_the_robot_leaves_a_ground_that_stands_still) {
  for (const std::uint64_t seed : kSeeds) {
    Followed followed(seed);
    followed.scene.put({});
    expect_none(followed, {0, 0}, 12);
  }
}

TEST(DisplacedView, keeps_a_robot_that_stays_in_the_image_while_the_ground_jumps) {
  for (const std::uint64_t seed : kSeeds) {
    Followed followed(seed);
    const TrackMemory before = followed.tracker.memory();
    for (const double length : kLengths)
      for (const Vector2d& way : ways(length)) {
        if (length == 40 && way.x() * way.y() != 0) continue;  // for the time it takes
        SCOPED_TRACE(testing::Message() << seed << " ground by " << -way.transpose());
        Ellipse at = swimming(kBefore);
        at.center_px += way;
        followed.scene.put(at);
        const Seen seen = followed.scene.window(kBefore, kMiddle + way);
        followed.tracker.restore(before);
        expect_tracked(followed.tracker.update(seen.image), seen.truth);
      }
  }
}

TEST(DisplacedView, gives_exactly_the_same_track_again_after_restoring_what_it_remembered) {
  for (const std::uint64_t seed : kSeeds) {
    Followed followed(seed);
    ColorTracker other(model(seed), {});
    const TrackMemory before = followed.tracker.memory();
    followed.scene.put(swimming(kBefore));
    const generated::Frame whole = followed.scene.whole(kBefore);
    for (const Vector2d& way : ways(60)) {
      Track first[2], again[2], elsewhere[2];
      const Seen seen[] = {Scene::cut(whole, kMiddle + way), Scene::cut(whole, kMiddle - way)};
      for (Track* tracks : {first, again, elsewhere}) {
        ColorTracker& tracker = tracks == elsewhere ? other : followed.tracker;
        tracker.restore(before);
        for (int k = 0; k < 2; ++k) tracks[k] = tracker.update(seen[k].image);
      }
      for (int k = 0; k < 2; ++k)
        for (const Track& same : {again[k], elsewhere[k]}) {
          ASSERT_EQ(first[k].state, same.state);
          ASSERT_TRUE(first[k].measured && same.measured);
          EXPECT_EQ(first[k].measured->ellipse.vector(), same.measured->ellipse.vector());
          EXPECT_EQ(first[k].measured->covariance, same.measured->covariance);
          EXPECT_EQ(first[k].work, same.work);
          EXPECT_TRUE((first[k].light == same.light).all());
        }
    }
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
