// SPDX-License-Identifier: Apache-2.0
#include "optics/system/medium.h"

#include "optics/system/names.h"

#include <array>
#include <cmath>
#include <initializer_list>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

/// Navarro's media by Herzberger's formula: n = a1 n(365) + a2 n(486.1) + a3 n(656.3) + a4 n(1014),
///  a_i = A0 + A1 l^2 + P / (l^2 - l0^2) + R / (l^2 - l0^2)^2,  l0^2 = 0.028, l in um.
/// A1 of the first row is printed as -0.0403 in the paper; with Herzberger's own -0.4035 the four
/// functions sum to 1.
double herzberger(const std::array<double, 4>& nodes, double um) {
  constexpr double kA[4][4] = {{0.66147196, -0.40352796, -0.28046790, 0.03385979},
                               {-4.20146383, 2.73508956, 1.50543784, -0.11593235},
                               {6.29834237, -4.69409935, -1.57508650, 0.10293038},
                               {-1.75835059, 2.36253794, 0.35011657, -0.02085782}};
  const double l2 = um * um;
  const double pole = 1 / (l2 - 0.028);
  double index = 0;
  for (int i = 0; i < 4; ++i) {
    index += nodes[i] * (kA[i][0] + kA[i][1] * l2 + pole * (kA[i][2] + pole * kA[i][3]));
  }
  return index;
}

/// Cauchy's equation in nm, as Atchison & Smith print it.
double cauchy(const std::array<double, 4>& a, double um) {
  const double p = 1e-6 / (um * um);  // 1 / nm^2
  return a[0] + p * (a[1] + p * (a[2] + p * a[3]));
}

/// Sellmeier's equation: n^2 = 1 + sum B l^2 / (l^2 - C), l in um.
double sellmeier(std::initializer_list<std::pair<double, double>> terms, double um) {
  double square = 1;
  for (const auto& [b, c] : terms) square += b * um * um / (um * um - c);
  return std::sqrt(square);
}

/// A wavelength outside the data would be answered by a polynomial that has left it; so each model
/// has its range.
struct Model {
  Dispersion dispersion;
  const char* name;
  // nm, of the data that the equation was fitted to, or as far as its authors extrapolate it
  double from_nm;
  double to_nm;
};

constexpr Model kModels[] = {
    {Dispersion::none, "none", 0, 1e9},
    {Dispersion::navarro_cornea, "navarro_cornea", 365, 1014},
    {Dispersion::navarro_aqueous, "navarro_aqueous", 365, 1014},
    {Dispersion::navarro_lens, "navarro_lens", 365, 1014},
    {Dispersion::navarro_vitreous, "navarro_vitreous", 365, 1014},
    {Dispersion::atchison_cornea, "atchison_cornea", 400, 900},
    {Dispersion::atchison_aqueous, "atchison_aqueous", 400, 900},
    {Dispersion::atchison_lens, "atchison_lens", 400, 900},
    {Dispersion::atchison_vitreous, "atchison_vitreous", 400, 900},
    {Dispersion::liou_brennan, "liou_brennan", 380, 750},
    {Dispersion::water, "water", 182, 1129},
    {Dispersion::n_bk7, "n_bk7", 300, 2500},
    {Dispersion::pmma, "pmma", 436, 1052},
};

/// Throws for a number that was cast to the enumeration.
const Model& model_of(Dispersion dispersion) {
  for (const Model& one : kModels) {
    if (one.dispersion == dispersion) return one;
  }
  throw std::invalid_argument("dispersion: there is no such model");
}

/// The numbers as printed: Navarro's are the indices at 365, 486.1, 656.3 and 1014 nm.
double index_of(Dispersion dispersion, double um) {
  switch (dispersion) {
    case Dispersion::navarro_cornea:
      return herzberger({1.3975, 1.3807, 1.37405, 1.3668}, um);
    case Dispersion::navarro_aqueous:
      return herzberger({1.3593, 1.3422, 1.3354, 1.3278}, um);
    case Dispersion::navarro_lens:
      return herzberger({1.4492, 1.42625, 1.4175, 1.4097}, um);
    case Dispersion::navarro_vitreous:
      return herzberger({1.3565, 1.3407, 1.3341, 1.3273}, um);
    case Dispersion::atchison_cornea:
      return cauchy({1.361594, 6009.687, -6.76076e8, 5.90845e13}, um);
    case Dispersion::atchison_aqueous:
      return cauchy({1.321631, 6070.796, -7.062305e8, 6.147861e13}, um);
    case Dispersion::atchison_lens:
      return cauchy({1.389248, 6521.218, -6.110661e8, 5.908191e13}, um);
    case Dispersion::atchison_vitreous:
      return cauchy({1.322357, 5560.240, -5.817391e8, 5.036810e13}, um);
    case Dispersion::liou_brennan:
      return 1 + 0.0512 - 0.1455 * um + 0.0961 * um * um;  // what they add to each index
    case Dispersion::water:
      return sellmeier({{5.684027565e-1, 5.101829712e-3},
                        {1.726177391e-1, 1.821153936e-2},
                        {2.086189578e-2, 2.620722293e-2},
                        {1.130748688e-1, 1.069792721e1}},
                       um);
    case Dispersion::n_bk7:
      return sellmeier(
          {{1.03961212, 0.00600069867}, {0.231792344, 0.0200179144}, {1.01046945, 103.560653}}, um);
    case Dispersion::pmma:
      return sellmeier({{1.1819, 0.011313}}, um);
    case Dispersion::none:
      break;
  }
  return 1;
}

}  // namespace

const char* to_string(Dispersion dispersion) { return model_of(dispersion).name; }

std::vector<std::string> dispersion_names() {
  std::vector<std::string> names;
  for (const Model& one : kModels) names.emplace_back(one.name);
  return names;
}

Dispersion dispersion_named(std::string_view name) {
  for (const Model& one : kModels) {
    if (one.name == name) return one.dispersion;
  }
  throw std::invalid_argument("dispersion: there is no \"" + std::string(name.substr(0, 40)) +
                              "\"" + detail::suggestions(name, dispersion_names()));
}

/// The ends of a range belong to it, whatever rounding made of 365e-9.
double model_index(Dispersion dispersion, double wavelength) {
  const Model& model = model_of(dispersion);
  constexpr double kNm = 1e-9;
  constexpr double kRounding_nm = 1e-6;
  if (!(wavelength >= (model.from_nm - kRounding_nm) * kNm &&
        wavelength <= (model.to_nm + kRounding_nm) * kNm)) {
    throw std::invalid_argument("wavelength: " + std::string(model.name) + " is known from " +
                                std::to_string(static_cast<int>(model.from_nm)) + " to " +
                                std::to_string(static_cast<int>(model.to_nm)) + " nm");
  }
  return index_of(dispersion, wavelength * 1e6);
}

}  // namespace vitreo::optics
