// Program under test: the built program, run as its users do, its output caught.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <sys/wait.h>
#include <system_error>
#include <thread>
#include <unistd.h>

namespace vitreo {

/// Whether more wants to compute here than there are cores: then what goes at the pace of the wall
/// clock is late, and that says nothing of the program.
inline bool machine_is_busy() {
  double load = 0;
  return getloadavg(&load, 1) == 1 && load > std::thread::hardware_concurrency();
}

struct Spoken {
  int exit_code = -1;
  std::string out, err;
};

/// A new folder with the program's own protocols and scripts in reach; everything in it goes when
/// the test ends.
class Workplace {
 public:
  Workplace() {
    std::string name = (std::filesystem::temp_directory_path() / "vitreo_program_XXXXXX").string();
    folder_ = mkdtemp(name.data());
  }
  /// A run whose server was killed goes on, and writes here for a moment longer.
  ~Workplace() {
    std::error_code still_written;
    for (int tries = 0; tries < 200; ++tries) {
      std::filesystem::remove_all(folder_, still_written);
      if (!still_written) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    ADD_FAILURE() << folder_ << " is still written into: " << still_written.message();
  }
  const std::filesystem::path& folder() const { return folder_; }

  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
    return (folder_ / name).string();
  }

  /// `words` as a shell would take them; run in the work place. `input` is the standard input.
  Spoken vitreo(const std::string& words, const std::string& input = "") const {
    write("input", input);
    // Control sockets of its own: other tests' runs are going on, too.
    const std::string command =
        "cd '" + folder_.string() + "' && XDG_RUNTIME_DIR='" + folder_.string() + "' VITREO_LOG='" +
        (folder_ / "host.log").string() + "' '" VITREO_PROGRAM "' " + words + " <input >out 2>err";
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read("out"), read("err")};
  }

  std::string read(const std::string& name) const {
    std::ostringstream text;
    text << std::ifstream(folder_ / name).rdbuf();
    return text.str();
  }

  /// Folders of runs below `runs`.
  int runs() const {
    if (!std::filesystem::exists(folder_ / "runs")) return 0;
    int count = 0;
    for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder_ / "runs"))
      ++count;
    return count;
  }

 private:
  std::filesystem::path folder_;
};

}  // namespace vitreo
