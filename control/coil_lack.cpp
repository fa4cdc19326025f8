// SPDX-License-Identifier: Apache-2.0
#include "control/coil_lack.h"

#include "control/stability.h"

#include <algorithm>

namespace vitreo::control {
namespace {

double slope(const LackSums& sums, double c) {
  return 2 * sums.linear + c * (4 * sums.curved - 2 * sums.information -
                                c * (6 * sums.mixed + 4 * c * sums.curved_square));
}

double bend(const LackSums& sums, double c) {
  return 4 * sums.curved - 2 * sums.information -
         c * (12 * sums.mixed + 12 * c * sums.curved_square);
}

}  // namespace

LostForce lost_force(const Robot& robot, const FieldGradient& whole, const FieldGradient& its) {
  const Eigen::Vector3d with_all = force_along_field(robot, whole);
  const Eigen::Vector3d all = with_all - force_along_field(robot, whole - its);
  const Eigen::Vector3d half = with_all - force_along_field(robot, whole - its / 2);
  return {4 * half - all, 2 * all - 4 * half};
}

// A polynomial of fourth degree may have two maxima: places are tried, then Newton's steps taken.
Lack most_probable_lack(const LackSums& sums, double least, double most) {
  Lack found;
  for (const double about : {0.25, 0.5, 0.75, 1.0, 1.5, 2.0}) {
    if (about < least || about > most) continue;
    if (const double ratio = sums.ratio(about); ratio > found.ratio) found = {about, ratio};
  }
  if (found.part == 0) found.part = least;
  for (int step = 0; step < 2 && bend(sums, found.part) < 0; ++step) {
    const double part =
        std::clamp(found.part - slope(sums, found.part) / bend(sums, found.part), least, most);
    if (const double ratio = sums.ratio(part); ratio > found.ratio) found = {part, ratio};
  }
  return found;
}

}  // namespace vitreo::control
