// Allocations of the color tracker: none per frame after its first ones.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/sequence_generator.h"
#include "vision/color_tracker.h"

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

}  // namespace
}  // namespace vitreo::vision
