// A plain reader of records, which knows SQLite, TIFF and CRC-32 and nothing of the program's own.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/record_writer.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <iterator>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace vitreo::reference {

namespace fs = std::filesystem;
using Rows = std::vector<std::vector<std::string>>;

/// What a query finds; numbers to all their digits, bytes in hexadecimal, NULL by name.
inline Rows rows(const fs::path& file, const std::string& query) {
  sqlite3* database = nullptr;
  sqlite3_stmt* statement = nullptr;
  EXPECT_EQ(sqlite3_open_v2(file.c_str(), &database, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
  Rows found;
  if (sqlite3_prepare_v2(database, query.c_str(), -1, &statement, nullptr) == SQLITE_OK) {
    while (sqlite3_step(statement) == SQLITE_ROW) {
      std::vector<std::string> row;
      for (int i = 0; i < sqlite3_column_count(statement); ++i) {
        switch (sqlite3_column_type(statement, i)) {
          case SQLITE_NULL:
            row.emplace_back("NULL");
            break;
          case SQLITE_FLOAT:
            row.push_back(fmt::format("{:.17g}", sqlite3_column_double(statement, i)));
            break;
          case SQLITE_BLOB: {
            std::string hexadecimal;
            const auto* bytes = static_cast<const std::uint8_t*>(sqlite3_column_blob(statement, i));
            for (int k = 0; k < sqlite3_column_bytes(statement, i); ++k)
              hexadecimal += fmt::format("{:02x}", bytes[k]);
            row.push_back(hexadecimal);
            break;
          }
          default: {
            const auto* text = sqlite3_column_text(statement, i);
            row.emplace_back(reinterpret_cast<const char*>(text));
          }
        }
      }
      found.push_back(row);
    }
    sqlite3_finalize(statement);
  } else {
    found.push_back({"error", sqlite3_errmsg(database)});
  }
  sqlite3_close(database);
  return found;
}

inline std::vector<std::uint8_t> bytes_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// CRC-32 of IEEE 802.3, bit by bit.
inline std::uint32_t crc32(const std::vector<std::uint8_t>& bytes) {
  std::uint32_t crc = 0xFFFFFFFF;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320U : 0U);
  }
  return ~crc;
}

struct Page {
  std::uint32_t width = 0, height = 0, samples = 1, offset = 0, bytes = 0;
};
/// The pages of a little-endian TIFF file, one strip each, along its chain.
inline std::vector<Page> pages(const std::vector<std::uint8_t>& file) {
  const auto number = [&](std::size_t at, int size) {
    std::uint32_t value = 0;
    for (int i = size - 1; i >= 0; --i) value = value << 8 | file.at(at + static_cast<unsigned>(i));
    return value;
  };
  EXPECT_EQ(number(0, 4), 0x002A4949U);
  std::vector<Page> found;
  for (std::uint32_t at = number(4, 4); at != 0;) {
    Page page;
    const std::uint32_t entries = number(at, 2);
    for (std::uint32_t i = 0; i < entries; ++i) {
      const std::uint32_t entry = at + 2 + 12 * i;
      const std::uint32_t value = number(entry + 8, number(entry + 2, 2) == 3 ? 2 : 4);
      switch (number(entry, 2)) {
        case 256:
          page.width = value;
          break;
        case 257:
          page.height = value;
          break;
        case 273:
          page.offset = value;
          break;
        case 277:
          page.samples = value;
          break;
        case 279:
          page.bytes = value;
          break;
        default:
          break;
      }
    }
    found.push_back(page);
    at = number(at + 2 + 12 * entries, 4);
  }
  return found;
}

/// A new folder that goes with its owner.
class Folder {
 public:
  Folder() {
    std::string name = (fs::temp_directory_path() / "record_reference_XXXXXX").string();
    EXPECT_NE(mkdtemp(name.data()), nullptr);
    path_ = name;
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  const fs::path& path() const { return path_; }
  fs::path database() const { return path_ / "run.sqlite"; }
  Rows rows(const std::string& query) const { return reference::rows(database(), query); }

 private:
  fs::path path_;
};

/// Limits whose reserve is quickly made.
inline RecordLimits small_limits() {
  RecordLimits limits;
  limits.disk.reserve_bytes = 12345;
  return limits;
}

inline RecordedCameraInfo camera_of(const std::string& role) {
  RecordedCameraInfo info;
  info.camera = role;
  return info;
}

inline void add_stream(RecordWriter& writer, const StreamInfo& info) {
  writer.post([info](RecordFile& file) { file.add_stream(info); }, false);
}

/// Holds the writer's thread, as a slow disk does, from here to release().
class HeldDisk {
 public:
  explicit HeldDisk(RecordWriter& writer) {
    // Shared, for a writer that has failed may still be in it.
    writer.post(
        [state = state_](RecordFile&) {
          state->begun.set_value();
          state->release.get_future().wait();
        },
        true);
    state_->begun.get_future().wait();
  }
  ~HeldDisk() { release(); }
  HeldDisk(const HeldDisk&) = delete;
  HeldDisk& operator=(const HeldDisk&) = delete;
  void release() {
    if (!released_) state_->release.set_value();
    released_ = true;
  }

 private:
  struct State {
    std::promise<void> begun, release;
  };
  std::shared_ptr<State> state_ = std::make_shared<State>();
  bool released_ = false;
};

/// 50 bytes of gray.
inline Frame gray(std::uint64_t number) {
  Frame frame;
  frame.image = cv::Mat(5, 10, CV_8UC1, cv::Scalar(7));
  frame.number = number;
  return frame;
}

/// Whether it is there before the patience is over.
inline bool within(std::chrono::milliseconds patience, const std::function<bool()>& there) {
  const auto begun = std::chrono::steady_clock::now();
  while (!there() && std::chrono::steady_clock::now() - begun < patience)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  return there();
}

}  // namespace vitreo::reference
