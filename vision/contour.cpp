// SPDX-License-Identifier: Apache-2.0
#include "vision/contour.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace vitreo::vision {
namespace {

constexpr int kCoarseRounds = 2;
constexpr int kMostCoarseRounds = 4;
constexpr int kFineRounds = 5;
constexpr double kLastMovePx = 0.03;  // a round that moves center and axes by less is the last
// Ratio of estimated to nominal blur from which the estimate is the better start.
constexpr double kClearlyMore = 1.3;
// px: how far to either side the rim of a body with corners is searched at most.
constexpr int kMostReach = 60;
// Prior of the shading: from the rim inwards a body brightens by about these parts of its contrast,
// as a root and linearly.
constexpr double kRootSpread = 0.5;
constexpr double kStraightSpread = 1;

// u, v in px, the center of the first pixel at (0, 0); the caller has checked that all four
// neighbors exist.
template <class T>
double bilinear(const cv::Mat& image, double u, double v) {
  const int i = static_cast<int>(u);
  const int j = static_cast<int>(v);
  const double a = u - i;
  const double b = v - j;
  const T* top = image.ptr<T>(j) + i;
  const T* bottom = image.ptr<T>(j + 1) + i;
  return (1 - b) * ((1 - a) * top[0] + a * top[1]) + b * ((1 - a) * bottom[0] + a * bottom[1]);
}

// Whether bilinear() has its four pixels.
bool inside_image(const cv::Mat& image, const Eigen::Vector2d& p) {
  return p.x() >= 0 && p.y() >= 0 && p.x() < image.cols - 1 && p.y() < image.rows - 1;
}

// `count` values 1 px apart outwards, the first `inside` px within the rim. False when they leave
// the image.
// The ground is sampled at the same positions, so that a pattern behind the rim is the same in
// both.
template <class Samples>
bool sample_normal(const cv::Mat& image, const cv::Mat& ground, const Normal& n, double inside,
                   int count, Samples& out) {
  const Eigen::Vector2d first = n.rim_px - inside * n.outward;
  if (!inside_image(image, first) || !inside_image(image, first + (count - 1) * n.outward))
    return false;
  for (int j = 0; j < count; ++j) {
    const Eigen::Vector2d p = first + j * n.outward;
    out.image[static_cast<std::size_t>(j)] = bilinear<unsigned char>(image, p.x(), p.y());
    out.ground[static_cast<std::size_t>(j)] = bilinear<float>(ground, p.x(), p.y());
  }
  return true;
}

// The upper median for an even count; 0 of none.
// Reorders `values`.
double upper_median(std::vector<double>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Standard deviation of a pixel at this gray level (Background::noise_of_level).
// A sensor's noise grows with the light (shot noise), so it is looked up by level.
double noise_at(const cv::Mat& noise, double level) {
  return noise.at<float>(static_cast<int>(std::clamp(level, 0.0, 255.0)));
}

}  // namespace

Contour::Contour(const ContourSettings& settings)
    : settings_(settings),
      profiles_(static_cast<std::size_t>(settings.normals / 4 + 1)),
      normals_(static_cast<std::size_t>(settings.normals)),
      samples_(normals_.size()),
      edges_(normals_.size()) {}

// Normals at t, pi - t, pi + t and 2 pi - t have the same profile: folded into the first quarter.
const EdgeModel::Profile& Contour::profile(std::size_t k) const {
  const std::size_t half = normals_.size() / 2;
  const std::size_t folded = k > half ? normals_.size() - k : k;
  return profiles_[std::min(folded, half - folded)];
}

// The range of ContourSettings::blur_sigma_px that a measured blur may have.
// Outside of this range the blur would have explained something else, such as a shadow.
double Contour::allowed_blur(double sigma) const {
  constexpr double kAlwaysAllowed = 6;  // px
  const double nominal = settings_.blur_sigma_px;
  return std::clamp(sigma, 0.4 * nominal, std::max(2.5 * nominal, kAlwaysAllowed));
}

// Half-contrast crossing: a symmetric blur leaves a step's half height at the step. Searched from
// outside inwards, so that highlights within cannot mislead: the position, by linear interpolation,
// where the difference from the ground is half of its maximum just inside, and the slope there
// (gray levels per px).
// Leaves `n.found` false where there is no edge, and where already the outermost samples differ:
// the rim then lies further out.
void Contour::half_crossing(const Images& images, const Reach& reach, Normal& n,
                            double& slope) const {
  using Line = std::array<double, 2 * kMostReach + 1>;
  struct {
    Line image, ground;
  } s;
  const int count = reach.inward + reach.outward + 1;
  if (!sample_normal(images.image, images.ground, n, reach.inward, count, s)) return;
  Line d{};
  const auto at = [&](int j) -> double& { return d[static_cast<std::size_t>(j)]; };
  for (int j = 0; j < count; ++j) {
    at(j) = s.image[static_cast<std::size_t>(j)] - s.ground[static_cast<std::size_t>(j)];
  }
  const double noise = noise_at(images.noise, s.ground[static_cast<std::size_t>(reach.inward)]);
  const double threshold = std::max(settings_.min_contrast / 2, 4 * noise);
  // The outermost two neighbors that differ from the ground, to the same side.
  int first = count - 2;
  const auto within = [&](int j) {
    return std::abs(at(j)) > threshold && at(j) * at(j - 1) > threshold * threshold;
  };
  while (first >= 1 && !within(first)) --first;
  if (first < 1 || first == count - 2) return;  // no edge, or the rim lies further out
  const double sign = at(first) > 0 ? 1 : -1;
  // The extremum within 3 sigma of it, which is the contrast of an edge blurred by sigma.
  int top = first;
  const int deepest = std::max(first - static_cast<int>(3 * sigma_) - 1, 0);
  for (int j = first; j >= deepest; --j) {
    if (sign * at(j) > sign * at(top)) top = j;
  }
  const double half = sign * at(top) / 2;
  int j = top;
  while (j < count - 1 && sign * at(j) > half) ++j;
  const double fraction = (sign * at(j - 1) - half) / (sign * at(j - 1) - sign * at(j));
  n.found = std::isfinite(fraction);
  n.shift_px = j - 1 + fraction - reach.inward;
  n.variance = 0.25;  // half a px: the fit scales it to the scatter it finds
  n.contrast = at(top);
  slope = sign * (at(std::max(j - 2, 0)) - at(std::min(j + 1, count - 1))) / 3;
}

// In which the rim is searched. In the frame in which the ellipse of a body with corners is the
// unit circle, a box has its sides at 0.89 and its corners at 1.26. Outside, the tail of the rim's
// blur has to end within the reach, or the rim counts as lying further out: of a cylinder of 36 px
// by 18 in which search_px were taken at the corners, too, five to ten normals were found in one
// frame and lost in the next, and its length came and went by 0.8 px (docs/localization.md).
// Inside, the contrast has to be reached.
Contour::Reach Contour::reach_of(std::size_t k, const Ellipse& ellipse) const {
  constexpr double kInner = 0.84, kOuter = 0.95;  // a round's start is not the last ellipse
  constexpr double kTail = 2.5, kContrast = 3;    // sigma of blur
  constexpr double kFlat = 3;                     // px, beyond either
  const int usual = static_cast<int>(settings_.search_px);
  if (!settings_.corners) return {usual, usual};
  const double angle =
      2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(normals_.size());
  const double side = 1 / std::max(std::abs(std::cos(angle)), std::abs(std::sin(angle)));
  // px along the normal for the ellipse's own radius there
  const double own = normals_[k].outward.dot(normals_[k].rim_px - ellipse.center_px);
  const double out = std::max(0.0, kOuter * side - 1) * own + kTail * sigma_ + kFlat;
  const double in = std::max(0.0, 1 - kInner * side) * own + kContrast * sigma_ + kFlat;
  const auto within = [usual](double wanted) {
    return std::clamp(static_cast<int>(std::ceil(wanted)), usual, kMostReach);
  };
  return {within(std::min(in, own)), within(out)};
}

// All normals' half crossings. The blur from their slope: a step of contrast c blurred by sigma has
// the slope c / (sqrt(2 pi) sigma) at half height.
void Contour::take_crossings(const Images& images, const Ellipse& ellipse) {
  place_normals(ellipse, normals_);
  std::vector<double> contrasts;
  std::vector<double> slopes;
  for (std::size_t k = 0; k < normals_.size(); ++k) {
    Normal& n = normals_[k];
    double slope = 0;
    half_crossing(images, reach_of(k, ellipse), n, slope);
    if (!n.found) continue;
    contrasts.push_back(std::abs(n.contrast));
    slopes.push_back(slope);
  }
  const double steep = upper_median(slopes) * std::sqrt(2 * std::numbers::pi);
  const double estimated = steep > 0 ? upper_median(contrasts) / steep : 0;
  const double nominal = settings_.blur_sigma_px;
  sigma_ = estimated > kClearlyMore * nominal ? allowed_blur(estimated) : nominal;
}

// The ellipse through them. False when too few normals agree on one. `ellipse` is replaced only by
// a valid fit.
bool Contour::coarse_round(const Images& images, Ellipse& ellipse) {
  take_crossings(images, ellipse);
  const FittedEllipse fitted =
      settings_.corners ? fit_cornered(ellipse, normals_) : fit_ellipse(ellipse, normals_);
  if (fitted.valid) ellipse = fitted.ellipse;
  return fitted.valid;
}

// Rounds of least squares through the half crossings until the ellipse rests. What a crossing may
// be off by beside noise is a shade within the body, a corner's own blur.
std::optional<EllipseMeasurement> Contour::cornered(const Images& images, Ellipse ellipse) {
  constexpr int kRounds = 8;
  constexpr double kCrossing_px = 0.15;
  FittedEllipse fitted;
  for (int k = 0; k < kRounds; ++k) {
    take_crossings(images, ellipse);
    for (Normal& n : normals_) n.variance = kCrossing_px * kCrossing_px;
    fitted = fit_cornered(ellipse, normals_);
    if (!fitted.valid) return std::nullopt;
    const Eigen::Matrix<double, 5, 1> moved = fitted.ellipse.vector() - ellipse.vector();
    ellipse = fitted.ellipse;
    if (moved.head<4>().cwiseAbs().maxCoeff() < kLastMovePx) break;
  }
  return measurement(fitted);
}

// Rounds until the blur settles: with too small a blur half_crossing() searches the contrast too
// close to the rim, and the next round has the better estimate.
// Two rounds at least, four at most: the first brings the normals near the rim, the next sees the
// true contrast.
bool Contour::coarse_rounds(const Images& images, Ellipse& ellipse) {
  sigma_ = settings_.blur_sigma_px;
  for (int k = 0; k < kMostCoarseRounds; ++k) {
    const double before = sigma_;
    if (!coarse_round(images, ellipse)) return false;
    if (k + 1 >= kCoarseRounds && sigma_ < kClearlyMore * before) break;
  }
  return true;
}

// Lamps flicker: difference of the ground from the learnt one, as the median over the three
// outermost samples of all normals.
// The outermost samples, beyond 2.5 sigma of blur, show the ground alone.
double Contour::ground_offset() const {
  std::vector<double> off;
  for (std::size_t k = 0; k < normals_.size(); ++k) {
    if (!normals_[k].found) continue;
    for (auto j = static_cast<std::size_t>(count_ - 3); j < static_cast<std::size_t>(count_); ++j) {
      off.push_back(samples_[k].image[j] - samples_[k].ground[j]);
    }
  }
  return upper_median(off);
}

// What the image has of the body's own light, where the body covers `cover` of the pixel: image =
// (1 - cover) ground + body, after Porter & Duff's "over".
double Contour::light(std::size_t k, std::size_t j, double cover) const {
  return samples_[k].image[j] - offset_ - (1 - cover) * samples_[k].ground[j];
}

// Least squares of the body's brightness with the rim at its current position: normal equations,
// the right-hand side in the last column.
// Trust falls towards the middle, where highlights are (EdgeModel), so that they do not set the
// brightness.
Eigen::Matrix4d Contour::brightness_sums(std::size_t k) const {
  const EdgeModel::Profile& model = profile(k);
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (std::size_t j = 0; j < static_cast<std::size_t>(count_); ++j) {
    Eigen::Vector4d row;
    row << model[j].value, light(k, j, model[j].value[0]);
    sum.noalias() += model[j].trust * row * row.transpose();
  }
  return sum;
}

// The brightness at the rim and its rises inwards (root, linear). `prior` is the Tikhonov term
// (noise / (spread contrast))^2 on the rises, a Gaussian prior in units of the noise: it separates
// them where noise and blur make them nearly collinear.
// In gray levels: the shade at the rim, and its coefficients of n and n^2 over the depth.
Eigen::Vector3d Contour::brightness(std::size_t k, double noise, Eigen::Vector3d& prior) const {
  const Eigen::Matrix4d sum = brightness_sums(k);
  const double contrast =
      std::max(std::abs(sum(0, 3) / sum(0, 0) - ground_at_rim(k)), settings_.min_contrast / 2);
  const double likely = std::max(noise, 0.5) / contrast;  // never less than half a gray level
  prior = {0, std::pow(likely / kRootSpread, 2), std::pow(likely / kStraightSpread, 2)};
  Eigen::Matrix3d normal = sum.topLeftCorner<3, 3>();
  normal.diagonal() += prior;
  return normal.inverse() * sum.topRightCorner<3, 1>();
}

// Normal equations of one Gauss-Newton step in (shift of the rim, three of brightness, blur), the
// residual in the last row and column: sum of trust (J, r)' (J, r). Model of a pixel: (1 - cover)
// ground + body . value, whose derivative by shift and blur therefore has the ground in it.
// Rows and columns: 0 shift, 1 to 3 brightness, 4 blur, 5 residual.
Contour::StepSums Contour::step_sums(std::size_t k, const Eigen::Vector3d& body) const {
  const EdgeModel::Profile& model = profile(k);
  StepSums sum = StepSums::Zero();
  for (std::size_t j = 0; j < static_cast<std::size_t>(count_); ++j) {
    const EdgeSample& m = model[j];
    const double ground = samples_[k].ground[j];
    Eigen::Matrix<double, 6, 1> row;
    row << body.dot(m.by_shift) - ground * m.by_shift[0], m.value,
        body.dot(m.by_blur) - ground * m.by_blur[0], light(k, j, m.value[0]) - body.dot(m.value);
    sum.noalias() += m.trust * row * row.transpose();
  }
  return sum;
}

// Solves a normal for shift and brightness and eliminates both from the blur's equation (Schur
// complement): `gradient` and `hessian` of the blur can then be added up over the normals, and
// `shift_by_blur` corrects the shift once the common blur is known.
// The Schur complement makes the blur common to all normals at the price of one normal each: the
// full system would have four unknowns a normal. `variance` in px^2 is that of the shift alone.
void Contour::fit_edge(const Images& images, std::size_t k) {
  Edge& edge = edges_[k];
  Normal& n = normals_[k];
  const double ground = ground_at_rim(k);
  const double noise = noise_at(images.noise, ground);
  Eigen::Vector3d prior;
  const Eigen::Vector3d body = brightness(k, noise, prior);
  StepSums sum = step_sums(k, body);
  sum.diagonal().segment<3>(1) += prior;
  sum.block<3, 1>(1, 5) -= prior.cwiseProduct(body);
  const Eigen::Matrix4d inverse = sum.topLeftCorner<4, 4>().inverse();
  const Eigen::Vector4d column = sum.block<4, 1>(0, 4);
  const Eigen::Vector4d right = sum.block<4, 1>(0, 5);
  const Eigen::Vector4d solved = inverse * right;
  const Eigen::Vector4d by_blur = inverse * column;
  // Residual variance with count - 4 degrees of freedom.
  edge.misfit = std::max(sum(5, 5) - right.dot(solved), 0.0) / std::max(count_ - 4.0, 1.0);
  edge.gradient = sum(4, 5) - column.dot(solved);
  edge.hessian = sum(4, 4) - column.dot(by_blur);
  edge.shift_by_blur = by_blur[0];
  n.shift_px = solved[0];
  n.variance = inverse(0, 0) * std::max(edge.misfit, noise * noise);
  // At the rim: the constant shade, updated, less the ground.
  n.contrast = body[0] + solved[1] - ground;
  n.found = std::isfinite(n.shift_px) && n.variance > 0 && n.variance < 4 &&
            std::abs(n.contrast) > settings_.min_contrast / 2 &&
            std::abs(n.shift_px) < settings_.search_px / 2;
}

// Drops normals that the model does not describe (highlights, vessels that were not learnt, other
// bodies): those with a residual of more than four times the median one.
// Four times in amplitude is 16 in variance; the median is at least a quarter of a gray level
// squared, lest a noiseless image drop everything.
void Contour::drop_misfits() {
  std::vector<double> misfits;
  for (std::size_t k = 0; k < normals_.size(); ++k) {
    if (normals_[k].found) misfits.push_back(edges_[k].misfit);
  }
  const double largest = 16 * std::max(upper_median(misfits), 0.25);
  for (std::size_t k = 0; k < normals_.size(); ++k) normals_[k].found &= edges_[k].misfit < largest;
}

// One Gauss-Newton step of the common blur, limited to 40 % up and 30 % down, and the shifts that
// go with it.
// The limits keep one bad round from leaving the range in which the model is nearly linear.
void Contour::improve_blur() {
  double gradient = 0;
  double hessian = 0;
  for (std::size_t k = 0; k < normals_.size(); ++k) {
    if (!normals_[k].found) continue;
    gradient += edges_[k].trust * edges_[k].gradient;
    hessian += edges_[k].trust * edges_[k].hessian;
  }
  if (!(hessian > 0)) return;
  const double wanted = std::clamp(sigma_ + gradient / hessian, 0.7 * sigma_, 1.4 * sigma_);
  const double next = allowed_blur(wanted);
  for (std::size_t k = 0; k < normals_.size(); ++k)
    normals_[k].shift_px -= edges_[k].shift_by_blur * (next - sigma_);
  sigma_ = next;
}

// Normals, model profiles and samples for a round, from 2.5 sigma + 3 px within the rim, but not
// past 0.7 of the semi-minor axis, to 2.5 sigma + 3 px outside.
// The profiles of a quarter of the normals serve all by symmetry; their depth is limited so that
// the samples of a thin body do not reach its other side.
void Contour::sample_profiles(const Images& images, const Ellipse& ellipse) {
  inside_ = std::min(2.5 * sigma_ + 3, 0.7 * ellipse.semi_minor_px);
  count_ = std::min(static_cast<int>(inside_ + 2.5 * sigma_ + 3) + 1, EdgeModel::kMaxSamples);
  for (std::size_t k = 0; k < normals_.size(); ++k)
    edges_[k].trust = normals_[k].weight;  // of the round before
  place_normals(ellipse, normals_);
  for (std::size_t k = 0; k < profiles_.size(); ++k) {
    const double t =
        2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(normals_.size());
    model_.profile(ellipse.semi_major_px, ellipse.semi_minor_px, t, sigma_, inside_, count_,
                   profiles_[k]);
  }
  for (std::size_t k = 0; k < normals_.size(); ++k) {
    normals_[k].found =
        sample_normal(images.image, images.ground, normals_[k], inside_, count_, samples_[k]);
  }
  offset_ = ground_offset();
}

// One round of block-wise Gauss-Newton: edges and blur at the current ellipse, then the ellipse.
// Nothing when the ellipse through the shifts is not determined.
std::optional<FittedEllipse> Contour::fine_round(const Images& images, const Ellipse& ellipse) {
  sample_profiles(images, ellipse);
  for (std::size_t k = 0; k < normals_.size(); ++k) {
    if (normals_[k].found) fit_edge(images, k);
  }
  drop_misfits();
  improve_blur();
  FittedEllipse fitted = fit_ellipse(ellipse, normals_);
  if (!fitted.valid) return std::nullopt;
  return fitted;
}

// Of the normals that the fit kept.
double Contour::median_contrast() const {
  std::vector<double> contrasts;
  for (const Normal& n : normals_) {
    if (n.found && n.weight > 0) contrasts.push_back(std::abs(n.contrast));
  }
  return upper_median(contrasts);
}

// Coarse rounds bring the ellipse within the edge model's range, fine rounds iterate to convergence
// of ellipse and blur; the inlier fraction is of all normals, also of those outside of the image.
// `start` may be off by about search_px. Nothing when too little of the rim is there; the
// covariance is that of the last round.
std::optional<EllipseMeasurement> Contour::measure(const cv::Mat& image, const cv::Mat& ground,
                                                   const cv::Mat& noise, const Ellipse& start) {
  const Images images{image, ground, noise};
  Ellipse ellipse = start;
  if (!coarse_rounds(images, ellipse)) return std::nullopt;
  if (settings_.corners) return cornered(images, ellipse);
  FittedEllipse last{ellipse, {}, true};
  for (int k = 0; k < kFineRounds; ++k) {
    const double before = sigma_;
    const auto fitted = fine_round(images, last.ellipse);
    if (!fitted) return std::nullopt;
    const Eigen::Matrix<double, 5, 1> moved = fitted->ellipse.vector() - last.ellipse.vector();
    last = *fitted;
    if (moved.head<4>().cwiseAbs().maxCoeff() < kLastMovePx && std::abs(sigma_ / before - 1) < 0.02)
      break;
  }
  return measurement(last);
}

// Of the last round's normals.
EllipseMeasurement Contour::measurement(const FittedEllipse& fitted) const {
  EllipseMeasurement result;
  result.ellipse = fitted.ellipse;
  result.covariance = fitted.covariance;
  const auto agree = [](const Normal& n) { return n.found && n.weight > 0; };
  const auto count = static_cast<double>(std::count_if(normals_.begin(), normals_.end(), agree));
  result.inlier_fraction = count / static_cast<double>(normals_.size());
  result.contrast = median_contrast();
  for (const Normal& n : normals_) {
    if (n.found)
      result.contour.push_back({n.rim_px + n.shift_px * n.outward, n.outward, n.variance});
  }
  return result;
}

}  // namespace vitreo::vision
