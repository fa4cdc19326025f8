// Ray aiming: the bundle that leaves a point in the vitreous and fills a pupil, be it the eye's
// stop or a microscope's.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/batch.h"
#include "optics/rays/observer.h"
#include "optics/rays/spot.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace vitreo::optics {

/// Points of the unit disc at the middles of rings x arms cells of equal area: radius sqrt((i +
/// 1/2) / rings), angle 2 pi j / arms. Both at least 1, else std::invalid_argument.
std::vector<Eigen::Vector2d> disc_samples(int rings = 12, int arms = 24);
/// `count` (at least 2) points on x from -1 to 1, both ends included: the meridional fan of an
/// object in the x-z plane.
std::vector<Eigen::Vector2d> fan_samples(int count = 101);

/// Which pupil is filled, and with what. The bare sensor's is the system's stop; a microscope's own
/// aperture is the stop of its chain: the rays then must also get through the system's.
struct Pupil {
  /// stop: the plane of the system's stop as rays reach it before the stop's surface refracts them,
  /// though that surface may lie before the plane: the reading that reproduces the thesis' numbers.
  /// real_stop: in whichever medium lies there, as trace_out clips. Both have the same chief ray.
  /// Behind a medium with a gradient, where no straight ray goes on, the stop is a real_stop.
  enum class Kind { stop, real_stop, plane, infinity };
  Kind kind = Kind::stop;
  double z = 0;                  // m, eye frame, of the plane
  Eigen::Vector2d center{0, 0};  // m; at infinity: slopes dx/dz, dy/dz
  double radius = 0;             // m; at infinity: slope
  /// Of a stop whose surface is off the axis: the stop's plane is the x-y plane of this frame, and
  /// `center` counts in it.
  std::optional<SurfaceFrame> frame;
  // throws std::invalid_argument without a stop
  static Pupil of_stop(const System& system, Kind kind = Kind::stop);
  static Pupil of_microscope(const System& system, const Microscope& microscope);
};

/// A point on the line from the center of the stop's plane that leaves the axis by `angle` (rad)
/// towards +x, `depth` (m) before the retina, counted along that line. Nothing where the line does
/// not meet the retina or depth leads out of the vitreous' side of the stop. Throws
/// std::invalid_argument for a system without stop and for arguments not finite.
std::optional<Eigen::Vector3d> point_at_field(const System& system, double angle, double depth = 0);

class PupilTracer {
 public:
  /// Throws std::invalid_argument as System::check, and when the stop is to be filled and there is
  /// none.
  PupilTracer(const System& system, const Pupil& pupil, CpuLevel level = best_cpu_level());

  /// The ray from `point` (m, eye frame, in the vitreous) that passes the pupil at `sample` of the
  /// unit disc; {0, 0} is the chief ray. Nothing when there is none, or the point is not finite or
  /// not in the vitreous.
  std::optional<Ray> aim(const Eigen::Vector3d& point,
                         const Eigen::Vector2d& sample = {0, 0}) const;

  /// The bundle of all samples, behind the last surface. False when there is no chief ray. `spot`
  /// is overwritten; its storage is used again, so a loop over many points needs no heap.
  bool trace(const Eigen::Vector3d& point, const std::vector<Eigen::Vector2d>& samples,
             Spot& spot) const;

  const System& system() const { return system_; }
  const Pupil& pupil() const { return pupil_; }
  /// Moves the pupil, as a focusing microscope does; `pupil` must be of the same kind.
  void set_pupil(const Pupil& pupil) { pupil_ = pupil; }
  /// Whether a point lies between the retina and surface 2.
  bool in_vitreous(const Eigen::Vector3d& point) const;

 private:
  struct Aim {
    Eigen::Vector2d slope;             // of the ray in the vitreous
    Eigen::Matrix2d slope_from_pupil;  // 1/m
  };
  std::optional<Aim> solve(const Eigen::Vector3d& point, const Eigen::Vector2d& target) const;
  void fill(const Eigen::Vector3d& point, RayBlock& rays, const double* slope_x,
            const double* slope_y) const;
  void reach(RayBlock& rays, double* pupil_x, double* pupil_y) const;
  void refine(const Eigen::Vector3d& point, const Aim& aim, const double* target_x,
              const double* target_y, double* slope_x, double* slope_y) const;
  void add(const RayBlock& rays, int count, Spot& spot) const;
  System system_;
  Pupil pupil_;
  BatchTracer real_;
  BatchTracer open_;  // its stop clips nothing
  double last_vertex_;
  bool fills_stop() const {
    return pupil_.kind == Pupil::Kind::stop || pupil_.kind == Pupil::Kind::real_stop;
  }
};

}  // namespace vitreo::optics
