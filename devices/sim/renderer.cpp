// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/renderer.h"

#include "devices/sim/checks.h"
#include "devices/sim/hardware_sample.h"
#include "optics/rays/trace.h"

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>

namespace vitreo::sim {
namespace {

constexpr int kNormalSamples = 1 << 18;  // standard normal numbers that the noise is taken from
constexpr int kMaxSmears = 9;            // instants of an exposure that are drawn at most

// Fall-off of the light by the square of the distance from the middle: the leading term of cos^4.
cv::Mat vignette_of(int width, int height, double missing) {
  cv::Mat map(height, width, CV_32F);
  const double u0 = (width - 1) / 2.0;
  const double v0 = (height - 1) / 2.0;
  const double corner = u0 * u0 + v0 * v0;
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u)
      map.at<float>(v, u) =
          static_cast<float>(1 - missing * ((u - u0) * (u - u0) + (v - v0) * (v - v0)) / corner);
  return map;
}

// The steepness of the distance at a pixel, by a central difference (one-sided at the window's
// edge); in a valley between two rims (a thin figure) that of the steeper side.
float steepness(float before, float here, float after, bool inside) {
  const float rise = after - here;
  const float fall = here - before;
  if (inside && rise * fall < 0) return std::max(std::abs(rise), std::abs(fall));
  return inside ? (after - before) / 2 : after - before;
}

// Light from a point of a body by Blinn's reflection model (1977), ambient + diffuse n.l + specular
// (n.h)^s, with a lamp beside the observer and h half-way between the two. On a calibration target
// round dots, half the pitch wide, reflect 15 %.
double light_from(const Figure& figure, const BodyLook& look, const Eigen::Vector3d& lamp,
                  const Eigen::Vector3d& half_way, const Hit& here) {
  const double shine = std::max(here.normal.dot(half_way), 0.0);
  double level = look.ambient + look.diffuse * std::max(here.normal.dot(lamp), 0.0);
  // Below 0.8 the highlight is less than a thousandth of a white surface's light.
  if (look.specular > 0 && shine > 0.8) level += look.specular * std::pow(shine, look.shininess);
  if (look.dot_pitch > 0) {
    const double x = here.position.dot(figure.side) / look.dot_pitch;
    const double y = here.position.dot(figure.across) / look.dot_pitch;
    if (std::hypot(x - std::round(x), y - std::round(y)) < 0.25) level *= 0.15;
  }
  return level;
}

// Coverage of each pixel from the rim's distance in pixels, (1 - distance) / slope, which is exact
// for a straight edge along the pixel's rows or columns; and the light times the coverage.
void cover(const cv::Mat& distance, cv::Mat& coverage, cv::Mat& light) {
  for (int v = 0; v < distance.rows; ++v) {
    const float* const row = distance.ptr<float>(v);
    const float* const above = distance.ptr<float>(std::max(v - 1, 0));
    const float* const below = distance.ptr<float>(std::min(v + 1, distance.rows - 1));
    const bool between_rows = v > 0 && v + 1 < distance.rows;
    for (int u = 0; u < distance.cols; ++u) {
      const bool between = u > 0 && u + 1 < distance.cols;
      const float du = steepness(row[std::max(u - 1, 0)], row[u],
                                 row[std::min(u + 1, distance.cols - 1)], between);
      const float dv = steepness(above[u], row[u], below[u], between_rows);
      const float slope = std::max(std::hypot(du, dv), 1e-6F);
      const float part = std::clamp((1 - row[u]) / slope + 0.5F, 0.0F, 1.0F);
      coverage.at<float>(v, u) = part;
      light.at<float>(v, u) *= part;
    }
  }
}

}  // namespace

void Sensor::check() const {
  require(full_well > 0, "full_well must be above zero");
  require(read_noise >= 0, "read_noise must not be negative");
  require(brightness > 0 && brightness <= 1000, "brightness must be in (0, 1000]");
  require(vignette >= 0 && vignette < 1, "vignette must be in [0, 1)");
}

Renderer::Renderer(View view, const Aperture& aperture, DefocusOf defocus, const cv::Mat& ground,
                   double ground_defocus, const Sensor& sensor, const BodyLook& look,
                   std::uint64_t seed)
    : view_(std::move(view)),
      blur_(aperture),
      defocus_(std::move(defocus)),
      sensor_(sensor),
      look_(look),
      seed_(seed) {
  sensor_.check();
  prepare_noise();
  vignette_ = vignette_of(view_.width, view_.height, sensor_.vignette);
  set_ground(ground, ground_defocus);
}

// Linear camera model (EMVA 1288): the variance in electrons is that of the shot noise, which is
// the mean, and that of the read-out. Sigma by gray level, and a list of standard normal numbers,
// both in fixed point: a frame's noise then costs one multiplication a pixel.
void Renderer::prepare_noise() {
  for (int level = 0; level < 256; ++level) {
    const double electrons = sensor_.full_well * level / 255;
    const double noise =
        std::sqrt(electrons + sensor_.read_noise * sensor_.read_noise) * 255 / sensor_.full_well;
    sigma_of_level_.push_back(static_cast<std::uint16_t>(std::lround(std::min(noise, 60.0) * 256)));
  }
  std::mt19937_64 random(mix(seed_, 1, 1));
  std::normal_distribution<double> normal;
  // Rows start at random positions of one long list: within an image a run repeats only by a rare
  // chance.
  normal_.resize(kNormalSamples + static_cast<std::size_t>(view_.width));
  for (auto& sample : normal_)
    sample = static_cast<std::int16_t>(std::lround(std::clamp(normal(random), -6.0, 6.0) * 1024));
}

void Renderer::set_ground(const cv::Mat& ground, double ground_defocus) {
  require(ground.cols == view_.width && ground.rows == view_.height && ground.depth() == CV_32F &&
              (ground.channels() == 1 || ground.channels() == 3),
          "ground: an image of one or three floats a pixel, of the view's size, is wanted");
  cv::split(ground, reflected_);
  for (cv::Mat& one : reflected_) blur_.apply(one, ground_defocus);
  light_ground();
}

void Renderer::set_brightness(double brightness) {
  Sensor changed = sensor_;
  changed.brightness = brightness;
  changed.check();
  sensor_ = changed;
  light_ground();
}

// The empty scene: vignetted and tinted, in units of 1/256 gray level.
void Renderer::light_ground() {
  ground_.create(view_.height, view_.width, CV_16U);
  ground_sigma_.create(view_.height, view_.width, CV_16U);
  for (int v = 0; v < view_.height; ++v) {
    for (int u = 0; u < view_.width; ++u) {
      const bool gray = reflected_.size() == 1;
      std::array<double, 3> color = sensor_.ground_tint;  // red, green, blue
      for (std::size_t c = 0; c < 3 && !gray; ++c) color[c] *= reflected_[2 - c].at<float>(v, u);
      const double reflected = gray ? reflected_[0].at<float>(v, u) : 1;
      const double level =
          sensor_.brightness * reflected * vignette_.at<float>(v, u) * factor(color, u, v);
      const auto mean = static_cast<std::uint16_t>(std::clamp(level * 256, 0.0, 65280.0));
      ground_.at<std::uint16_t>(v, u) = mean;
      ground_sigma_.at<std::uint16_t>(v, u) = sigma_of_level_[mean >> 8];
    }
  }
  scene_ = ground_.clone();
  scene_sigma_ = ground_sigma_.clone();
  drawn_.clear();
}

// A gray sensor weighs the colors about as luma does; a Bayer sensor has one filter a pixel.
double Renderer::factor(const std::array<double, 3>& color, int u, int v) const {
  if (sensor_.color == SensorColor::gray) return 0.3 * color[0] + 0.6 * color[1] + 0.1 * color[2];
  return color[static_cast<std::size_t>((u & 1) + (v & 1))];  // RG over GB
}

cv::Mat Renderer::render(const BodyState* robot, std::uint64_t frame) {
  std::vector<DrawnBody> bodies;
  if (robot != nullptr) bodies.push_back({*robot, *robot, look_});
  return render(bodies, frame);
}

// The painter's algorithm: from the farthest body to the nearest, each over what is there.
cv::Mat Renderer::render(const std::vector<DrawnBody>& bodies, std::uint64_t frame) {
  restore_ground();
  std::vector<const DrawnBody*> from_far;
  from_far.reserve(bodies.size());
  for (const DrawnBody& body : bodies) from_far.push_back(&body);
  const auto height = [this](const DrawnBody* body) {
    return view_.point_in_view(body->start.position).z();
  };
  std::stable_sort(
      from_far.begin(), from_far.end(),
      [&](const DrawnBody* one, const DrawnBody* other) { return height(one) < height(other); });
  for (const DrawnBody* body : from_far) draw(*body);
  cv::Mat image = add_noise(frame);
  if (sensor_.color == SensorColor::gray) return image;
  cv::Mat colors;
  cv::cvtColor(image, colors,
               cv::COLOR_BayerBG2BGR);  // OpenCV names the pattern by its second row and column
  return colors;
}

// Undoes the last frame's bodies: only their windows differ from the empty scene.
void Renderer::restore_ground() {
  for (const cv::Rect& window : drawn_) {
    ground_(window).copyTo(scene_(window));
    ground_sigma_(window).copyTo(scene_sigma_(window));
  }
  drawn_.clear();
}

// m per px at a depth of the view, along u.
// By a central difference of the two neighbors' lines.
double Renderer::scale_at(const Eigen::Vector2d& pixel, double z) const {
  const int u = std::clamp(static_cast<int>(pixel.x()), 1, view_.width - 2);
  const int v = std::clamp(static_cast<int>(pixel.y()), 1, view_.height - 2);
  const PixelLine& left = view_.at(u - 1, v);
  const PixelLine& right = view_.at(u + 1, v);
  return std::hypot(right.x - left.x + z * (right.dx - left.dx),
                    right.y - left.y + z * (right.dy - left.dy)) /
         2;
}

// The pixels that a body can touch, blur included; `extent`: how far it reaches from its center
// along x and y, m.
cv::Rect Renderer::window_of(const Eigen::Vector3d& center, const Eigen::Vector2d& extent,
                             const Eigen::Vector2d& pixel, double defocus) {
  const int u = std::clamp(static_cast<int>(pixel.x()), 1, view_.width - 2);
  const int v = std::clamp(static_cast<int>(pixel.y()), 1, view_.height - 2);
  const double scale = scale_at(pixel, center.z());
  // A quarter more than the size at the center: magnification grows towards the lens and towards
  // the rim.
  const int margin = blur_.reach(defocus) + 2;
  const int half_u = static_cast<int>(std::ceil(1.25 * extent.x() / scale)) + margin;
  const int half_v = static_cast<int>(std::ceil(1.25 * extent.y() / scale)) + margin;
  return cv::Rect(u - half_u, v - half_v, 2 * half_u + 1, 2 * half_v + 1) &
         cv::Rect(0, 0, view_.width, view_.height);
}

void Renderer::draw(const DrawnBody& body) {
  const Eigen::Vector3d center = view_.point_in_view(body.start.position);
  const auto pixel = view_.pixel_of(center);
  if (!pixel) return;  // outside the image
  const double defocus = defocus_(*pixel, center.z());
  // Half extent along an axis of the view.
  const auto reach = [&](int k) {
    return extent_along(body.start, body.look, view_.view_from_world.row(k).transpose());
  };
  cv::Rect window = window_of(center, {reach(0), reach(1)}, *pixel, defocus);
  const int smears = smears_of(body, *pixel, center.z(), window);
  if (window.empty()) return;
  cv::Mat coverage;
  cv::Mat light;
  expose(body, smears, window, coverage, light);
  blur_.apply(coverage, defocus);
  blur_.apply(light, defocus);
  compose(coverage, light, body.look, window);
  drawn_.push_back(window);
}

// Number of instants that show a body's motion during the exposure, two for each pixel that it
// moves or turns through; widens the window by the motion.
int Renderer::smears_of(const DrawnBody& body, const Eigen::Vector2d& pixel, double z,
                        cv::Rect& window) const {
  const auto last = view_.pixel_of(view_.point_in_view(body.end.position));
  if (!last) return 1;
  const Eigen::Vector2d gone = *last - pixel;
  const double turned =
      (body.end.axis - body.start.axis).norm() * body.start.semi_axis / scale_at(pixel, z);
  const int smears =
      std::clamp(static_cast<int>(std::ceil(2 * (gone.norm() + turned))), 1, kMaxSmears);
  const cv::Point shift(static_cast<int>(std::lround(gone.x())),
                        static_cast<int>(std::lround(gone.y())));
  if (smears > 1) window = (window | (window + shift)) & cv::Rect(0, 0, view_.width, view_.height);
  return smears;
}

// Motion blur: the mean of the body's coverage and light over the middles of `smears` equal parts
// of the exposure.
void Renderer::expose(const DrawnBody& body, int smears, const cv::Rect& window, cv::Mat& coverage,
                      cv::Mat& light) const {
  for (int smear = 0; smear < smears; ++smear) {
    BodyState at = body.start;
    const double part = (smear + 0.5) / smears;
    if (smears > 1) {
      at.position += part * (body.end.position - body.start.position);
      at.axis = (body.start.axis + part * (body.end.axis - body.start.axis)).normalized();
    }
    cv::Mat one;
    cv::Mat lit;
    shade(at, body.look, window, one, lit);
    if (smear == 0) {
      coverage = one;
      light = lit;
    } else {
      coverage += one;
      light += lit;
    }
  }
  if (smears > 1) {
    coverage /= smears;
    light /= smears;
  }
}

// The "over" operator (Porter & Duff 1984) with light that has been multiplied by the coverage
// already. Columns alternate between two filters of a Bayer row, which are even and odd within the
// window.
void Renderer::compose(const cv::Mat& coverage, const cv::Mat& light, const BodyLook& look,
                       const cv::Rect& window) {
  for (int v = 0; v < window.height; ++v) {
    const float* covered = coverage.ptr<float>(v);
    const float* lit = light.ptr<float>(v);
    const float* vignette = vignette_.ptr<float>(window.y + v) + window.x;
    std::uint16_t* mean = scene_.ptr<std::uint16_t>(window.y + v) + window.x;
    std::uint16_t* sigma = scene_sigma_.ptr<std::uint16_t>(window.y + v) + window.x;
    const auto even =
        static_cast<float>(sensor_.brightness * 256 * factor(look.color, window.x, window.y + v));
    const auto odd = static_cast<float>(sensor_.brightness * 256 *
                                        factor(look.color, window.x + 1, window.y + v));
    for (int u = 0; u < window.width; ++u) {
      const float full = (u & 1) == 0 ? even : odd;
      const float level = (1 - covered[u]) * mean[u] + full * lit[u] * vignette[u];
      mean[u] = static_cast<std::uint16_t>(std::clamp(level, 0.0F, 65280.0F));
      sigma[u] = sigma_of_level_[mean[u] >> 8];
    }
  }
}

// For each pixel of the window: the part of it that the body covers, and the light from there,
// times the coverage.
void Renderer::shade(const BodyState& body, const BodyLook& look, const cv::Rect& window,
                     cv::Mat& coverage, cv::Mat& light) const {
  const Figure figure = figure_of(view_, body, look);
  const Eigen::Vector3d lamp = Eigen::Vector3d(0.25, 0.15, 1).normalized();
  const Eigen::Vector3d half_way = (lamp + Eigen::Vector3d::UnitZ()).normalized();
  // Of the pixel's line from the figure's middle, 1 at the rim.
  cv::Mat distance(window.size(), CV_32F);
  coverage.create(window.size(), CV_32F);
  light.create(window.size(), CV_32F);
  for (int v = 0; v < window.height; ++v) {
    float* const far = distance.ptr<float>(v);
    float* const lit = light.ptr<float>(v);
    for (int u = 0; u < window.width; ++u) {
      const Hit here = hit(figure, view_.at(window.x + u, window.y + v));
      far[u] = static_cast<float>(std::sqrt(here.closest));
      lit[u] = here.closest > kWellOutside
                   ? 0
                   : static_cast<float>(light_from(figure, look, lamp, half_way, here));
    }
  }
  cover(distance, coverage, light);
}

namespace {

// Fixed point: mean and sigma are in 1/256 gray level and the normal numbers in 1/1024, so
// (sigma * normal) >> 10 is in 1/256, and + 128 rounds. Sigma is below 2^15 (prepare_noise), and
// the rows do not overlap: so the compiler takes eight pixels at a time.
void add_noise_to_row(const std::uint16_t* __restrict mean, const std::uint16_t* __restrict sigma,
                      const std::int16_t* __restrict normal, int width,
                      std::uint8_t* __restrict out) {
  for (int u = 0; u < width; ++u) {
    const int spread = static_cast<std::int16_t>(sigma[u]) * normal[u];
    const int value = mean[u] + (spread >> 10) + 128;
    out[u] = static_cast<std::uint8_t>(std::clamp(value, 0, 65535) >> 8);
  }
}

}  // namespace

cv::Mat Renderer::add_noise(std::uint64_t frame) const {
  cv::Mat image(view_.height, view_.width, CV_8U);
  for (int v = 0; v < view_.height; ++v) {
    const std::int16_t* normal =
        normal_.data() + mix(seed_, frame, static_cast<std::uint64_t>(v)) % kNormalSamples;
    add_noise_to_row(scene_.ptr<std::uint16_t>(v), scene_sigma_.ptr<std::uint16_t>(v), normal,
                     view_.width, image.ptr<std::uint8_t>(v));
  }
  return image;
}

namespace {

Eigen::Vector2d at_depth(const optics::Ray& ray, double z) {
  return (ray.origin + (z - ray.origin.z()) / ray.direction.z() * ray.direction).head<2>();
}

// Half the distance, at depth z, of two marginal rays: they meet in the focus plane's point of the
// chief ray `in_air` and cross the aperture on opposite sides, or the largest part of it that the
// eye's rims let through. Half the difference is free of coma, which moves both alike.
std::optional<double> half_spread(const optics::System& eye, const optics::Ray& in_air,
                                  double plane, double z, const Eigen::Vector3d& rim) {
  for (const double part : {1.0, 0.75, 0.5, 0.25}) {
    std::array<std::optional<Eigen::Vector2d>, 2> there;
    for (const int side : {0, 1}) {
      optics::Ray ray = in_air;
      ray.origin += (plane - ray.origin.z()) / ray.direction.z() * ray.direction;
      ray.direction = -(ray.direction + (side == 0 ? part : -part) * rim).normalized();
      const optics::TraceResult traced = optics::trace_in(eye, ray);
      if (traced.status == optics::TraceStatus::ok) there[side] = at_depth(traced.ray, z);
    }
    if (there[0] && there[1]) return (*there[0] - *there[1]).norm() / 2;
  }
  return std::nullopt;
}

}  // namespace

// The geometric blur at depth z is the marginal rays' spread there; divided by the local
// magnification (`per_meter`, of the vitreous over the image) it is a radius in the image, and over
// NA a defocus. Root mean square over the tangential and the sagittal direction.
Renderer::DefocusOf eye_defocus(const optics::System& eye, const optics::Microscope& microscope,
                                const optics::ImageScale& scale) {
  return [eye, microscope, scale](const Eigen::Vector2d& pixel, double z) {
    const Eigen::Vector2d m = scale.m_from_pixel(pixel);
    const double span = 8 * scale.pixel;  // m of image, for the local scale
    const double plane = eye.vertex(eye.size()) + microscope.focus;
    const auto chief = optics::isopixel_line(eye, microscope, m);
    if (!chief) return 0.0;
    const optics::Ray in_air = optics::chief_ray_in_air(eye, microscope, m);
    double sum = 0;
    for (int direction = 0; direction < 2; ++direction) {
      const auto beside =
          optics::isopixel_line(eye, microscope, m + span * Eigen::Vector2d::Unit(direction));
      const auto spread = half_spread(
          eye, in_air, plane, z, microscope.numerical_aperture * Eigen::Vector3d::Unit(direction));
      if (!beside || !spread) return 0.0;
      const double per_meter = (at_depth(*beside, z) - at_depth(*chief, z)).norm() / span;
      sum += std::pow(*spread / per_meter / microscope.numerical_aperture, 2);
    }
    return std::sqrt(sum / 2);
  };
}

// Ray and sphere: |o + t d| = R about the sphere's center, the root on the far side. Distance along
// the retina is R times the angle from the vertex (azimuthal equidistant projection).
cv::Mat retina_points(const View& view, double radius) {
  cv::Mat points(view.height, view.width, CV_64FC2);
  const Eigen::Vector3d center(0, 0, radius);
  for (int v = 0; v < view.height; ++v) {
    for (int u = 0; u < view.width; ++u) {
      const PixelLine& line = view.at(u, v);
      const Eigen::Vector3d o = Eigen::Vector3d(line.x, line.y, 0) - center, d(line.dx, line.dy, 1);
      const double dd = d.squaredNorm();
      const double od = o.dot(d);
      const double root = od * od - dd * (o.squaredNorm() - radius * radius);
      if (!(root >= 0)) {
        points.at<cv::Vec2d>(v, u) = {std::nan(""), std::nan("")};
        continue;
      }
      // The far side, with the smaller t: the retina, not the lens.
      const Eigen::Vector3d outward = o + (-od - std::sqrt(root)) / dd * d;
      const double across = std::hypot(outward.x(), outward.y());
      const double angle = std::atan2(across, -outward.z());
      const double stretch = across > 1e-9 ? radius * angle / across : 1;
      points.at<cv::Vec2d>(v, u) = {stretch * outward.x(), stretch * outward.y()};
    }
  }
  return points;
}

// A point that is not a number lies outside of every map, where a fundus is black.
cv::Mat painted_ground(const cv::Mat& points, const Fundus& fundus, const Eigen::Vector2d& shift,
                       bool in_color) {
  const bool color = in_color && fundus.has_color();
  cv::Mat ground(points.size(), color ? CV_32FC3 : CV_32FC1);
  for (int v = 0; v < points.rows; ++v) {
    for (int u = 0; u < points.cols; ++u) {
      const cv::Vec2d& at = points.at<cv::Vec2d>(v, u);
      const double x = at[0] - shift.x();
      const double y = at[1] - shift.y();
      if (color)
        ground.at<cv::Vec3f>(v, u) = fundus.color(x, y);
      else
        ground.at<float>(v, u) = fundus.reflectance(x, y);
    }
  }
  return ground;
}

cv::Mat retina_ground(const View& view, const Fundus& fundus, double radius) {
  return painted_ground(retina_points(view, radius), fundus, {0, 0}, false);
}

}  // namespace vitreo::sim
