// Wavefronts against closed forms (perfect lenses, Airy, defocus, Marechal) and published eyes.
// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/wavefront.h"

#include "optics/system/first_order.h"
#include "optics/system/medium.h"
#include "optics/system/prescriptions.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace vitreo::optics {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

/// Descartes' surfaces: from a point in glass of index 1.5 to parallel light in air (conic
/// constant -1/n^2, an ellipsoid, whose far focus is the point), and by its mirror image to a point
/// in glass. All paths are equally long. R = -10 mm; the focus lies R n / (n - 1) = 30 mm away.
System perfect(double radius_of_stop) {
  constexpr double kIndex = 1.5;
  constexpr double kConic = -1 / (kIndex * kIndex);
  System made;
  made.surfaces = {make_surface(50 * kMm, 0, 30 * kMm, kIndex),
                   make_surface(-10 * kMm, kConic, 4 * kMm, 1.0),
                   make_surface(std::numeric_limits<double>::infinity(), 0, 4 * kMm, 1.0),
                   make_surface(10 * kMm, kConic, 0, kIndex)};
  made.stop = Stop{3, radius_of_stop};
  return made;
}

Wavefront wave_of(const System& system, const Eigen::Vector3d& point, std::optional<double> image,
                  int rings = 16) {
  const PupilTracer tracer(system, Pupil::of_stop(system, Pupil::Kind::real_stop));
  return wavefront(tracer, point, {.image = image, .rings = rings, .arms = 2 * rings}).value();
}

TEST(Wavefront, APerfectLensHasNoneAndItsPointSpreadIsAirys) {
  const Wavefront wave = wave_of(perfect(1 * kMm), {0, 0, 0}, 30 * kMm, 12);
  EXPECT_LT(wave.rms(), 1e-15);
  EXPECT_NEAR(wave.strehl(), 1, 1e-12);
  // sin u = r / f to third order: NA = n r / 30 mm. The outermost of 12 rings lies half a ring
  // inside the rim.
  const double na = 1.5 * 1.0 / 30;
  EXPECT_NEAR(wave.numerical_aperture, na, 0.03 * na);
  for (const double v : {0.5, 1.0, 2.0, 3.0, 5.0}) {
    const double off = v * wave.wavelength / (2 * std::numbers::pi * na);
    const double airy = std::pow(2 * std::cyl_bessel_j(1.0, v) / v, 2);
    EXPECT_NEAR(wave.relative_intensity({off, 0}), airy, 2e-3) << v;
    EXPECT_NEAR(wave.relative_intensity({0, off}), airy, 2e-3) << v;
  }
  EXPECT_LT(wave.relative_intensity({0.61 * wave.wavelength / na, 0}), 1e-4);  // the dark ring
}

TEST(Wavefront, DefocusLowersTheStrehlRatioAsTheSquareOfASinc) {
  const double na = 1.5 * 1.0 / 30;
  for (const double waves : {0.1, 0.25, 0.5, 0.8}) {
    const double path = waves * kReferenceWavelength;  // at the rim: n dz sin^2 u / 2
    const double shift = 2 * path * 1.5 / (na * na);
    const Wavefront wave = wave_of(perfect(1 * kMm), {0, 0, 0}, 30 * kMm + shift, 12);
    const double x = std::numbers::pi * waves;
    EXPECT_NEAR(wave.relative_intensity(), std::pow(std::sin(x) / x, 2), 3e-3) << waves;
    // W = path (rho^2) has the Zernike coefficient path / (2 sqrt 3).
    EXPECT_NEAR(std::abs(zernike_coefficients(wave)[4]), path / (2 * std::sqrt(3.0)), 0.01 * path);
  }
}

TEST(Wavefront, SmallAberrationsFollowMarechal) {
  System eye = prescription("navarro_condensing").system;
  eye.stop->radius = 0.5 * kMm;
  const Wavefront wave = wave_of(eye, {0, 0, 0}, std::nullopt);
  const double sigma = 2 * std::numbers::pi * wave.rms() / wave.wavelength;
  ASSERT_LT(sigma, 0.7);
  EXPECT_NEAR(wave.strehl(), std::exp(-sigma * sigma), 0.02);
}

TEST(Wavefront, ZernikePolynomialsAreOrthonormalOverTheDisc) {
  const auto samples = disc_samples(100, 16);
  for (int i = 0; i < 21; ++i) {
    for (int j = 0; j <= i; ++j) {
      double product = 0;
      for (const auto& at : samples) product += zernike(i, at) * zernike(j, at);
      EXPECT_NEAR(product / static_cast<double>(samples.size()), i == j ? 1 : 0, 2e-3) << i << " " << j;
    }
  }
  EXPECT_NEAR(zernike(4, {1, 0}), std::sqrt(3.0), 1e-12);             // defocus, 2 rho^2 - 1
  EXPECT_NEAR(zernike(12, {1, 0}), std::sqrt(5.0), 1e-12);            // spherical aberration
  EXPECT_NEAR(zernike(8, {1, 0}), std::sqrt(8.0), 1e-12);             // coma along x
  EXPECT_NEAR(zernike(3, {0.6, 0.6}), std::sqrt(6.0) * 0.72, 1e-12);  // oblique astigmatism
}

TEST(Wavefront, TheModulationTransferIsThatOfACircularPupil) {
  const Wavefront wave = wave_of(perfect(1 * kMm), {0, 0, 0}, 30 * kMm, 24);
  const double na = 1.5 * 1.0 / 30;
  const double half_width = 5 * wave.wavelength / na;  // outside it 2.5 % of the light
  const Eigen::MatrixXd psf = diffraction_psf(wave, half_width, 48);
  EXPECT_NEAR(psf_mtf(psf, half_width, {0, 0}), 1, 1e-12);
  for (const double part : {0.2, 0.5, 0.8}) {  // of the cut-off 2 NA / lambda
    const double perfect_mtf =
        2 / std::numbers::pi * (std::acos(part) - part * std::sqrt(1 - part * part));
    EXPECT_NEAR(psf_mtf(psf, half_width, {part * 2 * na / wave.wavelength, 0}), perfect_mtf, 0.03);
  }
}

/// Refraction of the eye for light of its retina's vertex, dioptres: the vergence in air.
double vergence(const System& eye) {
  const auto image = axial_image(eye, 0);
  return image ? 1 / image->distance : 0;
}

TEST(Wavefront, NavarrosEyeHasItsPublishedColors) {
  const System eye = prescription("navarro").system;
  // Thibos et al. 1992, the chromatic eye: Rx = 1.68524 - 633.46 / (nm - 214.102); Navarro et al.
  // 1985 report agreement with such measurements. Between the F and the C line 0.90 D.
  const auto measured = [](double nm) { return 1.68524 - 633.46 / (nm - 214.102); };
  const double between =
      vergence(at_wavelength(eye, 486.1e-9)) - vergence(at_wavelength(eye, 656.3e-9));
  EXPECT_NEAR(std::abs(between), measured(656.3) - measured(486.1), 0.15);
  const double wider = vergence(at_wavelength(eye, 450e-9)) - vergence(at_wavelength(eye, 650e-9));
  EXPECT_NEAR(std::abs(wider), measured(650) - measured(450), 0.2);
}

TEST(Wavefront, SphericalAberrationOfNavarrosEyeIsThatOfSeidelNearTheAxis) {
  System eye = prescription("navarro_condensing").system;
  eye.stop->radius = 0.2 * kMm;
  const Wavefront wave = wave_of(eye, {0, 0, 0}, axial_image(eye, 0)->distance);
  const std::vector<double> z = zernike_coefficients(wave, 8);
  for (const int j : {1, 2, 3, 5, 7, 8}) EXPECT_NEAR(z[j], 0, 1e-12) << j;  // it is symmetric
  // Twice the pupil: 16 times the aberration, as it is of fourth order.
  eye.stop->radius = 0.4 * kMm;
  const Wavefront wider = wave_of(eye, {0, 0, 0}, axial_image(eye, 0)->distance);
  EXPECT_NEAR(zernike_coefficients(wider, 8)[12] / z[12], 16, 1);
}

TEST(Wavefront, BadArgumentsAreNamed) {
  const System eye = perfect(1 * kMm);
  const PupilTracer tracer(eye, Pupil::of_stop(eye));
  expect_refused("rings", [&] { (void)wavefront(tracer, {0, 0, 0}, {.image = 0.0, .rings = 1}); });
  const Wavefront wave = wave_of(eye, {0, 0, 0}, 30 * kMm, 4);
  expect_refused("cells", [&] { (void)diffraction_psf(wave, 1e-6, 0); });
  expect_refused("half_width", [&] { (void)diffraction_psf(wave, 1e-3, 8); });
  expect_refused("order", [&] { (void)zernike_coefficients(wave, 11); });
  expect_refused("wave", [&] { (void)zernike_coefficients(wave, 10); });
  Wavefront far = wave;
  far.image = kFar;
  expect_refused("wave", [&] { (void)diffraction_psf(far, 1e-6, 8); });
}

}  // namespace
}  // namespace vitreo::optics
