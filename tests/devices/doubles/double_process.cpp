// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/doubles/double_process.h"

#include "devices/time/error.h"

#include <array>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fcntl.h>
#include <filesystem>
#include <optional>
#include <poll.h>
#include <spawn.h>
#include <stdexcept>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

extern char** environ;

namespace vitreo {
namespace {

constexpr int kStartMs = 20000;  // of a Python on a busy machine

std::string server() {
  return (std::filesystem::path(__FILE__).parent_path() / "../../doubles/serve.py").string();
}

std::vector<std::string> words_of(const std::string& instrument,
                                  const std::vector<std::string>& options) {
  std::vector<std::string> words{"python3", "-B", server(), instrument};
  for (const std::string& option : options) {
    words.emplace_back("--option");
    words.push_back(option);
  }
  return words;
}

std::vector<std::string> on_line(std::vector<std::string> words, int baud) {
  words.emplace_back("--pty");
  if (baud != 0) {
    words.emplace_back("--baud");
    words.push_back(std::to_string(baud));
  }
  return words;
}

}  // namespace

DoubleProcess::DoubleProcess(const std::string& instrument, const std::vector<std::string>& options,
                             int baud)
    : DoubleProcess(on_line(words_of(instrument, options), baud), "serial:") {}

DoubleProcess DoubleProcess::on_socket(const std::string& instrument,
                                       const std::vector<std::string>& options) {
  std::string folder = (std::filesystem::temp_directory_path() / "vitreo_double_XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) throw std::runtime_error("no folder for the socket");
  std::vector<std::string> words = words_of(instrument, options);
  words.emplace_back("--socket");
  words.push_back(folder + "/s");
  return DoubleProcess(words, "");
}

DoubleProcess::DoubleProcess(const std::vector<std::string>& words, const std::string& prefix) {
  std::array<int, 2> in{}, out{};
  if (::pipe2(in.data(), O_CLOEXEC) != 0 || ::pipe2(out.data(), O_CLOEXEC) != 0)
    throw std::runtime_error("no pipe");
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, in[0], 0);
  posix_spawn_file_actions_adddup2(&actions, out[1], 1);
  std::vector<char*> arguments;
  for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const int error =
      ::posix_spawnp(&process_, arguments[0], &actions, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  ::close(in[0]);
  ::close(out[1]);
  orders_ = in[1];
  answers_ = out[0];
  if (error != 0) throw std::runtime_error(std::string("python3: ") + std::strerror(error));
  address_ = prefix + line();
}

DoubleProcess::DoubleProcess(DoubleProcess&& other) noexcept
    : process_(std::exchange(other.process_, -1)),
      orders_(std::exchange(other.orders_, -1)),
      answers_(std::exchange(other.answers_, -1)),
      read_(std::move(other.read_)),
      address_(std::move(other.address_)) {}

DoubleProcess::~DoubleProcess() {
  if (process_ < 0) return;
  ::close(orders_);
  ::close(answers_);
  ::kill(process_, SIGTERM);
  ::waitpid(process_, nullptr, 0);
}

std::string DoubleProcess::line() {
  for (;;) {
    if (const std::size_t end = read_.find('\n'); end != std::string::npos) {
      std::string found = read_.substr(0, end);
      read_.erase(0, end + 1);
      return found;
    }
    pollfd ready{answers_, POLLIN, 0};
    if (::poll(&ready, 1, kStartMs) <= 0) throw std::runtime_error("the double says nothing");
    std::array<char, 4096> bytes{};
    const ssize_t size = ::read(answers_, bytes.data(), bytes.size());
    if (size <= 0) throw std::runtime_error("the double has ended");
    read_.append(bytes.data(), static_cast<std::size_t>(size));
  }
}

std::string DoubleProcess::order(const std::string& json) {
  const std::string sent = json + "\n";
  if (::write(orders_, sent.data(), sent.size()) != static_cast<ssize_t>(sent.size()))
    throw std::runtime_error("the double takes no order");
  std::string answer = line();
  if (answer.find("\"error\"") != std::string::npos) throw std::runtime_error(answer);
  return answer;
}

double DoubleProcess::number(const std::string& name) {
  const std::string answer = order("{\"get\": \"" + name + "\"}");
  return std::strtod(answer.c_str() + answer.find(':') + 1, nullptr);
}

namespace {

/// Frames as tests/doubles/README.md has them. Time is the wall clock's.
class DoubleHid final : public HidLink {
 public:
  DoubleHid(const std::string& path, Clock& clock) : clock_(clock) {
    sockaddr_un where{};
    where.sun_family = AF_UNIX;
    path.copy(where.sun_path, sizeof where.sun_path - 1);
    socket_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&where), sizeof where) != 0)
      throw DeviceError(DeviceErrorKind::not_found, path, std::strerror(errno));
  }
  ~DoubleHid() override { ::close(socket_); }
  DoubleHid(const DoubleHid&) = delete;
  DoubleHid& operator=(const DoubleHid&) = delete;

  void write(std::span<const std::uint8_t> report) override {
    clock_.outside([&] {
      send('O', report);
      while (answers_.empty() && receive(5000)) {
      }
    });
    if (answers_.empty())
      throw DeviceError(DeviceErrorKind::lost, "double", "no answer to a report");
    const std::int32_t result = answers_.front();
    answers_.pop_front();
    if (result < 0)
      throw DeviceError(DeviceErrorKind::lost, "double",
                        std::string("a report cannot be sent: ") + std::strerror(-result));
  }

  std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
    const auto deadline = std::chrono::steady_clock::now() + timeout;
    clock_.outside([&] {
      do {
        const auto left = std::chrono::ceil<std::chrono::milliseconds>(
            deadline - std::chrono::steady_clock::now());
        if (!reports_.empty()) break;
        receive(static_cast<int>(std::max<std::int64_t>(0, left.count())));
      } while (reports_.empty() && std::chrono::steady_clock::now() < deadline);
    });
    if (reports_.empty()) return std::nullopt;
    std::vector<std::uint8_t> first = std::move(reports_.front());
    reports_.pop_front();
    return first;
  }

 private:
  void send(char kind, std::span<const std::uint8_t> payload) {
    std::vector<std::uint8_t> frame(5);
    const auto size = static_cast<std::uint32_t>(payload.size() + 1);
    std::memcpy(frame.data(), &size, 4);
    frame[4] = static_cast<std::uint8_t>(kind);
    frame.insert(frame.end(), payload.begin(), payload.end());
    if (::send(socket_, frame.data(), frame.size(), MSG_NOSIGNAL) !=
        static_cast<ssize_t>(frame.size()))
      throw DeviceError(DeviceErrorKind::lost, "double", "is unplugged");
  }
  /// One frame, if it begins within the time.
  bool receive(int milliseconds) {
    pollfd ready{socket_, POLLIN, 0};
    if (::poll(&ready, 1, milliseconds) <= 0) return false;
    std::uint32_t size = 0;
    take(&size, 4);
    std::vector<std::uint8_t> frame(size);
    take(frame.data(), size);
    if (frame.at(0) == 'A') {
      std::int32_t result = 0;
      std::memcpy(&result, frame.data() + 1, 4);
      answers_.push_back(result);
    } else if (frame[0] == 'I') {
      reports_.emplace_back(frame.begin() + 1, frame.end());
    }
    return true;
  }
  void take(void* into, std::size_t size) {
    if (::recv(socket_, into, size, MSG_WAITALL) != static_cast<ssize_t>(size))
      throw DeviceError(DeviceErrorKind::lost, "double", "is unplugged");
  }

  Clock& clock_;
  int socket_ = -1;
  std::deque<std::int32_t> answers_;
  std::deque<std::vector<std::uint8_t>> reports_;
};

}  // namespace

std::unique_ptr<HidLink> open_double_hid(const std::string& socket, Clock& clock) {
  return std::make_unique<DoubleHid>(socket, clock);
}

}  // namespace vitreo
