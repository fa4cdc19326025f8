// SPDX-License-Identifier: Apache-2.0
#include "control/measured_gel.h"

#include "control/constants.h"
#include "control/preconditions.h"

#include <array>
#include <charconv>
#include <cstdio>

namespace vitreo::control {
namespace {

/// The shortest text that reads back as the same number.
std::string shortest(double value) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value);
  return {text.data(), end.ptr};
}

}  // namespace

// A Kelvin-Voigt body below its yield strain: G' by the network, G'' by the solvent beside it,
// eta_s = G'' / (2 pi f) in Pa s. positive() refuses a NaN as well, which sscanf reads from "nan".
Gel gel_of(const Rheometry& measured) {
  require(positive(measured.storage_modulus), "gel storage_modulus: must be above 0 Pa");
  require(positive(measured.loss_modulus), "gel loss_modulus: must be above 0 Pa");
  require(positive(measured.frequency), "gel frequency: must be above 0 Hz");
  Gel gel;
  gel.name = gel_text(measured);
  gel.storage_modulus = measured.storage_modulus;
  gel.solvent_viscosity = measured.loss_modulus / (2 * kPi * measured.frequency);
  return gel;
}

// Shortest digits that read back the same, so that the twin, the emulated laboratory and the record
// have the gel to the bit.
std::string gel_text(const Rheometry& measured) {
  return "gel of G' " + shortest(measured.storage_modulus) + " Pa and G'' " +
         shortest(measured.loss_modulus) + " Pa at " + shortest(measured.frequency) + " Hz";
}

// The whole text must fit: words behind it would be a gel that nothing here knows.
std::optional<Rheometry> rheometry_in(std::string_view text) {
  Rheometry read;
  int used = 0;
  const std::string whole(text);
  const int found = std::sscanf(whole.c_str(), "gel of G' %lf Pa and G'' %lf Pa at %lf Hz%n",
                                &read.storage_modulus, &read.loss_modulus, &read.frequency, &used);
  if (found < 3 || static_cast<std::size_t>(used) != whole.size()) return std::nullopt;
  return read;
}

}  // namespace vitreo::control
