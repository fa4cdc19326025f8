// Schema of run.sqlite; docs/records.md explains the tables.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo {

// SQLite's user_version; a change of the tables raises it. 3: the table result was called figure;
// 4: bits and offset of a camera.
inline constexpr int kRecordVersion = 4;

// Beside these each stream has a table of its own, sample_NAME (RecordFile::add_stream). Times are
// ns of the run's clock. Nested data is JSON. A seed is text, for SQLite's integers end at 2^63
// - 1.
inline constexpr const char* kRecordSchema = R"(
  CREATE TABLE run(uid TEXT, time TEXT, protocol TEXT, title TEXT, script TEXT, script_hash TEXT,
                   operator TEXT, parameters TEXT, parameter_units TEXT, seed TEXT, versions TEXT,
                   rig TEXT, rig_hash TEXT, devices TEXT, files TEXT);
  CREATE TABLE module(name TEXT PRIMARY KEY, file TEXT, hash TEXT, text TEXT);
  CREATE TABLE stream(id INTEGER PRIMARY KEY, name TEXT UNIQUE, source TEXT, sample_table TEXT);
  CREATE TABLE channel(stream INTEGER REFERENCES stream(id), position INTEGER, name TEXT,
                       unit TEXT);
  CREATE TABLE camera(name TEXT PRIMARY KEY, identity TEXT, every INTEGER, frame_period REAL,
                      effective_pixel REAL, bits INTEGER, offset_x_px INTEGER,
                      offset_y_px INTEGER);
  CREATE TABLE frame(seq INTEGER PRIMARY KEY, camera TEXT, number INTEGER, t_ns INTEGER,
                     t_received_ns INTEGER, t_device_ns INTEGER, file TEXT, offset INTEGER,
                     bytes INTEGER, width_px INTEGER, height_px INTEGER, pixel_type INTEGER,
                     crc32 INTEGER, dropped_before INTEGER);
  CREATE TABLE event(seq INTEGER PRIMARY KEY, t_ns INTEGER, kind TEXT, text TEXT);
  CREATE TABLE result(name TEXT PRIMARY KEY, value REAL, unit TEXT);
  CREATE TABLE plot(seq INTEGER PRIMARY KEY, title TEXT, content TEXT);
  CREATE TABLE drawing(seq INTEGER PRIMARY KEY, title TEXT, svg TEXT);
  CREATE TABLE picture(seq INTEGER PRIMARY KEY, name TEXT, caption TEXT, file TEXT);
  CREATE TABLE result_table(seq INTEGER PRIMARY KEY, title TEXT, header TEXT, rows TEXT);
  CREATE TABLE stop(time TEXT, exit_status TEXT, reason TEXT, script_line TEXT,
                    experiment_time REAL, wall_time REAL, counts TEXT, dropped TEXT, held REAL);
)";

// Made when the first byte of a traced link is recorded; a run without it has no such table.
inline constexpr const char* kLinkTable =
    "CREATE TABLE IF NOT EXISTS link(seq INTEGER PRIMARY KEY, t_ns INTEGER, role TEXT, "
    "address TEXT, event TEXT, bytes BLOB)";

}  // namespace vitreo
