// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/hard_set/scene.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace vitreo::hard_set {
namespace {

using vision::Ellipse;

// Training is at other times of the same way, far from the frames that are judged.
constexpr int kTrainingFrom = 4000;
constexpr int kTrainingStep = 41;

// Of a point of the body's unit disc: steel under a ring of lamps, darker towards the rim, with one
// bright reflex and a seam.
double steel(double x, double y) {
  const double z = std::sqrt(std::max(1 - x * x - y * y, 0.0));
  const double reflex = std::exp(-((x - 0.25) * (x - 0.25) + (y + 0.3) * (y + 0.3)) / 0.012);
  const double seam = std::exp(-(x + 0.45) * (x + 0.45) / 0.002);
  return 44 + 38 * z + 85 * reflex - 9 * seam;
}

// Center and axes as the view's zoom about its middle moves them.
Ellipse zoomed(Ellipse e, double zoom, const cv::Size& view) {
  const Eigen::Vector2d middle(view.width / 2.0, view.height / 2.0);
  e.center_px = middle + zoom * (e.center_px - middle);
  e.semi_major_px *= zoom;
  e.semi_minor_px *= zoom;
  return e;
}

// The share of an ellipse whose points `are`, by samples of equal area (a sunflower's).
template <typename Are>
double share_of(const Ellipse& e, const Are& are) {
  constexpr int kSamples = 300;
  int count = 0;
  for (int q = 0; q < kSamples; ++q) {
    const double r = std::sqrt((q + 0.5) / kSamples);
    count += are(Ellipse{e.center_px, r * e.semi_major_px, r * e.semi_minor_px, e.angle}.point(
        2.399963 * q));
  }
  return count / double{kSamples};
}

// Within the view: a zoom takes the robot out of it.
double within(const cv::Size& view, const Ellipse& e) {
  return share_of(e, [&](const Eigen::Vector2d& p) {
    return p.x() >= 0 && p.y() >= 0 && p.x() <= view.width - 1 && p.y() <= view.height - 1;
  });
}

// The share of an ellipse of which an image says anything: where all channels are saturated there
// is nothing to see.
double unsaturated(const cv::Mat& image, const Ellipse& e) {
  constexpr int kSaturated = 250;
  return share_of(e, [&](const Eigen::Vector2d& p) {
    const cv::Point at(cvRound(p.x()), cvRound(p.y()));
    if (!cv::Rect({0, 0}, image.size()).contains(at)) return false;
    const auto& pixel = image.at<cv::Vec3b>(at);
    return std::min({pixel[0], pixel[1], pixel[2]}) < kSaturated;
  });
}

// From `at` onwards, to beyond the view; with 4 bits of sub-pixels.
void fill_bar(cv::Mat& light, const cv::Point2d& at, double angle, double wide,
              const cv::Scalar& color) {
  const cv::Point2d along(std::cos(angle), std::sin(angle));
  const cv::Point2d across(-along.y * wide, along.x * wide);
  std::vector<cv::Point> corners;
  for (const cv::Point2d& p :
       {at - across, at + across, at + across + 900 * along, at - across + 900 * along})
    corners.emplace_back(cvRound(p.x * 16), cvRound(p.y * 16));
  cv::fillConvexPoly(light, corners, color, cv::LINE_AA, 4);
}

}  // namespace

// Vessels of the robot's gray are drawn once, in the ground's frame; the noise too, of which each
// frame takes another part.
Scene::Scene(const Ground& ground, const Variant& variant, std::uint64_t seed, const cv::Size& view)
    : ground_(ground), variant_(variant), seed_(seed), view_(view) {
  cv::RNG random(0x2545F4914F6CDD1DULL * (seed + 7));
  for (double& p : phase_) p = random.uniform(0.0, 2 * CV_PI);
  noise_.create(view.height + 64, view.width + 64, CV_32FC1);
  random.fill(noise_, cv::RNG::NORMAL, 0, 1);
  if (!variant.gray_vessels) return;
  vessels_ = cv::Mat::zeros(ground.light.size(), CV_32FC1);
  for (int k = 0; k < 16; ++k) {
    cv::Point2d at(random.uniform(0.0, 1.0) * vessels_.cols,
                   random.uniform(0.0, 1.0) * vessels_.rows);
    double heading = random.uniform(0.0, 6.28);
    const int width = random.uniform(5, 16);
    for (int step = 0; step < 70; ++step) {
      heading += random.gaussian(0.1);
      const cv::Point2d to = at + 11.0 * cv::Point2d(std::cos(heading), std::sin(heading));
      cv::line(vessels_, at, to, 1.0, width, cv::LINE_AA);
      at = to;
    }
  }
  cv::GaussianBlur(vessels_, vessels_, {0, 0}, 1.2);
}

// Up to some 6 px and 2 degrees a frame, over most of the view.
Ellipse Scene::robot_at(double k) const {
  const double t = variant_.speed * k;
  const Eigen::Vector2d at(view_.width * (0.5 + 0.34 * std::sin(0.023 * t + phase_[0])) +
                               4 * std::sin(0.29 * t + phase_[1]),
                           view_.height * (0.5 + 0.32 * std::sin(0.031 * t + phase_[2])) +
                               3 * std::sin(0.25 * t + phase_[3]));
  const Ellipse e{at, variant_.semi_axes.width * (1 + 0.05 * std::sin(0.019 * t + phase_[4])),
                  variant_.semi_axes.height * (1 + 0.05 * std::sin(0.027 * t + phase_[5])),
                  std::remainder(1.1 * std::sin(0.029 * t + phase_[6]) + 0.01 * t, CV_PI)};
  return zoomed(e, 1 + (variant_.zoom_to - 1) * std::clamp(k / Scene::kFrames, 0.0, 1.0), view_);
}

// From 150 px beside it, where the view has more room, through it at frame 40, and on.
Ellipse Scene::twin_at(double k) const {
  Ellipse e = robot_at(k);
  const double side = robot_at(0).center_px.x() < view_.width / 2.0 ? 150 : -150;
  e.center_px += Eigen::Vector2d(side * std::cos(CV_PI * k / Scene::kFrames),
                                 14 * std::sin(CV_PI * k / Scene::kFrames));
  e.angle = std::remainder(e.angle + 0.9 - 0.02 * k, CV_PI);
  return e;
}

// Drifts to and fro within the margin, so that no edge of the ground is ever seen; jumps at frames
// 20 and 60 to one side and at 40 back; zooms about the view's middle.
cv::Mat Scene::ground_at(int k) const {
  const double far = 0.85 * kGroundMargin;
  cv::Point2d shift(far * std::sin(variant_.drift_px * k / far),
                    0.5 * far * std::sin(0.7 * variant_.drift_px * k / far + 1));
  for (const int when : {20, 40, 60})
    if (k >= when && k < kTrainingFrom) shift.x += (when == 40 ? -1 : 1) * variant_.jump_px;
  const double zoom = 1 + (variant_.zoom_to - 1) * std::clamp(k / double{kFrames}, 0.0, 1.0);
  const cv::Point2d middle(view_.width / 2.0, view_.height / 2.0);
  const cv::Mat ground_from_view =
      (cv::Mat_<double>(2, 3) << 1 / zoom, 0, middle.x * (1 - 1 / zoom) + kGroundMargin - shift.x,
       0, 1 / zoom, middle.y * (1 - 1 / zoom) + kGroundMargin - shift.y);
  const auto seen = [&](const cv::Mat& whole) {
    cv::Mat view;
    cv::warpAffine(whole, view, ground_from_view, view_, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                   cv::BORDER_REFLECT);
    return view;
  };
  cv::Mat light = seen(ground_.light);
  if (vessels_.empty()) return light;
  cv::Mat share;
  cv::merge(std::vector<cv::Mat>(3, seen(vessels_)), share);
  return light.mul(cv::Scalar::all(1) - share) + share.mul(cv::Scalar(74, 72, 70));
}

// Anti-aliased by 4 x 4 samples a pixel. The shadow lies 4 px to the right and 3 px down, a little
// larger than the body and without a sharp edge: it moves the measured rim as in a real view.
void Scene::draw_body(cv::Mat& light, const Ellipse& e) const {
  const int reach = static_cast<int>(e.semi_major_px) + 8;
  const cv::Rect box = cv::Rect(cvFloor(e.center_px.x()) - reach, cvFloor(e.center_px.y()) - reach,
                                2 * reach, 2 * reach) &
                       cv::Rect({0, 0}, light.size());
  const double c = std::cos(e.angle);
  const double s = std::sin(e.angle);
  for (int v = box.y; v < box.br().y; ++v) {
    auto* at = light.ptr<cv::Vec3f>(v);
    for (int u = box.x; u < box.br().x; ++u) {
      double covered = 0;
      double gray = 0;
      double shade = 0;
      for (int q = 0; q < 16; ++q) {
        const double du = u + (q % 4 - 1.5) / 4 - e.center_px.x();
        const double dv = v + (q / 4 - 1.5) / 4 - e.center_px.y();
        const double x = (c * du + s * dv) / e.semi_major_px;
        const double y = (c * dv - s * du) / e.semi_minor_px;
        const double beside = std::hypot((c * (du - 4) + s * (dv - 3)) / (e.semi_major_px + 3),
                                         (c * (dv - 3) - s * (du - 4)) / (e.semi_minor_px + 3));
        shade += std::clamp(4 * (1 - beside), 0.0, 1.0) / 16;
        if (x * x + y * y > 1) continue;
        covered += 1.0 / 16;
        gray += steel(x, y) / 16;
      }
      at[u] *= static_cast<float>((1 - covered) * (1 - variant_.shadow * shade));
      at[u] += static_cast<float>(gray) * variant_.tint;
    }
  }
}

// Returns the share of the robot that is left to see, by samples of equal area.
double Scene::cover_up(cv::Mat& light, const Ellipse& e, int k) const {
  const bool on = k >= 30 && k < 50;
  const double lengths = variant_.cover == Cover::third  ? -0.35
                         : variant_.cover == Cover::half ? 0.0
                         : variant_.cover == Cover::full ? 1.4
                         : variant_.cover == Cover::tool ? 0.1
                                                         : -2.0;
  if (lengths < -1 || (!on && variant_.cover != Cover::tool && variant_.cover != Cover::third))
    return 1;
  const cv::Point2d center(e.center_px.x(), e.center_px.y());
  // Its end wanders about the place on the robot's long axis up to which it is covered.
  const double angle = 0.6 + 0.3 * std::sin(0.05 * k);
  const double reach = lengths * e.semi_minor_px * 1.3 + 3 * std::sin(0.7 * k);
  const cv::Point2d along(std::cos(angle), std::sin(angle));
  // A forceps' bare steel over the robot, or a gray bar.
  const cv::Scalar color =
      variant_.cover == Cover::tool ? cv::Scalar(84, 82, 80) : cv::Scalar(120, 96, 70);
  fill_bar(light, center - reach * along, angle, 60, color);
  return share_of(e, [&](const Eigen::Vector2d& p) {
    return (cv::Point2d(p.x(), p.y()) - center).dot(along) < -reach;
  });
}

// Light as factors: flicker at no multiple of the frame rate, bands as of a rolling shutter, a
// vignette that falls as r^2, and a spot of 150 px that leaves 40 % elsewhere.
void Scene::shine(cv::Mat& light, int k) const {
  const double flicker = variant_.light * (1 + variant_.flicker * std::sin(2.3 * k + phase_[7]));
  const cv::Point2d middle(light.cols / 2.0, light.rows / 2.0);
  const cv::Point2d spot = middle + cv::Point2d(0.3 * light.cols * std::sin(0.05 * k + phase_[7]),
                                                0.3 * light.rows * std::cos(0.043 * k + phase_[6]));
  for (int v = 0; v < light.rows; ++v) {
    auto* at = light.ptr<cv::Vec3f>(v);
    const double band = variant_.bands ? 1 + 0.22 * std::sin(0.04 * v + 1.9 * k) : 1;
    for (int u = 0; u < light.cols; ++u) {
      const double away =
          ((u - middle.x) * (u - middle.x) + (v - middle.y) * (v - middle.y)) / middle.dot(middle);
      double gain = flicker * band * (1 - variant_.vignette * away);
      if (variant_.spot) {
        const double r2 = (u - spot.x) * (u - spot.x) + (v - spot.y) * (v - spot.y);
        gain *= 0.4 + 1.1 * std::exp(-r2 / (2 * 150.0 * 150.0));
      }
      at[u] = at[u].mul(static_cast<float>(gain) * variant_.cast);
    }
  }
}

// Light that no body reflects: it saturates the sensor.
void Scene::add_glare(cv::Mat& light, const Ellipse& e, int k) const {
  std::vector<std::pair<cv::Point2d, double>> spots;  // center, sigma
  const cv::Point2d at(e.center_px.x(), e.center_px.y());
  if (variant_.cover == Cover::glare_stays) spots.push_back({at + cv::Point2d(6, 4), 16});
  if (variant_.cover == Cover::glare_passes)
    spots.push_back({at + cv::Point2d(6.0 * (k - 40), 3.0 * (k - 40)), 18});
  if (variant_.reflexes) spots = {{{180, 150}, 9}, {{450, 120}, 7}, {{330, 360}, 12}};
  for (const auto& [center, sigma] : spots) {
    const int reach = static_cast<int>(4 * sigma);
    const cv::Rect box =
        cv::Rect(cvRound(center.x) - reach, cvRound(center.y) - reach, 2 * reach, 2 * reach) &
        cv::Rect({0, 0}, light.size());
    for (int v = box.y; v < box.br().y; ++v)
      for (int u = box.x; u < box.br().x; ++u) {
        const double r2 = (u - center.x) * (u - center.x) + (v - center.y) * (v - center.y);
        light.at<cv::Vec3f>(v, u) +=
            static_cast<float>(520 * std::exp(-r2 / (2 * sigma * sigma))) * cv::Vec3f(1, 1, 1);
      }
  }
}

// Shot and read noise on a mosaic of RG over GB, eight bits, interpolated; JPEG where asked.
cv::Mat Scene::camera(const cv::Mat& light, int k) const {
  cv::RNG random(seed_ * 7919 + static_cast<std::uint64_t>(k) * 104729 + 17);
  const int du = random.uniform(0, 64);
  const int dv = random.uniform(0, 64);
  cv::Mat mosaic(light.size(), CV_8UC1);
  for (int v = 0; v < light.rows; ++v) {
    const auto* from = light.ptr<cv::Vec3f>(v);
    const float* noise = noise_.ptr<float>(v + dv) + du;
    auto* to = mosaic.ptr<unsigned char>(v);
    for (int u = 0; u < light.cols; ++u) {
      const int channel = v % 2 == 0 ? (u % 2 == 0 ? 2 : 1) : (u % 2 == 0 ? 1 : 0);
      const float level = variant_.gray
                              ? 0.1F * from[u][0] + 0.55F * from[u][1] + 0.35F * from[u][2]
                              : from[u][channel];
      const float sigma = static_cast<float>(variant_.noise) *
                          std::sqrt(0.2F + std::clamp(level, 0.0F, 255.0F) / 128);
      to[u] = cv::saturate_cast<unsigned char>(level + sigma * noise[u]);
    }
  }
  cv::Mat image;
  cv::cvtColor(mosaic, image, variant_.gray ? cv::COLOR_GRAY2BGR : cv::COLOR_BayerBG2BGR);
  if (variant_.jpeg == 0) return image;
  std::vector<unsigned char> file;
  cv::imencode(".jpg", image, file, {cv::IMWRITE_JPEG_QUALITY, variant_.jpeg});
  return cv::imdecode(file, cv::IMREAD_COLOR);
}

// In the order of the light: ground, bodies, what covers them, lamp, smear, defocus, what shines
// into the lens, sensor.
Shot Scene::shot(int k) const {
  Shot shot;
  shot.truth = robot_at(k);
  if (k < kTrainingFrom) {
    // A jump of the view takes the robot with it, over the same retina.
    for (const int when : {20, 40, 60})
      if (k >= when) shot.truth.center_px.x() += (when == 40 ? -1 : 1) * variant_.jump_px;
  }
  cv::Mat light = ground_at(k);
  const bool absent = k >= variant_.absent_from && k < variant_.absent_until;
  if (variant_.twin) {
    shot.twin = twin_at(k);
    draw_body(light, shot.twin);
  }
  if (!absent) draw_body(light, shot.truth);
  shot.visible = absent ? 0 : cover_up(light, shot.truth, k) * within(view_, shot.truth);
  if (variant_.cover == Cover::blood && k >= 25 && k < 60) {
    const double thick = 0.75 * std::sin(CV_PI * (k - 25) / 35);
    cv::multiply(light, cv::Scalar(1 - thick, 1 - 0.95 * thick, 1 - 0.45 * thick), light);
  }
  if (variant_.cover == Cover::bubbles) {
    for (int q = 0; q < 9; ++q) {
      const cv::Point at(cvRound(view_.width * (0.5 + 0.45 * std::sin(1.7 * q + 0.02 * k))),
                         cvRound(std::fmod(60.0 * q + 3.0 * k, view_.height)));
      cv::circle(light, at, 10 + q, cv::Scalar(150, 165, 190), 2, cv::LINE_AA);
    }
  }
  shine(light, k);
  if (variant_.smear_px > 1) cv::blur(light, light, {variant_.smear_px, 1});
  cv::GaussianBlur(light, light, {0, 0}, variant_.defocus_px);
  if (k < kTrainingFrom) add_glare(light, shot.truth, k);
  shot.image = camera(light, k);
  const bool glare = variant_.cover == Cover::glare_stays || variant_.cover == Cover::glare_passes;
  if (glare) shot.visible *= unsaturated(shot.image, shot.truth);
  return shot;
}

// Robot, color and camera of the variant, but none of what makes it hard. Most variants are trained
// as the plain one is: these share the images of one seed, and so a model.
std::vector<vision::LabeledImage> training_of(const Ground& ground, const Variant& variant,
                                              std::uint64_t seed, const cv::Size& view) {
  Variant plain;
  plain.semi_axes = variant.semi_axes;
  plain.tint = variant.tint;
  plain.gray = variant.gray;
  plain.gray_vessels = variant.gray_vessels;
  const Scene scene(ground, plain, seed, view);
  std::vector<vision::LabeledImage> images;
  for (int n = 0; n < variant.training; ++n) {
    const Shot one = scene.shot(kTrainingFrom + kTrainingStep * n);
    cv::Mat mask = cv::Mat::zeros(view, CV_8UC1);
    cv::ellipse(mask,
                cv::RotatedRect(cv::Point2f(static_cast<float>(one.truth.center_px.x()),
                                            static_cast<float>(one.truth.center_px.y())),
                                cv::Size2f(static_cast<float>(2 * one.truth.semi_major_px),
                                           static_cast<float>(2 * one.truth.semi_minor_px)),
                                static_cast<float>(one.truth.angle * 180 / CV_PI)),
                255, cv::FILLED);
    images.push_back({one.image, mask});
  }
  return images;
}

bool trained_as_plain(const Variant& variant) {
  const Variant plain;
  return variant.semi_axes == plain.semi_axes && variant.tint == plain.tint && !variant.gray &&
         !variant.gray_vessels && variant.training == plain.training;
}

}  // namespace vitreo::hard_set
