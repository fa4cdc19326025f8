// Matroska export: lossless video (FFV1) by the program ffmpeg, decoded again and compared.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/child_process.h"
#include "host/files/digest.h"
#include "host/files/run_folder.h"
#include "host/runs/export.h"
#include "host/runs/run_reader.h"

#include <fmt/format.h>

#include <stdexcept>

namespace vitreo {
namespace {

// By FrameRow::pixel_type; FFV1 keeps each bit.
constexpr const char* kFormats[] = {"gray", "gray16le", "bgr24"};

std::string size_of(const FrameRow& row) {
  return fmt::format("{}x{}", row.width_px, row.height_px);
}

/// FFV1 version 3 with a key frame each frame (-g 1) and a CRC each slice: any frame can be read
/// alone, and damage shows.
void encode(const RunData& data, const std::vector<const FrameRow*>& rows, double rate,
            const std::string& file) {
  const FrameRow& first = *rows[0];
  const std::string format = kFormats[first.pixel_type];
  // bgr24 has no FFV1 form of its own: bgr0 keeps all of it.
  const std::string kept = first.pixel_type == 2 ? "bgr0" : format;
  ChildProcess ffmpeg({"ffmpeg",    "-v",
                       "error",     "-y",
                       "-f",        "rawvideo",
                       "-pix_fmt",  format,
                       "-s",        size_of(first),
                       "-r",        fmt::format("{:.6f}", rate),
                       "-i",        "-",
                       "-c:v",      "ffv1",
                       "-level",    "3",
                       "-g",        "1",
                       "-slicecrc", "1",
                       "-pix_fmt",  kept,
                       "-f",        "matroska",
                       file},
                      ChildProcess::Pipe::to_input);
  for (const FrameRow* row : rows) {
    const cv::Mat image = read_frame(data, *row);
    // It has ended before its time: its exit status says why.
    if (!ffmpeg.write({reinterpret_cast<const char*>(image.data), row->bytes})) break;
  }
  if (const int status = ffmpeg.finish(); status != 0)
    throw std::runtime_error(fmt::format("{}: ffmpeg ended with {}", file, status));
}

/// What was written decodes to the same pixels.
/// Against the CRC-32 of the record and not against the stack's pixels once more: so the film is
/// held to what the camera gave.
void check(const std::vector<const FrameRow*>& rows, const std::string& file) {
  ChildProcess ffmpeg({"ffmpeg", "-v", "error", "-i", file, "-f", "rawvideo", "-pix_fmt",
                       kFormats[rows[0]->pixel_type], "-"},
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

Files export_mkv(const RunData& data, const std::filesystem::path& folder) {
  Files files;
  for (const RecordedCameraInfo& camera : data.cameras) {
    const std::vector<const FrameRow*> rows = frames_of(data, camera.camera);
    if (rows.empty()) continue;
    const std::filesystem::path file = folder / (slug(camera.camera, "camera") + ".mkv");
    // Matroska wants one rate: the nominal one. The true times of the frames are in the record,
    // which dropped frames make uneven; 25 Hz where the camera stated none.
    const double period = camera.frame_period * camera.every;
    encode(data, rows, period > 0 ? 1 / period : 25, file.string());
    check(rows, file.string());
    files.push_back(file);
  }
  return files;
}

}  // namespace vitreo
