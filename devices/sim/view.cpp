// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/view.h"

#include "devices/sim/checks.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace vitreo::sim {
namespace {

using Line = Eigen::Vector4d;  // x, y, dx, dy
const double kNan = std::nan("");

// The isopixel line (thesis 3.2) of the image point m: the chief ray's straight part in the
// vitreous. NaN where a rim stops it.
Line traced_line(const optics::System& eye, const optics::Microscope& microscope,
                 const Eigen::Vector2d& m) {
  const auto ray = optics::isopixel_line(eye, microscope, m);
  if (!ray) return Line::Constant(kNan);
  const Eigen::Vector3d d = ray->direction / ray->direction.z();
  const Eigen::Vector3d foot = ray->origin - ray->origin.z() * d;
  return {foot.x(), foot.y(), d.x(), d.y()};
}

// Weights of the four neighbors in cubic Lagrange interpolation at t in [0, 1] between the second
// and the third: exact for cubics, error of the fourth order in the grid's step.
std::array<double, 4> cubic_weights(double t) {
  return {-t * (t - 1) * (t - 2) / 6, (t + 1) * (t - 1) * (t - 2) / 2, -(t + 1) * t * (t - 2) / 2,
          (t + 1) * t * (t - 1) / 6};
}

// Traced lines on a grid that reaches beyond the image on every side, so that every pixel has its
// 4x4 neighbors.
struct Grid {
  int step;
  int columns;
  int rows;
  std::vector<Line> nodes;
  const Line& node(int column, int row) const {
    return nodes[static_cast<std::size_t>(row) * columns + column];
  }
};

Grid trace_grid(const optics::System& eye, const optics::Microscope& microscope,
                const optics::ImageScale& scale, const ImageSize& size, int step,
                const Eigen::Matrix2d& turned) {
  Grid grid{step, (size.width + step - 1) / step + 4, (size.height + step - 1) / step + 4, {}};
  grid.nodes.reserve(static_cast<std::size_t>(grid.columns) * grid.rows);
  for (int row = 0; row < grid.rows; ++row)
    for (int column = 0; column < grid.columns; ++column)
      grid.nodes.push_back(traced_line(
          eye, microscope, turned * scale.m_from_pixel({(column - 1) * step, (row - 1) * step})));
  return grid;
}

// Tensor-product interpolation of the line's four numbers. A NaN among the neighbors makes it NaN.
Line interpolate(const Grid& grid, const std::array<double, 4>& wx, int column,
                 const std::array<double, 4>& wy, int row) {
  Line sum = Line::Zero();
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i) sum += wy[j] * wx[i] * grid.node(column + i, row + j);
  return sum;
}

PixelLine to_float(const Line& line) {
  return {static_cast<float>(line[0]), static_cast<float>(line[1]), static_cast<float>(line[2]),
          static_cast<float>(line[3])};
}

}  // namespace

// Inverts the map from pixels to crossings at the point's depth by Newton's method with a Jacobian
// of central differences over the table. The map is smooth and nearly linear, so a start in its
// center always serves.
std::optional<Eigen::Vector2d> View::pixel_of(const Eigen::Vector3d& point) const {
  Eigen::Vector2d pixel(width / 2.0, height / 2.0);
  const double z = point.z();
  const auto crossing = [&](int u, int v) {
    const PixelLine& line = at(u, v);
    return Eigen::Vector2d(line.x + z * line.dx, line.y + z * line.dy);
  };
  constexpr int kSpan = 8;  // px, of the difference quotient
  for (int iteration = 0; iteration < 12; ++iteration) {
    const int u = std::clamp(static_cast<int>(pixel.x()), kSpan, width - 1 - kSpan);
    const int v = std::clamp(static_cast<int>(pixel.y()), kSpan, height - 1 - kSpan);
    Eigen::Matrix2d jacobian;
    jacobian.col(0) = (crossing(u + kSpan, v) - crossing(u - kSpan, v)) / (2 * kSpan);
    jacobian.col(1) = (crossing(u, v + kSpan) - crossing(u, v - kSpan)) / (2 * kSpan);
    const Eigen::Vector2d step = jacobian.inverse() * (point.head<2>() - crossing(u, v));
    if (!step.allFinite()) return std::nullopt;
    const Eigen::Vector2d next = Eigen::Vector2d(u, v) + step;
    if ((next - pixel).norm() < 0.02) {
      const bool inside = next.x() >= 0 && next.y() >= 0 && next.x() < width && next.y() < height;
      return inside ? std::optional(next) : std::nullopt;
    }
    pixel = next;
  }
  return std::nullopt;
}

// A 1384 x 1036 image has 1.4 million lines; tracing one in 256 and interpolating saves almost all
// of the time.
View eye_view(const optics::System& eye, const optics::Microscope& microscope,
              const optics::ImageScale& scale, const ImageSize& size,
              const Eigen::Vector3d& eye_in_world, int grid_step, double turn) {
  require(size.width >= 32 && size.height >= 32, "size: an image of at least 32x32 is wanted");
  require(grid_step >= 1, "grid_step must be at least 1");
  eye.check();
  microscope.check();
  require(std::isfinite(turn), "turn is not finite");
  const Eigen::Matrix2d turned = Eigen::Rotation2Dd(turn).toRotationMatrix();
  const Grid grid = trace_grid(eye, microscope, scale, size, grid_step, turned);
  View view;
  view.width = size.width;
  view.height = size.height;
  view.origin_in_world = eye_in_world;
  view.lines.reserve(static_cast<std::size_t>(size.width) * size.height);
  std::vector<std::array<double, 4>> weights;
  weights.reserve(static_cast<std::size_t>(grid_step));
  for (int i = 0; i < grid_step; ++i)
    weights.push_back(cubic_weights(static_cast<double>(i) / grid_step));
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      Line line = interpolate(grid, weights[u % grid_step], u / grid_step, weights[v % grid_step],
                              v / grid_step);
      // At the edge of the field of view a neighbor on the grid is missing: such pixels are traced
      // themselves.
      if (!line.allFinite())
        line = traced_line(eye, microscope, turned * scale.m_from_pixel({u, v}));
      view.lines.push_back(to_float(line));
    }
  }
  return view;
}

namespace {

// The paraxial image of the stop's middle in the vitreous: m before surface 2's vertex plane,
// towards the observer. Without a stop that plane itself. At each surface on the way, with the
// distances s taken from the vertex (Gauss):
//   n'/s' = n/s - (n - n')/R
double apparent_stop(const optics::System& eye) {
  double distance = 0;  // m behind the surface that is next, in the medium there
  if (!eye.stop) return 0;
  for (int surface = eye.stop->surface - 1; surface >= 2; --surface) {
    const optics::Surface& s = eye.surfaces[static_cast<std::size_t>(surface - 1)];
    const double before = eye.surfaces[static_cast<std::size_t>(surface - 2)].index;
    distance = before / (s.index / (distance + s.thickness) - (s.index - before) / s.radius);
  }
  return distance;
}

}  // namespace

// The chief rays of a bare sensor cross the middle of the eye's stop (thesis 4.1). That is the
// microscope whose pupil distance d makes them do so: near the axis the crossing is linear in 1/d,
// so two traced rays give the root, as in one step of the secant method.
optics::Microscope bare_sensor(const optics::System& eye, double focus, double numerical_aperture) {
  optics::Microscope sensor;
  sensor.focus = focus;
  sensor.numerical_aperture = numerical_aperture;
  const double stop = apparent_stop(eye);
  constexpr double kNear = 10e-6;  // m off the axis
  const auto crossing = [&](double per_meter) {
    sensor.pupil_distance =
        per_meter == 0 ? std::numeric_limits<double>::infinity() : 1 / per_meter;
    const auto ray = optics::isopixel_line(eye, sensor, {kNear, 0});
    require(ray.has_value(), "bare_sensor: no light reaches the sensor on the axis");
    return ray->origin.x() + stop * ray->direction.x() / ray->direction.z();
  };
  constexpr double kTrial = -1.0;  // 1/m
  const double straight = crossing(0);
  const double tried = crossing(kTrial);
  require(std::abs(tried - straight) > 0, "bare_sensor: the eye has no pupil behind it");
  const double per_meter = kTrial * straight / (straight - tried);
  require(per_meter != 0, "bare_sensor: the sensor lies where the pupil's image is at infinity");
  sensor.pupil_distance = 1 / per_meter;
  return sensor;
}

// Parallel lines, along z, at the pixels' own scale; image rows go down, y up.
// The chief ray of a point m of the plane in focus goes to the pupil: along (-power m, 1).
View plain_view(double pixel, const Eigen::Vector2d& center_px, const ImageSize& size,
                const PlainMicroscope& microscope) {
  require(pixel > 0, "pixel must be above zero");
  const Eigen::Matrix3d turn = (Eigen::AngleAxisd(microscope.tilt.y(), Eigen::Vector3d::UnitY()) *
                                Eigen::AngleAxisd(microscope.tilt.x(), Eigen::Vector3d::UnitX()))
                                   .toRotationMatrix();
  View view;
  view.width = size.width;
  view.height = size.height;
  for (int v = 0; v < size.height; ++v)
    for (int u = 0; u < size.width; ++u) {
      const Eigen::Vector2d m((u - center_px.x()) * pixel, (center_px.y() - v) * pixel);
      const Eigen::Vector3d point = turn * Eigen::Vector3d(m.x(), m.y(), 0);
      const Eigen::Vector3d along = turn * Eigen::Vector3d(-microscope.pupil_power * m.x(),
                                                           -microscope.pupil_power * m.y(), 1);
      const Eigen::Vector2d slope = along.head<2>() / along.z();
      const double height = microscope.plane + point.z();
      view.lines.push_back(to_float(
          {point.x() - height * slope.x(), point.y() - height * slope.y(), slope.x(), slope.y()}));
    }
  return view;
}

View side_view(double pixel, const Eigen::Vector2d& center_px, const ImageSize& size, double turn) {
  require(pixel > 0, "pixel must be above zero");
  const Eigen::Matrix2d turned = Eigen::Rotation2Dd(turn).toRotationMatrix();
  View view;
  view.width = size.width;
  view.height = size.height;
  // The observer sits at -y and looks along +y: x right, z up, so the view's z is -y and its y is
  // z.
  view.view_from_world << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  for (int v = 0; v < size.height; ++v)
    for (int u = 0; u < size.width; ++u) {
      const Eigen::Vector2d point =
          turned * Eigen::Vector2d((u - center_px.x()) * pixel, (center_px.y() - v) * pixel);
      view.lines.push_back(to_float({point.x(), point.y(), 0, 0}));
    }
  return view;
}

}  // namespace vitreo::sim
