// Fundus: reflectance of the simulated retina, procedural (vessels, optic disc, fovea, mottling) or
// from a photograph.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <string>

namespace vitreo::sim {

/// Reflectance of the retina, by azimuthal equidistant coordinates: distance from the vertex along
/// the retina.
class Fundus {
 public:
  /// Procedural, from a seed. `reach`: m from the vertex along the retina to the map's edge.
  static Fundus drawn(std::uint64_t seed, double reach);
  /// From a photograph that spans `width` m of retina; its green channel is the reflectance. Throws
  /// std::invalid_argument when the file cannot be read as an image.
  static Fundus photograph(const std::string& file, double width);
  /// At (x, y) m along the retina from the vertex, linearly interpolated; about 0 to 1, and 0
  /// outside.
  float reflectance(double x, double y) const;
  /// The same in blue, green and red; only where has_color(), of a photograph.
  cv::Vec3f color(double x, double y) const;
  bool has_color() const { return !color_.empty(); }
  const cv::Mat& map() const { return map_; }

 private:
  Fundus(cv::Mat map, double pixels_per_meter)
      : map_(std::move(map)), pixels_per_meter_(pixels_per_meter) {}
  cv::Mat map_;    // CV_32F
  cv::Mat color_;  // CV_32FC3 of the same size, or empty
  double pixels_per_meter_;
};

}  // namespace vitreo::sim
