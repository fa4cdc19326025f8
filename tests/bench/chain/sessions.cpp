// SPDX-License-Identifier: Apache-2.0
#include "sessions.h"

#include <Eigen/Geometry>

#include <cmath>

namespace vitreo::optics {
namespace {

/// px: silhouettes by tangent lines and by a viewpoint half-way between the lines' foci differ by
/// 0.04 at worst.
constexpr double kOutlinesAgree = 0.03;

double uniform(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
double gauss(std::mt19937_64& random, double sigma) {
  return sigma * std::normal_distribution<double>()(random);
}

void measure(const TrueBench& truth, const char* name, double sigma, std::mt19937_64& random,
             ChainSession& session) {
  session.numbers.push_back({name, truth.off(name) + gauss(random, sigma), sigma});
}

/// The evening before: size under a microscope, and the target without an eye.
void before_the_eye(const TrueBench& truth, std::mt19937_64& random, ChainSession& session) {
  measure(truth, "robot_length", 0.002, random, session);
  measure(truth, "robot_width", 0.002, random, session);
  measure(truth, "pupil_power", 0.1, random, session);  // 5 % of 2 / m
  measure(truth, "pixel", 0.0005, random, session);
  measure(truth, "center_x", 20e-6, random, session);
  measure(truth, "center_y", 20e-6, random, session);
  measure(truth, "object_plane", 50e-6, random, session);
  measure(truth, "microscope_tilt_x", 1.7e-3, random, session);
  measure(truth, "microscope_tilt_y", 1.7e-3, random, session);
}

/// The middle of the retina and four places 3 mm from it.
void add_landings(const TrueBench& truth, std::mt19937_64& random, ChainSession& session) {
  constexpr double kRoughness = 30e-6;  // m
  for (const Eigen::Vector2d& at :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(3e-3, 0), Eigen::Vector2d(-3e-3, 0),
        Eigen::Vector2d(0, 3e-3), Eigen::Vector2d(0, -3e-3)}) {
    ChainLook look;
    look.axis = {1, 0, 0};
    const double lying = truth.robot().semi_radius;
    const auto seen = truth.seen(
        {at.x(), at.y(), truth.retina(at.x(), at.y()) + lying + gauss(random, kRoughness)},
        tilted(look.axis, kAxisSigma, random), 0.05, kAxisSigma, random);
    if (!seen) continue;
    look.seen = *seen;
    look.seen.contour_sigma_px = kOutlinesAgree;
    look.contact_sigma = kRoughness;
    look.lying_height = 0.5e-3;
    session.looks.push_back(look);
  }
}

}  // namespace

Eigen::Vector3d random_place(std::mt19937_64& random) {
  for (;;) {
    const double x = uniform(random, -4e-3, 4e-3);
    const double y = uniform(random, -4e-3, 4e-3);
    const double z = uniform(random, 2e-3, 9e-3);
    if (x * x + y * y < 16e-6) return {x, y, z};
  }
}

Eigen::Vector3d random_axis(std::mt19937_64& random, double pitch) {
  const double azimuth = uniform(random, 0, 2 * M_PI);
  const double up = gauss(random, pitch);
  return {std::cos(azimuth) * std::cos(up), std::sin(azimuth) * std::cos(up), std::sin(up)};
}

Eigen::Vector3d tilted(const Eigen::Vector3d& axis, double sigma, std::mt19937_64& random) {
  const Eigen::Vector3d e1 = axis.unitOrthogonal();
  const Eigen::Vector3d e2 = axis.cross(e1);
  const double a = gauss(random, sigma);
  const double b = gauss(random, sigma);
  return (axis + a * e1 + b * e2).normalized();
}

ChainLook flight_look(const TrueBench& truth, std::mt19937_64& random) {
  for (;;) {
    ChainLook look;
    look.axis = random_axis(random, 0.35);
    const Eigen::Vector3d place = random_place(random);
    const auto seen =
        truth.seen(place, tilted(look.axis, kAxisSigma, random), kNoise_px, kAxisSigma, random);
    if (!seen) continue;
    look.seen = *seen;
    return look;
  }
}

ChainSession landing_session(const TrueBench& truth, std::mt19937_64& random) {
  ChainSession session;
  add_landings(truth, random, session);
  return session;
}

ChainSession bench_session(const TrueBench& truth, int places, std::mt19937_64& random) {
  constexpr double kSide = 10e-6;  // m
  ChainSession session;
  before_the_eye(truth, random, session);
  while (static_cast<int>(session.looks.size()) < places) {
    const Eigen::Vector3d place = random_place(random);
    ChainLook look;
    look.axis = random_axis(random, 0);
    const auto seen =
        truth.seen(place, tilted(look.axis, kAxisSigma, random), 0.05, kAxisSigma, random);
    if (!seen) continue;
    look.seen = *seen;
    look.seen.contour_sigma_px = kOutlinesAgree;
    for (int i = 0; i < 3; ++i) look.known[i] = place[i] + gauss(random, kSide);
    look.known_sigma.setConstant(kSide);
    session.looks.push_back(look);
  }
  return session;
}

ChainSession in_eye_session(const TrueBench& truth, int frames, std::mt19937_64& random) {
  ChainSession session;
  before_the_eye(truth, random, session);
  measure(truth, "lens_axial", 0.1e-3, random, session);
  for (const char* name : {"lens_aside_x", "lens_aside_y"})
    measure(truth, name, 0.1e-3, random, session);
  for (const char* name : {"lens_tilt_x", "lens_tilt_y"})
    measure(truth, name, 8.7e-3, random, session);
  measure(truth, "vitreous.index", 0.001, random, session);
  measure(truth, "cornea.anterior.radius", 0.005, random, session);
  for (const char* name : {"cornea.thickness", "aqueous.thickness", "lens.thickness"})
    measure(truth, name, 0.02, random, session);
  add_landings(truth, random, session);
  for (int i = 0; i < frames; ++i) session.looks.push_back(flight_look(truth, random));
  for (int i = 0; i < 8; ++i) {
    const double angle = 2 * M_PI * i / 8;
    const double radius = i % 2 == 0 ? 4e-3 : 2.5e-3;
    const Eigen::Vector2d place(radius * std::cos(angle), radius * std::sin(angle));
    const auto pixel = truth.pixel(truth.of_retina(place.x(), place.y()));
    if (!pixel) continue;
    ChainLandmark mark;
    mark.sigma_px = 1;
    mark.place_sigma = 80e-6;  // 2 % of 4 mm
    mark.pixel_px = *pixel + Eigen::Vector2d(gauss(random, 1), gauss(random, 1));
    mark.place = place + Eigen::Vector2d(gauss(random, 80e-6), gauss(random, 80e-6));
    session.landmarks.push_back(mark);
  }
  return session;
}

}  // namespace vitreo::optics
