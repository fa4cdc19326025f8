// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/hard_set/ground.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::hard_set {
namespace {

const cv::Scalar kTissue(48, 84, 156);  // blue, green, red of a fundus

// The ground is larger than the view, for its drift.
cv::Size whole(const cv::Size& view) {
  return {view.width + 2 * kGroundMargin, view.height + 2 * kGroundMargin};
}

// Smooth noise of three widths over the tissue's color.
cv::Mat mottled(cv::RNG& random, const cv::Size& size) {
  cv::Mat light(size, CV_32FC3, kTissue);
  for (const int pitch : {110, 31, 9}) {
    cv::Mat coarse(size.height / pitch + 4, size.width / pitch + 4, CV_32FC1);
    random.fill(coarse, cv::RNG::NORMAL, 0, 1);
    cv::Mat fine;
    cv::resize(coarse, fine, size, 0, 0, cv::INTER_CUBIC);
    cv::Mat tint;
    cv::merge(std::vector<cv::Mat>{2.2 * fine, 3.8 * fine, 6.5 * fine}, tint);
    light += tint;
  }
  return light;
}

// What absorbs, as a share from 0 to 1 at each pixel, leaves `keep` of blue, green and red.
void absorb(cv::Mat& light, const cv::Mat& share, const cv::Vec3f& keep) {
  for (int v = 0; v < light.rows; ++v) {
    auto* at = light.ptr<cv::Vec3f>(v);
    const float* much = share.ptr<float>(v);
    for (int u = 0; u < light.cols; ++u)
      for (int c = 0; c < 3; ++c) at[u][c] *= 1 - much[u] * (1 - keep[c]);
  }
}

// A vessel's winding course, drawn from thick to thin.
void draw_vessel(cv::Mat& share, cv::RNG& random, cv::Point2d at, double heading, double width) {
  for (int k = 0; k < 90 && width > 1.5; ++k) {
    heading += random.gaussian(0.11);
    const cv::Point2d to = at + 11.0 * cv::Point2d(std::cos(heading), std::sin(heading));
    cv::line(share, at, to, 1.0, std::max(1, cvRound(width)), cv::LINE_AA);
    at = to;
    width *= 0.985;
    if (random.uniform(0.0, 1.0) < 0.07 && width > 3)
      draw_vessel(share, random, at, heading + (random.uniform(0, 2) ? 0.7 : -0.7), 0.7 * width);
  }
}

// Vessels that keep so little red that they come near to the steel's gray, crossing in a disc.
cv::Mat with_vessels(cv::RNG& random, const cv::Size& size) {
  cv::Mat light = mottled(random, size);
  const cv::Point2d disc(size.width * random.uniform(0.25, 0.5),
                         size.height * random.uniform(0.35, 0.65));
  for (int v = 0; v < size.height; ++v) {
    auto* at = light.ptr<cv::Vec3f>(v);
    for (int u = 0; u < size.width; ++u) {
      const double r = std::hypot(u - disc.x, v - disc.y);
      const auto bright = static_cast<float>(1 / (1 + std::exp((r - 46) / 4)));
      at[u] = (1 - bright) * at[u] + bright * cv::Vec3f(118, 170, 222);
    }
  }
  cv::Mat share = cv::Mat::zeros(size, CV_32FC1);
  for (int k = 0; k < 9; ++k)
    draw_vessel(share, random, disc, 2 * CV_PI * (k + random.uniform(0.0, 0.6)) / 9,
                random.uniform(8.0, 13.0));
  for (int k = 0; k < 14; ++k)
    draw_vessel(share, random,
                {random.uniform(0.0, 1.0) * size.width, random.uniform(0.0, 1.0) * size.height},
                random.uniform(0.0, 6.28), random.uniform(3.0, 9.0));
  cv::GaussianBlur(share, share, {0, 0}, 1.3);
  absorb(light, share, {0.95F, 0.68F, 0.42F});
  return light;
}

// A choroid's streaks: dark and light, side by side.
cv::Mat with_streaks(cv::RNG& random, const cv::Size& size) {
  cv::Mat light = mottled(random, size);
  cv::Mat share = cv::Mat::zeros(size, CV_32FC1);
  for (int k = 0; k < 120; ++k)
    draw_vessel(share, random,
                {random.uniform(0.0, 1.0) * size.width, random.uniform(0.0, 1.0) * size.height},
                random.gaussian(0.4), random.uniform(6.0, 16.0));
  cv::GaussianBlur(share, share, {0, 0}, 2.5);
  absorb(light, share, {0.8F, 0.66F, 0.72F});
  return light;
}

// Bodies of blood, of the robot's size and about its outline, dark and red.
cv::Mat with_hemorrhages(cv::RNG& random, const cv::Size& size) {
  cv::Mat light = mottled(random, size);
  cv::Mat share = cv::Mat::zeros(size, CV_32FC1);
  for (int k = 0; k < 22; ++k) {
    const cv::Point2d at(random.uniform(0.0, 1.0) * size.width,
                         random.uniform(0.0, 1.0) * size.height);
    const double along = random.uniform(16.0, 36.0);
    cv::ellipse(share,
                cv::RotatedRect(at, cv::Size2d(2 * along, along * random.uniform(0.8, 1.6)),
                                static_cast<float>(random.uniform(0.0, 180.0))),
                random.uniform(0.6, 1.0), cv::FILLED, cv::LINE_AA);
  }
  cv::GaussianBlur(share, share, {0, 0}, 2);
  absorb(light, share, {0.85F, 0.55F, 0.45F});
  return light;
}

// The part of a photograph, in shares of its width and height, that fills the ground.
Ground photograph(const std::string& folder, const std::string& file, const cv::Rect2d& part,
                  const std::string& name, const cv::Size& size) {
  const cv::Mat read = cv::imread(folder + "/" + file, cv::IMREAD_COLOR);
  if (read.empty()) throw std::runtime_error(folder + "/" + file + ": is no image that is there");
  const cv::Rect cut(cvRound(part.x * read.cols), cvRound(part.y * read.rows),
                     cvRound(part.width * read.cols), cvRound(part.height * read.rows));
  Ground ground{name, true, {}};
  cv::Mat light;
  read(cut).convertTo(light, CV_32FC3);
  cv::resize(light, ground.light, size, 0, 0, cv::INTER_CUBIC);
  return ground;
}

}  // namespace

// One generator for all: the order of the grounds is a part of their seeds.
std::vector<Ground> generated_grounds(std::uint64_t seed, const cv::Size& view) {
  cv::RNG random(0x9e3779b97f4a7c15ULL * (seed + 1));
  const cv::Size size = whole(view);
  std::vector<Ground> grounds;
  grounds.push_back({"mottle", false, mottled(random, size)});
  for (const char* name : {"vessels A", "vessels B", "vessels C"})
    grounds.push_back({name, false, with_vessels(random, size)});
  grounds.push_back({"choroid", false, with_streaks(random, size)});
  grounds.push_back({"hemorrhages", false, with_hemorrhages(random, size)});
  return grounds;
}

// Parts chosen so that the fundus' disc, its larger vessels and its black rim each come into view.
std::vector<Ground> photographed_grounds(const std::string& folder, const cv::Size& view) {
  const cv::Size size = whole(view);
  return {photograph(folder, "retina.jpg", {0.1, 0.17, 0.8, 0.68}, "fundus", size),
          photograph(folder, "retina.jpg", {0.08, 0.3, 0.45, 0.38}, "fundus, left", size),
          photograph(folder, "retina.jpg", {0.5, 0.3, 0.45, 0.38}, "fundus, right", size),
          photograph(folder, "ihc.png", {0, 0, 1, 1}, "stained tissue", size),
          photograph(folder, "chelsea.png", {0, 0, 1, 1}, "fur", size),
          photograph(folder, "coffee.png", {0, 0, 1, 1}, "coffee", size)};
}

}  // namespace vitreo::hard_set
