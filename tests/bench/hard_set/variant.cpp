// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/hard_set/variant.h"

namespace vitreo::hard_set {

// Issue 22's words, and the review's variants behind them, in their order: ground, robot and what
// covers it, light, camera, training. Append at the end: a variant's number is a part of its seeds.
std::vector<Variant> all_variants() {
  return {
      {.name = "plain"},
      {.name = "ground drifts 1 px a frame", .drift_px = 1},
      {.name = "ground drifts 2 px a frame", .drift_px = 2},
      {.name = "no robot", .absent_from = 0, .absent_until = 1000},
      {.name = "no robot, ground drifts", .drift_px = 2, .absent_from = 0, .absent_until = 1000},
      {.name = "robot leaves for 30 frames", .absent_from = 25, .absent_until = 55},
      {.name = "leaves, ground drifts", .drift_px = 1.5, .absent_from = 25, .absent_until = 55},
      {.name = "glare stays on it", .cover = Cover::glare_stays},
      {.name = "glare passes", .cover = Cover::glare_passes},
      {.name = "two alike cross", .twin = true},
      {.name = "covered by a third", .cover = Cover::third},
      {.name = "covered by half", .cover = Cover::half},
      {.name = "hidden for 20 frames", .cover = Cover::full},
      {.name = "tool over half of it", .cover = Cover::tool},
      {.name = "cloud of blood", .cover = Cover::blood},
      {.name = "bubbles", .cover = Cover::bubbles},
      {.name = "light x 0.25", .light = 0.25},
      {.name = "light x 0.5", .light = 0.5},
      {.name = "light x 0.7", .light = 0.7},
      {.name = "light x 1.3", .light = 1.3},
      {.name = "light x 1.6", .light = 1.6},
      {.name = "flicker of 15 %", .flicker = 0.15},
      {.name = "endoilluminator wanders", .spot = true},
      {.name = "bands of light", .bands = true},
      {.name = "cast: blue", .cast = {1.25F, 1, 0.8F}},
      {.name = "cast: yellow", .cast = {0.75F, 1.02F, 1.12F}},
      {.name = "vignette of 60 %", .vignette = 0.6},
      {.name = "vignette of 85 %", .vignette = 0.85},
      {.name = "reflexes in the image", .reflexes = true},
      {.name = "JPEG of 50", .jpeg = 50},
      {.name = "JPEG of 30", .jpeg = 30},
      {.name = "JPEG of 12", .jpeg = 12},
      {.name = "defocus of 3 px", .defocus_px = 3},
      {.name = "defocus of 5 px", .defocus_px = 5},
      {.name = "defocus of 8 px", .defocus_px = 8},
      {.name = "smear of 9 px", .smear_px = 9},
      {.name = "thrice as fast, smeared", .speed = 3, .smear_px = 7},
      {.name = "noise x 3", .noise = 7.5},
      {.name = "view jumps by 20 px", .jump_px = 20},
      {.name = "view jumps by 60 px", .jump_px = 60},
      {.name = "zoom to 0.5", .zoom_to = 0.5},
      {.name = "zoom to 1.8", .zoom_to = 1.8},
      {.name = "shadow of 45 %", .shadow = 0.45},
      {.name = "robot as red as vessels", .tint = {0.75F, 0.8F, 1.3F}},
      {.name = "vessels of the robot's gray", .gray_vessels = true},
      {.name = "robot of 20 x 12 px", .semi_axes = {10, 6}},
      {.name = "four masks", .training = 4},
      {.name = "a camera without color", .gray = true},
  };
}

}  // namespace vitreo::hard_set
