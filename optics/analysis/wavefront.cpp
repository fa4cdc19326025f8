// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/wavefront.h"

#include "optics/numerics/linear.h"
#include "optics/numerics/preconditions.h"
#include "optics/rays/trace.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <stdexcept>

namespace vitreo::optics {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

/// Where and how the waves of the rays are compared.
struct Comparison {
  double index;               // behind the last surface
  bool far;                   // on the plane through `reference` across `along`: a far image
  Eigen::Vector3d reference;  // m
  Eigen::Vector3d along;      // the chief ray's direction
  /// Optical path from the object: a plane wave of direction d that has the path L at o has
  /// L + n d . (p - o) at p.
  double path(const TraceResult& traced) const {
    const Ray& ray = traced.ray;
    const Eigen::Vector3d left = reference - ray.origin;
    return traced.path +
           index * (far ? along.dot(left) / along.dot(ray.direction) : ray.direction.dot(left));
  }
};

/// Where the image lies, from the last vertex: as asked for, or the rays' best focus.
std::optional<double> image_of(const PupilTracer& tracer, const Eigen::Vector3d& point,
                               const WavefrontSettings& settings) {
  if (settings.image) return settings.image;
  Spot spot;
  if (!tracer.trace(point, disc_samples(settings.rings, settings.arms), spot)) return std::nullopt;
  const double focus = spot.moments().best_focus();
  return std::isfinite(focus) ? std::optional(focus) : std::nullopt;
}

/// The sum of the samples' waves at `off`, over their number: of modulus 1 when all are in phase.
std::complex<double> field(const Wavefront& wave, const Eigen::Vector2d& off) {
  const double k = kTurn / wave.wavelength;
  std::complex<double> sum = 0;
  for (std::size_t i = 0; i < wave.opd.size(); ++i)
    sum += std::polar(1.0, k * (wave.opd[i] + wave.index * wave.direction[i].dot(off)));
  return sum / static_cast<double>(wave.opd.size());
}

/// The system that carries the bundle: a stop that is filled to its rim is taken out, where
/// rounding is no vignetting.
System carrier(const PupilTracer& tracer) {
  System made = tracer.system();
  const Pupil::Kind kind = tracer.pupil().kind;
  if (kind == Pupil::Kind::stop || kind == Pupil::Kind::real_stop) made.stop.reset();
  return made;
}

}  // namespace

/// The upper bounds keep a mistyped number from taking minutes: the time goes with their product.
void WavefrontSettings::check() const {
  detail::require(!image || !std::isnan(*image), "image: must be a number");
  detail::require_at_least(rings, 2, "rings");
  detail::require_at_least(arms, 4, "arms");
  detail::require(rings <= 200 && arms <= 400, "rings: at most 200, and 400 arms");
}

/// About the mean: a constant path is no aberration. Two passes, as the differences are small.
double Wavefront::rms() const {
  double mean = 0;
  for (const double w : opd) mean += w / static_cast<double>(opd.size());
  double square = 0;
  for (const double w : opd) square += (w - mean) * (w - mean) / static_cast<double>(opd.size());
  return std::sqrt(square);
}

/// Over that of the same samples all in phase, which is what a perfect lens would make there.
double Wavefront::relative_intensity(const Eigen::Vector2d& off) const {
  return std::norm(field(*this, off));
}

/// From the chief ray by steps of half an Airy radius to the brightest neighbor, then of a quarter,
/// and so on: where the tilt of the wave is least.
double Wavefront::strehl() const {
  if (!std::isfinite(image)) {
    Wavefront level = *this;  // the far image's place is a tilt, in directions of unit-disc slopes
    for (std::size_t i = 0; i < pupil.size(); ++i) level.direction[i] = pupil[i];
    level.index = 1;
    level.image = 0;
    level.numerical_aperture = 1;
    return level.strehl();
  }
  constexpr int kHalvings = 12;
  constexpr int kMostMoves = 200;
  double step = 0.3 * wavelength / numerical_aperture;
  Eigen::Vector2d best(0, 0);
  double brightest = relative_intensity(best);
  int moves = 0;
  for (int halving = 0; halving < kHalvings; step /= 2, ++halving) {
    for (bool moved = true; moved && moves < kMostMoves;) {
      moved = false;
      for (const Eigen::Vector2d& way : {Eigen::Vector2d(1, 0), Eigen::Vector2d(-1, 0),
                                         Eigen::Vector2d(0, 1), Eigen::Vector2d(0, -1)}) {
        const double there = relative_intensity(best + step * way);
        if (!(there > brightest)) continue;
        brightest = there;
        best += step * way;
        moved = true;
        ++moves;
      }
    }
  }
  return brightest;
}

/// Each sample's ray is aimed by itself and traced with its optical path.
std::optional<Wavefront> wavefront(const PupilTracer& tracer, const Eigen::Vector3d& point,
                                   const WavefrontSettings& settings) {
  settings.check();
  const System system = carrier(tracer);
  const auto image = image_of(tracer, point, settings);
  const auto chief_aim = tracer.aim(point);
  if (!image || !chief_aim) return std::nullopt;
  const TraceResult chief = trace_out(system, *chief_aim);
  if (chief.status != TraceStatus::ok) return std::nullopt;
  Wavefront made;
  made.wavelength = system.wavelength;
  made.index = system.surfaces.back().index;
  made.image = *image;
  const bool far = !std::isfinite(*image);
  Comparison at{made.index, far, chief.ray.origin, chief.ray.direction};
  if (!far) {
    const double z = system.vertex(system.size()) + *image;
    at.reference += at.along * ((z - at.reference.z()) / at.along.z());
    made.chief = at.reference.head<2>();
  }
  for (const Eigen::Vector2d& sample : disc_samples(settings.rings, settings.arms)) {
    const auto ray = tracer.aim(point, sample);
    const TraceResult traced = ray ? trace_out(system, *ray) : TraceResult{};
    if (!ray || traced.status != TraceStatus::ok) {
      ++made.lost;
      continue;
    }
    made.pupil.push_back(sample);
    made.opd.push_back(at.path(traced) - at.path(chief));
    made.direction.emplace_back((traced.ray.direction - chief.ray.direction).head<2>());
    made.numerical_aperture =
        std::max(made.numerical_aperture, made.index * made.direction.back().norm());
  }
  if (made.lost > static_cast<int>(made.opd.size())) return std::nullopt;
  // The sum over `arms` directions follows Bessel's functions up to v = k NA off = arms, that over
  // rings, at the middles of equal areas, up to twice their number.
  if (!far)
    made.reach = made.wavelength / (kTurn * made.numerical_aperture) *
                 std::min(settings.arms, 2 * settings.rings);
  return made;
}

/// Cell by cell: the samples lie on no grid, so there is no fast transform, and the square may be
/// as small as wanted.
Eigen::MatrixXd diffraction_psf(const Wavefront& wave, double half_width, int cells) {
  detail::require_positive(half_width, "half_width");
  detail::require(cells >= 1 && cells <= 1024, "cells: must lie within 1 and 1024");
  detail::require(std::isfinite(wave.image), "wave: its image is far away");
  constexpr double kRounding = 1e-9;  // a corner that was computed to be at the end is there
  detail::require(half_width * std::numbers::sqrt2 <= wave.reach * (1 + kRounding),
                  "half_width: beyond what the wave's samples suffice for: more rings and arms");
  Eigen::MatrixXd psf(cells, cells);
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column) {
      const Eigen::Vector2d at((2.0 * column + 1) / cells - 1, (2.0 * row + 1) / cells - 1);
      psf(row, column) = wave.relative_intensity(half_width * at);
    }
  }
  return psf;
}

/// The first color with an image of its own chooses the plane, where none is asked for: its rays'
/// best focus.
std::vector<ColoredWave> colored_waves(const System& system, const Eigen::Vector3d& point,
                                       const std::vector<std::pair<double, double>>& spectrum,
                                       const WavefrontSettings& settings) {
  std::vector<ColoredWave> colors;
  WavefrontSettings same = settings;
  for (const auto& [wavelength, energy] : spectrum) {
    detail::require_positive(energy, "energy");
    const System lit = at_wavelength(system, wavelength);
    const PupilTracer tracer(lit, Pupil::of_stop(lit, Pupil::Kind::real_stop));
    auto wave = wavefront(tracer, point, same);
    if (!wave)
      throw std::invalid_argument("wavelength: no light of " +
                                  std::to_string(std::lround(wavelength * 1e9)) +
                                  " nm comes through");
    same.image = wave->image;
    colors.push_back({std::move(*wave), energy});
  }
  return colors;
}

/// A pattern whose middle is 1 holds the energy (lambda / NA)^2 / pi, so that equal energies have
/// middles as (NA / lambda)^2.
Eigen::MatrixXd polychromatic_psf(const std::vector<ColoredWave>& colors, double half_width,
                                  int cells) {
  detail::require(!colors.empty(), "colors: wants at least one");
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(cells, cells);
  double middle = 0;
  for (const ColoredWave& color : colors) {
    detail::require_positive(color.energy, "energy");
    detail::require(color.wave.image == colors.front().wave.image,
                    "colors: their images lie in different planes");
    const double per = color.wave.numerical_aperture / color.wave.wavelength;
    const double bright = color.energy * per * per;
    Wavefront aside = color.wave;
    // The pattern about the first color's chief ray: a shift is a tilt of the wave.
    const Eigen::Vector2d shift = colors.front().wave.chief - color.wave.chief;
    for (std::size_t i = 0; i < aside.opd.size(); ++i)
      aside.opd[i] += aside.index * aside.direction[i].dot(shift);
    aside.reach -= shift.norm();
    sum += bright * diffraction_psf(aside, half_width, cells);
    middle += bright;
  }
  return sum / middle;
}

/// Over the sum of the intensities: what lies outside the square counts as no light, which lifts
/// the transfer by as much as is lost there.
double psf_mtf(const Eigen::MatrixXd& psf, double half_width, const Eigen::Vector2d& frequency) {
  detail::require_positive(half_width, "half_width");
  detail::require(frequency.allFinite(), "frequency: must be finite");
  std::complex<double> sum = 0;
  for (Eigen::Index row = 0; row < psf.rows(); ++row) {
    for (Eigen::Index column = 0; column < psf.cols(); ++column) {
      const Eigen::Vector2d at(
          (2.0 * static_cast<double>(column) + 1) / static_cast<double>(psf.cols()) - 1,
          (2.0 * static_cast<double>(row) + 1) / static_cast<double>(psf.rows()) - 1);
      sum += psf(row, column) * std::polar(1.0, -kTurn * half_width * frequency.dot(at));
    }
  }
  return std::abs(sum) / psf.sum();
}

/// R_n^m(r) = sum (-1)^s (n - s)! / (s! ((n + m)/2 - s)! ((n - m)/2 - s)!) r^(n - 2 s); the norm is
/// sqrt(n + 1), times sqrt(2) for m != 0.
double zernike(int j, const Eigen::Vector2d& at) {
  detail::require(j >= 0 && j < 66, "j: must lie within 0 and 65");
  int n = 0;
  while ((n + 1) * (n + 2) / 2 <= j) ++n;
  const int signed_m = 2 * j - n * (n + 2);
  const int m = std::abs(signed_m);
  double radial = 0;
  for (int s = 0; s <= (n - m) / 2; ++s) {
    radial +=
        (s % 2 == 0 ? 1 : -1) * std::tgamma(n - s + 1) /
        (std::tgamma(s + 1) * std::tgamma((n + m) / 2 - s + 1) * std::tgamma((n - m) / 2 - s + 1)) *
        std::pow(at.norm(), n - 2 * s);
  }
  const double angle = std::atan2(at.y(), at.x());
  if (m == 0) return std::sqrt(n + 1.0) * radial;
  return std::sqrt(2.0 * (n + 1)) * radial *
         (signed_m > 0 ? std::cos(m * angle) : std::sin(m * angle));
}

/// Samples that are lost make the polynomials no longer orthogonal, which least squares do not
/// need. At least two samples a coefficient, so that they are not fitted to rounding.
std::vector<double> zernike_coefficients(const Wavefront& wave, int order) {
  detail::require(order >= 0 && order <= 10, "order: must lie within 0 and 10");
  const int terms = (order + 1) * (order + 2) / 2;
  const auto samples = static_cast<Eigen::Index>(wave.opd.size());
  if (samples < 2 * terms)
    throw std::invalid_argument("wave: " + std::to_string(samples) + " samples are too few for " +
                                std::to_string(terms) + " coefficients");
  Eigen::MatrixXd basis(samples, terms);
  Eigen::MatrixXd opd(samples, 1);
  for (Eigen::Index i = 0; i < samples; ++i) {
    for (int j = 0; j < terms; ++j) basis(i, j) = zernike(j, wave.pupil[i]);
    opd(i, 0) = wave.opd[i];
  }
  const Eigen::MatrixXd found = detail::least_squares(basis, opd);
  return {found.data(), found.data() + terms};
}

}  // namespace vitreo::optics
