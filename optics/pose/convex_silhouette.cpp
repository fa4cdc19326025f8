// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/convex_silhouette.h"

#include "optics/numerics/linear.h"

#include <Eigen/Dense>

#include <cmath>
#include <numbers>

namespace vitreo::optics::detail {
namespace {

using Vector = Eigen::Vector3d;
constexpr double kTurn = 2 * std::numbers::pi;

/// Two unit vectors across `w`.
struct Across {
  Vector e1;
  Vector e2;
  // Crossed with the unit axis that is least along w, so that the product is never near zero.
  explicit Across(const Vector& w) {
    Eigen::Index least = 0;
    w.cwiseAbs().minCoeff(&least);
    e1 = w.cross(Vector(Vector::Unit(least))).normalized();
    e2 = w.cross(e1);
  }
  Vector at(double angle) const { return std::cos(angle) * e1 + std::sin(angle) * e2; }
};

/// A point of the outline. The plane that holds the viewpoint (far * w) and touches the body has
/// the normal n = c cos t + w sin t with h(n) = n . viewpoint, where h is the support function and
/// its gradient the point of contact. Safeguarded Newton; the equation is nearly far sin t = h.
/// The bracket 0 to pi/2 holds because the viewpoint is outside the body; a step that leaves it is
/// replaced by a halving.
Vector touching(const ObjectModel& body, const Vector& c, const Vector& w, double far) {
  constexpr int kSteps = 60;
  constexpr double kExact = 1e-9;  // rad; the outline moves by its square
  double low = 0;
  double high = std::numbers::pi / 2;
  double t = std::asin(std::fmin(1.0, body.support(c).dot(c) / far));
  Vector point(0, 0, 0);
  for (int i = 0; i < kSteps; ++i) {
    const double cosine = std::cos(t);
    const double sine = std::sin(t);
    const Vector n = cosine * c + sine * w;
    point = body.support(n);
    const double excess = point.dot(n) - far * sine;
    (excess > 0 ? low : high) = t;
    const double change = point.dot(cosine * w - sine * c) - far * cosine;
    double next = t - excess / change;
    if (!(next > low && next < high)) next = (low + high) / 2;
    if (std::abs(next - t) < kExact) break;
    t = next;
  }
  return point;
}

/// Where the ellipsoid is the unit sphere, s . s = 1 and s . (far w) = 1 hold on the outline: a
/// circle at height 1 / far along w.
/// `far` is the viewpoint's distance in units of the body's semi-axes along the line of sight;
/// points are in the same units.
std::vector<Vector> ellipsoid_outline(const Across& across, const Vector& w, double far,
                                      int count) {
  std::vector<Vector> points;
  points.reserve(static_cast<std::size_t>(count));
  const double sine = 1 / far;
  const double cosine = std::sqrt(1 - sine * sine);
  for (int i = 0; i < count; ++i)
    points.push_back(cosine * across.at(kTurn * i / count) + sine * w);
  return points;
}

/// Where the half-plane at `angle` round the line of sight cuts a closed polygon; `from` is the
/// edge to start at.
/// Half-planes are asked for in the order of their angle, so the next crossing is at the same edge
/// or soon behind it.
Vector cut(const std::vector<Vector>& polygon, const Across& across, double angle,
           std::size_t& from) {
  const Vector along = across.at(angle);
  const Vector side = across.at(angle + kTurn / 4);
  for (std::size_t tried = 0; tried <= polygon.size(); ++tried) {
    const Vector& a = polygon[from];
    const Vector& b = polygon[(from + 1) % polygon.size()];
    const double before = side.dot(a);
    const double after = side.dot(b);
    if (before <= 0 && after > 0 && along.dot(a + b) > 0)
      return a + (b - a) * (before / (before - after));
    from = (from + 1) % polygon.size();
  }
  return polygon[from];  // unreachable: the polygon goes round the line of sight
}

/// Points of contact for normals at equal angles make a polygon; the outline's points are its
/// crossings with half-planes at equal angles round the line of sight, as corners gather many
/// normals in one point.
std::vector<Vector> general_outline(const ObjectModel& body, const Across& across, const Vector& w,
                                    double far, int count) {
  constexpr int kNormals = 240;
  std::vector<Vector> polygon;
  std::vector<Vector> points;
  polygon.reserve(kNormals);
  points.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < kNormals; ++i)
    polygon.push_back(touching(body, across.at(kTurn * i / kNormals), w, far));
  std::size_t edge = 0;
  for (int i = 0; i < count; ++i) points.push_back(cut(polygon, across, kTurn * i / count, edge));
  return points;
}

/// Where the line from the viewpoint v = far w along -w + s c touches the ellipsoid p.S p = 1, the
/// largest such s and the point: tangency, (v.S d)^2 = (d.S d) (v.S v - 1), is
///   s^2 (far^2 B^2 - K C) - 2 s B + A = 0,  A = w.S w, B = w.S c, C = c.S c, K = v.S v - 1.
struct Tangent {
  double slope;
  Vector point;
};
Tangent tangent(const Vector& stretch, const Vector& c, const Vector& w, double far) {
  const double A = w.dot(stretch.cwiseProduct(w));
  const double B = w.dot(stretch.cwiseProduct(c));
  const double C = c.dot(stretch.cwiseProduct(c));
  const double K = far * far * A - 1;
  const double q = K * C - far * far * B * B;
  const double slope = (std::sqrt(B * B + q * A) - B) / q;
  const Vector d = slope * c - w;
  const Vector sd = stretch.cwiseProduct(d);
  return {slope, far * w - d * (far * w.dot(sd) / d.dot(sd))};
}

/// Of two ellipsoids that cross, at each angle round the line of sight the one that reaches farther
/// out. In the space in which the larger of a and b, and c, are 1.
std::vector<Vector> crossed_outline(const ObjectModel& body, const Vector& unit,
                                    const Across& across, const Vector& w, double far, int count) {
  const auto stretch_of = [&unit](const ObjectModel& one) -> Vector {
    return unit.cwiseQuotient(one.semi_axes).cwiseAbs2();
  };
  const Vector first = stretch_of(body);
  const Vector second = stretch_of(body.other());
  std::vector<Vector> points;
  for (int i = 0; i < count; ++i) {
    const Vector c = across.at(kTurn * i / count);
    const Tangent one = tangent(first, c, w, far);
    const Tangent two = tangent(second, c, w, far);
    points.push_back(one.slope > two.slope ? one.point : two.point);
  }
  return points;
}

/// Center and shape of the ellipse with the polygon's area moments, by Green's theorem as sums over
/// its edges. Of an ellipse with semi-axes a, b the second moments are a^2 / 4, b^2 / 4, hence the
/// factor 2 at the root.
/// False for a rim without area, or one so thin that its moments no longer tell its axes.
bool moments(const std::vector<Eigen::Vector2d>& rim, Eigen::Vector2d& center,
             Eigen::Matrix2d& shape) {
  const Eigen::Vector2d& origin = rim.front();
  double area = 0;
  Eigen::Vector2d first(0, 0);
  Eigen::Matrix2d second = Eigen::Matrix2d::Zero();
  for (std::size_t i = 0; i < rim.size(); ++i) {
    const Eigen::Vector2d a = rim[i] - origin;
    const Eigen::Vector2d b = rim[(i + 1) % rim.size()] - origin;
    const double part = (a.x() * b.y() - a.y() * b.x()) / 2;
    area += part;
    first += part / 3 * (a + b);
    second += part / 12 * ((a + b) * (a + b).transpose() + a * a.transpose() + b * b.transpose());
  }
  if (!(std::abs(area) > 0)) return false;
  center = first / area;
  const Eigen::Matrix2d spread = second / area - center * center.transpose();
  const double half_trace = spread.trace() / 2;
  const double largest = half_trace + std::hypot((spread(0, 0) - spread(1, 1)) / 2, spread(0, 1));
  if (!(spread.determinant() > 1e-12 * largest * largest))
    return false;  // least over largest eigenvalue
  shape = 2 * square_root(spread);
  center += origin;
  return true;
}

/// A rim point in coordinates in which the ellipse is the unit circle.
struct OnCircle {
  Eigen::Vector2d direction;  // unit: cosine and sine of its angle
  double length;
};

/// rad, between two unit vectors.
double angle_between(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return std::abs(std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b)));
}

/// Cauchy's weight of a distance in px, as the tracker's first rounds have it.
double counted(double off_px) {
  constexpr double kScale_px = 1;
  return 1 / (1 + off_px * off_px / (kScale_px * kScale_px));
}

/// One Gauss-Newton step for the least-squares ellipse; returns the step's size. Where the ellipse
/// is the unit circle the rim's distance from it is fitted by 1, cos, sin, cos 2, sin 2 of the
/// angle: the size, shift and stretch of an ellipse. Each point counts for the arc it stands for.
/// Least squares of distances is what a tracker's fit does, so a model that fits its rim in the
/// same way has no bias against it.
double correct(const std::vector<Eigen::Vector2d>& rim, RimFit fit, Eigen::Vector2d& center,
               Eigen::Matrix2d& shape) {
  const Eigen::Matrix2d inverse = shape.inverse();
  std::vector<OnCircle> there;
  there.reserve(rim.size());
  for (const Eigen::Vector2d& point : rim) {
    const Eigen::Vector2d q = inverse * (point - center);
    const double length = q.norm();
    there.push_back({q / length, length});
  }
  const std::size_t count = rim.size();
  const double size = std::sqrt(std::abs(shape.determinant()));  // px
  Eigen::Matrix<double, 5, 5> matrix = Eigen::Matrix<double, 5, 5>::Zero();
  Eigen::Matrix<double, 5, 1> right = Eigen::Matrix<double, 5, 1>::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    double weight =
        angle_between(there[(i + count - 1) % count].direction, there[(i + 1) % count].direction);
    if (fit == RimFit::robust) weight *= counted((there[i].length - 1) * size);
    const double cosine = there[i].direction.x();
    const double sine = there[i].direction.y();
    Eigen::Matrix<double, 5, 1> by;
    by << cosine, sine, 1, cosine * cosine - sine * sine, 2 * sine * cosine;
    matrix += weight * by * by.transpose();
    right += weight * (there[i].length - 1) * by;
  }
  const Eigen::Matrix<double, 5, 1> step = matrix.ldlt().solve(right);
  center += shape * step.head<2>();
  Eigen::Matrix2d growth;
  growth << 1 + step[2] + step[3], step[4], step[4], 1 + step[2] - step[3];
  // Only shape * shape^T matters; its symmetric root drops the rotation of the parameter.
  const Eigen::Matrix2d stretched = shape * growth;
  shape = square_root(stretched * stretched.transpose());
  return step.norm();
}

}  // namespace

/// In the space where the semi-axes are 1, since tangency is preserved by affine maps.
/// Nothing for a viewpoint nearer than 1.05 times the plane that touches the body: the outline
/// would degenerate to a point.
std::optional<std::vector<Vector>> outline(const ObjectModel& body, const Vector& viewpoint,
                                           int count) {
  Vector unit = body.semi_axes;
  if (body.crossed) unit.head<2>().setConstant(body.semi_axes.head<2>().maxCoeff());
  const Vector seen_from = viewpoint.cwiseQuotient(unit);
  const double far = seen_from.norm();
  const Vector w = seen_from / far;
  // of the distance at which the body's plane of support holds the viewpoint
  constexpr double kNearest = 1.05;
  if (!(far > kNearest * body.support(w).dot(w))) return std::nullopt;
  const Across across(w);
  auto points = body.crossed       ? crossed_outline(body, unit, across, w, far, count)
                : body.ellipsoid() ? ellipsoid_outline(across, w, far, count)
                                   : general_outline(body, across, w, far, count);
  for (Vector& point : points) point = point.cwiseProduct(unit);
  return points;
}

/// (a - b) / 2 times (cos 2 phi, sin 2 phi): the second-harmonic vector, which is zero for a circle
/// instead of undefined.
/// (u, v, mean semi-axis, and that vector); the last two coordinates change smoothly when the axes
/// exchange their order.
SmoothEllipse smooth_ellipse(const Eigen::Matrix<double, 5, 1>& e) {
  SmoothEllipse smooth;
  const double half = (e[2] - e[3]) / 2;
  smooth << e[0], e[1], (e[2] + e[3]) / 2, half * std::cos(2 * e[4]), half * std::sin(2 * e[4]);
  return smooth;
}

/// Its inverse. A circle is given the angle 0; angles lie in (-pi/2, pi/2].
Eigen::Matrix<double, 5, 1> center_axes_angle(const SmoothEllipse& e) {
  const double half = std::hypot(e[3], e[4]);
  Eigen::Matrix<double, 5, 1> made;
  double angle = half > 0 ? std::atan2(e[4], e[3]) / 2 : 0;
  if (angle <= -std::numbers::pi / 2) angle = std::numbers::pi / 2;
  made << e[0], e[1], e[2] + half, e[2] - half, angle;
  return made;
}

/// Start: the ellipse of the area's moments. The axes follow from shape * shape^T without an
/// eigenvalue decomposition, which would not be smooth at a circle.
/// Nothing for a rim without area. In pixels, as the rim.
std::optional<SmoothEllipse> rim_ellipse(const std::vector<Eigen::Vector2d>& rim, RimFit fit) {
  // From the moments' ellipse. Nearly an ellipse, a rim needs two steps, each the square of the one
  // before; re-weighted ones shrink by a factor.
  const int steps = fit == RimFit::robust ? 12 : 8;
  const double small = fit == RimFit::robust ? 1e-5 : 1e-6;
  Eigen::Vector2d center;
  Eigen::Matrix2d shape;
  if (!moments(rim, center, shape)) return std::nullopt;
  for (int i = 0; i < steps; ++i) {
    if (correct(rim, fit, center, shape) < small) break;
  }
  const double uu = shape.row(0).squaredNorm();
  const double vv = shape.row(1).squaredNorm();
  const double uv = shape.row(0).dot(shape.row(1));
  const double sum = std::sqrt(uu + vv + 2 * std::abs(shape.determinant()));  // a + b
  SmoothEllipse ellipse;
  // (a^2 - b^2) / 2 cos 2t = (uu - vv) / 2, and a - b = (a^2 - b^2) / (a + b)
  ellipse << center, sum / 2, (uu - vv) / (2 * sum), uv / sum;
  if (!ellipse.allFinite()) return std::nullopt;
  return ellipse;
}

}  // namespace vitreo::optics::detail
