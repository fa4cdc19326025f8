// What a color tracker carries from image to image, and its steps: color_tracker.cpp judges and
// reports looks, color_tracker_find.cpp finds and confirms, color_tracker_follow.cpp follows.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_tracker.h"
#include "vision/object_search.h"

#include <memory>
#include <optional>
#include <utility>

namespace vitreo::vision {

// All that changes from frame to frame is in TrackMemory, so that a frame can be undone by
// restoring it (MultiTracker).
struct ColorTracker::State : TrackMemory {
  // A look with what it is worth, for which the memory is asked once.
  struct Judged {
    Observation seen;
    LookWorth worth;
    Eigen::Vector2d free_axes_px{0, 0};  // as they were measured before they were held
  };
  State(ObjectModel learnt, const ColorTrackerSettings& chosen)
      : model(std::move(learnt)),
        settings(chosen),
        view(model, settings.view),
        search_source(evidence_source(model)),
        search({{0, 0}, model.semi_axes_px.x(), model.semi_axes_px.y(), 0}) {}

  Ellipse expected() const;
  // Least share of the rim and likeness of a look that is believed.
  struct Asked {
    double inliers;
    double likeness;
  };
  Asked asked_near() const;
  bool near_expected(const cv::Mat& image, const Owned& owned, const Asked& asked, Track& track);
  bool near_expected_displaced(const cv::Mat& image, const Owned& owned, Track& track);
  bool near_expected_relit(const cv::Mat& image, const Owned& owned, Track& track);
  bool anywhere(const cv::Mat& image, const Owned& owned, Track& track);
  void search_in(const LogColor& gains, const Eigen::Vector2d& axes, double reserve,
                 const cv::Mat& image, const Owned& owned);
  void pick_from(const Judged& look, const LogColor& gains);
  struct Way {
    LogColor gains;
    Eigen::Vector2d axes;
    bool resized;
  };
  std::optional<Way> other_way(const Eigen::Vector2d& axes);
  Observation observe(const cv::Mat& image, const Ellipse& start, double gate_px,
                      const EllipsePrior& prior, const Owned& owned, bool from_front = true);
  double look_work(const Eigen::Vector2d& axes) const;
  double search_work(const Eigen::Vector2d& axes) const;
  bool affords(double more) const { return work + for_search + more <= kMostWork; }
  Eigen::Vector2d trained_axes() const;
  double size_of(const Ellipse& e) const;
  const FalseBelief::Asked& asked_of(const Ellipse& e) const;
  bool good(const Observation& seen, const Ellipse& start, const Eigen::Vector2d& axes, double jump,
            double inliers) const;
  LookWorth worth_of(const Observation& seen) const;
  bool look_near(const cv::Mat& image, const Owned& owned, const Ellipse& start, bool from_front,
                 double inliers, Judged& look);
  void hold_axes(const cv::Mat& image, const Owned& owned, const Ellipse& start, Judged& look);
  bool vague(const Judged& look) const;
  void weigh_with_last(LookWorth& worth);
  void look_at(const cv::Mat& image, const Owned& owned, Ellipse start, const Eigen::Vector2d& axes,
               double reserve, Observation& seen);
  void follow(const Ellipse& e, double inliers);
  void find(const cv::Mat& image, const Observation& seen);
  void confirm(const cv::Mat& image, const Judged& look, Track& track);
  bool moved(const cv::Mat& image, const Judged& look) const;
  GroundRing place_found(const cv::Mat& image) const;
  void drop_candidate();
  bool in_image(const Ellipse& e) const;
  void report(const cv::Mat& image, const Judged& look, Track& track);
  EllipseMeasurement calibrated(const Judged& look) const;
  void learn_light(const cv::Mat& image, const Judged& look);
  void head_of(const cv::Mat& image, Track& track);
  void not_seen();

  ObjectModel model;
  ColorTrackerSettings settings;
  ObjectView view;
  std::unique_ptr<EvidenceSource> search_source;
  ObjectSearch search;
  double work = 0;        // of this image, as Track::work
  double for_search = 0;  // of it, kept for a search that follows
  struct {
    std::optional<Judged> best;
    LogColor gains = LogColor::Zero();
    double second = 0;  // likeness of the next best, elsewhere
  } pick;               // of one image's search
};

}  // namespace vitreo::vision
