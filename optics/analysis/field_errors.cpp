// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/field_errors.h"

#include "optics/maps/thesis_curves.h"
#include "optics/numerics/preconditions.h"
#include "optics/rays/pupil.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace vitreo::optics {
namespace {

constexpr double kMostMissing = 0.25;  // of the field, when there is still an answer
constexpr double kReach = 3;  // vitreous lengths; the cubics beyond their ends cross anywhere

/// Statistics of the errors over a grid of the field; points without an answer are counted.
class FieldErrors {
 public:
  void add(const std::optional<double>& error) {
    ++count_;
    if (!error || !std::isfinite(*error)) return;
    ++answered_;
    sum_ += *error;
    max_ = std::max(max_, *error);
  }
  // Nothing when more than a quarter of the field has no answer: statistics over the easy part
  // would flatter the method.
  std::optional<double> summary(ErrorMeasure measure) const {
    if (answered_ == 0 || answered_ < (1 - kMostMissing) * count_) return std::nullopt;
    return measure == ErrorMeasure::max ? max_ : sum_ / answered_;
  }

 private:
  int count_ = 0;
  int answered_ = 0;
  double sum_ = 0;
  double max_ = 0;
};

/// No answer in one case is no answer.
std::optional<double> worse(const std::optional<double>& one, const std::optional<double>& other) {
  if (!one || !other) return std::nullopt;
  return std::max(*one, *other);
}

/// A point of the field and the focus and height of its sharp image.
/// Focus: d_ls, m from the last vertex. Height: |d_op|, m; the sign of the magnification is known
/// and not measured.
struct ImagedPoint {
  Eigen::Vector3d point;
  double focus;
  double height;
};

struct ImagedField {
  std::vector<ImagedPoint> points;
  int lost = 0;
  double retina_focus = 0;  // m, on the axis
};

/// Thesis 4.2: bundles from a grid of points over the field are traced to the image.
/// A point counts as lost unless its whole bundle comes through: a vignetted bundle has another
/// best focus, as another pupil would have, and would be blamed on the eye.
std::optional<ImagedField> image_field(const System& system, const FieldErrorOptions& options) {
  const PupilTracer tracer(system, Pupil::of_stop(system));
  const auto samples = disc_samples(options.rings, options.arms);
  ImagedField imaged;
  Spot spot;
  for (int i = 0; i < options.angles; ++i) {
    const double angle = options.max_angle * i / (options.angles - 1);
    for (int j = 0; j < options.depths; ++j) {
      const auto point = point_at_field(system, angle, options.depth_to * j / (options.depths - 1));
      if (!point || !tracer.trace(*point, samples, spot) || spot.lost > 0) {
        ++imaged.lost;
        continue;
      }
      const double focus = spot.moments().best_focus();
      if (i == 0 && j == 0) imaged.retina_focus = focus;
      imaged.points.push_back({*point, focus, std::abs(spot.chief_at(focus).x())});
    }
  }
  // The retina on the axis comes first; without its focus there is nothing to calibrate on.
  if (imaged.points.empty() || imaged.points.front().point.head<2>().norm() > 0)
    return std::nullopt;
  return imaged;
}

/// Localization by focus with an assumed eye: its curves (3.2.1) and its on-axis law (4.10) to
/// (4.12).
struct Believed {
  ThesisCurves curves;
  OnAxisLaw law;
  // m, from the retina's vertex: what lies farther is no position in or about the eye
  double reach;
};

/// Thesis 3.2.1 and 4.3 for the assumed eye; the isofocus surfaces take the conic constant of its
/// retina.
/// Throws std::invalid_argument naming `believed` when that eye has no images of these depths. A
/// true eye may fail, the assumed one must work.
Believed believe(const Prescription& believed, const FieldErrorOptions& options) {
  WideAngleSettings settings;
  settings.max_angle = options.max_angle;
  settings.max_depth = options.depth_to;
  const AxialFocus focus = traced_focus();
  std::vector<OnAxisPoint> own;
  for (int i = 0; i < options.depths; ++i) {
    const double depth = options.depth_to * i / (options.depths - 1);
    const auto sensor = focus(believed.system, depth);
    detail::require(sensor.has_value() && std::isfinite(*sensor),
                    "believed: the eye has no images of all these depths");
    own.push_back({*sensor, depth - believed.system.surfaces.front().thickness});
  }
  ThesisSettings fit;
  fit.conic = believed.system.surfaces.front().conic;
  return {fit_thesis_curves(WideAngleMap(believed.system, settings), fit),
          fit_on_axis(on_axis_law(believed.system), own).law,
          kReach * believed.system.surfaces.front().thickness};
}

/// Errors with the sensor off by `shift`. With a calibrated law the isofocus surfaces are moved
/// along the axis by its difference from the assumed one (4.3: only their intersection with the
/// axis is calibrated).
/// `shift`: m, added to each focus, as a misplaced sensor would read it. `calibrated` null: the
/// curves are used as they were fitted.
std::optional<double> error_of(const Believed& believed, const ImagedField& imaged,
                               const OnAxisLaw* calibrated, double shift, ErrorMeasure measure) {
  FieldErrors errors;
  for (int i = 0; i < imaged.lost; ++i) errors.add(std::nullopt);
  for (const ImagedPoint& one : imaged.points) {
    const double focus = one.focus + shift;
    std::optional<double> pole_shift = 0;
    if (calibrated != nullptr) {
      const auto now = calibrated->object_from_sensor(focus);
      const auto before = believed.law.object_from_sensor(focus);
      pole_shift = now && before ? std::optional(*now - *before) : std::nullopt;
    }
    // 4.1: intersection of isopixel curve and isofocus surface.
    const auto found = pole_shift
                           ? believed.curves.extrapolated_point(focus, one.height, *pole_shift)
                           : std::optional<WideAngleMap::Plane>();
    const bool there = found && std::hypot(found->r, found->z) < believed.reach;
    errors.add(there ? std::optional(std::hypot(found->r - one.point.x(), found->z - one.point.z()))
                     : std::nullopt);
  }
  return errors.summary(measure);
}

/// The worst of the signs of the sensor's misplacement (figure 4.2e) and, calibrated, of the
/// retinal depth error (figure 4.6). The two have independent causes, so all four combinations
/// count. `retina_object`: d_o of the true eye's retina, m from surface 2, negative.
std::optional<double> error_of(const Believed& believed, const ImagedField& imaged,
                               double retina_object, const FieldErrorOptions& options) {
  const auto either_focus = [&](const OnAxisLaw* calibrated) {
    return worse(error_of(believed, imaged, calibrated, options.focus_error, options.measure),
                 error_of(believed, imaged, calibrated, -options.focus_error, options.measure));
  };
  if (!options.calibrated) return either_focus(nullptr);
  const auto with = [&](double depth_error) -> std::optional<double> {
    const OnAxisPoint retina{imaged.retina_focus, retina_object + depth_error};
    try {
      const OnAxisLaw law = calibrate_biometric(believed.law, retina, options.method).law;
      return either_focus(&law);
    } catch (const std::invalid_argument&) {
      return std::nullopt;  // this eye's retina cannot be reached by the law
    }
  };
  return worse(with(options.retinal_depth_error), with(-options.retinal_depth_error));
}

}  // namespace

void FieldErrorOptions::check() const {
  detail::require(max_angle > 0 && max_angle < std::numbers::pi / 2,
                  "max_angle: must lie between 0 and 90 degrees");
  detail::require_positive(depth_to, "depth_to");
  detail::require(angles >= 3 && angles <= 1000, "angles: must lie within 3 and 1000");
  detail::require(depths >= 3 && depths <= 1000, "depths: must lie within 3 and 1000");
  detail::require(rings >= 1, "rings: must be at least 1");
  detail::require(arms >= 2, "arms: must be at least 2");
  detail::require_not_negative(focus_error, "focus_error");
  detail::require_not_negative(retinal_depth_error, "retinal_depth_error");
}

/// The curves and the law of the assumed eye are fitted here, once; each true eye then costs its
/// bundles alone. The function returned owns copies of both.
EyeError field_error(const Prescription& believed, const FieldErrorOptions& options) {
  options.check();
  const Believed model = believe(believed, options);
  return [model, options](const Prescription& truth) -> std::optional<double> {
    const auto imaged = image_field(truth.system, options);
    if (!imaged) return std::nullopt;
    return error_of(model, *imaged, -truth.system.surfaces.front().thickness, options);
  };
}

}  // namespace vitreo::optics
