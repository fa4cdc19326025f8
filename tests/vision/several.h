// Generated sequences of a robot and three discs: of different colors, of one color, apart or
// touching.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/vision/sequence_generator.h"
#include "vision/multi_tracker.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace vitreo::vision::generated {

enum class Meeting {
  apart,     ///< each on its own
  touching,  ///< discs 1 and 2 come together, stay rim to rim for 25 frames, and part; the robot
             ///< leans on disc 3
};

struct SeveralSettings {
  std::uint64_t seed = 1;
  /// all three discs alike, and the robot of the same steel; else red, green, blue discs
  bool one_color = false;
  Meeting meeting = Meeting::apart;
  bool fundus = false;
  int hidden_from = -1;  ///< the bar goes over the robot and what is near it for 20 frames
  int half_hidden_from = -1;
};

/// Discs of 18 px radius at training frames (5000 and later) far from each other.
inline SequenceSettings several(const SeveralSettings& chosen) {
  constexpr double kRadius = 18;
  const auto shift = 0.7 * static_cast<double>(chosen.seed % 10);
  const bool meet = chosen.meeting == Meeting::touching;
  // From 60 px of gap to none in frames 0 to 20, together until 45, then apart again.
  const auto gap = [meet](int k) {
    if (!meet || k >= 5000) return 60.0;
    return 60 * std::clamp(std::max((20.0 - k) / 20, (k - 45.0) / 20), 0.0, 1.0);
  };
  const auto wander = [shift](int k, double phase) {
    return Eigen::Vector2d(34 * std::sin(0.03 * k + phase + shift),
                           26 * std::cos(0.037 * k + 2 * phase + shift));
  };
  const auto disc = [=](Eigen::Vector2d at) { return Ellipse{at, kRadius, kRadius * 0.97, 0.3}; };
  SequenceSettings made;
  made.seed = chosen.seed;
  made.fundus = chosen.fundus;
  made.hidden_from = chosen.hidden_from;
  made.half_hidden_from = chosen.half_hidden_from;
  const Eigen::Vector2d pair(200, 160), third(430, 330);
  // The pair turns about its middle while it holds together.
  const auto side = [=](int k) {
    return Eigen::Vector2d(std::cos(0.02 * k + shift), std::sin(0.02 * k + shift));
  };
  const std::function<Ellipse(int)> first = [=](int k) {
    return disc(pair + wander(k, 0.4) - (kRadius + gap(k) / 2) * side(k));
  };
  const std::function<Ellipse(int)> second = [=](int k) {
    return disc(pair + wander(k, 0.4) + (kRadius + gap(k) / 2) * side(k));
  };
  const std::function<Ellipse(int)> alone = [=](int k) { return disc(third + wander(k, 1.1)); };
  made.path = [=](int k) {  // beside the third disc, its long side along the rim
    const double turn = 0.015 * k;
    const Eigen::Vector2d out(std::cos(turn), std::sin(turn));
    return Ellipse{third + wander(k, 1.1) + (kRadius + 15 + gap(k)) * out, 30, 15,
                   std::remainder(turn + std::numbers::pi / 2, std::numbers::pi)};
  };
  const cv::Vec3f steel(0.98F, 1.0F, 1.03F);
  made.companions = {{first, chosen.one_color ? steel : cv::Vec3f(0.25F, 0.9F, 0.3F)},
                     {second, chosen.one_color ? steel : cv::Vec3f(1.5F, 0.55F, 0.3F)},
                     {alone, chosen.one_color ? steel : cv::Vec3f(0.9F, 1.2F, 0.25F)}};
  return made;
}

struct SeveralScore {
  int frames = 0, lost = 0, wrong = 0, swapped = 0, seen = 0;
  double center_px = 0;
};

/// `lost`, `wrong`, `seen` over all four objects; `swapped`: wrong, and within 10 px of another
/// object.
inline SeveralScore score_several(const SeveralSettings& chosen, int frames) {
  Sequence sequence(several(chosen));
  std::vector<TrackedObject> objects;
  for (int who = -1; who < 3; ++who)
    objects.push_back({ObjectModel::train(sequence.training(4, 5000, 37, who), {}, {}), {}});
  MultiTracker tracker(objects);
  SeveralScore score;
  score.frames = frames;
  for (int k = 0; k < frames; ++k) {
    const Frame frame = sequence.frame(k);
    std::vector<Ellipse> truths{frame.truth};
    truths.insert(truths.end(), frame.companions.begin(), frame.companions.end());
    // Which of three equal discs is which is not in the image: a person states it once.
    if (k == 0 && chosen.one_color)
      for (std::size_t i = 0; i < 4; ++i) tracker.place(i, truths[i]);
    const std::vector<Track>& tracks = tracker.update(frame.image);
    const bool covered = frame.visible < 0.99;
    for (std::size_t i = 0; i < 4; ++i) {
      if (tracks[i].state != TrackState::tracking) {
        score.lost += !covered && k + 1 >= ColorTrackerSettings{}.confirm_frames;
        continue;
      }
      const Eigen::Vector2d at = tracks[i].measured->ellipse.center_px;
      const double off = (at - truths[i].center_px).norm();
      if (off > 10 || (i == 0 && frame.visible <= 0)) {
        ++score.wrong;
        for (std::size_t j = 0; j < 4; ++j)
          score.swapped += j != i && (at - truths[j].center_px).norm() < 10;
        continue;
      }
      ++score.seen;
      score.center_px += off;
    }
  }
  score.center_px /= std::max(score.seen, 1);
  return score;
}

}  // namespace vitreo::vision::generated
