// Matroska export: lossless video (FFV1) by the program ffmpeg, each frame at its own time, decoded
// again and compared.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/child_process.h"
#include "host/files/digest.h"
#include "host/files/raw_film.h"
#include "host/files/run_folder.h"
#include "host/runs/export.h"
#include "host/runs/run_clock.h"
#include "host/runs/run_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <thread>

namespace vitreo {
namespace {

// By FrameRow::pixel_type; FFV1 keeps each bit.
constexpr const char* kFormats[] = {"gray", "gray16le", "bgr24"};
constexpr RawPixels kPixels[] = {RawPixels::gray8, RawPixels::gray16, RawPixels::bgr8};

std::string threads() { return std::to_string(std::max(1U, std::thread::hardware_concurrency())); }

/// us of the run's clock, to the nearest. The film's file has ms, to which ffmpeg rounds them.
std::uint64_t film_time(Time time) {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(0, time.count() + 500) / 1000);
}

/// FFV1 version 3 with a key frame each frame (-g 1) and a CRC each slice: any frame can be read
/// alone, and damage shows. The frames' times pass through: ffmpeg neither doubles nor drops.
std::vector<std::string> encoder(const RunData& data, int pixel_type, const std::string& file) {
  // bgr24 has no FFV1 form of its own: bgr0 keeps all of it.
  const std::string kept = pixel_type == 2 ? "bgr0" : kFormats[pixel_type];
  return {"ffmpeg",
          "-v",
          "error",
          "-y",
          "-f",
          "matroska",
          "-i",
          "-",
          "-copyts",
          "-c:v",
          "ffv1",
          "-level",
          "3",
          "-g",
          "1",
          "-slices",
          "4",
          "-slicecrc",
          "1",
          "-threads",
          threads(),
          "-pix_fmt",
          kept,
          "-fps_mode",
          "passthrough",
          "-enc_time_base",
          "-1",
          "-metadata",
          "creation_time=" + t0_utc_text(data),
          "-metadata",
          "title=" + data.folder.filename().string(),
          "-f",
          "matroska",
          file};
}

void encode(const RunData& data, const std::vector<const FrameRow*>& rows,
            const std::string& file) {
  const FrameRow& first = *rows[0];
  ChildProcess ffmpeg(encoder(data, first.pixel_type, file), ChildProcess::Pipe::to_input);
  bool takes =
      ffmpeg.write(raw_film_head(first.width_px, first.height_px, kPixels[first.pixel_type]));
  for (const FrameRow* row : rows) {
    // It has ended before its time: its exit status says why.
    if (!takes) break;
    const cv::Mat image = read_frame(data, *row);
    takes = ffmpeg.write(raw_film_frame_head(film_time(row->exposed), row->bytes)) &&
            ffmpeg.write({reinterpret_cast<const char*>(image.data), row->bytes});
  }
  if (const int status = ffmpeg.finish(); status != 0 || !takes)
    throw std::runtime_error(fmt::format("{}: ffmpeg ended with {}", file, status));
}

/// What was written decodes to the same pixels.
/// Against the CRC-32 of the record and not against the stack's pixels once more: so the film is
/// held to what the camera gave.
void check(const std::vector<const FrameRow*>& rows, const std::string& file) {
  ChildProcess ffmpeg(
      {"ffmpeg", "-v", "error", "-threads", threads(), "-i", file, "-fps_mode", "passthrough", "-f",
       "rawvideo", "-pix_fmt", kFormats[rows[0]->pixel_type], "-"},
      ChildProcess::Pipe::from_output);
  std::string pixels(rows[0]->bytes, '\0');
  for (const FrameRow* row : rows)
    if (ffmpeg.read(pixels.data(), pixels.size()) != pixels.size() ||
        crc32(pixels.data(), pixels.size()) != row->crc32)
      throw std::runtime_error(
          fmt::format("{}: frame {} does not come back as it was recorded", file, row->number));
  if (ffmpeg.read(pixels.data(), 1) != 0)
    throw std::runtime_error(file + ": has more frames than were recorded");
  ffmpeg.finish();
}

}  // namespace

// The film's times are the run's clock, so that films of two cameras and the streams lie beside
// each other; its date is the zero of that clock.
void export_mkv(const RunData& data, ExportFolder& folder) {
  for (const RecordedCameraInfo& camera : data.cameras) {
    const std::vector<const FrameRow*> rows = frames_of(data, camera.camera);
    if (rows.empty()) continue;
    const std::string file = folder.add(slug(camera.camera, "camera"), ".mkv").string();
    encode(data, rows, file);
    check(rows, file);
  }
}

}  // namespace vitreo
