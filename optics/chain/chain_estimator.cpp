// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_estimator.h"

#include "optics/chain/chain_solve.h"
#include "optics/numerics/chi_square.h"
#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

using detail::ChainEnd;

constexpr double kFalseAlarms = 0.005;  // of right sessions, as of right ellipses (kMisfitChi2)

/// Where a solve starts, and what it keeps there at first.
struct Start {
  Eigen::VectorXd theta;
  detail::ChainWay way;
};

std::vector<int> rotations(const std::vector<ChainParameter>& parameters) {
  std::vector<int> found;
  for (std::size_t i = 0; i < parameters.size(); ++i)
    if (parameters[i].name.starts_with("eye_rotation")) found.push_back(static_cast<int>(i));
  return found;
}

/// The nominal eye, and turned along x and y both ways; then along both at once. A start turned by
/// 1.2 sigma is beyond the ridge between the twins and still within what is likely.
std::vector<Start> starts_of(const std::vector<ChainParameter>& parameters, double turn) {
  const auto turned = rotations(parameters);
  std::vector<Start> starts{
      {Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters.size())), {}}};
  const Eigen::VectorXd zero = starts.front().theta;
  for (const int i : turned) {
    for (const double sign : {1.0, -1.0}) {
      starts.push_back({zero, {turned}});
      starts.back().theta[i] = sign * turn;
    }
  }
  if (turned.size() != 2) return starts;
  for (const double x : {1.0, -1.0}) {
    for (const double y : {1.0, -1.0}) {
      starts.push_back({zero, {turned}});
      starts.back().theta[turned[0]] = x * turn;
      starts.back().theta[turned[1]] = y * turn;
    }
  }
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

/// Everything that the search for the minima of one session shares.
class SessionSearch {
 public:
  SessionSearch(const NominalChain& nominal, const ChainSigmas& sigmas, const ChainSession& session,
                const ChainEstimatorSettings& settings)
      : nominal_(nominal),
        session_(session),
        settings_(settings),
        parameters_(chain_parameters(nominal, sigmas)),
        degrees_(degrees_of(session)),
        limit_(detail::chi_square_limit(std::max(degrees_, 1), kFalseAlarms)) {}

  ChainEstimate run();

 private:
  std::optional<ChainEnd> solved(const ChainSession& session, const Start& start) const {
    return detail::solve_chain(nominal_, parameters_, session, settings_, start.theta, start.way);
  }
  bool fits() const {
    return !ends_.empty() && ends_.front().converged && ends_.front().minimum.chi2 <= limit_;
  }
  void follow(const Start& start);
  std::vector<LookMisfit> outliers() const;
  ChainEstimate made() const;

  const NominalChain& nominal_;
  const ChainSession& session_;
  const ChainEstimatorSettings& settings_;
  std::vector<ChainParameter> parameters_;
  int degrees_;
  double limit_;
  std::vector<ChainEnd> ends_;  // distinct; at rest before not, then the best first
  std::vector<LookMisfit> outliers_;
  int ended_ = 0;
};

void SessionSearch::follow(const Start& start) {
  auto end = solved(session_, start);
  if (!end) return;
  ended_ += end->converged ? 1 : 0;
  const auto better = [](const ChainEnd& a, const ChainEnd& b) {
    return a.converged != b.converged ? a.converged : a.minimum.chi2 < b.minimum.chi2;
  };
  const auto same = std::find_if(ends_.begin(), ends_.end(), [&](const ChainEnd& one) {
    return alike(one.minimum, end->minimum);
  });
  if (same == ends_.end())
    ends_.push_back(std::move(*end));
  else if (better(*end, *same))
    *same = std::move(*end);
  std::sort(ends_.begin(), ends_.end(), better);
}

/// By a solve that counts looks by Cauchy's loss, in which a wrong one hardly bends the chain:
/// those that are worse than the worst of so many right ones, provided that the rest then fits.
std::vector<LookMisfit> SessionSearch::outliers() const {
  constexpr double kScale = 4;  // a right look's chi2 is 2 to 5, which then counts nearly whole
  Start start = starts_of(parameters_, 0).front();
  start.way.robust = kScale;
  const auto end = solved(session_, start);
  if (!end) return {};
  std::vector<LookMisfit> found;
  ChainSession rest = session_;
  rest.looks.clear();
  for (std::size_t i = 0; i < session_.looks.size(); ++i) {
    const ChainLook& look = session_.looks[i];
    const int degrees = degrees_of({{look}, {}, {}});
    const double one = kFalseAlarms / static_cast<double>(session_.looks.size());
    if (end->look_chi2[i] > detail::chi_square_limit(degrees, one))
      found.push_back({i, end->look_chi2[i]});
    else
      rest.looks.push_back(look);
  }
  // A third of the looks are no exceptions.
  if (found.empty() || 3 * found.size() > session_.looks.size()) return {};
  const auto left = solved(rest, starts_of(parameters_, 0).front());
  const double limit = detail::chi_square_limit(std::max(degrees_of(rest), 1), kFalseAlarms);
  if (!left || !left->converged || left->minimum.chi2 > limit) return {};
  std::sort(found.begin(), found.end(),
            [](const LookMisfit& a, const LookMisfit& b) { return a.chi2 > b.chi2; });
  return found;
}

ChainEstimate SessionSearch::made() const {
  const ChainEnd& best = ends_.front();
  std::vector<ChainMinimum> minima;
  for (const ChainEnd& one : ends_) {
    // A minimum that explains the session that much worse is no explanation.
    if (one.converged == best.converged &&
        one.minimum.chi2 <= best.minimum.chi2 + settings_.equal_chi2)
      minima.push_back(one.minimum);
  }
  const auto covariance = mixed_covariance(minima);
  ChainEstimate estimate{
      .belief = {ViewingChain(nominal_, parameters_, best.minimum.theta), covariance},
      .minima = std::move(minima),
      .chi2 = best.minimum.chi2,
      .degrees_of_freedom = degrees_,
      .places = best.places,
      .ended_starts = ended_,
      .chi2_limit = limit_};
  estimate.status = estimate.minima.size() > 1 ? SessionStatus::ambiguous : SessionStatus::found;
  if (!best.converged) estimate.status = SessionStatus::not_converged;
  // Where the rest fits without a few looks, it is they that kept the solver from its rest.
  if ((best.converged && !fits()) || !outliers_.empty()) estimate.status = SessionStatus::misfit;
  estimate.outliers = outliers_;
  return estimate;
}

ChainEstimate SessionSearch::run() {
  const auto all = starts_of(parameters_, settings_.start_rotation);
  const auto usual = std::min(all.size(), static_cast<std::size_t>(std::max(1, settings_.starts)));
  for (std::size_t i = 0; i < usual; ++i) follow(all[i]);
  if (!fits()) outliers_ = outliers();
  for (std::size_t i = usual; i < all.size() && !fits() && outliers_.empty(); ++i) follow(all[i]);
  if (ends_.empty())
    throw std::invalid_argument("session: no chain within the priors shows all of its looks");
  return made();
}

}  // namespace

const char* to_string(SessionStatus status) {
  switch (status) {
    case SessionStatus::found:
      return "found";
    case SessionStatus::ambiguous:
      return "ambiguous";
    case SessionStatus::misfit:
      return "misfit";
    case SessionStatus::not_converged:
      return "not_converged";
  }
  return "unknown";
}

ChainEstimate estimate_chain(const NominalChain& nominal, const ChainSigmas& sigmas,
                             const ChainSession& session, const ChainEstimatorSettings& settings) {
  return SessionSearch(nominal, sigmas, session, settings).run();
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
