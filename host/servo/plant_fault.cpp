// SPDX-License-Identifier: Apache-2.0
#include "host/servo/plant_fault.h"

#include "control/coil_lack.h"
#include "control/stability.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

// Parts of a coil's current that may be missing where it is weak or open.
constexpr double kPlantLeastLack = 0.3;
constexpr double kPlantMostLack = 1;
// What a hypothesis must explain of what is left over, at least.
constexpr double kPlantExplained = 0.65;
// By so much of it the next coil explains less: coils that stand beside each other pull in
// directions 15 degrees apart, and gains, axes and drift of healthy machines turn what is left over
// by 5.
constexpr double kPlantAlike = 0.12;

/// Of amplifiers (coil 0) or a coil.
struct Suspect {
  Eigen::Index coil = 0;
  bool reversed = false;
  double lack = 0;
  double explained = -1;  // m^2, by which it lowers the sum of squares
};

/// The likeliest of each kind, with a fault that began at a place of the path or halfway to the
/// next.
class Suspects {
 public:
  Suspects(const std::vector<LeftOver>& path, Eigen::Index coils)
      : path_(path), suspects_(static_cast<std::size_t>(1 + 2 * coils)) {
    for (Eigen::Index k = 0; k < coils; ++k) {
      suspects_[static_cast<std::size_t>(1 + k)].coil = k + 1;
      suspects_[static_cast<std::size_t>(1 + coils + k)] = {k + 1, true};
    }
    for (std::size_t k = 0; k + 1 < path.size(); ++k) {
      begin(path[k].moved, k + 1);
      begin((path[k].moved + path[k + 1].moved) / 2, k + 1);
    }
    std::stable_sort(suspects_.begin(), suspects_.end(),
                     [](const Suspect& a, const Suspect& b) { return a.explained > b.explained; });
  }
  const Suspect& first() const { return suspects_.front(); }
  /// The next of another coil.
  const Suspect& next() const {
    const auto found = std::find_if(suspects_.begin(), suspects_.end(), [this](const Suspect& one) {
      return one.coil != first().coil && one.coil != 0;
    });
    return found == suspects_.end() ? first() : *found;
  }

 private:
  void begin(const PlantMotions& from, std::size_t place) {
    for (Suspect& one : suspects_) {
      const Suspect since = one.coil == 0  ? without_current(from, place)
                            : one.reversed ? reversed(one.coil, from, place)
                                           : weak(one.coil, from, place);
      if (since.explained > one.explained) one = since;
    }
  }
  double lowered(std::size_t place, const Eigen::Vector3d& explained) const {
    return explained.dot(2 * path_[place].left - explained);
  }
  Suspect without_current(const PlantMotions& from, std::size_t place) const {
    Suspect found{0, false, 1, 0};
    for (; place < path_.size(); ++place) {
      const PlantMotions moved = path_[place].moved - from;
      found.explained += lowered(place, moved.col(kPlantNone) - moved.col(kPlantAsTold));
    }
    return found;
  }
  Suspect reversed(Eigen::Index coil, const PlantMotions& from, std::size_t place) const {
    const Eigen::Index column = kPlantCoils + kPlantPerCoil * (coil - 1) + 2;
    Suspect found{coil, true, 2, 0};
    for (; place < path_.size(); ++place)
      found.explained += lowered(place, path_[place].moved.col(column) - from.col(column));
    return found;
  }
  Suspect weak(Eigen::Index coil, const PlantMotions& from, std::size_t place) const {
    const Eigen::Index column = kPlantCoils + kPlantPerCoil * (coil - 1);
    control::LackSums sums;
    for (; place < path_.size(); ++place) {
      const Eigen::Vector3d linear = path_[place].moved.col(column) - from.col(column);
      const Eigen::Vector3d curved = path_[place].moved.col(column + 1) - from.col(column + 1);
      sums.linear += path_[place].left.dot(linear);
      sums.curved += path_[place].left.dot(curved);
      sums.information += linear.squaredNorm();
      sums.mixed += linear.dot(curved);
      sums.curved_square += curved.squaredNorm();
    }
    const control::Lack lack = control::most_probable_lack(sums, kPlantLeastLack, kPlantMostLack);
    return {coil, false, lack.part, lack.ratio};
  }

  const std::vector<LeftOver>& path_;
  std::vector<Suspect> suspects_;
};

std::string words(const Suspect& one) {
  if (one.coil == 0) return "no current flowed: the amplifiers give nothing";
  if (one.reversed) return fmt::format("the leads of coil {} were exchanged", one.coil);
  return fmt::format("coil {} made {:.0f} % of its field: it is open, shorted or weak", one.coil,
                     100 * (1 - one.lack));
}

}  // namespace

PlantMotions plant_velocities(const control::Robot& robot, const PlantForces& forces,
                              const control::Currents& currents) {
  const control::FieldGradient whole = forces.matrix * currents + forces.background;
  const Eigen::Vector3d weight(0, 0, -forces.weight);
  const Eigen::Vector3d with_all = control::force_along_field(robot, whole);
  const Eigen::Index coils = currents.size();
  PlantMotions found(3, kPlantCoils + kPlantPerCoil * coils);
  found.col(kPlantAsTold) = with_all + weight;
  found.col(kPlantNone) = control::force_along_field(robot, forces.background) + weight;
  for (Eigen::Index k = 0; k < coils; ++k) {
    const control::FieldGradient its = forces.matrix.col(k) * currents[k];
    const control::LostForce lost = control::lost_force(robot, whole, its);
    const Eigen::Index column = kPlantCoils + kPlantPerCoil * k;
    found.col(column) = -lost.linear;
    found.col(column + 1) = -lost.curved;
    found.col(column + 2) = control::force_along_field(robot, whole - 2 * its) - with_all;
  }
  return forces.mobility * found;
}

std::string plant_fault(const std::vector<LeftOver>& path, double sigma) {
  if (path.size() < 2) return {};
  const Suspects suspects(path, (path.front().moved.cols() - kPlantCoils) / kPlantPerCoil);
  double all = 0;
  for (const LeftOver& place : path) all += place.left.squaredNorm();
  const auto rest = [all](const Suspect& one) {
    return std::sqrt(std::max(0.0, all - one.explained));
  };
  const double noise = 2 * sigma * std::sqrt(static_cast<double>(path.size()));
  const Suspect& first = suspects.first();
  if (rest(first) > (1 - kPlantExplained) * std::sqrt(all) + noise) return {};
  std::string text = "the robot moves as if " + words(first);
  const Suspect& next = suspects.next();
  if (next.coil != first.coil && rest(next) < rest(first) + kPlantAlike * std::sqrt(all))
    text += "; or as if " + words(next);
  return text;
}

}  // namespace vitreo
