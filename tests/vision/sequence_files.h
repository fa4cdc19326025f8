// A generated sequence as files, as people would hand them over: frames, training pairs, truth.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/vision/sequence_generator.h"

#include <opencv2/imgcodecs.hpp>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>

namespace vitreo::vision::generated {

/// Writes `frames/frame_0000.png` ..., `training/NAME.png` with `NAME_mask.png`, and `truth.csv`
/// (full axes) below `folder`.
inline void write_sequence(const SequenceSettings& settings, int frames, int masks,
                           const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder / "frames");
  std::filesystem::create_directories(folder / "training");
  Sequence sequence(settings);
  std::ofstream truth(folder / "truth.csv");
  truth << "frame,cx,cy,A,B,phi_deg,visible\n";
  char name[40];
  for (int k = 0; k < frames; ++k) {
    const Frame one = sequence.frame(k);
    std::snprintf(name, sizeof name, "frame_%04d.png", k);
    cv::imwrite((folder / "frames" / name).string(), one.image, {cv::IMWRITE_PNG_COMPRESSION, 1});
    truth << k << ',' << one.truth.center_px.x() << ',' << one.truth.center_px.y() << ','
          << 2 * one.truth.semi_major_px << ',' << 2 * one.truth.semi_minor_px << ','
          << one.truth.angle * 180 / std::numbers::pi << ',' << one.visible << '\n';
  }
  int k = 0;
  for (const LabeledImage& one : sequence.training(masks)) {
    std::snprintf(name, sizeof name, "robot_%d", k++);
    cv::imwrite((folder / "training" / (std::string(name) + ".png")).string(), one.image);
    cv::imwrite((folder / "training" / (std::string(name) + "_mask.png")).string(), one.mask);
  }
}

}  // namespace vitreo::vision::generated
