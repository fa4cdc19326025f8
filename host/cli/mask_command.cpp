// SPDX-License-Identifier: Apache-2.0
#include "host/cli/mask_command.h"

#include "host/files/image_files.h"
#include "host/files/run_folder.h"
#include "vision/color_tracker.h"
#include "vision/draw.h"
#include "vision/mask_outline.h"
#include "vision/moments.h"
#include "vision/tip_template.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <charconv>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <ostream>
#include <stdexcept>
#include <string>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// Numbers with commas between, and nothing else.
/// std::from_chars and not a stream: it does not depend on the locale, in which a comma may be the
/// decimal point. It takes "inf" and "nan" too, hence the test for finite values.
std::vector<double> numbers_of(const std::string& text, const std::string& option,
                               const std::string& wanted) {
  std::vector<double> numbers;
  const char* at = text.data();
  const char* const end = text.data() + text.size();
  while (at != end) {
    double value = 0;
    const auto [next, error] = std::from_chars(at, end, value);
    // The last clause refuses a comma at the end, behind which a number is missing.
    if (error != std::errc() || !std::isfinite(value) || (next != end && *next != ',') ||
        next + 1 == end)
      throw std::invalid_argument(option + ": wants " + wanted + ", got " + text);
    numbers.push_back(value);
    at = next == end ? end : next + 1;
  }
  return numbers;
}

// Pairs (u, v) in px; the caller has checked that the count is even.
std::vector<Eigen::Vector2d> points_of(const std::vector<double>& numbers) {
  std::vector<Eigen::Vector2d> points;
  for (std::size_t i = 0; i + 1 < numbers.size(); i += 2)
    points.emplace_back(numbers[i], numbers[i + 1]);
  return points;
}

// vision::Ellipse has its semi-major axis first; a person measures either one first. Swapping the
// axes turns the ellipse by a right angle.
vision::Ellipse ellipse_of(const std::string& text) {
  const std::vector<double> n = numbers_of(text, "--ellipse", "cx,cy,A,B,phi");
  if (n.size() != 5 || !(n[2] > 0 && n[3] > 0))
    throw std::invalid_argument("--ellipse: wants cx,cy,A,B,phi with axes above 0, got " + text);
  const double turn = n[3] > n[2] ? 90 : 0;  // the axes may be given either way round
  // Full axes to semi-axes; an ellipse's angle is known modulo pi.
  return {{n[0], n[1]},
          std::max(n[2], n[3]) / 2,
          std::min(n[2], n[3]) / 2,
          std::remainder((n[4] + turn) * std::numbers::pi / 180, std::numbers::pi)};
}

// All options are checked before the first image is read: a training set of hundreds of images
// should not fail half-way for a misspelt number.
vision::MaskOutline outline_of(const MaskRequest& request) {
  vision::MaskOutline outline;
  for (const std::string& text : request.ellipses) outline.ellipses.push_back(ellipse_of(text));
  for (const std::string& text : request.polygons) {
    const std::vector<double> n = numbers_of(text, "--polygon", "x,y,x,y,x,y...");
    if (n.size() < 6 || n.size() % 2 != 0)
      throw std::invalid_argument("--polygon: wants x,y of three corners or more, got " + text);
    outline.polygons_px.push_back(points_of(n));
  }
  const auto add = [](const std::vector<std::string>& texts, const char* option,
                      std::vector<Eigen::Vector2d>& to) {
    for (const std::string& text : texts) {
      const std::vector<double> n = numbers_of(text, option, "x,y");
      if (n.size() != 2)
        throw std::invalid_argument(std::string(option) + ": wants x,y, got " + text);
      to.emplace_back(n[0], n[1]);
    }
  };
  add(request.on, "--on", outline.on_px);
  add(request.off, "--off", outline.off_px);
  if (outline.ellipses.empty() && outline.polygons_px.empty())
    throw std::invalid_argument(
        "wants --ellipse or --polygon: where the object is in the first image");
  if (!request.grab && !(outline.on_px.empty() && outline.off_px.empty()))
    throw std::invalid_argument("--on, --off: are for --grab only");
  // Negated, so that NaN is refused too. The margin is half the width of the band in which GrabCut
  // may decide.
  if (!(request.margin_px >= 1 && request.margin_px <= 200))
    throw std::invalid_argument("--margin: wants 1 to 200 px");
  return outline;
}

/// Where the files of one image go.
struct Target {
  fs::path image;
  fs::path mask;
  fs::path overlay;
  std::string name;
};

// NAME.png and NAME_mask.png are what a training folder of the tracker holds (docs/vision.md);
// overlays go to a folder of their own, since they would be taken for images to train with. The
// mask is protected from being written over, because only that may have been mended by hand.
Target target_of(const MaskRequest& request, const std::string& image) {
  const fs::path folder =
      request.out.empty() ? fs::path(image).parent_path() : fs::path(request.out);
  const std::string name = fs::path(image).stem().string();
  Target target{folder / (name + ".png"), folder / (name + "_mask.png"),
                folder / "overlays" / (name + ".png"), name};
  if (!request.force && fs::exists(target.mask))
    throw std::invalid_argument(target.mask.string() +
                                ": is there already; --force writes over it");
  return target;
}

// The image itself is copied only where --out names another folder: beside its source it is there
// already.
void write(const MaskRequest& request, const Target& target, const cv::Mat& image,
           const cv::Mat& mask, const std::optional<Eigen::Vector2d>& tip_px) {
  fs::create_directories(target.overlay.parent_path());
  if (!request.out.empty()) write_png(target.image, image);
  write_png(target.mask, mask);
  vision::Overlay overlay;
  overlay.contours_px = vision::contours_of(mask);
  overlay.target_px = tip_px;
  write_png(target.overlay, vision::draw_overlay(image, overlay));
}

/// Finds in other images what the first one's mask shows.
/// A color tracker trained with one image and its mask; it gives an ellipse only, from which
/// make_masks() cuts the outline by color.
class Follower {
 public:
  Follower(const cv::Mat& image, const cv::Mat& mask) {
    const std::vector<vision::LabeledImage> one{{image, mask}};
    vision::ColorTrackerSettings settings;
    settings.confirm_frames = 1;  // pictures are no sequence: no second one can agree
    tracker_ =
        std::make_unique<vision::ColorTracker>(vision::ObjectModel::train(one, {}, {}), settings);
  }
  std::optional<vision::Ellipse> find(const cv::Mat& image) {
    tracker_->reset();  // pictures are no sequence
    const vision::Track track = tracker_->update(image);
    if (!track.measured) return std::nullopt;
    return track.measured->ellipse;
  }

 private:
  std::unique_ptr<vision::ColorTracker> tracker_;
};

// Tips by the images' names, for `track_sequence tips=`: the first as it was pointed at, the others
// where the first one's pixels fit.
class Tips {
 public:
  explicit Tips(const MaskRequest& request) {
    if (request.tip.empty()) return;
    const std::vector<double> n = numbers_of(request.tip, "--tip", "x,y");
    if (n.size() != 2) throw std::invalid_argument("--tip: wants x,y, got " + request.tip);
    pointed_at_ = Eigen::Vector2d(n[0], n[1]);
    const fs::path folder = request.out.empty() ? fs::path(request.images.front()).parent_path()
                                                : fs::path(request.out);
    file_ = folder / "tips.csv";
    if (!request.force && fs::exists(file_))
      throw std::invalid_argument(file_.string() + ": is there already; --force writes over it");
  }
  // `body`: of an image after the first.
  std::optional<Eigen::Vector2d> look(const std::string& name, const cv::Mat& image,
                                      const cv::Mat& mask,
                                      const std::optional<vision::Ellipse>& body) {
    if (!pointed_at_) return std::nullopt;
    if (!body) {
      template_.emplace(image, vision::moments_of(mask).ellipse({0, 0}), *pointed_at_);
      tips_[name] = *pointed_at_;
    } else if (const auto at = template_->find(image, *body)) {
      tips_[name] = *at;
    }
    ++looked_;
    const auto found = tips_.find(name);
    return found == tips_.end() ? std::nullopt : std::optional(found->second);
  }
  void write(std::ostream& out) const {
    if (!pointed_at_) return;
    std::string rows = "name,x_px,y_px\n";
    for (const auto& [name, at] : tips_)
      rows += fmt::format("{},{:.2f},{:.2f}\n", name, at.x(), at.y());
    write_file(file_, rows);
    out << fmt::format("{}: tips in {} of {} images\n", file_.string(), tips_.size(), looked_);
  }

 private:
  std::optional<Eigen::Vector2d> pointed_at_;
  std::optional<vision::TipTemplate> template_;
  std::map<std::string, Eigen::Vector2d> tips_;
  fs::path file_;
  int looked_ = 0;
};

/// Size and bounding box, for a mask that is wrong shows there first.
/// A mask on the image's edge is a part of the object, and a model trained with it learns a wrong
/// shape. The mask has a pixel, so on[0] is there: mask_of() and cut_by_color() throw for an empty
/// one.
void say(std::ostream& out, const Target& target, const cv::Mat& mask) {
  const cv::Rect all({0, 0}, mask.size()), box = [&mask] {
    std::vector<cv::Point> on;
    cv::findNonZero(mask, on);
    cv::Rect found(on[0], cv::Size(1, 1));
    for (const cv::Point& p : on) found |= cv::Rect(p, cv::Size(1, 1));
    return found;
  }();
  const bool cut = box.x == 0 || box.y == 0 || box.br().x == all.width || box.br().y == all.height;
  out << fmt::format("{}: {} px, {} x {} at {}, {}{}\n", target.mask.string(),
                     cv::countNonZero(mask), box.width, box.height, box.x, box.y,
                     cut ? "; it is cut off by the image's edge" : "");
}

}  // namespace

// The first image's mask is the outline's, cut by color where it is rough. In the others the
// trained tracker finds an ellipse, and the same cut by color makes the mask.
int make_masks(const MaskRequest& request, std::ostream& out) {
  if (request.images.empty()) throw std::invalid_argument("images: there is none");
  const vision::MaskOutline outline = outline_of(request);
  Tips tips(request);
  std::unique_ptr<Follower> follower;
  int missed = 0;
  cv::Size size;
  for (const std::string& file : request.images) {
    const Target target = target_of(request, file);
    const cv::Mat image = read_color_image(file);
    cv::Mat mask;
    std::optional<vision::Ellipse> found;
    if (!follower) {
      mask = vision::mask_of(outline, image.size());
      if (request.grab) mask = vision::cut_by_color(image, mask, outline, request.margin_px);
      size = image.size();
      if (request.images.size() > 1) follower = std::make_unique<Follower>(image, mask);
    } else {
      if (image.size() != size)
        throw std::invalid_argument(file + ": has another size than the first image");
      // Absence and not a failure: an image without the object is common in a recorded sequence.
      found = follower->find(image);
      if (!found) {
        ++missed;
        out << file << ": the object was not found; no mask is written\n";
        continue;
      }
      vision::MaskOutline here;
      here.ellipses.push_back(*found);
      // Without the marks of --on and --off: they are pixels of the first image.
      mask = vision::cut_by_color(image, vision::mask_of(here, size), {}, request.margin_px);
    }
    write(request, target, image, mask, tips.look(target.name, image, mask, found));
    say(out, target, mask);
  }
  tips.write(out);
  return missed;
}

}  // namespace vitreo
