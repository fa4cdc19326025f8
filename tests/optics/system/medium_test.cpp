// Dispersion against the indices that its sources print.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/medium.h"

#include "optics/system/prescriptions.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

TEST(Medium, IndicesAreThosePrinted) {
  constexpr double kD = 589.3e-9;
  const struct {
    Dispersion dispersion;
    double wavelength;
    double index;
    double within;
  } rows[] = {{Dispersion::navarro_cornea, kD, 1.376, 1e-4},  // Navarro et al. 1985, table 1
              {Dispersion::navarro_aqueous, kD, 1.3374, 1e-4},
              {Dispersion::navarro_lens, kD, 1.42, 1e-4},
              {Dispersion::navarro_vitreous, kD, 1.336, 1e-4},
              {Dispersion::navarro_cornea, 543e-9, 1.3777, 1e-4},  // Escudero-Sanz & Navarro 1999
              {Dispersion::navarro_aqueous, 543e-9, 1.3391, 1e-4},
              {Dispersion::navarro_lens, 543e-9, 1.4222, 1e-4},
              {Dispersion::navarro_vitreous, 543e-9, 1.3377, 1e-4},
              {Dispersion::atchison_cornea, 555e-9, 1.376, 1e-5},  // Atchison & Smith 2005
              {Dispersion::atchison_aqueous, 555e-9, 1.336, 1e-5},
              {Dispersion::atchison_lens, 555e-9, 1.406, 1e-5},
              {Dispersion::atchison_vitreous, 555e-9, 1.336, 1e-5},
              {Dispersion::n_bk7, 587.56e-9, 1.51680, 1e-5},
              {Dispersion::water, kD, 1.33336, 3e-5}};
  for (const auto& row : rows)
    EXPECT_NEAR(model_index(row.dispersion, row.wavelength), row.index, row.within)
        << to_string(row.dispersion) << " at " << row.wavelength;
}

TEST(Medium, AnotherColorAndBackIsTheSameSystem) {
  const System eye = prescription("navarro").system;
  const System blue = at_wavelength(eye, 450e-9);
  EXPECT_GT(blue.surfaces[1].index, eye.surfaces[1].index);  // normal dispersion
  const System back = at_wavelength(blue, eye.wavelength);
  for (int i = 0; i < eye.size(); ++i)
    EXPECT_NEAR(back.surfaces[i].index, eye.surfaces[i].index, 1e-15);
  EXPECT_EQ(blue.surfaces.back().index, 1);  // air has none here
}

TEST(Medium, NamesAreKnownAndOtherRangesRefused) {
  for (const std::string& name : dispersion_names())
    EXPECT_EQ(to_string(dispersion_named(name)), name);
  expect_refused("dispersion", [] { (void)dispersion_named("navaro_lens"); });
  expect_refused("wavelength", [] { (void)model_index(Dispersion::navarro_lens, 1200e-9); });
  expect_refused("wavelength",
                 [] { (void)at_wavelength(prescription("liou_brennan").system, 900e-9); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
