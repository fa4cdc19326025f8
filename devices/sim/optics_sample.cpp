// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/optics_sample.h"

#include "devices/sim/checks.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

namespace vitreo::sim {
namespace {

constexpr double kCut = 3;  // sigmas

/// Streams of this sample, counted after those of the plant (plant_sample.cpp).
enum class OpticsStream : std::uint64_t {
  pupil_power = 1001,
  tilt_x,
  tilt_y,
  object_plane,
  pixel,
  center_x,
  center_y,
  lens_axial,
  axial_length,
  retina_depth,
  retina_curvature
};

std::mt19937_64 optics_stream(std::uint64_t seed, OpticsStream which) {
  return std::mt19937_64(mix(seed_for(seed, Purpose::plant), static_cast<std::uint64_t>(which), 0));
}

double drawn(double sigma, std::uint64_t seed, OpticsStream which) {
  auto random = optics_stream(seed, which);
  return sigma * std::clamp(std::normal_distribution<double>()(random), -kCut, kCut);
}

/// The air before the condensing lens, as in the laboratory.
constexpr std::size_t kAirBeforeLens = 4;  // from 0

}  // namespace

// Pupil: of a stereo microscope somewhere between telecentric and 250 mm. Tilt: half a degree, of a
// mounting by hand. Object plane: half a millimeter, of a focus set by eye. Pixel: half a percent.
// Center: 0.2 mm of aerial image. Lens: half a millimeter, held by a ring stand. Axial length: 0.1
// mm by ultrasound. Retina: 0.3 mm by MRI (thesis 4.3), 0.15 mm of sag at 4 mm.
OpticsSigmas OpticsSigmas::stated() {
  OpticsSigmas sigmas;
  sigmas.pupil_power = 2;
  sigmas.microscope_tilt = 8.7e-3;
  sigmas.object_plane = 0.5e-3;
  sigmas.pixel = 0.005;
  sigmas.center = 0.2e-3;
  sigmas.lens_axial = 0.5e-3;
  sigmas.axial_length = 0.1e-3;
  sigmas.retina_depth = 0.3e-3;
  sigmas.retina_curvature = 0.15e-3;
  return sigmas;
}

void OpticsSigmas::check() const {
  require_not_negative(pupil_power, "optics.pupil_power");
  require_not_negative(microscope_tilt, "optics.microscope_tilt");
  require_not_negative(object_plane, "optics.object_plane");
  require_not_negative(center, "optics.center");
  require_not_negative(lens_axial, "optics.lens_axial");
  require_not_negative(axial_length, "optics.axial_length");
  require_not_negative(retina_depth, "optics.retina_depth");
  require_not_negative(retina_curvature, "optics.retina_curvature");
  require(pixel >= 0 && pixel < 1 / kCut, "optics.pixel must be in [0, 1/3)");
}

std::vector<std::pair<std::string, double>> OpticsSample::named() const {
  return {{"pupil_power_per_m", pupil_power},
          {"microscope_tilt_x_rad", microscope_tilt.x()},
          {"microscope_tilt_y_rad", microscope_tilt.y()},
          {"object_plane_m", object_plane},
          {"aerial_pixel_factor", 1 + pixel},
          {"center_x_m", center.x()},
          {"center_y_m", center.y()},
          {"lens_axial_m", lens_axial},
          {"axial_length_m", axial_length},
          {"retina_depth_m", retina_depth},
          {"retina_curvature_m", retina_curvature}};
}

OpticsSample sample_optics(const OpticsSigmas& sigmas, std::uint64_t seed) {
  sigmas.check();
  OpticsSample sample;
  auto pupil = optics_stream(seed, OpticsStream::pupil_power);
  sample.pupil_power = 2 * sigmas.pupil_power * std::uniform_real_distribution<double>(0, 1)(pupil);
  const auto draw = [seed](double sigma, OpticsStream which) { return drawn(sigma, seed, which); };
  sample.microscope_tilt = {draw(sigmas.microscope_tilt, OpticsStream::tilt_x),
                            draw(sigmas.microscope_tilt, OpticsStream::tilt_y)};
  sample.object_plane = draw(sigmas.object_plane, OpticsStream::object_plane);
  sample.pixel = draw(sigmas.pixel, OpticsStream::pixel);
  sample.center = {draw(sigmas.center, OpticsStream::center_x),
                   draw(sigmas.center, OpticsStream::center_y)};
  sample.lens_axial = draw(sigmas.lens_axial, OpticsStream::lens_axial);
  sample.axial_length = draw(sigmas.axial_length, OpticsStream::axial_length);
  sample.retina_depth = draw(sigmas.retina_depth, OpticsStream::retina_depth);
  sample.retina_curvature = draw(sigmas.retina_curvature, OpticsStream::retina_curvature);
  return sample;
}

// A retina that stands deeper leaves the lenses where they are: it is nearer to or farther from
// them. The eye frame begins at the retina.
optics::System OpticsSample::applied_to(optics::System eye) const {
  eye.surfaces.front().thickness += axial_length - retina_depth;
  if (eye.surfaces.size() > kAirBeforeLens + 1)
    eye.surfaces[kAirBeforeLens].thickness += lens_axial;
  return eye;
}

// The microscope is counted from the last vertex, which moves with the condensing lens; it does
// not. A sag of r^2 / (2 R) changes by -r^2 dR / (2 R^2).
LaboratorySettings with_optics(LaboratorySettings settings, const OpticsSample& sample) {
  settings.top_image.pixel *= 1 + sample.pixel;
  const Eigen::Vector2d off = sample.center / settings.top_image.pixel;
  settings.top_image.center_px += Eigen::Vector2d(off.x(), -off.y());
  if (settings.top_view == TopView::plain)
    settings.plain = {1 / settings.microscope.pupil_distance + sample.pupil_power,
                      settings.microscope.tilt + sample.microscope_tilt, sample.object_plane};
  if (settings.top_view != TopView::microscope) return settings;
  settings.eye = sample.applied_to(settings.eye);
  optics::Microscope& microscope = settings.microscope;
  microscope.focus += sample.object_plane - sample.lens_axial;
  microscope.tilt += sample.microscope_tilt;
  // Not where nothing was drawn: 1 / (1 / d) is not d to the last bit.
  if (sample.pupil_power != 0)
    microscope.pupil_distance = 1 / (1 / microscope.pupil_distance + sample.pupil_power);
  constexpr double kAside = 4e-3;  // m, from the axis, where the sag is stated
  settings.world.cavity.vertex.z() += sample.retina_depth;
  const double radius = settings.world.cavity.radius;
  settings.world.cavity.radius -=
      std::clamp(2 * sample.retina_curvature * radius * radius / (kAside * kAside), -0.3 * radius,
                 0.3 * radius);
  settings.world.cavity.lens_depth += sample.axial_length - sample.retina_depth;
  return settings;
}

}  // namespace vitreo::sim
