// Box-constrained current allocation: a quadratic program with the vertical force as an equality.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/allocation.h"

namespace vitreo::control {

/// A per coil, at least 0. A dead coil has 0: its part goes to the others.
using CurrentLimits = Currents;

/// Weights of the misses where a limit is in the way: of the field in T, of the lateral force over
/// moment times 20 mm in T.
struct AllocationWeights {
  double field = 1;
  // a field a little weaker or turned still holds the robot; a force that points elsewhere moves it
  double force = 3;
};

struct BoxAllocation {
  Currents currents;               // A, within the limits always
  Eigen::Vector3d field{0, 0, 0};  // T, that these make
  Eigen::Vector3d force{0, 0, 0};  // N, with the moment given
  double headroom = 1;             // 1 - the largest |I| / limit over the working coils
  int iterations = 0;              // of the program; 0 when no limit was met, at full rank
  bool limited = false;            // a limit, or a lost rank, cost something of what was wanted
  bool vertical_cut = false;       // even of the vertical force above the levitation
};

/// min |W (A I - w)|^2 + eps |I|^2 with |I_k| <= limits_k, and the vertical force (levitation and
/// more) met exactly. Only where more vertical force is asked than 70 % of what the coils can do at
/// all is the part above the levitation cut to that. Without a limit in the way: the least-norm
/// solution, as allocate. No heap; at most 48 iterations, and each keeps to the limits and holds
/// the vertical force, so that the bound costs only optimality. Throws as allocate;
/// std::domain_error when the levitation is out of reach and no wanted force against it brings the
/// sum back. Rank may be short: what can be had is made.
BoxAllocation allocate_within(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                              const FieldAndForce& wanted, const CurrentLimits& limits,
                              const AllocationWeights& weights = {});

/// For a permanent magnet, whose torque needs not a whole field: [T_perp (2); F (3)], a row less to
/// make than above. `torque` in N m, world; its part along the moment cannot be made and is passed
/// over. `wanted.field` is not used: zero torque leaves the field's magnitude and sense open.
BoxAllocation allocate_five_degrees(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                                    const Eigen::Vector3d& torque, const FieldAndForce& wanted,
                                    const CurrentLimits& limits,
                                    const AllocationWeights& weights = {});

/// Of the 6 x n matrix from currents to field and force (over moment, times 20 mm), without the
/// coils whose limit is 0: largest over smallest singular value. 5 is usual, infinity is a lost
/// degree of freedom. Not for every tick (5 us).
double condition_number(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                        const CurrentLimits& limits);

}  // namespace vitreo::control
