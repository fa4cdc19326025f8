// Table of the export formats.
// SPDX-License-Identifier: Apache-2.0
#include "host/runs/export.h"

namespace vitreo {

const std::vector<ExportFormat>& export_formats() {
  static const std::vector<ExportFormat> kFormats{
      {"csv", "a table for each stream, for spreadsheets", export_csv},
      {"mcap", "one file, for Foxglove and Lichtblick", export_mcap},
      {"tiff", "the frames as a stack for ImageJ, a file a camera", export_tiff, true},
      {"ome", "the frames as OME-TIFF, a file a camera", export_ome, true},
      {"mkv", "the frames as a film without loss (FFV1), a file a camera", export_mkv, true},
      {"hdf5", "all streams and frames in one file", export_hdf5}};
  return kFormats;
}

}  // namespace vitreo
