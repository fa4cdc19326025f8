// Choice of an eye: of what several eyes say of one picture, the observation that steers the loop.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/servo/localizer.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace vitreo {

/// The eye that sees the robot with the least noise, kept while the others are not clearly better.
/// Where one sees it, that one; where two see it in different places of the image, none: one of
/// them is wrong.
class EyeChoice {
 public:
  /// `seen`: one an eye, in their order. Its number; nothing where none is to be believed.
  std::optional<std::size_t> choose(const std::vector<Observation>& seen);
  /// In the last choice two eyes saw different places.
  bool contradicted() const { return contradicted_; }

 private:
  std::optional<std::size_t> eye_;  // of the last choice that there was
  int better_ = 0;                  // choices in a row in which another eye was clearly better
  bool contradicted_ = false;
};

}  // namespace vitreo
