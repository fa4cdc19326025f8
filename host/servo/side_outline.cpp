// SPDX-License-Identifier: Apache-2.0
#include "host/servo/side_outline.h"

#include <cmath>

namespace vitreo {

SideObservation side_observation(const RigModel& model, Time exposed,
                                 const vision::EllipseMeasurement& seen) {
  const Eigen::Vector2d away = seen.ellipse.center_px - model.side_center_px;
  Eigen::Matrix2d to_world;  // x to the right, z up
  to_world << model.side_pixel, 0, 0, -model.side_pixel;
  // As of the top camera: systematic errors of a tenth of a pixel, which are in no covariance.
  const Eigen::Matrix2d image =
      seen.covariance.topLeftCorner<2, 2>() + 0.1 * 0.1 * Eigen::Matrix2d::Identity();
  SideObservation side{exposed, to_world * away, to_world * image * to_world.transpose()};
  // The outline's own error, over the difference of its axes, turns its direction.
  constexpr double kOutline_px = 0.3;
  constexpr double kRound = 0.2;  // rad: a direction that is less certain is none
  const double difference = seen.ellipse.semi_major_px - seen.ellipse.semi_minor_px;
  const double sigma = difference > 0 ? kOutline_px / difference : 1;
  if (sigma < kRound) {
    // Image v points down, world z up.
    side.direction = Eigen::Vector2d(std::cos(seen.ellipse.angle), -std::sin(seen.ellipse.angle));
    side.direction_sigma = std::hypot(sigma, std::sqrt(seen.covariance(4, 4)));
  }
  // A scale moves along the way out from the center, a turn of the camera across it.
  const Eigen::Vector2d out = side.position;
  const Eigen::Vector2d across(-out.y(), out.x());
  const ViewUncertainty& known = model.uncertainty;
  side.systematic = known.pixel * known.pixel * out * out.transpose() +
                    known.tilt * known.tilt * across * across.transpose();
  side.covariance += side.systematic;
  return side;
}

}  // namespace vitreo
