// Solutions of a smooth map of N variables, and whether they are unique: cells of the unit cube
// with boxes round their images, for starting Newton's method in each cell that may hold a
// solution.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

namespace vitreo::optics::detail {

template <int N>
/// Exclusion by cells: the cube is cut into cells, each with a box that holds its image. A target
/// can only have a solution in the cells whose boxes hold it. Where the determinant of the
/// derivative keeps its sign in a cell, the map is taken to be one-to-one there and one start
/// suffices; a cell in which it changes (a fold) is started from all of its lattice points. The
/// boxes are sampled, not proven: they hold for maps that are smooth on the scale of a cell.
class CellSearch {
 public:
  using Point = Eigen::Matrix<double, N, 1>;
  struct Sample {
    Point image;
    double determinant = 0;  // of the map's derivative
    bool hidden = false;     // its image is blocked (in the iris' shadow): no solution
  };
  struct Solution {
    Point unit;  // in the unit cube
    // in coordinates without singularity (an azimuth has one on the axis), of order one
    Point position;
    Sample there;
  };

  CellSearch() = default;
  /// `sample(unit)` gives the map there; twice as finely as the cells, its images' boxes widened by
  /// a quarter for what bends between.
  template <class Map>
  CellSearch(const std::array<int, N>& cells, Map&& sample) : counts_(cells) {
    int total = 1;
    int nodes = 1;
    for (int count : cells) total *= count, nodes *= 2 * count + 1;
    std::vector<Sample> lattice;
    for (int i = 0; i < nodes; ++i) {
      Point unit;
      for (int d = 0, rest = i; d < N; rest /= 2 * counts_[d] + 1, ++d) {
        unit[d] = double(rest % (2 * counts_[d] + 1)) / (2 * counts_[d]);
      }
      lattice.push_back(sample(unit));
    }
    // The determinant in the cube's middle sets the map's orientation and the scale of "nearly
    // zero".
    const double typical = sample(Point(Point::Constant(0.5))).determinant;
    orientation_ = typical < 0 ? -1 : 1;
    scale_ = std::abs(typical);
    for (int i = 0; i < total; ++i) add(i, lattice);
    sort_into_bins();
    one_to_one_ =
        std::none_of(cells_.begin(), cells_.end(), [](const Cell& cell) { return cell.folds; });
  }

  /// The one visible solution of map(unit) = image. Nothing when there is none, when there are
  /// several, or so close to a fold that they cannot be distinguished. `solve(start)` is Newton's
  /// method: a std::optional<Solution>, in the cube.
  template <class Solve>
  std::optional<Solution> only(const Point& image, Solve&& solve) const {
    constexpr double kSame = 1e-6;      // of the cube's side: the same solution, found twice
    constexpr double kNearFold = 1e-3;  // of the usual determinant
    std::optional<Solution> one;
    const std::vector<int>* bin = bin_of(image);
    if (bin == nullptr) return std::nullopt;
    for (const int i : *bin) {
      const Cell& cell = cells_[i];
      if (!cell.holds(image) || (one && !cell.folds && cell.near(one->unit))) continue;
      if (!cell.folds && !cell.may_hold(image)) continue;
      const int starts = cell.folds ? kLattice : 1;
      for (int start = 0; start < starts; ++start) {
        const auto found = solve(cell.folds ? cell.lattice(start) : cell.middle());
        if (!found || found->there.hidden) continue;
        // Too near a fold, or on the other branch: two solutions merge there, and neither is
        // certain.
        if (!(found->there.determinant * orientation_ > kNearFold * scale_)) return std::nullopt;
        if (one && (found->position - one->position).norm() > kSame) return std::nullopt;
        if (!one) one = found;
      }
    }
    return one;
  }

  /// Tests at all cells' middles that no image belongs to two positions. `newton(image)`
  /// makes the solver.
  template <class Newton, class Map>
  void test_one_to_one(Newton&& newton, Map&& sample) {
    for (const Cell& cell : cells_) {
      if (!one_to_one_) return;
      const Sample there = sample(cell.middle());
      if (!there.hidden && !only(there.image, newton(there.image))) one_to_one_ = false;
    }
  }
  bool one_to_one() const { return one_to_one_; }

 private:
  static constexpr int kLattice = N == 2 ? 9 : 27;
  static constexpr int kBins = 24;

  struct Cell {
    // in the unit cube
    Point low;
    Point high;
    // of its image
    Point image_low;
    Point image_high;
    bool folds = false;  // the determinant changes its sign, or nearly
    Point image_middle;
    // in widths of the cell, by differences; not of a cell that folds
    Eigen::Matrix<double, N, N> cell_per_image;
    /// Whether the linear map about the middle leads into the cell or to within half its width.
    bool may_hold(const Point& image) const {
      constexpr double kReach = 1.0;
      const Point step = cell_per_image * (image - image_middle);
      return !(step.cwiseAbs().maxCoeff() > kReach);  // NaN: it may
    }
    Point middle() const { return (low + high) / 2; }
    Point lattice(int i) const {
      Point at;
      for (int d = 0; d < N; ++d, i /= 3) at[d] = low[d] + (high[d] - low[d]) * (i % 3) / 2;
      return at;
    }
    bool holds(const Point& image) const {
      return (image.array() >= image_low.array()).all() &&
             (image.array() <= image_high.array()).all();
    }
    bool near(const Point& unit) const {
      const Point margin = (high - low) / 2;
      return (unit.array() >= (low - margin).array()).all() &&
             (unit.array() <= (high + margin).array()).all();
    }
  };

  void add(int number, const std::vector<Sample>& lattice) {
    constexpr double kWiden = 0.25;
    constexpr double kNearly = 0.05;  // of the usual determinant
    const double infinite = std::numeric_limits<double>::infinity();
    Cell cell;
    std::array<int, N> first{};
    for (int d = 0, rest = number; d < N; rest /= counts_[d], ++d) {
      first[d] = 2 * (rest % counts_[d]);
      cell.low[d] = double(first[d]) / (2 * counts_[d]);
      cell.high[d] = double(first[d] + 2) / (2 * counts_[d]);
    }
    const auto node = [&](int i) -> const Sample& {
      int at = 0;
      for (int d = 0, stride = 1; d < N; stride *= 2 * counts_[d] + 1, i /= 3, ++d)
        at += stride * (first[d] + i % 3);
      return lattice[static_cast<std::size_t>(at)];
    };
    cell.image_low.setConstant(infinite);
    cell.image_high.setConstant(-infinite);
    double least = infinite;
    bool hidden = true;
    for (int i = 0; i < kLattice; ++i) {
      const Sample& at = node(i);
      cell.image_low = cell.image_low.cwiseMin(at.image);
      cell.image_high = cell.image_high.cwiseMax(at.image);
      least = std::min(least, at.determinant * orientation_);
      hidden = hidden && at.hidden;
    }
    if (hidden) return;
    const Point wider = (cell.image_high - cell.image_low) * kWiden;
    cell.image_low -= wider;
    cell.image_high += wider;
    cell.folds = !(least > kNearly * scale_);
    constexpr int kMiddle = kLattice / 2;
    cell.image_middle = node(kMiddle).image;
    Eigen::Matrix<double, N, N> image_per_cell;
    for (int d = 0, stride = 1; d < N; stride *= 3, ++d) {
      image_per_cell.col(d) = node(kMiddle + stride).image - node(kMiddle - stride).image;
    }
    // Central differences over the cell: the linear map that may_hold() inverts.
    cell.cell_per_image = image_per_cell.inverse();
    cells_.push_back(cell);
  }

  // A uniform grid over the first two coordinates of the images, so that a search does not test
  // every cell's box.
  void sort_into_bins() {
    const double infinite = std::numeric_limits<double>::infinity();
    from_.setConstant(infinite);
    to_.setConstant(-infinite);
    for (const Cell& cell : cells_) {
      from_ = from_.cwiseMin(cell.image_low.template head<2>());
      to_ = to_.cwiseMax(cell.image_high.template head<2>());
    }
    bins_.assign(kBins * kBins, {});
    for (int i = 0; i < static_cast<int>(cells_.size()); ++i) {
      const Eigen::Vector2i a = bin_index(cells_[i].image_low.template head<2>());
      const Eigen::Vector2i b = bin_index(cells_[i].image_high.template head<2>());
      for (int x = a.x(); x <= b.x(); ++x) {
        for (int y = a.y(); y <= b.y(); ++y) bins_[x * kBins + y].push_back(i);
      }
    }
  }
  Eigen::Vector2i bin_index(const Eigen::Vector2d& image) const {
    const Eigen::Array2d part = (image - from_).array() / (to_ - from_).array();
    return (part * kBins).cwiseMin(kBins - 1.0).cwiseMax(0.0).template cast<int>().matrix();
  }
  const std::vector<int>* bin_of(const Point& image) const {
    const Eigen::Vector2d at = image.template head<2>();
    if (!((at.array() >= from_.array()).all() && (at.array() <= to_.array()).all())) return nullptr;
    const Eigen::Vector2i bin = bin_index(at);
    return &bins_[bin.x() * kBins + bin.y()];
  }

  std::array<int, N> counts_{};
  std::vector<Cell> cells_;
  std::vector<std::vector<int>> bins_;
  // of the first two of an image
  Eigen::Vector2d from_{0, 0};
  Eigen::Vector2d to_{0, 0};
  double orientation_ = 1;
  double scale_ = 0;
  bool one_to_one_ = false;
};

}  // namespace vitreo::optics::detail
