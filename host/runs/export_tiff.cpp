// TIFF exports: a stack for ImageJ, each slice labelled with its time, and OME-TIFF (the 2016-06
// schema) with the time of each plane.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/run_folder.h"
#include "host/files/tiff_stack.h"
#include "host/runs/export.h"
#include "host/runs/run_clock.h"
#include "host/runs/run_reader.h"
#include "host/text/markup.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <chrono>
#include <span>

namespace vitreo {
namespace {

using Rows = std::span<const FrameRow* const>;

/// The stack of a camera's frames, without its texts.
TiffStack stack_of(const RecordedCameraInfo& camera, const FrameRow& first) {
  TiffStack stack;
  stack.width_px = first.width_px;
  stack.height_px = first.height_px;
  stack.samples = first.pixel_type == 2 ? 3 : 1;
  stack.bits = first.pixel_type == 1 ? 16 : 8;
  // A record that does not say how many bits count leaves all 16.
  stack.significant_bits = first.pixel_type != 1 ? 8 : camera.bits > 8 ? camera.bits : 16;
  stack.pixel = camera.effective_pixel;
  return stack;
}

/// In integers, exact to the nanosecond however long the run was. The sign stands apart, since the
/// whole part of -0.5 has none.
std::string exact_seconds(Time time) {
  const std::int64_t ns = time.count();
  return fmt::format("{}{}.{:09}", ns < 0 ? "-" : "", std::abs(ns / 1000000000),
                     std::abs(ns % 1000000000));
}

std::string utc_of(std::int64_t t0, Time time) {
  return utc_text(std::chrono::system_clock::time_point(
      std::chrono::duration_cast<std::chrono::system_clock::duration>(std::chrono::nanoseconds(t0) +
                                                                      time)));
}

/// ImageJ's own keys.
/// ImageJ reads the first directory alone: by "images" it knows how many pictures follow it without
/// a gap. `max` is the range of gray that it shows: of 12 bits in 16 all would be black.
/// `finterval` is the camera's own, in s; where frames are missing the labels have the times.
std::string imagej_text(const RunData& data, const RecordedCameraInfo& camera,
                        const TiffStack& stack, std::size_t count) {
  const double period = camera.frame_period * camera.every;
  return fmt::format(
      "ImageJ=1.53t\nimages={0}\nframes={0}\nhyperstack=true\nmode=grayscale\nunit=um\n"
      "finterval={1}\nfps={2}\nmin=0\nmax={3}\ntunit=s\nt0_utc={4}\nclock={5}\nrun={6}\n",
      count, period, period > 0 ? 1 / period : 0, (1U << stack.significant_bits) - 1,
      t0_utc_text(data), clock_text(data), data.folder.filename().string());
}

/// "t=2.200000000 s  2026-11-21T13:30:02.323456Z  frame 17", so that it sorts by time.
std::vector<std::string> imagej_labels(const RunData& data, Rows rows) {
  const std::int64_t t0 = t0_utc_ns(data);
  std::vector<std::string> labels;
  for (const FrameRow* row : rows)
    labels.push_back(fmt::format("t={} s  {}  frame {}", exact_seconds(row->exposed),
                                 utc_of(t0, row->exposed), row->number));
  return labels;
}

/// DeltaT is counted from AcquisitionDate, which is the zero of the run's clock.
/// TiffData names no other file, so the planes are the directories of this one in their order,
/// which XYCZT makes that of time. A color plane is one channel of three samples. TimeIncrement is
/// the camera's own period; where frames are missing DeltaT has the times.
std::string ome_text(const RunData& data, const RecordedCameraInfo& camera, const TiffStack& stack,
                     Rows rows) {
  const std::string scale = stack.pixel > 0
                                ? fmt::format(
                                      "PhysicalSizeX=\"{0}\" PhysicalSizeXUnit=\"\xC2\xB5m\" "
                                      "PhysicalSizeY=\"{0}\" PhysicalSizeYUnit=\"\xC2\xB5m\" ",
                                      stack.pixel * 1e6)
                                : "";
  std::string text = fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>"
      "<OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" "
      "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
      "xsi:schemaLocation=\"http://www.openmicroscopy.org/Schemas/OME/2016-06 "
      "http://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd\" Creator=\"vitreo\">"
      "<Image ID=\"Image:0\" Name=\"{}\"><AcquisitionDate>{}</AcquisitionDate>"
      "<Description>run {}, {}; DeltaT: {}</Description>"
      "<Pixels ID=\"Pixels:0\" DimensionOrder=\"XYCZT\" Type=\"uint{}\" SignificantBits=\"{}\" "
      "SizeX=\"{}\" SizeY=\"{}\" SizeC=\"{}\" SizeZ=\"1\" SizeT=\"{}\" {}BigEndian=\"false\" "
      "Interleaved=\"{}\" TimeIncrement=\"{}\" TimeIncrementUnit=\"s\">"
      "<Channel ID=\"Channel:0:0\" SamplesPerPixel=\"{}\"/>"
      "<TiffData IFD=\"0\" PlaneCount=\"{}\"/>",
      escape_markup(camera.camera), t0_utc_text(data),
      escape_markup(data.folder.filename().string()), escape_markup(camera.identity),
      clock_text(data), stack.bits, stack.significant_bits, stack.width_px, stack.height_px,
      stack.samples, rows.size(), scale, stack.samples == 3 ? "true" : "false",
      camera.frame_period * camera.every, stack.samples, rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i)
    text += fmt::format("<Plane TheZ=\"0\" TheC=\"0\" TheT=\"{}\" DeltaT=\"{}\" DeltaTUnit=\"s\"/>",
                        i, exact_seconds(rows[i]->exposed));
  return text + "</Pixels></Image></OME>";
}

void write_pages(const RunData& data, const std::filesystem::path& file, const TiffStack& stack,
                 Rows rows) {
  // Outside of the function, whose bytes are in use until its next call.
  cv::Mat image;
  write_tiff_stack(file, stack, rows.size(), [&](std::size_t i) {
    image = read_frame(data, *rows[i]);
    // OpenCV has BGR, TIFF has RGB.
    if (stack.samples == 3) cv::cvtColor(image, image, cv::COLOR_BGR2RGB);
    return std::string_view(reinterpret_cast<const char*>(image.data), rows[i]->bytes);
  });
}

/// A file a camera, and a new one where a file is full; each is whole by itself.
template <class Describe>
void export_stacks(const RunData& data, ExportFolder& folder, const std::string& ending,
                   Describe describe) {
  for (const RecordedCameraInfo& camera : data.cameras) {
    const std::vector<const FrameRow*> frames = frames_of(data, camera.camera);
    if (frames.empty()) continue;
    TiffStack stack = stack_of(camera, *frames[0]);
    const std::size_t in_one = tiff_capacity(stack);
    for (std::size_t from = 0; from < frames.size(); from += in_one) {
      const Rows rows = Rows(frames).subspan(from, std::min(in_one, frames.size() - from));
      describe(camera, rows, stack);
      write_pages(data, folder.add(slug(camera.camera, "camera"), ending), stack, rows);
    }
  }
}

}  // namespace

void export_tiff(const RunData& data, ExportFolder& folder) {
  export_stacks(data, folder, ".tif",
                [&](const RecordedCameraInfo& camera, Rows rows, TiffStack& stack) {
                  stack.description = imagej_text(data, camera, stack, rows.size());
                  stack.labels = imagej_labels(data, rows);
                });
}

void export_ome(const RunData& data, ExportFolder& folder) {
  export_stacks(data, folder, ".ome.tif",
                [&](const RecordedCameraInfo& camera, Rows rows, TiffStack& stack) {
                  stack.description = ome_text(data, camera, stack, rows);
                });
}

}  // namespace vitreo
