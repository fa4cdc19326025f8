// Designer: one continuation path from a lens to its optimum, in rounds of ray aiming, solving and
// checking.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/design/design_merit.h"
#include "optics/design/design_result.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::optics::detail {

/// The continuation path to the optimum: everything at once may diverge far from it; fields from
/// the axis outwards and low orders first lead to other minima.
struct Path {
  bool fields_grow;
  bool orders_grow;
};

/// State of a design between rounds.
class Designer {
 public:
  Designer(const Prescription& start, const LensDesignOptions& options);
  LensDesign run(const Path& path);

 private:
  struct Rays {
    std::size_t whole = 0;          // fields that come through whole
    std::vector<std::size_t> used;  // those that count
    bool operator==(const Rays&) const = default;
  };
  Rays gather(std::size_t fields);
  std::optional<DesignBundle> bundle(const PupilTracer& tracer, double angle, int& lost);
  std::vector<double> start_of_round() const;
  bool solve(std::vector<double>& x, ShapeKind highest, int& iterations, double& cost);
  void adopt(const std::vector<double>& x);
  std::string violated() const;
  std::string violated_gap(std::size_t surface) const;
  std::string violated_profile(std::size_t surface) const;
  LensDesign report(bool settled, int iterations) const;
  Prescription start_;
  Prescription now_;
  LensDesignOptions options_;
  std::string unsound_;  // why the last step was not taken
  DesignProblem problem_;
  std::vector<std::pair<double, double>> bounds_;
};

}  // namespace vitreo::optics::detail
