// libFuzzer target of the image files that a person names: any bytes give an image or a mask of
// the documented kind, or std::invalid_argument, never anything else. Built and run by `make fuzz`.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/image_files.h"

#include <opencv2/core.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <unistd.h>

namespace {

namespace fs = std::filesystem;

// One file in memory for all inputs of a process; the loaders want a path.
const fs::path& scratch() {
  static const fs::path file = [] {
    const fs::path memory = fs::is_directory("/dev/shm") ? "/dev/shm" : fs::temp_directory_path();
    return memory / ("vitreo_fuzz_" + std::to_string(::getpid()) + ".png");
  }();
  return file;
}

struct Removed {
  ~Removed() {
    std::error_code error;
    fs::remove(scratch(), error);
  }
};

template <class Load>
void try_load(Load load, int type) {
  try {
    const cv::Mat image = load(scratch());
    if (image.empty() || image.type() != type) __builtin_trap();
  } catch (const std::invalid_argument&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Removed removed;
  std::ofstream(scratch(), std::ios::binary)
      .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  try_load(vitreo::read_color_image, CV_8UC3);
  try_load(vitreo::read_mask, CV_8UC1);
  return 0;
}
