// SPDX-License-Identifier: Apache-2.0
#include "host/servo/field_allocator.h"

#include "host/text/units.h"

#include <Eigen/Cholesky>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace vitreo {
namespace {

// Of the weight, that may be lacking where a soft robot's field and moment are cut by a limit: it
// sinks by a fifth of its free speed, and the law is told.
constexpr double kMostMissing = 0.2;

// Forces tried: the one wanted, four halves of it, none.
constexpr int kMostAttempts = 6;

void check_limit(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

/// What the interlock's total limit is about, A.
/// Magnitudes, as opposite currents do not cancel.
double total(const control::Currents& currents) { return currents.cwiseAbs().sum(); }

/// A soft robot's moment falls with its field, and where a limit cuts the field there is less of
/// both than was wanted. The largest field up to `wanted` that the allocation makes when the moment
/// is taken for it, to a thousandth, by the secant from above: `high` makes less than itself, `low`
/// more, or nothing that levitates. Where there is none, that which lacks least. at(field): the
/// allocation with that field's moment; throws std::domain_error.
template <class At>
control::BoxAllocation agreeing(const At& at, double wanted) {
  constexpr double kAgree = 1e-3;
  constexpr int kMost = 24;
  double low = 0, high = wanted, field = wanted;
  double above = wanted, above_made = wanted;  // the try before
  control::BoxAllocation nearest;
  double share = -std::numeric_limits<double>::infinity();
  for (int i = 0; i < kMost && high - low > kAgree / 4 * wanted; ++i) {
    double made = 0;
    try {
      control::BoxAllocation found = at(field);
      made = found.field.norm();
      const bool less = made / field < 1 - kAgree;
      const bool more = made / field > 1 + kAgree;
      if (!less && (!more || field == wanted)) return found;
      if (less && made / field > share) nearest = found, share = made / field;
    } catch (const std::domain_error&) {
      if (field == wanted) throw;
    }
    if (made > 0 && made < field) {
      const double slope = (above_made - made) / (above - field);
      const bool secant = above > field && slope > 0 && slope < 1;
      const double next = secant ? (made - slope * field) / (1 - slope) : made;
      above = high = field;
      above_made = made;
      field = next > low && next < high ? next : (low + high) / 2;
    } else {
      low = field;
      field = (low + high) / 2;
    }
  }
  return nearest;
}

}  // namespace

FieldAllocator::FieldAllocator(const RigModel& model, const AllocatorSettings& settings)
    : model_(model), settings_(settings), field_(settings.field) {
  check_limit(settings.limits.size() == model.field.coils(), "limits: one a coil is wanted");
  check_limit(settings.limits.allFinite() && settings.limits.minCoeff() >= 0,
              "limits: must be at least 0 A");
  check_limit(settings.limits.maxCoeff() > 0, "limits: every coil is dead");
  check_limit(settings.total_limit > 0, "total_limit: must be above 0 A");
  check_limit(settings.field_max >= settings.field, "field_max: must be at least the field");
}

FieldAllocation FieldAllocator::allocate(const Eigen::Vector3d& position,
                                         const Eigen::Vector3d& force) const {
  try {
    return allocate(position, force, field_);
  } catch (const std::domain_error& error) {
    const auto helps = stronger(position, Eigen::Vector3d::Zero());
    throw std::domain_error(std::string(error.what()) +
                            (helps ? ": raise the field to " + format_quantity(*helps, "T") : "") +
                            (helps ? " (field, field_max)" : "; no stronger field helps"));
  }
}

std::optional<double> FieldAllocator::stronger(const Eigen::Vector3d& position,
                                               const Eigen::Vector3d& force) const {
  constexpr double kStrongest = 40e-3;  // T, as a loop's settings allow
  constexpr double kRung = 1e-3;        // T
  for (double field = field_ + kRung; field <= kStrongest; field += kRung) try {
      if (!allocate(position, force, field).limited) return field;
    } catch (const std::domain_error&) {
      continue;  // not even the weight: a rung higher
    }
  return std::nullopt;
}

/// Outside of the field model's region the nearest position's field is used, and `outside` says so.
FieldAllocation FieldAllocator::allocate(const Eigen::Vector3d& position,
                                         const Eigen::Vector3d& force, double field) const {
  const Eigen::Vector3d known = model_.field.nearest_valid(position);
  const control::FieldMatrix matrix = model_.field.matrix(known);
  const control::FieldGradient background = model_.field.background(known);
  const control::BoxAllocation found = within(matrix, background, force, field);
  FieldAllocation result;
  result.currents = found.currents;
  result.force = found.force - Eigen::Vector3d(0, 0, model_.robot.net_weight(model_.medium));
  result.headroom = found.headroom;
  result.limited = found.limited || found.vertical_cut;
  result.outside = known != position;
  return result;
}

/// The largest current over its limit, and with less weight the sum of all over theirs
/// (facts/control_limits 7). On top, what a field costs by being weak: the coils' errors and the
/// room's field turn the robot by their part of it. A limit that is met outweighs all of these, and
/// a field that cannot levitate weighs most.
double FieldAllocator::cost(const Eigen::Vector3d& position, const Eigen::Vector3d& force,
                            double field) const {
  constexpr double kSum = 0.3;
  constexpr double kStray = 1.8e-3;  // T
  constexpr double kLimited = 10;
  constexpr double kFails = 1000;
  try {
    const FieldAllocation found = allocate(position, force, field);
    return 1 - found.headroom + kSum * total(found.currents) / settings_.limits.sum() +
           kStray / field + (found.limited ? kLimited : 0);
  } catch (const std::domain_error&) {
    return kFails;
  }
}

/// Downhill by a bounded rate; where the field that there is meets a limit, a ladder over the whole
/// range.
void FieldAllocator::choose(const Eigen::Vector3d& position, const Eigen::Vector3d& force,
                            double span) {
  constexpr double kRate = 5e-3;     // T/s
  constexpr double kRung = 1.25e-3;  // T
  constexpr double kMatters = 1e-3;  // of the cost
  constexpr double kAtLimit = 5;
  const double low = settings_.field, high = settings_.field_max;
  if (!(high > low)) return;
  double least = cost(position, force, field_);
  if (least > kAtLimit) {
    for (double rung = low; rung <= high; rung += kRung)
      if (const double there = cost(position, force, rung); there < least) {
        least = there;
        field_ = rung;
      }
    return;
  }
  const double step = kRate * span;
  for (const double other : {std::max(field_ - step, low), std::min(field_ + step, high)})
    if (cost(position, force, other) < (1 - kMatters) * least) {
      field_ = other;
      return;
    }
}

/// The quadratic programme of control::allocate_within at the moment that the field has which it
/// makes, with as much of the force as goes: less and in the end none but the levitation where the
/// sum of currents is beyond its limit, or no field agrees with its moment. Field and force of the
/// result are those that the robot feels, the background's share included. Throws
/// std::domain_error where levitation is out of reach.
control::BoxAllocation FieldAllocator::within(const control::FieldMatrix& matrix,
                                              const control::FieldGradient& background,
                                              const Eigen::Vector3d& force, double wanted) const {
  const Eigen::Vector3d levitation(0, 0, model_.robot.net_weight(model_.medium));
  std::string why;
  for (int attempt = 0; attempt < kMostAttempts; ++attempt) {
    const Eigen::Vector3d asked = attempt + 1 < kMostAttempts
                                      ? Eigen::Vector3d(force / (1 << attempt))
                                      : Eigen::Vector3d(Eigen::Vector3d::Zero());
    const auto at = [&](double field) {
      const Eigen::Vector3d moment = model_.robot.moment(field) * settings_.axis;
      // F = S(m) g: the force in the gradients that are there without any current of ours.
      const Eigen::Vector3d pulled = control::force_from_field(moment) * background;
      control::BoxAllocation found = control::allocate_within(
          matrix, moment,
          {wanted * settings_.axis - background.head<3>(), levitation - pulled, asked},
          settings_.limits);
      found.field += background.head<3>();
      found.force += pulled;
      return found;
    };
    try {
      control::BoxAllocation found = agreeing(at, wanted);
      found.limited = found.limited || attempt > 0;
      // With the moment that there is.
      const double made = found.field.norm();
      const Eigen::Vector3d there =
          control::force_from_field(model_.robot.moment(made) * settings_.axis) *
          (matrix * found.currents + background);
      const bool held =
          found.force.z() - there.z() <= kMostMissing * std::abs(levitation.z()) + 1e-12;
      found.force = there;
      if (held && !(total(found.currents) > settings_.total_limit)) return found;
      why = held
                ? "holding the robot against its weight is beyond the limit of the sum of currents "
                  "here"
                : "the coils' limits leave no field here whose moment holds the robot against its "
                  "weight";
    } catch (const std::domain_error& error) {
      why = error.what();
    }
    if (asked.isZero(0)) break;
  }
  throw std::domain_error(why);
}

// x - W' (W W')^-1 W x with the wrench's rows W = [B; F] at the moment that the field makes, rows
// and columns of unit magnitude; columns of dead coils are zero, and so are their shares.
control::Currents FieldAllocator::tone(const control::Currents& currents,
                                       const Eigen::Vector3d& position, double time) const {
  const Eigen::Index coils = currents.size();
  control::Currents tone = control::Currents::Zero(coils);
  if (!(settings_.tone > 0) || coils <= 6) return tone;
  const Eigen::Vector3d known = model_.field.nearest_valid(position);
  const control::FieldMatrix matrix = model_.field.matrix(known);
  const Eigen::Vector3d moment = model_.robot.moment(field_) * settings_.axis;
  Eigen::Matrix<double, Eigen::Dynamic, 6, 0, control::kMaxCoils, 6> rows(coils, 6);
  rows.leftCols<3>() = matrix.topRows<3>().transpose();
  rows.rightCols<3>() = (control::force_from_field(moment) * matrix).transpose();
  for (Eigen::Index k = 0; k < coils; ++k) {
    if (!(settings_.limits[k] > 0)) {
      rows.row(k).setZero();
      continue;
    }
    // An eighth of a turn from coil to coil: no two are in step.
    tone[k] = settings_.tone *
              std::sin(2 * M_PI * (kToneRate * time + static_cast<double>(k) / control::kMaxCoils));
  }
  rows.colwise().normalize();
  tone -= rows * (rows.transpose() * rows).ldlt().solve(rows.transpose() * tone);
  const control::Currents sum = currents + tone;
  const bool within = (settings_.limits - sum.cwiseAbs()).minCoeff() >= 0;
  if (!within || total(sum) > settings_.total_limit || !tone.allFinite()) tone.setZero();
  return tone;
}

/// Levitation and force are zero: as long as the position is not known, a gradient made for one
/// position would push a robot at another.
control::Currents FieldAllocator::orienting() const {
  const Eigen::Vector3d center = model_.field.nearest_valid(Eigen::Vector3d::Zero());
  const Eigen::Vector3d moment = model_.robot.moment(settings_.field) * settings_.axis;
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  const Eigen::Vector3d field =
      settings_.field * settings_.axis - model_.field.background(center).head<3>();
  return control::allocate_within(model_.field.matrix(center), moment, {field, none, none},
                                  settings_.limits)
      .currents;
}

}  // namespace vitreo
