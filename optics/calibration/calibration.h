// Calibration of the depth of isofocus surfaces on the axis, biometric and full: the law of thesis
// (4.10) to (4.12).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/system.h"

#include <Eigen/Core>

#include <optional>
#include <span>

namespace vitreo::optics {

/// Law of the positions of an object on the axis and its image d_ls behind the last vertex. With
/// the signs that agree with (4.7), (4.8); as printed, the retina of table 3.4 would lie at -20.47
/// mm instead of -16.32:
///   s_i = d_ls - [O2,PP2] + e_dls        (4.10)
///   s_o = -f n_v s_i / (s_i - f)         (4.11)
///   d_o = s_o + [O1,PP1] + e_do          (4.12)
/// d_o counts from surface 2 towards +z, so it is negative in the vitreous. All lengths in m.
struct OnAxisLaw {
  double focal_length = 0;            // f
  double first_principal_point = 0;   // [O1,PP1]
  double second_principal_point = 0;  // [O2,PP2]
  double object_index = 1;            // n_v
  double sensor_shift = 0;            // e_dls
  double object_shift = 0;            // e_do
  /// d_o of an image at d_ls; nothing where the law has its pole.
  std::optional<double> object_from_sensor(double d_ls) const;
  /// The inverse.
  std::optional<double> sensor_from_object(double d_o) const;
  /// Throws std::invalid_argument naming the parameter.
  void check() const;
};

/// By first-order optics. Throws std::invalid_argument for an unsound or afocal system.
OnAxisLaw on_axis_law(const System& system);

/// One object on the axis and where its image is in focus, m.
struct OnAxisPoint {
  double sensor = 0;  // d_ls
  double object = 0;  // d_o
};

struct OnAxisFit {
  OnAxisLaw law;
  double rms_residual = 0;  // m, of d_o
  double max_residual = 0;
  // of f, PP1, PP2, m^2, from the residuals; zero without spare points
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// f, PP1 and PP2 fitted to points by least squares of d_o: the refinement of 4.3, "because of the
/// conic and aspheric components", and the full on-axis calibration of 4.4.4. Starts at `start`,
/// whose shifts go into PP1 and PP2. Throws std::invalid_argument naming `points` for fewer than
/// three of different depth or not finite ones, and when it does not converge.
OnAxisFit fit_on_axis(const OnAxisLaw& start, std::span<const OnAxisPoint> points);

/// Which of the two lumped errors is adjusted; one equation cannot determine both. Never e_do
/// alone: after 3 % of the lens' index that left 2.2 mm where the default leaves 0.12
/// (docs/optics.md).
enum class BiometricMethod {
  sensor_shift,  // e_dls alone
  minimum_norm,  // smallest e_dls^2 + e_do^2, as the thesis
};

struct BiometricFit {
  OnAxisLaw law;
  double residual = 0;  // m, left at the retina: rounding
};

/// Calibrates the law so that it maps the sensor position at which the known retina was in focus to
/// the retina's depth (`retina.object`, minus the depth from surface 2). Throws
/// std::invalid_argument naming `retina` when it is not finite or cannot be reached.
BiometricFit calibrate_biometric(const OnAxisLaw& law, const OnAxisPoint& retina,
                                 BiometricMethod method = BiometricMethod::sensor_shift);

}  // namespace vitreo::optics
