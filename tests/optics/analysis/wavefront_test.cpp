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
namespace VITREO_TEST_FILE {

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
      EXPECT_NEAR(product / static_cast<double>(samples.size()), i == j ? 1 : 0, 2e-3)
          << i << " " << j;
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

TEST(Polychromatic, APerfectLensAddsAirysPatternsByTheirEnergies) {
  const double na = 1.5 * 1.0 / 30;
  const std::vector<std::pair<double, double>> spectrum{{450e-9, 1}, {550e-9, 2}, {650e-9, 0.5}};
  const auto colors = colored_waves(perfect(1 * kMm), {0, 0, 0}, spectrum,
                                    {.image = 30 * kMm, .rings = 24, .arms = 48});
  const double half_width = 3 * 650e-9 / na;
  constexpr int kCells = 41;
  const Eigen::MatrixXd psf = polychromatic_psf(colors, half_width, kCells);
  EXPECT_NEAR(psf(20, 20), 1, 1e-12);
  for (const int column : {22, 25, 30}) {
    const double off = half_width * ((2.0 * column + 1) / kCells - 1);
    double sum = 0, middle = 0;
    for (const auto& [wavelength, energy] : spectrum) {
      const double v = 2 * std::numbers::pi * na * off / wavelength;
      const double bright = energy / (wavelength * wavelength);
      sum += bright * std::pow(2 * std::cyl_bessel_j(1.0, v) / v, 2);
      middle += bright;
    }
    EXPECT_NEAR(psf(20, column), sum / middle, 3e-3);
  }
}

TEST(Polychromatic, TheTransferIsTheMeanOfTheColorsByTheirEnergies) {
  const double na = 1.5 * 1.0 / 30;
  const std::vector<std::pair<double, double>> spectrum{{450e-9, 1}, {650e-9, 1}};
  const auto colors = colored_waves(perfect(1 * kMm), {0, 0, 0}, spectrum,
                                    {.image = 30 * kMm, .rings = 24, .arms = 48});
  const double half_width = 5 * 450e-9 / na;
  const Eigen::MatrixXd psf = polychromatic_psf(colors, half_width, 48);
  for (const double frequency : {0.2, 0.5, 0.9}) {  // of the cut-off of the longer wave
    double mean = 0;
    const double cycles = frequency * 2 * na / 650e-9;
    for (const auto& [wavelength, energy] : spectrum) {
      const double part = cycles * wavelength / (2 * na);
      mean += (std::acos(part) - part * std::sqrt(1 - part * part)) / std::numbers::pi;
    }
    EXPECT_NEAR(psf_mtf(psf, half_width, {cycles, 0}), mean, 0.03);  // 3 % of the light outside
  }
}

TEST(Polychromatic, AColorOutOfFocusFallsAsItsOwnDefocusSays) {
  // The eye's own colors: 486 and 656 nm in the focus of 589 nm are darker in the middle, by
  // sinc^2 of their own focus' distance; the sum weighs them by their energies over areas.
  System eye = prescription("navarro_condensing").system;
  eye.stop->radius = 0.5 * kMm;  // of more the spherical aberration would change the law
  const std::vector<std::pair<double, double>> spectrum{
      {589.3e-9, 1}, {486.1e-9, 1}, {656.3e-9, 1}};
  const auto alone = colored_waves(eye, {0, 0, 0}, {spectrum[0]}, {});
  const auto three = colored_waves(eye, {0, 0, 0}, spectrum, {.image = alone[0].wave.image});
  double sum = 0, middle = 0;
  for (const ColoredWave& color : three) {
    const auto focused = colored_waves(eye, {0, 0, 0}, {{color.wave.wavelength, 1}}, {});
    const double na = color.wave.numerical_aperture;
    const double shift = focused[0].wave.image - three[0].wave.image;
    const double x = std::numbers::pi * na * na * shift / (2 * color.wave.wavelength);
    const double dark = std::abs(x) > 1e-9 ? std::pow(std::sin(x) / x, 2) : 1;
    EXPECT_NEAR(color.wave.relative_intensity() / focused[0].wave.relative_intensity(), dark, 0.08);
    const double bright = std::pow(na / color.wave.wavelength, 2);
    sum += bright * dark * focused[0].wave.relative_intensity();
    middle += bright;
  }
  const double seen = polychromatic_psf(three, 1e-6, 1)(0, 0);
  EXPECT_NEAR(seen, sum / middle, 0.05);
  EXPECT_LT(seen, 0.95 * polychromatic_psf(alone, 1e-6, 1)(0, 0));
}

TEST(Polychromatic, BadSpectraAreNamed) {
  const System lens = perfect(1 * kMm);
  const WavefrontSettings at{.image = 30 * kMm, .rings = 4, .arms = 8};
  expect_refused("energy", [&] { (void)colored_waves(lens, {0, 0, 0}, {{5e-7, 0}}, at); });
  expect_refused("colors", [&] { (void)polychromatic_psf({}, 1e-6, 4); });
  auto colors = colored_waves(lens, {0, 0, 0}, {{5e-7, 1}, {6e-7, 1}}, at);
  colors[1].wave.image += 1e-3;
  expect_refused("colors", [&] { (void)polychromatic_psf(colors, 1e-6, 4); });
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

/// m, rms of the aberrations that are neither piston, tilt nor defocus.
double beyond_defocus(const System& eye, double aperture, const Eigen::Vector3d& point) {
  Microscope microscope;
  microscope.numerical_aperture = aperture;
  microscope.focus = 12.3 * kMm;
  const PupilTracer tracer(eye, Pupil::of_microscope(eye, microscope));
  const auto wave = wavefront(tracer, point, {.rings = 12, .arms = 24});
  EXPECT_TRUE(wave);
  if (!wave) return kFar;
  EXPECT_NEAR(wave->numerical_aperture, aperture, 0.1 * aperture);
  const std::vector<double> z = zernike_coefficients(*wave, 6);
  double squares = 0;
  for (std::size_t j = 3; j < z.size(); ++j)
    if (j != 4) squares += z[j] * z[j];
  return std::sqrt(squares);
}

// Why the renderer's kernel has the wave of a defocus and no other (docs/simulated_laboratory.md):
// a rms of a 25th of the wavelength takes 6 % of the light from the middle (Marechal).
TEST(Wavefront, AtTheMicroscopesApertureDefocusIsAllThatTheEyeDoes) {
  for (const char* const name : {"model_eye_5_3", "navarro_condensing"}) {
    const System eye = prescription(name).system;
    for (const double z : {0.5 * kMm, 4 * kMm, 8 * kMm}) {
      for (const double aside : {0.0, 1.5 * kMm, 3 * kMm, 4 * kMm}) {
        const double rms = beyond_defocus(eye, 0.01, {aside, 0, z + aside * aside / (24 * kMm)});
        EXPECT_LT(rms, 0.04 * eye.wavelength) << name << " " << z << " " << aside;
      }
    }
    EXPECT_GT(beyond_defocus(eye, 0.05, {3 * kMm, 0, 1 * kMm}), 0.05 * eye.wavelength)
        << "of a wider aperture it is not";
  }
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

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
