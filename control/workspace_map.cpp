// The largest scale of each direction's least-norm currents within the limits, and the worst of the
// directions.
// SPDX-License-Identifier: Apache-2.0
#include "control/workspace_map.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::control {
namespace {

// Half of the 26 neighbors of a cube: the opposite of each costs the same but for the field held.
std::vector<Eigen::Vector3d> directions() {
  std::vector<Eigen::Vector3d> list;
  for (int k = 14; k < 27; ++k) {
    list.push_back(Eigen::Vector3d(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1).normalized());
  }
  return list;
}

// The largest s with |fixed + s each| within the limits on both sides of it.
double scale_within(const Currents& fixed, const Currents& each, const CurrentLimits& limits) {
  double scale = std::numeric_limits<double>::infinity();
  for (Eigen::Index k = 0; k < fixed.size(); ++k) {
    const double room = limits[k] - std::abs(fixed[k]);
    if (room < 0) return 0;
    if (each[k] != 0) scale = std::min(scale, room / std::abs(each[k]));
  }
  return std::isfinite(scale) ? scale : 0;
}

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
  const Currents none = Currents::Zero(a.cols()), held = currents(request.field, {0, 0, 0});
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
  if (!low.allFinite() || !high.allFinite() || !(low.array() <= high.array()).all()) {
    throw std::invalid_argument("map: low must not be above high");
  }
  if (points.minCoeff() < 1 || points.maxCoeff() > 1000)
    throw std::invalid_argument("map points: 1 to 1000 an axis");
  if (!field.allFinite() || !(field.norm() > 0))
    throw std::invalid_argument("map field: must be finite and above 0 T");
}

std::vector<MapPoint> workspace_map(const FieldModel& model, const MapRequest& request) {
  request.check();
  std::vector<MapPoint> map;
  const Eigen::Vector3d span = request.high - request.low;
  for (int z = 0; z < request.points.z(); ++z) {
    for (int y = 0; y < request.points.y(); ++y) {
      for (int x = 0; x < request.points.x(); ++x) {
        const Eigen::Vector3d part = Eigen::Vector3d(x, y, z).cwiseQuotient(
            (request.points.array() - 1).max(1).matrix().cast<double>());
        const Eigen::Vector3d place = request.low + span.cwiseProduct(part);
        MapPoint point;
        point.condition = std::numeric_limits<double>::infinity();
        if (model.valid_at(place)) point = map_point(model.matrix(place), request);
        point.position = place;
        map.push_back(point);
      }
    }
  }
  return map;
}

}  // namespace vitreo::control
