// SPDX-License-Identifier: Apache-2.0
#include "vision/mosaic.h"

#include "vision/mosaic_adjust.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::vision {
namespace {

constexpr double kLost =
    15;  // px: refined farther than this from where the others put it, a link is another place

std::size_t at(int k) { return static_cast<std::size_t>(k); }

void check_views(std::span<const cv::Mat> views) {
  if (views.size() < 2) throw std::invalid_argument("views: a mosaic wants at least two");
  for (const cv::Mat& view : views) {
    if (view.size() != views[0].size() || view.type() != views[0].type())
      throw std::invalid_argument("views: must be of one size and type");
  }
}

// Each view to the one before it, else to the nearest in time that it fits.
std::vector<MosaicLink> chain_of(const std::vector<RegistrationView>& views,
                                 const RegistrationSettings& settings) {
  std::vector<MosaicLink> links;
  for (int second = 1; second < static_cast<int>(views.size()); ++second) {
    for (int first = second - 1; first >= 0; --first) {
      const auto found = register_views(views[at(first)], views[at(second)], settings);
      if (!found) continue;
      links.push_back({first, second, *found});
      break;
    }
  }
  return links;
}

using Places = std::vector<std::optional<Eigen::Affine2d>>;

// From one view along the links.
Places places_from(int root, int count, const std::vector<MosaicLink>& links) {
  Places places(at(count));
  places[at(root)] = Eigen::Affine2d::Identity();
  for (bool grew = true; std::exchange(grew, false);) {
    for (const MosaicLink& link : links) {
      auto &first = places[at(link.first)], &second = places[at(link.second)];
      const Eigen::Affine2d& first_from_second = link.registration.first_from_second;
      if (first && !second) second = *first * first_from_second, grew = true;
      if (second && !first) first = *second * first_from_second.inverse(), grew = true;
    }
  }
  return places;
}

int count_of(const Places& places) {
  return static_cast<int>(
      std::count_if(places.begin(), places.end(), [](const auto& p) { return p.has_value(); }));
}

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

struct Guess {
  int first, second;
  double overlap;
  Eigen::Affine2d first_from_second;
};

// Pairs that the chain's places say overlap, the largest overlaps first.
std::vector<Guess> guesses_of(const MosaicPlan& plan, const cv::Size& size, double least) {
  std::vector<Guess> guesses;
  const int count = static_cast<int>(plan.mosaic_from_view.size());
  for (int second = 0; second < count; ++second) {
    for (int first = 0; first < second; ++first) {
      const auto &a = plan.mosaic_from_view[at(first)], &b = plan.mosaic_from_view[at(second)];
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
                   [](const Guess& a, const Guess& b) { return a.overlap > b.overlap; });
  return guesses;
}

// A chain bends with each link's error; views that meet again later straighten it. Where the guess
// from the places is too far off, the pair is searched for anew.
void close_loops(MosaicPlan& plan, const std::vector<RegistrationView>& views,
                 const MosaicSettings& settings) {
  std::vector<int> links(views.size(), 0);
  for (const MosaicLink& link : plan.links) ++links[at(link.first)], ++links[at(link.second)];
  const cv::Size size = views[0].size();
  const Eigen::Vector2d middle(size.width / 2.0, size.height / 2.0);
  for (const Guess& guess : guesses_of(plan, size, settings.link_overlap)) {
    if (std::max(links[at(guess.first)], links[at(guess.second)]) >= settings.links_per_view)
      continue;
    const RegistrationView &first = views[at(guess.first)], &second = views[at(guess.second)];
    auto found = refine_registration(first, second, guess.first_from_second, settings.registration);
    if (!found) found = register_views(first, second, settings.registration);
    if (!found) continue;
    if ((found->first_from_second * middle - guess.first_from_second * middle).norm() > kLost)
      continue;
    plan.links.push_back({guess.first, guess.second, *found});
    ++links[at(guess.first)], ++links[at(guess.second)];
  }
}

}  // namespace

void MosaicSettings::check() const {
  registration.check();
  if (!(link_overlap > 0 && link_overlap < 1))
    throw std::invalid_argument("link_overlap: must be between 0 and 1");
  if (links_per_view < 2) throw std::invalid_argument("links_per_view: must be 2 at least");
  if (!(max_pixels >= 1 && max_pixels <= 1e9))
    throw std::invalid_argument("max_pixels: must be 1 to 1e9");
}

int MosaicPlan::joined() const { return count_of(mosaic_from_view); }

MosaicPlan plan_mosaic(std::span<const cv::Mat> views, const MosaicSettings& settings) {
  settings.check();
  check_views(views);
  std::vector<RegistrationView> prepared;
  prepared.reserve(views.size());
  for (const cv::Mat& view : views) prepared.emplace_back(view, settings.registration);
  MosaicPlan plan;
  plan.links = chain_of(prepared, settings.registration);
  const int count = static_cast<int>(views.size());
  int root = 0;
  for (int k = 0; k < count; ++k) {
    Places places = places_from(k, count, plan.links);
    if (count_of(places) > count_of(plan.mosaic_from_view))
      plan.mosaic_from_view = std::move(places), root = k;
  }
  if (count_of(plan.mosaic_from_view) == 1) plan.mosaic_from_view.assign(at(count), std::nullopt);
  std::erase_if(plan.links,
                [&](const MosaicLink& link) { return !plan.mosaic_from_view[at(link.first)]; });
  if (plan.links.empty()) return plan;
  close_loops(plan, prepared, settings);
  adjust_mosaic(plan, views[0].size(), root, settings.registration.model);
  return plan;
}

}  // namespace vitreo::vision
