// SPDX-License-Identifier: Apache-2.0
#include "control/field_identification.h"

#include "control/preconditions.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

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
  /// Of the variances of their unknowns.
  double response_sigma(double variance) const { return doubt_.response * std::sqrt(variance); }
  double sink_sigma(double variance) const { return doubt_.sink * std::sqrt(variance); }

  /// T, what the currents of a part make where the robot was.
  Eigen::Vector3d made(const Row::Part& part, const Eigen::VectorXd& x) const {
    return (field(x).matrix(part.position) * part.given->currents).head<3>() + background_ +
           background(x);
  }

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

/// (m/s)^2, of the velocities that the model does not have.
double squares_left(const Model& model, const std::vector<Row>& rows, const Eigen::VectorXd& x) {
  const CoilField field = model.field(x);
  double squares = 0;
  for (const Row& row : rows)
    squares += (row.moved - model.moved(row, field, x)).squaredNorm() / std::pow(row.span, 2);
  return squares;
}

double rms(double squares, std::size_t rows) {
  return std::sqrt(squares / (3 * static_cast<double>(rows)));
}

}  // namespace

void FieldDoubt::check() const {
  require(positive(coils.gain) && positive(coils.position) && positive(coils.axis),
          "coils: sigmas must be above 0");
  require(positive(background), "background: must be above 0 T");
  require(positive(response) && positive(sink), "response, sink: must be above 0");
  require(positive(noise) && positive(unexplained), "noise, unexplained: must be above 0");
}

namespace {

/// Rows of the motions that are fitted, or of those that are not.
std::vector<Row> rows_of(const std::vector<FieldMotion>& motions, double delay, bool held_out) {
  std::vector<Row> rows;
  for (const FieldMotion& motion : motions)
    if (motion.held_out == held_out) add_rows(motion, delay, rows);
  return rows;
}

/// Derivatives of `value` (a 3-vector of the unknowns) by central differences about x.
template <class Value>
Eigen::MatrixXd derivatives(const Eigen::VectorXd& x, Value value) {
  constexpr double kStep = 0.05;  // of a prior's sigma
  Eigen::MatrixXd by(3, x.size());
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    Eigen::VectorXd up = x, down = x;
    up[i] += kStep;
    down[i] -= kStep;
    by.col(i) = (value(up) - value(down)) / (2 * kStep);
  }
  return by;
}

/// Sigma of a vector's strength (relative) and of either coordinate of its direction (rad), of the
/// covariance of its coordinates.
std::pair<double, double> strength_and_direction(const Eigen::Vector3d& vector,
                                                 const Eigen::Matrix3d& covariance) {
  const Eigen::Vector3d along = vector.normalized();
  const double strength = along.dot(covariance * along);
  return {std::sqrt(strength) / vector.norm(),
          std::sqrt(std::max(0.0, covariance.trace() - strength) / 2) / vector.norm()};
}

IdentifiedCoil coil_at(const Model& model, const Eigen::VectorXd& x,
                       const Eigen::MatrixXd& covariance, const Eigen::Vector3d& place, int coil) {
  const auto made = [&](const Eigen::VectorXd& of) -> Eigen::Vector3d {
    return model.field(of).matrix(place).col(coil).head<3>();
  };
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(x.size());
  const Eigen::Vector3d now = made(x), before = made(none);
  const Eigen::MatrixXd by = derivatives(x, made), by_before = derivatives(none, made);
  const auto [gain, angle] = strength_and_direction(now, by * covariance * by.transpose());
  const auto [gain_before, angle_before] =
      strength_and_direction(before, by_before * by_before.transpose());
  const double ratio = now.norm() / before.norm();
  return {{ratio, ratio * gain},
          std::atan2(now.cross(before).norm(), now.dot(before)),
          angle,
          gain_before,
          angle_before};
}

/// Of the field's direction at the currents in use, rms over some of the rows.
double direction_sigma(const Model& model, const std::vector<Row>& rows, const Eigen::VectorXd& x,
                       const Eigen::MatrixXd& covariance) {
  const std::size_t every = std::max<std::size_t>(1, rows.size() / 40);
  double squares = 0;
  int count = 0;
  for (std::size_t i = 0; i < rows.size(); i += every, ++count) {
    const Row::Part& part = rows[i].parts.front();
    const auto made = [&](const Eigen::VectorXd& of) { return model.made(part, of); };
    const Eigen::MatrixXd by = derivatives(x, made);
    const auto found = strength_and_direction(made(x), by * covariance * by.transpose());
    squares += std::pow(found.second, 2);
  }
  return std::sqrt(squares / std::max(1, count));
}

Eigen::Vector3d middle_of(const std::vector<Row>& rows) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Row& row : rows) sum += row.parts.front().position;
  return sum / static_cast<double>(rows.size());
}

/// How much larger the squares are than noise and prior say, at least 1.
double excess(const Model& model, const std::vector<Row>& rows, const Eigen::VectorXd& x) {
  const CoilField field = model.field(x);
  double squares = 0;
  for (const Row& row : rows)
    squares +=
        (row.moved - model.moved(row, field, x)).squaredNorm() / std::pow(model.sigma(row), 2);
  return std::max(1.0, squares / (3 * static_cast<double>(rows.size())));
}

FieldIdentification result_of(const Model& model, const std::vector<Row>& rows,
                              const Eigen::VectorXd& x, const Eigen::MatrixXd& information) {
  const Eigen::Index n = model.unknowns();
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(n, n);
  const Eigen::LLT<Eigen::MatrixXd> factored(information / excess(model, rows, x) + one);
  FieldIdentification found{model.field(x), model.background(x)};
  found.covariance = factored.solve(one);
  found.response = {model.response(x), model.response_sigma(found.covariance(n - 2, n - 2))};
  found.sink = {model.sink(x), model.sink_sigma(found.covariance(n - 1, n - 1))};
  const Eigen::Vector3d middle = middle_of(rows);
  for (int k = 0; k < found.field.coils(); ++k)
    found.coils.push_back(coil_at(model, x, found.covariance, middle, k));
  found.direction_believed = direction_sigma(model, rows, Eigen::VectorXd::Zero(n), one);
  found.direction_sigma = direction_sigma(model, rows, x, found.covariance);
  return found;
}

}  // namespace

// The minimum of |d - f(x)|^2 / sigma^2 + |x|^2: x has unit variance beforehand, and (J'J + 1)^-1
// afterwards.
FieldIdentification identify_field(const CoilField& believed, const Robot& robot,
                                   const Medium& medium, const std::vector<FieldMotion>& motions,
                                   double delay, const FieldDoubt& doubt,
                                   const Eigen::Vector3d& background) {
  doubt.check();
  require(not_negative(delay) && delay < 1, "delay: must be within 0 and 1 s");
  for (const FieldMotion& motion : motions) check(motion, believed.coils());
  const std::vector<Row> rows = rows_of(motions, delay, false);
  constexpr std::size_t kFewest = 100;
  if (rows.size() < kFewest)
    throw std::domain_error("the robot was not seen to move for long enough: 50 s are wanted");
  const Model model(believed, robot, medium, doubt, background);
  const Eigen::Index n = model.unknowns();
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(n);
  Eigen::VectorXd x = none;
  Normal sums = linearize(model, rows, x);
  const double before = rms(sums.squares, rows.size());
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::MatrixXd whole = sums.information + Eigen::MatrixXd::Identity(n, n);
    x += whole.llt().solve(sums.right - x);
    sums = linearize(model, rows, x);
  }
  FieldIdentification found = result_of(model, rows, x, sums.information);
  found.fitted = {before, rms(sums.squares, rows.size()), static_cast<int>(rows.size())};
  const std::vector<Row> others = rows_of(motions, delay, true);
  if (!others.empty())
    found.held_out = {rms(squares_left(model, others, none), others.size()),
                      rms(squares_left(model, others, x), others.size()),
                      static_cast<int>(others.size())};
  return found;
}

// B_1 r^-2 P_1 with grad Psi = B is the dipole with mu0 m / 4 pi = -B_1 axis.
std::optional<DipoleModel> dipoles_of(const FieldModel& model) {
  if (model.dipoles() != nullptr) return DipoleModel{*model.dipoles(), model.uniform_background()};
  constexpr double kPerMoment = 1e-7;  // mu0 / 4 pi, T m/A
  const MultipoleField& multipoles = *model.multipoles();
  const auto none = [](const std::vector<double>& of, std::size_t from) {
    return std::all_of(of.begin() + static_cast<std::ptrdiff_t>(std::min(from, of.size())),
                       of.end(), [](double coefficient) { return coefficient == 0; });
  };
  std::vector<Dipole> dipoles;
  for (const MultipoleField::Sources& coil : multipoles.sources()) {
    if (coil.size() != 1 || coil[0].irregular.empty() || !none(coil[0].irregular, 1) ||
        !none(coil[0].regular, 0))
      return std::nullopt;
    dipoles.push_back({coil[0].position, -coil[0].irregular[0] / kPerMoment * coil[0].axis});
  }
  Eigen::Vector3d uniform = model.uniform_background();
  for (const MultipoleSource& source : multipoles.background_sources()) {
    if (source.regular.empty() || !none(source.regular, 1) || !none(source.irregular, 0))
      return std::nullopt;
    uniform += source.regular[0] * source.axis;
  }
  return DipoleModel{CoilField(std::move(dipoles)), uniform};
}

}  // namespace vitreo::control
