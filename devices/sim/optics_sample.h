// Optics sample: by how much the simulated eye, condensing lens, microscope and retina differ from
// what the rig believes of them, drawn from the seed with stated standard deviations.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::sim {

/// Standard deviations. 0: as believed. The eye's own numbers (thesis table 5.1) are drawn by
/// `optical_system:sample` and set by scripts; scale, tilt and the eye's place are among
/// PlantSigmas too, and add.
struct OpticsSigmas {
  double pupil_power = 0;       // 1/m: 1 / pupil distance is drawn evenly from 0 to twice this
  double microscope_tilt = 0;   // rad, about x and y
  double object_plane = 0;      // m, along the axis
  double pixel = 0;             // relative
  double center = 0;            // m in the aerial image, x and y
  double lens_axial = 0;        // m, of the condensing lens, which the microscope does not follow
  double lens_aside = 0;        // m, the same, x and y
  double lens_tilt = 0;         // rad, the same about its inner vertex, x and y
  double eye_rotation = 0;      // rad, of the eye about its retina's center, x and y
  double inner_lens_aside = 0;  // m, of the eye's own lens, x and y
  double inner_lens_tilt = 0;   // rad, the same about its rear vertex, x and y
  double stage_backlash = 0;    // m, of the focusing stage: |N(0, 1)| times this
  double stage_noise = 0;       // m, of where it comes to rest, anew each time
  double axial_length = 0;      // m, retina to the eye's lens
  double retina_depth = 0;      // m, where the retina stands; the eye's lenses stay
  double retina_curvature = 0;  // m of sag, 4 mm from the axis
  /// Those of a bench set up by hand (docs/chain.md).
  static OpticsSigmas stated();
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// What was drawn, SI.
struct OpticsSample {
  double pupil_power = 0;
  Eigen::Vector2d microscope_tilt{0, 0};
  double object_plane = 0;
  double pixel = 0;
  Eigen::Vector2d center{0, 0};
  double lens_axial = 0;
  Eigen::Vector2d lens_aside{0, 0};
  Eigen::Vector2d lens_tilt{0, 0};
  Eigen::Vector2d eye_rotation{0, 0};
  Eigen::Vector2d inner_lens_aside{0, 0};
  Eigen::Vector2d inner_lens_tilt{0, 0};
  double stage_backlash = 0;
  double stage_noise = 0;  // the standard deviation
  double axial_length = 0;
  double retina_depth = 0;
  double retina_curvature = 0;
  /// A name and value of each, for a record.
  std::vector<std::pair<std::string, double>> named() const;
  /// Another eye in the same bench.
  optics::System applied_to(optics::System eye) const;
};

/// Each number from a stream of its own, cut at three standard deviations.
OpticsSample sample_optics(const OpticsSigmas& sigmas, std::uint64_t seed);

/// The settings' eye, microscope, scale and retina with the sample in them; a view without an eye
/// has the microscope's alone: scale, center, pupil, tilt and plane.
LaboratorySettings with_optics(LaboratorySettings settings, const OpticsSample& sample);

}  // namespace vitreo::sim
