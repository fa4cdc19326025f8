// Allocations of the color tracker: none per frame after its first ones; of the level set: none
// after it was told how large its regions may be.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/level_set_reference.h"
#include "tests/vision/sequence_generator.h"
#include "vision/color_tracker.h"
#include "vision/level_set.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <new>
#include <vector>

namespace {
thread_local bool counting = false;
thread_local int allocations = 0;
}  // namespace

// Replaces the program's: it counts only where a test asks for it. Not inlined: GCC would take
// malloc and free for a mismatch.
[[gnu::noinline]] void* operator new(std::size_t size) {
  allocations += counting;
  if (void* memory = std::malloc(size == 0 ? 1 : size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void* operator new(std::size_t size,
                                     const std::nothrow_t&) noexcept {  // std::stable_sort's
  allocations += counting;
  return std::malloc(size == 0 ? 1 : size);
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace vitreo::vision {
namespace {

TEST(ColorTracker, allocates_nothing_per_frame_whether_it_tracks_or_searches) {
  generated::Sequence sequence({.seed = 805});
  ColorTracker tracker(ObjectModel::train(sequence.training(8), {}, {}), {});
  std::vector<cv::Mat> images;
  for (int k = 0; k < 30; ++k) images.push_back(sequence.frame(k).image);
  for (int k = 0; k < 8; ++k) images.push_back(cv::Mat::zeros(480, 640, CV_8UC3));
  tracker.update(images[0]);
  counting = true;
  for (const cv::Mat& image : images) tracker.update(image);
  counting = false;
  EXPECT_EQ(allocations, 0);
}

// The most that a region can ask for: every second column is another object's, so that each row has
// as many runs as fit, and every pixel inside is at the front.
TEST(LevelSetMemory, nothing_is_allocated_once_room_was_made_for_the_largest_region) {
  constexpr int kSide = 120;
  const cv::Mat image(200, 200, CV_8UC3, cv::Scalar(0, 0, 0));
  cv::Mat owned(image.size(), CV_8UC1, cv::Scalar(0));
  for (int u = 0; u < owned.cols; u += 2) owned.col(u).setTo(2);
  const Ellipse all{{100, 100}, 400, 400, 0};
  level_set_reference::Blue blue;
  Evidence striped;
  Evidence plain;
  striped.look(image, blue, all, kSide, owned, 7);
  plain.look(image, blue, {{100, 100}, 30, 20, 0.4}, kSide);
  ASSERT_GE(striped.region().width, kSide);
  ASSERT_GE(striped.region().height, kSide);
  LevelSetSettings settings;
  settings.max_points = 20000;
  LevelSet level_set(settings);
  level_set.reserve(kSide);
  std::vector<FrontPoint> points;
  points.reserve(20000);
  counting = true;
  allocations = 0;
  level_set.start(plain, {{100, 100}, 25, 14, 0.3});
  level_set.evolve({-1, 1});
  level_set.keep_largest();
  level_set.start(striped, all);
  level_set.evolve({-1, 1});
  level_set.front(points);
  const Segment segment = level_set.keep_largest();
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(points.size(), kSide * kSide * 2 / 3);
  EXPECT_GT(segment.area_px, kSide / 2);
  EXPECT_FALSE(level_set.leaked());
}

}  // namespace
}  // namespace vitreo::vision
