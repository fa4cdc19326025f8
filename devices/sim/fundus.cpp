// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/fundus.h"

#include "devices/sim/checks.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <random>
#include <stdexcept>

namespace vitreo::sim {
namespace {

constexpr int kMapSize = 2048;  // px
// m along the retina from the vertex, about as in an adult eye: the optic disc is nasal, 1.8 mm
// wide, and 5 mm from the fovea, which is temporal.
constexpr double kDiscX = 4.0e-3;
constexpr double kDiscY = 0.4e-3;
constexpr double kDiscRadius = 0.9e-3;
constexpr double kFoveaX = -1.0e-3;
constexpr double kFoveaRadius = 0.9e-3;

// Map with coordinates in meters: x right, y up, the vertex in the middle.
struct Canvas {
  cv::Mat map;
  double scale;                             // px per m
  cv::Point at(double x, double y) const {  // OpenCV's fixed-point coordinates, 1/16 px
    const double center = map.cols / 2.0;
    return {static_cast<int>(std::lround((center + x * scale) * 16)),
            static_cast<int>(std::lround((center - y * scale) * 16))};
  }
};

// Mottling: value noise. Random values on five grids, each twice as fine as the one before and 0.6
// times as strong, interpolated by cubics and summed.
cv::Mat mottling(std::mt19937_64& random) {
  std::uniform_real_distribution<float> uniform(-1, 1);
  cv::Mat sum = cv::Mat::zeros(kMapSize, kMapSize, CV_32F);
  float weight = 0.04F;
  for (int cells = 6; cells <= 96; cells *= 2, weight *= 0.6F) {
    cv::Mat coarse(cells, cells, CV_32F), fine;
    for (int i = 0; i < cells * cells; ++i)
      coarse.at<float>(i / cells, i % cells) = uniform(random);
    cv::resize(coarse, fine, sum.size(), 0, 0, cv::INTER_CUBIC);
    sum += weight * fine;
  }
  return sum;
}

// State of a vessel's tip.
struct Vessel {
  double x;        // m
  double y;        // m
  double heading;  // rad
  double width;    // m
  double bend;     // rad/m: curvature
};

// One vessel as a random walk outwards from the disc, in steps of a quarter of a millimeter:
// curvature decays by 1.5 % and width by 1.2 % a step, the heading gets 0.1 rad of noise, and with
// a chance of 9 % a branch leaves at 0.6 to 0.9 rad with 0.65 of the width, to the fourth
// generation.
void draw_vessel(Canvas& canvas, Vessel vessel, int generation, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  constexpr double kVesselStep = 0.25e-3;  // m
  for (int step = 0; step < 90 && vessel.width > 25e-6; ++step) {
    const double x = vessel.x + kVesselStep * std::cos(vessel.heading);
    const double y = vessel.y + kVesselStep * std::sin(vessel.heading);
    const int thickness = std::max(1, static_cast<int>(std::lround(vessel.width * canvas.scale)));
    cv::line(canvas.map, canvas.at(vessel.x, vessel.y), canvas.at(x, y), cv::Scalar(255), thickness,
             cv::LINE_AA, 4);
    vessel.x = x;
    vessel.y = y;
    vessel.heading += vessel.bend * kVesselStep + 0.10 * normal(random);
    vessel.bend *= 0.985;
    vessel.width *= 0.988;
    const bool branches = uniform(random) < 0.09;
    const bool left = uniform(random) < 0.5;
    if (branches && generation < 4) {
      Vessel branch = vessel;
      branch.heading += (left ? 1 : -1) * (0.6 + 0.3 * uniform(random));
      branch.bend = (left ? -1 : 1) * 60;
      branch.width *= 0.65;
      vessel.width *= 0.9;
      draw_vessel(canvas, branch, generation + 1, random);
    }
  }
}

// Vessel map in [0, 1], antialiased and softened by a Gaussian of 1.2 px.
cv::Mat vessels(double scale, std::mt19937_64& random) {
  Canvas canvas{cv::Mat::zeros(kMapSize, kMapSize, CV_8U), scale};
  std::normal_distribution<double> normal;
  // Arcades up and down towards the temporal side, which bend round the fovea, and smaller ones to
  // the nasal side; an artery and a vein each.
  struct Start {
    double heading;
    double bend;
    double width;
  };
  const Start starts[] = {{1.9, 110, 150e-6},  {2.2, 80, 120e-6},  {-1.9, -110, 150e-6},
                          {-2.2, -80, 120e-6}, {0.7, -40, 110e-6}, {-0.7, 40, 110e-6},
                          {1.1, 20, 90e-6},    {-1.1, -20, 90e-6}};
  for (const Start& start : starts) {
    const double x = kDiscX + 0.15e-3 * normal(random);
    const double y = kDiscY + 0.15e-3 * normal(random);
    const double heading = start.heading + 0.1 * normal(random);
    draw_vessel(canvas, {x, y, heading, start.width, start.bend}, 0, random);
  }
  cv::Mat soft;
  canvas.map.convertTo(soft, CV_32F, 1.0 / 255);
  cv::GaussianBlur(soft, soft, cv::Size(0, 0), 1.2);
  return soft;
}

// Adds a disc with a soft edge, height / (1 + e^((r - r0) / (0.6 edge))): a logistic step.
void add_disc(cv::Mat& map, double scale, double x, double y, double radius, double edge,
              double height) {
  const double u0 = map.cols / 2.0 + x * scale;
  const double v0 = map.rows / 2.0 - y * scale;
  const double r0 = radius * scale;
  const double e = edge * scale;
  const int reach = static_cast<int>(r0 + 6 * e);
  const cv::Rect box =
      cv::Rect(static_cast<int>(u0) - reach, static_cast<int>(v0) - reach, 2 * reach, 2 * reach) &
      cv::Rect(0, 0, map.cols, map.rows);
  for (int v = box.y; v < box.y + box.height; ++v)
    for (int u = box.x; u < box.x + box.width; ++u)
      map.at<float>(v, u) += static_cast<float>(
          height / (1 + std::exp((std::hypot(u - u0, v - v0) - r0) / (0.6 * e))));
}

// Bilinear interpolation; 0 outside of the map.
template <class Value>
Value bilinear(const cv::Mat& map, double u, double v) {
  if (!(u >= 0 && v >= 0 && u < map.cols - 1 && v < map.rows - 1)) return Value{};
  const int i = static_cast<int>(u);
  const int j = static_cast<int>(v);
  const float a = static_cast<float>(u - i);
  const float b = static_cast<float>(v - j);
  const Value* above = map.ptr<Value>(j) + i;
  const Value* below = map.ptr<Value>(j + 1) + i;
  return (1 - b) * ((1 - a) * above[0] + a * above[1]) + b * ((1 - a) * below[0] + a * below[1]);
}

}  // namespace

// Reflectance: an even ground of 0.52 with mottling, the fovea darker, disc and cup brighter,
// vessels up to 38 % darker.
Fundus Fundus::drawn(std::uint64_t seed, double reach) {
  std::mt19937_64 random(seed);
  const double scale = kMapSize / 2.0 / reach;
  cv::Mat map = mottling(random) + 0.52F;
  add_disc(map, scale, kFoveaX, 0, kFoveaRadius, 0.5e-3, -0.10);
  add_disc(map, scale, kDiscX, kDiscY, kDiscRadius, 0.06e-3, 0.22);
  add_disc(map, scale, kDiscX, kDiscY, 0.4 * kDiscRadius, 0.08e-3, 0.08);  // its cup
  cv::Mat darker = 1.0F - 0.38F * vessels(scale, random);
  map = map.mul(darker);
  return {map, scale};
}

Fundus Fundus::photograph(const std::string& file, double width) {
  require(width > 0, "fundus_width must be above zero");
  const cv::Mat color = cv::imread(file, cv::IMREAD_COLOR);
  if (color.empty()) throw std::invalid_argument("fundus: cannot read '" + file + "' as an image");
  cv::Mat green;
  cv::Mat map;
  cv::extractChannel(color, green, 1);  // the vessels' contrast is best in green light
  green.convertTo(map, CV_32F, 1.0 / 255);
  Fundus made(map, map.cols / width);
  color.convertTo(made.color_, CV_32F, 1.0 / 255);
  return made;
}

// (0, 0) is the middle of the map, bilinear its pixels, hence the half; 0 outside of it.
float Fundus::reflectance(double x, double y) const {
  return bilinear<float>(map_, map_.cols / 2.0 - 0.5 + x * pixels_per_meter_,
                         map_.rows / 2.0 - 0.5 - y * pixels_per_meter_);
}

cv::Vec3f Fundus::color(double x, double y) const {
  return bilinear<cv::Vec3f>(color_, color_.cols / 2.0 - 0.5 + x * pixels_per_meter_,
                             color_.rows / 2.0 - 0.5 - y * pixels_per_meter_);
}

}  // namespace vitreo::sim
