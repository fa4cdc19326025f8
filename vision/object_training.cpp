// Training of an object model: colors, shape and calibration from images with masks.
// SPDX-License-Identifier: Apache-2.0
#include "vision/color_statistics.h"
#include "vision/learned_evidence.h"
#include "vision/look_training.h"
#include "vision/moments.h"
#include "vision/object_model.h"
#include "vision/object_view.h"
#include "vision/preconditions.h"

#include <Eigen/Eigenvalues>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace vitreo::vision {
namespace {

using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

// Smallest variances of a calibration: a few masks cannot show less. px^2, and rad^2 for the angle.
constexpr double kLeastPx2 = 0.004;
constexpr double kLeastAngle2 = 1e-5;

// The largest part of a hand-drawn mask: a stray dot far away would turn and stretch all moments.
// There is one: empty masks were refused by check_labeled().
cv::Mat largest_part(const cv::Mat& mask) {
  cv::Mat labels;
  cv::Mat statistics;
  cv::Mat centroids;
  cv::Mat part;
  const int count = cv::connectedComponentsWithStats(mask, labels, statistics, centroids);
  int best = 1;
  for (int k = 2; k < count; ++k)
    if (statistics.at<int>(k, cv::CC_STAT_AREA) > statistics.at<int>(best, cv::CC_STAT_AREA))
      best = k;
  cv::compare(labels, best, part, cv::CMP_EQ);
  return part;
}

// Whether the mask touches the image's border, and so may be cut by it.
// Its moments would be those of a part.
bool at_edge(const cv::Mat& mask) {
  const int u = mask.cols - 1;
  const int v = mask.rows - 1;
  return cv::countNonZero(mask.row(0)) + cv::countNonZero(mask.row(v)) +
             cv::countNonZero(mask.col(0)) + cv::countNonZero(mask.col(u)) >
         0;
}

// The images that show the whole object, for its shape, each with its mask's largest part and that
// part's moment ellipse; all, where none does.
// Throws std::invalid_argument naming the image, from 1, for another size or an object too small to
// have an axis.
std::vector<KnownObject> whole_masks(std::span<const LabeledImage> images) {
  std::vector<KnownObject> all;
  std::vector<KnownObject> whole;
  for (std::size_t k = 0; k < images.size(); ++k) {
    const std::string which = "image " + std::to_string(k + 1) + ": ";
    require(images[k].image.size() == images[0].image.size(), which + "has another size");
    const cv::Mat part = largest_part(images[k].mask);
    all.push_back({{images[k].image, part}, moments_of(part).ellipse({0, 0})});
    if (at_edge(part)) continue;
    require(all.back().truth.semi_minor_px >= 2.5, which + "its mask is thinner than 5 px");
    whole.push_back(all.back());
  }
  require(!whole.empty() || all[0].truth.semi_minor_px >= 2.5,
          "image 1: its mask is thinner than 5 px");
  return whole.empty() ? all : whole;
}

// The nearest positive semidefinite matrix (negative eigenvalues set to 0, Higham 1988), in units
// in which an angle counts as the rim that it moves, at 20 px: the difference of two estimated
// covariances need not be a covariance.
Matrix5 positive_part(const Matrix5& matrix) {
  const Vector5 unit = (Vector5() << 1, 1, 1, 1, 20).finished();
  const Eigen::SelfAdjointEigenSolver<Matrix5> solver(unit.asDiagonal() * matrix *
                                                      unit.asDiagonal());
  const Vector5 values = solver.eigenvalues().cwiseMax(0);
  const Matrix5 good =
      solver.eigenvectors() * values.asDiagonal() * solver.eigenvectors().transpose();
  return unit.cwiseInverse().asDiagonal() * good * unit.cwiseInverse().asDiagonal();
}

// Bias of the axes and covariance of what the measurements' own covariance, `reported` on average,
// does not explain: Cov(errors) - reported. `errors`: measured less true, of single measurements.
// Covariance with the divisor n - 1, as the bias is estimated from the same errors.
Calibration from_errors(const std::vector<Vector5>& errors, const Matrix5& reported) {
  Calibration result;
  const auto count = static_cast<double>(errors.size());
  for (const Vector5& e : errors) result.semi_axes_px += e.segment<2>(2) / count;
  for (Vector5 e : errors) {
    e.segment<2>(2) -= result.semi_axes_px;
    result.covariance += e * e.transpose() / std::max(count - 1, 1.0);
  }
  if (count < 5) result.covariance *= 3;  // a variance from so few masks is hardly known
  result.covariance = positive_part(result.covariance - reported);
  // The center's error follows the direction of the light, which may differ in other images: made
  // isotropic, and uncorrelated with axes and angle.
  const double mean = result.covariance.topLeftCorner<2, 2>().trace() / 2;
  result.covariance.topLeftCorner<2, 2>() = mean * Eigen::Matrix2d::Identity();
  result.covariance.topRightCorner<2, 3>().setZero();
  result.covariance.bottomLeftCorner<3, 2>().setZero();
  result.covariance.diagonal().head<4>().array() += kLeastPx2;
  result.covariance(4, 4) += kLeastAngle2;
  return result;
}

// Measures every training image from its true ellipse and compares. Failures, with few normals or a
// center off by more than 5 px, are the tracker's to reject, not the calibration's to explain.
// `refine`: of the rim, else of the level set's segment; both have a bias of their own.
Calibration calibration_of(const ObjectModel& model, const std::vector<KnownObject>& images,
                           ObjectViewSettings settings, bool refine) {
  settings.refine = refine;
  ObjectView view(model, settings);
  std::vector<Vector5> errors;
  Matrix5 reported = Matrix5::Zero();
  for (const auto& [labeled, truth] : images) {
    const EllipsePrior prior{truth, 5, 2, settings.angle_sigma};
    const Observation seen = view.observe(labeled.image, truth, settings.gate_px, prior);
    if (!seen.measured || seen.measured->inlier_fraction < 0.5) continue;
    Vector5 error = seen.measured->ellipse.vector() - truth.vector();
    error[4] = std::remainder(error[4], std::numbers::pi);  // an axis has no sense
    if (error.head<2>().norm() > 5) continue;
    errors.push_back(error);
    reported += seen.measured->covariance;
  }
  return from_errors(
      errors, errors.empty() ? reported : Matrix5(reported / static_cast<double>(errors.size())));
}

// Of ground and object, each the mean over the images; the ground without what is near the object.
TrainedLight light_of(const std::vector<KnownObject>& images) {
  TrainedLight light;
  int objects = 0;
  for (const auto& [labeled, truth] : images) {
    cv::Mat near;
    cv::dilate(labeled.mask, near, cv::getStructuringElement(cv::MORPH_RECT, {9, 9}));
    light.ground += log_light(labeled.image, near) / static_cast<double>(images.size());
    const auto within = log_color_within(labeled.image, truth);
    if (!within) continue;
    light.object += *within;
    ++objects;
  }
  light.object /= std::max(objects, 1);
  light.known = objects > 0;
  return light;
}

// F of every pixel, natural units.
cv::Mat f_of(EvidenceSource& source, const cv::Mat& image) {
  source.prepare(image, {{0, 0}, image.size()});
  cv::Mat whole(image.size(), CV_8SC1);
  for (int v = 0; v < image.rows; ++v)
    source.read(image, v, 0, 1, image.cols, whole.ptr<std::int8_t>(v));
  cv::Mat f;
  whole.convertTo(f, CV_32F, 1 / ColorModel::kScale);
  return f;
}

// (8.2) on the F that the network has a part in, weighted as that of the colors.
Thresholds thresholds_with(const ObjectModel& model, std::span<const LabeledImage> images,
                           const ColorModelSettings& settings) {
  LearnedEvidence source(model.color, model.network);
  const auto evidence = [&source](const cv::Mat& image) { return f_of(source, image); };
  return thresholds_of(images, evidence, settings)[1];
}

// (8.2) on the F of gray levels, each image's against the ground around its object.
// thresholds_of() asks for each image once, in their order.
Thresholds thresholds_gray(const ObjectModel& model, std::span<const LabeledImage> images,
                           const ColorModelSettings& settings) {
  GrayEvidence source(model.gray);
  std::size_t next = 0;
  const auto evidence = [&](const cv::Mat& image) {
    const Ellipse object = moments_of(largest_part(images[next++].mask)).ellipse({0, 0});
    source.surround(image, object, {}, 0);
    return f_of(source, image);
  };
  return thresholds_of(images, evidence, settings)[1];
}

}  // namespace

// Colors first: shape and calibration are measured with them. The calibrations use the training
// images themselves, so they show the bias, not how far it generalizes.
// Throws std::invalid_argument naming the image at fault.
ObjectModel ObjectModel::train(std::span<const LabeledImage> images,
                               const ColorModelSettings& color, const ObjectViewSettings& view,
                               const std::string& network) {
  view.check();
  ObjectModel model;
  model.color = ColorModel::train(images, color);
  if (!network.empty()) {
    LearnedEvidence::check(network);
    model.network = network;
    model.network_thresholds = thresholds_with(model, images, color);
  }
  if (network.empty()) model.gray = GrayModel::train(images);
  if (model.gray.known) model.gray.thresholds = thresholds_gray(model, images, color);
  const std::vector<KnownObject> whole = whole_masks(images);
  std::vector<cv::Mat> masks;
  masks.reserve(whole.size());
  for (const KnownObject& one : whole) masks.push_back(one.labeled.mask);
  model.shape = ShapeModel::train(masks);
  model.image_size = images[0].image.size();
  for (const auto& [labeled, e] : whole) {
    model.semi_axes_px +=
        Eigen::Vector2d(e.semi_major_px, e.semi_minor_px) / static_cast<double>(whole.size());
  }
  model.rim = calibration_of(model, whole, view, true);
  model.segment = calibration_of(model, whole, view, false);
  model.light = light_of(whole);
  learn_looks(model, whole, view);
  return model;
}

}  // namespace vitreo::vision
