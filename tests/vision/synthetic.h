// Synthetic scenes for the tracker's tests: an ellipsoid of known outline over a fundus-like
// ground, blurred, noisy.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/background.h"
#include "vision/ellipse.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>

namespace vitreo::vision::synthetic {

struct Look {  // of the body, gray levels; the rim is ambient
  double ambient = 20, diffuse = 0, specular = 0, shininess = 30;
  Eigen::Vector3d lamp{0.25, 0.15, 1};
};

struct Scene {
  cv::Size size{640, 480};
  double ground = 125, mottling = 6, vessels = 40;  // gray levels
  double blur_sigma_px = 2;
  double full_well = 20000, read_noise = 15;  // electrons at gray 255; electrons
  std::uint64_t seed = 1;
};

inline cv::Mat noisy(const cv::Mat& mean, const Scene& scene, std::mt19937_64& random) {
  std::normal_distribution<float> normal;
  cv::Mat image(mean.size(), CV_8U);
  const double gain = 255 / scene.full_well;  // gray levels per electron
  for (int v = 0; v < mean.rows; ++v) {
    for (int u = 0; u < mean.cols; ++u) {
      const double level = mean.at<float>(v, u);
      const double sigma =
          std::sqrt(gain * std::max(level, 0.0) + std::pow(gain * scene.read_noise, 2));
      image.at<unsigned char>(v, u) =
          cv::saturate_cast<unsigned char>(level + sigma * normal(random));
    }
  }
  return image;
}

/// Mottling, a few dark vessels; CV_32F, without noise.
inline cv::Mat ground_of(const Scene& scene) {
  std::mt19937_64 random(scene.seed);
  std::normal_distribution<float> normal;
  cv::Mat coarse(scene.size.height / 24 + 2, scene.size.width / 24 + 2, CV_32F), ground;
  for (int v = 0; v < coarse.rows; ++v) {
    for (int u = 0; u < coarse.cols; ++u) coarse.at<float>(v, u) = normal(random);
  }
  cv::resize(coarse, ground, scene.size, 0, 0, cv::INTER_CUBIC);
  ground = ground * scene.mottling + scene.ground;
  std::uniform_real_distribution<double> u(0, scene.size.width), v(0, scene.size.height),
      thickness(2, 7);
  for (int k = 0; scene.vessels > 0 && k < 12; ++k) {
    const double u1 = u(random), v1 = v(random), u2 = u(random), v2 = v(random),
                 width = thickness(random);
    cv::Mat line = cv::Mat::zeros(scene.size, CV_32F);
    cv::line(line, {static_cast<int>(u1), static_cast<int>(v1)},
             {static_cast<int>(u2), static_cast<int>(v2)}, scene.vessels, static_cast<int>(width));
    cv::GaussianBlur(line, line, {0, 0}, 2.5);
    ground -= line;
  }
  return ground;
}

inline Background learnt(const cv::Mat& ground, const Scene& scene, std::mt19937_64& random,
                         int images = 10) {
  Background background;
  for (int k = 0; k < images; ++k) background.learn(noisy(ground, scene, random));
  return background;
}

/// Brightness of a spheroid seen from above whose axis lies in the image, at (x, y) of its unit
/// disc; a, b its semi-axes.
inline double brightness(const Look& look, double x, double y, double a, double b) {
  const double z = std::sqrt(std::max(1 - x * x - y * y, 0.0));
  const Eigen::Vector3d normal = Eigen::Vector3d(x / a, y / b, z / b).normalized(),
                        lamp = look.lamp.normalized();
  const Eigen::Vector3d half_way = (lamp + Eigen::Vector3d::UnitZ()).normalized();
  return look.ambient + look.diffuse * std::max(normal.dot(lamp), 0.0) +
         look.specular * std::pow(std::max(normal.dot(half_way), 0.0), look.shininess);
}

/// Draws the body over `mean`: (1 - cover) ground + light, both blurred; 6 x 6 points a pixel.
inline void draw_body(cv::Mat& mean, const Ellipse& e, const Look& look, const Scene& scene) {
  const int reach = static_cast<int>(e.semi_major_px + 5 * scene.blur_sigma_px) + 3;
  const int u0 = static_cast<int>(e.center_px.x()) - reach,
            v0 = static_cast<int>(e.center_px.y()) - reach;
  cv::Mat cover = cv::Mat::zeros(2 * reach + 1, 2 * reach + 1, CV_32F), light = cover.clone();
  const double c = std::cos(e.angle), s = std::sin(e.angle);
  for (int j = 0; j < cover.rows; ++j) {
    for (int i = 0; i < cover.cols; ++i) {
      for (int k = 0; k < 36; ++k) {
        const double du = u0 + i + (k % 6 - 2.5) / 6 - e.center_px.x(),
                     dv = v0 + j + (k / 6 - 2.5) / 6 - e.center_px.y();
        const double x = (c * du + s * dv) / e.semi_major_px,
                     y = (c * dv - s * du) / e.semi_minor_px;
        if (x * x + y * y > 1) continue;
        cover.at<float>(j, i) += 1.0F / 36;
        light.at<float>(j, i) +=
            static_cast<float>(brightness(look, x, y, e.semi_major_px, e.semi_minor_px) / 36);
      }
    }
  }
  cv::GaussianBlur(cover, cover, {0, 0}, scene.blur_sigma_px, 0, cv::BORDER_CONSTANT);
  cv::GaussianBlur(light, light, {0, 0}, scene.blur_sigma_px, 0, cv::BORDER_CONSTANT);
  for (int j = 0; j < cover.rows; ++j) {
    for (int i = 0; i < cover.cols; ++i) {
      const int u = u0 + i, v = v0 + j;
      if (u < 0 || v < 0 || u >= mean.cols || v >= mean.rows) continue;
      float& level = mean.at<float>(v, u);
      level = (1 - cover.at<float>(j, i)) * level + light.at<float>(j, i);
    }
  }
}

inline Ellipse random_ellipse(std::mt19937_64& random, double major, double minor,
                              const cv::Size& size) {
  std::uniform_real_distribution<double> unit(0, 1);
  const double u = unit(random), v = unit(random), turn = unit(random);
  const double margin = major / 2 + 25;
  return {{margin + u * (size.width - 2 * margin), margin + v * (size.height - 2 * margin)},
          major / 2,
          minor / 2,
          (turn - 0.5) * std::numbers::pi};
}

/// A scene, its learnt background, and images of it.
struct Bench {
  Scene scene;
  std::mt19937_64 random{7};
  cv::Mat ground;
  Background background;

  explicit Bench(const Scene& chosen = {})
      : scene(chosen), ground(ground_of(scene)), background(learnt(ground, scene, random)) {}
  cv::Mat image(const Ellipse& e, const Look& look) {
    cv::Mat mean = ground.clone();
    draw_body(mean, e, look, scene);
    return noisy(mean, scene, random);
  }
};

// As the simulated laboratory draws it: dark, brighter in the middle, a highlight as bright as the
// ground.
inline Look metal() {
  Look look;
  look.ambient = 15;
  look.diffuse = 41;
  look.specular = 89;
  return look;
}

}  // namespace vitreo::vision::synthetic
