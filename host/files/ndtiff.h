// NDTiff 3.3 stacks (github.com/micro-manager/NDStorage): TIFF pages and an index file that says
// where each one is. Both are whole at every moment, also while they grow and after kill -9.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

/// Where one image is. Offsets and sizes in bytes.
struct NdtiffEntry {
  nlohmann::json axes;  // {"time": 12}
  std::string file;     // a name in the stack's folder
  std::uint64_t pixels_at = 0;
  std::uint64_t metadata_at = 0;
  std::uint64_t metadata_bytes = 0;
  int width_px = 0;
  int height_px = 0;
  int pixel_type = 0;           // 0: 8 bit, 1: 16 bit, 2: 8-bit RGB
  int bits = 0;                 // of 16 that count, the low ones, where the index says it; else 0
  std::uint64_t index_end = 0;  // where its entry ends in the index, when it was read from there
  std::uint64_t pixel_bytes() const;
};

/// Writes one stack. Errors of the disk throw std::runtime_error naming the file; the pages before
/// stay whole.
class NdtiffWriter {
 public:
  static constexpr std::uint64_t kLargestFile =
      0xFFFFFFFF;  // TIFF's offsets have 32 bits; then a new file begins

  /// Makes the folder. `name` begins the files' names; `summary` goes into each file's head.
  NdtiffWriter(const std::filesystem::path& folder, const std::string& name,
               const nlohmann::json& summary, std::uint64_t largest_file = kLargestFile);
  ~NdtiffWriter();
  NdtiffWriter(const NdtiffWriter&) = delete;
  NdtiffWriter& operator=(const NdtiffWriter&) = delete;

  /// 8- or 16-bit gray or 8-bit BGR (stored as RGB), not empty: std::invalid_argument. Pixels
  /// first, then the page's link in the chain, then the index entry. `bits` of 16 that count: the
  /// index tells 10, 12 and 14, and readers show that range.
  NdtiffEntry write(const nlohmann::json& axes, const cv::Mat& image,
                    const nlohmann::json& metadata, int bits = 16);
  /// What was written is on the disk when this returns.
  void sync();

 private:
  void begin_file();

  std::filesystem::path folder_;
  std::string name_;
  std::string file_;
  std::string summary_;
  std::uint64_t largest_;
  std::uint64_t end_ = 0;
  std::uint64_t link_at_ =
      0;  // where the last page keeps the offset of the next; 4 is the file's head
  int stack_ = -1;
  int index_ = -1;
  int files_ = 0;
};

/// The whole entries of a stack's index. `whole_bytes`, when given: how long they are together;
/// what follows is half an entry. Throws std::runtime_error naming the file for what is no index.
std::vector<NdtiffEntry> read_ndtiff_index(const std::filesystem::path& folder,
                                           std::uint64_t* whole_bytes = nullptr);

/// The pixels; color as BGR. Throws std::runtime_error naming the file when they are not all there.
cv::Mat read_ndtiff_image(const std::filesystem::path& folder, const NdtiffEntry& entry);

/// What was written beside the pixels; an object, empty where it is none. Throws like
/// read_ndtiff_image().
nlohmann::json read_ndtiff_metadata(const std::filesystem::path& folder, const NdtiffEntry& entry);

/// After a crash: cuts off half an entry, entries without a page, and pages without an entry.
/// Returns what stays.
std::vector<NdtiffEntry> mend_ndtiff(const std::filesystem::path& folder);

}  // namespace vitreo
