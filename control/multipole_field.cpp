// Multipole sources: solid harmonics about an axis, their gradients and second derivatives in
// closed form.
// SPDX-License-Identifier: Apache-2.0
#include "control/multipole_field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::control {
namespace {

// First and second derivatives of the Legendre polynomials at c, orders 0 to `last`.
struct Legendre {
  std::array<double, kMaxMultipoleOrder + 3> first{}, second{};

  Legendre(double c, int last) {
    double before = 1, now = c;  // P_(k-1), P_k
    first[1] = 1;
    for (int k = 1; k < last; ++k) {
      const auto at = static_cast<std::size_t>(k);
      first[at + 1] = first[at - 1] + (2 * k + 1) * now;
      second[at + 1] = second[at - 1] + (2 * k + 1) * first[at];
      const double next = ((2 * k + 1) * c * now - k * before) / (k + 1);
      before = std::exchange(now, next);
    }
  }
};

// With r^ the direction from the source and ' the derivative of P_n:
//   grad (r^-(n+1) P_n) = r^-(n+2) (P'_n z - P'_(n+1) r^)
//   second derivatives  = r^-(n+3) (P''_n z z - P''_(n+1) (z r^ + r^ z) + P''_(n+2) r^ r^ -
//   P'_(n+1) 1)
// and for r^n P_n the same with r^(n-1), r^(n-2) before and orders n-1, n-2 in place of n+1, n+2.
class Sum {
 public:
  Sum(const Eigen::Vector3d& z, const Eigen::Vector3d& away) : z_(z), away_(away) {}

  void add(double scale, double f, double own1, double next1, double own2, double next2,
           double last2) {
    z1_ += scale * own1;
    away1_ -= scale * next1;
    zz_ += f * own2;
    mixed_ -= f * next2;
    away2_ += f * last2;
    one_ -= f * next1;
  }

  FieldGradient field() const {
    const Eigen::Vector3d b = z1_ * z_ + away1_ * away_;
    const auto g = [&](int i, int j) {
      return zz_ * z_[i] * z_[j] + mixed_ * (z_[i] * away_[j] + away_[i] * z_[j]) +
             away2_ * away_[i] * away_[j] + (i == j ? one_ : 0.0);
    };
    FieldGradient result;
    result << b, g(0, 0), g(0, 1), g(0, 2), g(1, 1), g(1, 2);
    return result;
  }

 private:
  Eigen::Vector3d z_, away_;
  double z1_ = 0, away1_ = 0, zz_ = 0, mixed_ = 0, away2_ = 0, one_ = 0;
};

FieldGradient source_field(const MultipoleSource& source, const Eigen::Vector3d& position) {
  const Eigen::Vector3d offset = position - source.position;
  const double r = offset.norm();
  const std::size_t inner = source.regular.size(), outer = source.irregular.size();
  if (!(r > 0) && outer > 0)
    throw std::invalid_argument("position_in_world: at a source of the field model");
  // At the source itself the regular harmonics are polynomials: any direction gives their value.
  const Eigen::Vector3d away = r > 0 ? Eigen::Vector3d(offset / r) : source.axis;
  const Legendre p(source.axis.dot(away), static_cast<int>(std::max(inner, outer)) + 2);
  Sum sum(source.axis, away);
  double before = 0, power = 1;  // r^(n-2), r^(n-1); the first harmonic has no second derivatives
  for (std::size_t n = 1; n <= inner; ++n) {
    const double a = source.regular[n - 1];
    sum.add(a * power, a * before, p.first[n], p.first[n - 1], p.second[n], p.second[n - 1],
            n < 2 ? 0 : p.second[n - 2]);
    before = std::exchange(power, power * r);
  }
  power = outer > 0 ? 1 / (r * r * r) : 0;  // r^-(n+2)
  for (std::size_t n = 1; n <= outer; ++n, power /= r) {
    const double scale = source.irregular[n - 1] * power;
    sum.add(scale, scale / r, p.first[n], p.first[n + 1], p.second[n], p.second[n + 1],
            p.second[n + 2]);
  }
  return sum.field();
}

FieldGradient field_of(const MultipoleField::Sources& sources, const Eigen::Vector3d& position) {
  FieldGradient sum = FieldGradient::Zero();
  for (const MultipoleSource& source : sources) sum += source_field(source, position);
  return sum;
}

void check(MultipoleField::Sources& sources, const std::string& whose) {
  for (MultipoleSource& source : sources) {
    const auto require = [&](bool good, const char* what) {
      if (!good) throw std::invalid_argument(whose + ": " + what);
    };
    require(source.position.allFinite(), "source position is not finite");
    require(std::abs(source.axis.norm() - 1) < 1e-3, "source direction is not a unit vector");
    // Left to the bit when it is unit already, so that a file written and read again is the same.
    if (std::abs(source.axis.norm() - 1) > 1e-12) source.axis.normalize();
    require(source.regular.size() <= kMaxMultipoleOrder &&
                source.irregular.size() <= kMaxMultipoleOrder,
            "source has coefficients beyond order 12");
    for (const auto* list : {&source.regular, &source.irregular}) {
      for (const double value : *list)
        require(std::isfinite(value), "source coefficient is not finite");
    }
  }
}

}  // namespace

bool Region::contains(const Eigen::Vector3d& p) const {
  return (p.array() >= low.array()).all() && (p.array() <= high.array()).all();
}

MultipoleField::MultipoleField(std::vector<Sources> coils, Sources background, const Region& region)
    : coils_(std::move(coils)), background_(std::move(background)), region_(region) {
  if (coils_.empty() || coils_.size() > kMaxCoils) {
    throw std::invalid_argument("coils: " + std::to_string(coils_.size()) + " given, 1 to " +
                                std::to_string(kMaxCoils) + " allowed");
  }
  for (std::size_t k = 0; k < coils_.size(); ++k) check(coils_[k], "coil " + std::to_string(k));
  check(background_, "background");
  if (!region_.low.allFinite() || !region_.high.allFinite() ||
      !(region_.low.array() < region_.high.array()).all()) {
    throw std::invalid_argument("region: low must be below high on every axis");
  }
}

void MultipoleField::check_inside(const Eigen::Vector3d& p) const {
  if (!p.allFinite()) throw std::invalid_argument("position_in_world: not finite");
  if (region_.contains(p)) return;
  const Eigen::RowVector3d at = 1e3 * p, low = 1e3 * region_.low, high = 1e3 * region_.high;
  std::ostringstream text;
  text << "position_in_world: (" << at << ") mm is outside the field model, which holds from ("
       << low << ") to (" << high << ") mm";
  throw std::domain_error(text.str());
}

FieldMatrix MultipoleField::matrix(const Eigen::Vector3d& position_in_world) const {
  check_inside(position_in_world);
  FieldMatrix result(8, coils());
  for (int k = 0; k < coils(); ++k) {
    result.col(k) = field_of(coils_[static_cast<std::size_t>(k)], position_in_world);
  }
  return result;
}

FieldGradient MultipoleField::background(const Eigen::Vector3d& position_in_world) const {
  check_inside(position_in_world);
  return field_of(background_, position_in_world);
}

}  // namespace vitreo::control
