// Tracking score: a color tracker on a generated sequence, as the project's figures are defined.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/vision/sequence_generator.h"
#include "vision/color_tracker.h"

#include <Eigen/LU>

#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

namespace vitreo::vision::generated {

struct Score {
  int frames = 0, wrong = 0, seen = 0;
  int lost = 0;            ///< beyond the frames that a find takes to be believed
  int hidden_tracked = 0;  ///< frames reported tracking though nothing of the object is visible
  std::optional<int> found_again_after;  ///< frames from the end of the hiding to the first track
  double center_px = 0, major_px = 0, minor_px = 0,
         angle_deg = 0;  ///< mean errors where all is visible; full axes
  double inside = 0;     ///< share of those centers within their own 95 % ellipse
};

inline void add_errors(Score& score, const EllipseMeasurement& m, const Ellipse& truth) {
  const Eigen::Vector2d off = m.ellipse.center_px - truth.center_px;
  const Eigen::Matrix2d covariance = m.covariance.topLeftCorner<2, 2>();
  ++score.seen;
  score.center_px += off.norm();
  score.major_px += 2 * std::abs(m.ellipse.semi_major_px - truth.semi_major_px);
  score.minor_px += 2 * std::abs(m.ellipse.semi_minor_px - truth.semi_minor_px);
  score.angle_deg += std::abs(std::remainder(m.ellipse.angle - truth.angle, std::numbers::pi)) *
                     180 / std::numbers::pi;
  score.inside += off.dot(covariance.inverse() * off) < 5.991 ? 1 : 0;  // chi^2 of two, 95 %
}

/// What a tracker for this ground learns: 24 frames of another time, in the training's light.
inline ObjectModel trained_on(Sequence& sequence, const ColorTrackerSettings& chosen = {},
                              const ColorModelSettings& color = {}) {
  return ObjectModel::train(sequence.training(24), color, chosen.view);
}

/// Of a tracker that has been trained.
inline Score score(Sequence& sequence, const SequenceSettings& settings, int frames,
                   ColorTracker tracker, const ColorTrackerSettings& chosen = {}) {
  Score score;
  score.frames = frames;
  int in_view = 0;
  const int hidden_end = settings.hidden_from + settings.hidden_frames;
  for (int k = 0; k < frames; ++k) {
    const Frame frame = sequence.frame(k);
    const Track track = tracker.update(frame.image);
    const bool hidden = frame.visible <= 0, tracking = track.state == TrackState::tracking;
    in_view = hidden ? 0 : in_view + 1;
    if (!tracking) {
      score.lost += frame.visible >= 0.3 && in_view >= chosen.confirm_frames;
      continue;
    }
    const double off = (track.measured->ellipse.center_px - frame.truth.center_px).norm();
    score.wrong += off > 10 || hidden;
    score.hidden_tracked += hidden;
    if (settings.hidden_from >= 0 && k >= hidden_end && !score.found_again_after)
      score.found_again_after = k - hidden_end;
    if (frame.visible > 0.99) add_errors(score, *track.measured, frame.truth);
  }
  for (double* sum :
       {&score.center_px, &score.major_px, &score.minor_px, &score.angle_deg, &score.inside}) {
    *sum /= std::max(score.seen, 1);
  }
  return score;
}

inline Score score(const SequenceSettings& settings, int frames,
                   const ColorTrackerSettings& chosen = {}, const ColorModelSettings& color = {}) {
  Sequence sequence(settings);
  return score(sequence, settings, frames,
               ColorTracker(trained_on(sequence, chosen, color), chosen), chosen);
}

}  // namespace vitreo::vision::generated
