// Learned evidence: a network (ONNX, run by OpenCV's dnn on the CPU) that says, from an image and
// the F of its colors, what to add to F. It sees what is round a pixel, which a color does not.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/evidence_source.h"

#include <array>
#include <memory>
#include <string>

namespace vitreo::vision {

/// The network's contract (scripts/networks/train_evidence.py writes one): input {1, 4, V, U} of
/// floats, sides a multiple of 16: blue, green, red over 255 in the light of the training, F over
/// 8; output {1, 1, V/2, U/2}: what to add to F there.
class LearnedEvidence : public EvidenceSource {
 public:
  /// `colors` must outlive it. Throws std::invalid_argument for bytes that are no such network.
  LearnedEvidence(const ColorModel& colors, const std::string& network);
  ~LearnedEvidence() override;
  /// Throws std::invalid_argument unless the bytes are a network as above.
  static void check(const std::string& network);
  /// Runs the network over the region and kContext px all round; over a large region (a whole
  /// image's search) at half the resolution.
  void prepare(const cv::Mat& image, const cv::Rect& region) override;
  void read(const cv::Mat& image, int v, int u, int step, int count,
            std::int8_t* to) const override;
  void set_light(const LogColor& gains) override;

 private:
  struct Network;
  void fill(const cv::Mat& image);
  void combine(const cv::Mat& image, const cv::Mat& more);
  ColorEvidence colors_;
  std::array<std::array<float, 256>, 3> levels_{};  // over 255, of each level, gains taken out
  std::unique_ptr<Network> network_;
  cv::Mat input_;
  cv::Mat f_;  // CV_8SC1, of the image's pixels from `origin_` on
  cv::Point origin_;
  cv::Size side_;  // of the network's input, its own pixels
  int scale_ = 1;  // pixels of the image to one of the input's
};

}  // namespace vitreo::vision
