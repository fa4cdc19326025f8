// SPDX-License-Identifier: Apache-2.0
#include "host/view/control_client.h"

#include "host/config/config.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/write.hpp>
#include <cstring>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;
using Local = asio::local::stream_protocol;

constexpr auto kPatience = std::chrono::seconds(5);  // for a reply

/// The folder of the sockets, for this user alone: a connection is enough to stop a run. Throws
/// std::runtime_error where it is not safe.
fs::path runtime_folder() {
  const char* const given = std::getenv("XDG_RUNTIME_DIR");
  const fs::path folder = given != nullptr && *given != '\0'
                              ? fs::path(given) / "vitreo"
                              : fs::temp_directory_path() / fmt::format("vitreo-{}", getuid());
  if (mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
    throw std::runtime_error(folder.string() + ": cannot be made: " + std::strerror(errno));
  struct stat there = {};
  // In /tmp another user may have made a folder, or a link, of that name before.
  if (lstat(folder.c_str(), &there) != 0 || !S_ISDIR(there.st_mode) || there.st_uid != getuid() ||
      (there.st_mode & 077) != 0)
    throw std::runtime_error(folder.string() + ": is not a folder that only this user can enter");
  return folder;
}

/// One line of JSON. Text that a user typed need not be UTF-8: what is not is replaced.
/// Newlines inside of texts are escaped by JSON, so "\n" ends the message.
std::string line_of(const nlohmann::json& message) {
  return message.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

/// The socket of the one run whose name begins so. Throws ConfigError for none, and for several.
fs::path find_run(const std::string& run) {
  std::vector<std::string> fitting;
  for (const std::string& name : controllable_runs())
    if (name.starts_with(run)) fitting.push_back(name);
  if (fitting.size() == 1) return control_socket_path(fitting[0]);
  if (fitting.empty())
    throw ConfigError(run.empty() ? "no run is going on"
                                  : "no run that is going on begins with '" + run + "'");
  throw ConfigError(
      fmt::format("several runs are going on: {}; say which", fmt::join(fitting, ", ")));
}

/// A line that run `name` has sent. Throws std::runtime_error.
nlohmann::json parsed(const std::string& name, const std::string& line) {
  nlohmann::json message = nlohmann::json::parse(line, nullptr, false);
  if (message.is_discarded())
    throw std::runtime_error(name + ": answers in words that are no JSON");
  return message;
}

}  // namespace

// XDG_RUNTIME_DIR is this user's alone by its specification, and goes with the login. Run folders
// have unique names, so their sockets have.
fs::path control_socket_path(const std::string& run_name) {
  return runtime_folder() / (run_name + ".sock");
}

// Removing sockets without a listener keeps the list true after a kill. The connection that is made
// here sends nothing and ends at once, which a run's server takes for a client that left.
std::vector<std::string> controllable_runs() {
  std::vector<std::string> names;
  asio::io_context io;
  for (const auto& entry : fs::directory_iterator(runtime_folder())) {
    if (entry.path().extension() != ".sock") continue;
    boost::system::error_code failed;
    // Whether there is a listener shows only when connecting.
    Local::socket(io).connect(Local::endpoint(entry.path().string()), failed);
    if (failed) {
      // Left by a host that was killed.
      std::error_code ignored;
      fs::remove(entry.path(), ignored);
    } else {
      names.push_back(entry.path().stem().string());
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

nlohmann::json control_run(const std::string& run, const nlohmann::json& request) {
  const fs::path path = find_run(run);
  const std::string name = path.stem().string();
  // One connection a request.
  Local::iostream stream;
  stream.expires_after(kPatience);
  stream.connect(Local::endpoint(path.string()));
  // Between the listing and this.
  if (!stream) throw ConfigError(name + ": has just ended");
  std::string reply;
  if (!(stream << line_of(request) << std::flush) || !std::getline(stream, reply))
    throw std::runtime_error(name + ": does not answer");
  return parsed(name, reply);
}

struct ControlConnection::State {
  asio::io_context io;
  Local::socket socket{io};
  std::string name, received;
};

ControlConnection::ControlConnection(const std::string& run) : state_(std::make_unique<State>()) {
  const fs::path path = find_run(run);
  state_->name = path.stem().string();
  boost::system::error_code failed;
  state_->socket.connect(Local::endpoint(path.string()), failed);
  if (failed) throw ConfigError(state_->name + ": has just ended");
}

ControlConnection::~ControlConnection() = default;

const std::string& ControlConnection::name() const { return state_->name; }

int ControlConnection::descriptor() const { return state_->socket.native_handle(); }

void ControlConnection::send(const nlohmann::json& request) {
  boost::system::error_code failed;
  asio::write(state_->socket, asio::buffer(line_of(request)), failed);
  if (failed) throw std::runtime_error(state_->name + ": does not take what is sent");
}

// One read, so it blocks only where poll() has not said that there is something.
bool ControlConnection::receive() {
  char bytes[4096];
  boost::system::error_code failed;
  const std::size_t count = state_->socket.read_some(asio::buffer(bytes), failed);
  // By a signal, such as a change of the terminal's size.
  if (failed == asio::error::interrupted) return true;
  state_->received.append(bytes, count);
  return !failed;
}

std::optional<nlohmann::json> ControlConnection::next() {
  std::string& received = state_->received;
  const std::size_t end = received.find('\n');
  // Half a line waits for the rest.
  if (end == std::string::npos) return std::nullopt;
  const nlohmann::json message = parsed(state_->name, received.substr(0, end));
  received.erase(0, end + 1);
  return message;
}

}  // namespace vitreo
