// SPDX-License-Identifier: Apache-2.0
#include "host/record/frame_store.h"

#include "host/files/digest.h"
#include "host/files/run_folder.h"

#include <utility>

namespace vitreo {
namespace {

constexpr auto kFrameSyncAfter = std::chrono::seconds(1);

/// What stands beside each image in the stack. `vitreo recover` makes the missing rows from it.
nlohmann::json metadata_of(const RecordedCameraInfo& info, const Frame& frame,
                           const MissingFrames& missing) {
  nlohmann::json json = {
      {"Camera", info.camera},
      {"Number", frame.number},
      {"Exposed-ns", frame.exposed.count()},
      {"Received-ns", frame.received.count()},
      {"ElapsedTime-ms", static_cast<double>(frame.exposed.count()) * 1e-6},  // Micro-Manager's key
      {"DroppedBefore", missing.dropped},
      {"LostBefore", missing.lost}};
  if (frame.device) json["Device-ns"] = frame.device->count();
  json["BitDepth"] = frame.bits;  // Micro-Manager's key
  return json;
}

}  // namespace

FrameStore::FrameStore(std::filesystem::path folder, std::uint64_t largest_stack)
    : folder_(std::move(folder)), largest_stack_(largest_stack) {}

void FrameStore::add(const RecordedCameraInfo& info) { stacks_.push_back({info, nullptr, 0}); }

/// The stack's head, with Micro-Manager's keys where it has them: its reader shows scale and
/// interval.
void FrameStore::open(Stack& stack, const Frame& frame) {
  const RecordedCameraInfo& info = stack.info;
  const nlohmann::json summary = {
      {"Camera", info.camera},
      {"CameraIdentity", info.identity},
      {"Every", info.every},
      {"Interval_ms", info.frame_period * info.every * 1e3},  // Micro-Manager's keys
      {"PixelSize_um", info.effective_pixel * 1e6},
      {"Width", frame.image.cols},
      {"Height", frame.image.rows},
      {"Run", folder_.filename().string()}};
  const std::string name = slug(info.camera, "camera");
  stack.writer =
      std::make_unique<NdtiffWriter>(folder_ / "frames" / name, name, summary, largest_stack_);
}

void FrameStore::write(std::size_t camera, const Frame& frame, const MissingFrames& missing) {
  Stack& stack = stacks_.at(camera);
  if (!stack.writer) open(stack, frame);
  // All bits that the camera gave. A window into a larger image has gaps between its rows; file and
  // CRC-32 are of the pixels without them.
  const cv::Mat& pixels = frame.deep.empty() ? frame.image : frame.deep;
  const cv::Mat image = pixels.isContinuous() ? pixels : pixels.clone();
  const NdtiffEntry entry =
      stack.writer->write({{"time", stack.count}}, image, metadata_of(stack.info, frame, missing));
  ++stack.count;
  FrameRow row;
  row.camera = stack.info.camera;
  row.number = frame.number;
  row.exposed = frame.exposed;
  row.received = frame.received;
  row.device = frame.device;
  row.file = "frames/" + slug(stack.info.camera, "camera") + "/" + entry.file;
  row.offset = entry.pixels_at;
  row.bytes = entry.pixel_bytes();
  row.width_px = entry.width_px;
  row.height_px = entry.height_px;
  row.pixel_type = entry.pixel_type;
  // Of the image in memory, before the disk had it: what comes back is compared with what the
  // camera gave.
  row.crc32 = crc32(image.data, entry.pixel_bytes());
  row.dropped_before = missing.dropped;
  row.lost_before = missing.lost;
  bytes_ += row.bytes;
  // The first row that waits starts the clock of write_rows().
  if (named_ == rows_.size()) waiting_since_ = std::chrono::steady_clock::now();
  const std::lock_guard lock(mutex_);
  rows_.push_back(std::move(row));
}

std::vector<FrameRow> FrameStore::rows() const {
  const std::lock_guard lock(mutex_);
  return rows_;
}

/// Pixels first, rows second: after a crash a row never names pixels that are not there.
void FrameStore::write_rows(RecordFile& file, bool now) {
  if (named_ == rows_.size()) return;
  // One wait for the disk a second and not one a frame; a power cut takes at most the frames of
  // that second.
  if (!now && std::chrono::steady_clock::now() - waiting_since_ < kFrameSyncAfter) return;
  for (const Stack& stack : stacks_)
    if (stack.writer) stack.writer->sync();
  for (std::size_t i = named_; i < rows_.size(); ++i) file.frame(i, rows_[i]);
  file.commit();
  named_ = rows_.size();
}

}  // namespace vitreo
