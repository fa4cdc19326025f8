// SPDX-License-Identifier: Apache-2.0
#include "host/session/error_statistics.h"

#include "host/record/recorder.h"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>

namespace vitreo {
namespace {

// A side view has x and z only: its y is not compared.
constexpr std::size_t kAbsent = static_cast<std::size_t>(-1);
constexpr std::size_t kY = 1;
// At 1 mm/s a robot that turns a corner is off a straight line by less than a tenth of this times
// its speed: 15 um.
constexpr Time kGap = std::chrono::milliseconds(150);

// Three columns of one stream, found once: rows are then read without any search by name.
struct Track {
  const Stream* stream;
  std::array<std::size_t, 3> channels;

  bool has(std::size_t axis) const { return channels[axis] != kAbsent; }
  double at(std::size_t row, std::size_t axis) const { return stream->at(row, channels[axis]); }
};

/// The stream and its channels prefix + "x", "y", "z", of which only y may be missing.
Track find_track(const Recorder& recorder, const std::string& name, const std::string& prefix) {
  Track track{recorder.stream(name), {}};
  if (!track.stream) throw std::invalid_argument("stream \"" + name + "\" is not in the record");
  const auto& channels = track.stream->info.channels;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string wanted = prefix + "xyz"[i];
    const auto found = std::find_if(channels.begin(), channels.end(),
                                    [&](const Channel& channel) { return channel.name == wanted; });
    if (found == channels.end() && i != kY)
      throw std::invalid_argument("stream \"" + name + "\" has no channel \"" + wanted + "\"");
    track.channels[i] =
        found == channels.end() ? kAbsent : static_cast<std::size_t>(found - channels.begin());
  }
  return track;
}

/// A time between two rows of a stream: `part` of the way from one to the other.
struct Between {
  std::size_t before = 0;
  std::size_t after = 0;
  double part = 0;
};

/// Between two rows the robot is taken to go straight, unless they are farther apart than kGap.
std::optional<Between> rows_around(const Stream& stream, Time time, bool exactly) {
  const auto& times = stream.times;
  const auto after = std::lower_bound(times.begin(), times.end(), time);
  if (after == times.end()) return std::nullopt;
  const auto row = static_cast<std::size_t>(after - times.begin());
  if (*after == time) return Between{row, row, 0};
  if (exactly || row == 0 || *after - times[row - 1] > kGap) return std::nullopt;
  return Between{row - 1, row,
                 to_seconds(time - times[row - 1]) / to_seconds(*after - times[row - 1])};
}

/// Whether the streams share a moment in [from, to]. Those of one loop carry the time of the
/// exposure that they are about: their rows match, and nothing is interpolated. Two cameras that
/// run freely see at other moments.
bool share_moments(const Stream& a, const Stream& b, Time from, Time to) {
  return std::any_of(a.times.begin(), a.times.end(), [&](Time time) {
    return time >= from && time <= to && std::binary_search(b.times.begin(), b.times.end(), time);
  });
}

double at(const Track& track, const Between& between, std::size_t axis) {
  const double from = track.at(between.before, axis);
  return from + between.part * (track.at(between.after, axis) - from);
}

/// Of absolute values; the standard deviation is that of a sample (n - 1).
struct Moments {
  double count = 0, squares = 0, max = 0, mean = 0, scatter = 0;

  void add(double value) {
    ++count;
    squares += value * value;
    max = std::max(max, value);
    // Welford 1962: no cancellation where the scatter is small beside the mean.
    const double before = value - mean;
    mean += before / count;
    scatter += before * (value - mean);
  }
  double rms() const { return count > 0 ? std::sqrt(squares / count) : 0; }
  double std() const { return count > 1 ? std::sqrt(scatter / (count - 1)) : 0; }
};

}  // namespace

ErrorStatistics error_statistics(const Recorder& recorder, const std::string& stream,
                                 const std::string& prefix, const std::string& reference,
                                 const std::string& reference_prefix, Time from, Time to) {
  const Track track = find_track(recorder, stream, prefix);
  const Track other = find_track(recorder, reference, reference_prefix);
  const bool exactly = share_moments(*track.stream, *other.stream, from, to);
  Moments whole, lateral, depth;
  for (std::size_t row = 0; row < track.stream->times.size(); ++row) {
    const Time time = track.stream->times[row];
    if (time < from || time > to) continue;
    const std::optional<Between> between = rows_around(*other.stream, time, exactly);
    if (!between) continue;
    Eigen::Vector3d error = Eigen::Vector3d::Zero();
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (track.has(axis) && other.has(axis))
        error[static_cast<Eigen::Index>(axis)] = track.at(row, axis) - at(other, *between, axis);
    if (!error.allFinite()) continue;  // the robot was lost
    whole.add(error.norm());
    // Depth is along z, the optical axis of the eye; lateral is across it.
    lateral.add(std::hypot(error.x(), error.y()));
    depth.add(std::fabs(error.z()));
  }
  ErrorStatistics result;
  result.count = static_cast<std::size_t>(whole.count);
  result.rms = whole.rms();
  result.mean = whole.mean;
  result.max = whole.max;
  result.lateral_rms = lateral.rms();
  result.lateral_mean = lateral.mean;
  result.lateral_max = lateral.max;
  result.lateral_std = lateral.std();
  result.depth_rms = depth.rms();
  result.depth_mean = depth.mean;
  result.depth_max = depth.max;
  result.depth_std = depth.std();
  return result;
}

}  // namespace vitreo
