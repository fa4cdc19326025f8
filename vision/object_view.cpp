// SPDX-License-Identifier: Apache-2.0
#include "vision/object_view.h"

#include "vision/gray_evidence.h"
#include "vision/learned_evidence.h"
#include "vision/preconditions.h"

#include <algorithm>
#include <cmath>

namespace vitreo::vision {
namespace {

// Ratios of a segment's area to the predicted one beyond which it is a piece, or a leak: then the
// rim is searched at the prediction.
constexpr double kSmallestShare = 0.75;
constexpr double kLargestShare = 1.35;
// Share of the gate that has the object's colors from which there is no rim in it: every normal
// that is found needs ground beyond it, and a look asks for 35 % of them.
constexpr double kFullGate = 0.95;
constexpr int kClear = static_cast<int>(Evidence::kScale);  // F = -1: the ground's by e to one

double area_of(const Ellipse& e) {
  return 3.14159265358979323846 * e.semi_major_px * e.semi_minor_px;
}

}  // namespace

// Throws std::invalid_argument naming the setting.
void ObjectViewSettings::check() const {
  level_set.check();
  rim.check();
  require(gate_px >= 2 && gate_px <= 100, "gate_px: must be 2 to 100");
  require(angle_sigma > 0 && angle_sigma <= 10, "angle_sigma: must be above 0, at most 10 rad");
  require(shape_fit.iterations >= 1 && shape_fit.iterations <= 50,
          "shape_fit.iterations: must be 1 to 50");
  if (thresholds)
    require(thresholds->low <= thresholds->high, "thresholds: the lower is above the higher");
}

std::unique_ptr<EvidenceSource> evidence_source(const ObjectModel& model) {
  if (!model.network.empty()) return std::make_unique<LearnedEvidence>(model.color, model.network);
  if (model.gray.known) return std::make_unique<GrayEvidence>(model.gray);
  return std::make_unique<ColorEvidence>(model.color);
}

ObjectView::ObjectView(const ObjectModel& model, const ObjectViewSettings& settings)
    : model_(&model),
      settings_(settings),
      thresholds_(settings.thresholds.value_or(model.thresholds())),
      // The object at twice its size or a little more, and room for a gate that has grown.
      max_side_px_(static_cast<int>(5 * model.semi_axes_px.x() + 6 * settings.gate_px) + 16),
      source_(evidence_source(model)),
      level_set_(settings.level_set),
      rim_(settings.rim) {
  settings.check();
  evidence_.reserve(max_side_px_);
  if (source_->rim() != source_.get()) rim_evidence_.reserve(max_side_px_);
  level_set_.reserve(max_side_px_);
  front_.reserve(4 * static_cast<std::size_t>(settings.level_set.max_points));
}

// Shares of the ellipse's pixels for and against the object, over every second pixel and row.
// A pixel outside of the region was not looked at: it counts for neither side, but in the whole.
// One outside of the image does not count: an object that leaves it is judged by what is left.
void ObjectView::count_support(const Ellipse& ellipse, Observation& observation) const {
  const cv::Rect& region = evidence_.region();
  int count = 0;
  int for_it = 0;
  int against = 0;
  int sum = 0;  // a blocked pixel counts as the surest ground
  const int top = static_cast<int>(ellipse.center_px.y() - ellipse.semi_major_px);
  const int bottom = static_cast<int>(ellipse.center_px.y() + ellipse.semi_major_px) + 1;
  const EllipseRows rows(ellipse);
  for (int v = top; v < bottom; v += 2) {
    const RowSpan span = rows.at(v);
    for (int u = span.first; u < span.end; u += 2) {
      if (!evidence_.in_image(u, v)) continue;
      ++count;
      if (!region.contains({u, v})) continue;
      const std::int16_t f = evidence_.at(u, v);
      for_it += f > 0;
      sum += std::clamp<int>(f, -4 * kClear, 4 * kClear);
      against += f < -kClear && f != Evidence::kBlocked;
    }
  }
  observation.support = static_cast<double>(for_it) / std::max(count, 1);
  observation.against =
      std::max(static_cast<double>(against) / std::max(count, 1) - source_->own_against(), 0.0);
  observation.evidence = static_cast<double>(sum) / (std::max(count, 1) * Evidence::kScale);
}

// In each a step of one is what distinguishes good looks from bad ones: shares by thirds, axes by a
// sixth of their length, the claimed deviation and the segment's area by factors, the size by a
// factor of 1.4, the rim's unevenness by two thirds of a pixel.
LookFeatures features_of(const Observation& seen, double size) {
  const EllipseMeasurement& m = *seen.measured;
  const double sigma = std::sqrt(std::max(m.covariance.topLeftCorner<2, 2>().trace() / 2, 1e-6));
  const double a = m.ellipse.semi_major_px / seen.expected_axes_px.x();
  const double b = m.ellipse.semi_minor_px / seen.expected_axes_px.y();
  const double share = std::clamp(seen.segment.area_px / area_of(m.ellipse), 0.1, 10.0);
  const std::array<double, kLookFeatures> of{3 * m.inlier_fraction,
                                             m.contrast / 2,
                                             3 * seen.support,
                                             4 * seen.against,
                                             std::log(sigma),
                                             6 * std::log(a),
                                             6 * std::log(b),
                                             seen.evidence,
                                             1.5 * std::log(share),
                                             1.5 * std::log(size),
                                             1.5 * std::min(seen.unevenness_px, 3.0)};
  LookFeatures features;
  for (std::size_t k = 0; k < features.size(); ++k)
    features[k] = static_cast<float>(std::clamp(of[k], -20.0, 20.0));
  return features;
}

// Thesis 8.2 in order: F within the gate, cycles one and two, the shape prior from the front (8.4)
// and cycle three; then, beyond the thesis, the sub-pixel rim around the shape. With a rim to be
// found cycle three comes last, and only where there is one: it changes nothing of the rim.
// A segment of an area unlike the prediction's is a piece or has run into a vessel: the rim is then
// searched around the prediction.
Observation ObjectView::observe(const cv::Mat& image, const Ellipse& expected, double gate_px,
                                const EllipsePrior& prior, const Owned& owned, bool from_front) {
  Observation result;
  result.expected_axes_px = {expected.semi_major_px, expected.semi_minor_px};
  const Evidence& at_rim = read(image, expected, gate_px, owned);
  if (settings_.refine && evidence_.share_above(0) > kFullGate) return result;
  level_set_.start(at_rim, expected);
  level_set_.evolve(thresholds_);
  result.segment = level_set_.keep_largest();
  Ellipse at = result.segment.ellipse;
  double area = result.segment.area_px;
  if (settings_.shape_prior && area > 0 && !level_set_.leaked()) {
    level_set_.front(front_);
    result.shape = model_->shape.fit(front_, model_->shape.pose_of(expected), settings_.shape_fit);
    // The prior's ellipse is taken only for refinement; else the moments of what cycle three left.
    if (settings_.refine) {
      at = model_->shape.ellipse_of(*result.shape);
      area = area_of(at);
    } else {
      to_prior(result);
      at = result.segment.ellipse;
      area = result.segment.area_px;
    }
  }
  const double share = area / area_of(expected);
  const bool like =
      from_front && share > kSmallestShare && share < kLargestShare && at.semi_minor_px > 2;
  if (settings_.refine) {
    result.measured = rim_.measure(at_rim, like ? at : expected, prior);
    result.unevenness_px = rim_.unevenness_px();
    if (result.measured && result.shape) to_prior(result);
  } else if (at.semi_minor_px > 1) {
    // Moments have no covariance of their own: the calibration adds one.
    result.measured =
        EllipseMeasurement{at, Eigen::Matrix<double, 5, 5>::Zero(), like ? 1.0 : 0.0, 0};
  }
  result.leaked = level_set_.leaked();
  result.iterations = level_set_.iterations();
  if (result.measured) count_support(result.measured->ellipse, result);
  return result;
}

// F in the gate around `expected`; returns that which decides on the outline.
const Evidence& ObjectView::read(const cv::Mat& image, const Ellipse& expected, double gate_px,
                                 const Owned& owned) {
  source_->surround(image, expected, owned.map, owned.self);
  const Ellipse gate = grown(expected, gate_px);
  evidence_.look(image, *source_, gate, max_side_px_, owned.map, owned.self);
  EvidenceSource* rim_source = source_->rim();
  if (rim_source == source_.get()) return evidence_;
  rim_evidence_.look(image, *rim_source, gate, max_side_px_, owned.map, owned.self);
  return rim_evidence_;
}

// Cycle three, table 8.1.
void ObjectView::to_prior(Observation& result) {
  level_set_.evolve_to_prior(PlacedShape(model_->shape, *result.shape));
  result.segment = level_set_.keep_largest();
}

}  // namespace vitreo::vision
