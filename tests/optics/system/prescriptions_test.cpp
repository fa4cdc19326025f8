// The prescriptions by name, personal eyes, accommodation, and tables of rows.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/prescriptions.h"

#include "optics/system/first_order.h"
#include "optics/system/prescription_rows.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Prescription overridden(const char* eye, std::initializer_list<Override> overrides) {
  return with_parameters(prescription(eye), std::span(overrides.begin(), overrides.size()));
}

void expect_same(const System& a, const System& b) {
  ASSERT_EQ(a.size(), b.size());
  for (int i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a.surfaces[i].radius, b.surfaces[i].radius) << i;
    EXPECT_EQ(a.surfaces[i].conic, b.surfaces[i].conic) << i;
    EXPECT_EQ(a.surfaces[i].aspheric, b.surfaces[i].aspheric) << i;
    EXPECT_EQ(a.surfaces[i].thickness, b.surfaces[i].thickness) << i;
    EXPECT_EQ(a.surfaces[i].index, b.surfaces[i].index) << i;
    EXPECT_EQ(a.surfaces[i].semi_diameter, b.surfaces[i].semi_diameter) << i;
  }
  ASSERT_EQ(a.stop.has_value(), b.stop.has_value());
  if (!a.stop) return;
  EXPECT_EQ(a.stop->surface, b.stop->surface);
  EXPECT_EQ(a.stop->radius, b.stop->radius);
}

TEST(Prescriptions, AllAreSoundNamedAndSayWhereTheyAreFrom) {
  const auto names = prescription_names();
  EXPECT_GE(names.size(), 10u);
  for (const std::string& name : names) {
    const Prescription one = prescription(name);
    EXPECT_NO_THROW(one.check()) << name;
    EXPECT_EQ(one.name, name);
    EXPECT_FALSE(one.title.empty()) << name;
    EXPECT_FALSE(one.source.empty()) << name;
  }
}

TEST(Prescriptions, AreTheTablesOfTheThesis) {
  expect_same(prescription("navarro_condensing").system, navarro_with_condensing_lens(true));
  expect_same(prescription("navarro_condensing_conic").system, navarro_with_condensing_lens(false));
  expect_same(prescription("model_eye_5_3").system, model_eye_5_3());
  EXPECT_EQ(prescription("model_eye_5_3").system.name, model_eye_5_3().name);
  EXPECT_EQ(parameter(prescription("model_eye_5_3_printed"), "cornea.anterior.radius"), 9.48 * kMm);
  EXPECT_EQ(parameter(prescription("model_eye_5_3"), "cornea.anterior.radius"), -9.48 * kMm);
  EXPECT_EQ(parameter(prescription("porcine"), "aqueous.thickness"), 1.5 * kMm);
  EXPECT_EQ(parameter(prescription("porcine"), "lens.thickness"), 8 * kMm);
  EXPECT_EQ(parameter(prescription("navarro_vitrectomy"), "contact.index"), 1.425);
}

TEST(Prescriptions, AnUnknownNameIsRefusedWithTheNearestOnes) {
  try {
    prescription("navaro");
    FAIL();
  } catch (const std::invalid_argument& refusal) {
    EXPECT_NE(std::string(refusal.what()).find("did you mean navarro"), std::string::npos)
        << refusal.what();
  }
  try {
    overridden("navarro", {{"cornea.anterior.radious", 8 * kMm}});
    FAIL();
  } catch (const std::invalid_argument& refusal) {
    EXPECT_NE(std::string(refusal.what()).find("did you mean cornea.anterior.radius"),
              std::string::npos)
        << refusal.what();
  }
  expect_refused("prescription", [] { (void)prescription(std::string(100000, 'x')); });
}

TEST(Prescriptions, EveryParameterCanBeReadAndReplacedByEitherOfItsNames) {
  const Prescription eye = prescription("navarro_condensing");
  for (const Parameter& one : parameters(eye))
    EXPECT_EQ(parameter(eye, one.name), one.value) << one.name;
  const Prescription changed =
      overridden("navarro_condensing", {{"cornea.anterior.radius", -8 * kMm},
                                        {"surface_2.index", 1.41},
                                        {"condensing.posterior.a4", 1e4},
                                        {"vitreous.thickness", 17 * kMm},
                                        {"stop.radius", 2 * kMm},
                                        {"stop.surface", 4}});
  EXPECT_EQ(changed.system.surfaces[4].radius, -8 * kMm);
  EXPECT_EQ(parameter(changed, "lens.index"), 1.41);
  EXPECT_EQ(changed.system.surfaces[5].aspheric[0], 1e4);
  EXPECT_EQ(changed.system.stop->surface, 4);
  EXPECT_EQ(changed.system.surfaces[3].thickness, eye.system.surfaces[3].thickness);
}

TEST(Prescriptions, AValueThatMakesTheSystemUnsoundNamesItsParameter) {
  const auto refused = [](const char* name, double value) {
    expect_refused(name, [&] {
      (void)overridden("navarro_condensing", {{"lens.index", 1.43}, {name, value}});
    });
  };
  refused("cornea.anterior.radius", 0);
  refused("cornea.anterior.radius", kNan);
  refused("vitreous.index", 0.9);
  refused("aqueous.thickness", -1e-3);
  refused("stop.radius", -1);
  refused("stop.surface", 9);
  refused("stop.surface", 2.5);
  refused("gap.thickness", std::numeric_limits<double>::infinity());
}

TEST(Prescriptions, SurfacesThatCrossWithinTheirRimsAreRefused) {
  System eye = navarro_with_condensing_lens(false);
  eye.surfaces[5].semi_diameter = eye.surfaces[6].semi_diameter = 8 * kMm;
  EXPECT_NO_THROW(eye.check());  // 13 mm thick; the rims come within 4 mm of each other
  eye.surfaces[5].thickness = 2 * kMm;
  expect_refused("surface 6: thickness", [&] { eye.check(); });
}

TEST(Prescriptions, TheAccommodatedEyeIsFocusedNearTheDistanceItIsMeantFor) {
  for (double dioptres : {1.0, 2.0, 4.0, 8.0, 10.0}) {
    const auto image = axial_image(accommodate(prescription("navarro"), dioptres).system, 0);
    ASSERT_TRUE(image);
    EXPECT_GT(image->distance, 0);
    // Navarro's polynomials are fits to measured lenses; at 10 D they give 9.6 D.
    EXPECT_NEAR(1 / image->distance, dioptres, 0.07 + 0.06 * dioptres) << dioptres;
  }
  expect_same(accommodate(prescription("navarro_condensing"), 0).system,
              prescription("navarro_condensing").system);
}

TEST(Prescriptions, TheAccommodatedLensHasTheNumbersOfNavarrosFormulas) {
  const Prescription eye = accommodate(prescription("navarro"), 4);
  const double l = std::log(5.0);
  EXPECT_NEAR(parameter(eye, "lens.anterior.radius"), -(10.2 - 1.75 * l) * kMm, 1e-15);
  EXPECT_NEAR(parameter(eye, "lens.posterior.radius"), (6 - 0.2294 * l) * kMm, 1e-15);
  EXPECT_NEAR(parameter(eye, "lens.index"), 1.42504, 1e-15);
  EXPECT_NEAR(parameter(eye, "lens.thickness"), (4 + 0.1 * l) * kMm, 1e-15);
  expect_refused("accommodation", [] { (void)accommodate(prescription("navarro"), -1); });
  expect_refused("accommodation", [] { (void)accommodate(prescription("navarro"), kNan); });
  expect_refused("parameter", [] { (void)accommodate(prescription("model_eye_in_air"), 2); });
}

TEST(Prescriptions, TheModelEyeInAirMagnifiesAsChapter4Says) {
  const auto image = axial_image(prescription("model_eye_in_air").system, 0);
  ASSERT_TRUE(image);
  EXPECT_NEAR(image->magnification, -0.78, 1e-4);  // four decimals of mm in the table
}

TEST(PrescriptionRows, KeepEveryBitOfEveryPrescription) {
  for (const std::string& name : prescription_names()) {
    const Prescription before = prescription(name), after = from_rows(to_rows(before));
    expect_same(before.system, after.system);
    EXPECT_EQ(before.surfaces, after.surfaces);
    EXPECT_EQ(before.media, after.media);
    EXPECT_EQ(before.title, after.title);
  }
}

TEST(PrescriptionRows, ThatAreWrongNameTheSurfaceOrTheField) {
  const PrescriptionTable good = to_rows(prescription("navarro"));
  const auto refused = [&](const char* name, auto spoil) {
    PrescriptionTable table = good;
    spoil(table);
    expect_refused(name, [&] { (void)from_rows(table); });
  };
  refused("surface 2: radius", [](auto& table) { table.rows[1].radius = 0; });
  refused("surface 3: index", [](auto& table) { table.rows[2].index = kNan; });
  refused("surfaces", [](auto& table) { table.rows[2].surface = table.rows[1].surface; });
  refused("media", [](auto& table) { table.rows[2].medium = table.rows[1].medium; });
  refused("stop", [](auto& table) { table.stop_surface = 17; });
  refused("surfaces", [](auto& table) { table.rows.clear(); });
  refused("rows", [](auto& table) { table.rows.resize(5000); });
}

TEST(PrescriptionRows, WithoutNamesAreNumbered) {
  PrescriptionTable table = to_rows(prescription("navarro"));
  for (PrescriptionRow& row : table.rows) row.surface = row.medium = "";
  const Prescription eye = from_rows(table);
  EXPECT_EQ(parameter(eye, "surface_5.radius"), -7.72 * kMm);
  EXPECT_EQ(parameter(eye, "medium_2.index"), 1.42);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
