// SPDX-License-Identifier: Apache-2.0
#include "control/multipole_field.h"

#include "control/preconditions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::control {
namespace {

// P'_n(c) and P''_n(c) for n = 0 to `last`, by recursions that are stable for |c| <= 1:
//   (k + 1) P_(k+1) = (2k + 1) c P_k - k P_(k-1)       (Bonnet)
//   P'_(k+1) = P'_(k-1) + (2k + 1) P_k                 and its derivative for P''
struct LegendreDerivatives {
  std::array<double, kMaxMultipoleOrder + 3> first{};
  // `last` at least 1; entries from 0 to `last`, P'_0 = P''_0 = P''_1 = 0.
  std::array<double, kMaxMultipoleOrder + 3> second{};

  LegendreDerivatives(double c, int last) {
    double before = 1;  // P_(k-1)
    double now = c;     // P_k
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

// The sum of the gradients of solid harmonics r^n P_n(cos th), regular, and r^-(n+1) P_n(cos th),
// irregular (Jackson 1998, 3.3; Petruska, Edelmann & Nelson 2017). With z the source's axis, r^ the
// direction from the source and ' the derivative of P_n by cos th = z.r^:
//   grad (r^-(n+1) P_n) = r^-(n+2) (P'_n z - P'_(n+1) r^)
//   second derivatives  = r^-(n+3) (P''_n z z - P''_(n+1) (z r^ + r^ z)
//                                   + P''_(n+2) r^ r^ - P'_(n+1) 1)
// and for r^n P_n the same with r^(n-1), r^(n-2) before and orders n-1, n-2 in place of n+1, n+2.
// Coefficients of the four dyads are summed up, and the tensors are built once per source.
class HarmonicSum {
 public:
  HarmonicSum(const Eigen::Vector3d& z, const Eigen::Vector3d& away) : z_(z), away_(away) {}

  // One harmonic with the factor `scale` of its gradient and `f` of its second derivatives: own1,
  // own2 are P'_n, P''_n; next1, next2 those of the order beside it; last2 P'' two orders away.
  void add(double scale, double f, double own1, double next1, double own2, double next2,
           double last2) {
    z1_ += scale * own1;
    away1_ -= scale * next1;
    zz_ += f * own2;
    mixed_ -= f * next2;
    away2_ += f * last2;
    one_ -= f * next1;
  }

  // B = +grad Psi, and its gradients as the rows of FieldMatrix.
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
  Eigen::Vector3d z_;
  Eigen::Vector3d away_;
  double z1_ = 0;     // of B: along z
  double away1_ = 0;  // of B: along r^
  double zz_ = 0;     // of the second derivatives: z z
  double mixed_ = 0;  // z r^ + r^ z
  double away2_ = 0;  // r^ r^
  double one_ = 0;    // the identity
};

// B and its gradients of one source, closed form: nothing is differenced, so sources that nearly
// cancel, or lie far away, are as exact as any other.
// Throws std::invalid_argument at an irregular source's own position, where the field is infinite.
FieldGradient source_field(const MultipoleSource& source, const Eigen::Vector3d& position) {
  const Eigen::Vector3d offset = position - source.position;
  const double r = offset.norm();
  const std::size_t inner = source.regular.size();
  const std::size_t outer = source.irregular.size();
  if (!(r > 0) && outer > 0)
    throw std::invalid_argument("position_in_world: at a source of the field model");
  // At the source itself the regular harmonics are polynomials: any direction gives their value.
  const Eigen::Vector3d away = r > 0 ? Eigen::Vector3d(offset / r) : source.axis;
  const LegendreDerivatives p(source.axis.dot(away), static_cast<int>(std::max(inner, outer)) + 2);
  HarmonicSum sum(source.axis, away);
  double before = 0;  // r^(n-2); the first harmonic has no second derivatives
  double power = 1;   // r^(n-1)
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

// Superposition of a coil's sources.
FieldGradient sources_field(const MultipoleField::Sources& sources,
                            const Eigen::Vector3d& position) {
  FieldGradient sum = FieldGradient::Zero();
  for (const MultipoleSource& source : sources) sum += source_field(source, position);
  return sum;
}

// Throws naming the fault; normalizes the axes.
void check_sources(MultipoleField::Sources& sources, const std::string& whose) {
  for (MultipoleSource& source : sources) {
    const auto expect = [&](bool good, const char* what) {
      if (!good) throw std::invalid_argument(whose + ": " + what);
    };
    expect(source.position.allFinite(), "source position is not finite");
    expect(std::abs(source.axis.norm() - 1) < 1e-3, "source direction is not a unit vector");
    // Left as it is when it is a unit vector already, so that a file that is written and read again
    // is the same to the bit.
    if (std::abs(source.axis.norm() - 1) > 1e-12) source.axis.normalize();
    expect(source.regular.size() <= kMaxMultipoleOrder &&
               source.irregular.size() <= kMaxMultipoleOrder,
           "source has coefficients beyond order 12");
    for (const auto* list : {&source.regular, &source.irregular}) {
      for (const double value : *list)
        expect(std::isfinite(value), "source coefficient is not finite");
    }
  }
}

}  // namespace

bool Region::contains(const Eigen::Vector3d& p) const {
  return (p.array() >= low.array()).all() && (p.array() <= high.array()).all();
}

// Throws std::invalid_argument naming coil or region. The sources are taken over and their axes
// normalized.
MultipoleField::MultipoleField(std::vector<Sources> coils, Sources background, const Region& region)
    : coils_(std::move(coils)), background_(std::move(background)), region_(region) {
  if (coils_.empty() || coils_.size() > kMaxCoils) {
    throw std::invalid_argument("coils: " + std::to_string(coils_.size()) + " given, 1 to " +
                                std::to_string(kMaxCoils) + " allowed");
  }
  for (std::size_t k = 0; k < coils_.size(); ++k)
    check_sources(coils_[k], "coil " + std::to_string(k + 1));
  check_sources(background_, "background");
  if (!region_.low.allFinite() || !region_.high.allFinite() ||
      !(region_.low.array() < region_.high.array()).all()) {
    throw std::invalid_argument("region: low must be below high on every axis");
  }
}

// Outside is std::domain_error and not a wrong argument: the position is sound, and the model ends
// there.
void MultipoleField::check_inside(const Eigen::Vector3d& p) const {
  if (!p.allFinite()) throw std::invalid_argument("position_in_world: not finite");
  if (region_.contains(p)) return;
  const Eigen::RowVector3d at = 1e3 * p;
  const Eigen::RowVector3d low = 1e3 * region_.low;
  const Eigen::RowVector3d high = 1e3 * region_.high;
  std::ostringstream text;
  text << "position_in_world: (" << at << ") mm is outside the field model, which holds from ("
       << low << ") to (" << high << ") mm";
  throw std::domain_error(text.str());
}

FieldMatrix MultipoleField::matrix(const Eigen::Vector3d& position_in_world) const {
  check_inside(position_in_world);
  FieldMatrix result(8, coils());
  for (int k = 0; k < coils(); ++k) {
    result.col(k) = sources_field(coils_[static_cast<std::size_t>(k)], position_in_world);
  }
  return result;
}

FieldGradient MultipoleField::background(const Eigen::Vector3d& position_in_world) const {
  check_inside(position_in_world);
  return sources_field(background_, position_in_world);
}

}  // namespace vitreo::control
