// SPDX-License-Identifier: Apache-2.0
#include "host/view/technician.h"

#include "devices/time/quiet_thread.h"
#include "host/view/control_client.h"

#include <atomic>
#include <chrono>
#include <fstream>
#include <iostream>
#include <map>
#include <poll.h>
#include <string>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

namespace vitreo {
namespace {

constexpr auto kListen = std::chrono::milliseconds(50);
/// Listens between two looks for new runs, which ask every run on the machine who it is.
constexpr int kListensALook = 10;

/// The parent of a process; 0 when it is gone. In /proc/PID/stat it is the second word after the
/// name, which stands in parentheses and may hold anything.
pid_t parent_of(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/stat");
  std::string text;
  std::getline(file, text);
  const std::size_t name = text.rfind(')');
  if (name == std::string::npos || name + 4 >= text.size()) return 0;
  return static_cast<pid_t>(std::strtol(text.c_str() + name + 4, nullptr, 10));
}

bool is_ours(pid_t process) {
  for (; process > 1; process = parent_of(process))
    if (process == getpid()) return true;
  return false;
}

/// The process at the other end of a Unix socket.
pid_t peer_of(int descriptor) {
  ucred credentials{};
  socklen_t size = sizeof credentials;
  if (getsockopt(descriptor, SOL_SOCKET, SO_PEERCRED, &credentials, &size) != 0) return 0;
  return credentials.pid;
}

/// One run that is followed.
struct Followed {
  explicit Followed(const std::string& run) : connection(run) {
    connection.send({{"do", "watch"}});
  }
  ControlConnection connection;
  int answered = 0;  // the number of the last question
};

}  // namespace

struct Technician::State {
  explicit State(Hands the_hands)
      : hands(std::move(the_hands)), thread(quiet_thread([this] { work(); })) {}
  ~State() {
    ended = true;
    thread.join();
  }

  void work() {
    for (int listened = 0; !ended; ++listened) {
      if (listened % kListensALook == 0) find_runs();
      std::erase_if(runs, [this](auto& entry) { return !follow(*entry.second); });
      std::this_thread::sleep_for(kListen);
    }
  }

  void find_runs() {
    for (const std::string& name : controllable_runs()) {
      if (runs.contains(name) || foreign.contains(name)) continue;
      try {
        auto run = std::make_unique<Followed>(name);
        if (is_ours(peer_of(run->connection.descriptor())))
          runs.emplace(name, std::move(run));
        else
          foreign.emplace(name, true);
      } catch (const std::exception&) {  // it has just ended
      }
    }
  }

  /// False when the run is gone.
  bool follow(Followed& run) {
    try {
      pollfd ready{run.connection.descriptor(), POLLIN, 0};
      while (poll(&ready, 1, 0) > 0)
        if (!run.connection.receive()) return false;
      while (const auto message = run.connection.next())
        if (message->contains("status")) look(run, message->at("status"));
      return true;
    } catch (const std::exception&) {
      return false;
    }
  }

  void look(Followed& run, const nlohmann::json& status) {
    const auto question = status.find("question");
    if (question == status.end() || question->at("task").is_null()) return;
    const int number = question->at("number");
    if (number == run.answered) return;
    run.answered = number;
    std::string answer = "yes";
    try {
      hands(question->at("task"));
    } catch (const std::exception& error) {
      std::cerr << "vitreo: the emulated technician cannot: " << error.what() << std::endl;
      answer = "no";
    }
    run.connection.send({{"do", "answer"}, {"text", answer}, {"by", "the emulated technician"}});
  }

  const Hands hands;
  std::map<std::string, std::unique_ptr<Followed>> runs;
  std::map<std::string, bool> foreign;
  std::atomic<bool> ended{false};
  std::thread thread;  // last: it uses the others
};

Technician::Technician(Hands hands) : state_(std::make_unique<State>(std::move(hands))) {}
Technician::~Technician() = default;

}  // namespace vitreo
