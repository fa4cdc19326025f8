// Exports of a run in the formats of other programs. Each returns the files it made; errors throw
// std::runtime_error naming the file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

using Files = std::vector<std::filesystem::path>;

/// A table a stream, "t (s),x (m),...", and events, figures and frames: opens in a spreadsheet. NaN
/// is an empty cell.
Files export_csv(const RunData& data, const std::filesystem::path& folder);
/// MCAP (mcap.dev) for Foxglove and ROS tools: JSON with JSON Schema a stream, frames as
/// foxglove.CompressedImage. Log times count from the run's beginning.
Files export_mcap(const RunData& data, const std::filesystem::path& folder);
/// An ImageJ stack a camera; a new file at 4 GB.
Files export_tiff(const RunData& data, const std::filesystem::path& folder);
/// FFV1 in Matroska a camera, by the program `ffmpeg`; decoded again and compared frame by frame.
Files export_mkv(const RunData& data, const std::filesystem::path& folder);
/// HDF5: a group a stream, a dataset a channel with its unit; frames as (n, height, width).
Files export_hdf5(const RunData& data, const std::filesystem::path& folder);

/// The frames of one camera, in order; all of one size and kind, or std::runtime_error.
std::vector<const FrameRow*> frames_of(const RunData& data, const std::string& camera);

}  // namespace vitreo
