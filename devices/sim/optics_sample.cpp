// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/optics_sample.h"

#include "devices/sim/checks.h"
#include "devices/sim/lens_groups.h"
#include "optics/system/frames.h"

#include <Eigen/Geometry>

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
  retina_curvature,
  lens_aside_x,
  lens_aside_y,
  lens_tilt_x,
  lens_tilt_y,
  eye_rotation_x,
  eye_rotation_y,
  inner_lens_aside_x,
  inner_lens_aside_y,
  inner_lens_tilt_x,
  inner_lens_tilt_y,
  stage_backlash
};

std::mt19937_64 optics_stream(std::uint64_t seed, OpticsStream which) {
  return std::mt19937_64(mix(seed_for(seed, Purpose::plant), static_cast<std::uint64_t>(which), 0));
}

double drawn(double sigma, std::uint64_t seed, OpticsStream which) {
  auto random = optics_stream(seed, which);
  return sigma * std::clamp(std::normal_distribution<double>()(random), -kCut, kCut);
}

/// Turns a group about x, then about y, and moves it. Nothing where nothing was drawn: the surfaces
/// of a centered system stay so to the last bit, and fast.
void move_group(optics::System& eye, int first, int last, const Eigen::Vector2d& aside,
                const Eigen::Vector2d& tilt, double pivot) {
  if (aside.isZero(0) && tilt.isZero(0)) return;
  const Eigen::Vector3d turn =
      optics::tilt_of((Eigen::AngleAxisd(tilt.y(), Eigen::Vector3d::UnitY()) *
                       Eigen::AngleAxisd(tilt.x(), Eigen::Vector3d::UnitX()))
                          .toRotationMatrix());
  optics::place_group(eye, first, last, {{aside.x(), aside.y(), 0}, turn}, {0, 0, pivot});
}

}  // namespace

// Pupil: of a stereo microscope somewhere between telecentric and 250 mm. Tilt: half a degree, of a
// mounting by hand. Object plane: half a millimeter, of a focus set by eye. Pixel: half a percent.
// Center: 0.2 mm of aerial image. Lens: half a millimeter and two degrees, held by a ring stand.
// Eye: 3 degrees, laid by hand. Its own lens: 3 degrees and 0.2 mm, of an implant or an aged one.
// Stage: a lead screw's 4 um of backlash, 2 um of repeatability. Axial length: 0.1 mm by
// ultrasound. Retina: 0.3 mm by MRI (thesis 4.3), 0.15 mm of sag at 4 mm.
OpticsSigmas OpticsSigmas::stated() {
  OpticsSigmas sigmas;
  sigmas.pupil_power = 2;
  sigmas.microscope_tilt = 8.7e-3;
  sigmas.object_plane = 0.5e-3;
  sigmas.pixel = 0.005;
  sigmas.center = 0.2e-3;
  sigmas.lens_axial = 0.5e-3;
  sigmas.lens_aside = 0.5e-3;
  sigmas.lens_tilt = 0.035;
  sigmas.eye_rotation = 0.052;
  sigmas.inner_lens_aside = 0.2e-3;
  sigmas.inner_lens_tilt = 0.052;
  sigmas.stage_backlash = 4e-6;
  sigmas.stage_noise = 2e-6;
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
  require_not_negative(lens_aside, "optics.lens_aside");
  require_not_negative(lens_tilt, "optics.lens_tilt");
  require_not_negative(eye_rotation, "optics.eye_rotation");
  require_not_negative(inner_lens_aside, "optics.inner_lens_aside");
  require_not_negative(inner_lens_tilt, "optics.inner_lens_tilt");
  require_not_negative(stage_backlash, "optics.stage_backlash");
  require_not_negative(stage_noise, "optics.stage_noise");
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
          {"lens_aside_x_m", lens_aside.x()},
          {"lens_aside_y_m", lens_aside.y()},
          {"lens_tilt_x_rad", lens_tilt.x()},
          {"lens_tilt_y_rad", lens_tilt.y()},
          {"eye_rotation_x_rad", eye_rotation.x()},
          {"eye_rotation_y_rad", eye_rotation.y()},
          {"inner_lens_aside_x_m", inner_lens_aside.x()},
          {"inner_lens_aside_y_m", inner_lens_aside.y()},
          {"inner_lens_tilt_x_rad", inner_lens_tilt.x()},
          {"inner_lens_tilt_y_rad", inner_lens_tilt.y()},
          {"stage_backlash_m", stage_backlash},
          {"stage_noise_m", stage_noise},
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
  const auto pair = [&draw](double sigma, OpticsStream x, OpticsStream y) {
    return Eigen::Vector2d(draw(sigma, x), draw(sigma, y));
  };
  sample.microscope_tilt = pair(sigmas.microscope_tilt, OpticsStream::tilt_x, OpticsStream::tilt_y);
  sample.object_plane = draw(sigmas.object_plane, OpticsStream::object_plane);
  sample.pixel = draw(sigmas.pixel, OpticsStream::pixel);
  sample.center = pair(sigmas.center, OpticsStream::center_x, OpticsStream::center_y);
  sample.lens_axial = draw(sigmas.lens_axial, OpticsStream::lens_axial);
  sample.lens_aside =
      pair(sigmas.lens_aside, OpticsStream::lens_aside_x, OpticsStream::lens_aside_y);
  sample.lens_tilt = pair(sigmas.lens_tilt, OpticsStream::lens_tilt_x, OpticsStream::lens_tilt_y);
  sample.eye_rotation =
      pair(sigmas.eye_rotation, OpticsStream::eye_rotation_x, OpticsStream::eye_rotation_y);
  sample.inner_lens_aside = pair(sigmas.inner_lens_aside, OpticsStream::inner_lens_aside_x,
                                 OpticsStream::inner_lens_aside_y);
  sample.inner_lens_tilt = pair(sigmas.inner_lens_tilt, OpticsStream::inner_lens_tilt_x,
                                OpticsStream::inner_lens_tilt_y);
  sample.stage_backlash = std::abs(draw(sigmas.stage_backlash, OpticsStream::stage_backlash));
  sample.stage_noise = sigmas.stage_noise;
  sample.axial_length = draw(sigmas.axial_length, OpticsStream::axial_length);
  sample.retina_depth = draw(sigmas.retina_depth, OpticsStream::retina_depth);
  sample.retina_curvature = draw(sigmas.retina_curvature, OpticsStream::retina_curvature);
  return sample;
}

// A retina that stands deeper leaves the lenses where they are: it is nearer to or farther from
// them. The eye frame begins at the retina; so it turns about a center that a deeper retina leaves
// where it was. Its own lens is turned in the eye first, then the eye with it; the condensing lens
// stands on the bench.
optics::System OpticsSample::applied_to(optics::System eye) const {
  const double turned_about = eye.surfaces.front().radius - retina_depth;
  eye.surfaces.front().thickness += axial_length - retina_depth;
  const auto group = lens_groups(eye);
  if (!group) return eye;
  eye.surfaces[static_cast<std::size_t>(group->cornea) - 1].thickness += lens_axial;
  move_group(eye, group->inner_lens, group->inner_lens_front, inner_lens_aside, inner_lens_tilt,
             eye.vertex(group->inner_lens));
  move_group(eye, group->inner_lens, group->cornea, {0, 0}, eye_rotation, turned_about);
  move_group(eye, group->condensing_lens, eye.size(), lens_aside, lens_tilt,
             eye.vertex(group->condensing_lens));
  return eye;
}

// The microscope is counted from the last vertex, which moves with the condensing lens; it does
// not. A sag of r^2 / (2 R) changes by -r^2 dR / (2 R^2).
LaboratorySettings with_optics(LaboratorySettings settings, const OpticsSample& sample) {
  settings.top_image.pixel *= 1 + sample.pixel;
  const Eigen::Vector2d off = sample.center / settings.top_image.pixel;
  settings.top_image.center_px += Eigen::Vector2d(off.x(), -off.y());
  settings.stage_play = {sample.stage_backlash, sample.stage_noise};
  for (const auto& one : sample.named())  // what stands as believed is no news
    if (one.second != 0 && one.second != 1) settings.drawn_bench.push_back(one);
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
