// SPDX-License-Identifier: Apache-2.0
#include "vision/mosaic.h"

#include "vision/mosaic_adjust.h"
#include "vision/preconditions.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo::vision {
namespace {

// px: a link that refines farther than this from where the others put it joins another part of the
// retina.
constexpr double kFarOff = 15;

std::size_t as_index(int k) { return static_cast<std::size_t>(k); }

// Throws std::invalid_argument naming the views.
void check_uniform(std::span<const cv::Mat> views) {
  require(views.size() >= 2, "views: a mosaic wants at least two");
  for (const cv::Mat& view : views) {
    require(view.size() == views[0].size() && view.type() == views[0].type(),
            "views: must be of one size and type");
  }
}

// Structure that is the same in all views while the retina moves under them: dirt, dead pixels,
// what the optics reflect. Empty for fewer than five views, or where so much stays that the views
// did not move.
cv::Mat fixed_to_sensor(const std::vector<RegistrationView>& views) {
  constexpr std::size_t kFewestViews = 5;
  constexpr double kMuch = 0.05;  // of the view
  if (views.size() < kFewestViews) return {};
  cv::Mat sum = cv::Mat::zeros(views[0].size(), CV_32F);
  cv::Mat squares = sum.clone();
  for (const RegistrationView& view : views) {
    const cv::Mat& image = view.level(0).image;
    sum += image;
    squares += image.mul(image);
  }
  const auto count = static_cast<double>(views.size());
  const cv::Mat mean = cv::abs(sum) / count;
  const cv::Mat variance = squares / count - mean.mul(mean);
  // A flattened view has the deviation 1: chance means of five reach 1 in one pixel of a hundred,
  // but then with the deviation of the retina.
  cv::Mat fixed = (mean > 1) & (variance < 0.25 * mean.mul(mean));
  cv::dilate(fixed, fixed, cv::getStructuringElement(cv::MORPH_ELLIPSE, {9, 9}));
  if (cv::countNonZero(fixed) > kMuch * static_cast<double>(fixed.total())) return {};
  return fixed;
}

// Each view to the one before it, else to the nearest in time that it fits.
// One link places a view; close_loops() adds the redundant ones. A view that fits none is left out
// of the list.
std::vector<MosaicLink> chain_of(const std::vector<RegistrationView>& views,
                                 const RegistrationSettings& settings) {
  std::vector<MosaicLink> links;
  for (int second = 1; second < static_cast<int>(views.size()); ++second) {
    for (int first = second - 1; first >= 0; --first) {
      const auto found = register_views(views[as_index(first)], views[as_index(second)], settings);
      if (!found) continue;
      links.push_back({first, second, *found});
      break;
    }
  }
  return links;
}

using Poses = std::vector<std::optional<Eigen::Affine2d>>;

// Poses by composition along the links, from the view `root` at the origin; of the views it
// reaches.
// Views that the links do not reach have no pose.
Poses poses_from(int root, int count, const std::vector<MosaicLink>& links) {
  Poses poses(as_index(count));
  poses[as_index(root)] = Eigen::Affine2d::Identity();
  // Along the links in either direction, until no view is added.
  for (bool grew = true; std::exchange(grew, false);) {
    for (const MosaicLink& link : links) {
      auto& first = poses[as_index(link.first)];
      auto& second = poses[as_index(link.second)];
      const Eigen::Affine2d& first_from_second = link.registration.first_from_second;
      if (first && !second) second = *first * first_from_second, grew = true;
      if (second && !first) first = *second * first_from_second.inverse(), grew = true;
    }
  }
  return poses;
}

int count_of(const Poses& poses) {
  return static_cast<int>(
      std::count_if(poses.begin(), poses.end(), [](const auto& p) { return p.has_value(); }));
}

// Share of the second view that the first covers, on a 12 x 12 grid.
// Coarse, but only used to choose and order pairs.
double overlap_share(const Eigen::Affine2d& first_from_second, const cv::Size& size) {
  constexpr int kSide = 12;
  int inside = 0;
  for (int j = 0; j < kSide; ++j) {
    for (int i = 0; i < kSide; ++i) {
      const Eigen::Vector2d q =
          first_from_second *
          Eigen::Vector2d((i + 0.5) * size.width / kSide, (j + 0.5) * size.height / kSide);
      inside += q.x() >= 0 && q.y() >= 0 && q.x() < size.width && q.y() < size.height;
    }
  }
  return inside / static_cast<double>(kSide * kSide);
}

struct LinkGuess {
  int first;
  int second;
  double overlap;
  Eigen::Affine2d first_from_second;
};

// Pairs that overlap by the chain's poses and are not linked yet, the largest overlaps first.
// By the poses alone; no pixel is compared yet.
std::vector<LinkGuess> guesses_of(const MosaicPlan& plan, const cv::Size& size, double least) {
  std::vector<LinkGuess> guesses;
  const int count = static_cast<int>(plan.mosaic_from_view.size());
  for (int second = 0; second < count; ++second) {
    for (int first = 0; first < second; ++first) {
      const auto& a = plan.mosaic_from_view[as_index(first)];
      const auto& b = plan.mosaic_from_view[as_index(second)];
      const bool linked = std::any_of(
          plan.links.begin(), plan.links.end(),
          [&](const MosaicLink& link) { return link.first == first && link.second == second; });
      if (!a || !b || linked) continue;
      const Eigen::Affine2d first_from_second = a->inverse() * *b;
      const double overlap = overlap_share(first_from_second, size);
      if (overlap >= least) guesses.push_back({first, second, overlap, first_from_second});
    }
  }
  std::stable_sort(guesses.begin(), guesses.end(),
                   [](const LinkGuess& a, const LinkGuess& b) { return a.overlap > b.overlap; });
  return guesses;
}

// Loop closure: a chain accumulates every link's error, which links between views that meet again
// later correct. Where the guess from the chain is too far off, the pair is registered without it.
// links_per_view bounds the cost, which would else grow with the square of the number of views.
void close_loops(MosaicPlan& plan, const std::vector<RegistrationView>& views,
                 const MosaicSettings& settings) {
  std::vector<int> links(views.size(), 0);
  for (const MosaicLink& link : plan.links)
    ++links[as_index(link.first)], ++links[as_index(link.second)];
  const cv::Size size = views[0].size();
  const Eigen::Vector2d middle(size.width / 2.0, size.height / 2.0);
  for (const LinkGuess& guess : guesses_of(plan, size, settings.link_overlap)) {
    if (std::max(links[as_index(guess.first)], links[as_index(guess.second)]) >=
        settings.links_per_view)
      continue;
    const RegistrationView& first = views[as_index(guess.first)];
    const RegistrationView& second = views[as_index(guess.second)];
    auto found = refine_registration(first, second, guess.first_from_second, settings.registration);
    if (!found) found = register_views(first, second, settings.registration);
    if (!found) continue;
    if ((found->first_from_second * middle - guess.first_from_second * middle).norm() > kFarOff)
      continue;
    plan.links.push_back({guess.first, guess.second, *found});
    ++links[as_index(guess.first)], ++links[as_index(guess.second)];
  }
}

}  // namespace

void MosaicSettings::check() const {
  registration.check();
  require(link_overlap > 0 && link_overlap < 1, "link_overlap: must be between 0 and 1");
  require(links_per_view >= 2, "links_per_view: must be 2 at least");
  require(max_pixels >= 1 && max_pixels <= 1e9, "max_pixels: must be 1 to 1e9");
}

int MosaicPlan::joined() const { return count_of(mosaic_from_view); }

// Chain in time, largest connected group of views, loop closure, global adjustment.
// Views outside of the largest group have neither a pose nor links; the picture is made without
// them.
MosaicPlan plan_mosaic(std::span<const cv::Mat> views, const MosaicSettings& settings) {
  settings.check();
  check_uniform(views);
  std::vector<RegistrationView> prepared;
  prepared.reserve(views.size());
  for (const cv::Mat& view : views) prepared.emplace_back(view, settings.registration);
  const cv::Mat fixed = fixed_to_sensor(prepared);
  if (!fixed.empty())
    for (RegistrationView& view : prepared) view.leave_out(fixed);
  MosaicPlan plan;
  plan.links = chain_of(prepared, settings.registration);
  const int count = static_cast<int>(views.size());
  // The root that reaches the most views; of equals, the earliest.
  int root = 0;
  for (int k = 0; k < count; ++k) {
    Poses poses = poses_from(k, count, plan.links);
    if (count_of(poses) > count_of(plan.mosaic_from_view))
      plan.mosaic_from_view = std::move(poses), root = k;
  }
  // A single view is no mosaic: nothing is joined.
  if (count_of(plan.mosaic_from_view) == 1)
    plan.mosaic_from_view.assign(as_index(count), std::nullopt);
  std::erase_if(plan.links, [&](const MosaicLink& link) {
    return !plan.mosaic_from_view[as_index(link.first)];
  });
  if (plan.links.empty()) return plan;
  close_loops(plan, prepared, settings);
  adjust_mosaic(plan, views[0].size(), root, settings.registration.model);
  return plan;
}

}  // namespace vitreo::vision
