// Wavefront of a point's light behind the system: optical path differences and what follows from
// them: rms, Strehl ratio, diffraction point spread and modulation transfer. Frame: the eye frame.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/pupil.h"

#include <Eigen/Core>

#include <optional>
#include <utility>
#include <vector>

namespace vitreo::optics {

struct WavefrontSettings {
  /// m, from the last vertex to the image plane; nothing: the best focus of the rays; infinite: the
  /// image is far away, as of an eye alone.
  std::optional<double> image{};
  // of the pupil's samples: disc_samples, at least 2 and 4
  int rings = 16;
  int arms = 32;
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// Samples of equal area of the filled pupil. Each ray is a plane wave that has its own phase in
/// the image: the field there is their sum (Debye's integral), so no exit pupil needs to be chosen,
/// and nothing is paraxial.
struct Wavefront {
  double wavelength = 0;                   // m, in vacuum
  double index = 1;                        // behind the last surface
  double image = 0;                        // m, from the last vertex; infinite: far away
  Eigen::Vector2d chief{0, 0};             // m, where the chief ray meets the image plane
  std::vector<Eigen::Vector2d> pupil;      // in the unit disc
  std::vector<double> opd;                 // m, against the chief ray's path; positive: longer
  std::vector<Eigen::Vector2d> direction;  // cosines along x and y against the chief ray's
  int lost = 0;                            // samples whose ray did not come through
  double numerical_aperture = 0;           // index times the largest |direction|
  double reach = 0;                        // m, in the image plane, how far off the samples suffice
  double rms() const;                      // m, about the mean
  /// Intensity over that without aberration at `off` (m, from the chief ray in the image plane).
  double relative_intensity(const Eigen::Vector2d& off = {0, 0}) const;
  /// The largest of them: where the image is brightest, found from where rays are densest.
  double strehl() const;
};

/// Of a point in the vitreous (m) through the pupil that `tracer` fills, which is the system's real
/// stop, or a microscope's own. Light of the system's wavelength. Nothing when the chief ray or
/// more than half of the samples do not come through.
std::optional<Wavefront> wavefront(const PupilTracer& tracer, const Eigen::Vector3d& point,
                                   const WavefrontSettings& settings = {});

/// Diffraction point spread about the chief ray: cells x cells intensities at the middles of
/// squares that span -half_width to half_width (m), rows along y, columns along x; 1 is the middle
/// of a perfect one. Throws std::invalid_argument for bad arguments, for a square whose corners are
/// beyond the wave's reach (there the sum repeats itself), and for an image that is far away.
Eigen::MatrixXd diffraction_psf(const Wavefront& wave, double half_width, int cells);

/// One color of a spectrum: its wave, and the energy of its light that fills the pupil (any unit).
struct ColoredWave {
  Wavefront wave;
  double energy = 1;
};
/// A point's waves in several colors, in one image plane: where a color has its own focus or its
/// own place, that is in the waves (at_wavelength, then wavefront() at the same `image`). Throws
/// std::invalid_argument for an energy that is not positive, and for a color without a wave.
std::vector<ColoredWave> colored_waves(const System& system, const Eigen::Vector3d& point,
                                       const std::vector<std::pair<double, double>>& spectrum,
                                       const WavefrontSettings& settings);
/// Point spread of light of several colors: intensities add up, each color's pattern of the size
/// that its wavelength gives it and about its own chief ray, as seen from that of the first. Each
/// cell has energy per area, in units of the middle of the same light without aberrations. Throws
/// std::invalid_argument as diffraction_psf does, and for images in different planes.
Eigen::MatrixXd polychromatic_psf(const std::vector<ColoredWave>& colors, double half_width,
                                  int cells);

/// Modulation transfer (0 to 1) of a point spread at a frequency (cycles per m): the modulus of its
/// Fourier transform.
double psf_mtf(const Eigen::MatrixXd& psf, double half_width, const Eigen::Vector2d& frequency);

/// Zernike polynomials in the ANSI Z80.28 order and norm (each of rms 1 over the unit disc), angles
/// from +x towards +y: j = (n (n + 2) + m) / 2.
double zernike(int j, const Eigen::Vector2d& at);

/// Coefficients (m) of the wavefront up to the radial order `order` (0 to 10), by least squares;
/// index j in the ANSI order. Throws std::invalid_argument for a bad order or too few samples.
std::vector<double> zernike_coefficients(const Wavefront& wave, int order = 6);

}  // namespace vitreo::optics
