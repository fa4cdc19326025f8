// SPDX-License-Identifier: Apache-2.0
#include "host/servo/robot_eye.h"

#include "devices/roles/gray.h"
#include "host/servo/robot_outline.h"
#include "vision/blob_tracker.h"
#include "vision/multi_tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo {
namespace {

/// The expected blur of the microscope's image at the ends of the workspace, as the sum of the
/// variances of diffraction, defocus and the pixel's own width. The tracker finds the rest itself,
/// from 0.4 to 2.5 times this.
vision::BlobTrackerSettings blob_settings(const RigModel& model) {
  constexpr double kWavelength = 550e-9;  // m
  // m of aerial image, over a workspace focused at its middle.
  constexpr double kGreatestDefocus = 3.5e-3;
  const double aperture = model.microscope.numerical_aperture;
  const double pixel = model.top_image.pixel;
  // The Gaussian nearest to the Airy pattern has sigma 0.21 lambda / NA.
  const double diffraction = 0.21 * kWavelength / aperture;
  // Defocus spreads a point over a disc of radius NA * defocus; a uniform disc of radius r has a
  // standard deviation of r / 2 along each axis.
  const double disc = aperture * kGreatestDefocus / 2;
  vision::BlobTrackerSettings settings;
  // A pixel integrates over its width, a uniform density of variance pixel^2 / 12.
  settings.blur_sigma_px =
      0.8 * std::sqrt(diffraction * diffraction + disc * disc + pixel * pixel / 12) / pixel;
  settings.corners = has_flat_ends(model.robot);
  return settings;
}

class BackgroundEye final : public RobotEye {
 public:
  BackgroundEye(const RigModel& model, vision::Background background)
      : tracker_(std::move(background), blob_settings(model)) {}
  const char* name() const override { return "background"; }
  std::optional<vision::EllipseMeasurement> look(const cv::Mat& picture) override {
    return tracker_.update(as_gray(picture));
  }
  void forget() override { tracker_.reset(); }
  /// 1 for a robot that nothing hides. Below this a speck at its edge, as dark as it is, begins to
  /// bend the ellipse: the place is 0.2 mm off at most above, up to 1.7 mm below.
  double least_rim() const override { return 0.75; }

 private:
  vision::BlobTracker tracker_;
};

/// Without color a dark region of the ground is like the robot for the second in which it crosses
/// its edge, and ten of thirteen runs across a fovea ended there. What the tracker follows on its
/// own then is held against the plant (plant_gate.h), so a look in the loop may be less like it.
std::vector<vision::TrackedObject> in_loop(std::vector<vision::TrackedObject> objects) {
  constexpr double kLeastLikeness = -3;
  for (vision::TrackedObject& one : objects)
    if (one.model.gray.known)
      one.settings.min_likeness = std::min(one.settings.min_likeness, kLeastLikeness);
  return objects;
}

class ColorEye final : public RobotEye {
 public:
  explicit ColorEye(const std::vector<vision::TrackedObject>& objects)
      : tracker_(in_loop(objects)) {}
  const char* name() const override { return "color"; }
  /// A look that has no measure of itself, without the rim's refinement, steers nothing.
  std::optional<vision::EllipseMeasurement> look(const cv::Mat& picture) override {
    const vision::Track& robot = tracker_.update(as_color(picture)).front();
    return robot.self_measured ? robot.measured : std::nullopt;
  }
  void forget() override { tracker_.reset(); }
  /// Lower than the background's: a vessel beside the rim takes a part of it with it, and the
  /// covariance says so.
  double least_rim() const override { return 0.55; }

 private:
  vision::MultiTracker tracker_;
};

}  // namespace

std::unique_ptr<RobotEye> background_eye(const RigModel& model, vision::Background background) {
  return std::make_unique<BackgroundEye>(model, std::move(background));
}

std::unique_ptr<RobotEye> color_eye(const std::vector<vision::TrackedObject>& objects) {
  return std::make_unique<ColorEye>(objects);
}

}  // namespace vitreo
