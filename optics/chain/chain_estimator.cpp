// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_estimator.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>
#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

constexpr double kPlaceUnit = 1e-3;  // m: the solver moves places in mm

/// The chain at the parameters that Ceres tries, built once for all measurements.
// Ceres announces each new point before it asks for residuals (EvaluationCallback), so a chain is
// built once for the looks of a session and not once for each. That callback is only right with one
// thread, which the solver's options hold to.
class SharedChain : public ceres::EvaluationCallback {
 public:
  SharedChain(const NominalChain& nominal, std::vector<ChainParameter> parameters)
      : nominal_(nominal),
        parameters_(std::move(parameters)),
        theta(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters_.size()))) {}
  void PrepareForEvaluation(bool, bool new_point) override {
    if (new_point || !chain_) chain_.emplace(nominal_, parameters_, theta);
  }
  const ViewingChain& chain() const { return *chain_; }

 private:
  NominalChain nominal_;
  std::vector<ChainParameter> parameters_;
  std::optional<ViewingChain> chain_;

 public:
  Eigen::VectorXd theta;
};

/// Rows of Ceres' Jacobians lie one after the other.
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

void put(const Eigen::MatrixXd& from, double* to) {
  if (to != nullptr) Eigen::Map<RowMajor>(to, from.rows(), from.cols()) = from;
}

// Residuals of one picture: its own five unknowns are the place (in mm, so that a step of one is
// one of a sigma's order for every unknown) and the two angles by which the axis is turned from
// where it is believed. A place that the chain does not show makes the evaluation fail, and the
// solver takes a shorter step.
class LookCost : public ceres::CostFunction {
 public:
  LookCost(const SharedChain& shared, const ChainLook& look, int rows, int parameters)
      : shared_(shared), look_(look) {
    set_num_residuals(rows);
    *mutable_parameter_block_sizes() = {5, parameters};
  }
  bool Evaluate(double const* const* values, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector3d> position(values[0]);
    const Eigen::Map<const Eigen::Vector2d> turned(values[0] + 3);
    const auto block =
        block_of(shared_.chain(), look_, kPlaceUnit * position, turned, jacobians != nullptr);
    if (!block || !block->residuals.allFinite()) return false;
    Eigen::Map<Eigen::VectorXd>(residuals, block->residuals.size()) = block->residuals;
    if (jacobians == nullptr) return true;
    Eigen::MatrixXd own = block->by_own;
    own.leftCols<3>() *= kPlaceUnit;
    put(own, jacobians[0]);
    put(block->by_theta, jacobians[1]);
    return true;
  }

 private:
  const SharedChain& shared_;
  ChainLook look_;
};

// A point of the retina has two unknowns of its own, its place in the picture of the fundus, which
// is known to some 2 % beforehand; so a landmark that is misplaced there does not bend the eye.
class LandmarkCost : public ceres::CostFunction {
 public:
  LandmarkCost(const SharedChain& shared, const ChainLandmark& landmark, int parameters)
      : shared_(shared), landmark_(landmark) {
    set_num_residuals(4);
    *mutable_parameter_block_sizes() = {2, parameters};
  }
  bool Evaluate(double const* const* values, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector2d> place(values[0]);
    const auto block = block_of(shared_.chain(), landmark_, kPlaceUnit * place);
    if (!block) return false;
    Eigen::Map<Eigen::VectorXd>(residuals, 4) = block->residuals;
    if (jacobians == nullptr) return true;
    put(kPlaceUnit * block->by_own, jacobians[0]);
    put(block->by_theta, jacobians[1]);
    return true;
  }

 private:
  const SharedChain& shared_;
  ChainLandmark landmark_;
};

// A parameter that was measured by itself adds one row, linear in theta.
class NumberCost : public ceres::CostFunction {
 public:
  NumberCost(const SharedChain& shared, ChainNumber number, int parameters)
      : shared_(shared), number_(std::move(number)) {
    set_num_residuals(1);
    *mutable_parameter_block_sizes() = {parameters};
  }
  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    const ChainBlock block = block_of(shared_.chain(), number_);
    residuals[0] = block.residuals[0];
    if (jacobians != nullptr) put(block.by_theta, jacobians[0]);
    return true;
  }

 private:
  const SharedChain& shared_;
  ChainNumber number_;
};

/// theta ~ N(0, 1) beforehand.
class PriorCost : public ceres::CostFunction {
 public:
  explicit PriorCost(int parameters) {
    set_num_residuals(parameters);
    *mutable_parameter_block_sizes() = {parameters};
  }
  bool Evaluate(double const* const* values, double* residuals, double** jacobians) const override {
    std::copy_n(values[0], num_residuals(), residuals);
    if (jacobians != nullptr)
      put(Eigen::MatrixXd::Identity(num_residuals(), num_residuals()), jacobians[0]);
    return true;
  }
};

/// Where the unknowns of one solve are.
// Ceres holds pointers into these: they are made before the problem and not moved during a solve.
struct Unknowns {
  std::vector<Eigen::Matrix<double, 5, 1>> looks;
  std::vector<Eigen::Vector2d> landmarks;
};

// One solve from one start. The session is borrowed; chain and unknowns are the solve's own, as a
// start may end far from where another one does.
class ChainSolve {
 public:
  ChainSolve(const NominalChain& nominal, const std::vector<ChainParameter>& parameters,
             const ChainSession& session, const ChainEstimatorSettings& settings)
      : session_(session),
        settings_(settings),
        shared_(nominal, parameters),
        nominal_(nominal),
        parameters_(parameters) {}

  std::optional<ChainMinimum> from(const Eigen::VectorXd& start,
                                   std::vector<Eigen::Vector3d>& places);

 private:
  bool begin(const Eigen::VectorXd& start);
  void pose(ceres::Problem& problem);
  std::optional<Eigen::MatrixXd> information() const;

  const ChainSession& session_;
  const ChainEstimatorSettings& settings_;
  SharedChain shared_;
  NominalChain nominal_;
  std::vector<ChainParameter> parameters_;
  Unknowns unknowns_;
};

/// Every look where this chain has it. A look that it does not show ends the start.
bool ChainSolve::begin(const Eigen::VectorXd& start) {
  shared_.theta = start;
  shared_.PrepareForEvaluation(false, true);
  unknowns_ = {};
  for (const ChainLook& look : session_.looks) {
    const auto position = locate_in_chain(shared_.chain(), look.seen, look.axis);
    if (!position) return false;
    Eigen::Matrix<double, 5, 1> own;
    own << *position / kPlaceUnit, 0, 0;
    unknowns_.looks.push_back(own);
  }
  for (const ChainLandmark& one : session_.landmarks)
    unknowns_.landmarks.push_back(one.place / kPlaceUnit);
  return true;
}

void ChainSolve::pose(ceres::Problem& problem) {
  const auto count = static_cast<int>(parameters_.size());
  double* theta = shared_.theta.data();
  problem.AddResidualBlock(new PriorCost(count), nullptr, theta);
  for (std::size_t i = 0; i < session_.looks.size(); ++i) {
    const auto first = block_of(shared_.chain(), session_.looks[i],
                                kPlaceUnit * unknowns_.looks[i].head<3>(), {0, 0}, false);
    const int rows = first ? static_cast<int>(first->residuals.size()) : 7;
    problem.AddResidualBlock(new LookCost(shared_, session_.looks[i], rows, count), nullptr,
                             unknowns_.looks[i].data(), theta);
  }
  for (std::size_t i = 0; i < session_.landmarks.size(); ++i)
    problem.AddResidualBlock(new LandmarkCost(shared_, session_.landmarks[i], count), nullptr,
                             unknowns_.landmarks[i].data(), theta);
  for (const ChainNumber& one : session_.numbers)
    problem.AddResidualBlock(new NumberCost(shared_, one, count), nullptr, theta);
}

/// Prior and all blocks at the minimum, the looks' own unknowns eliminated.
std::optional<Eigen::MatrixXd> ChainSolve::information() const {
  const auto count = static_cast<Eigen::Index>(parameters_.size());
  Eigen::MatrixXd all = Eigen::MatrixXd::Identity(count, count);
  for (std::size_t i = 0; i < session_.looks.size(); ++i) {
    const auto& own = unknowns_.looks[i];
    const auto block = block_of(shared_.chain(), session_.looks[i], kPlaceUnit * own.head<3>(),
                                own.tail<2>(), true);
    if (!block) return std::nullopt;
    all += information_of(*block);
  }
  for (std::size_t i = 0; i < session_.landmarks.size(); ++i) {
    const auto block =
        block_of(shared_.chain(), session_.landmarks[i], kPlaceUnit * unknowns_.landmarks[i]);
    if (!block) return std::nullopt;
    all += information_of(*block);
  }
  for (const ChainNumber& one : session_.numbers)
    all += information_of(block_of(shared_.chain(), one));
  return all;
}

/// Levenberg-Marquardt; each look's five unknowns are eliminated first (Schur complement).
std::optional<ChainMinimum> ChainSolve::from(const Eigen::VectorXd& start,
                                             std::vector<Eigen::Vector3d>& places) {
  if (!begin(start)) return std::nullopt;
  // Cost functions belong to the problem, the callback to this object.
  ceres::Problem::Options problem_options;
  problem_options.evaluation_callback = &shared_;
  ceres::Problem problem(problem_options);
  pose(problem);
  ceres::Solver::Options options;
  // Forty iterations ended before the minimum in one bench of eight (chi2 3058 of 159 degrees): the
  // valleys are narrow, since five hundredths of a pixel are weighed against half a millimeter.
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = settings_.max_iterations;
  options.function_tolerance = 1e-8;
  options.parameter_tolerance = 1e-7;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  // Group 0 is eliminated: block diagonal, as no two looks share an unknown.
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (auto& one : unknowns_.looks) ordering->AddElementToGroup(one.data(), 0);
  for (auto& one : unknowns_.landmarks) ordering->AddElementToGroup(one.data(), 0);
  ordering->AddElementToGroup(shared_.theta.data(), 1);
  options.linear_solver_ordering = ordering;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return std::nullopt;
  shared_.PrepareForEvaluation(true, true);
  // C = (I + sum of the looks' Schur complements)^-1, at the minimum itself.
  const auto all = information();
  if (!all) return std::nullopt;
  places.clear();
  for (const auto& one : unknowns_.looks) places.push_back(kPlaceUnit * one.head<3>());
  return ChainMinimum{shared_.theta, all->inverse(), 2 * summary.final_cost};
}

/// The nominal eye, and turned along x and y both ways.
std::vector<Eigen::VectorXd> starts_of(const std::vector<ChainParameter>& parameters,
                                       const ChainEstimatorSettings& settings) {
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters.size()));
  // Of the rotation's two coordinates each way; a start turned by 1.2 sigma is beyond the ridge
  // between the twins and still within what is likely.
  std::vector<Eigen::VectorXd> starts{zero};
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    if (!parameters[i].name.starts_with("eye_rotation")) continue;
    for (const double sign : {1.0, -1.0}) {
      starts.push_back(zero);
      starts.back()[static_cast<Eigen::Index>(i)] = sign * settings.start_rotation;
    }
  }
  starts.resize(std::min(starts.size(), static_cast<std::size_t>(std::max(1, settings.starts))));
  return starts;
}

/// The same minimum again: less than a tenth of a sigma away, by the covariance at both.
bool alike(const ChainMinimum& a, const ChainMinimum& b) {
  // Mahalanobis distance below one: the same place on the curved ridge, reached from two sides.
  const Eigen::VectorXd apart = a.theta - b.theta;
  return apart.dot(a.covariance.ldlt().solve(apart)) < 1;
}

/// Moments of the mixture about the best minimum.
Eigen::MatrixXd mixed_covariance(const std::vector<ChainMinimum>& minima) {
  const ChainMinimum& best = minima.front();
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(best.theta.size(), best.theta.size());
  double weights = 0;
  for (const ChainMinimum& one : minima) {
    // Relative posterior density of the minima, their volumes taken as alike.
    const double weight = std::exp(-(one.chi2 - best.chi2) / 2);
    const Eigen::VectorXd apart = one.theta - best.theta;
    sum += weight * (one.covariance + apart * apart.transpose());
    weights += weight;
  }
  return sum / weights;
}

// Numbers measured less unknowns of the looks; theta and its priors cancel.
int degrees_of(const ChainSession& session) {
  int measured = 0;
  for (const ChainLook& look : session.looks) {
    measured += 2 + (look.contact_sigma > 0 ? 1 : 0);  // 5 + 2 for the axis less 5 unknowns
    for (const double sigma : look.known_sigma) measured += std::isfinite(sigma) ? 1 : 0;
  }
  return measured + 2 * static_cast<int>(session.landmarks.size()) +
         static_cast<int>(session.numbers.size());
}

}  // namespace

ChainEstimate estimate_chain(const NominalChain& nominal, const ChainSigmas& sigmas,
                             const ChainSession& session, const ChainEstimatorSettings& settings) {
  const auto parameters = chain_parameters(nominal, sigmas);
  ChainSolve solve(nominal, parameters, session, settings);
  std::vector<ChainMinimum> minima;
  std::vector<Eigen::Vector3d> places;
  int ended = 0;
  for (const Eigen::VectorXd& start : starts_of(parameters, settings)) {
    std::vector<Eigen::Vector3d> of_this;
    auto found = solve.from(start, of_this);
    if (!found) continue;
    ++ended;
    if (minima.empty() || found->chi2 < minima.front().chi2) places = of_this;
    const auto same = std::find_if(minima.begin(), minima.end(),
                                   [&](const ChainMinimum& one) { return alike(one, *found); });
    if (same == minima.end())
      minima.push_back(std::move(*found));
    else if (found->chi2 < same->chi2)
      *same = std::move(*found);
    std::sort(minima.begin(), minima.end(),
              [](const ChainMinimum& a, const ChainMinimum& b) { return a.chi2 < b.chi2; });
  }
  if (minima.empty())
    throw std::invalid_argument("session: no chain within the priors shows all of its looks");
  // A minimum that explains the session that much worse is no explanation.
  std::erase_if(minima, [&](const ChainMinimum& one) {
    return one.chi2 > minima.front().chi2 + settings.equal_chi2;
  });
  const double chi2 = minima.front().chi2;
  ChainBelief belief{ViewingChain(nominal, parameters, minima.front().theta),
                     mixed_covariance(minima)};
  return {std::move(belief),   std::move(minima), chi2,
          degrees_of(session), std::move(places), ended};
}

// Information is additive over measurements, and needs no data, only places: that is what makes a
// plan cheap.
Eigen::MatrixXd session_information(const ViewingChain& chain, const ChainSession& session,
                                    const std::vector<Eigen::Vector3d>& places) {
  detail::require(places.size() == session.looks.size(), "places: wants one for each look");
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(chain.size(), chain.size());
  for (std::size_t i = 0; i < places.size(); ++i)
    if (const auto block = block_of(chain, session.looks[i], places[i], {0, 0}, true))
      all += information_of(*block);
  for (const ChainLandmark& one : session.landmarks)
    if (const auto block = block_of(chain, one, one.place)) all += information_of(*block);
  for (const ChainNumber& one : session.numbers) all += information_of(block_of(chain, one));
  return all;
}

}  // namespace vitreo::optics
