// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/doubles/double_process.h"

#include "devices/time/error.h"

#include <algorithm>
#include <array>
#include <cerrno>
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
#include <system_error>
#include <unistd.h>
#include <utility>

extern char** environ;

namespace vitreo {
namespace {

constexpr int kStartMs = 20000;  // of a Python on a busy machine

std::string server(const std::string& script = "serve.py") {
  return (std::filesystem::path(__FILE__).parent_path() / "../../doubles" / script).string();
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
  DoubleProcess made(words, "");
  made.folder_ = folder;
  return made;
}

DoubleProcess DoubleProcess::of_server(const std::string& script,
                                       const std::vector<std::string>& words) {
  std::vector<std::string> all{"python3", "-B", server(script)};
  all.insert(all.end(), words.begin(), words.end());
  return DoubleProcess(all, "");
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
      address_(std::move(other.address_)),
      folder_(std::exchange(other.folder_, {})) {}

DoubleProcess::~DoubleProcess() {
  if (process_ < 0) return;
  ::close(orders_);
  ::close(answers_);
  ::kill(process_, SIGTERM);
  ::waitpid(process_, nullptr, 0);
  std::error_code ignored;
  if (!folder_.empty()) std::filesystem::remove_all(folder_, ignored);
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

struct Answer {
  std::int32_t result = 0;
  std::vector<std::uint8_t> data;
};

/// Frames as tests/doubles/README.md has them. Time is the wall clock's.
class Frames {
 public:
  explicit Frames(const std::string& path) {
    sockaddr_un where{};
    where.sun_family = AF_UNIX;
    path.copy(where.sun_path, sizeof where.sun_path - 1);
    socket_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&where), sizeof where) != 0)
      throw DeviceError(DeviceErrorKind::not_found, path, std::strerror(errno));
  }
  ~Frames() { ::close(socket_); }
  Frames(const Frames&) = delete;
  Frames& operator=(const Frames&) = delete;

  Answer ask(char kind, std::span<const std::uint8_t> payload) {
    std::vector<std::uint8_t> frame(5);
    const auto size = static_cast<std::uint32_t>(payload.size() + 1);
    std::memcpy(frame.data(), &size, 4);
    frame[4] = static_cast<std::uint8_t>(kind);
    frame.insert(frame.end(), payload.begin(), payload.end());
    if (::send(socket_, frame.data(), frame.size(), MSG_NOSIGNAL) !=
        static_cast<ssize_t>(frame.size()))
      throw DeviceError(DeviceErrorKind::lost, "double", "is unplugged");
    while (answers_.empty())
      if (!receive(5000)) throw DeviceError(DeviceErrorKind::lost, "double", "does not answer");
    Answer first = std::move(answers_.front());
    answers_.pop_front();
    return first;
  }
  std::optional<std::vector<std::uint8_t>> report(int milliseconds) {
    const auto deadline =
        std::chrono::steady_clock::now() + std::chrono::milliseconds(milliseconds);
    while (reports_.empty()) {
      const auto left =
          std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
      if (!receive(static_cast<int>(std::max<std::int64_t>(0, left.count()))) && left.count() <= 0)
        return std::nullopt;
    }
    std::vector<std::uint8_t> first = std::move(reports_.front());
    reports_.pop_front();
    return first;
  }

 private:
  /// One frame, if it begins within the time.
  bool receive(int milliseconds) {
    pollfd ready{socket_, POLLIN, 0};
    if (::poll(&ready, 1, milliseconds) <= 0) return false;
    std::uint32_t size = 0;
    take(&size, 4);
    std::vector<std::uint8_t> frame(size);
    take(frame.data(), size);
    if (frame.at(0) == 'A') {
      Answer answer;
      std::memcpy(&answer.result, frame.data() + 1, 4);
      answer.data.assign(frame.begin() + 5, frame.end());
      answers_.push_back(std::move(answer));
    } else if (frame[0] == 'I') {
      reports_.emplace_back(frame.begin() + 1, frame.end());
    }
    return true;
  }
  void take(void* into, std::size_t size) {
    if (::recv(socket_, into, size, MSG_WAITALL) != static_cast<ssize_t>(size))
      throw DeviceError(DeviceErrorKind::lost, "double", "is unplugged");
  }

  int socket_ = -1;
  std::deque<Answer> answers_;
  std::deque<std::vector<std::uint8_t>> reports_;
};

class DoubleHid final : public HidLink {
 public:
  DoubleHid(const std::string& path, Clock& clock) : frames_(path), clock_(clock) {}
  void write(std::span<const std::uint8_t> report) override {
    clock_.outside([&] {
      if (const std::int32_t result = frames_.ask('O', report).result; result < 0)
        throw DeviceError(DeviceErrorKind::lost, "double",
                          std::string("a report cannot be sent: ") + std::strerror(-result));
    });
  }
  std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
    std::optional<std::vector<std::uint8_t>> report;
    const auto wait = std::chrono::ceil<std::chrono::milliseconds>(timeout).count();
    clock_.outside([&] {
      report = frames_.report(static_cast<int>(std::clamp<std::int64_t>(wait, 0, 3600000)));
    });
    return report;
  }

 private:
  Frames frames_;
  Clock& clock_;
};

class DoublePeer final : public HidPeer {
 public:
  DoublePeer(const std::string& path, std::vector<std::uint8_t> questions)
      : frames_(path), questions_(std::move(questions)) {}
  std::vector<std::vector<std::uint8_t>> receive(std::span<const std::uint8_t> report) override {
    std::vector<std::vector<std::uint8_t>> answers;
    frames_.ask('O', report);
    const bool asks = !report.empty() && std::find(questions_.begin(), questions_.end(),
                                                   report.front()) != questions_.end();
    if (asks)
      if (auto answer = frames_.report(kAnswerMs)) answers.push_back(std::move(*answer));
    return answers;
  }

 private:
  static constexpr int kAnswerMs = 50;
  Frames frames_;
  const std::vector<std::uint8_t> questions_;
};

class DoubleUsb final : public UsbLink {
 public:
  DoubleUsb(const std::string& path, Clock& clock) : frames_(path), clock_(clock) {}
  const UsbIdentity& identity() const override { return identity_; }
  void write(const UsbSetup& setup, std::span<const std::uint8_t> data, Time) override {
    transfer(setup, static_cast<std::uint16_t>(data.size()), data);
  }
  std::vector<std::uint8_t> read(const UsbSetup& setup, std::uint16_t length, Time) override {
    return transfer(setup, length, {});
  }

 private:
  std::vector<std::uint8_t> transfer(const UsbSetup& setup, std::uint16_t length,
                                     std::span<const std::uint8_t> data) {
    std::vector<std::uint8_t> payload{setup.type, setup.request};
    for (const std::uint16_t word : {setup.value, setup.index, length}) {
      payload.push_back(static_cast<std::uint8_t>(word & 0xFF));
      payload.push_back(static_cast<std::uint8_t>(word >> 8));
    }
    payload.insert(payload.end(), data.begin(), data.end());
    Answer answer;
    clock_.outside([&] { answer = frames_.ask('C', payload); });
    if (answer.result < 0)
      throw DeviceError(answer.result == -EPIPE       ? DeviceErrorKind::refused
                        : answer.result == -ETIMEDOUT ? DeviceErrorKind::timeout
                                                      : DeviceErrorKind::lost,
                        "double", std::strerror(-answer.result));
    return std::move(answer.data);
  }

  Frames frames_;
  Clock& clock_;
  UsbIdentity identity_{0x1FFB, 0x00B3, 0x0109, "00123456", "Pololu", "Tic T825", ""};
};

DeviceError usb_double_error(std::int32_t result) {
  return {result == -EPIPE       ? DeviceErrorKind::refused
          : result == -ETIMEDOUT ? DeviceErrorKind::timeout
                                 : DeviceErrorKind::lost,
          "double", std::strerror(-result)};
}

/// USBTMC: the numbers of the endpoints are the double's (usbtmc.py). A transfer ends with a packet
/// of less than 64 bytes, and the double gives it up to what is wanted.
class DoubleUsbtmc final : public UsbtmcPipe {
 public:
  DoubleUsbtmc(const std::string& path, Clock& clock) : frames_(path), clock_(clock) {}
  const std::string& address() const override { return address_; }
  std::uint8_t interface_number() const override { return 0; }
  std::uint8_t out_endpoint() const override { return 0x02; }
  std::uint8_t in_endpoint() const override { return 0x81; }
  void out(std::span<const std::uint8_t> transfer, Time) override {
    std::vector<std::uint8_t> payload{out_endpoint()};
    payload.insert(payload.end(), transfer.begin(), transfer.end());
    ask('B', payload);
  }
  In in(std::size_t most, Time timeout) override {
    std::vector<std::uint8_t> payload{in_endpoint()};
    const auto patience = std::chrono::ceil<std::chrono::milliseconds>(timeout).count();
    for (const std::size_t word : {most, static_cast<std::size_t>(patience)})
      for (const int shift : {0, 8, 16, 24})
        payload.push_back(static_cast<std::uint8_t>(word >> shift & 0xFF));
    const Answer answer = frames_ask('R', payload);
    if (answer.result == -ETIMEDOUT) return {};
    if (answer.result < 0) throw usb_double_error(answer.result);
    return {answer.data, true};
  }
  ByteString control(const UsbSetup& setup, std::uint16_t length, Time) override {
    std::vector<std::uint8_t> payload{setup.type, setup.request};
    for (const std::uint16_t word : {setup.value, setup.index, length}) {
      payload.push_back(static_cast<std::uint8_t>(word & 0xFF));
      payload.push_back(static_cast<std::uint8_t>(word >> 8));
    }
    return ask('C', payload);
  }
  void clear_halt(std::uint8_t endpoint) override { control({0x02, 1, 0, endpoint}, 0, {}); }
  void reopen() override {}

 private:
  Answer frames_ask(char kind, const std::vector<std::uint8_t>& payload) {
    Answer answer;
    clock_.outside([&] { answer = frames_.ask(kind, payload); });
    return answer;
  }
  std::vector<std::uint8_t> ask(char kind, const std::vector<std::uint8_t>& payload) {
    Answer answer = frames_ask(kind, payload);
    if (answer.result < 0) throw usb_double_error(answer.result);
    return std::move(answer.data);
  }

  const std::string address_ = "usbtmc:1bfa:0498";
  Frames frames_;
  Clock& clock_;
};

}  // namespace

std::unique_ptr<UsbtmcPipe> open_double_usbtmc(const std::string& socket, Clock& clock) {
  return std::make_unique<DoubleUsbtmc>(socket, clock);
}
std::unique_ptr<HidLink> open_double_hid(const std::string& socket, Clock& clock) {
  return std::make_unique<DoubleHid>(socket, clock);
}
std::unique_ptr<HidPeer> double_hid_peer(const std::string& socket,
                                         const std::vector<std::uint8_t>& questions) {
  return std::make_unique<DoublePeer>(socket, questions);
}
std::unique_ptr<UsbLink> open_double_usb(const std::string& socket, Clock& clock) {
  return std::make_unique<DoubleUsb>(socket, clock);
}

}  // namespace vitreo
