// Exports of a run in the formats of other programs. Errors throw std::runtime_error naming the
// file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"
#include "host/runs/export_folder.h"

#include <string>
#include <vector>

namespace vitreo {

/// A format by its name on the command line.
struct ExportFormat {
  std::string name;
  std::string help;
  void (*write)(const RunData&, ExportFolder&);
  bool of_frames = false;  // nothing else: a record without frames has none
};
const std::vector<ExportFormat>& export_formats();

/// A table a stream, "t (s),x (m),...", and events, results and frames; run.csv and channels.csv
/// say what they are. Opens in a spreadsheet. NaN is an empty cell.
void export_csv(const RunData& data, ExportFolder& folder);
/// MCAP (mcap.dev) for Foxglove, Lichtblick and their kin: the topics of host/channels, times in
/// UTC, with what the run was asked, its results and its report.
void export_mcap(const RunData& data, ExportFolder& folder);
/// An ImageJ stack a camera, each slice labelled with its time; a new file at 4 GB.
void export_tiff(const RunData& data, ExportFolder& folder);
/// An OME-TIFF a camera, with the time of each plane; a new file at 4 GB.
void export_ome(const RunData& data, ExportFolder& folder);
/// FFV1 in Matroska a camera, by the program `ffmpeg`, each frame at its own time; decoded again
/// and compared frame by frame.
void export_mkv(const RunData& data, ExportFolder& folder);
/// HDF5: a group a stream, a dataset a channel with its unit; frames as (n, height, width).
void export_hdf5(const RunData& data, ExportFolder& folder);

/// The frames of one camera, in order; all of one size and kind, or std::runtime_error.
std::vector<const FrameRow*> frames_of(const RunData& data, const std::string& camera);

}  // namespace vitreo
