// Parameters of a prescription by name: listing, reading, replacing.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/names.h"
#include "optics/system/prescriptions.h"
#include "optics/system/surface_fields.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// a_2k multiplies r^2k to a length: m^(1 - 2k).
constexpr const char* kAspheric[] = {".a4", ".a6", ".a8", ".a10"};
constexpr const char* kAsphericUnit[] = {"m^-3", "m^-5", "m^-7", "m^-9"};

/// Calls visit(name, alias, unit, value&) for every real parameter. The alias counts the surface:
/// "surface_5.radius".
/// Listing, reading and replacing all come through here, so a name that is listed can always be
/// set. A thickness behind the last surface is no parameter, since nothing depends on it.
template <class AnyPrescription, class Visitor>
void visit_parameters(AnyPrescription& of, Visitor&& visit) {
  auto& surfaces = of.system.surfaces;
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    const std::string number = "surface_" + std::to_string(i + 1);
    const auto one = [&](const std::string& owner, const char* field, const char* unit,
                         auto& value) { visit(owner + field, number + field, unit, value); };
    auto& surface = surfaces[i];
    one(of.surfaces[i], ".radius", "m", surface.radius);
    one(of.surfaces[i], ".conic", "1", surface.conic);
    for (std::size_t k = 0; k < surface.aspheric.size(); ++k) {
      one(of.surfaces[i], kAspheric[k], kAsphericUnit[k], surface.aspheric[k]);
    }
    one(of.surfaces[i], ".semi_diameter", "m", surface.semi_diameter);
    if (i + 1 < surfaces.size()) one(of.media[i], ".thickness", "m", surface.thickness);
    one(of.media[i], ".index", "1", surface.index);
    if (i == 0) continue;  // the retina is centered and no toric, the vitreous has no gradient
    for (const SurfaceField& field : surface_fields()) {
      one(field.of_medium ? of.media[i] : of.surfaces[i], ("." + std::string(field.name)).c_str(),
          field.unit, field.of(const_cast<Surface&>(surface)));
    }
  }
  if (of.system.stop) visit("stop.radius", "stop.radius", "m", of.system.stop->radius);
}

std::vector<std::string> names_of(const Prescription& prescription) {
  std::vector<std::string> names;
  visit_parameters(prescription, [&](const std::string& name, const std::string&, const char*,
                                     double) { names.push_back(name); });
  return names;
}

/// With the nearest names, as most unknown names are misspelled.
[[noreturn]] void refuse_unknown(const Prescription& prescription, std::string_view name) {
  throw std::invalid_argument("parameter: " + prescription.name + " has no \"" + std::string(name) +
                              "\"" + detail::suggestions(name, names_of(prescription)));
}

/// One name for each surface and medium, none twice, since parameters are found by them.
void check_names(const std::vector<std::string>& names, const System& system, const char* what) {
  if (names.size() != system.surfaces.size()) {
    throw std::invalid_argument(std::string(what) + ": " + std::to_string(names.size()) +
                                " names for " + std::to_string(system.size()) + " surfaces");
  }
  std::set<std::string> seen;
  for (const std::string& name : names) {
    if (name.empty() || !seen.insert(name).second) {
      throw std::invalid_argument(std::string(what) + ": \"" + name + "\" is empty or used twice");
    }
  }
}

/// The only parameter that is an integer.
/// Throws std::invalid_argument naming it; the surface must refract, so it is never the retina.
void set_stop_surface(Prescription& prescription, double value) {
  if (!(std::floor(value) == value && value >= 2 && value <= prescription.system.size())) {
    throw std::invalid_argument("stop.surface: must be a whole number of 2.." +
                                std::to_string(prescription.system.size()));
  }
  prescription.system.stop->surface = static_cast<int>(value);
}

/// Only the name and NaN are refused here: values that are unsound alone may be sound with the next
/// one.
void set(Prescription& prescription, const std::string& name, double value) {
  if (std::isnan(value)) throw std::invalid_argument(name + ": is not a number");
  if (name == "stop.surface" && prescription.system.stop)
    return set_stop_surface(prescription, value);
  bool found = false;
  visit_parameters(prescription, [&](const std::string& its, const std::string& alias, const char*,
                                     double& parameter) {
    if (its != name && alias != name) return;
    parameter = value;
    found = true;
  });
  if (!found) refuse_unknown(prescription, name);
}

/// The message of System::check; empty when the system is sound.
std::string why_unsound(const System& system) {
  try {
    system.check();
  } catch (const std::invalid_argument& unsound) {
    return unsound.what();
  }
  return {};
}

}  // namespace

void Prescription::check() const {
  system.check();
  check_names(surfaces, system, "surfaces");
  check_names(media, system, "media");
}

/// What a surface of revolution about the axis does not have is listed where it is not 0.
std::vector<Parameter> parameters(const Prescription& prescription) {
  std::vector<Parameter> list;
  const auto skew = [](const std::string& name) {
    const auto fields = surface_fields();
    return std::any_of(fields.begin(), fields.end(), [&](const SurfaceField& field) {
      return name.ends_with("." + std::string(field.name));
    });
  };
  visit_parameters(prescription, [&](const std::string& name, const std::string&, const char* unit,
                                     double value) {
    if (value != 0 || !skew(name)) list.push_back({name, unit, value});
  });
  if (prescription.system.stop)
    list.push_back({"stop.surface", "1", double(prescription.system.stop->surface)});
  return list;
}

/// By name, or by the surface's number.
double parameter(const Prescription& prescription, std::string_view name) {
  if (name == "stop.surface" && prescription.system.stop) return prescription.system.stop->surface;
  const double* found = nullptr;
  visit_parameters(prescription, [&](const std::string& its, const std::string& alias, const char*,
                                     const double& value) {
    if (its == name || alias == name) found = &value;
  });
  if (found == nullptr) refuse_unknown(prescription, name);
  return *found;
}

/// All overrides at once, since some are sound only together. When the result is unsound, each is
/// tried alone, so that the error names the parameter at fault.
/// A Prescription is returned whole or an error is thrown; nothing is half changed.
Prescription with_parameters(const Prescription& prescription,
                             std::span<const Override> overrides) {
  prescription.check();
  Prescription changed = prescription;
  for (const auto& [name, value] : overrides) set(changed, name, value);
  const std::string unsound = why_unsound(changed.system);
  if (unsound.empty()) return changed;
  for (const auto& [name, value] : overrides) {
    Prescription alone = prescription;
    set(alone, name, value);
    const std::string its_fault = why_unsound(alone.system);
    if (!its_fault.empty()) throw std::invalid_argument(name + ": " + its_fault);
  }
  throw std::invalid_argument("parameters: together they leave the system unsound: " + unsound);
}

}  // namespace vitreo::optics
