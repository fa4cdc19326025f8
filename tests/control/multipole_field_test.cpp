// The multipole model against dipoles, its own potential, differences of its field, and the traps
// real files hold.
// SPDX-License-Identifier: Apache-2.0
#include "control/multipole_field.h"

#include "control/field_model.h"
#include "tests/control/field_support.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const Region kCube{Eigen::Vector3d::Constant(-10e-3), Eigen::Vector3d::Constant(10e-3)};
const Region kWide{Eigen::Vector3d::Constant(-1), Eigen::Vector3d::Constant(1)};

// The same coils as multipoles of the first order.
MultipoleField as_multipoles(const CoilField& dipoles) {
  std::vector<MultipoleField::Sources> coils;
  for (const Dipole& dipole : dipoles.dipoles()) {
    const double size = dipole.moment_per_ampere.norm();
    coils.push_back({{dipole.position, dipole.moment_per_ampere / size, {}, {-1e-7 * size}}});
  }
  return MultipoleField(coils, {}, kCube);
}

// Psi once more, with the library's Legendre polynomials.
double potential(const MultipoleSource& source, const Eigen::Vector3d& p) {
  const Eigen::Vector3d offset = p - source.position;
  const double r = offset.norm(), c = source.axis.dot(offset) / r;
  double sum = 0;
  for (std::size_t k = 0; k < source.regular.size(); ++k) {
    sum += source.regular[k] * std::pow(r, k + 1) * std::legendre(static_cast<unsigned>(k + 1), c);
  }
  for (std::size_t k = 0; k < source.irregular.size(); ++k) {
    sum +=
        source.irregular[k] / std::pow(r, k + 2) * std::legendre(static_cast<unsigned>(k + 1), c);
  }
  return sum;
}

FieldGradient column(const MultipoleField& field, const Eigen::Vector3d& p) {
  return field.matrix(p).col(0);
}

// Field against potential, gradient against field, and neither sources nor curl, at `p` with the
// step h.
void expect_consistent(const MultipoleField& field, const Eigen::Vector3d& p, double h,
                       double tolerance) {
  const auto b = [&](const Eigen::Vector3d& at) {
    return Eigen::Vector3d(column(field, at).head<3>());
  };
  const auto psi = [&](const Eigen::Vector3d& at) {
    double sum = 0;
    for (const MultipoleSource& source : field.sources()[0]) sum += potential(source, at);
    return Eigen::Vector3d(sum, 0, 0);
  };
  const FieldGradient here = column(field, p);
  const Eigen::Vector3d from_potential = differenced_gradient(psi, p, h).row(0);
  EXPECT_LT((here.head<3>() - from_potential).norm(), tolerance * from_potential.norm());
  const Eigen::Matrix3d g = differenced_gradient(b, p, h);
  EXPECT_LT((gradient_matrix(here) - g).norm(), tolerance * g.norm());
  EXPECT_LT(std::abs(g.trace()), 1e-9 * g.norm());         // div B: the figure
  EXPECT_LT((g - g.transpose()).norm(), 1e-9 * g.norm());  // curl B
}

TEST(MultipoleField, of_the_first_order_is_the_dipole_with_moment_minus_b) {
  const CoilField dipoles = CoilField::octomag();
  const MultipoleField field = as_multipoles(dipoles);
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector3d p = place_within(random, 10e-3);
    const FieldMatrix a = dipoles.matrix(p), b = field.matrix(p);
    for (int k = 0; k < 8; ++k) {  // the same sums in another order: rounding
      EXPECT_LT((a.col(k).head<3>() - b.col(k).head<3>()).norm(),
                1e-13 * a.col(k).head<3>().norm());
      EXPECT_LT((a.col(k).tail<5>() - b.col(k).tail<5>()).norm(),
                1e-13 * a.col(k).tail<5>().norm());
    }
  }
}

TEST(MultipoleField, is_the_gradient_of_its_potential_and_knows_its_own_gradient_for_every_order) {
  std::mt19937_64 random(2);
  for (std::size_t order = 1; order <= kMaxMultipoleOrder; ++order) {
    for (const bool regular : {false, true}) {
      MultipoleSource source{0.1 * any_direction(random), any_direction(random), {}, {}};
      (regular ? source.regular : source.irregular).assign(order, 0);
      (regular ? source.regular : source.irregular).back() = 1;
      const MultipoleField field({{source}}, {}, kWide);
      // The first regular harmonic is a uniform field: its differences are nothing but rounding.
      if (regular && order == 1) continue;
      // Truncation (n + 10)!/n! (h/r)^8/630 and rounding r/(h n): below 1e-10 at every order here.
      expect_consistent(field, place_within(random, 10e-3), 0.3e-3, 2e-10);
    }
  }
}

TEST(MultipoleField, adds_its_orders) {
  std::mt19937_64 random(3);
  const MultipoleSource source{
      {0.03, -0.08, 0.05}, any_direction(random), {2e-3, -0.01, 0.3}, {-9e-7, 3e-8, -4e-10}};
  for (int trial = 0; trial < 20; ++trial) {
    expect_consistent(MultipoleField({{source}}, {}, kWide), place_within(random, 10e-3), 0.3e-3,
                      2e-10);  // as above
  }
}

TEST(MultipoleField, of_regular_harmonics_is_smooth_at_its_own_center) {
  const MultipoleSource source{{1e-3, 0, 0}, {0, 0, 1}, {1e-3, 0.02, 0.5}, {}};
  const MultipoleField field({{source}}, {}, kCube);
  const FieldGradient at = column(field, {1e-3, 0, 0});
  EXPECT_NEAR(at[2], 1e-3, 1e-18);   // A_1 z
  EXPECT_NEAR(at[3], -0.02, 1e-16);  // A_2 (3 zz - 1)
  EXPECT_NEAR(at[6], -0.02, 1e-16);
  const FieldGradient near = column(field, {1e-3 + 1e-9, 0, 0});
  EXPECT_LT((at - near).norm(), 1e-8);  // a nanometer away: A_3 times it, 3e-9
}

TEST(MultipoleField, copes_with_the_traps_of_real_files) {
  // As found in calibrations of the machine: a faint source inside the workspace, a pair that
  // nearly cancels just outside it, a source hundreds of kilometers away.
  const Eigen::Vector3d far(1.12e5, 2.1e5, -0.53e5);
  MultipoleField::Sources sources{
      {{-11e-3, 11e-3, -11e-3}, Eigen::Vector3d(0.9, -0.1, 0.3).normalized(), {}, {1e-11}},
      {{0.0195, 0.0196, -0.0817}, Eigen::Vector3d(-0.9, 0.3, -0.3).normalized(), {}, {-4.6e-5}},
      {{0.0194, 0.0197, -0.0816}, Eigen::Vector3d(-0.9, 0.3, -0.3).normalized(), {}, {4.5e-5}},
      {far, Eigen::Vector3d(-0.75, 0.5, 0.43).normalized(), {}, {3.6e12}}};
  const MultipoleField field({sources}, {}, kCube);
  std::mt19937_64 random(4);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector3d p = place_within(random, 8e-3);
    // The potential of the far source is 50 T m, of which differences over 0.1 mm keep four digits:
    // field only.
    const auto b = [&](const Eigen::Vector3d& at) {
      return Eigen::Vector3d(column(field, at).head<3>());
    };
    const Eigen::Matrix3d g = differenced_gradient(b, p, 0.1e-3);
    EXPECT_LT((gradient_matrix(column(field, p)) - g).norm(), 1e-9 * g.norm());
    EXPECT_LT(std::abs(g.trace()), 1e-9 * g.norm());
    EXPECT_LT((g - g.transpose()).norm(), 1e-9 * g.norm());
  }
}

TEST(MultipoleField, refuses_places_outside_its_region_and_says_where_it_holds) {
  const MultipoleField field = as_multipoles(CoilField::octomag());
  EXPECT_NO_THROW(field.matrix({10e-3, -10e-3, 10e-3}));
  try {
    field.matrix({0, 12e-3, 0});
    FAIL();
  } catch (const std::domain_error& error) {
    EXPECT_NE(std::string(error.what()).find("12"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("-10"), std::string::npos);
  }
  EXPECT_THROW(field.background({0, 12e-3, 0}), std::domain_error);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(field.matrix({nan, 0, 0}), std::invalid_argument);
}

TEST(MultipoleField, refuses_what_is_no_field) {
  const MultipoleSource good{{0, 0, 0.1}, {0, 0, 1}, {}, {1e-7}};
  const auto refuse = [&](MultipoleSource source, const Region& region = kCube) {
    EXPECT_THROW(MultipoleField({{source}}, {}, region), std::invalid_argument);
  };
  EXPECT_THROW(MultipoleField({}, {}, kCube), std::invalid_argument);
  EXPECT_THROW(MultipoleField(std::vector<MultipoleField::Sources>(9, {good}), {}, kCube),
               std::invalid_argument);
  refuse({{0, 0, 0.1}, {0, 0, 2}, {}, {1e-7}});
  refuse({{0, 0, 0.1}, {0, 0, 0}, {}, {1e-7}});
  refuse({{0, 0, 0.1}, {0, 0, 1}, {}, std::vector<double>(13, 1e-7)});
  refuse({{0, 0, 0.1}, {0, 0, 1}, {}, {std::numeric_limits<double>::infinity()}});
  refuse(good, {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()});
  const MultipoleField inside({{{{0, 0, 0}, {0, 0, 1}, {}, {1e-11}}}}, {}, kCube);
  EXPECT_THROW(inside.matrix({0, 0, 0}), std::invalid_argument);
  try {  // coils count from 1, as on the machine
    MultipoleField({{good}, {{{0, 0, 0.1}, {0, 0, 2}, {}, {1e-7}}}}, {}, kCube);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "coil 2: source direction is not a unit vector");
  }
}

TEST(FieldModel, takes_either_kind_and_adds_the_background) {
  const MultipoleSource pole{{0, 0, 0.2}, {0, 0, 1}, {}, {-1e-7}};
  FieldModel multipoles(
      MultipoleField(as_multipoles(CoilField::octomag()).sources(), {pole}, kCube));
  FieldModel dipoles(CoilField::octomag());
  const Eigen::Vector3d p(1e-3, 2e-3, 3e-3), earth(0, 20e-6, -45e-6);
  EXPECT_LT((multipoles.matrix(p) - dipoles.matrix(p)).norm(),
            1e-13);  // rounding of entries below 1
  EXPECT_EQ(dipoles.background(p).norm(), 0);
  const FieldGradient own = multipoles.background(p);
  EXPECT_GT(own.norm(), 0);
  multipoles.set_uniform_background(earth);
  EXPECT_LT((multipoles.background(p).head<3>() - own.head<3>() - earth).norm(), 1e-18);
  EXPECT_EQ(multipoles.background(p).tail<5>(), own.tail<5>());
  EXPECT_TRUE(dipoles.valid_at({1, 0, 0}));
  EXPECT_FALSE(multipoles.valid_at({1, 0, 0}));
  EXPECT_THROW(dipoles.set_uniform_background({0, std::numeric_limits<double>::infinity(), 0}),
               std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
