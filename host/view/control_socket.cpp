// SPDX-License-Identifier: Apache-2.0
#include "host/view/control_socket.h"

#include "devices/time/quiet_thread.h"
#include "host/config/config.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <poll.h>
#include <stdexcept>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

namespace vitreo {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kLongestLine = 64 << 10;
constexpr std::size_t kMostClients = 16;
constexpr int kLook = 50;        // ms: how late a change of the status, or the end, is noticed
constexpr int kPatience = 5000;  // ms, for a reply

fs::path runtime_folder() {
  const char* const given = std::getenv("XDG_RUNTIME_DIR");
  const fs::path folder = given && *given
                              ? fs::path(given) / "vitreo"
                              : fs::temp_directory_path() / fmt::format("vitreo-{}", getuid());
  if (mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
    throw std::runtime_error(folder.string() + ": cannot be made: " + std::strerror(errno));
  struct stat there = {};
  if (lstat(folder.c_str(), &there) != 0 || !S_ISDIR(there.st_mode) || there.st_uid != getuid() ||
      (there.st_mode & 077) != 0)
    throw std::runtime_error(folder.string() + ": is not a folder that only this user can enter");
  return folder;
}

sockaddr_un address_of(const fs::path& path) {
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  if (path.string().size() >= sizeof address.sun_path)
    throw std::runtime_error(path.string() + ": is too long a name for a socket");
  std::strcpy(address.sun_path, path.c_str());
  return address;
}

/// The words that a person can choose from; empty where any text may do.
std::vector<std::string> choices_of(const Parameter& answer) {
  return answer.kind == ParameterKind::flag ? std::vector<std::string>{"yes", "no"}
                                            : answer.choices;
}

nlohmann::json alarms_json(const Alarms& alarms) {
  nlohmann::json list = nlohmann::json::array();
  for (const Alarm& alarm : alarms.shown())
    list.push_back({{"name", alarm.name},
                    {"priority", to_string(alarm.priority)},
                    {"text", alarm.text},
                    {"time", to_seconds(alarm.raised)},
                    {"active", alarm.active},
                    {"times", alarm.times},
                    {"acknowledged_by", alarm.acknowledged_by}});
  return list;
}

/// Nobody needs a right to end a run.
bool ends(const std::string& word, const std::string& by, RunControl& control) {
  const StopTier tier = word == "stop"        ? StopTier::stop
                        : word == "abort"     ? StopTier::abort
                        : word == "emergency" ? StopTier::emergency
                                              : StopTier::none;
  if (tier == StopTier::none) return false;
  if (by.empty())
    control.request(tier);
  else
    control.request(tier, "by " + by);
  return true;
}

void acknowledge(const nlohmann::json& request, const std::string& by, const ControlDesk& desk) {
  if (desk.alarms == nullptr) throw std::invalid_argument("this run has no alarms");
  const std::string name = request.value("alarm", "");
  if (desk.alarms->acknowledge(name, by.empty() ? "operator at the control socket" : by) == 0)
    throw std::invalid_argument("no alarm stands");
}

void perform(const nlohmann::json& request, RunControl& control, Questions& questions,
             const ControlDesk& desk) {
  const std::string word = request.at("do"), by = request.value("by", "");
  if (ends(word, by, control)) return;
  if (word == "pause") return control.request_pause(request.value("at", ""));
  if (word == "resume") {
    if (request.value("override", false)) {
      desk.rights.require_researcher(by, "an override");
      control.override_suspension(by.empty() ? "operator at the control socket" : by);
    }
    return control.resume();
  }
  if (word == "answer")
    return questions.answer(request.at("text"), by.empty() ? "operator at the control socket" : by);
  if (word == "ack") return acknowledge(request, by, desk);
  if (word != "status" && word != "watch")
    throw std::invalid_argument("'" + word +
                                "' is not understood: do status, watch, pause, resume, stop, "
                                "abort, emergency, answer or ack");
}

int connect_to(const fs::path& path) {
  const int socket = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_un address = address_of(path);
  if (socket >= 0 &&
      connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0)
    return socket;
  if (socket >= 0) close(socket);
  return -1;
}

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

}  // namespace

fs::path control_socket_path(const std::string& run_name) {
  return runtime_folder() / (run_name + ".sock");
}

std::vector<std::string> controllable_runs() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(runtime_folder())) {
    if (entry.path().extension() != ".sock") continue;
    const int socket = connect_to(entry.path());
    if (socket < 0) {
      std::error_code ignored;  // left by a host that was killed
      fs::remove(entry.path(), ignored);
      continue;
    }
    close(socket);
    names.push_back(entry.path().stem().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

nlohmann::json status_json(const RunControl& control, const Questions& questions,
                           const ControlDesk& desk) {
  const RunStatus status = control.status();
  nlohmann::json json = {{"phase", to_string(status.phase)},
                         {"tier", to_string(status.tier)},
                         {"waiting_for", status.waiting_for},
                         {"note", status.note},
                         {"text", to_string(status)},
                         {"progress", status.progress},
                         {"doing", status.doing}};
  if (status.remaining >= 0) json["remaining"] = status.remaining;
  if (desk.alarms != nullptr) json["alarms"] = alarms_json(*desk.alarms);
  if (const auto question = questions.open())
    json["question"] = {{"number", question->number},
                        {"name", question->answer.name},
                        {"text", shown(*question)},
                        {"choices", choices_of(question->answer)}};
  return json;
}

nlohmann::json answer_request(const std::string& line, RunControl& control, Questions& questions,
                              const ControlDesk& desk) {
  try {
    const nlohmann::json request = nlohmann::json::parse(line);
    if (!request.is_object() || !request.contains("do"))
      throw std::invalid_argument("wants {\"do\": WORD}");
    perform(request, control, questions, desk);
    return {{"ok", true}, {"status", status_json(control, questions, desk)}};
  } catch (const std::exception& error) {
    return {{"ok", false}, {"error", error.what()}};
  }
}

ControlSocket::ControlSocket(const fs::path& path, RunControl& control, Questions& questions,
                             const ControlDesk& desk)
    : path_(path), control_(control), questions_(questions), desk_(desk) {
  const sockaddr_un address = address_of(path);
  std::error_code ignored;
  fs::remove(path, ignored);
  listener_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (listener_ < 0 ||
      bind(listener_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      listen(listener_, 4) != 0) {
    const std::string why = std::strerror(errno);
    if (listener_ >= 0) close(listener_);
    throw std::runtime_error(path.string() + ": cannot listen: " + why);
  }
  thread_ = quiet_thread([this] { serve(); });
}

ControlSocket::~ControlSocket() {
  done_ = true;
  thread_.join();
  for (const Client& client : clients_) close(client.socket);
  close(listener_);
  std::error_code ignored;
  fs::remove(path_, ignored);
}

void ControlSocket::serve() {
  while (!done_) {
    std::vector<pollfd> watched{{listener_, POLLIN, 0}};
    for (const Client& client : clients_) watched.push_back({client.socket, POLLIN, 0});
    if (poll(watched.data(), watched.size(), kLook) > 0) {
      for (std::size_t i = clients_.size(); i-- > 0;) {
        if (watched[i + 1].revents == 0 || take(clients_[i])) continue;
        close(clients_[i].socket);
        clients_.erase(clients_.begin() + static_cast<std::ptrdiff_t>(i));
      }
      if (watched[0].revents != 0) accept_client();
    }
    tell_watchers();
  }
}

void ControlSocket::accept_client() {
  const int socket = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (socket < 0) return;
  if (clients_.size() >= kMostClients) {
    close(socket);
    return;
  }
  clients_.push_back({socket, {}, false});
}

/// False: the client is gone, or is to be dropped.
bool ControlSocket::take(Client& client) {
  char bytes[4096];
  const ssize_t count = recv(client.socket, bytes, sizeof bytes, 0);
  if (count < 0 && (errno == EAGAIN || errno == EINTR)) return true;
  if (count <= 0) return false;
  client.received.append(bytes, static_cast<std::size_t>(count));
  for (std::size_t end; (end = client.received.find('\n')) != std::string::npos;) {
    const std::string line = client.received.substr(0, end);
    client.received.erase(0, end + 1);
    const nlohmann::json reply = answer_request(line, control_, questions_, desk_);
    if (reply["ok"] && nlohmann::json::parse(line)["do"] == "watch") client.watches = true;
    if (!send(client, reply)) return false;
  }
  return client.received.size() <= kLongestLine;
}

bool ControlSocket::send(const Client& client, const nlohmann::json& message) {
  // What a client sent us comes back in errors: it need not be UTF-8.
  const std::string line =
      message.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  const ssize_t sent = ::send(client.socket, line.data(), line.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  return sent == static_cast<ssize_t>(line.size());
}

void ControlSocket::tell_watchers() {
  const unsigned long changes =
      control_.changes() + (desk_.alarms != nullptr ? desk_.alarms->changes() : 0);
  if (changes == told_) return;
  told_ = changes;
  std::erase_if(clients_, [&](const Client& client) {
    if (!client.watches ||
        send(client, {{"ok", true}, {"status", status_json(control_, questions_, desk_)}}))
      return false;
    close(client.socket);
    return true;
  });
}

nlohmann::json control_run(const std::string& run, const nlohmann::json& request) {
  const fs::path path = find_run(run);
  const int socket = connect_to(path);
  if (socket < 0) throw ConfigError(path.stem().string() + ": has just ended");
  const std::string line =
      request.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  std::string reply;
  bool whole =
      ::send(socket, line.data(), line.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(line.size());
  while (whole && !reply.ends_with('\n')) {
    pollfd watched{socket, POLLIN, 0};
    char bytes[4096];
    const ssize_t count =
        poll(&watched, 1, kPatience) > 0 ? recv(socket, bytes, sizeof bytes, 0) : 0;
    whole = count > 0;
    if (whole) reply.append(bytes, static_cast<std::size_t>(count));
  }
  close(socket);
  if (!whole) throw std::runtime_error(path.stem().string() + ": does not answer");
  return nlohmann::json::parse(reply);
}

ControlConnection::ControlConnection(const std::string& run) {
  const fs::path path = find_run(run);
  name_ = path.stem().string();
  socket_ = connect_to(path);
  if (socket_ < 0) throw ConfigError(name_ + ": has just ended");
}

ControlConnection::~ControlConnection() { close(socket_); }

void ControlConnection::send(const nlohmann::json& request) {
  const std::string line =
      request.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  if (::send(socket_, line.data(), line.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(line.size()))
    throw std::runtime_error(name_ + ": does not take what is sent");
}

bool ControlConnection::receive() {
  char bytes[4096];
  const ssize_t count = recv(socket_, bytes, sizeof bytes, 0);
  if (count < 0 && errno == EINTR) return true;
  if (count <= 0) return false;
  received_.append(bytes, static_cast<std::size_t>(count));
  return true;
}

std::optional<nlohmann::json> ControlConnection::next() {
  const std::size_t end = received_.find('\n');
  if (end == std::string::npos) return std::nullopt;
  const nlohmann::json message = nlohmann::json::parse(received_.substr(0, end));
  received_.erase(0, end + 1);
  return message;
}

}  // namespace vitreo
