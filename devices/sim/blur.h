// Blur of a defocused microscope image: the wave of its aperture, or the disc where that is much
// larger than the diffraction, and the pixel in one kernel.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include <map>
#include <vector>

namespace vitreo::sim {

struct Aperture {
  double numerical_aperture = 0.01;
  double wavelength = 550e-9;  // m
  double pixel = 14.3e-6;      // m, in the object plane of the microscope
};

/// The point spread of a defocus (m along the axis), averaged over the pixels, summing to 1: the
/// wave of the aperture (defocus_wave.h); the geometric disc, |defocus| NA, convolved with the Airy
/// pattern where that is above 16 Airy radii. Odd size. CV_32F.
cv::Mat point_spread(const Aperture& aperture, double defocus);

/// Blurs CV_32F images with the kernel as a sum of few separable ones (its leading singular
/// vectors), cached for each tenth of a pixel of disc radius. `defocus` in m, as in point_spread.
class Blur {
 public:
  explicit Blur(const Aperture& aperture) : aperture_(aperture) {}
  void apply(cv::Mat& image, double defocus);
  /// px on each side that the kernel reaches.
  int reach(double defocus);

 private:
  struct Separable {
    std::vector<cv::Mat> rows;
    std::vector<cv::Mat> columns;
    int reach;  // px
  };
  const Separable& kernel(double defocus);
  Aperture aperture_;
  std::map<int, Separable> kernels_;  // by disc radius in tenths of a pixel
};

}  // namespace vitreo::sim
