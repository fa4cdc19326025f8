// Renderer of a simulated camera: bodies by their pixel lines over a ground that is drawn once, the
// nearer over the farther, then blur and noise.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/blur.h"
#include "devices/sim/body_shape.h"
#include "devices/sim/fundus.h"
#include "devices/sim/view.h"
#include "devices/sim/world.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

namespace vitreo::sim {

/// Gray, or red, green and blue filters in the order of Bayer (RG over GB), demosaiced.
enum class SensorColor { gray, bayer };

/// An 8-bit sensor with shot noise and read-out noise (the linear camera model of EMVA 1288).
struct Sensor {
  SensorColor color = SensorColor::gray;
  std::array<double, 3> ground_tint{1, 1, 1};  // the ground's red, green, blue over its gray
  double full_well = 20000;                    // electrons at gray level 255
  double read_noise = 15;                      // electrons, standard deviation
  double brightness = 255;  // gray level of reflectance 1 in the middle of the image
  double vignette = 0.3;    // part of the light that is missing in the corners
  void check() const;       // throws std::invalid_argument naming the parameter
};

/// A body during one exposure: its state at the start and at the end.
struct DrawnBody {
  BodyState start;
  BodyState end;
  BodyLook look;
};

class Renderer {
 public:
  /// Defocus (m along the axis of the camera's object space) of a point seen at a pixel, at a depth
  /// in the view.
  using DefocusOf = std::function<double(const Eigen::Vector2d& pixel, double z_in_view)>;

  /// `ground`: sharp reflectance of the empty scene, CV_32FC1, or CV_32FC3 (blue, green, red), of
  /// the view's size; `ground_defocus` in m.
  Renderer(View view, const Aperture& aperture, DefocusOf defocus, const cv::Mat& ground,
           double ground_defocus, const Sensor& sensor, const BodyLook& look, std::uint64_t seed);
  /// The image number `frame` with the robot, or without one (null). Same arguments, same image.
  cv::Mat render(const BodyState* robot, std::uint64_t frame);
  /// With any bodies, smeared by their motion during the exposure; CV_8UC1, or CV_8UC3 (blue,
  /// green, red) of a color sensor.
  cv::Mat render(const std::vector<DrawnBody>& bodies, std::uint64_t frame);
  /// Another empty scene from the next image on, for a ground that moves.
  void set_ground(const cv::Mat& ground, double ground_defocus);
  /// Another light from the next image on: `Sensor::brightness`. The view stays as it was traced.
  void set_brightness(double brightness);
  const View& view() const { return view_; }

 private:
  cv::Rect window_of(const Eigen::Vector3d& center, const Eigen::Vector2d& extent,
                     const Eigen::Vector2d& pixel, double defocus);
  double scale_at(const Eigen::Vector2d& pixel, double z) const;
  void draw(const DrawnBody& body);
  int smears_of(const DrawnBody& body, const Eigen::Vector2d& pixel, double z,
                cv::Rect& window) const;
  void expose(const DrawnBody& body, int smears, const cv::Rect& window, cv::Mat& coverage,
              cv::Mat& light) const;
  void shade(const BodyState& body, const BodyLook& look, const cv::Rect& window, cv::Mat& coverage,
             cv::Mat& light) const;
  void compose(const cv::Mat& coverage, const cv::Mat& light, const BodyLook& look,
               const cv::Rect& window);
  double factor(const std::array<double, 3>& color, int u, int v) const;
  void prepare_noise();
  void light_ground();
  void restore_ground();
  cv::Mat add_noise(std::uint64_t frame) const;

  View view_;
  Blur blur_;
  DefocusOf defocus_;
  Sensor sensor_;
  BodyLook look_;
  std::uint64_t seed_;
  cv::Mat vignette_;                           // CV_32F, 1 in the middle
  std::vector<cv::Mat> reflected_;             // CV_32F: the ground's channels, blurred
  cv::Mat ground_;                             // CV_16U: mean gray level * 256, without bodies
  cv::Mat scene_;                              // CV_16U: mean gray level * 256, with bodies
  cv::Mat ground_sigma_;                       // CV_16U: noise * 256
  cv::Mat scene_sigma_;                        // CV_16U: noise * 256
  std::vector<cv::Rect> drawn_;                // where scene_ differs from ground_
  std::vector<std::uint16_t> sigma_of_level_;  // noise * 256 at each gray level
  std::vector<std::int16_t> normal_;           // standard normal samples * 1024
};

/// The defocus of a point at depth z (m, eye frame) seen by pixel `pixel`: marginal rays of the
/// microscope's aperture are traced in, and their spread at the depth is measured against the
/// pixel's own scale there; root mean square of tangential and sagittal, least midway between their
/// foci. Where rims of the eye cut the aperture, of what they leave.
Renderer::DefocusOf eye_defocus(const optics::System& eye, const optics::Microscope& microscope,
                                const optics::ImageScale& scale);

/// Where each pixel's line meets the retina, a sphere of `radius` with its vertex at the view's
/// origin: CV_64FC2, m along the retina from the vertex (azimuthal equidistant); not numbers where
/// a line misses it.
cv::Mat retina_points(const View& view, double radius);

/// The ground at such points, `fundus` moved by `shift` (m along the retina): CV_32FC1, or CV_32FC3
/// of a fundus in color where `in_color`.
cv::Mat painted_ground(const cv::Mat& points, const Fundus& fundus, const Eigen::Vector2d& shift,
                       bool in_color);

/// Both, of a fundus that lies still, in gray.
cv::Mat retina_ground(const View& view, const Fundus& fundus, double radius);

}  // namespace vitreo::sim
