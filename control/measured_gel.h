// Gel by the moduli that a rheometer measured: G' and G'' at one frequency (thesis 7.1,
// figure 7.1).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/vitreous.h"

#include <optional>
#include <string>
#include <string_view>

namespace vitreo::control {

/// Storage and loss modulus in Pa at `frequency` Hz of a small strain.
struct Rheometry {
  double storage_modulus = 14;
  double loss_modulus = 3;
  double frequency = 1;
};

/// Below its yield strain the gel's complex modulus is G* = G' + i 2 pi f eta_s, so eta_s = G'' /
/// (2 pi f); what such a measurement does not tell, yield strain and plastic viscosity, is as in
/// `Gel`. Throws std::invalid_argument naming a modulus that is not above 0.
Gel gel_of(const Rheometry& measured);

/// As an operator is asked for it, and as gel_named() takes it: "gel of G' 14 Pa and G'' 3 Pa at 1
/// Hz".
std::string gel_text(const Rheometry& measured);
/// What gel_text() wrote, or nothing.
std::optional<Rheometry> rheometry_in(std::string_view text);

}  // namespace vitreo::control
