// Level set: the fast two-list method of Shi & Karl (2005, 2008) with the thesis' two thresholds
// (8.2.1) and its third cycle (table 8.1).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_model.h"
#include "vision/ellipse.h"
#include "vision/evidence.h"
#include "vision/shape_model.h"

#include <cstdint>
#include <vector>

namespace vitreo::vision {

struct LevelSetSettings {
  int iterations = 30;  ///< of cycle one before cycle two gets its turn (N_a)
  int smoothing = 3;    ///< iterations of cycle two (N_g)
  int rounds = 2;       ///< of both cycles, at most
  /// Of cycle three (N_s); few, so that the object may differ from the prior.
  int prior_iterations = 3;
  /// Of both lists together; a longer front is a leak and stops the evolution.
  int max_points = 4096;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// The largest connected part of the inside.
struct Segment {
  double area_px = 0;   ///< 0: nothing is inside
  Ellipse ellipse;      ///< with the part's moments
  double evidence = 0;  ///< mean F of the part
};

/// Minimizes the region energy of front C with inside A and outside B,
///   E = -int_A log P(u|object) - int_B log P(u|ground) + lambda |C|
/// (region competition, Zhu & Yuille 1996), by switching pixels across the front: cycle one follows
/// the data terms, whose speed is F, cycle two the length, and cycle three pulls to the shape
/// prior. No PDE is solved; phi has four values.
class LevelSet {
 public:
  explicit LevelSet(const LevelSetSettings& settings);
  /// Makes room for regions of up to `side_px` squared at once, so that none is made later.
  void reserve(int side_px);
  /// phi from `ellipse`, on the evidence's region. Blocked pixels stay outside. `evidence` must
  /// outlive what follows.
  void start(const Evidence& evidence, const Ellipse& ellipse);
  /// Cycles one and two, the thresholds rounded to the steps of F (Evidence::kScale a unit).
  void evolve(const Thresholds& thresholds);
  /// Cycle three: table 8.1 line by line.
  void evolve_to_prior(const PlacedShape& prior);
  /// Drops all but the largest part from phi and from the lists.
  Segment keep_largest();

  bool leaked() const { return leaked_; }
  int iterations() const { return iterations_; }
  /// The pixels of L_in and L_out, with phi in pixels to the front: -0.5 and +0.5.
  void front(std::vector<FrontPoint>& points) const;
  /// -3, -1, +1, +3 as thesis 8.2.1; image coordinates, in the region.
  int phi(int u, int v) const { return phi_[evidence_->index_of(u, v)]; }

 private:
  using List = std::vector<int>;
  // Pixels [first, end) of one row that are inside; `root`: the part's first run, which has its
  // area, px.
  struct Run {
    int first;
    int end;
    int root;
    int area = 0;
  };
  void list_front(int skip, int size);
  bool cycle_one(const Thresholds& thresholds);
  void cycle_two();
  int smoothed(int p) const;
  void switch_in();
  void switch_out();
  void clean(List& list, int sign);
  void find_runs();
  int next_inside(int from, int end) const;
  int root_of(int run);
  void join(int a, int b);
  Segment segment_of(int root);

  LevelSetSettings settings_;
  const Evidence* evidence_ = nullptr;
  int stride_ = 0;
  bool leaked_ = false;
  int iterations_ = 0;
  std::vector<std::int8_t> phi_;
  std::vector<unsigned char> flag_;
  List in_;
  List out_;
  List kept_;
  List added_;
  std::vector<Run> runs_;
};

}  // namespace vitreo::vision
