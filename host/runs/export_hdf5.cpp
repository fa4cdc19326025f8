// HDF5 export, by the format's own C library.
// SPDX-License-Identifier: Apache-2.0
#include "host/record/record_json.h"
#include "host/runs/export.h"
#include "host/runs/run_clock.h"
#include "host/runs/run_reader.h"

#include <opencv2/imgproc.hpp>

#include <array>
#include <hdf5.h>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// An identifier of the library with the call that gives it back; a negative one is an error.
/// H5Fclose() leaves a file open as long as an object in it is: everything is closed by its scope,
/// in reverse order, also where an error is thrown.
class Handle {
 public:
  Handle(hid_t id, herr_t (*close)(hid_t), const std::string& what) : id_(id), close_(close) {
    if (id < 0) throw std::runtime_error("HDF5: " + what + " cannot be made");
  }
  ~Handle() { close_(id_); }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  operator hid_t() const { return id_; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

/// Throws where the library reports an error, as a negative value.
void wanted(herr_t result, const std::string& what) {
  if (result < 0) throw std::runtime_error("HDF5: " + what + " cannot be written");
}

/// In HDF5's names a slash separates levels, and "." is the group itself.
std::string named(std::string name) {
  for (char& c : name) c = c == '/' ? '_' : c;
  return name.empty() || name == "." ? "_" : name;
}

/// Variable length, UTF-8.
/// The encoding is stated in the type: no reader has to guess it.
Handle text_type() {
  return {[] {
            const hid_t type = H5Tcopy(H5T_C_S1);
            H5Tset_size(type, H5T_VARIABLE);
            H5Tset_cset(type, H5T_CSET_UTF8);
            return type;
          }(),
          H5Tclose, "a text"};
}

void attribute(hid_t of, const std::string& name, const std::string& value) {
  const Handle type = text_type();
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, name);
  const Handle made(H5Acreate2(of, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose,
                    name);
  const char* text = value.c_str();
  wanted(H5Awrite(made, type, &text), name);
}

Handle group(hid_t in, const std::string& name) {
  return {H5Gcreate2(in, named(name).c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose,
          name};
}

/// One dimension; `unit` is its attribute.
void numbers(hid_t in, const std::string& name, hid_t type, const void* values, std::size_t count,
             const std::string& unit) {
  const hsize_t size = count;
  const Handle space(H5Screate_simple(1, &size, nullptr), H5Sclose, name);
  const Handle set(
      // Native types: the file states their order of bytes, and readers convert.
      H5Dcreate2(in, named(name).c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
      H5Dclose, name);
  if (count > 0) wanted(H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), name);
  attribute(set, "unit", unit);
}

void number_attribute(hid_t of, const std::string& name, std::int64_t value) {
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, name);
  const Handle made(H5Acreate2(of, name.c_str(), H5T_NATIVE_INT64, space, H5P_DEFAULT, H5P_DEFAULT),
                    H5Aclose, name);
  wanted(H5Awrite(made, H5T_NATIVE_INT64, &value), name);
}

void texts(hid_t in, const std::string& name, const std::vector<std::string>& values) {
  const Handle type = text_type();
  const hsize_t size = values.size();
  const Handle space(H5Screate_simple(1, &size, nullptr), H5Sclose, name);
  const Handle set(H5Dcreate2(in, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                   H5Dclose, name);
  std::vector<const char*> pointers;
  for (const std::string& value : values) pointers.push_back(value.c_str());
  if (!values.empty())
    wanted(H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, pointers.data()), name);
}

/// A column of integers, one for each element.
template <class List, class Each>
void integers(hid_t in, const std::string& name, const std::string& unit, const List& list,
              Each each) {
  std::vector<std::int64_t> values;
  for (const auto& one : list) values.push_back(each(one));
  numbers(in, name, H5T_NATIVE_INT64, values.data(), values.size(), unit);
}

// Column by column, as h5py and MATLAB read them; the record in memory is by rows.
void write_stream(hid_t streams, const Stream& stream) {
  const Handle here = group(streams, stream.info.name);
  attribute(here, "source", stream.info.source);
  attribute(here, "clock", stream.info.clock);
  integers(here, "t_ns", "ns", stream.times, [](Time time) { return std::int64_t{time.count()}; });
  std::vector<double> column(stream.times.size());
  for (std::size_t i = 0; i < stream.info.channels.size(); ++i) {
    for (std::size_t row = 0; row < column.size(); ++row) column[row] = stream.at(row, i);
    const Channel& channel = stream.info.channels[i];
    numbers(here, channel.name, H5T_NATIVE_DOUBLE, column.data(), column.size(), channel.unit);
    const Handle set(H5Dopen2(here, named(channel.name).c_str(), H5P_DEFAULT), H5Dclose,
                     channel.name);
    attribute(set, "description", channel.help);
    attribute(set, "axes", channel.axes);
  }
}

/// One dataset (frames, v, u[, RGB]), a chunk a frame, so that readers load single frames. Written
/// frame by frame through a hyperslab, for the whole need not fit into memory.
void write_images(hid_t here, const RunData& data, const std::vector<const FrameRow*>& rows) {
  const FrameRow& first = *rows[0];
  const bool color = first.pixel_type == 2;
  const hid_t type = first.pixel_type == 1 ? H5T_NATIVE_UINT16 : H5T_NATIVE_UINT8;
  const int rank = color ? 4 : 3;
  const std::array<hsize_t, 4> all{rows.size(), static_cast<hsize_t>(first.height_px),
                                   static_cast<hsize_t>(first.width_px), 3};
  std::array<hsize_t, 4> one = all;
  std::array<hsize_t, 4> at{0, 0, 0, 0};
  one[0] = 1;
  const Handle space(H5Screate_simple(rank, all.data(), nullptr), H5Sclose, "images");
  const Handle memory(H5Screate_simple(rank, one.data(), nullptr), H5Sclose, "images");
  const Handle layout(H5Pcreate(H5P_DATASET_CREATE), H5Pclose, "images");
  wanted(H5Pset_chunk(layout, rank, one.data()), "images");
  const Handle set(H5Dcreate2(here, "images", type, space, H5P_DEFAULT, layout, H5P_DEFAULT),
                   H5Dclose, "images");
  attribute(set, "axes", color ? "frame, v, u, RGB" : "frame, v, u");
  for (const FrameRow* row : rows) {
    cv::Mat image = read_frame(data, *row);
    // As the stacks of the record have it, and what readers show.
    if (color) cv::cvtColor(image, image, cv::COLOR_BGR2RGB);
    wanted(H5Sselect_hyperslab(space, H5S_SELECT_SET, at.data(), nullptr, one.data(), nullptr),
           "images");
    wanted(H5Dwrite(set, type, memory, space, H5P_DEFAULT, image.data), "images");
    ++at[0];
  }
}

void write_frames(hid_t file, const RunData& data) {
  const Handle frames = group(file, "frames");
  for (const RecordedCameraInfo& camera : data.cameras) {
    const std::vector<const FrameRow*> rows = frames_of(data, camera.camera);
    if (rows.empty()) continue;
    const Handle here = group(frames, camera.camera);
    attribute(here, "identity", camera.identity);
    integers(here, "bits", "", std::array{camera.bits},
             [](int bits) { return std::int64_t{bits}; });
    integers(here, "t_ns", "ns", rows,
             [](const FrameRow* row) { return std::int64_t{row->exposed.count()}; });
    integers(here, "received_ns", "ns", rows,
             [](const FrameRow* row) { return std::int64_t{row->received.count()}; });
    integers(here, "number", "", rows,
             [](const FrameRow* row) { return static_cast<std::int64_t>(row->number); });
    write_images(here, data, rows);
  }
}

void write_events(hid_t file, const RunData& data) {
  const Handle here = group(file, "events");
  integers(here, "t_ns", "ns", data.events,
           [](const Event& event) { return std::int64_t{event.time.count()}; });
  std::vector<std::string> kinds;
  std::vector<std::string> words;
  for (const Event& event : data.events) {
    kinds.push_back(event.kind);
    words.push_back(event.text);
  }
  texts(here, "kind", kinds);
  texts(here, "text", words);
}

/// All of the file.
void write_run(const std::string& path, const RunData& data) {
  const Handle file(H5Fcreate(path.c_str(), H5F_ACC_EXCL, H5P_DEFAULT, H5P_DEFAULT), H5Fclose,
                    "the file");
  attribute(file, "run", data.folder.filename().string());
  attribute(file, "protocol", std::filesystem::path(data.start.protocol_file).filename().string());
  attribute(file, "parameters", dumped(data.start.parameters));
  attribute(file, "versions", dumped(data.start.versions));
  attribute(file, "tags", dumped(data.start.tags));
  attribute(file, "sample", dumped(data.start.sample));
  attribute(file, "seed", std::to_string(data.start.seed));
  // All t_ns of the file count from here.
  attribute(file, "t0_utc", t0_utc_text(data));
  number_attribute(file, "t0_utc_ns", t0_utc_ns(data));
  attribute(file, "clock", clock_text(data));
  const Handle streams = group(file, "streams");
  for (const Stream& stream : data.streams) write_stream(streams, stream);
  write_events(file, data);
  write_frames(file, data);
  // The handle's close cannot report an error any more: flushed here.
  wanted(H5Fflush(file, H5F_SCOPE_GLOBAL), "the file's end");
}

}  // namespace

// Both settings are for the whole process: nothing else in the host uses the library. Its clean-up
// at the program's end crashes after a file that could not be closed for want of room.
void export_hdf5(const RunData& data, ExportFolder& folder) {
  H5dont_atexit();
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // its errors are thrown, not printed
  const std::string path = folder.add("run", ".h5").string();
  try {
    write_run(path, data);
  } catch (const RecordError&) {
    throw;  // names what is wrong with the record
  } catch (const std::exception& error) {
    throw std::runtime_error(path + ": " + error.what());
  }
}

}  // namespace vitreo
