// SPDX-License-Identifier: Apache-2.0
#include "control/field_identification.h"

#include "control/preconditions.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::control {
namespace {

constexpr double kSpan = 0.5;  // s, of a displacement
constexpr Eigen::Index kOfCoil = 6;
constexpr Eigen::Index kCommon = 5;  // background, response, sink
constexpr int kRounds = 4;           // of Gauss-Newton: nearly linear, two are enough

/// A displacement, and the set-points that made it.
struct Row {
  struct Part {
    const TimedCurrents* given;
    Eigen::Vector3d position;  // m
    double span;               // s, for which it acted
  };
  Eigen::Vector3d moved{0, 0, 0};  // m
  double span = 0;                 // s
  std::vector<Part> parts;
};

Eigen::Vector3d position_at(const std::vector<TimedVector>& rows, double time) {
  const auto after =
      std::lower_bound(rows.begin(), rows.end(), time,
                       [](const TimedVector& row, double t) { return row.time < t; });
  if (after == rows.begin()) return rows.front().value;
  if (after == rows.end()) return rows.back().value;
  const auto before = after - 1;
  const double part = (time - before->time) / (after->time - before->time);
  return before->value + part * (after->value - before->value);
}

void check(const FieldMotion& motion, int coils) {
  for (std::size_t i = 0; i < motion.measured.size(); ++i) {
    const TimedVector& row = motion.measured[i];
    require(std::isfinite(row.time) && row.value.allFinite(), "measured: must be finite");
    require(i == 0 || row.time > motion.measured[i - 1].time, "measured: times must go up");
  }
  for (std::size_t i = 0; i < motion.commanded.size(); ++i) {
    const TimedCurrents& row = motion.commanded[i];
    require(row.currents.size() == coils && row.currents.allFinite() && row.mobility.allFinite(),
            "commanded: wants a current for each coil");
    require(i == 0 || row.time > motion.commanded[i - 1].time, "commanded: times must go up");
  }
}

/// Set-points act from `delay` after their command until the next one does. A row that begins
/// before the first of them acts is left out, and one with a gap of the measurements in it.
void add_rows(const FieldMotion& motion, double delay, std::vector<Row>& rows) {
  const auto& measured = motion.measured;
  const auto& given = motion.commanded;
  for (std::size_t i = 0; i < measured.size();) {
    std::size_t j = i + 1;
    while (j < measured.size() && measured[j].time - measured[i].time < kSpan) ++j;
    if (j >= measured.size() || given.empty()) return;
    const double from = measured[i].time, to = measured[j].time;
    Row row{measured[j].value - measured[i].value, to - from, {}};
    for (std::size_t k = 0; k < given.size(); ++k) {
      const double begin = std::max(from, given[k].time + delay);
      const double end = k + 1 < given.size() ? std::min(to, given[k + 1].time + delay) : to;
      if (!(end > begin)) continue;
      row.parts.push_back({&given[k], position_at(measured, (begin + end) / 2), end - begin});
    }
    const bool whole = from >= given.front().time + delay && to - from < 2 * kSpan;
    if (whole && !row.parts.empty()) rows.push_back(std::move(row));
    i = j;
  }
}

/// Believed model and unknowns in units of their prior sigmas.
class Model {
 public:
  Model(const CoilField& believed, const Robot& robot, const Medium& medium,
        const FieldDoubt& doubt, const Eigen::Vector3d& background)
      : believed_(believed),
        robot_(robot),
        weight_(robot.net_weight(medium)),
        doubt_(doubt),
        background_(background) {}

  Eigen::Index unknowns() const { return kOfCoil * believed_.coils() + kCommon; }

  /// Moments along by the gain's sigma, across by the axis', about two directions across.
  CoilField field(const Eigen::VectorXd& x) const {
    std::vector<Dipole> dipoles = believed_.dipoles();
    for (std::size_t k = 0; k < dipoles.size(); ++k) {
      const auto mine = x.segment<kOfCoil>(kOfCoil * static_cast<Eigen::Index>(k));
      const Eigen::Vector3d moment = dipoles[k].moment_per_ampere;
      Eigen::Index least = 0;
      moment.cwiseAbs().minCoeff(&least);
      const Eigen::Vector3d one = moment.cross(Eigen::Vector3d::Unit(least)).normalized();
      const Eigen::Vector3d two = moment.normalized().cross(one);
      dipoles[k].moment_per_ampere +=
          doubt_.coils.gain * mine[0] * moment +
          doubt_.coils.axis * moment.norm() * (mine[1] * one + mine[2] * two);
      dipoles[k].position += doubt_.coils.position * mine.tail<3>();
    }
    return CoilField(dipoles);
  }
  Eigen::Vector3d background(const Eigen::VectorXd& x) const {
    return doubt_.background * x.segment<3>(unknowns() - kCommon);
  }
  double response(const Eigen::VectorXd& x) const {
    return 1 + doubt_.response * x[unknowns() - 2];
  }
  double sink(const Eigen::VectorXd& x) const { return 1 + doubt_.sink * x[unknowns() - 1]; }

  /// m, a displacement, for the unknowns.
  Eigen::Vector3d moved(const Row& row, const CoilField& field, const Eigen::VectorXd& x) const {
    const Eigen::Vector3d uniform = background_ + background(x);
    const double magnetic = response(x);
    const Eigen::Vector3d down(0, 0, -weight_ * sink(x));
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Row::Part& part : row.parts) {
      FieldGradient made = field.matrix(part.position) * part.given->currents;
      made.head<3>() += uniform;
      const double strength = made.head<3>().norm();
      if (!(strength > 0)) continue;
      const Eigen::Vector3d moment = robot_.moment(strength) / strength * made.head<3>();
      const Eigen::Vector3d force = magnetic * (force_from_field(moment) * made) + down;
      sum += part.span * (part.given->mobility * force);
    }
    return sum;
  }
  /// m, of a displacement's coordinate.
  double sigma(const Row& row) const {
    return std::hypot(std::sqrt(2.0) * doubt_.noise, doubt_.unexplained * row.span);
  }

 private:
  const CoilField& believed_;
  const Robot& robot_;
  double weight_;  // N
  const FieldDoubt& doubt_;
  Eigen::Vector3d background_;  // T, believed
};

/// Sums of one round: J'J and J'd in units of sigma, and the squares of the velocities left over.
struct Normal {
  Eigen::MatrixXd information;
  Eigen::VectorXd right;
  double squares = 0;  // (m/s)^2
};

Normal linearize(const Model& model, const std::vector<Row>& rows, const Eigen::VectorXd& x) {
  constexpr double kStep = 0.05;  // of a prior's sigma
  const Eigen::Index n = model.unknowns();
  std::vector<CoilField> moved;
  std::vector<Eigen::VectorXd> at;
  for (Eigen::Index i = 0; i < n; ++i) {
    at.push_back(x);
    at.back()[i] += kStep;
    moved.push_back(model.field(at.back()));
  }
  const CoilField field = model.field(x);
  Normal sums{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)};
  Eigen::MatrixXd by(3, n);
  for (const Row& row : rows) {
    const Eigen::Vector3d shown = model.moved(row, field, x);
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      by.col(i) = (model.moved(row, moved[k], at[k]) - shown) / kStep;
    }
    const Eigen::Vector3d left = row.moved - shown;
    const double weight = 1 / std::pow(model.sigma(row), 2);
    sums.information.noalias() += weight * by.transpose() * by;
    sums.right.noalias() += weight * by.transpose() * left;
    sums.squares += left.squaredNorm() / std::pow(row.span, 2);
  }
  return sums;
}

double rms(const Normal& sums, std::size_t rows) {
  return std::sqrt(sums.squares / (3 * static_cast<double>(rows)));
}

}  // namespace

void FieldDoubt::check() const {
  require(positive(coils.gain) && positive(coils.position) && positive(coils.axis),
          "coils: sigmas must be above 0");
  require(positive(background), "background: must be above 0 T");
  require(positive(response) && positive(sink), "response, sink: must be above 0");
  require(positive(noise) && positive(unexplained), "noise, unexplained: must be above 0");
}

// The minimum of |d - f(x)|^2 / sigma^2 + |x|^2: x has unit variance beforehand, and (J'J + 1)^-1
// afterwards.
FieldIdentification identify_field(const CoilField& believed, const Robot& robot,
                                   const Medium& medium, const std::vector<FieldMotion>& motions,
                                   double delay, const FieldDoubt& doubt,
                                   const Eigen::Vector3d& background) {
  doubt.check();
  require(not_negative(delay) && delay < 1, "delay: must be within 0 and 1 s");
  std::vector<Row> rows;
  for (const FieldMotion& motion : motions) {
    check(motion, believed.coils());
    add_rows(motion, delay, rows);
  }
  constexpr std::size_t kFewest = 100;
  if (rows.size() < kFewest)
    throw std::domain_error("the robot was not seen to move for long enough: 50 s are wanted");
  const Model model(believed, robot, medium, doubt, background);
  const Eigen::Index n = model.unknowns();
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n);
  Normal sums = linearize(model, rows, x);
  const double before = rms(sums, rows.size());
  Eigen::LLT<Eigen::MatrixXd> factored;
  for (int round = 0; round < kRounds; ++round) {
    factored.compute(sums.information + Eigen::MatrixXd::Identity(n, n));
    x += factored.solve(sums.right - x);
    sums = linearize(model, rows, x);
  }
  const Eigen::MatrixXd covariance = factored.solve(Eigen::MatrixXd::Identity(n, n));
  FieldIdentification found{model.field(x), model.background(x), {}, {}, {}};
  found.response = {model.response(x), doubt.response * std::sqrt(covariance(n - 2, n - 2))};
  found.sink = {model.sink(x), doubt.sink * std::sqrt(covariance(n - 1, n - 1))};
  for (Eigen::Index k = 0; k < believed.coils(); ++k)
    found.gains.push_back({1 + doubt.coils.gain * x[kOfCoil * k],
                           doubt.coils.gain * std::sqrt(covariance(kOfCoil * k, kOfCoil * k))});
  found.before = before;
  found.after = rms(sums, rows.size());
  found.rows = static_cast<int>(rows.size());
  return found;
}

}  // namespace vitreo::control
