// Dispersion of the eye's media and of lens materials.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace vitreo::optics {

/// m, in vacuum; the sodium line, for which the thesis' tables are.
constexpr double kReferenceWavelength = 589.3e-9;

/// How a medium's index changes with the wavelength. The models give the index itself too, but only
/// its change is used, so that a personal eye's media keep their own index.
enum class Dispersion {
  none,
  // Navarro, Santamaria & Bescos (1985)
  navarro_cornea,
  navarro_aqueous,
  navarro_lens,
  navarro_vitreous,
  // Atchison & Smith (2005), Cauchy's equations
  atchison_cornea,
  atchison_aqueous,
  atchison_lens,
  atchison_vitreous,
  liou_brennan,  // Liou & Brennan (1997), all media alike
  water,         // Daimon & Masumura (2007), 20 degrees C
  n_bk7,         // Schott
  pmma,          // Sultanova, Kasarova & Nikolov (2009)
};
const char* to_string(Dispersion dispersion);
/// Throws std::invalid_argument with suggestions for an unknown name.
Dispersion dispersion_named(std::string_view name);
std::vector<std::string> dispersion_names();

/// Index of the model at a vacuum wavelength (m). Throws std::invalid_argument outside the range
/// that its source covers. 1 for none.
double model_index(Dispersion dispersion, double wavelength);

}  // namespace vitreo::optics
