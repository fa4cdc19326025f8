// SPDX-License-Identifier: Apache-2.0
#include "host/record/meaning.h"

#include "host/record/record_schema.h"

namespace vitreo {
namespace {

// By the first part of the path: a file of a run's folder that no row begins is none of ours.
const std::vector<Meaning> kFiles{
    {"file", "run.sqlite", "",
     "the record: SQLite 3. While the run goes on run.sqlite-wal and run.sqlite-shm belong to it"},
    {"file", "DATA.md", "", "this description, made from run.sqlite"},
    {"file", "report.html", "", "report for people, self-contained; made from run.sqlite"},
    {"file", "summary.json", "", "outcome, parameters and results for programs, in SI units"},
    {"file", "expectations.json", "",
     "what the protocol judged: each number with what it was compared with, and the verdict"},
    {"file", "frames/", "",
     "a folder a recorded camera: NDTiff 3.3 (NDTiff.index and TIFF stacks), uncompressed; the "
     "table frame has the place of each image"},
    {"file", "pictures/", "", "pictures of the report, PNG"},
    {"file", "plots/", "", "plots of the report, SVG"},
    {"file", "script/", "",
     "the protocol, the rig file and what it builds on, script/modules/ what they required: as "
     "they were"},
    {"file", "SHA256SUMS", "", "SHA-256 of every other file, as sha256sum -c reads it"},
    {"file", "export/", "", "what vitreo export made from the record; not part of it"},
    {"file", "recording.lock", "", "held by the program while it records"},
    {"file", "reserve.room", "", "room kept on the disk for the end record while it records"},
};

// The names are words of the format: readers compare with them, so a text may change here and a
// name may not.
const std::vector<Meaning> kNames{
    {"time", "real", "",
     "the run's clock is the monotonic clock of the host, which goes at the pace of the wall "
     "clock: run.t0_utc_ns plus t_ns is UTC as the host's wall clock had it when the run began"},
    {"time", "virtual", "",
     "the run's clock is that of the simulation, which jumps from event to event and does not keep "
     "the pace of the wall clock: run.t0_utc_ns is when the simulation began; plus t_ns it is a "
     "time by which simulated data can be laid in order, not a time of the wall clock"},
    {"clock", kExposure, "",
     "the middle of the exposure of the frame (of a pose sensor: the moment whose pose it gives)"},
    {"clock", kSetPoint, "",
     "the moment at which the loop had computed the set-points and they were sent to the "
     "amplifiers; the coils follow later"},
    {"clock", kReadBack, "", "the moment at which the host had what was read back"},
    {"clock", kReading, "", "the moment of the instrument's reading, as its driver states it"},
    {"clock", kHostClock, "", "the moment at which the host computed it"},
    {"clock", kScriptClock, "", "the moment at which the script recorded it"},
    {"axes", kWorld, "",
     "right-handed, origin at the center of the workspace, z up towards the top camera along the "
     "eye's optical axis, x to the right in the top image; light leaves the retina towards +z"},
    {"axes", kTopImage, "",
     "the top camera's image: the center of the first pixel is (0, 0), u goes right, v goes down"},
    {"axes", kSideImage, "",
     "the side camera's image: the center of the first pixel is (0, 0), u goes right along +x, v "
     "goes down along -z; the camera looks along +y"},
};

// Sample tables differ from record to record: one pattern stands for all of them.
std::vector<Meaning> all() {
  std::vector<Meaning> list = kFiles;
  list.insert(list.end(), kNames.begin(), kNames.end());
  for (const RecordTable& table : record_tables())
    list.push_back({"table", table.name, "", table.help});
  list.push_back({"table", "sample_NAME", "", "the samples of the stream NAME, a row each"});
  for (const RecordColumn& one : record_columns())
    list.push_back({"column", std::string(one.table) + "." + one.name, one.unit, one.help});
  list.push_back({"column", "sample_NAME.seq", "1", "the row's number, from 1"});
  list.push_back({"column", "sample_NAME.t_ns", "ns",
                  "the run's clock, at the instant that stream.clock says; the other columns are "
                  "the stream's channels, NULL where there was no value"});
  return list;
}

}  // namespace

const std::vector<Meaning>& meanings() {
  static const std::vector<Meaning> kAll = all();
  return kAll;
}

}  // namespace vitreo
