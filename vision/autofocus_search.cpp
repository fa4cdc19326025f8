// SPDX-License-Identifier: Apache-2.0
#include "vision/autofocus_search.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace vitreo::vision {
namespace {

// A bracket, two old steps wide, is then swept at nine positions.
constexpr int kRefinement = 4;  // ratio of a sweep's step to that of the next

struct Range {
  double low;
  double high;
  double width() const { return high - low; }
};

Range intersection(const Range& range, const Range& limits) {
  return {std::max(range.low, limits.low), std::min(range.high, limits.high)};
}

// Evenly over the range, both ends included, three positions at least.
// A value type: a strategy takes a new one for each sweep. Numbers of positions are fixed at the
// start, so no rounding adds one.
class EvenSweep {
 public:
  EvenSweep() = default;
  EvenSweep(const Range& range, int count) : range_(range), count_(std::max(count, 3)) {}
  static EvenSweep by_step(const Range& range, double step) {
    // The tolerance keeps a width that is a multiple of the step from gaining one by rounding.
    return {range, static_cast<int>(std::ceil(range.width() / step - 1e-9)) + 1};
  }
  double spacing() const { return range_.width() / (count_ - 1); }
  std::optional<double> next() {
    if (done_ == count_) return std::nullopt;
    const double share = static_cast<double>(done_++) / (count_ - 1);
    // The last position is the end itself, without rounding.
    return share < 1 ? range_.low + share * range_.width() : range_.high;
  }

 private:
  Range range_{0, 0};
  int count_ = 3;
  int done_ = 0;
};

// The sample of largest value from index `from` on.
const FocusSample& best_of(const std::vector<FocusSample>& samples, std::size_t from = 0) {
  return *std::max_element(
      samples.begin() + static_cast<std::ptrdiff_t>(from), samples.end(),
      [](const FocusSample& a, const FocusSample& b) { return a.value < b.value; });
}

// Exhaustive search: every step from low to high.
// Slow but without an assumption about the curve; the reference for the other strategies.
class Sweep final : public FocusSearch {
 public:
  explicit Sweep(const AutofocusSettings& s)
      : sweep_(EvenSweep::by_step({s.low, s.high}, s.step)) {}
  std::optional<double> next(const std::vector<FocusSample>&) override { return sweep_.next(); }

 private:
  EvenSweep sweep_;
};

// The first, coarse sweep of the other strategies. While no sample stands out, the peak may be
// narrower than the sweep's spacing: it is swept again at half the spacing, down to the finest
// step.
// Ends when a sample stands out, or when its spacing has come down to `step_`.
class Bracketing {
 public:
  explicit Bracketing(const AutofocusSettings& s)
      : limits_{s.low, s.high},
        step_(s.step),
        hysteresis_(s.hysteresis),
        sweep_(limits_, s.coarse) {}
  std::optional<double> next(const std::vector<FocusSample>& samples) {
    if (const auto position = sweep_.next()) return position;
    if (stands_out(samples) || spacing() <= step_) return std::nullopt;
    sweep_ = EvenSweep::by_step(limits_, spacing() / 2);
    return sweep_.next();
  }
  double spacing() const { return sweep_.spacing(); }
  const Range& limits() const { return limits_; }
  // Whether the best exceeds the median by the hysteresis: most of a coarse sweep is out of focus.
  // A median and not a mean, as the peak itself must not raise what it is compared with.
  bool stands_out(const std::vector<FocusSample>& samples) const {
    std::vector<double> values;
    values.reserve(samples.size());
    for (const FocusSample& s : samples) values.push_back(s.value);
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    const double best = best_of(samples).value;
    return best > 0 && best - *middle > hysteresis_ * best;
  }
  // A unimodal curve has its maximum between the best sample's neighbors.
  // Cut at the limits, so that a maximum at an end is found there.
  Range bracket(const std::vector<FocusSample>& samples) const {
    const double best = best_of(samples).position;
    return intersection({best - spacing(), best + spacing()}, limits_);
  }

 private:
  Range limits_;
  double step_;
  double hysteresis_;
  EvenSweep sweep_;
};

// Sweeps of ever smaller step around the best sample, each kRefinement times finer than the one
// before.
// A sweep costs more readings than a section, but no single reading decides what is cut off.
class CoarseToFine final : public FocusSearch {
 public:
  explicit CoarseToFine(const AutofocusSettings& s) : step_(s.step), coarse_(s) {}
  std::optional<double> next(const std::vector<FocusSample>& samples) override {
    if (spacing_ == 0) {
      if (const auto position = coarse_.next(samples)) return position;
      if (!coarse_.stands_out(samples)) return std::nullopt;
      return refine(samples, coarse_.spacing());
    }
    if (const auto position = sweep_.next()) return position;
    return refine(samples, spacing_);
  }

 private:
  // About the best of the last sweep: those before it were coarser, and the light may have changed
  // since.
  // Ends when the sweep just done had the finest step.
  std::optional<double> refine(const std::vector<FocusSample>& samples, double spacing) {
    if (spacing <= step_ * (1 + 1e-9)) return std::nullopt;
    const double best = best_of(samples, swept_).position;
    swept_ = samples.size();
    spacing_ = std::max(spacing / kRefinement, step_);
    sweep_ = EvenSweep::by_step(intersection({best - spacing, best + spacing}, coarse_.limits()),
                                spacing_);
    return sweep_.next();
  }

  double step_;
  double spacing_ = 0;
  std::size_t swept_ = 0;
  Bracketing coarse_;
  EvenSweep sweep_;
};

// Golden-section and Fibonacci search (Kiefer 1953) of a unimodal curve: a bracket with two inner
// positions; the outer part beside the lower one is cut off, the other inner position stays. A new
// inner position mirrors it, low + high - kept, so each step costs one reading and shrinks the
// bracket by 1 / phi, or by a ratio of Fibonacci numbers.
class Section final : public FocusSearch {
 public:
  explicit Section(const AutofocusSettings& s)
      : golden_(s.strategy == AutofocusStrategy::golden_section),
        step_(s.step),
        hysteresis_(s.hysteresis),
        coarse_(s) {}
  std::optional<double> next(const std::vector<FocusSample>& samples) override {
    if (stage_ == Stage::coarse) {
      if (const auto position = coarse_.next(samples)) return position;
      if (!coarse_.stands_out(samples)) return std::nullopt;
      begin(coarse_.bracket(samples));
      return left_.position;
    }
    if (stage_ == Stage::over) return std::nullopt;
    Inner& measured = stage_ == Stage::left ? left_ : right_;
    // The stage may have stopped beside its target; the bracket goes on with the target, the peak
    // fit takes the real position.
    measured.value = samples.back().value;
    // Both inner values are needed to compare; after the first pair each step lacks one.
    if (!right_.value) return ask(Stage::right);
    if (!left_.value) return ask(Stage::left);
    return shrink();
  }

 private:
  enum class Stage { coarse, left, right, over };
  struct Inner {
    double position = 0;
    std::optional<double> value;
  };

  // Fibonacci: the bracket is divided into F_n steps, F_n the first Fibonacci number with F_n step
  // >= width, and the inner positions stand at F_(n-1) / F_n, so all positions lie on whole steps.
  void begin(const Range& bracket) {
    range_ = bracket;
    int small = 1;
    int large = 1;
    while (large * step_ < range_.width()) small = std::exchange(large, small + large);
    const double ratio = golden_ ? 1 / std::numbers::phi : static_cast<double>(small) / large;
    left_ = {range_.high - ratio * range_.width(), {}};
    right_ = {range_.low + ratio * range_.width(), {}};
    stage_ = Stage::left;
  }
  double ask(Stage stage) {
    stage_ = stage;
    return stage == Stage::left ? left_.position : right_.position;
  }
  // One step: cuts the bracket on the side of the lower inner value.
  // Nothing when the bracket is two steps wide: the parabola through all samples is finer than
  // another cut.
  std::optional<double> shrink() {
    const double difference = *left_.value - *right_.value;
    if (std::abs(difference) < hysteresis_ * std::max(*left_.value, *right_.value)) {
      // Noise would choose the side; the parabola through all samples is more reliable.
      stage_ = Stage::over;
      return (left_.position + right_.position) / 2;
    }
    (difference > 0 ? range_.high : range_.low) = difference > 0 ? right_.position : left_.position;
    if (range_.width() <= 2 * step_) return std::nullopt;
    if (difference > 0) {
      right_ = left_;
      left_ = {range_.low + range_.high - right_.position, {}};
      return ask(Stage::left);
    }
    left_ = right_;
    right_ = {range_.low + range_.high - left_.position, {}};
    return ask(Stage::right);
  }

  bool golden_;
  double step_;
  double hysteresis_;
  Stage stage_ = Stage::coarse;
  Bracketing coarse_;
  Range range_{0, 0};
  Inner left_;
  Inner right_;
};

}  // namespace

// Throws std::invalid_argument for a number that is none of the strategies.
std::unique_ptr<FocusSearch> make_focus_search(const AutofocusSettings& settings) {
  switch (settings.strategy) {
    case AutofocusStrategy::sweep:
      return std::make_unique<Sweep>(settings);
    case AutofocusStrategy::coarse_to_fine:
      return std::make_unique<CoarseToFine>(settings);
    case AutofocusStrategy::golden_section:
    case AutofocusStrategy::fibonacci:
      return std::make_unique<Section>(settings);
  }
  throw std::invalid_argument("strategy: there is no such autofocus strategy");
}

}  // namespace vitreo::vision
