// The multipole field's refusals and the sides of its region, compared with the header's words.
// SPDX-License-Identifier: Apache-2.0
#include "control/multipole_field.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;
using Sources = MultipoleField::Sources;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
const std::vector<double> kBad{kNan, kInfinity, -kInfinity};

/// What a field is made of: coils of one, two and one sources, and a background.
struct Parts {
  std::vector<Sources> coils;
  Sources background;
  Region region{{-0.011, -0.012, -0.013}, {0.021, 0.022, 0.023}};
  MultipoleField field() const { return {coils, background, region}; }
};

MultipoleSource source(double x) {
  return {{x, 0.02, -0.1}, {0.48, -0.6, 0.64}, {1e-3, -2e-3}, {3e-6, 1e-7, -2e-8}};
}

Parts parts() {
  return {{{source(0.01)}, {source(0.02), source(-0.03)}, {source(0.04)}}, {source(-0.05)}};
}

/// The message of std::invalid_argument after a change of the good parts, "none" without one.
std::string refusal(const std::function<void(Parts&)>& change) {
  Parts changed = parts();
  change(changed);
  try {
    static_cast<void>(changed.field());
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "none";
}

/// The same change of a source in each place, the first, the last of a coil and of all included.
void expect_refused(const std::function<void(MultipoleSource&)>& change, const std::string& what) {
  EXPECT_EQ(refusal([&](Parts& p) { change(p.coils[0][0]); }), "coil 1: " + what);
  EXPECT_EQ(refusal([&](Parts& p) { change(p.coils[1][0]); }), "coil 2: " + what);
  EXPECT_EQ(refusal([&](Parts& p) { change(p.coils[1][1]); }), "coil 2: " + what);
  EXPECT_EQ(refusal([&](Parts& p) { change(p.coils[2][0]); }), "coil 3: " + what);
  EXPECT_EQ(refusal([&](Parts& p) { change(p.background[0]); }), "background: " + what);
}

void expect_taken(const std::function<void(MultipoleSource&)>& change) {
  EXPECT_EQ(refusal([&](Parts& p) { change(p.coils[0][0]); }), "none");
  EXPECT_EQ(refusal([&](Parts& p) { change(p.coils[1][1]); }), "none");
  EXPECT_EQ(refusal([&](Parts& p) { change(p.background[0]); }), "none");
}

TEST(MultipoleFieldArguments, takes_one_to_eight_coils) {
  EXPECT_EQ(refusal([](Parts& p) { p.coils.clear(); }), "coils: 0 given, 1 to 8 allowed");
  EXPECT_EQ(refusal([](Parts& p) { p.coils.resize(1); }), "none");
  EXPECT_EQ(refusal([](Parts& p) { p.coils.resize(8); }), "none");
  EXPECT_EQ(refusal([](Parts& p) { p.coils.resize(9); }), "coils: 9 given, 1 to 8 allowed");
  EXPECT_EQ(refusal([](Parts& p) { p.background.clear(); }), "none");
}

TEST(MultipoleFieldArguments, takes_orders_up_to_twelve) {
  const std::string what = "source has coefficients beyond order 12";
  expect_taken([](MultipoleSource& s) { s.regular.resize(12); });
  expect_taken([](MultipoleSource& s) { s.irregular.resize(12); });
  expect_refused([](MultipoleSource& s) { s.regular.resize(13); }, what);
  expect_refused([](MultipoleSource& s) { s.irregular.resize(13); }, what);
}

TEST(MultipoleFieldArguments, takes_axes_that_are_unit_to_a_thousandth) {
  const std::string what = "source direction is not a unit vector";
  for (const double length : {0.9991, 1.0009})
    expect_taken([&](MultipoleSource& s) { s.axis *= length; });
  for (const double length : {0., 0.9989, 1.0011, 2.})
    expect_refused([&](MultipoleSource& s) { s.axis *= length; }, what);
  for (const double bad : kBad)
    for (int i = 0; i < 3; ++i) expect_refused([&](MultipoleSource& s) { s.axis[i] = bad; }, what);
}

TEST(MultipoleFieldArguments, refuses_numbers_that_are_not_finite) {
  for (const double bad : kBad) {
    for (int i = 0; i < 3; ++i)
      expect_refused([&](MultipoleSource& s) { s.position[i] = bad; },
                     "source position is not finite");
    for (const int n : {0, 1})
      expect_refused([&](MultipoleSource& s) { s.regular[n] = bad; },
                     "source coefficient is not finite");
    for (const int n : {0, 2})
      expect_refused([&](MultipoleSource& s) { s.irregular[n] = bad; },
                     "source coefficient is not finite");
  }
}

TEST(MultipoleFieldArguments, refuses_an_empty_region) {
  const std::string what = "region: low must be below high on every axis";
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(refusal([&](Parts& p) { p.region.low[i] = p.region.high[i]; }), what);
    EXPECT_EQ(refusal([&](Parts& p) { std::swap(p.region.low[i], p.region.high[i]); }), what);
    EXPECT_EQ(refusal([&](Parts& p) { p.region.low[i] = p.region.high[i] - 1e-6; }), "none");
    for (const double bad : kBad) {
      EXPECT_EQ(refusal([&](Parts& p) { p.region.low[i] = bad; }), what);
      EXPECT_EQ(refusal([&](Parts& p) { p.region.high[i] = bad; }), what);
    }
  }
  EXPECT_EQ(refusal([](Parts& p) { p.region = {}; }), what);
}

/// Of std::domain_error.
std::string outside(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::domain_error& error) {
    return error.what();
  }
  return "none";
}

TEST(MultipoleFieldArguments, holds_from_the_regions_low_to_its_high_side) {
  const MultipoleField field = parts().field();
  const Region& region = field.region();
  const Vector3d inside{1e-3, 2e-3, 3e-3};
  ASSERT_TRUE(region.contains(inside));
  for (int i = 0; i < 3; ++i) {
    for (const bool high : {false, true}) {
      SCOPED_TRACE(testing::Message() << "axis " << i << (high ? " high" : " low"));
      Vector3d place = inside;
      place[i] = high ? region.high[i] : region.low[i];
      EXPECT_TRUE(region.contains(place));
      EXPECT_NO_THROW(field.matrix(place));
      EXPECT_NO_THROW(field.background(place));
      place[i] += high ? 1e-9 : -1e-9;
      EXPECT_FALSE(region.contains(place));
      EXPECT_THROW(field.matrix(place), std::domain_error);
      EXPECT_THROW(field.background(place), std::domain_error);
      place[i] = high ? 3 : -3;
      EXPECT_FALSE(region.contains(place));
      EXPECT_THROW(field.matrix(place), std::domain_error);
      EXPECT_THROW(field.background(place), std::domain_error);
      place[i] = high ? kInfinity : -kInfinity;
      EXPECT_FALSE(region.contains(place));
    }
    Vector3d nowhere = inside;
    nowhere[i] = kNan;
    EXPECT_FALSE(region.contains(nowhere));
  }
}

TEST(MultipoleFieldArguments, names_position_and_region_outside) {
  const MultipoleField field = parts().field();
  const Vector3d place{0.005, -0.0125, 0.007};
  const std::string what =
      "position_in_world: (    5 -12.5     7) mm is outside the field model, which holds from "
      "(-11 -12 -13) to (21 22 23) mm";
  EXPECT_EQ(outside([&] { static_cast<void>(field.matrix(place)); }), what);
  EXPECT_EQ(outside([&] { static_cast<void>(field.background(place)); }), what);
}

/// Of std::invalid_argument.
std::string refused(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "none";
}

TEST(MultipoleFieldArguments, refuses_a_position_that_is_not_finite) {
  const MultipoleField field = parts().field();
  for (const double bad : kBad) {
    for (int i = 0; i < 3; ++i) {
      Vector3d place{1e-3, 2e-3, 3e-3};
      place[i] = bad;
      EXPECT_EQ(refused([&] { static_cast<void>(field.matrix(place)); }),
                "position_in_world: not finite");
      EXPECT_EQ(refused([&] { static_cast<void>(field.background(place)); }),
                "position_in_world: not finite");
    }
  }
}

TEST(MultipoleFieldArguments, refuses_the_position_of_a_source) {
  const std::string what = "position_in_world: at a source of the field model";
  const Vector3d own{1e-3, 2e-3, 3e-3};
  for (const auto& [coil, which] : std::vector<std::pair<int, int>>{{0, 0}, {1, 1}, {2, 0}}) {
    Parts here = parts();
    here.coils[coil][which].position = own;
    const MultipoleField field = here.field();
    EXPECT_EQ(refused([&] { static_cast<void>(field.matrix(own)); }), what) << coil;
    EXPECT_TRUE(field.matrix(own + Vector3d(0, 1e-6, 0)).allFinite());
  }
  Parts here = parts();
  here.background[0].position = own;
  const MultipoleField field = here.field();
  EXPECT_EQ(refused([&] { static_cast<void>(field.background(own)); }), what);
  EXPECT_TRUE(field.background(own + Vector3d(0, 0, -1e-6)).allFinite());
}

// A source with regular terms only has a field there, A_1 along its axis.
TEST(MultipoleFieldArguments, takes_the_position_of_a_regular_source) {
  const Vector3d own{1e-3, 2e-3, 3e-3};
  Parts here = parts();
  here.coils[0][0].position = own;
  here.coils[0][0].irregular.clear();
  EXPECT_TRUE(here.field().matrix(own).allFinite());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
