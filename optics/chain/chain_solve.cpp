// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_solve.h"

#include <Eigen/Dense>
#include <ceres/ceres.h>

#include <algorithm>
#include <memory>
#include <utility>

namespace vitreo::optics::detail {
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
  double relaxed = 1;  // of the looks' sigmas
};

/// Rows of Ceres' Jacobians lie one after the other.
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

void put(const Eigen::MatrixXd& from, double* to) {
  if (to != nullptr) Eigen::Map<RowMajor>(to, from.rows(), from.cols()) = from;
}

/// Rows of a look that a relaxed solve counts for less: all but the two of the axis, which are what
/// was known of it beforehand, as the priors of the chain are.
void relax(double by, ChainBlock& block, bool derivatives) {
  Eigen::ArrayXd weight = Eigen::ArrayXd::Constant(block.residuals.size(), 1 / by);
  weight.segment<2>(5).setOnes();
  block.residuals.array() *= weight;
  if (!derivatives) return;
  block.by_own.array().colwise() *= weight;
  block.by_theta.array().colwise() *= weight;
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
    auto block =
        block_of(shared_.chain(), look_, kPlaceUnit * position, turned, jacobians != nullptr);
    if (!block || !block->residuals.allFinite()) return false;
    relax(shared_.relaxed, *block, jacobians != nullptr);
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
             const ChainSession& session, const ChainEstimatorSettings& settings,
             const ChainWay& way)
      : session_(session),
        settings_(settings),
        way_(way),
        shared_(nominal, parameters),
        parameters_(parameters) {}

  std::optional<ChainEnd> from(const Eigen::VectorXd& start);

 private:
  bool begin(const Eigen::VectorXd& start);
  void pose(ceres::Problem& problem);
  ceres::Solver::Options options();
  bool descend(ceres::Problem& problem);
  std::optional<ChainEnd> ended() const;

  const ChainSession& session_;
  const ChainEstimatorSettings& settings_;
  const ChainWay& way_;
  SharedChain shared_;
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
    ceres::LossFunction* loss = way_.robust > 0 ? new ceres::CauchyLoss(way_.robust) : nullptr;
    problem.AddResidualBlock(new LookCost(shared_, session_.looks[i], rows, count), loss,
                             unknowns_.looks[i].data(), theta);
  }
  for (std::size_t i = 0; i < session_.landmarks.size(); ++i)
    problem.AddResidualBlock(new LandmarkCost(shared_, session_.landmarks[i], count), nullptr,
                             unknowns_.landmarks[i].data(), theta);
  for (const ChainNumber& one : session_.numbers)
    problem.AddResidualBlock(new NumberCost(shared_, one, count), nullptr, theta);
}

/// Each look's five unknowns are eliminated first (Schur complement).
ceres::Solver::Options ChainSolve::options() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.parameter_tolerance = 1e-7;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  // Group 0 is eliminated: block diagonal, as no two looks share an unknown.
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (auto& one : unknowns_.looks) ordering->AddElementToGroup(one.data(), 0);
  for (auto& one : unknowns_.landmarks) ordering->AddElementToGroup(one.data(), 0);
  ordering->AddElementToGroup(shared_.theta.data(), 1);
  options.linear_solver_ordering = ordering;
  return options;
}

/// Whether it came to rest by whole weights.
bool ChainSolve::descend(ceres::Problem& problem) {
  ceres::Solver::Options how = options();
  double* theta = shared_.theta.data();
  if (!way_.held.empty())
    problem.SetManifold(
        theta, new ceres::SubsetManifold(static_cast<int>(shared_.theta.size()), way_.held));
  ceres::Solver::Summary summary;
  constexpr int kRoughly = 30;  // iterations of a relaxed solve: a start need be no better
  for (const double relaxed : {100.0, 10.0, 1.0}) {
    const bool whole = relaxed == 1;
    if (whole && !way_.held.empty()) problem.SetManifold(theta, nullptr);
    shared_.relaxed = relaxed;
    how.max_num_iterations = whole ? settings_.max_iterations : kRoughly;
    how.function_tolerance = whole ? 1e-8 : 1e-3;
    ceres::Solve(how, &problem, &summary);
    if (!summary.IsSolutionUsable()) return false;
  }
  return summary.termination_type == ceres::CONVERGENCE;
}

/// The minimum with C = (I + sum of the blocks' Schur complements)^-1, where the unknowns are now.
std::optional<ChainEnd> ChainSolve::ended() const {
  const auto count = static_cast<Eigen::Index>(parameters_.size());
  Eigen::MatrixXd information = Eigen::MatrixXd::Identity(count, count);
  ChainEnd end;
  double chi2 = shared_.theta.squaredNorm();
  const auto add = [&](const ChainBlock& block) {
    information += information_of(block);
    chi2 += block.residuals.squaredNorm();
  };
  for (std::size_t i = 0; i < session_.looks.size(); ++i) {
    const auto& own = unknowns_.looks[i];
    const auto block = block_of(shared_.chain(), session_.looks[i], kPlaceUnit * own.head<3>(),
                                own.tail<2>(), true);
    if (!block) return std::nullopt;
    add(*block);
    end.look_chi2.push_back(block->residuals.squaredNorm());
    end.places.push_back(kPlaceUnit * own.head<3>());
  }
  for (std::size_t i = 0; i < session_.landmarks.size(); ++i) {
    const auto block =
        block_of(shared_.chain(), session_.landmarks[i], kPlaceUnit * unknowns_.landmarks[i]);
    if (!block) return std::nullopt;
    add(*block);
  }
  for (const ChainNumber& one : session_.numbers) add(block_of(shared_.chain(), one));
  end.minimum = {shared_.theta, information.inverse(), chi2};
  return end;
}

std::optional<ChainEnd> ChainSolve::from(const Eigen::VectorXd& start) {
  if (!begin(start)) return std::nullopt;
  // Cost functions belong to the problem, the callback to this object.
  ceres::Problem::Options problem_options;
  problem_options.evaluation_callback = &shared_;
  ceres::Problem problem(problem_options);
  pose(problem);
  const bool converged = descend(problem);
  shared_.PrepareForEvaluation(true, true);
  auto end = ended();
  if (end) end->converged = converged;
  return end;
}

}  // namespace

std::optional<ChainEnd> solve_chain(const NominalChain& nominal,
                                    const std::vector<ChainParameter>& parameters,
                                    const ChainSession& session,
                                    const ChainEstimatorSettings& settings,
                                    const Eigen::VectorXd& start, const ChainWay& way) {
  return ChainSolve(nominal, parameters, session, settings, way).from(start);
}

}  // namespace vitreo::optics::detail
