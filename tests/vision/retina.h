// A procedurally drawn retina, and views of it by a sensor that turns and shifts, vignetted and
// noisy.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

namespace vitreo::vision::synthetic {

inline void grow_vessel(cv::Mat& darkness, Eigen::Vector2d at, double heading, double width,
                        std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(0, 1);
  while (width > 1.2) {
    heading += 0.12 * normal(random);
    const Eigen::Vector2d next = at + 9 * Eigen::Vector2d(std::cos(heading), std::sin(heading));
    if (next.x() < 0 || next.y() < 0 || next.x() >= darkness.cols || next.y() >= darkness.rows)
      return;
    // OpenCV's lines in sixteenths of a pixel.
    const auto fixed = [](double x) { return static_cast<int>(std::lround(16 * x)); };
    cv::line(darkness, {fixed(at.x()), fixed(at.y())}, {fixed(next.x()), fixed(next.y())},
             cv::Scalar(18 + 5 * width), static_cast<int>(std::lround(width)), cv::LINE_AA, 4);
    at = next;
    width *= 0.996;
    if (unit(random) < 0.05) {
      const double side = unit(random) < 0.5 ? -1 : 1;
      grow_vessel(darkness, at, heading + side * (0.5 + 0.4 * unit(random)), 0.65 * width, random);
      width *= 0.9;
    }
  }
}

inline cv::Mat mottling(const cv::Size& size, int grain, std::mt19937_64& random) {
  std::normal_distribution<float> normal;
  cv::Mat coarse(size.height / grain + 2, size.width / grain + 2, CV_32F), fine;
  for (int v = 0; v < coarse.rows; ++v) {
    for (int u = 0; u < coarse.cols; ++u) coarse.at<float>(v, u) = normal(random);
  }
  cv::resize(coarse, fine, size, 0, 0, cv::INTER_CUBIC);
  return fine;
}

/// Gray levels, CV_32F: choroid, optic disc, macula, branching vessels.
inline cv::Mat retina(const cv::Size& size, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  cv::Mat picture = 120 + 4 * mottling(size, 60, random) + 2.5 * mottling(size, 9, random);
  cv::Mat darkness = cv::Mat::zeros(size, CV_32F), bright = darkness.clone(),
          macula = darkness.clone();
  const Eigen::Vector2d disc(0.32 * size.width, 0.48 * size.height);
  for (int k = 0; k < 10; ++k)
    grow_vessel(darkness, disc, 2 * std::numbers::pi * (k + 0.3) / 10, 9 - 0.4 * k, random);
  for (int k = 0; k < 14; ++k) {  // from outside the picture
    std::uniform_real_distribution<double> u(0, size.width), v(0, size.height),
        turn(-std::numbers::pi, std::numbers::pi);
    const double u0 = u(random), v0 = v(random), heading = turn(random);
    grow_vessel(darkness, {u0, v0}, heading, 4.5, random);
  }
  const cv::Point at(static_cast<int>(disc.x()), static_cast<int>(disc.y()));
  cv::circle(bright, at, size.height / 14, cv::Scalar(55), cv::FILLED);
  cv::GaussianBlur(bright, bright, {0, 0}, 6);
  cv::circle(macula, {static_cast<int>(0.62 * size.width), static_cast<int>(0.52 * size.height)},
             size.height / 9, cv::Scalar(22), cv::FILLED);
  cv::GaussianBlur(macula, macula, {0, 0}, 30);
  cv::GaussianBlur(darkness, darkness, {0, 0}, 1.0);
  return picture + bright - macula - darkness;
}

struct ViewLook {
  cv::Size size{640, 480};
  double noise = 4;       // gray levels
  double vignette = 0.4;  // of the light is lost in the corner
  double light = 1;
};

/// What the sensor sees from this place.
inline cv::Mat view_of(const cv::Mat& picture, const Eigen::Affine2d& picture_from_view,
                       const ViewLook& look, std::mt19937_64& random) {
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> m = picture_from_view.matrix().topRows<2>();
  cv::Mat mean, view(look.size, CV_8U);
  cv::warpAffine(picture, mean, cv::Mat(2, 3, CV_64F, m.data()), look.size,
                 cv::INTER_CUBIC | cv::WARP_INVERSE_MAP, cv::BORDER_REFLECT);
  std::normal_distribution<double> normal;
  const Eigen::Vector2d center((look.size.width - 1) / 2.0, (look.size.height - 1) / 2.0);
  for (int v = 0; v < look.size.height; ++v) {
    for (int u = 0; u < look.size.width; ++u) {
      const double r = (Eigen::Vector2d(u, v) - center).norm() / center.norm();
      const double light = look.light * (1 - look.vignette * r * r);
      view.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(light * mean.at<float>(v, u) +
                                                                      look.noise * normal(random));
    }
  }
  return view;
}

/// The sensor turned by `angle` about its middle, which looks at `at`.
inline Eigen::Affine2d picture_from_view(const Eigen::Vector2d& at, double angle,
                                         const cv::Size& size = {640, 480}) {
  const Eigen::Vector2d center((size.width - 1) / 2.0, (size.height - 1) / 2.0);
  return Eigen::Translation2d(at) * Eigen::Rotation2Dd(angle) * Eigen::Translation2d(-center);
}

}  // namespace vitreo::vision::synthetic
