// Another program, with a pipe to its input or from its output.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

class ChildProcess {
 public:
  enum class Pipe { to_input, from_output };
  /// Starts the program that the path knows. Throws std::runtime_error naming it when there is none.
  ChildProcess(const std::vector<std::string>& words, Pipe pipe);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;
  /// False when it takes no more.
  bool write(std::string_view bytes);
  /// So many bytes, fewer only at the end.
  std::size_t read(void* into, std::size_t bytes);
  /// Closes the pipe and waits; the exit status, or 128 + a signal.
  int finish();

 private:
  int pid_ = -1, pipe_ = -1;
};

}  // namespace vitreo
