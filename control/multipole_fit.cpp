// SPDX-License-Identifier: Apache-2.0
#include "control/multipole_fit.h"

#include "control/constants.h"
#include "control/field_least_squares.h"
#include "control/preconditions.h"

#include <Eigen/Geometry>
#include <ceres/cost_function.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::control {
namespace {

constexpr double kLengthUnit = 0.01;  // m: of a source's position
// rad, of the central difference by the axis: its error is 1e-10, and the rounding 1e-11.
constexpr double kTurn = 1e-5;
constexpr double kFar = 1e9;  // m: the fit's own models are valid everywhere

/// One source and its unknowns: position (3), axis (2, on the plane that touches the unit sphere at
/// the start's axis), regular, irregular coefficients.
struct SourceUnknowns {
  std::size_t coil = 0;
  MultipoleSource start;
  double distance = 1;  // m, from the readings' middle
  int first = 0;        // index of its first unknown
  int size() const { return 5 + static_cast<int>(start.regular.size() + start.irregular.size()); }

  /// The coefficient that makes about kFieldUnit per ampere at the distance r: A_n r^(n-1) and
  /// B_n r^-(n+2) are fields, and k = n - 1. So all unknowns are of one size.
  double regular_unit(std::size_t k) const {
    return kFieldUnit * std::pow(distance, -static_cast<double>(k));
  }
  double irregular_unit(std::size_t k) const {
    return kFieldUnit * std::pow(distance, static_cast<double>(k) + 3);
  }

  /// From the solver's numbers; the axis is of unit length whatever they are.
  MultipoleSource source(const double* x) const {
    MultipoleSource made = start;
    x += first;
    made.position = kLengthUnit * Eigen::Map<const Eigen::Vector3d>(x);
    const Eigen::Vector3d u = start.axis.unitOrthogonal();
    const Eigen::Vector3d v = start.axis.cross(u);
    made.axis = (start.axis + x[3] * u + x[4] * v).normalized();
    x += 5;
    for (std::size_t k = 0; k < made.regular.size(); ++k) made.regular[k] = *x++ * regular_unit(k);
    for (std::size_t k = 0; k < made.irregular.size(); ++k)
      made.irregular[k] = *x++ * irregular_unit(k);
    return made;
  }

  /// The inverse at the start, where the axis' two numbers are 0.
  void unknowns(double* x) const {
    x += first;
    Eigen::Map<Eigen::Vector3d>(x, 3) = start.position / kLengthUnit;
    x[3] = x[4] = 0;
    x += 5;
    for (std::size_t k = 0; k < start.regular.size(); ++k)
      *x++ = start.regular[k] / regular_unit(k);
    for (std::size_t k = 0; k < start.irregular.size(); ++k)
      *x++ = start.irregular[k] / irregular_unit(k);
  }
};

const Region kEverywhere{Eigen::Vector3d::Constant(-kFar), Eigen::Vector3d::Constant(kFar)};

MultipoleField only(const MultipoleSource& source) { return {{{source}}, {}, kEverywhere}; }

// As DipoleResiduals: r = B(p) I + b - B_measured in one dense block. Coefficients enter linearly;
// the derivative by a source's position is -G; only those by the axis are differenced.
// The background is one more unknown of three components, the same for all readings.
class MultipoleResiduals final : public ceres::CostFunction {
 public:
  MultipoleResiduals(const std::vector<ProbeReading>& readings,
                     const std::vector<SourceUnknowns>& slots, int unknowns,
                     std::vector<Eigen::Vector3d> known)
      : readings_(readings), slots_(slots), unknowns_(unknowns), known_(std::move(known)) {
    set_num_residuals(static_cast<int>(3 * readings.size()));
    mutable_parameter_block_sizes()->push_back(unknowns);
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const double* x = parameters[0];
    for (int i = 0; i < unknowns_; ++i)
      if (!std::isfinite(x[i])) return false;
    const bool derive = jacobians && jacobians[0];
    Eigen::Map<Jacobian> jacobian(derive ? jacobians[0] : nullptr, derive ? num_residuals() : 0,
                                  unknowns_);
    jacobian.setZero();  // a coil without a current in a reading leaves its entries
    const Eigen::Map<const Eigen::Vector3d> background(x + unknowns_ - 3);
    for (std::size_t n = 0; n < readings_.size(); ++n) {
      Eigen::Map<Eigen::Vector3d>(residuals + 3 * n) =
          (known_[n] - readings_[n].field) / kFieldUnit + background;
      if (derive)
        jacobian.block<3, 3>(static_cast<Eigen::Index>(3 * n), unknowns_ - 3).setIdentity();
    }
    try {
      for (const SourceUnknowns& slot : slots_)
        add(slot, x, residuals, derive ? &jacobian : nullptr);
    } catch (const std::invalid_argument&) {
      return false;  // a source lies on a reading's own position: the step was too long
    }
    return true;
  }

 private:
  void add(const SourceUnknowns& slot, const double* x, double* residuals,
           Eigen::Map<Jacobian>* jacobian) const {
    const MultipoleSource source = slot.source(x);
    const MultipoleField field = only(source);
    for (std::size_t n = 0; n < readings_.size(); ++n) {
      const double current =
          readings_[n].currents[static_cast<Eigen::Index>(slot.coil)] / kFieldUnit;
      if (current == 0) continue;
      const FieldGradient made = field.matrix(readings_[n].position);
      Eigen::Map<Eigen::Vector3d>(residuals + 3 * n) += current * made.head<3>();
      if (jacobian)
        jacobian->block<3, 3>(static_cast<Eigen::Index>(3 * n), slot.first) =
            -current * kLengthUnit * gradient_matrix(made);
    }
    if (!jacobian) return;
    // Central differences by the two angles of the axis.
    // The only derivative without a closed form here; its column costs two evaluations of the
    // source.
    std::vector<double> moved(x, x + unknowns_);
    for (int turn = 3; turn < 5; ++turn) {
      const auto at = static_cast<std::size_t>(slot.first + turn);
      moved[at] = x[at] + kTurn;
      const MultipoleField ahead = only(slot.source(moved.data()));
      moved[at] = x[at] - kTurn;
      const MultipoleField behind = only(slot.source(moved.data()));
      moved[at] = x[at];
      column(slot, slot.first + turn, *jacobian, [&](const Eigen::Vector3d& p) {
        return Eigen::Vector3d((ahead.matrix(p) - behind.matrix(p)).topRows<3>() / (2 * kTurn));
      });
    }
    coefficients(slot, source, *jacobian);
  }

  // Columns of the coefficients: the field of each alone, at its unit.
  void coefficients(const SourceUnknowns& slot, const MultipoleSource& source,
                    Eigen::Map<Jacobian>& jacobian) const {
    MultipoleSource unit = source;
    std::fill(unit.regular.begin(), unit.regular.end(), 0);
    std::fill(unit.irregular.begin(), unit.irregular.end(), 0);
    int at = slot.first + 5;
    const auto one = [&](double& coefficient, double size) {
      coefficient = size;
      const MultipoleField field = only(unit);
      column(slot, at++, jacobian, [&](const Eigen::Vector3d& p) {
        return Eigen::Vector3d(field.matrix(p).topRows<3>());
      });
      coefficient = 0;
    };
    for (std::size_t k = 0; k < unit.regular.size(); ++k)
      one(unit.regular[k], slot.regular_unit(k));
    for (std::size_t k = 0; k < unit.irregular.size(); ++k)
      one(unit.irregular[k], slot.irregular_unit(k));
  }

  // Fills one column of the slot's coil: its field per unit of the unknown, times the current.
  template <class Field>
  void column(const SourceUnknowns& slot, int at, Eigen::Map<Jacobian>& jacobian,
              const Field& field) const {
    for (std::size_t n = 0; n < readings_.size(); ++n) {
      const double current =
          readings_[n].currents[static_cast<Eigen::Index>(slot.coil)] / kFieldUnit;
      if (current == 0) continue;
      jacobian.block<3, 1>(static_cast<Eigen::Index>(3 * n), at) =
          current * field(readings_[n].position);
    }
  }

  const std::vector<ProbeReading>& readings_;
  const std::vector<SourceUnknowns>& slots_;
  int unknowns_;
  std::vector<Eigen::Vector3d> known_;  // T, of the start's own background sources
};

// Every source of every coil in order, and the number of unknowns, with 3 of the background.
// Throws std::invalid_argument for a source without coefficients: nothing would determine its
// position.
std::vector<SourceUnknowns> slots_of(const MultipoleField& start, const Eigen::Vector3d& middle,
                                     int& unknowns) {
  std::vector<SourceUnknowns> slots;
  unknowns = 0;
  for (std::size_t k = 0; k < start.sources().size(); ++k) {
    for (const MultipoleSource& source : start.sources()[k]) {
      SourceUnknowns slot{k, source, std::max((source.position - middle).norm(), kLengthUnit),
                          unknowns};
      if (slot.size() == 5)
        throw std::invalid_argument("start: coil " + std::to_string(k + 1) +
                                    " has an empty source");
      unknowns += slot.size();
      slots.push_back(std::move(slot));
    }
  }
  unknowns += 3;
  return slots;
}

// The box of the readings' positions: the fit interpolates within it and says nothing beyond.
// Throws std::invalid_argument for readings in one plane: nothing is known beside it.
Region spanned(const std::vector<ProbeReading>& readings) {
  Region region{readings.front().position, readings.front().position};
  for (const ProbeReading& reading : readings) {
    region.low = region.low.cwiseMin(reading.position);
    region.high = region.high.cwiseMax(reading.position);
  }
  require((region.high - region.low).minCoeff() > 0,
          "readings: all in one plane, they span no box");
  return region;
}

}  // namespace

/// A start for a fit: each dipole as a source of that order, whose higher coefficients are 0.
MultipoleField multipoles_like(const CoilField& dipoles, int order, const Region& region) {
  require(order >= 1 && order <= kMaxMultipoleOrder, "order: must be 1 to 12");
  std::vector<MultipoleField::Sources> coils;
  for (const Dipole& dipole : dipoles.dipoles()) {
    const double size = dipole.moment_per_ampere.norm();
    require(size > 0, "dipoles: one has no moment");
    std::vector<double> irregular(static_cast<std::size_t>(order), 0.0);
    irregular.front() = kMu0Over4Pi * size;  // mu0 m / 4 pi = -B_1 axis
    coils.push_back(
        {{dipole.position, -dipole.moment_per_ampere / size, {}, std::move(irregular)}});
  }
  return {std::move(coils), {}, region};
}

/// Throws std::invalid_argument for too few or degenerate readings. The result holds in the box of
/// the readings, whatever the start's region was.
MultipoleFit fit_multipoles(const MultipoleField& start,
                            const std::vector<ProbeReading>& readings) {
  int unknowns = 0;
  check_readings(readings, start.coils(), 1);
  const Region region = spanned(readings);
  const std::vector<SourceUnknowns> slots =
      slots_of(start, (region.low + region.high) / 2, unknowns);
  check_readings(readings, start.coils(), static_cast<std::size_t>((unknowns + 2) / 3));
  // The start's own background sources are kept as they are: their field is a constant of the fit.
  const MultipoleField everywhere(start.sources(), start.background_sources(), kEverywhere);
  std::vector<Eigen::Vector3d> known;
  known.reserve(readings.size());
  for (const ProbeReading& reading : readings)
    known.push_back(everywhere.background(reading.position).head<3>());
  std::vector<double> x(static_cast<std::size_t>(unknowns), 0.0);
  for (const SourceUnknowns& slot : slots) slot.unknowns(x.data());
  const bool converged = solve_least_squares(
      std::make_unique<MultipoleResiduals>(readings, slots, unknowns, known), x);
  std::vector<MultipoleField::Sources> coils(start.sources().size());
  for (const SourceUnknowns& slot : slots) coils[slot.coil].push_back(slot.source(x.data()));
  MultipoleFit fit{MultipoleField(std::move(coils), start.background_sources(), region),
                   kFieldUnit * Eigen::Map<const Eigen::Vector3d>(x.data() + unknowns - 3),
                   {},
                   converged};
  fit.residual = residual_report(readings, [&](const ProbeReading& reading) {
    return Eigen::Vector3d(fit.field.matrix(reading.position).topRows<3>() * reading.currents +
                           fit.field.background(reading.position).head<3>() + fit.background);
  });
  return fit;
}

}  // namespace vitreo::control
