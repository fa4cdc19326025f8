// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/image_sequence/driver.h"

#include "devices/roles/gray.h"
#include "devices/time/error.h"

#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <set>
#include <stdexcept>
#include <utility>

namespace vitreo::image_sequence {
namespace {

namespace fs = std::filesystem;

/// Image i is exposed at start + i / frame_rate, whether or not it is grabbed.
class ImageSequence final : public Camera {
 public:
  ImageSequence(const Settings& settings, Clock& clock)
      : settings_(settings), clock_(clock), period_(from_seconds(1 / settings.frame_rate)) {
    find_images();
    const cv::Mat first = load(0);
    info_ = {
        "image sequence " + settings_.folder + ", " + std::to_string(files_.size()) + " images",
        first.cols, first.rows, 1 / settings_.frame_rate, settings_.effective_pixel};
    start_ = clock_.now();
  }

  const CameraInfo& info() const override { return info_; }
  CameraStatistics statistics() const override { return statistics_; }

  /// With every_frame the next image, else the newest that was not yet grabbed; waits for it.
  /// `arrived` counts from the opening, by the clock alone: the sequence goes on between two grabs,
  /// as a camera does.
  Frame grab(Time timeout) override {
    const std::int64_t arrived = (clock_.now() - start_) / period_;
    const std::int64_t number = settings_.every_frame ? last_ + 1 : std::max(arrived, last_ + 1);
    const auto count = static_cast<std::int64_t>(files_.size());
    // As a camera that is unplugged.
    if (!settings_.repeat && number >= count) fail(DeviceErrorKind::lost, "the sequence is over");
    const Time exposed = start_ + number * period_;
    const Time deadline = later(clock_.now(), timeout);
    if (exposed > deadline) {
      clock_.sleep_until(deadline);
      fail(DeviceErrorKind::timeout, "no frame in time");
    }
    clock_.sleep_until(exposed);
    // Images that were exposed between two grabs are lost, as a camera's.
    statistics_.lost += static_cast<std::uint64_t>(number - last_ - 1);
    last_ = number;
    Frame frame{load(static_cast<std::size_t>(number % count)), static_cast<std::uint64_t>(number),
                exposed, std::max(exposed, clock_.now())};
    ++statistics_.delivered;
    return frame;
  }

 private:
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, settings_.name, what);
  }

  /// By the extension, whatever its case; what is no image is found when it is loaded.
  void find_images() {
    std::error_code error;
    static const std::set<std::string> kKnown{".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp"};
    for (fs::directory_iterator entry(settings_.folder, error), end; !error && entry != end;
         entry.increment(error)) {
      std::string extension = entry->path().extension().string();
      std::transform(extension.begin(), extension.end(), extension.begin(),
                     [](unsigned char letter) { return static_cast<char>(std::tolower(letter)); });
      if (kKnown.count(extension) != 0) files_.push_back(entry->path().string());
    }
    if (error) fail(DeviceErrorKind::not_found, settings_.folder + ": " + error.message());
    if (files_.empty()) fail(DeviceErrorKind::not_found, settings_.folder + " holds no images");
    std::sort(files_.begin(), files_.end(), naturally_before);
  }

  /// Loaded when it is grabbed: a long sequence may not fit into memory.
  cv::Mat load(std::size_t index) const {
    const std::string& file = files_[index];
    // OpenCV reports a damaged file by an exception or by an empty image.
    cv::Mat image;
    try {
      image = cv::imread(file, cv::IMREAD_UNCHANGED);
    } catch (const cv::Exception& problem) {
      fail(DeviceErrorKind::protocol, file + " cannot be read: " + problem.err);
    }
    if (image.empty()) fail(DeviceErrorKind::protocol, file + " is no image");
    // info_ is empty while the first image, which sets the size, is loaded.
    if (info_.width_px != 0 && (image.cols != info_.width_px || image.rows != info_.height_px))
      fail(DeviceErrorKind::protocol, file + " has another size than the first image");
    try {
      return in_gray(image);
    } catch (const std::invalid_argument& problem) {
      fail(DeviceErrorKind::protocol, file + ": " + problem.what());
    }
  }

  const Settings settings_;
  Clock& clock_;
  const Time period_;
  std::vector<std::string> files_;
  CameraInfo info_;
  Time start_{};
  std::int64_t last_ = -1;
  CameraStatistics statistics_;
};

bool is_digit(char letter) { return letter >= '0' && letter <= '9'; }

/// The digits from `at`, without leading zeros; moves `at` past them.
/// For names as people number them: frame2 before frame10.
std::string number_at(const std::string& text, std::size_t& at) {
  const std::size_t begin = at;
  while (at < text.size() && is_digit(text[at])) ++at;
  const std::size_t first = std::min(text.find_first_not_of('0', begin), at);
  return text.substr(first, at - first);
}

}  // namespace

/// Numbers of any length compare by their count of digits, then digit by digit.
bool naturally_before(const std::string& a, const std::string& b) {
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const std::string left = number_at(a, i);
      const std::string right = number_at(b, j);
      if (left.size() != right.size()) return left.size() < right.size();
      if (left != right) return left < right;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i;
      ++j;
    }
  }
  if (i == a.size() && j == b.size()) return a < b;  // the same but for leading zeros
  return i == a.size();
}

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (folder.empty()) throw std::invalid_argument("folder: must not be empty");
  if (!(frame_rate > 0 && frame_rate <= 1e5))
    throw std::invalid_argument("frame_rate: must be in (0, 1e5] Hz");
  if (!(effective_pixel > 0 && effective_pixel < 1))
    throw std::invalid_argument("effective_pixel: must be in (0, 1) m");
}

std::unique_ptr<Camera> open(const Settings& settings, Clock& clock) {
  settings.check();
  return std::make_unique<ImageSequence>(settings, clock);
}

}  // namespace vitreo::image_sequence
