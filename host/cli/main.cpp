// Main program: its command line joins the host and Lua. A command is a row here and a file in
// host/cli/.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/error.h"
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/config/rights.h"
#include "host/engine/preparation.h"
#include "host/engine/run_result.h"
#include "host/engine/versions.h"
#include "host/files/log.h"
#include "host/files/run_folder.h"
#include "host/runs/run_reader.h"
#include "host/text/error_words.h"
#include "host/trials/point_folder.h"

#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>

#include <csignal>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <iostream>
#include <string>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo {
namespace {

// The order of the rows is that of `vitreo --help` and of the man page.
int dispatch(int count, char** words) {
  cli::CommandLine line(
      "Vitreo drives the instruments of a laboratory that steers microrobots inside the eye.\n"
      "Without a command: a Lua prompt on the rig.",
      "vitreo");
  cli::Program program;
  cli::add_run(line, program);
  cli::add_check(line, program);
  cli::add_control(line, program);
  cli::add_describe(line, program);
  cli::add_mask(line, program);
  cli::add_sweep(line, program);
  cli::add_serve(line, program);
  cli::add_reproduce(line, program);
  cli::add_test(line, program);
  cli::add_records(line, program);
  cli::add_compare(line, program);
  cli::add_devices(line, program);
  cli::add_doctor(line, program);
  cli::add_faults(line, program);
  cli::add_soak(line, program);
  cli::add_attach(line, program);
  cli::add_new(line, program);
  cli::add_docs(line, program);
  cli::add_completion(line, program);
  line.version([] { return versions().dump(); });
  return line.run(count, words);
}

/// POSIX gives a new file the lowest free number: a stream that was closed would give its number to
/// the next file, and what is printed would land in the record.
/// From the lowest number up: open() returns the lowest free one, so another answer than `stream`
/// means that the table of descriptors is not as it seems, and nothing may be written. 5 is
/// ExitCode::internal; _exit(), since nothing is there yet to be torn down.
void keep_standard_streams() {
  for (int stream = 0; stream < 3; ++stream)
    if (fcntl(stream, F_GETFD) < 0 && open("/dev/null", O_RDWR) != stream) _exit(5);
}

/// Whether --json is among the words: then an error is a JSON object, too, on the standard output.
/// The words are searched before they are parsed, because parsing itself may be what fails. After
/// "--" they belong to another command.
bool json_wanted(int count, char** words) {
  for (int i = 1; i < count && std::string_view(words[i]) != "--"; ++i)
    if (std::string_view(words[i]) == "--json") return true;
  return false;
}

/// What was printed has reached its file, or its reader has gone (`| head`): a pipe or a socket.
/// Both layers are flushed: fmt::print() writes through stdio, the commands through std::cout. A
/// full disk shows only here, at the flush.
bool printed() {
  std::cout.flush();
  const bool whole = std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout.good();
  struct stat about {};
  return whole || (fstat(STDOUT_FILENO, &about) == 0 &&
                   (S_ISFIFO(about.st_mode) || S_ISSOCK(about.st_mode)));
}

/// The exit code, unless output was lost: a file with half of it must not pass for the whole.
int leave(int code) {
  if (printed()) return code;
  std::cerr << "vitreo: what was printed cannot be written to the standard output\n";
  return code == 0 ? static_cast<int>(ExitCode::internal) : code;
}

/// A name that no file can have, in words of our own. It may be thousands of letters long.
std::string name_error(const std::filesystem::filesystem_error& error) {
  constexpr std::size_t kShown = 60;
  const std::string name = error.path1().string();
  return "'" + name.substr(0, kShown) + (name.size() > kShown ? "..." : "") +
         "': " + error.code().message();
}

}  // namespace
}  // namespace vitreo

// What happens during a run is in its result (run_protocol), so an exception that reaches this
// function comes from before a run or from a command without one, and its type alone decides the
// exit code.
int main(int count, char** words) {
  using vitreo::ExitCode;
  vitreo::keep_standard_streams();
  // Before anything is opened, and inherited by threads: with the default action a `| head` would
  // kill the host while coils are energized.
  std::signal(SIGPIPE, SIG_IGN);  // a reader that has gone must not end a run
  std::signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is an error of write()
  cv::setNumThreads(1);           // the same bytes on every run; and the loop owns its core
  const auto fail = [json = vitreo::json_wanted(count, words)](const std::string& error,
                                                               ExitCode code) {
    std::cerr << "vitreo: " << error << "\n";
    const nlohmann::json object{{"error", error}, {"exit_code", static_cast<int>(code)}};
    if (json)
      std::cout << object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) << "\n";
    vitreo::write_log(error);
    return vitreo::leave(static_cast<int>(code));
  };
  try {
    if (const auto log = vitreo::default_log(); !log.empty()) vitreo::open_log(log);
  } catch (const std::exception& error) {
    // A home that cannot be written to is no reason not to run.
    std::cerr << "vitreo: no log: " << error.what() << "\n";
  }
  try {
    return vitreo::leave(vitreo::dispatch(count, words));
  } catch (const vitreo::ScriptError& error) {
    return fail(error.what(), ExitCode::usage);
  } catch (const vitreo::ConfigError& error) {
    return fail(error.what(), ExitCode::usage);
  } catch (const vitreo::FolderError& error) {
    return fail(error.what(), ExitCode::usage);
  } catch (const std::filesystem::filesystem_error& error) {
    // Of a name that was given: what fails later is an outcome of its run.
    return fail(vitreo::name_error(error), ExitCode::usage);
  } catch (const vitreo::RightError& error) {
    return fail(error.what(), ExitCode::usage);
  } catch (const vitreo::PreflightError& error) {
    return fail(error.what(), ExitCode::preflight_failed);
  } catch (const vitreo::Stopped&) {
    // Out of the dry run: once the record is open, a stop is an outcome and no exception (judge()).
    return fail("stopped by the operator before anything was opened", ExitCode::stopped);
  } catch (const vitreo::SweepError& error) {
    return fail(error.what(), ExitCode::usage);
  } catch (const vitreo::RecordError& error) {
    return fail(error.what(), ExitCode::usage);
  } catch (const vitreo::DeviceError& error) {
    return fail(error.what(), ExitCode::device_missing);
  } catch (const std::exception& error) {
    return fail(vitreo::error_words(error), ExitCode::internal);
  }
}
