// Rules of the source tree: the include table of docs/architecture.md, the lines that every source
// must have, and their checker.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <iterator>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::architecture {

using Strings = std::vector<std::string_view>;

/// One row of the table. The first row whose folder begins a path is the path's own.
struct Row {
  std::string_view folder;
  Strings ours;      ///< what begins a path of ours that it may include
  Strings not_ours;  ///< what of those is excepted
  Strings others;    ///< prefixes of includes that are not ours
  bool posix = false;
  bool pure = false;  ///< no clock, no threads, no files: these are arguments
};

inline const Strings kEverything{"optics/", "vision/", "control/", "devices/", "host/"};
inline const Strings kOfHost{
    "Eigen/", "opencv2/core",  "opencv2/imgproc", "opencv2/imgcodecs", "opencv2/videoio",
    "fmt/",   "sqlite3.h",     "nlohmann/",       "ceres/version",     "readline/",
    "hdf5.h", "openssl/evp.h", "zlib.h",          "yaml-cpp/"};
inline const Strings kOfDevices{"Eigen/", "opencv2/core"};
inline Strings with(Strings some, const Strings& more) {
  some.insert(some.end(), more.begin(), more.end());
  return some;
}

// The rooms of host/ in order, each with those below it that it may use.
inline const Strings kPure{"optics/", "vision/", "control/"};
inline const Strings kText{"host/text/"};
inline const Strings kFiles{"host/files/"};
inline const Strings kConfig = with(kText, {"host/config/"});
inline const Strings kPlot = with(kText, {"host/plot/", "vision/"});
inline const Strings kSafety{"host/safety/", "devices/"};
inline const Strings kRig =
    with(with(with(kConfig, kFiles), kSafety), {"host/rig/", "optics/", "control/"});
inline const Strings kRecord =
    with(with(with(kConfig, kFiles), kPlot), {"host/record/", "devices/time/", "devices/roles/"});
inline const Strings kChannels = with(kRecord, {"host/channels/"});
inline const Strings kRuns = with(kChannels, {"host/runs/"});
inline const Strings kServo = with(with(with(kRecord, kRig), kPure), {"host/servo/"});
inline const Strings kSession = with(kServo, {"host/session/"});
inline const Strings kEngine = with(with(kSession, kRuns), {"host/engine/"});
inline const Strings kView = with(kSession, {"host/view/", "host/channels/"});
inline const Strings kTerminal = with(kSession, {"host/terminal/"});
inline const Strings kTrials = with(kEngine, {"host/trials/"});
inline const Strings kServe = with(with(kView, kRuns), {"host/serve/"});
inline const Strings kInterpreter = with(kSession, {"host/lua/interpreter/"});
inline const Strings kLuaOptics = with(kInterpreter, {"host/lua/optics/"});
inline const Strings kLuaVision = with(kInterpreter, {"host/lua/vision/"});
inline const Strings kLuaControl = with(kInterpreter, {"host/lua/control/"});
inline const Strings kLuaRig =
    with(with(with(kLuaOptics, kLuaVision), kLuaControl), {"host/lua/rig/"});
inline const Strings kLuaRun = with(kLuaRig, {"host/lua/run/", "host/engine/", "host/runs/"});
inline const Strings kLuaScript = with(kLuaRig, {"host/lua/script/"});
inline const Strings kReference = with(with(kLuaRun, kLuaScript), {"host/lua/reference/"});
inline const Strings kPrompt = with(kReference, {"host/lua/prompt/", "host/terminal/"});
inline const Strings kLuaEngine = with(kPrompt, {"host/lua/engine/"});

// OpenCV is named by module: opencv2/core means <opencv2/core.hpp> and <opencv2/core/...>.
inline const std::vector<Row> kTable{
    {"optics/numerics/", {"optics/numerics/"}, {}, {"Eigen/", "ceres/"}, false, true},
    {"optics/system/",
     {"optics/system/", "optics/numerics/"},
     {},
     {"Eigen/", "ceres/"},
     false,
     true},
    {"optics/rays/",
     {"optics/rays/", "optics/system/", "optics/numerics/"},
     {},
     {"Eigen/"},
     false,
     true},
    {"optics/maps/",
     {"optics/maps/", "optics/rays/", "optics/system/", "optics/numerics/"},
     {},
     {"Eigen/"},
     false,
     true},
    {"optics/projection/",
     {"optics/projection/", "optics/rays/", "optics/system/", "optics/numerics/"},
     {},
     {"Eigen/", "ceres/"},
     false,
     true},
    {"optics/pose/",
     {"optics/pose/", "optics/projection/", "optics/rays/", "optics/system/", "optics/numerics/"},
     {},
     {"Eigen/", "ceres/"},
     false,
     true},
    {"optics/chain/",
     {"optics/chain/", "optics/pose/", "optics/projection/", "optics/rays/", "optics/system/",
      "optics/numerics/"},
     {},
     {"Eigen/", "ceres/"},
     false,
     true},
    {"optics/calibration/",
     {"optics/"},
     {"optics/analysis/", "optics/design/", "optics/maps/"},
     {"Eigen/", "ceres/"},
     false,
     true},
    {"optics/analysis/", {"optics/"}, {"optics/design/"}, {"Eigen/", "ceres/"}, false, true},
    {"optics/design/", {"optics/"}, {}, {"Eigen/", "ceres/"}, false, true},
    {"vision/",
     {"vision/"},
     {},
     {"Eigen/", "ceres/", "opencv2/core", "opencv2/imgproc", "opencv2/video", "opencv2/dnn"},
     false,
     true},
    {"control/", {"control/"}, {}, {"Eigen/", "ceres/"}, false, true},
    {"devices/sim/",
     {"devices/", "optics/", "control/"},
     {"devices/testbed/"},
     {"Eigen/", "opencv2/core", "opencv2/imgproc", "opencv2/imgcodecs"}},
    {"devices/time/", {"devices/time/"}, {}, {}, true},
    // Each bus' library in one place.
    {"devices/links/serial_port.cpp",
     {"devices/links/", "devices/time/"},
     {},
     {"libserialport.h"},
     true},
    {"devices/links/hidapi_link.cpp", {"devices/links/", "devices/time/"}, {}, {"hidapi.h"}},
    {"devices/links/evdev_link.cpp",
     {"devices/links/", "devices/time/"},
     {},
     {"libevdev/libevdev.h"},
     true},
    {"devices/links/libusb_", {"devices/links/", "devices/time/"}, {}, {"libusb.h"}},
    {"devices/links/", {"devices/links/", "devices/time/"}, {}, {}, true},
    // Instruments of one Lua file: a sandbox of their own, below the host and its Lua.
    {"devices/scripted/",
     {"devices/scripted/", "devices/links/", "devices/roles/", "devices/time/",
      "devices/instruments/stage_driver.h"},
     {},
     {"lua.hpp"}},
    {"devices/roles/", {"devices/roles/", "devices/time/"}, {}, kOfDevices, true},
    {"devices/contract/",
     {"devices/contract/", "devices/roles/", "devices/time/"},
     {},
     kOfDevices,
     true},
    {"devices/testbed/",
     {"devices/testbed/", "devices/links/", "devices/time/"},
     {},
     {"umockdev.h", "ifaddrs.h", "net/if.h"},
     true},
    // Each instrument's library in one place.
    {"devices/instruments/genicam/",
     {"devices/"},
     {"devices/sim/", "devices/testbed/"},
     {"opencv2/core", "opencv2/imgproc", "arv.h"},
     true},
    {"devices/instruments/iidc/",
     {"devices/"},
     {"devices/sim/", "devices/testbed/"},
     {"opencv2/core", "dc1394/"},
     true},
    {"devices/instruments/image_sequence/",
     {"devices/"},
     {"devices/sim/", "devices/testbed/"},
     {"opencv2/core", "opencv2/imgcodecs"}},
    {"devices/instruments/opencv_camera/",
     {"devices/"},
     {"devices/sim/", "devices/testbed/"},
     {"opencv2/core", "opencv2/videoio"},
     true},  // V4L2's controls
    {"devices/instruments/", {"devices/"}, {"devices/sim/", "devices/testbed/"}, kOfDevices, true},
    {"host/text/", kText, {}, {"fmt/", "nlohmann/"}, true},
    {"host/files/", kFiles, {}, kOfHost, true},
    {"host/config/", kConfig, {}, kOfHost, true},
    {"host/plot/", kPlot, {}, kOfHost, true},
    {"host/safety/guardian/", {"devices/", "host/safety/guardian/"}, {"devices/sim/"}, {}, true},
    {"host/safety/", kSafety, {"devices/sim/"}, kOfHost, true},
    {"host/rig/", kRig, {}, kOfHost, true},
    {"host/record/", kRecord, {}, kOfHost, true},
    {"host/channels/", kChannels, {}, kOfHost, true},
    {"host/runs/", kRuns, {}, kOfHost, true},
    {"host/servo/", kServo, {}, kOfHost, true},
    {"host/session/", kSession, {}, kOfHost, true},
    {"host/engine/", kEngine, {}, kOfHost, true},
    {"host/view/web_server.cpp", kView, {}, with(kOfHost, {"boost/"}), true},
    {"host/view/control_socket.cpp", kView, {}, with(kOfHost, {"boost/"}), true},
    {"host/view/control_client.cpp", kView, {}, with(kOfHost, {"boost/"}), true},
    {"host/view/", kView, {}, kOfHost, true},
    {"host/terminal/", kTerminal, {}, kOfHost, true},
    {"host/trials/soak_check.cpp", kTrials, {}, with(kOfHost, {"malloc.h"}), true},
    {"host/trials/", kTrials, {}, kOfHost, true},
    {"host/serve/", kServe, {}, kOfHost, true},
    {"host/lua/interpreter/", kInterpreter, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/lua/optics/", kLuaOptics, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/lua/vision/", kLuaVision, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/lua/control/", kLuaControl, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/lua/rig/", kLuaRig, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/lua/run/", kLuaRun, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/lua/script/", kLuaScript, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/lua/reference/", kReference, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/lua/prompt/", kPrompt, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/lua/engine/", kLuaEngine, {}, with(kOfHost, {"lua.hpp"}), true},
    {"host/cli/command_line.cpp", kEverything, {"host/lua/"}, with(kOfHost, {"CLI/"}), true},
    {"host/cli/", kEverything, {}, kOfHost, true},
};

inline std::set<std::string> words(const std::string& text) {
  std::istringstream stream(text);
  return {std::istream_iterator<std::string>(stream), {}};
}
// The last one is the compiler's own: the kernels of run-time dispatch want it.
inline const std::set<std::string> kStd = words(
    "algorithm any array atomic barrier bit bitset cassert cctype cerrno cfenv cfloat charconv "
    "chrono "
    "cinttypes climits clocale cmath compare complex concepts condition_variable coroutine csetjmp "
    "csignal "
    "cstdarg cstddef cstdint cstdio cstdlib cstring ctime cwchar deque exception execution "
    "filesystem "
    "forward_list fstream functional future initializer_list iomanip ios iosfwd iostream istream "
    "iterator "
    "latch limits list locale map memory memory_resource mutex new numbers numeric optional "
    "ostream queue "
    "random ranges ratio regex semaphore set shared_mutex source_location span sstream stack "
    "stdexcept "
    "stop_token streambuf string string_view strstream system_error thread tuple type_traits "
    "typeindex "
    "typeinfo unordered_map unordered_set utility valarray variant vector version immintrin.h");
inline const std::set<std::string> kImpure = words(
    "chrono ctime thread mutex condition_variable future filesystem fstream iostream csignal");
inline const std::set<std::string> kPosix = words(
    "dirent.h dlfcn.h errno.h fcntl.h fnmatch.h glob.h netdb.h poll.h pthread.h pty.h pwd.h "
    "sched.h "
    "semaphore.h signal.h spawn.h "
    "stdlib.h termios.h time.h unistd.h");
inline const Strings kPosixFolders{"arpa/", "asm/", "linux/", "netinet/", "sys/"};

inline bool begins(std::string_view text, std::string_view with) {
  return text.substr(0, with.size()) == with;
}
inline bool begins_with_any(std::string_view text, const Strings& with) {
  return std::any_of(with.begin(), with.end(),
                     [&](std::string_view one) { return begins(text, one); });
}
/// As begins_with_any, but a prefix without a slash or a dot is a module: opencv2/video does not
/// mean opencv2/videoio.
inline bool is_of(std::string_view include, const Strings& libraries) {
  return std::any_of(libraries.begin(), libraries.end(), [&](std::string_view library) {
    if (!begins(include, library)) return false;
    const bool whole = include.size() == library.size() || library.back() == '/';
    return whole || include[library.size()] == '/' || include[library.size()] == '.';
  });
}

inline const Row* row_of(std::string_view path) {
  const auto row = std::find_if(kTable.begin(), kTable.end(),
                                [&](const Row& r) { return begins(path, r.folder); });
  return row == kTable.end() ? nullptr : &*row;
}

/// Why the file at `path` may not include this; empty when it may.
inline std::string complaint(std::string_view path, char quote, const std::string& include) {
  const Row* const row = row_of(path);
  if (row == nullptr) return "is included by a file that no row of the table covers";
  if (quote == '"') {
    if (!begins_with_any(include, kEverything))
      return "is quoted, but begins with none of our folders";
    if (begins_with_any(include, row->not_ours) || !begins_with_any(include, row->ours))
      return "is forbidden in " + std::string(row->folder);
    return {};
  }
  if (begins_with_any(include, kEverything)) return "is ours and belongs in quotes";
  if (kStd.count(include) != 0)
    return row->pure && kImpure.count(include) != 0
               ? "is not pure: time, threads and files are the host's"
               : "";
  if (kPosix.count(include) != 0 || begins_with_any(include, kPosixFolders))
    return row->posix ? "" : "is POSIX, which is forbidden in " + std::string(row->folder);
  return is_of(include, row->others) ? "" : "is forbidden in " + std::string(row->folder);
}

/// The header that a .cpp implements says what both are for; whatever has no header must say so
/// itself.
inline bool has_header_of_its_own(const std::string& path, const std::string& text) {
  if (path.size() < 4 || path.substr(path.size() - 4) != ".cpp") return false;
  return text.find("#include \"" + path.substr(0, path.size() - 4) + ".h\"\n") != std::string::npos;
}

/// Everything wrong with one source, each as "path:line: what".
inline std::vector<std::string> findings_in(const std::string& path, const std::string& text) {
  static const std::regex kInclude(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"].*)");
  static const std::regex kLeftOver(R"(.*\b(TODO|FIXME|XXX)\b.*)");
  static const std::regex kPurpose(R"(^// \S.{14,})");
  std::vector<std::string> findings;
  int number = 0;
  const auto find = [&](const std::string& what) {
    findings.push_back(path + ":" + std::to_string(number) + ": " + what);
  };
  std::istringstream lines(text);
  std::smatch match;
  bool licensed = false;
  const bool silent = has_header_of_its_own(path, text);
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (number == 1 && !silent && (!std::regex_match(line, kPurpose) || begins(line, "// SPDX")))
      find("does not begin with a comment that says what it is for");
    if (line == "// SPDX-License-Identifier: Apache-2.0") licensed = true;
    if (std::regex_match(line, kLeftOver)) find("something is left to do");
    if (std::regex_match(line, match, kInclude)) {
      const std::string why = complaint(path, *match[1].first, match[2].str());
      if (!why.empty()) find("<" + match[2].str() + "> " + why);
    }
  }
  number = 1;
  if (!licensed) find("has no SPDX line");
  return findings;
}

}  // namespace vitreo::architecture
