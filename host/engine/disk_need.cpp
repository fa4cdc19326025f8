// SPDX-License-Identifier: Apache-2.0
#include "host/engine/disk_need.h"

#include "host/record/disk_watch.h"

#include <fmt/format.h>

namespace vitreo {
namespace {

constexpr double kMargin = 1.2;  // of the need: the dry run gives the least of it
constexpr double kValue = 9;     // bytes of a REAL with its type, in a row of SQLite
constexpr double kRow = 16;      // bytes of a row's number, time and heads
constexpr double kWarn = 600;    // s

}  // namespace

double frame_bytes_per_second(const std::vector<FramePolicy>& policies, const Rig& rig) {
  double rate = 0;
  for (const FramePolicy& policy : policies) {
    const Camera* const camera = policy.camera == "side_camera" ? rig.side_camera : rig.top_camera;
    if (camera == nullptr || camera->info().frame_period <= 0) continue;
    const CameraInfo& info = camera->info();
    if (policy.around > 0) continue;  // the number of events is not known in advance
    const double whole = static_cast<double>(info.width_px) * info.height_px;
    const double window = static_cast<double>(policy.window) * policy.window;
    // A window's policy records one whole frame a second beside the windows (FrameRecording).
    rate += policy.window > 0 ? whole + window / info.frame_period / policy.every
                              : whole / info.frame_period / policy.every;
  }
  return rate;
}

// An estimate from above for small values: SQLite stores integers and zero in fewer bytes.
double sample_bytes(const Recorder& recorder) {
  double bytes = 0;
  for (const Stream& stream : recorder.streams())
    bytes += static_cast<double>(stream.times.size()) * kRow +
             static_cast<double>(stream.values.size()) * kValue;
  return bytes;
}

double free_bytes_for(const std::filesystem::path& out) {
  std::filesystem::path folder = std::filesystem::absolute(out);
  std::error_code error;
  // The first folder above that exists is on the file system on which `out` will be made.
  while (!std::filesystem::exists(folder, error) && folder.has_parent_path() &&
         folder != folder.parent_path())
    folder = folder.parent_path();
  return static_cast<double>(std::filesystem::space(folder).available);
}

// On top come the reserve, which the recorder sets aside before the first sample, and what must be
// left then: with less a run is not begun (DiskWatch::check_start) or is ended (DiskWatch::look).
std::string disk_problem(const std::filesystem::path& out, double need, bool frames) {
  const DiskLimits limits;
  const double room = free_bytes_for(out);
  const std::uint64_t left = frames ? limits.stop_bytes_with_frames : limits.stop_bytes;
  const double wanted = need * kMargin + static_cast<double>(limits.reserve_bytes + left);
  if (room >= wanted) return "";
  return fmt::format("{}: the run would need {} of disk, with a margin, and {} are free",
                     out.string(), size_text(static_cast<std::uint64_t>(wanted)),
                     size_text(static_cast<std::uint64_t>(room)));
}

// At the moment at which recording begins, with the sizes and rates of the cameras that are open: a
// simulated rig has had no preflight.
std::string disk_warning(const std::filesystem::path& out, double bytes_per_second) {
  if (bytes_per_second <= 0) return "";
  const DiskLimits limits;
  const double room = free_bytes_for(out) - static_cast<double>(limits.stop_bytes_with_frames);
  const double seconds = room > 0 ? room / bytes_per_second : 0;
  if (seconds >= kWarn) return "";
  return fmt::format("{}: at {}/s of frames the disk holds {:.0f} s of recording", out.string(),
                     size_text(static_cast<std::uint64_t>(bytes_per_second)), seconds);
}

}  // namespace vitreo
