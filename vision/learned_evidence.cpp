// SPDX-License-Identifier: Apache-2.0
#include "vision/learned_evidence.h"

#include "vision/preconditions.h"

#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace vitreo::vision {
namespace {

constexpr int kContext = 16;      // px of the input beside what is asked for
constexpr int kNetworkStep = 16;  // its sides are multiples of it
constexpr int kRegionStep = 32;   // and a region's of this: fewer shapes, each of which is set up
constexpr int kWholeResolution = 320;  // px, largest side read at full resolution
constexpr std::size_t kLargestNetwork = 2 << 20;

int rounded_up(int value, int step) { return (value + step - 1) / step * step; }

}  // namespace

struct LearnedEvidence::Network {
  cv::dnn::Net net;
  explicit Network(const std::string& bytes) {
    require(!bytes.empty() && bytes.size() <= kLargestNetwork,
            "network: must be an ONNX file of at most 2 MB");
    try {
      net = cv::dnn::readNetFromONNX(bytes.data(), bytes.size());
      net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
      net.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
    } catch (const cv::Exception&) {
      require(false, "network: is no ONNX file that can be run");
    }
  }
  cv::Mat run(const cv::Mat& input) {
    net.setInput(input);
    return net.forward();
  }
};

LearnedEvidence::LearnedEvidence(const ColorModel& colors, const std::string& network)
    : colors_(colors), network_(std::make_unique<Network>(network)) {
  set_light(LogColor::Zero());
}

LearnedEvidence::~LearnedEvidence() = default;

void LearnedEvidence::set_light(const LogColor& gains) {
  colors_.set_light(gains);
  for (std::size_t c = 0; c < 3; ++c) {
    const double divide = std::exp(-gains[static_cast<Eigen::Index>(c)]) / 255;
    for (std::size_t level = 0; level < 256; ++level)
      levels_[c][level] = static_cast<float>(std::min(static_cast<double>(level) * divide, 1.0));
  }
}

// Pixels beyond the image's border are those at it. At half the resolution each is the mean of two
// by two, as the network makes it of its own input in its first step.
void LearnedEvidence::fill(const cv::Mat& image) {
  const std::array<int, 4> shape{1, 4, side_.height, side_.width};
  input_.create(4, shape.data(), CV_32F);
  std::array<std::vector<float>, 4> row;
  std::vector<std::int8_t> f(static_cast<std::size_t>(image.cols));
  const auto plane = static_cast<std::ptrdiff_t>(side_.area());
  const float share = 1.0F / static_cast<float>(scale_ * scale_);
  input_.setTo(0);
  for (int y = 0; y < side_.height * scale_; ++y) {
    const int v = std::clamp(origin_.y + y, 0, image.rows - 1);
    const auto* from = image.ptr<cv::Vec3b>(v);
    colors_.read(image, v, 0, 1, image.cols, f.data());
    float* to = input_.ptr<float>() + static_cast<std::ptrdiff_t>(y / scale_) * side_.width;
    for (int x = 0; x < side_.width * scale_; ++x) {
      const int u = std::clamp(origin_.x + x, 0, image.cols - 1);
      float* at = to + x / scale_;
      for (std::size_t c = 0; c < 3; ++c)
        at[static_cast<std::ptrdiff_t>(c) * plane] +=
            share * levels_[c][from[u][static_cast<int>(c)]];
      at[3 * plane] += share * static_cast<float>(f[static_cast<std::size_t>(u)]) / 128;
    }
  }
}

// F of the colors at full resolution, and what the network adds, between its samples.
void LearnedEvidence::combine(const cv::Mat& image, const cv::Mat& more) {
  const cv::Mat coarse(more.size[2], more.size[3], CV_32F, const_cast<float*>(more.ptr<float>()));
  cv::Mat fine;
  cv::resize(coarse, fine, side_ * scale_, 0, 0, cv::INTER_LINEAR);
  f_.create(fine.size(), CV_8SC1);
  const cv::Rect seen = cv::Rect(origin_, fine.size()) & cv::Rect({0, 0}, image.size());
  for (int v = seen.y; v < seen.br().y; ++v) {
    auto* to = f_.ptr<std::int8_t>(v - origin_.y) + (seen.x - origin_.x);
    const float* add = fine.ptr<float>(v - origin_.y) + (seen.x - origin_.x);
    colors_.read(image, v, seen.x, 1, seen.width, to);
    for (int k = 0; k < seen.width; ++k)
      to[k] = static_cast<std::int8_t>(std::clamp<long>(
          to[k] + std::lround(static_cast<float>(ColorModel::kScale) * add[k]), -127, 127));
  }
}

void LearnedEvidence::prepare(const cv::Mat& image, const cv::Rect& region) {
  const int longest = std::max(region.width, region.height);
  scale_ = longest > kWholeResolution ? 2 : 1;
  if (scale_ == 1) {
    const int side = rounded_up(longest + 2 * kContext, kRegionStep);
    side_ = {side, side};
    origin_ = {region.x + (region.width - side) / 2, region.y + (region.height - side) / 2};
  } else {
    side_ = {rounded_up((region.width + 1) / 2, kNetworkStep),
             rounded_up((region.height + 1) / 2, kNetworkStep)};
    origin_ = region.tl();
  }
  fill(image);
  combine(image, network_->run(input_));
}

void LearnedEvidence::read(const cv::Mat& /*image*/, int v, int u, int step, int count,
                           std::int8_t* to) const {
  const auto* from = f_.ptr<std::int8_t>(v - origin_.y) + (u - origin_.x);
  for (int k = 0; k < count; ++k) to[k] = from[static_cast<std::ptrdiff_t>(k) * step];
}

// An empty image shows whether its shapes are those of the contract.
void LearnedEvidence::check(const std::string& bytes) {
  Network network(bytes);
  constexpr int kSide = 2 * kRegionStep;
  const std::array<int, 4> shape{1, 4, kSide, kSide};
  bool fits = false;
  try {
    const cv::Mat more = network.run(cv::Mat(4, shape.data(), CV_32F, cv::Scalar(0)));
    fits = more.dims == 4 && more.type() == CV_32F && more.size[0] == 1 && more.size[1] == 1 &&
           more.size[2] == kSide / 2 && more.size[3] == kSide / 2;
  } catch (const cv::Exception&) {
    fits = false;
  }
  require(fits, "network: its shapes are not those of learned evidence");
}

}  // namespace vitreo::vision
