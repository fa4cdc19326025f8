// SPDX-License-Identifier: Apache-2.0
#include "true_bench.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include <cmath>
#include <stdexcept>

namespace vitreo::optics {
namespace {

Eigen::Matrix3d rotation(double x, double y) {
  Eigen::Matrix3d about_x;
  Eigen::Matrix3d about_y;
  about_x << 1, 0, 0, 0, std::cos(x), -std::sin(x), 0, std::sin(x), std::cos(x);
  about_y << std::cos(y), 0, std::sin(y), 0, 1, 0, -std::sin(y), 0, std::cos(y);
  return about_y * about_x;
}

/// The conic A x^2 + B x y + C y^2 + D x + E y = 1 through points, by linear least squares about
/// their mean; exact for points of an ellipse.
EllipseVector fitted(const std::vector<Eigen::Vector2d>& points) {
  Eigen::Vector2d mean(0, 0);
  for (const auto& p : points) mean += p / static_cast<double>(points.size());
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(points.size()), 5);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d p = points[i] - mean;
    rows.row(static_cast<Eigen::Index>(i)) << p.x() * p.x(), p.x() * p.y(), p.y() * p.y(), p.x(),
        p.y();
  }
  const Eigen::VectorXd k = rows.colPivHouseholderQr().solve(Eigen::VectorXd::Ones(rows.rows()));
  Eigen::Matrix2d shape;
  shape << k[0], k[1] / 2, k[1] / 2, k[2];
  const Eigen::Vector2d linear(k[3], k[4]);
  const Eigen::Vector2d center = -shape.inverse() * linear / 2;
  const double size = 1 + center.dot(shape * center);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(shape / size);
  EllipseVector ellipse;
  const Eigen::Vector2d along = axes.eigenvectors().col(0);  // the small eigenvalue: the long axis
  ellipse << mean + center, 1 / std::sqrt(axes.eigenvalues()[0]),
      1 / std::sqrt(axes.eigenvalues()[1]), std::atan2(along.y(), along.x());
  return ellipse;
}

}  // namespace

double TrueBench::Body::implicit(const Eigen::Vector3d& p) const {
  const double r2 = p.x() * p.x() + p.y() * p.y();
  const double root = 1 - (1 + conic) * curvature * curvature * r2;
  if (root < 0) return std::nan("");
  double sag = curvature * r2 / (1 + std::sqrt(root));
  double power = r2;
  for (const double a : aspheric) sag += a * (power *= r2);
  return p.z() - sag;
}

/// By differences of fourth order, so that no formula of a derivative is shared.
Eigen::Vector3d TrueBench::Body::slope(const Eigen::Vector3d& p) const {
  constexpr double h = 2e-5;
  Eigen::Vector3d by(0, 0, 1);
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d e = h * Eigen::Vector3d::Unit(i);
    by[i] =
        (8 * (implicit(p + e) - implicit(p - e)) - (implicit(p + 2 * e) - implicit(p - 2 * e))) /
        (12 * h);
  }
  return by.normalized();
}

TrueBench::TrueBench(const NominalChain& nominal, const ChainSigmas& sigmas, std::uint64_t seed)
    : nominal_(nominal), parameters_(chain_parameters(nominal, sigmas)) {
  std::mt19937_64 random(seed);
  for (int attempt = 0; attempt < 100; ++attempt)
    if (draw(random)) return;
  throw std::runtime_error("no draw is an eye");
}

double TrueBench::off(const std::string& name) const {
  const auto found = off_.find(name);
  return found == off_.end() ? 0 : found->second;
}

bool TrueBench::draw(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  off_.clear();
  for (const ChainParameter& one : parameters_) off_[one.name] = one.sigma * normal(random);
  if (!build()) return false;
  return ellipse({0, 0, 5e-3}, {1, 0, 0}).has_value();
}

TrueBench TrueBench::moved(const std::map<std::string, double>& by) const {
  TrueBench other = *this;
  for (const auto& [name, much] : by) other.off_[name] += much;
  if (!other.build()) throw std::invalid_argument("moved: no eye any more");
  return other;
}

bool TrueBench::build() {
  const Prescription& eye = nominal_.prescription;
  const auto& all = eye.system.surfaces;
  const auto index = [&](std::size_t i) {
    return all[i].index * (1 + off(eye.media[i] + ".index"));
  };
  const auto thickness = [&](std::size_t i) {
    return all[i].thickness * (1 + off(eye.media[i] + ".thickness"));
  };
  bodies_.clear();
  double z = thickness(0) + off("axial_length");
  const Eigen::Vector3d eye_center(0, 0, all[0].radius);
  const Eigen::Matrix3d eye_turn = rotation(off("eye_rotation_x"), off("eye_rotation_y"));
  const double inner_pivot = z;
  double lens_pivot = -1;
  bool outside = false;
  for (std::size_t i = 1; i < all.size(); ++i) {
    Body body;
    body.curvature = 1 / (all[i].radius * (1 + off(eye.surfaces[i] + ".radius")));
    body.conic = all[i].conic;
    body.aspheric = all[i].aspheric;
    body.inside = index(i - 1);
    body.outside = index(i);
    body.vertex = {0, 0, z};
    body.frame.setIdentity();
    if (eye.surfaces[i].starts_with("lens.") && !outside) {
      const Eigen::Vector3d pivot(0, 0, inner_pivot);
      const Eigen::Matrix3d turn = rotation(off("inner_lens_tilt_x"), off("inner_lens_tilt_y"));
      body.vertex = pivot + turn * (body.vertex - pivot) +
                    Eigen::Vector3d(off("inner_lens_aside_x"), off("inner_lens_aside_y"), 0);
      body.frame = turn;
    }
    if (!outside) {
      body.vertex = eye_center + eye_turn * (body.vertex - eye_center);
      body.frame = (eye_turn * body.frame).eval();
    } else {
      if (lens_pivot < 0) lens_pivot = z;
      const Eigen::Vector3d pivot(0, 0, lens_pivot);
      const Eigen::Matrix3d turn = rotation(off("lens_tilt_x"), off("lens_tilt_y"));
      body.vertex = pivot + turn * (body.vertex - pivot) +
                    Eigen::Vector3d(off("lens_aside_x"), off("lens_aside_y"), off("lens_axial"));
      body.frame = turn;
    }
    if (std::abs(all[i].index - 1) < 1e-3) outside = true;
    bodies_.push_back(body);
    last_vertex_ = z;
    if (i + 1 < all.size()) {
      const double step = thickness(i);
      if (!(step > 0.1e-3)) return false;
      z += step;
    }
  }
  return true;
}

/// Inwards from the microscope. The surface is met by the secant method on its implicit function
/// along the ray.
std::optional<TrueBench::Sight> TrueBench::sight(const Eigen::Vector2d& pixel_px) const {
  const double scale = nominal_.image.pixel * (1 + off("pixel"));
  const Eigen::Vector2d from_center = pixel_px - nominal_.image.center_px;
  const Eigen::Vector3d m(-from_center.x() * scale, from_center.y() * scale, 0);
  const Eigen::Matrix3d turn = rotation(nominal_.microscope.tilt.x() + off("microscope_tilt_x"),
                                        nominal_.microscope.tilt.y() + off("microscope_tilt_y"));
  const Eigen::Vector3d origin(nominal_.microscope.decenter.x() + off("center_x"),
                               nominal_.microscope.decenter.y() + off("center_y"),
                               last_vertex_ + nominal_.microscope.focus + off("object_plane"));
  const double power = 1 / nominal_.microscope.pupil_distance + off("pupil_power");
  Sight ray{origin + turn * m, turn * Eigen::Vector3d(-power * m.x(), -power * m.y(), 1)};
  ray.direction = -ray.direction.normalized();
  for (std::size_t k = bodies_.size(); k-- > 0;) {
    const Body& body = bodies_[k];
    const Eigen::Vector3d p = body.frame.transpose() * (ray.point - body.vertex);
    const Eigen::Vector3d d = body.frame.transpose() * ray.direction;
    double s0 = -p.z() / d.z();
    double f0 = body.implicit(p + s0 * d);
    double s1 = s0 - f0 / d.z();
    double f1 = body.implicit(p + s1 * d);
    for (int i = 0; i < 60 && std::abs(f1) > 1e-15 && f1 != f0; ++i) {
      const double s2 = s1 - f1 * (s1 - s0) / (f1 - f0);
      s0 = s1, f0 = f1, s1 = s2, f1 = body.implicit(p + s1 * d);
    }
    if (!(std::abs(f1) < 1e-12)) return std::nullopt;
    const Eigen::Vector3d hit = p + s1 * d;
    const Eigen::Vector3d n = body.slope(hit);
    // The part across the normal scales with the indices; what is left of the unit length is along.
    const Eigen::Vector3d across = (body.outside / body.inside) * (d - d.dot(n) * n);
    const double along2 = 1 - across.squaredNorm();
    if (along2 < 0) return std::nullopt;
    const Eigen::Vector3d out = across - std::sqrt(along2) * n;
    ray.point = body.vertex + body.frame * hit;
    ray.direction = body.frame * out;
  }
  return ray;
}

Spheroid TrueBench::robot() const {
  return {nominal_.robot.semi_axis * (1 + off("robot_length")),
          nominal_.robot.semi_radius * (1 + off("robot_width"))};
}

std::optional<Eigen::Vector2d> TrueBench::pixel(const Eigen::Vector3d& point) const {
  Eigen::Vector2d at = nominal_.image.center_px;
  const auto miss = [&](const Eigen::Vector2d& p) -> std::optional<Eigen::Vector2d> {
    const auto line = sight(p);
    if (!line) return std::nullopt;
    const double s = (point.z() - line->point.z()) / line->direction.z();
    return Eigen::Vector2d((line->point + s * line->direction - point).head<2>());
  };
  for (int i = 0; i < 30; ++i) {
    const auto here = miss(at);
    const auto u = miss(at + Eigen::Vector2d(1, 0));
    const auto v = miss(at + Eigen::Vector2d(0, 1));
    if (!here || !u || !v) return std::nullopt;
    Eigen::Matrix2d jacobian;
    jacobian << *u - *here, *v - *here;
    const Eigen::Vector2d step = jacobian.inverse() * *here;
    if (!step.allFinite() || step.norm() > 1e4) return std::nullopt;
    at -= step;
    if (step.norm() < 1e-7) return at;
  }
  return std::nullopt;
}

/// A line touches the spheroid where the quadratic of its crossing has a double root, in the space
/// where it is a unit sphere.
std::optional<EllipseVector> TrueBench::ellipse(const Eigen::Vector3d& position,
                                                const Eigen::Vector3d& axis) const {
  constexpr int kPoints = 24;
  const auto center = pixel(position);
  if (!center) return std::nullopt;
  const Spheroid body = robot();
  const Eigen::Matrix3d to_sphere =
      Eigen::Matrix3d::Identity() / body.semi_radius +
      (1 / body.semi_axis - 1 / body.semi_radius) * axis * axis.transpose();
  // Squared distance of the line from the sphere's center, less 1.
  const auto clearance = [&](const Eigen::Vector2d& p) -> double {
    const auto line = sight(p);
    if (!line) return std::nan("");
    const Eigen::Vector3d q = to_sphere * (line->point - position);
    const Eigen::Vector3d d = (to_sphere * line->direction).normalized();
    return q.squaredNorm() - std::pow(q.dot(d), 2) - 1;
  };
  std::vector<Eigen::Vector2d> rim;
  for (int i = 0; i < kPoints; ++i) {
    const Eigen::Vector2d outwards(std::cos(2 * M_PI * i / kPoints),
                                   std::sin(2 * M_PI * i / kPoints));
    double low = 0;
    double high = 1;
    while (high < 4000 && clearance(*center + high * outwards) < 0) high *= 1.5;
    if (!(clearance(*center + high * outwards) > 0)) return std::nullopt;
    low = high / 1.5 > 1 ? high / 1.5 : 0;
    for (int k = 0; k < 34; ++k) {
      const double middle = (low + high) / 2;
      (clearance(*center + middle * outwards) < 0 ? low : high) = middle;
    }
    rim.push_back(*center + (low + high) / 2 * outwards);
  }
  EllipseVector shown = fitted(rim);
  const double dilation = off("dilation") + off("dilation_slope") * (position.z() - 5e-3);
  shown[2] += dilation;
  shown[3] += dilation;
  return shown;
}

std::optional<OutlineSeen> TrueBench::seen(const Eigen::Vector3d& position,
                                           const Eigen::Vector3d& axis, double sigma_px,
                                           double axis_sigma, std::mt19937_64& random) const {
  std::normal_distribution<double> normal;
  auto shown = ellipse(position, axis);
  if (!shown) return std::nullopt;
  OutlineSeen seen;
  const double difference = (*shown)[2] - (*shown)[3];
  for (int i = 0; i < 4; ++i) (*shown)[i] += sigma_px * normal(random);
  const double angle = sigma_px / std::max(difference, 1.0);
  (*shown)[4] += angle * normal(random);
  if ((*shown)[3] > (*shown)[2]) {
    std::swap((*shown)[2], (*shown)[3]);
    (*shown)[4] += M_PI / 2;
  }
  seen.ellipse = *shown;
  seen.covariance = sigma_px * sigma_px * EllipseCovariance::Identity();
  seen.covariance(4, 4) = angle * angle;
  seen.axis_sigma = axis_sigma;
  return seen;
}

double TrueBench::retina(double x, double y) const {
  const double radius = nominal_.prescription.system.surfaces[0].radius;
  const double conic = nominal_.prescription.system.surfaces[0].conic;
  const double r2 = x * x + y * y;
  const double u = x / 4e-3;
  const double v = y / 4e-3;
  return r2 / radius / (1 + std::sqrt(1 - (1 + conic) * r2 / (radius * radius))) +
         off("retina_depth") + off("retina_tilt_x") * u + off("retina_tilt_y") * v +
         off("retina_curvature") * (u * u + v * v) + off("retina_astigmatism_x") * (u * u - v * v) +
         off("retina_astigmatism_y") * 2 * u * v;
}

Eigen::Vector3d TrueBench::of_retina(double x, double y) const {
  const Eigen::Vector3d center(0, 0, nominal_.prescription.system.surfaces[0].radius);
  return center + rotation(off("eye_rotation_x"), off("eye_rotation_y")) *
                      (Eigen::Vector3d(x, y, retina(x, y)) - center);
}

}  // namespace vitreo::optics
