// SPDX-License-Identifier: Apache-2.0
#include "host/view/board.h"

#include <algorithm>

namespace vitreo::view {
namespace {

constexpr std::size_t kSamples = 3000;  // of a stream: 200 s at 15 Hz
constexpr std::size_t kLines = 300;     // messages and events

}  // namespace

// One frame a camera: a viewer is shown the present, not a film.
void Board::seen(const std::string& camera, const Frame& frame) {
  const std::lock_guard lock(mutex_);
  newest_ = std::max(newest_, frame.received);
  // A cv::Mat shares its pixels: nothing is copied here, and a frame is not written to again.
  frames_[camera] = frame;
}

void Board::sample(const StreamInfo& stream, Time time, std::span<const double> values) {
  // Known to the simulator alone: an operator must not steer by what a real rig cannot show.
  if (stream.name == "truth") return;
  const std::lock_guard lock(mutex_);
  newest_ = std::max(newest_, time);
  // A stream appears with its first sample.
  Held& held = streams_.try_emplace(stream.name, Held{stream, {}}).first->second;
  held.samples.push_back({time, {values.begin(), values.end()}});
  if (held.samples.size() > kSamples) held.samples.pop_front();
}

// The lock is between the threads that write the record and the server's, which reads.
void Board::event(Time time, const std::string& kind, const std::string& text) {
  const std::lock_guard lock(mutex_);
  newest_ = std::max(newest_, time);
  add_line(to_seconds(time), kind, text);
  if (kind != kCoilRest) return;
  rest_ = Rest{to_seconds(time), text, std::nullopt};
  // Its sample comes first, with the same time.
  const auto read = streams_.find(kCoilReadBack);
  if (read != streams_.end() && read->second.samples.back().time == time)
    rest_->amperes = read->second.samples.back().values;
}

void Board::message(const std::string& line) {
  terminal_.message(line);
  const std::lock_guard lock(mutex_);
  // A message has no time of its own.
  add_line(to_seconds(newest_), "message", line);
}

// With the lock held. Numbers go on when old lines are forgotten, so that a viewer knows what it
// has.
void Board::add_line(double time, const std::string& kind, const std::string& text) {
  lines_.push_back({++line_count_, time, kind, text});
  if (lines_.size() > kLines) lines_.pop_front();
}

std::optional<Frame> Board::frame(const std::string& camera,
                                  std::optional<std::uint64_t> after) const {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find(camera);
  // Only a frame that the viewer does not have yet.
  if (found == frames_.end() || (after && found->second.number <= *after)) return {};
  return found->second;
}

std::optional<Rest> Board::rest() const {
  const std::lock_guard lock(mutex_);
  return rest_;
}

std::vector<std::string> Board::cameras() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> names;
  for (const auto& [name, frame] : frames_) names.push_back(name);
  return names;
}

// Copies, here and below: the server's thread encodes them without the lock.
std::vector<StreamInfo> Board::streams() const {
  const std::lock_guard lock(mutex_);
  std::vector<StreamInfo> infos;
  for (const auto& [name, held] : streams_) infos.push_back(held.info);
  return infos;
}

std::vector<Sample> Board::samples(const std::string& stream, std::optional<Time> after,
                                   std::size_t count) const {
  const std::lock_guard lock(mutex_);
  const auto found = streams_.find(stream);
  if (found == streams_.end()) return {};
  const auto& held = found->second.samples;
  auto begin = held.begin();
  if (after)
    // From the end: the samples that are new are few.
    begin = std::find_if(held.rbegin(), held.rend(), [&](const Sample& s) {
              return s.time <= *after;
            }).base();
  if (static_cast<std::size_t>(held.end() - begin) > count)
    begin = held.end() - static_cast<std::ptrdiff_t>(count);
  return {begin, held.end()};
}

std::vector<Line> Board::lines(std::uint64_t after) const {
  const std::lock_guard lock(mutex_);
  std::vector<Line> found;
  for (const Line& line : lines_)
    if (line.number > after) found.push_back(line);
  return found;
}

Time Board::now() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

}  // namespace vitreo::view
