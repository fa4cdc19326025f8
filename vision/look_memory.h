// Look memory: what looks at the training images, disturbed in many ways, were like, how far they
// erred, and what looks at anatomy were like; by it a tracker knows what a look is worth.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/bytes.h"

#include <Eigen/Core>

#include <array>
#include <vector>

namespace vitreo::vision {

/// What a look says of itself, each in units in which a difference of one is a large one; filled by
/// features_of() (object_view.h).
constexpr int kLookFeatures = 11;
constexpr std::size_t kSizeFeature = 9;  ///< the object's size, among looks of which densities are
using LookFeatures = std::array<float, kLookFeatures>;

/// Worth of a look, by those in memory that were like it.
struct LookWorth {
  /// Factors on the covariance of the center, and of axes and angle.
  double center = 1;
  double shape = 1;
  /// log(density of looks at the object / density of looks at anything else) among the like.
  double likeness = 0;
};

class LookMemory {
 public:
  /// A look at the object. `center`, `shape`: its squared errors in units of the covariance that it
  /// claimed (Mahalanobis, 2 and 3 degrees of freedom).
  void add_object(const LookFeatures& look, double center, double shape);
  /// A look at anatomy, or one gone astray.
  void add_other(const LookFeatures& look);
  /// All looks of another memory, after its own.
  void append(const LookMemory& other);
  LookWorth worth(const LookFeatures& look) const;
  /// Nothing is known: worth() is then a factor of one and no likeness.
  bool empty() const { return objects_.size() == 0; }
  std::size_t objects() const { return objects_.size(); }
  std::size_t others() const { return others_.size(); }

  void save(ByteWriter& out) const;
  /// `features` of a look in the file; those that an older one does not have are 0.
  static LookMemory load(ByteReader& in, int features = kLookFeatures);

 private:
  // Features by rows of looks, so that distances to all of them are one vector loop.
  struct Looks {
    std::array<std::vector<float>, kLookFeatures> columns;
    std::size_t size() const { return columns[0].size(); }
    void add(const LookFeatures& look);
    void append(const Looks& other);
    LookFeatures at(std::size_t k) const;
  };
  static constexpr std::size_t kBlock = 128;  // looks whose distances are computed at once
  static void squared_distances(const Looks& looks, const LookFeatures& from, std::size_t first,
                                std::size_t count, float* to);
  static double count_of_size(const Looks& looks, const LookFeatures& look);
  static double density_of(const Looks& looks, const LookFeatures& look);

  Looks objects_;
  std::vector<float> center_;  // squared errors of each of `objects_`
  std::vector<float> shape_;
  Looks others_;
};

}  // namespace vitreo::vision
