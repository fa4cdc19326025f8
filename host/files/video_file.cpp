// SPDX-License-Identifier: Apache-2.0
#include "host/files/video_file.h"

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace vitreo {

// Invariant after construction: `capture` is open, and `first` holds the frame that it gave, until
// read() hands it out.
struct VideoFile::State {
  cv::VideoCapture capture;
  std::filesystem::path file;
  cv::Mat first;  // read at once: some that are no videos open all the same
};

VideoFile::VideoFile(const std::filesystem::path& file) : state_(std::make_unique<State>()) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error))
    throw std::invalid_argument(file.string() + ": there is no such file");
  state_->file = file;
  bool open = false;
  try {
    // Absolute, since a name such as "http:..." means something else to the library.
    open = state_->capture.open(std::filesystem::absolute(file).string(), cv::CAP_FFMPEG) &&
           state_->capture.read(state_->first) && !state_->first.empty();
  } catch (const cv::Exception&) {
    open = false;
  }
  if (!open) throw std::invalid_argument(file.string() + ": is not a video that can be read");
}

VideoFile::~VideoFile() = default;

// Checked on every frame and not at construction alone: some files change their format on the way.
// The copy keeps the frame valid whatever the back end does with its buffer.
cv::Mat VideoFile::read() {
  cv::Mat frame;
  if (!state_->first.empty())
    std::swap(frame, state_->first);
  else if (!state_->capture.read(frame) || frame.empty())
    return {};
  if (frame.type() != CV_8UC3)
    throw std::runtime_error(state_->file.string() + ": its frames are not 8-bit color");
  return frame.clone();
}

// FFmpeg estimates it from duration and rate where the file does not say, and may give a negative
// number.
int VideoFile::count() const {
  return static_cast<int>(std::clamp(state_->capture.get(cv::CAP_PROP_FRAME_COUNT), 0.0, 1e9));
}

}  // namespace vitreo
