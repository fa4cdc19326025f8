// SPDX-License-Identifier: Apache-2.0
#include "optics/system/prescriptions.h"

#include "optics/numerics/preconditions.h"
#include "optics/system/names.h"

#include <array>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <stdexcept>

namespace vitreo::optics {
namespace {

constexpr double kPlane = std::numeric_limits<double>::infinity();

/// A row as the tables print it: lengths in mm, a4 to a10 in mm^-3 to mm^-9.
struct Row {
  const char* surface;
  const char* medium;  // behind it
  double radius_mm;
  double conic;
  double thickness_mm;
  double index;
  std::array<double, 4> aspheric_mm{};
};

/// SI from the tables' millimeters: a_2k scales as mm^(1 - 2k).
Surface surface_from(const Row& row) {
  constexpr double kMm = 1e-3;
  constexpr std::array<double, 4> kPerMm{1e9, 1e15, 1e21, 1e27};
  Surface surface;
  surface.radius = row.radius_mm * kMm;
  surface.conic = row.conic;
  for (std::size_t i = 0; i < kPerMm.size(); ++i)
    surface.aspheric[i] = row.aspheric_mm[i] * kPerMm[i];
  surface.thickness = row.thickness_mm * kMm;
  surface.index = row.index;
  return surface;
}

/// The stop is counted as in the tables, from 1, the retina.
struct About {
  const char* name;
  const char* title;
  const char* source;
  int stop_surface;
  double stop_radius_mm;
};

using Rows = std::vector<Row>;

/// The tables have no rims: semi-diameters stay infinite, and only the stop clips.
Prescription make(const About& about, const Rows& rows) {
  Prescription made{about.name, about.title, about.source, {}, {}, {}};
  made.system.name = about.title;
  for (const Row& row : rows) {
    made.surfaces.emplace_back(row.surface);
    made.media.emplace_back(row.medium);
    made.system.surfaces.push_back(surface_from(row));
  }
  made.system.stop = Stop{about.stop_surface, about.stop_radius_mm * 1e-3};
  return made;
}

/// Gives the eye's media, and what else has their names, the dispersion of an author's model.
Prescription dispersed(Prescription made, Dispersion cornea, Dispersion aqueous, Dispersion lens,
                       Dispersion vitreous) {
  for (std::size_t i = 0; i < made.media.size(); ++i) {
    const std::string& medium = made.media[i];
    Dispersion& dispersion = made.system.surfaces[i].dispersion;
    if (medium == "cornea") dispersion = cornea;
    if (medium == "aqueous") dispersion = aqueous;
    if (medium.starts_with("lens")) dispersion = lens;
    if (medium == "vitreous") dispersion = vitreous;
  }
  return made;
}

/// Navarro, Santamaria & Bescos (1985) give dispersions with the indices of table 3.1.
Prescription as_navarro(Prescription made) {
  return dispersed(std::move(made), Dispersion::navarro_cornea, Dispersion::navarro_aqueous,
                   Dispersion::navarro_lens, Dispersion::navarro_vitreous);
}

/// In the order of light: the eye first, then what is put before it.
Rows operator+(Rows eye, const Rows& more) {
  eye.insert(eye.end(), more.begin(), more.end());
  return eye;
}

/// Table 3.1; what stands behind the cornea, and how far the next surface is, differs from system
/// to system.
Rows navarro(const char* behind, double gap_mm, double index_behind) {
  return {{"retina", "vitreous", 12.00, 0.00, 16.32, 1.336},
          {"lens.posterior", "lens", 6.00, -1.00, 4.00, 1.420},
          {"lens.anterior", "aqueous", -10.20, -3.13, 3.05, 1.337},
          {"cornea.posterior", "cornea", -6.50, 0.00, 0.55, 1.376},
          {"cornea.anterior", behind, -7.72, -0.26, gap_mm, index_behind}};
}

/// Navarro's eye with the porcine lens and anterior chamber of thesis 7.2. The vitreous is 1.76 mm
/// shorter, which puts the retina in focus.
Rows porcine(const char* behind, double gap_mm) {
  Rows rows = navarro(behind, gap_mm, 1.0);
  rows[0].thickness_mm = 14.56;
  rows[1].thickness_mm = 8.00;
  rows[2].thickness_mm = 1.50;
  return rows;
}

/// Tables 3.3 and 5.3: the surface with R = 11.65 faces the eye.
Rows condensing_lens(double index) {
  return {{"condensing.posterior", "condensing", 11.65, -9.24, 13.00, index},
          {"condensing.anterior", "air", -9.48, -1.07, 0.00, 1.000}};
}

/// Table 3.4.
Rows aspheric_condensing_lens() {
  Rows rows = condensing_lens(1.523);
  // as printed: along +z, as the radius' sign
  rows[0].aspheric_mm = {4.078e-5, -1.542e-7, -2.647e-9, 2.023e-11};
  return rows;
}

/// Table 5.3; the sign of R5 is the argument.
Rows two_lens_eye(double cornea_anterior_mm) {
  return Rows{{"retina", "vitreous", 11.50, 0.00, 15.50, 1.403},
              {"lens.posterior", "lens", 24.73, 0.00, 4.00, 1.492},
              {"lens.anterior", "aqueous", -12.27, 3.80, 2.97, 1.403},
              {"cornea.posterior", "cornea", 32.36, 0.00, 1.68, 1.415},
              {"cornea.anterior", "gap", cornea_anterior_mm, -1.20, 3.84, 1.000}} +
         condensing_lens(1.531);
}

/// One plano-convex lens in air, its flat side to the retina, the retina in its focus.
/// It stands in for the undisclosed eye of chapter 4, so that its experiments can be repeated with
/// some eye of that kind.
Rows one_lens_eye(double retina_mm, double radius_mm) {
  return Rows{{"retina", "vitreous", 12.00, -0.175, retina_mm, 1.000},
              {"lens.posterior", "lens", kPlane, 0.00, 3.00, 1.492},
              {"lens.anterior", "gap", radius_mm, 0.00, 3.59, 1.000}} +
         condensing_lens(1.531);
}

constexpr const char* kIris =
    "Pupil: 3 mm in the vertex plane of the lens' anterior surface (docs/optics.md).";

/// Tables 3.1 to 3.4.
std::vector<Prescription> all_of_navarro() {
  return {
      as_navarro(make({"navarro", "Navarro's eye, relaxed (table 3.1)", kIris, 3, 1.5},
                      navarro("air", 0, 1.0))),
      as_navarro(make({"navarro_vitrectomy",
                       "Navarro's eye with vitrectomy lens S5.7010 (table 3.2)", kIris, 3, 1.5},
                      navarro("contact", 2.00, 1.425) +
                          Rows{{"contact.anterior", "air", kPlane, 0.00, 0.00, 1.000}})),
      as_navarro(make({"navarro_condensing_conic",
                       "Navarro's eye with the conic condensing lens (table 3.3)", kIris, 3, 1.5},
                      navarro("gap", 2.31, 1.0) + condensing_lens(1.523))),
      as_navarro(
          make({"navarro_condensing", "Navarro's eye with the aspheric condensing lens (table 3.4)",
                kIris, 3, 1.5},
               navarro("gap", 2.31, 1.0) + aspheric_condensing_lens())),
  };
}

/// The gradients of Liou & Brennan (1997), table 1, whose z counts into the eye: from the lens'
/// anterior vertex 1.368 + 0.049057 z - 0.015427 z^2 - 0.001978 r^2, 1.59 mm deep; from the equator
/// 1.407 - 0.006605 z^2 - 0.001978 r^2, 2.43 mm deep; mm. Here z counts from the other end.
void add_liou_brennan_gradients(System& system) {
  constexpr double kPerMm = 1e3;
  constexpr double kAcross = -0.001978 * kPerMm * kPerMm;
  Surface& back = system.surfaces[1];
  back.index = 1.407 - 0.006605 * 2.43 * 2.43;
  back.gradient.along = {2 * 0.006605 * 2.43 * kPerMm, -0.006605 * kPerMm * kPerMm, 0, 0};
  back.gradient.across[0] = kAcross;
  Surface& front = system.surfaces[2];
  front.index = 1.368 + 0.049057 * 1.59 - 0.015427 * 1.59 * 1.59;
  front.gradient.along = {(2 * 0.015427 * 1.59 - 0.049057) * kPerMm, -0.015427 * kPerMm * kPerMm, 0,
                          0};
  front.gradient.across[0] = kAcross;
}

Prescription liou_brennan(const About& about, double gap_mm, const Rows& before_the_eye) {
  Prescription made =
      make(about, Rows{{"retina", "vitreous", 12.00, 0.00, 16.27, 1.336},
                       {"lens.posterior", "lens_back", 8.10, 0.96, 2.43, 1.368},
                       {"lens.equator", "lens_front", kPlane, 0.00, 1.59, 1.407},
                       {"lens.anterior", "aqueous", -12.40, -0.94, 3.16, 1.336},
                       {"cornea.posterior", "cornea", -6.40, -0.60, 0.50, 1.376},
                       {"cornea.anterior", gap_mm > 0 ? "gap" : "air", -7.77, -0.18, gap_mm, 1.0}} +
                      before_the_eye);
  add_liou_brennan_gradients(made.system);
  made.system.wavelength = 555e-9;
  constexpr Dispersion kAll = Dispersion::liou_brennan;
  return dispersed(std::move(made), kAll, kAll, kAll, kAll);
}

/// Eyes with a gradient lens.
std::vector<Prescription> all_of_gradients() {
  constexpr const char* kSource =
      "Liou & Brennan (1997), table 1, at 555 nm; retina's radius 12 mm assumed; the stop is "
      "centered "
      "(theirs lies 0.5 mm nasally). Pupil: 3 mm in the vertex plane of the lens' anterior "
      "surface.";
  return {
      liou_brennan({"liou_brennan", "eye of Liou and Brennan, gradient lens", kSource, 4, 1.5}, 0,
                   {}),
      liou_brennan({"liou_brennan_condensing",
                    "eye of Liou and Brennan with the aspheric condensing lens", kSource, 4, 1.5},
                   2.31, aspheric_condensing_lens())};
}

/// Table 5.3, the porcine eye of 7.2 and two stand-ins for the model eye of chapter 4.
std::vector<Prescription> all_of_other_eyes() {
  constexpr const char* kPig =
      "Thesis 7.2 gives the anterior chamber (1.5 mm) and the lens (8 mm). Assumed: all else as "
      "Navarro's eye, the "
      "vitreous 14.56 mm long, which puts the retina in focus (16.32 - 1.76). Pupil as there.";
  constexpr const char* kGwb =
      "Stands in for the undisclosed eye of chapter 4: plano-convex acrylic lens, retina in its "
      "focus, 3.59 mm to the "
      "condensing lens, conic constant of the retina -0.175 (4.4). Assumed: index 1.492, 3 mm "
      "thick, retina's radius "
      "12 "
      "mm. ";
  static const std::string magnified = std::string(kGwb) +
                                       "Focal length for a magnification of 0.78, pupil for 83 um "
                                       "by (4.1).";
  static const std::string long_eye =
      std::string(kGwb) + "Focal length for the retinal depth of 33.1 mm of 4.4.4.";
  return {
      make({"model_eye_5_3", "model eye of table 5.3, R5 = -9.48 mm",
            "R5 is printed as +9.48; docs/optics.md. Pupil: 3 mm at surface 3.", 3, 1.5},
           two_lens_eye(-9.48)),
      make({"model_eye_5_3_printed", "model eye of table 5.3 as printed, R5 = +9.48 mm",
            "The misprint: this eye is a lens of -30 D. Pupil: 3 mm at surface 3.", 3, 1.5},
           two_lens_eye(9.48)),
      as_navarro(make({"porcine", "porcine eye (thesis 7.2)", kPig, 3, 1.5}, porcine("air", 0))),
      as_navarro(make(
          {"porcine_condensing", "porcine eye with the aspheric condensing lens", kPig, 3, 1.5},
          porcine("gap", 2.31) + aspheric_condensing_lens())),
      make({"model_eye_in_air", "one-lens model eye in air (chapter 4), magnification 0.78",
            magnified.c_str(), 2, 2.356},
           one_lens_eye(14.0321, -7.8931)),
      make({"model_eye_in_air_33mm", "one-lens model eye in air (chapter 4), retina at 33.1 mm",
            long_eye.c_str(), 2, 2.356},
           one_lens_eye(33.1, -17.2745)),
  };
}

/// Built anew at each call, so that there is no global state.
std::vector<Prescription> all() {
  std::vector<Prescription> list = all_of_navarro();
  for (const auto& others : {all_of_other_eyes(), all_of_gradients()})
    list.insert(list.end(), others.begin(), others.end());
  return list;
}

}  // namespace

System model_eye_5_3() { return prescription("model_eye_5_3").system; }

std::vector<std::string> prescription_names() {
  std::vector<std::string> names;
  for (const Prescription& one : all()) names.push_back(one.name);
  return names;
}

Prescription prescription(std::string_view name) {
  for (Prescription& one : all()) {
    if (one.name == name) return std::move(one);
  }
  throw std::invalid_argument("prescription: there is no \"" + std::string(name) + "\"" +
                              detail::suggestions(name, prescription_names()));
}

/// Of Navarro's lens; the vitreous keeps its length, so that the retina's image comes to 1 / A
/// before the eye. Throws std::invalid_argument naming a parameter that the eye does not have.
Prescription accommodate(Prescription relaxed, double accommodation) {
  detail::require(accommodation >= 0 && accommodation <= 10,
                  "accommodation: must lie within 0 and 10 dioptres");
  constexpr double kMm = 1e-3;
  // Navarro, Santamaria & Bescos (1985), table 4: L = ln(A + 1).
  const double l = std::log(accommodation + 1);
  const auto changed = [&](const char* name, double by) {
    return Override{name, parameter(relaxed, name) + by};
  };
  // Radii here have the signs of light that leaves the eye: +6 behind, -10.2 in front.
  const std::initializer_list<Override> changes = {
      changed("lens.anterior.radius", 1.75 * kMm * l),
      changed("lens.posterior.radius", -0.2294 * kMm * l),
      changed("lens.anterior.conic", -0.34 * l),
      changed("lens.posterior.conic", -0.125 * l),
      changed("lens.thickness", 0.1 * kMm * l),
      changed("aqueous.thickness", -0.05 * kMm * l),
      changed("lens.index", 9e-5 * (10 * accommodation + accommodation * accommodation)),
  };
  return with_parameters(std::move(relaxed), std::span(changes.begin(), changes.size()));
}

}  // namespace vitreo::optics
