// Child process with one pipe: to its input, or from its output and, if asked for, its errors.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

class ChildProcess {
 public:
  /// A program whose output is read has nothing to read itself.
  enum class Pipe { to_input, from_output, from_output_and_errors };
  /// Starts the program that the path knows. Throws std::runtime_error naming it when there is
  /// none.
  ChildProcess(const std::vector<std::string>& words, Pipe pipe);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;
  /// False when it takes no more.
  bool write(std::string_view bytes);
  /// So many bytes, fewer only at the end.
  std::size_t read(void* into, std::size_t bytes);
  /// Whether read() would give something, or the end, without waiting any longer than that.
  bool readable(std::chrono::milliseconds patience) const;
  /// What is there by now, at most so many bytes; none: the end.
  std::size_t read_some(void* into, std::size_t bytes);
  /// Closes the pipe and waits; the exit status, or 128 + a signal.
  int finish();

 private:
  int pid_ = -1;
  int pipe_ = -1;
};

}  // namespace vitreo
