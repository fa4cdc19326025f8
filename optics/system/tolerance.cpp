// SPDX-License-Identifier: Apache-2.0
#include "optics/system/tolerance.h"

#include "optics/numerics/preconditions.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

/// A standard normal number by Box & Muller (1958), the cosine branch alone.
/// std::normal_distribution differs from library to library, and with it would the sampled eyes.
/// A draw always takes two numbers of the generator, so the n-th draw of a seed is the same
/// whatever came before.
double normal(std::mt19937_64& random) {
  constexpr double kUnit = 0x1p-53;
  // The upper 53 bits of a draw: what a double holds. The half keeps u above 0, where the logarithm
  // is.
  const double u = (static_cast<double>(random() >> 11) + 0.5) * kUnit;  // never 0
  const double v = (static_cast<double>(random() >> 11) + 0.5) * kUnit;
  return std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * v);
}

/// From a relative sigma of 1 on, a sixth of all draws or more would have the wrong sign.
void check(const Uncertainty& one) {
  if (!(one.relative >= 0 && one.relative < 1)) {
    throw std::invalid_argument(one.parameter + ": its uncertainty must lie within 0 and 1");
  }
}

/// The parameter at value * (1 + relative * sigmas): table 5.1 states relative uncertainties.
Override off(const Prescription& prescription, const Uncertainty& one, double sigmas) {
  check(one);
  return {one.parameter, parameter(prescription, one.parameter) * (1 + one.relative * sigmas)};
}

}  // namespace

/// One sigma each; the sources are those that thesis 4.2 cites.
std::vector<Uncertainty> table_5_1() {
  constexpr const char* kKirschkamp = "Kirschkamp et al. 2004";
  constexpr const char* kCarney = "Carney et al. 1997";
  constexpr const char* kRead = "Read et al. 2006, Dubbelman et al. 2006";
  return {
      {"vitreous.index", 0.02, "assumed in 4.2; water is 1.333"},
      {"lens.posterior.radius", 0.08, kKirschkamp},
      {"lens.thickness", 0.06, kCarney},
      {"lens.anterior.radius", 0.04, kKirschkamp},
      {"lens.index", 0.04, "range 1.363 to 1.476 in 4.2"},
      {"aqueous.thickness", 0.10, kCarney},
      {"aqueous.index", 0.02, "as the vitreous"},
      {"cornea.posterior.radius", 0.04, kRead},
      {"cornea.thickness", 0.06, kRead},
      {"cornea.anterior.radius", 0.03, kRead},
      {"cornea.index", 0.03, "Patel et al. 1995"},
  };
}

/// Leaves out what the prescription does not have, and what has no fraction: the index of air is
/// exact, a plane has no radius.
std::vector<Uncertainty> applicable(const std::vector<Uncertainty>& uncertainties,
                                    const Prescription& prescription) {
  const auto known = parameters(prescription);
  std::vector<Uncertainty> those;
  for (const Uncertainty& one : uncertainties) {
    const auto is_it = [&](const Parameter& its) {
      const bool air = its.value == 1 && its.name.ends_with(".index");
      // no fraction of it is uncertain
      const bool flat = its.value == 0 || !std::isfinite(its.value);
      return its.name == one.parameter && !air && !flat;
    };
    if (std::any_of(known.begin(), known.end(), is_it)) those.push_back(one);
  }
  return those;
}

/// Throws std::invalid_argument where the moved parameter leaves no sound system.
Prescription perturbed(const Prescription& prescription, const Uncertainty& uncertainty,
                       double sigmas) {
  const Override change = off(prescription, uncertainty, sigmas);
  return with_parameters(prescription, {&change, 1});
}

/// Independent Gaussian parameters; rejection sampling truncates them to systems that pass
/// System::check.
/// Throws std::invalid_argument naming the uncertainties when hardly any draw is sound. The sigmas
/// drawn are kept with each eye, so that errors can be traced back to them.
std::vector<PerturbedEye> monte_carlo(const Prescription& prescription,
                                      const std::vector<Uncertainty>& uncertainties, int count,
                                      std::mt19937_64& random) {
  constexpr int kTriesPerEye = 1000;
  detail::require(count >= 0, "count: must not be negative");
  std::vector<PerturbedEye> eyes;
  for (long tries = 0; static_cast<int>(eyes.size()) < count; ++tries) {
    if (tries >= static_cast<long>(kTriesPerEye) * count) {
      throw std::invalid_argument("uncertainties: too large, hardly any draw is an eye");
    }
    PerturbedEye eye;
    std::vector<Override> changes;
    for (const Uncertainty& one : uncertainties) {
      eye.sigmas.push_back(normal(random));
      changes.push_back(off(prescription, one, eye.sigmas.back()));
    }
    try {
      eye.prescription = with_parameters(prescription, changes);
    } catch (const std::invalid_argument&) {
      continue;
    }
    eyes.push_back(std::move(eye));
  }
  return eyes;
}

}  // namespace vitreo::optics
