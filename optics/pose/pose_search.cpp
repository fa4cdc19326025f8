// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/pose_search.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace vitreo::optics::detail {
namespace {

/// Known orientation or size within a sigma are free too, with that knowledge as a residual.
FreeParameters free_parameters(const ObjectPoseSettings& settings) {
  FreeParameters free{0, 1, 2};
  if (settings.rotate || std::isfinite(settings.orientation_sigma))
    free.insert(free.end(), {3, 4, 5});
  if (settings.scale_sigma > 0) free.push_back(6);
  return free;
}

constexpr Eigen::Index kAboutAxis = 5;  // of the free parameters, where the body may rotate

constexpr double kTilt = 0.35;  // rad, of starts away from what was found

/// The logarithm of a rotation, rad; its length lies between 0 and pi.
Eigen::Vector3d rotation_vector(const Eigen::Matrix3d& rotation) {
  const Eigen::AngleAxisd turn(rotation);
  return turn.angle() * turn.axis();
}

/// The point of a line at a height.
Eigen::Vector3d on_line(const Ray& line, double z) {
  return line.origin + (z - line.origin.z()) / line.direction.z() * line.direction;
}

/// The smallest rotation vector, in the frame of `from`, that brings a body of this symmetry into
/// the same attitude as `to`. about_z: only the axes count, and their sense does not.
/// half_turns: of the four attitudes that a half-turn about an axis of the body makes equal, the
/// nearest counts.
Eigen::Vector3d difference(const Eigen::Matrix3d& from, const Eigen::Matrix3d& to,
                           Symmetry symmetry) {
  if (symmetry == Symmetry::about_z) {
    Eigen::Vector3d there = from.transpose() * to.col(2);
    if (there.z() < 0) there = -there;
    const Eigen::Vector3d across = Eigen::Vector3d::UnitZ().cross(there);
    const double sine = across.norm();
    return sine > 0 ? Eigen::Vector3d(across * (std::atan2(sine, there.z()) / sine))
                    : Eigen::Vector3d(0, 0, 0);
  }
  Eigen::Vector3d least = rotation_vector(from.transpose() * to);
  if (symmetry == Symmetry::none) return least;
  for (int axis = 0; axis < 3; ++axis) {
    Eigen::Vector3d flip(-1, -1, -1);
    flip[axis] = 1;
    const Eigen::Vector3d other = rotation_vector(from.transpose() * to * flip.asDiagonal());
    if (other.norm() < least.norm()) least = other;
  }
  return least;
}

/// The 24 rotations of the cube, or the first six that half-turns do not turn into each other
/// (three for a body round about z); all of them oblique, since gradients vanish by symmetry where
/// a body is aligned with the line of sight.
/// Few and far apart; the mirrored and tilted starts that follow cover what lies between.
std::vector<Eigen::Matrix3d> orientations(Symmetry symmetry) {
  const Eigen::Matrix3d oblique =
      Eigen::AngleAxisd(0.6, Eigen::Vector3d(1, 2, -1.5).normalized()).toRotationMatrix();
  const int orders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}};
  std::vector<Eigen::Matrix3d> made;
  for (int signs = 0; signs < (symmetry == Symmetry::none ? 4 : 1); ++signs) {
    for (int i = 0; i < (symmetry == Symmetry::about_z ? 3 : 6); ++i) {
      Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
      for (int column = 0; column < 3; ++column) turn(orders[i][column], column) = 1;
      if (signs & 1) turn.col(0) *= -1;
      if (signs & 2) turn.col(1) *= -1;
      if (turn.determinant() < 0) turn.col(2) *= -1;
      made.push_back(oblique * turn);
    }
  }
  return made;
}

/// An end of the solver, and what it leaves of the measurement: rms of the plain differences, px.
struct Explanation : Minimum {
  double residual_px = 0;
};

/// One search. Settings, measurement and start are borrowed for the call; minima_ has the distinct
/// minima in the order in which they were found, unfinished_ the best end that did not converge,
/// which is reported only when there is no other.
class Search {
 public:
  Search(const ObjectPoseSettings& settings, const Measurement& measured, const PoseStart& start)
      : settings_(settings),
        measured_(measured),
        start_(start),
        camera_(settings.projection, settings.exact, settings.image),
        free_(free_parameters(settings)),
        rotates_(free_.size() > 3 && free_[3] == 3) {}

  ObjectPose run();

 private:
  std::optional<Eigen::VectorXd> residuals(const BodyState& state,
                                           Eigen::MatrixXd* per_state) const;
  Eigen::Vector3d prior_weights() const;
  Eigen::Vector3d prior_terms(const Eigen::Matrix3d& orientation) const;
  void whiten(Eigen::VectorXd& terms, Eigen::MatrixXd* per_state) const;
  double depth_of_size(const Ray& sight, const Eigen::Matrix3d& orientation) const;
  std::vector<Eigen::Vector3d> start_positions(const Eigen::Matrix3d& orientation) const;
  std::vector<BodyState> starts() const;
  std::optional<BodyState> mirrored(const BodyState& state) const;
  std::vector<BodyState> tilted(const BodyState& state) const;
  std::vector<BodyState> rolled(const BodyState& state) const;
  std::vector<BodyState> scanned(const BodyState& state) const;
  bool hopeful(double cost) const;
  std::optional<Explanation> explained(const BodyState& start);
  void follow(const BodyState& start);
  void follow_starts(bool tilts);
  Eigen::VectorXd step_between(const BodyState& a, const BodyState& b, Symmetry symmetry) const;
  std::optional<Minimum> held_at(const Minimum& minimum, const Eigen::VectorXd& direction,
                                 double sigma, double far, const BodyState& start) const;
  double widened(const Minimum& minimum, const Eigen::VectorXd& direction, double sigma) const;
  struct Turned {
    double turn;  // rad, about the body's axis, from a minimum
    Minimum best;
  };
  std::vector<Turned> turned_about_axis(const Explanation& minimum, double sigma) const;
  Eigen::MatrixXd sampled_covariance(const Explanation& minimum,
                                     const Eigen::MatrixXd& covariance) const;
  bool same(const Minimum& a, const Minimum& b) const;
  PoseCandidate candidate(const Explanation& minimum) const;

  const ObjectPoseSettings& settings_;
  const Measurement& measured_;
  const PoseStart& start_;
  ProjectionModel camera_;
  FreeParameters free_;
  bool rotates_;
  std::vector<Explanation> minima_;
  std::optional<Explanation> unfinished_;
  double widening_ = 1;  // of the measurement's tail
};

/// Differences as independent terms of unit variance, and with them their derivatives. Beyond the
/// tail k a term r becomes k sqrt(2 (sqrt(1 + (r/k)^2) - 1)), whose square grows linearly.
void Search::whiten(Eigen::VectorXd& terms, Eigen::MatrixXd* per_state) const {
  const bool derived = per_state && per_state->rows() > 0;
  if (measured_.weights.size() > 0) {
    terms = terms.cwiseProduct(measured_.weights).eval();
    if (derived) *per_state = measured_.weights.asDiagonal() * *per_state;
  } else {
    terms = (measured_.root * terms).eval();
    if (derived) *per_state = (measured_.root * *per_state).eval();
  }
  if (!std::isfinite(measured_.tail)) return;
  const double k = measured_.tail * widening_;
  for (Eigen::Index i = 0; i < terms.size(); ++i) {
    const double r = terms[i];
    const double bent = std::sqrt(1 + r * r / (k * k));
    // Equal to the above, without its cancellation at zero.
    const double factor = std::sqrt(2 / (1 + bent));
    terms[i] = r * factor;
    if (derived) per_state->row(i) *= 1 / (bent * factor);
  }
}

/// The inverse of the right Jacobian of the rotation group: how the rotation vector phi of R
/// changes when R is multiplied by a small rotation from the right (Sola et al. 2018, eq. 144).
Eigen::Matrix3d inverse_right_jacobian(const Eigen::Vector3d& phi) {
  const double angle = phi.norm();
  Eigen::Matrix3d cross;
  cross << 0, -phi.z(), phi.y(), phi.z(), 0, -phi.x(), -phi.y(), phi.x(), 0;
  constexpr double kSmall = 1e-4;  // rad: below, the factor is its limit 1/12
  const double factor =
      angle < kSmall
          ? 1.0 / 12
          : (1 - angle / 2 * std::cos(angle / 2) / std::sin(angle / 2)) / (angle * angle);
  return Eigen::Matrix3d::Identity() + cross / 2 + factor * cross * cross;
}

/// 1/rad, about each of the body's axes.
Eigen::Vector3d Search::prior_weights() const {
  const double sigma = settings_.orientation_sigma;
  return {1 / sigma, 1 / sigma, 1 / settings_.roll_sigma.value_or(sigma)};
}

/// What is known of the orientation beforehand, as terms of unit variance; zero where nothing is.
Eigen::Vector3d Search::prior_terms(const Eigen::Matrix3d& orientation) const {
  if (!std::isfinite(settings_.orientation_sigma)) return Eigen::Vector3d::Zero();
  return prior_weights().cwiseProduct(
      rotation_vector(start_.orientation->transpose() * orientation));
}

/// Whitened residuals of the measurement, then of the prior knowledge: the orientation as a
/// rotation vector and the logarithm of the size, each over its sigma.
/// Nothing where the body has no image.
std::optional<Eigen::VectorXd> Search::residuals(const BodyState& state,
                                                 Eigen::MatrixXd* per_state) const {
  Eigen::MatrixXd derivatives;
  auto seen = measured_.difference_px(state, per_state ? &derivatives : nullptr);
  if (!seen) return std::nullopt;
  whiten(*seen, &derivatives);
  const bool oriented = std::isfinite(settings_.orientation_sigma);
  const bool sized = settings_.scale_sigma > 0;
  const bool derived = per_state && derivatives.rows() > 0;
  const Eigen::Index own = seen->size();
  Eigen::VectorXd all(own + (oriented ? 3 : 0) + (sized ? 1 : 0));
  all.head(own) = *seen;
  if (derived) {
    per_state->setZero(all.size(), 7);
    per_state->topRows(own) = derivatives;
  }
  if (oriented) {
    all.segment<3>(own) = prior_terms(state.orientation);
    if (derived) {
      const Eigen::Vector3d turn =
          rotation_vector(start_.orientation->transpose() * state.orientation);
      per_state->block<3, 3>(own, 3) = prior_weights().asDiagonal() * inverse_right_jacobian(turn);
    }
  }
  // Not known at all (an infinite sigma) counts as a factor of e, so that size and depth cannot run
  // away together.
  if (sized) {
    const double sigma = std::fmin(settings_.scale_sigma, 1);
    all.tail<1>()[0] = std::log(state.scale) / sigma;
    if (derived) (*per_state)(all.size() - 1, 6) = 1 / sigma;
  }
  return all;
}

/// z on a line of sight where the body would show the observed size. The size goes with the inverse
/// of the distance from the viewpoint, nearly: each step solves that proportion.
double Search::depth_of_size(const Ray& sight, const Eigen::Matrix3d& orientation) const {
  constexpr int kSteps = 12;
  constexpr double kNear = 50e-6;  // m; a start need be no better
  constexpr double kTop = 0.999;   // of the highest place
  double z = camera_.max_z() / 2;
  for (int i = 0; i < kSteps && measured_.size > 0; ++i) {
    const Eigen::Vector3d place = on_line(sight, z);
    const auto shown = measured_.size_px({place, orientation, 1});
    const auto viewpoint = camera_.viewpoint(place);
    double next = z / 2;  // beyond the projection it is too near
    if (shown && viewpoint) next = viewpoint->z() - (viewpoint->z() - z) * *shown / measured_.size;
    next = std::clamp(next, -settings_.behind_retina, kTop * camera_.max_z());
    if (std::abs(next - z) < kNear) return next;
    z = next;
  }
  return z;
}

/// Start positions: on the line of sight of the observed center, where the body would show the
/// observed size, and 3 mm before and behind it.
/// A caller's own position comes alone. Without an observed size, as of one point, the middle of
/// the range is the guess.
std::vector<Eigen::Vector3d> Search::start_positions(const Eigen::Matrix3d& orientation) const {
  constexpr double kAside = 3e-3;
  if (start_.position_in_eye) return {*start_.position_in_eye};
  const auto sight = camera_.line_of_sight(measured_.center_px);
  if (!sight) return {};
  const double guess = depth_of_size(*sight, orientation);
  std::vector<Eigen::Vector3d> made{on_line(*sight, guess)};
  for (const double z : {guess - kAside, guess + kAside}) {
    if (z > -settings_.behind_retina && z < camera_.max_z()) made.push_back(on_line(*sight, z));
  }
  return made;
}

/// Every start orientation with its start positions.
/// A known orientation leaves the depth as the doubt, hence all its start positions; unknown ones
/// get the middle position each.
std::vector<BodyState> Search::starts() const {
  const auto turns = start_.orientation ? std::vector<Eigen::Matrix3d>{*start_.orientation}
                                        : orientations(measured_.symmetry);
  std::vector<BodyState> made;
  for (const Eigen::Matrix3d& turn : turns) {
    const auto there = start_positions(turn);
    // Many orientations are enough variety.
    const std::size_t count =
        turns.size() > 1 ? std::min<std::size_t>(1, there.size()) : there.size();
    for (std::size_t i = 0; i < count; ++i) made.push_back({there[i], turn, 1});
  }
  return made;
}

/// The other pose of a weak-perspective projection: seen from afar, a body and its mirror image in
/// the plane across the line of sight look the same (Necker reversal; Schweighofer & Pinz 2006 for
/// planar targets). I - 2 w w^T mirrors across the line of sight, I - 2 n n^T maps the body onto
/// itself.
/// Both mirrorings together are a rotation again, so the result is a proper attitude. None where
/// the prior of the orientation rules it out; else the equal attitude that is nearest to that
/// prior.
std::optional<BodyState> Search::mirrored(const BodyState& state) const {
  constexpr double kFar = 25;  // of chi^2 by the prior
  const auto viewpoint = camera_.viewpoint(state.position);
  if (!viewpoint) return std::nullopt;
  const Eigen::Vector3d w = (*viewpoint - state.position).normalized();
  const Eigen::Vector3d n = measured_.mirror;
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - 2 * w * w.transpose();
  const Eigen::Matrix3d own = Eigen::Matrix3d::Identity() - 2 * n * n.transpose();
  const Eigen::Matrix3d orientation = across * state.orientation * own;
  if (!std::isfinite(settings_.orientation_sigma))
    return BodyState{state.position, orientation, state.scale};
  const Eigen::Matrix3d& believed = *start_.orientation;
  const Eigen::Vector3d turn = difference(believed, orientation, measured_.symmetry);
  if (prior_weights().cwiseProduct(turn).squaredNorm() > kFar) return std::nullopt;
  const Eigen::Matrix3d back =
      Eigen::AngleAxisd(turn.norm(), turn.stableNormalized()).toRotationMatrix();
  return BodyState{state.position, believed * back, state.scale};
}

/// Starts tilted away from the attitude across the line of sight, where the image is stationary in
/// the tilt.
/// None where the axis points along the line of sight to within 0.1: the direction in which to tilt
/// is undefined there.
std::vector<BodyState> Search::tilted(const BodyState& state) const {
  const auto viewpoint = camera_.viewpoint(state.position);
  if (!viewpoint) return {};
  const Eigen::Vector3d w = (*viewpoint - state.position).normalized();
  const Eigen::Vector3d across = w.cross(Eigen::Vector3d(state.orientation.col(2)));
  if (!(across.norm() > 0.1)) return {};
  std::vector<BodyState> made;
  for (const double tilt : {-kTilt, kTilt}) {
    made.push_back(
        {state.position,
         Eigen::AngleAxisd(tilt, across.normalized()).toRotationMatrix() * state.orientation,
         state.scale});
  }
  return made;
}

/// The twins of a turn about the body's own axis: its mirror images in the plane of that axis and
/// the line of sight, which shows them alike. The body is its own mirror image in the planes across
/// its x and y, crossed plates also in those between. Only where the prior of the orientation
/// leaves them possible: nothing else would decide for or against them. Not of two ellipsoids that
/// cross, which are followed from frame to frame by where they were.
std::vector<BodyState> Search::rolled(const BodyState& state) const {
  constexpr double kFar = 25;  // of chi^2 by the prior
  const auto viewpoint = camera_.viewpoint(state.position);
  if (!viewpoint || measured_.symmetry != Symmetry::half_turns || settings_.object.crossed)
    return {};
  const Eigen::Vector3d w = (*viewpoint - state.position).normalized();
  const Eigen::Vector3d aside = w.cross(Eigen::Vector3d(state.orientation.col(2)));
  if (!(aside.norm() > 0.1)) return {};  // seen along its axis a turn about it is seen as such
  const Eigen::Vector3d m = aside.normalized();
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - 2 * m * m.transpose();
  std::vector<BodyState> made;
  for (const Eigen::Vector3d& normal : {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0),
                                        Eigen::Vector3d(1, 1, 0), Eigen::Vector3d(1, -1, 0)}) {
    const Eigen::Matrix3d own =
        Eigen::Matrix3d::Identity() - 2 / normal.squaredNorm() * normal * normal.transpose();
    const BodyState other{state.position, across * state.orientation * own, state.scale};
    if (prior_terms(other.orientation).squaredNorm() < kFar) made.push_back(other);
  }
  return made;
}

/// Starts for a body that is round about its z: all tilts against the line of sight, towards the
/// direction in which it lies in `state` and across, at the depth where the size fits; those that
/// fit better than their neighbors. A short cylinder shows one ellipse at two tilts that are nearer
/// to each other than any few starts are.
/// Costs are of the start positions, without a minimization: a scan is cheap, and its minima are
/// followed like other starts.
std::vector<BodyState> Search::scanned(const BodyState& state) const {
  constexpr int kTilts = 24;  // of half a turn: 7.5 degrees
  const auto viewpoint = camera_.viewpoint(state.position);
  if (!viewpoint) return {};
  const Eigen::Vector3d w = (*viewpoint - state.position).normalized();
  const Eigen::Vector3d axis = state.orientation.col(2);
  Eigen::Vector3d aside = axis - axis.dot(w) * w;
  if (!(aside.norm() > 0.01)) aside = w.unitOrthogonal();
  aside.normalize();
  std::vector<BodyState> made;
  for (const Eigen::Vector3d& towards : {aside, Eigen::Vector3d(w.cross(aside))}) {
    std::array<std::optional<BodyState>, kTilts> seen;
    std::array<double, kTilts> cost;
    cost.fill(std::numeric_limits<double>::infinity());
    for (int i = 0; i < kTilts; ++i) {
      const double tilt = std::numbers::pi * (i + 0.5) / kTilts;
      const Eigen::Matrix3d turn = orientation_along(std::cos(tilt) * w + std::sin(tilt) * towards);
      const auto there = start_positions(turn);
      if (there.empty()) continue;
      seen[i] = BodyState{there.front(), turn, 1};
      const auto terms = residuals(*seen[i], nullptr);
      if (terms) cost[i] = terms->squaredNorm();
    }
    for (int i = 0; i < kTilts; ++i) {
      const double before = cost[(i + kTilts - 1) % kTilts];
      const double after = cost[(i + 1) % kTilts];
      if (std::isfinite(cost[i]) && cost[i] <= before && cost[i] <= after) made.push_back(*seen[i]);
    }
  }
  return made;
}

/// Logarithm of moved(): the step in the free parameters that leads from a to b.
/// In m, rad and the logarithm of the size, by the symmetry given: none where the way itself
/// counts.
Eigen::VectorXd Search::step_between(const BodyState& a, const BodyState& b,
                                     Symmetry symmetry) const {
  Eigen::VectorXd step(static_cast<Eigen::Index>(free_.size()));
  step.head<3>() = b.position - a.position;
  if (rotates_) step.segment<3>(3) = difference(a.orientation, b.orientation, symmetry);
  if (free_.back() == 6) step[step.size() - 1] = std::log(b.scale / a.scale);
  return step;
}

/// The best state, with its cost, that is `far` natural units along a direction from a minimum. The
/// distance is held by a penalty of 1e3 per sigma while the solver moves all else.
std::optional<Minimum> Search::held_at(const Minimum& minimum, const Eigen::VectorXd& direction,
                                       double sigma, double far, const BodyState& start) const {
  constexpr double kHeld = 1e3;
  const Eigen::VectorXd units = parameter_units(free_);
  const auto held = [&](const BodyState& state,
                        Eigen::MatrixXd* per_state) -> std::optional<Eigen::VectorXd> {
    const auto terms = residuals(state, per_state);
    if (!terms) return std::nullopt;
    Eigen::VectorXd all(terms->size() + 1);
    const Eigen::VectorXd step = step_between(minimum.state, state, Symmetry::none);
    all << *terms, kHeld / sigma * (direction.dot(step.cwiseQuotient(units)) - far);
    if (!per_state || per_state->rows() == 0) return all;
    per_state->conservativeResize(all.size(), Eigen::NoChange);
    per_state->bottomRows<1>().setZero();
    Eigen::Matrix<double, 1, 7> row = Eigen::Matrix<double, 1, 7>::Zero();
    row(free_) = kHeld / sigma * direction.cwiseQuotient(units);
    if (rotates_) row.segment<3>(3) *= inverse_right_jacobian(step.segment<3>(3));
    per_state->bottomRows<1>() = row;
    return all;
  };
  return minimize(held, free_, start);
}

/// Profile likelihood: the distance along a direction, every other parameter at its best, at which
/// chi^2 has grown by about 1; the distances tried are coarse, so 0.7 is enough. A valley that is
/// flatter than its bottom's curvature, as of a tilt near zero, has a larger sigma.
/// 1, a natural unit, means that the direction is not observed.
double Search::widened(const Minimum& minimum, const Eigen::VectorXd& direction,
                       double sigma) const {
  constexpr double kEnough = 0.7;
  constexpr double kFarther = 1.5;
  const Eigen::VectorXd units = parameter_units(free_);
  for (double far = sigma; far < 1; far *= kFarther) {
    const auto found = held_at(minimum, direction, sigma, far,
                               moved(minimum.state, free_, far * units.cwiseProduct(direction)));
    if (!found || found->cost > minimum.cost + kEnough) return far;
  }
  return 1;
}

/// Turns about the body's axis, in sigmas of the Jacobian, at which the posterior is sampled: dense
/// where it is smooth, and far enough to get over a kink whose one side is steep.
constexpr std::array<double, 7> kTurns{0.6, 1.3, 2.2, 3.5, 6, 10, 18};

/// The turns at which a pose is as likely as to count, from the minimum to one side and the other:
/// each with everything else at its best.
std::vector<Search::Turned> Search::turned_about_axis(const Explanation& minimum,
                                                      double sigma) const {
  constexpr double kUnlikely = 14;  // of chi^2
  const Eigen::VectorXd units = parameter_units(free_);
  const Eigen::VectorXd about = Eigen::VectorXd::Unit(units.size(), kAboutAxis);
  const double unit = units[kAboutAxis];
  const auto at = [&](double turn, const BodyState& start) {
    return held_at(minimum, about, sigma / unit, turn / unit, start);
  };
  std::vector<Turned> made;
  if (const auto middle = at(0, minimum.state)) made.push_back({0, *middle});
  for (const double side : {-1.0, 1.0}) {
    BodyState start = minimum.state;
    double last = 0;
    for (const double sigmas : kTurns) {
      const double turn = side * sigmas * sigma;
      if (std::abs(turn) > 4 * *settings_.roll_sigma) break;
      const auto found = at(turn, moved(start, free_, (turn - last) * about));
      if (!found) break;
      made.push_back({turn, *found});
      if (found->cost > minimum.cost + kUnlikely) break;
      start = found->state;
      last = turn;
    }
  }
  std::sort(made.begin(), made.end(),
            [](const Turned& a, const Turned& b) { return a.turn < b.turn; });
  return made;
}

/// Covariance about the minimum from the posterior over the turn about the body's own axis,
/// sampled, everything else normal at each turn (Laplace):
///   C = sum w (C_turn + step step') / sum w,   w = exp(-chi^2 / 2) sqrt(det C_turn) d(turn).
/// Plates that lie face on are the narrowest at one turn and wider on both sides of it: a kink, of
/// which the derivatives at the minimum know one side. Empty where it cannot be had.
Eigen::MatrixXd Search::sampled_covariance(const Explanation& minimum,
                                           const Eigen::MatrixXd& covariance) const {
  const double believed = *settings_.roll_sigma;
  const double sigma =
      std::clamp(std::sqrt(covariance(kAboutAxis, kAboutAxis)), 0.02 * believed, believed);
  const std::vector<Turned> turned = turned_about_axis(minimum, sigma);
  if (turned.size() < 3) return {};
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(covariance.rows(), covariance.cols());
  double weights = 0;
  double first_root = 0;
  for (std::size_t i = 0; i < turned.size(); ++i) {
    const Eigen::MatrixXd& jacobian = turned[i].best.jacobian;
    const Eigen::LDLT<Eigen::MatrixXd> information(jacobian.transpose() * jacobian);
    if (!information.isPositive()) return {};
    // 1 / sqrt(det), against overflow over that of the first.
    const double root = information.vectorD().array().log().sum() / 2;
    if (i == 0) first_root = root;
    const double before = turned[i == 0 ? 0 : i - 1].turn;
    const double after = turned[std::min(i + 1, turned.size() - 1)].turn;
    const double weight =
        std::exp((minimum.cost - turned[i].best.cost) / 2 + first_root - root) * (after - before);
    const Eigen::VectorXd step = step_between(minimum.state, turned[i].best.state, Symmetry::none);
    const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(covariance.rows(), covariance.cols());
    sum += weight * (information.solve(one) + step * step.transpose());
    weights += weight;
  }
  sum = (sum / weights).eval();
  return sum.allFinite() ? sum : Eigen::MatrixXd{};
}

/// Half a sigma by both Jacobians, or equal to rounding.
/// So near, the measurement cannot tell them apart. Both must agree: where one valley is flat, the
/// other may still be steep.
bool Search::same(const Minimum& a, const Minimum& b) const {
  constexpr double kApart = 0.5;  // sigma
  const Eigen::VectorXd step = step_between(a.state, b.state, measured_.symmetry);
  if (step.head<3>().norm() < 1e-7 && step.tail(step.size() - 3).norm() < 1e-4) return true;
  return (a.jacobian * step).norm() < kApart && (b.jacobian * step).norm() < kApart;
}

/// Whether an end is so near to the best one in chi^2 that what is left of the way to its minimum,
/// or what its mirror image leads to, may be an answer.
bool Search::hopeful(double cost) const {
  constexpr double kFar = 400;
  for (const Explanation& known : minima_)
    if (known.cost + kFar < cost) return false;
  return true;
}

/// The solver's end from a start. The fit of an ellipse starts from that of a neighboring pose, and
/// may succeed on the way and fail at the same pose on its own: that end is none.
std::optional<Explanation> Search::explained(const BodyState& start) {
  constexpr double kWide = 10;  // from afar all of an outline lies in its tails
  const BodyResiduals terms = [this](const BodyState& state, Eigen::MatrixXd* per_state) {
    return residuals(state, per_state);
  };
  std::optional<Minimum> found;
  if (std::isfinite(measured_.tail)) {
    widening_ = kWide;
    found = minimize(terms, free_, start, true);
    widening_ = 1;
    if (!found) return std::nullopt;
  }
  found = minimize(terms, free_, found ? found->state : start, true);
  if (!found) return std::nullopt;
  if (!found->converged && hopeful(found->cost)) {
    if (const auto better = minimize(terms, free_, found->state)) found = better;
  }
  Explanation made{*found, std::numeric_limits<double>::infinity()};
  const auto plain = measured_.difference_px(found->state, nullptr);
  if (plain)
    made.residual_px = std::sqrt(plain->squaredNorm() / static_cast<double>(plain->size()));
  else
    made.converged = false;
  return made;
}

/// Minimizes from a start and keeps the minimum, or the better of two that are the same.
/// A start without an image, or an end outside the projection, leaves nothing behind.
void Search::follow(const BodyState& start) {
  const auto found = explained(start);
  if (!found) return;
  if (!found->converged) {
    if (!unfinished_ || found->cost < unfinished_->cost) unfinished_ = *found;
    return;
  }
  if (!camera_.inside(found->state.position, settings_.behind_retina)) return;
  for (Explanation& known : minima_) {
    if (!same(known, *found)) continue;
    if (found->cost < known.cost) known = *found;
    return;
  }
  minima_.push_back(*found);
}

/// Covariance of the free parameters, written into the full 7 x 7 matrix.
/// A pose that did not converge has a position but no covariance: infinite variances.
PoseCandidate Search::candidate(const Explanation& minimum) const {
  PoseCandidate made;
  made.pose = {minimum.state.position, minimum.state.orientation};
  made.scale = minimum.state.scale;
  made.chi2 = minimum.cost;
  made.iterations = minimum.iterations;
  made.residual_px = minimum.residual_px;
  if (!minimum.converged) {
    for (const int i : free_) made.covariance(i, i) = std::numeric_limits<double>::infinity();
    return made;
  }
  const Observed seen =
      observed_from(minimum.jacobian, free_, [&](const Eigen::VectorXd& direction, double sigma) {
        return std::fmax(widened(minimum, direction, sigma), widened(minimum, -direction, sigma));
      });
  made.covariance(free_, free_) = seen.covariance;
  const bool plates = measured_.symmetry == Symmetry::half_turns && !settings_.object.crossed;
  if (plates && rotates_ && settings_.roll_sigma && seen.unobservable.cols() == 0) {
    const Eigen::MatrixXd sampled = sampled_covariance(minimum, seen.covariance);
    if (sampled.size() > 0) made.covariance(free_, free_) = sampled;
  }
  for (Eigen::Index i = 0; i < seen.unobservable.cols(); ++i) {
    Eigen::Matrix<double, 7, 1> direction = Eigen::Matrix<double, 7, 1>::Zero();
    direction(free_) = seen.unobservable.col(i);
    made.unobservable.push_back(direction);
  }
  return made;
}

/// Every start, with tilted attitudes of one whose orientation is known loosely.
void Search::follow_starts(bool tilts) {
  constexpr double kExplained = 6;  // chi^2, of two degrees of freedom: 95 % of right ellipses
  // With its orientation known a body grows in the image all the way to the lens: a depth that
  // explains the size is the only one, and the starts before and behind it would find it again.
  const bool one_depth = measured_.size > 0 && start_.orientation && !tilts;
  for (const BodyState& start : starts()) {
    if (one_depth && !minima_.empty() && minima_.front().cost < kExplained) return;
    follow(start);
    if (!tilts || !start_.orientation) continue;
    for (const BodyState& other : tilted(start)) follow(other);
  }
}

/// All starts, then for each minimum found its mirror image and tilted attitudes. Candidates are
/// the minima whose chi^2 is within equal_chi2 of the best.
/// At most kMost minima are expanded: each may bring three others.
ObjectPose Search::run() {
  constexpr std::size_t kMost = 12;
  // sigma of what is known of the orientation: a tilted start would end where it is
  constexpr double kFarOff = 5;
  const bool tilts = rotates_ && !(settings_.orientation_sigma * kFarOff < kTilt);
  follow_starts(tilts);
  if (settings_.rotate && !start_.orientation && measured_.symmetry == Symmetry::about_z &&
      !minima_.empty()) {
    const auto best = std::min_element(
        minima_.begin(), minima_.end(),
        [](const Explanation& a, const Explanation& b) { return a.cost < b.cost; });
    for (const BodyState& other : scanned(best->state)) follow(other);
  }
  // By index: minima found this way are expanded in their turn. A short cylinder has four poses
  // with the same ellipse.
  for (std::size_t i = 0; rotates_ && i < std::min(minima_.size(), kMost); ++i) {
    if (!hopeful(minima_[i].cost)) continue;
    const BodyState found = minima_[i].state;
    if (const auto other = mirrored(found)) follow(*other);
    for (const BodyState& other : rolled(found)) follow(other);
    if (!tilts) continue;
    for (const BodyState& other : tilted(found)) follow(other);
  }
  ObjectPose pose;
  if (minima_.empty()) {
    if (!unfinished_) return pose;
    return {PoseStatus::not_converged, {candidate(*unfinished_)}};
  }
  std::sort(minima_.begin(), minima_.end(),
            [](const Explanation& a, const Explanation& b) { return a.cost < b.cost; });
  for (const Explanation& minimum : minima_) {
    if (minimum.cost <= minima_.front().cost + settings_.equal_chi2)
      pose.candidates.push_back(candidate(minimum));
  }
  pose.status = pose.candidates.size() > 1 ? PoseStatus::ambiguous : PoseStatus::found;
  if (!(pose.candidates.front().residual_px <= settings_.max_residual_px))
    pose.status = PoseStatus::misfit;
  return pose;
}

}  // namespace

ObjectPose search_pose(const ObjectPoseSettings& settings, const Measurement& measured,
                       const PoseStart& start) {
  return Search(settings, measured, start).run();
}

}  // namespace vitreo::optics::detail
