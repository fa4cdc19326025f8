// Image files: whole or refused, listed in natural order of their numbers.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// `name_2.png` before `name_10.png`: digits are compared as numbers.
bool natural_less(const std::string& a, const std::string& b);
/// The last run of digits in a file's name without its ending, "frame_0012.png": 12; nothing
/// without one.
std::optional<long long> number_in(const std::filesystem::path& file);
/// PNG, JPEG, TIFF, BMP, by its ending in either case.
bool is_image_file(const std::filesystem::path& file);

/// The images in a folder, masks (`NAME_mask.png`) left out, in natural order. Throws
/// std::invalid_argument naming the folder when it is none.
std::vector<std::filesystem::path> image_files(const std::filesystem::path& folder);

/// 8-bit BGR (deeper images are scaled, gray ones repeated, transparency dropped). Throws
/// std::invalid_argument naming the file when there is none, it is larger than 256 MB or 2^26
/// pixels, or its bytes are no image.
cv::Mat read_color_image(const std::filesystem::path& file);
/// 8-bit gray: 255 where the brightest channel is above half of the image's own maximum, so masks
/// of 0 and 1, of 0 and 255 and smoothed ones do. Errors as read_color_image.
cv::Mat read_mask(const std::filesystem::path& file);

/// NAME.png with NAME_mask.png beside it.
struct LabeledFiles {
  std::string name;
  std::filesystem::path image;
  std::filesystem::path mask;
};
/// Throws std::invalid_argument naming the folder when it has no such pair, or a mask whose image
/// is missing.
std::vector<LabeledFiles> labeled_files(const std::filesystem::path& folder);

/// PNG bytes, written whole or not at all. Throws std::invalid_argument for an empty image,
/// std::runtime_error naming the file.
void write_png(const std::filesystem::path& file, const cv::Mat& image);

}  // namespace vitreo
