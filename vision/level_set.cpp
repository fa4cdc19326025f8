// SPDX-License-Identifier: Apache-2.0
#include "vision/level_set.h"

#include "vision/moments.h"
#include "vision/preconditions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>

namespace vitreo::vision {
namespace {

// A Gaussian of sigma 1.2 px, 4 exp(-x^2 / (2 sigma^2)) rounded; only the sign of a sum counts.
constexpr std::array kSmoothingKernel{1, 3, 4, 3, 1};

}  // namespace

void LevelSetSettings::check() const {
  require(iterations >= 1 && iterations <= 200, "iterations: must be 1 to 200");
  require(smoothing >= 0 && smoothing <= 20, "smoothing: must be 0 to 20");
  require(rounds >= 1 && rounds <= 10, "rounds: must be 1 to 10");
  require(prior_iterations >= 0 && prior_iterations <= 50, "prior_iterations: must be 0 to 50");
  require(max_points >= 64 && max_points <= 1000000, "max_points: must be 64 to 1000000");
}

LevelSet::LevelSet(const LevelSetSettings& settings) : settings_(settings) {
  settings.check();
  // A pass adds at most three neighbors a point before the length is checked.
  const auto most = 4 * static_cast<std::size_t>(settings.max_points);
  for (List* list : {&in_, &out_, &kept_, &added_}) list->reserve(most);
  flag_.resize(most);
}

// Called once with the largest region, so that no frame allocates.
void LevelSet::reserve(int side_px) {
  const auto size =
      (static_cast<std::size_t>(side_px) + 2) * (static_cast<std::size_t>(side_px) + 2);
  phi_.reserve(size);
  runs_.reserve(size / 2);
}

// phi = -3 inside the ellipse, +3 elsewhere, then the two lists. Row by row between kMargin and the
// region's end: a pixel of the front always has its 5 x 5 neighborhood in the region.
// `evidence` is kept by its address until the next start(). Lists, leak and count of iterations
// begin anew.
void LevelSet::start(const Evidence& evidence, const Ellipse& ellipse) {
  evidence_ = &evidence;
  const cv::Rect& region = evidence.region();
  stride_ = region.width;
  const auto size =
      static_cast<std::size_t>(region.width) * static_cast<std::size_t>(region.height);
  if (phi_.size() < size) {
    phi_.resize(size);
    runs_.reserve(size / 2);
  }
  std::fill_n(phi_.begin(), size, std::int8_t{3});
  in_.clear();
  out_.clear();
  leaked_ = false;
  iterations_ = 0;
  const int top = region.y + Evidence::kMargin;
  const int bottom = region.y + region.height - Evidence::kMargin;
  const int left = region.x + Evidence::kMargin;
  const int right = region.x + region.width - Evidence::kMargin;
  const std::int16_t* f = evidence.values().data();
  const EllipseRows rows(ellipse);
  for (int v = top; v < bottom; ++v) {
    const RowSpan span = rows.at(v);
    const int from = static_cast<int>(evidence.index_of(std::clamp(span.first, left, right), v));
    const int to = static_cast<int>(evidence.index_of(std::clamp(span.end, left, right), v));
    for (int p = from; p < to; ++p) {
      if (f[p] != Evidence::kBlocked) phi_[static_cast<std::size_t>(p)] = -3;
    }
  }
  list_front(static_cast<int>(evidence.index_of(left, top)), static_cast<int>(size));
}

// L_in and L_out of thesis 8.2.1, by their definitions, for a phi that is 3 outside and -3 inside,
// of `size` pixels the first and last `skip` of which are outside.
void LevelSet::list_front(int skip, int size) {
  const std::array<int, 4> around{-1, 1, -stride_, stride_};
  const int first = skip;
  const int end = size - skip;
  for (int p = next_inside(first, end); p < end; p = next_inside(p + 1, end)) {
    std::int8_t* phi = phi_.data() + p;
    if ((phi[-1] < 0 && phi[1] < 0 && phi[-stride_] < 0 && phi[stride_] < 0)) continue;
    *phi = -1;
    in_.push_back(p);
    for (const int d : around) {
      if (phi[d] != 3) continue;
      phi[d] = 1;
      out_.push_back(p + d);
    }
    // A front this long is no object's, and the lists would outgrow their room.
    if (in_.size() + out_.size() > static_cast<std::size_t>(settings_.max_points)) {
      leaked_ = true;
      return;
    }
  }
}

// switch_in() of thesis 8.2.1 for the points of L_out that are flagged: to L_in, and their exterior
// 4-neighbors to L_out. By two vectors that swap: nothing is erased from the middle of a list.
// A pixel is marked in phi when it is added, so it enters a list only once.
void LevelSet::switch_in() {
  kept_.clear();
  added_.clear();
  for (std::size_t k = 0; k < out_.size(); ++k) {
    const int p = out_[k];
    if (flag_[k] == 0) {
      kept_.push_back(p);
      continue;
    }
    std::int8_t* phi = phi_.data() + p;
    *phi = -1;
    in_.push_back(p);
    for (const int d : {-1, 1, -stride_, stride_}) {
      if (phi[d] != 3) continue;
      phi[d] = 1;
      added_.push_back(p + d);
    }
  }
  kept_.insert(kept_.end(), added_.begin(), added_.end());
  std::swap(out_, kept_);
}

// switch_out() of thesis 8.2.1 for the flagged points of L_in: to L_out, and their interior
// 4-neighbors to L_in.
void LevelSet::switch_out() {
  kept_.clear();
  added_.clear();
  for (std::size_t k = 0; k < in_.size(); ++k) {
    const int p = in_[k];
    if (flag_[k] == 0) {
      kept_.push_back(p);
      continue;
    }
    std::int8_t* phi = phi_.data() + p;
    *phi = 1;
    out_.push_back(p);
    for (const int d : {-1, 1, -stride_, stride_}) {
      if (phi[d] != -3) continue;
      phi[d] = -1;
      added_.push_back(p + d);
    }
  }
  kept_.insert(kept_.end(), added_.begin(), added_.end());
  std::swap(in_, kept_);
}

// Drops the points that have only neighbors of their own `sign`: they are no longer at the front.
// Table 8.1 has this deletion after each switch; Shi & Karl have it in cycles one and two as well.
void LevelSet::clean(List& list, int sign) {
  std::size_t kept = 0;
  for (const int p : list) {
    std::int8_t* phi = phi_.data() + p;
    if (phi[-1] * sign > 0 && phi[1] * sign > 0 && phi[-stride_] * sign > 0 &&
        phi[stride_] * sign > 0) {
      *phi = static_cast<std::int8_t>(3 * sign);
    } else {
      list[kept++] = p;
    }
  }
  list.resize(kept);
  if (in_.size() + out_.size() > static_cast<std::size_t>(settings_.max_points)) leaked_ = true;
}

// Cycle one of thesis 8.2.1, one iteration: x in L_out switches in if F(x) > t_h, x in L_in
// switches out if F(x) < t_l; with t_l = t_h = 0 it is Shi & Karl's data-driven cycle, which
// descends the region energy. Blocked pixels have the lowest F and never switch in. True when no
// point switched.
// Between the thresholds a pixel stays what it is (8.1.2: as in hysteresis), so the result depends
// on the start.
bool LevelSet::cycle_one(const Thresholds& thresholds) {
  const std::int16_t* f = evidence_->values().data();
  // In the map's units: integers are compared.
  const auto high = static_cast<int>(std::lround(thresholds.high * Evidence::kScale));
  const auto low = static_cast<int>(std::lround(thresholds.low * Evidence::kScale));
  int switched = 0;
  for (std::size_t k = 0; k < out_.size(); ++k) switched += flag_[k] = f[out_[k]] > high;
  switch_in();
  clean(in_, -1);
  for (std::size_t k = 0; k < in_.size(); ++k) switched += flag_[k] = f[in_[k]] < low;
  switch_out();
  clean(out_, 1);
  return switched == 0;
}

// The sign of (G * phi)(p), by the separable kernel's outer product.
// Kernel and phi are small integers, so the sum is exact.
int LevelSet::smoothed(int p) const {
  int sum = 0;
  for (int j = 0; j < 5; ++j) {
    const std::int8_t* row = phi_.data() + p + (j - 2) * stride_ - 2;
    sum += kSmoothingKernel[static_cast<std::size_t>(j)] *
           (row[0] + row[4] + 3 * (row[1] + row[3]) + 4 * row[2]);
  }
  return sum;
}

// Cycle two, one iteration: x in L_out switches in if (G * phi)(x) < 0, x in L_in out if it is > 0
// (Shi & Karl 2005). Filtering phi by a Gaussian is motion by mean curvature to first order
// (Merriman, Bence & Osher 1992), the descent of the front's length.
// A blocked pixel never switches in, or smoothing would round the front into another object.
void LevelSet::cycle_two() {
  const std::int16_t* f = evidence_->values().data();
  for (std::size_t k = 0; k < out_.size(); ++k)
    flag_[k] = smoothed(out_[k]) < 0 && f[out_[k]] != Evidence::kBlocked;
  switch_in();
  clean(in_, -1);
  for (std::size_t k = 0; k < in_.size(); ++k) flag_[k] = smoothed(in_[k]) > 0;
  switch_out();
  clean(out_, 1);
}

// N_a iterations of cycle one, or until it has converged, then N_g of cycle two; repeated `rounds`
// times at most, as smoothing may open the way for the data again.
// The round in which cycle one converges is the last; its cycle two still runs.
void LevelSet::evolve(const Thresholds& thresholds) {
  bool settled = false;
  for (int round = 0; round < settings_.rounds && !settled; ++round) {
    for (int k = 0; k < settings_.iterations && !settled && !leaked_; ++k, ++iterations_)
      settled = cycle_one(thresholds);
    for (int k = 0; k < settings_.smoothing && !leaked_; ++k) cycle_two();
  }
}

// Table 8.1: N_s iterations in which x in L_out switches in if phi*(x) < 0, and x in L_in out if
// phi*(x) > 0, each followed by the deletion of points that left the front (clean()).
// Only the sign of phi* counts, and only at the points of the lists. A blocked pixel stays outside
// whatever the prior asks.
void LevelSet::evolve_to_prior(const PlacedShape& prior) {
  const std::int16_t* f = evidence_->values().data();
  const cv::Rect& region = evidence_->region();
  const auto at = [&](int p) {
    const cv::Point pixel(region.x + p % stride_, region.y + p / stride_);
    return prior.at(pixel.x, pixel.y);
  };
  for (int i = 0; i < settings_.prior_iterations && !leaked_; ++i) {
    for (std::size_t k = 0; k < out_.size(); ++k)
      flag_[k] = f[out_[k]] != Evidence::kBlocked && at(out_[k]) < 0;
    switch_in();
    clean(in_, -1);
    for (std::size_t k = 0; k < in_.size(); ++k) flag_[k] = at(in_[k]) > 0;
    switch_out();
    clean(out_, 1);
  }
}

// The runs of the inside by rows, each joined with those of the row above that it touches
// (4-connected, union-find). Nothing is inside the margin.
void LevelSet::find_runs() {
  const cv::Rect& region = evidence_->region();
  runs_.clear();
  std::size_t above = 0;  // first run of the row above
  for (int v = Evidence::kMargin; v < region.height - Evidence::kMargin; ++v) {
    const std::size_t row = runs_.size();
    std::size_t k = above;
    const int origin = v * stride_;
    for (int p = next_inside(origin, origin + stride_); p < origin + stride_;) {
      int end = p + 1;
      while (phi_[static_cast<std::size_t>(end)] < 0) ++end;
      const auto one = static_cast<int>(runs_.size());
      runs_.push_back({p, end, one});
      while (k < row && runs_[k].end <= p - stride_) ++k;
      for (std::size_t j = k; j < row && runs_[j].first < end - stride_; ++j)
        join(one, static_cast<int>(j));
      p = next_inside(end, origin + stride_);
    }
    above = row;
  }
}

// First pixel of [from, end) that is inside, or `end`; eight outside ones, of which phi is 1 or 3
// and no sign bit is set, are passed at once.
int LevelSet::next_inside(int from, int end) const {
  const std::int8_t* phi = phi_.data();
  for (; from + 8 <= end; from += 8) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, phi + from, 8);
    if ((eight & 0x8080808080808080U) != 0) break;
  }
  while (from < end && phi[from] > 0) ++from;
  return from;
}

int LevelSet::root_of(int run) {
  while (runs_[static_cast<std::size_t>(run)].root != run)
    run = runs_[static_cast<std::size_t>(run)].root;
  return run;
}

void LevelSet::join(int a, int b) {
  a = root_of(a);
  b = root_of(b);
  runs_[static_cast<std::size_t>(std::max(a, b))].root = std::min(a, b);
}

// Area, moments and F of the part with the root `root`. Sums are taken in coordinates of the
// region, exactly in integers, and moved to the image at the end.
Segment LevelSet::segment_of(int root) {
  MomentSums sums;
  std::int64_t evidence = 0;
  const std::int16_t* f = evidence_->values().data();
  for (const Run& run : runs_) {
    if (run.root != root) continue;
    const int v = run.first / stride_;
    sums.add_run(run.first - v * stride_, run.end - v * stride_, v);
    std::int32_t of_run = 0;
    for (int p = run.first; p < run.end; ++p) of_run += f[p];
    evidence += of_run;
  }
  const cv::Rect& region = evidence_->region();
  return {static_cast<double>(sums.count), sums.ellipse({region.x, region.y}),
          static_cast<double>(evidence) / static_cast<double>(sums.count) / Evidence::kScale};
}

// The area is 0 when nothing is inside.
Segment LevelSet::keep_largest() {
  find_runs();
  int parts = 0;
  for (std::size_t k = 0; k < runs_.size(); ++k) {
    Run& run = runs_[k];
    run.root = root_of(static_cast<int>(k));
    parts += run.root == static_cast<int>(k);
    runs_[static_cast<std::size_t>(run.root)].area += run.end - run.first;
  }
  if (parts == 0) return {};
  const auto largest = std::max_element(runs_.begin(), runs_.end(),
                                        [](const Run& a, const Run& b) { return a.area < b.area; });
  const auto root = static_cast<int>(largest - runs_.begin());
  Segment best = segment_of(root);
  // The other parts become outside, which leaves points of L_out without an inside neighbor.
  if (parts == 1) return best;
  for (const Run& run : runs_)
    if (run.root != root)
      std::fill(phi_.begin() + run.first, phi_.begin() + run.end, std::int8_t{3});
  std::erase_if(in_, [&](int p) { return phi_[static_cast<std::size_t>(p)] > 0; });
  clean(out_, 1);
  return best;
}

// The rim lies between the two lists, half a pixel from either on average.
// In image coordinates, the distance with the sign of phi; what the shape prior is fitted to.
void LevelSet::front(std::vector<FrontPoint>& points) const {
  points.clear();
  const cv::Rect& region = evidence_->region();
  const auto add = [&](const auto& list, float distance) {
    for (const int p : list) {
      const cv::Point pixel(region.x + p % stride_, region.y + p / stride_);
      points.push_back({static_cast<float>(pixel.x), static_cast<float>(pixel.y), distance});
    }
  };
  add(in_, -0.5F);
  add(out_, 0.5F);
}

}  // namespace vitreo::vision
