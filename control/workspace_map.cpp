// SPDX-License-Identifier: Apache-2.0
#include "control/workspace_map.h"

#include "control/preconditions.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>

namespace vitreo::control {
namespace {

// Half of the 26 directions to the neighbors of a cube's cell, sampling the sphere at 35 to 45
// degrees: least-norm currents are linear, so the opposite direction has the same scale.
std::vector<Eigen::Vector3d> directions() {
  std::vector<Eigen::Vector3d> list;
  for (int k = 14; k < 27; ++k) {
    const Eigen::Vector3i cell(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
    list.push_back(cell.cast<double>().normalized());
  }
  return list;
}

// The largest s with |fixed +- s each| within the limits, both signs alike; 0 where `fixed` alone
// exceeds them.
// Directions come with their opposites, hence both signs.
double scale_within(const Currents& fixed, const Currents& each, const CurrentLimits& limits) {
  double scale = std::numeric_limits<double>::infinity();
  for (Eigen::Index k = 0; k < fixed.size(); ++k) {
    const double room = limits[k] - std::abs(fixed[k]);
    if (room < 0) return 0;
    if (each[k] != 0) scale = std::min(scale, room / std::abs(each[k]));
  }
  return std::isfinite(scale) ? scale : 0;
}

// At one position the least-norm currents I = A' (A A')^-1 w, in rows of field and of force over
// moment, scaled to the first limit: a lower bound of what a box-constrained solution could reach.
// A position where a degree of freedom is lost has neither field nor force, but an infinite
// condition.
MapPoint map_point(const FieldMatrix& matrix, const MapRequest& request) {
  MapPoint point;
  const Eigen::Vector3d axis = request.field.normalized();
  point.condition = condition_number(matrix, axis, request.limits);
  if (!std::isfinite(point.condition)) return point;
  Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::ColMajor, 6, kMaxCoils> a(6, matrix.cols());
  a << matrix.topRows<3>(), force_from_field(axis) * matrix;
  for (Eigen::Index k = 0; k < a.cols(); ++k) {
    if (request.limits[k] == 0) a.col(k).setZero();
  }
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> gram(a * a.transpose());
  const auto currents = [&](const Eigen::Vector3d& field, const Eigen::Vector3d& force) {
    Eigen::Matrix<double, 6, 1> w;
    w << field, force;
    return Currents(a.transpose() * gram.solve(w));
  };
  const Currents none = Currents::Zero(a.cols());
  const Currents held = currents(request.field, {0, 0, 0});
  point.field = point.force = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector3d& direction : directions()) {
    point.field =
        std::min(point.field, scale_within(none, currents(direction, {0, 0, 0}), request.limits));
    point.force =
        std::min(point.force, scale_within(held, currents({0, 0, 0}, direction), request.limits));
  }
  return point;
}

}  // namespace

void MapRequest::check() const {
  require(low.allFinite() && high.allFinite() && (low.array() <= high.array()).all(),
          "map: low must not be above high");
  require(points.minCoeff() >= 1 && points.maxCoeff() <= 1000, "map points: 1 to 1000 an axis");
  require(field.allFinite() && field.norm() > 0, "map field: must be finite and above 0 T");
}

// x fastest, then y, then z. Where the model does not hold the condition is infinite.
std::vector<MapPoint> workspace_map(const FieldModel& model, const MapRequest& request) {
  request.check();
  std::vector<MapPoint> map;
  const Eigen::Vector3d span = request.high - request.low;
  for (int z = 0; z < request.points.z(); ++z) {
    for (int y = 0; y < request.points.y(); ++y) {
      for (int x = 0; x < request.points.x(); ++x) {
        const Eigen::Vector3d part = Eigen::Vector3d(x, y, z).cwiseQuotient(
            (request.points.array() - 1).max(1).matrix().cast<double>());
        const Eigen::Vector3d position = request.low + span.cwiseProduct(part);
        MapPoint point;
        point.condition = std::numeric_limits<double>::infinity();
        if (model.valid_at(position)) point = map_point(model.matrix(position), request);
        point.position = position;
        map.push_back(point);
      }
    }
  }
  return map;
}

}  // namespace vitreo::control
