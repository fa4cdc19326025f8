// SPDX-License-Identifier: Apache-2.0
#include "vision/retina_map.h"

#include "vision/preconditions.h"
#include "vision/retina_frame.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace vitreo::vision {
namespace {

constexpr int kNearestFrames = 4;  // frames of the map that a lost view is searched in
// Farther from the prediction it is a false minimum beside the right one, or a leap: searched.
constexpr double kLeap_px = 48;

}  // namespace

void RetinaMapSettings::check() const {
  require(flatten_px >= 8 && flatten_px <= 1000, "flatten_px: must be 8 to 1000");
  require(min_correlation > 0 && min_correlation < 1, "min_correlation: must be between 0 and 1");
  require(min_overlap > 0 && min_overlap < 1, "min_overlap: must be between 0 and 1");
  require(grow_overlap > min_overlap && grow_overlap < 1,
          "grow_overlap: must be above min_overlap, below 1");
  require(max_frames >= 1 && max_frames <= 10000, "max_frames: must be 1 to 10000");
}

double RetinaPose::scale() const {
  return std::sqrt(std::abs(map_from_image.linear().determinant()));
}

double RetinaPose::angle() const {
  return std::atan2(map_from_image.linear()(1, 0), map_from_image.linear()(0, 0));
}

struct RetinaMap::State {
  std::size_t nearest(const Eigen::Affine2d& map_from_image) const;
  void add(const Eigen::Affine2d& map_from_image, double sigma_px);
  std::optional<RetinaPose> pose_of(std::size_t frame, const Alignment& found) const;
  std::optional<RetinaPose> follow();
  std::optional<RetinaPose> search();
  RetinaPose first();
  void take(RetinaPose& pose, bool kept);

  RetinaMapSettings settings;
  cv::Size size;
  int type = -1;
  std::vector<MapFrame> frames;
  MapPyramid now;
  Eigen::Affine2d last = Eigen::Affine2d::Identity();  // map_from_image, of the last found frame
  Eigen::Vector2d velocity{0, 0};                      // of the image's middle in the map, px/frame
  bool followed = false;                               // the last frame was found
  std::size_t lost = 0;                                // searches in a row that found nothing
};

// By where the image's middle lies.
std::size_t RetinaMap::State::nearest(const Eigen::Affine2d& map_from_image) const {
  const Eigen::Vector2d middle(size.width / 2.0, size.height / 2.0);
  const auto apart = [&](const MapFrame& frame) {
    return (frame.map_from_frame * middle - map_from_image * middle).squaredNorm();
  };
  const auto best =
      std::min_element(frames.begin(), frames.end(),
                       [&](const MapFrame& a, const MapFrame& b) { return apart(a) < apart(b); });
  return static_cast<std::size_t>(best - frames.begin());
}

void RetinaMap::State::add(const Eigen::Affine2d& map_from_image, double sigma_px) {
  frames.push_back(make_frame(now, map_from_image, sigma_px));
}

std::optional<RetinaPose> RetinaMap::State::pose_of(std::size_t frame,
                                                    const Alignment& found) const {
  if (!found.sound) return std::nullopt;
  RetinaPose pose;
  pose.map_from_image = frames[frame].map_from_frame * found.image_from_frame.inverse();
  pose.sigma_px = std::hypot(found.sigma_px, frames[frame].sigma_px);
  pose.correlation = found.correlation;
  pose.overlap = found.overlap;
  pose.frame = static_cast<int>(frame);
  return pose;
}

// From the motion of the last two frames, with the map's frame that lies nearest.
std::optional<RetinaPose> RetinaMap::State::follow() {
  const Eigen::Affine2d expected = Eigen::Translation2d(velocity) * last;
  const std::size_t frame = nearest(expected);
  const Eigen::Affine2d guess = expected.inverse() * frames[frame].map_from_frame;
  auto pose = pose_of(frame, align(frames[frame], now, guess, settings));
  const Eigen::Vector2d middle(size.width / 2.0, size.height / 2.0);
  if (pose && (pose->map_from_image * middle - expected * middle).norm() > kLeap_px)
    return std::nullopt;
  return pose;
}

// Without a guess: by phase correlation with the frames of the map nearest to the last place, and,
// the longer it is lost, with others in turn; the best of those that are sound.
std::optional<RetinaPose> RetinaMap::State::search() {
  const cv::Mat spectrum = map_spectrum(now.back());
  const Eigen::Vector2d middle(size.width / 2.0, size.height / 2.0);
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t k = 0; k < frames.size(); ++k)
    order.emplace_back((frames[k].map_from_frame * middle - last * middle).norm(), k);
  std::sort(order.begin(), order.end());
  std::optional<RetinaPose> best;
  const std::size_t most = std::min<std::size_t>(order.size(), kNearestFrames);
  for (std::size_t k = 0; k < most; ++k) {
    const std::size_t number = order[(lost * most + k) % order.size()].second;
    const MapFrame& frame = frames[number];
    const auto pose = pose_of(number, align(frame, now, shift_of(frame, spectrum), settings));
    if (pose && (!best || pose->correlation * std::sqrt(pose->overlap) >
                              best->correlation * std::sqrt(best->overlap)))
      best = pose;
  }
  lost = best ? 0 : lost + 1;
  return best;
}

RetinaPose RetinaMap::State::first() {
  add(Eigen::Affine2d::Identity(), 0);
  last = Eigen::Affine2d::Identity();
  velocity.setZero();
  followed = true;
  RetinaPose pose;
  pose.correlation = pose.overlap = 1;
  pose.grew = true;
  return pose;
}

// `kept`: it was followed from the last frame, so that the two show a motion.
void RetinaMap::State::take(RetinaPose& pose, bool kept) {
  const Eigen::Vector2d middle(size.width / 2.0, size.height / 2.0);
  velocity.setZero();
  if (kept) velocity = pose.map_from_image * middle - last * middle;
  last = pose.map_from_image;
  const bool full = frames.size() >= static_cast<std::size_t>(settings.max_frames);
  if (full || pose.overlap >= settings.grow_overlap) return;
  add(pose.map_from_image, pose.sigma_px);
  pose.grew = true;
}

RetinaMap::RetinaMap(const RetinaMapSettings& settings) : state_(std::make_unique<State>()) {
  settings.check();
  state_->settings = settings;
}

RetinaMap::~RetinaMap() = default;

int RetinaMap::frames() const { return static_cast<int>(state_->frames.size()); }

void RetinaMap::reset() {
  state_->frames.clear();
  state_->followed = false;
}

std::optional<RetinaPose> RetinaMap::update(const cv::Mat& image, std::span<const Ellipse> bodies) {
  State& s = *state_;
  require(image.type() == CV_8UC1 || image.type() == CV_8UC3,
          "image: must be 8-bit, gray or color");
  require(image.cols >= 160 && image.rows >= 160, "image: wants at least 160 pixels a side");
  require(s.type < 0 || (s.size == image.size() && s.type == image.type()),
          "image: is not of the size and kind of the first");
  s.size = image.size();
  s.type = image.type();
  if (!make_pyramid(image, bodies, s.settings.flatten_px, s.now)) {
    s.followed = false;
    return std::nullopt;
  }
  if (s.frames.empty()) return s.first();
  std::optional<RetinaPose> pose;
  if (s.followed) pose = s.follow();
  const bool kept = pose.has_value();
  if (!pose) pose = s.search();
  s.followed = pose.has_value();
  if (pose) s.take(*pose, kept);
  return pose;
}

}  // namespace vitreo::vision
