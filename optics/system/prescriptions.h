// Optical systems as data: the thesis' tables by name, and personal eyes made of them by overriding
// parameters.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/system.h"

#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace vitreo::optics {

/// A system whose surfaces and media have names, and through them its parameters:
/// "cornea.anterior.radius" (m), ".conic", ".a4" to ".a10" (m^-3 to m^-9), ".semi_diameter" (m);
/// "lens.thickness" (m), "lens.index"; "stop.radius" (m), "stop.surface". A surface may also be
/// called by its number: "surface_5.radius", "surface_5.thickness". Off the axis:
/// "lens.anterior.decenter_x" to "_z" (m), ".tilt_x" to "_z" (rad); toric: ".radius_y" (m),
/// ".conic_y"; "lens.gradient_z1" to "_z4", "_r2" to "_r6" (system/gradient.h).
struct Prescription {
  std::string name;                   // as prescription_names() lists it
  std::string title;                  // for display
  std::string source;                 // where the numbers are from, and what was assumed
  std::vector<std::string> surfaces;  // names, one per surface: "retina", "lens.posterior", ...
  // names of what lies behind each surface: "vitreous", "lens", ...
  std::vector<std::string> media;
  System system;
  /// Throws std::invalid_argument when names are missing or used twice, or the system is not sound.
  void check() const;
};

struct Parameter {
  std::string name;
  std::string unit;  // "m", "1", "m^-3", ...
  double value = 0;  // SI
};

/// Names of all built-in prescriptions.
std::vector<std::string> prescription_names();

/// One of them. Throws std::invalid_argument with suggestions for an unknown name.
Prescription prescription(std::string_view name);

/// All parameters with their values, in the order of the surfaces, the stop last. Decenter, tilt,
/// toric sections and gradients only where there are some.
std::vector<Parameter> parameters(const Prescription& prescription);

/// One parameter's value. Throws std::invalid_argument with suggestions for an unknown name.
double parameter(const Prescription& prescription, std::string_view name);

using Override = std::pair<std::string, double>;

/// A personal eye: the same prescription with some parameters replaced. When a thickness changes,
/// all other entries of the table stay, so what lies behind moves along. Throws
/// std::invalid_argument naming the parameter for an unknown name (with suggestions) and for a
/// value that leaves the system unsound.
Prescription with_parameters(const Prescription& prescription, std::span<const Override> overrides);

/// The eye when it accommodates by `accommodation` (dioptres, 1/m): lens and anterior chamber as
/// Navarro, Santamaria & Bescos (1985), table 4, with the relaxed values of the prescription
/// (Escudero-Sanz & Navarro 1999 keep that table): with L = ln(A + 1), in mm, the lens' anterior
/// radius changes by -1.75 L, its posterior by -0.2294 L, its anterior conic by -0.34 L, its
/// posterior by -0.125 L, its thickness by 0.1 L, the aqueous by -0.05 L, and the lens' index by
/// 9e-5 (10 A + A^2). The vitreous keeps its length. Throws std::invalid_argument outside 0 to 10,
/// and for a prescription that has no lens and aqueous.
Prescription accommodate(Prescription prescription, double accommodation);

}  // namespace vitreo::optics
