// The multipole field, compared with derivatives of Psi carried through the harmonics' recurrence.
// SPDX-License-Identifier: Apache-2.0
#include "control/coil_field.h"
#include "control/multipole_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;
using Real = long double;
using Sources = MultipoleField::Sources;

/// A value with its first and second derivatives by x, y, z.
struct Jet {
  Real value = 0;
  std::array<Real, 3> first{};
  std::array<std::array<Real, 3>, 3> second{};
};

Jet operator*(const Jet& a, const Jet& b) {
  Jet c;
  c.value = a.value * b.value;
  for (int i = 0; i < 3; ++i) {
    c.first[i] = a.first[i] * b.value + a.value * b.first[i];
    for (int j = 0; j < 3; ++j)
      c.second[i][j] = a.second[i][j] * b.value + a.first[i] * b.first[j] +
                       a.first[j] * b.first[i] + a.value * b.second[i][j];
  }
  return c;
}

Jet sum(Real p, const Jet& a, Real q, const Jet& b) {
  Jet c;
  c.value = p * a.value + q * b.value;
  for (int i = 0; i < 3; ++i) {
    c.first[i] = p * a.first[i] + q * b.first[i];
    for (int j = 0; j < 3; ++j) c.second[i][j] = p * a.second[i][j] + q * b.second[i][j];
  }
  return c;
}

Jet power(const Jet& a, Real exponent) {
  Jet c;
  c.value = std::pow(a.value, exponent);
  const Real slope = exponent * std::pow(a.value, exponent - 1);
  const Real bend = exponent * (exponent - 1) * std::pow(a.value, exponent - 2);
  for (int i = 0; i < 3; ++i) {
    c.first[i] = slope * a.first[i];
    for (int j = 0; j < 3; ++j)
      c.second[i][j] = slope * a.second[i][j] + bend * a.first[i] * a.first[j];
  }
  return c;
}

/// Psi of one source. The solid harmonics S_n = r^n P_n are polynomials of z = r cos th and r^2,
/// n S_n = (2n - 1) z S_(n-1) - (n - 1) r^2 S_(n-2); the irregular ones are S_n / r^(2n+1).
Jet potential(const MultipoleSource& source, const Vector3d& position) {
  Real length = 0;
  for (int i = 0; i < 3; ++i) length += static_cast<Real>(source.axis[i]) * source.axis[i];
  length = std::sqrt(length);
  Jet along;
  Jet square;
  for (int i = 0; i < 3; ++i) {
    const Real offset = static_cast<Real>(position[i]) - source.position[i];
    along.value += source.axis[i] / length * offset;
    along.first[i] = source.axis[i] / length;
    square.value += offset * offset;
    square.first[i] = 2 * offset;
    square.second[i][i] = 2;
  }
  Jet before;
  Jet harmonic;
  harmonic.value = 1;
  Jet psi;
  const int order = static_cast<int>(std::max(source.regular.size(), source.irregular.size()));
  for (int n = 1; n <= order; ++n) {
    const Jet next =
        sum((2 * n - 1) / Real(n), along * harmonic, -(n - 1) / Real(n), square * before);
    before = harmonic;
    harmonic = next;
    if (n <= static_cast<int>(source.regular.size()))
      psi = sum(1, psi, source.regular[n - 1], harmonic);
    if (n <= static_cast<int>(source.irregular.size()))
      psi = sum(1, psi, source.irregular[n - 1], harmonic * power(square, -n - 0.5L));
  }
  return psi;
}

/// B = grad Psi and its gradients in the order of a FieldMatrix' rows.
FieldGradient expected(const Sources& sources, const Vector3d& position) {
  Jet psi;
  for (const MultipoleSource& source : sources) psi = sum(1, psi, 1, potential(source, position));
  FieldGradient rows;
  const std::array<Real, 8> all{psi.first[0],     psi.first[1],     psi.first[2],
                                psi.second[0][0], psi.second[0][1], psi.second[0][2],
                                psi.second[1][1], psi.second[1][2]};
  for (int i = 0; i < 8; ++i) rows[i] = static_cast<double>(all[i]);
  return rows;
}

/// Field and gradients each to `tolerance` of their own size.
void expect_same(const FieldGradient& got, const FieldGradient& want, double tolerance) {
  for (int i = 0; i < 8; ++i) {
    const double size = i < 3 ? want.head(3).norm() : want.tail(5).norm();
    EXPECT_NEAR(got[i], want[i], tolerance * size) << "row " << i;
  }
}

class Draw {
 public:
  explicit Draw(unsigned seed) : random_(seed) {}
  double normal() { return normal_(random_); }
  Vector3d vector(double scale) {
    const double x = normal();
    const double y = normal();
    return scale * Vector3d(x, y, normal());
  }
  /// Some 0.1 m away; each order counts there about as much as any other.
  MultipoleSource source(int regular, int irregular) {
    MultipoleSource source;
    source.position = vector(1).normalized() * 0.1 + vector(0.01);
    source.axis = vector(1).normalized();
    for (int n = 1; n <= regular; ++n) source.regular.push_back(normal() * std::pow(0.1, 1 - n));
    for (int n = 1; n <= irregular; ++n)
      source.irregular.push_back(normal() * std::pow(0.1, n + 2));
    return source;
  }

 private:
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

/// Of another size to each side.
const Region kRegion{{-0.011, -0.012, -0.013}, {0.021, 0.022, 0.023}};
const Vector3d kPlace{3.1e-3, -4.7e-3, 8.3e-3};

TEST(MultipoleFieldReference, each_order_alone_up_to_the_twelfth_is_the_gradient_of_psi) {
  Draw draw(41);
  for (int n = 1; n <= kMaxMultipoleOrder; ++n) {
    for (const bool irregular : {false, true}) {
      SCOPED_TRACE(testing::Message() << "order " << n << (irregular ? " irregular" : " regular"));
      MultipoleSource source = draw.source(0, 0);
      std::vector<double>& terms = irregular ? source.irregular : source.regular;
      terms.resize(n);
      terms.back() = irregular ? -1.7 * std::pow(0.1, n + 2) : 2.3 * std::pow(0.1, 1 - n);
      const MultipoleField field({{source}}, {source}, kRegion);
      for (int k = 0; k < 5; ++k) {
        const Vector3d place = kPlace + draw.vector(2e-3);
        expect_same(field.matrix(place).col(0), expected({source}, place), 1e-12);
        expect_same(field.background(place), expected({source}, place), 1e-12);
      }
    }
  }
}

TEST(MultipoleFieldReference, a_column_is_the_sum_of_its_own_coils_sources) {
  Draw draw(42);
  std::vector<Sources> coils(8);
  for (int k = 0; k < 8; ++k)
    for (int n = 0; n <= k % 4; ++n)
      coils[k].push_back(draw.source((5 * k + n) % 13, (7 * k + 12 - n) % 13));
  const Sources background{draw.source(3, 1), draw.source(0, 12)};
  const MultipoleField field(coils, background, kRegion);
  ASSERT_EQ(field.coils(), 8);
  for (int n = 0; n < 20; ++n) {
    const Vector3d place = kPlace + draw.vector(2e-3);
    const FieldMatrix matrix = field.matrix(place);
    ASSERT_EQ(matrix.cols(), 8);
    for (int k = 0; k < 8; ++k) {
      SCOPED_TRACE(testing::Message() << "coil " << k);
      expect_same(matrix.col(k), expected(coils[k], place), 1e-11);
    }
    expect_same(field.background(place), expected(background, place), 1e-11);
  }
}

TEST(MultipoleFieldReference, gradients_are_the_differences_of_the_field) {
  Draw draw(43);
  const MultipoleField field({{draw.source(4, 5), draw.source(2, 6)}}, {}, kRegion);
  constexpr double kStep = 1e-4;
  const Eigen::Matrix3d whole = gradient_matrix(field.matrix(kPlace).col(0));
  for (int j = 0; j < 3; ++j) {
    const auto at = [&](double steps) {
      return Vector3d(field.matrix(kPlace + steps * kStep * Vector3d::Unit(j)).col(0).head(3));
    };
    // Of the fourth order, so that its own error is some (step / 0.1 m)^4.
    const Vector3d slope = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * kStep);
    EXPECT_LT((slope - whole.col(j)).norm(), 1e-8 * whole.norm()) << j;
  }
}

TEST(MultipoleFieldReference, first_irregular_coefficient_is_a_dipole_against_the_axis) {
  Draw draw(44);
  const MultipoleSource source = draw.source(0, 1);
  const CoilField dipole({{source.position, -source.irregular[0] / 1e-7 * source.axis}});
  const MultipoleField field({{source}}, {}, kRegion);
  expect_same(field.matrix(kPlace).col(0), dipole.matrix(kPlace).col(0), 1e-13);
}

TEST(MultipoleFieldReference, first_regular_coefficient_is_uniform_along_the_axis) {
  const MultipoleSource source{{0.3, -0.2, 0.5}, {0.48, -0.6, 0.64}, {-7e-3}, {}};
  const MultipoleField field({{source}}, {}, kRegion);
  const FieldGradient got = field.matrix(kPlace).col(0);
  EXPECT_LT((got.head(3) + 7e-3 * source.axis).norm(), 1e-17);
  EXPECT_LT(got.tail(5).norm(), 1e-17);
}

TEST(MultipoleFieldReference, is_exact_for_faint_near_canceling_and_far_sources) {
  Draw draw(45);
  // A faint one inside the workspace, seen from 3 um to 20 mm.
  MultipoleSource faint = draw.source(0, 3);
  faint.position = {1e-3, 2e-3, 3e-3};
  faint.irregular = {2e-11, -3e-14, 5e-17};
  for (const double distance : {3e-6, 1e-4, 5e-3, 18e-3}) {
    const Vector3d place = faint.position + distance * Vector3d(0.48, 0.6, 0.64);
    expect_same(MultipoleField({{faint}}, {}, kRegion).matrix(place).col(0),
                expected({faint}, place), 1e-9 * std::max(1., 1e-5 / distance));
  }
  // A pair that cancels but for 2 um of the 0.1 m.
  MultipoleSource plus = draw.source(0, 4);
  MultipoleSource minus = plus;
  minus.position += Vector3d(1e-6, -1e-6, 1.5e-6);
  for (double& term : minus.irregular) term = -term;
  expect_same(MultipoleField({{plus, minus}}, {}, kRegion).matrix(kPlace).col(0),
              expected({plus, minus}, kPlace), 1e-9);
  // A thousand kilometers away.
  MultipoleSource far = draw.source(0, 1);
  far.position = {0.6e6, -0.48e6, 0.64e6};
  far.irregular = {3e16};
  expect_same(MultipoleField({{far}}, {}, kRegion).matrix(kPlace).col(0), expected({far}, kPlace),
              1e-13);
}

TEST(MultipoleFieldReference, is_exact_on_the_axis_and_across_it) {
  for (const Vector3d& axis : {Vector3d(0.48, -0.6, 0.64), Vector3d(-0.48, 0.6, -0.64),
                               Vector3d(0.8, 0.64, 0).normalized()}) {
    Draw draw(46);
    MultipoleSource source = draw.source(7, 7);
    source.axis = axis;
    source.position = kPlace - 0.09 * Vector3d(0.48, -0.6, 0.64);
    expect_same(MultipoleField({{source}}, {}, kRegion).matrix(kPlace).col(0),
                expected({source}, kPlace), 1e-12);
  }
}

TEST(MultipoleFieldReference, normalizes_an_axis_that_is_unit_to_a_thousandth) {
  Draw draw(47);
  const MultipoleSource unit = draw.source(3, 3);
  for (const double length : {0.9991, 1.0009}) {
    MultipoleSource other = unit;
    other.axis *= length;
    const MultipoleField field({{unit}, {unit, other}}, {other}, kRegion);
    EXPECT_NEAR(field.sources()[1][1].axis.norm(), 1, 1e-15);
    EXPECT_NEAR(field.background_sources()[0].axis.norm(), 1, 1e-15);
    expect_same(field.matrix(kPlace).col(1), 2 * expected({unit}, kPlace), 1e-12);
    expect_same(field.background(kPlace), expected({unit}, kPlace), 1e-12);
  }
}

TEST(MultipoleFieldReference, keeps_what_it_was_given) {
  Draw draw(48);
  const std::vector<Sources> coils{{draw.source(2, 3)}, {draw.source(1, 4), draw.source(5, 0)}};
  const Sources background{draw.source(3, 2)};
  const MultipoleField field(coils, background, kRegion);
  EXPECT_EQ(field.coils(), 2);
  ASSERT_EQ(field.sources().size(), 2U);
  ASSERT_EQ(field.sources()[1].size(), 2U);
  EXPECT_EQ(field.sources()[1][1].regular, coils[1][1].regular);
  EXPECT_EQ(field.sources()[1][0].irregular, coils[1][0].irregular);
  EXPECT_EQ(field.sources()[0][0].position, coils[0][0].position);
  ASSERT_EQ(field.background_sources().size(), 1U);
  EXPECT_EQ(field.background_sources()[0].irregular, background[0].irregular);
  EXPECT_EQ(field.region().low, kRegion.low);
  EXPECT_EQ(field.region().high, kRegion.high);
  // Without sources there is no field.
  const MultipoleField none({{}, coils[0]}, {}, kRegion);
  EXPECT_EQ(none.matrix(kPlace).col(0).norm(), 0);
  EXPECT_EQ(none.background(kPlace).norm(), 0);
  expect_same(none.matrix(kPlace).col(1), expected(coils[0], kPlace), 1e-11);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
