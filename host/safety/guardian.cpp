// SPDX-License-Identifier: Apache-2.0
#include "host/safety/guardian.h"

#include "devices/time/error.h"
#include "devices/time/quiet_thread.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <poll.h>
#include <sched.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

extern char** environ;

namespace vitreo {
namespace {

using namespace std::chrono_literals;
using guardian::kBeat;

constexpr int kPatience = 5;  // s, until it is ready
constexpr auto kLeave = 2s;   // until it has left, when it is sent away
// SCHED_RR priority of the thread of heartbeats: below the guardian's own 5.
constexpr int kUrgent = 4;

[[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) {
  throw DeviceError(kind, "guardian", what);
}

/// Beside the program, or beside the folder of the tests.
std::string program() {
  std::error_code none;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", none);
  for (const auto& folder : {self.parent_path(), self.parent_path().parent_path()})
    if (std::filesystem::exists(folder / "vitreo_guardian", none))
      return (folder / "vitreo_guardian").string();
  fail(DeviceErrorKind::not_found, "the program vitreo_guardian is not beside " + self.string());
}

/// Whether systemd is there to be asked for a scope: the system's for root, else the user's own
/// (sd_booted(3); the user's manager has its folder in the user's runtime directory).
bool makes_scopes() {
  std::error_code none;
  if (!std::filesystem::is_directory("/run/systemd/system", none)) return false;
  if (::geteuid() == 0) return true;
  const char* const runtime = std::getenv("XDG_RUNTIME_DIR");
  return runtime != nullptr &&
         std::filesystem::exists(std::filesystem::path(runtime) / "systemd/private", none);
}

// Armed before the first current is sent and disarmed after the zero was taken: an error in between
// leaves the guardian armed.
// The decorator that the interlock sends to: limits are judged before, so that only what really
// goes to the outputs arms the guardian.
class GuardedCoils final : public CoilAmplifier {
 public:
  GuardedCoils(CoilAmplifier& amplifier, Guardian& guardian)
      : amplifier_(amplifier), guardian_(guardian) {}
  std::string identity() const override { return amplifier_.identity(); }
  int channels() const override { return amplifier_.channels(); }
  double current_limit() const override { return amplifier_.current_limit(); }
  std::vector<double> currents() const override { return amplifier_.currents(); }
  void set_currents(std::span<const double> currents) override {
    const bool zero =
        std::all_of(currents.begin(), currents.end(), [](double current) { return current == 0; });
    // arm() throws where there is no guardian any more: then nothing is energized.
    if (!zero) guardian_.arm("coils");
    amplifier_.set_currents(currents);
    if (zero) guardian_.disarm("coils");
  }
  std::optional<std::vector<double>> measured_currents() override {
    return amplifier_.measured_currents();
  }
  LinkState link_state() const override { return amplifier_.link_state(); }
  void make_safe() override {
    amplifier_.make_safe();
    guardian_.disarm("coils");
  }
  EnableLine* enable_line() override { return amplifier_.enable_line(); }

 private:
  CoilAmplifier& amplifier_;
  Guardian& guardian_;
};

class GuardedLamp final : public Lamp {
 public:
  GuardedLamp(Lamp& lamp, Guardian& guardian) : lamp_(lamp), guardian_(guardian) {}
  std::string identity() const override { return lamp_.identity(); }
  double level() const override { return lamp_.level(); }
  void ask() override { lamp_.ask(); }
  LinkState link_state() const override { return lamp_.link_state(); }
  EnableLine* enable_line() override { return lamp_.enable_line(); }
  void set_level(double level) override {
    if (level != 0) guardian_.arm("lamp");
    lamp_.set_level(level);
    if (level == 0) guardian_.disarm("lamp");
  }
  void make_safe() override {
    lamp_.make_safe();
    guardian_.disarm("lamp");
  }

 private:
  Lamp& lamp_;
  Guardian& guardian_;
};

class GuardedInstrument final : public Instrument {
 public:
  GuardedInstrument(Instrument& instrument, Guardian& guardian, std::string role)
      : instrument_(instrument), guardian_(guardian), role_(std::move(role)) {}
  const InstrumentInfo& info() const override { return instrument_.info(); }
  QuantitySample read(std::size_t index, Time timeout) override {
    return instrument_.read(index, timeout);
  }
  void set(std::size_t index, const QuantityValue& value) override {
    guardian_.arm(role_);
    instrument_.set(index, value);
  }
  void command(std::size_t index, const std::vector<QuantityValue>& arguments) override {
    guardian_.arm(role_);
    instrument_.command(index, arguments);
  }
  Latest latest(std::size_t index) const override { return instrument_.latest(index); }
  void on_poll(PollListener listener) override { instrument_.on_poll(std::move(listener)); }
  void make_safe() override {
    instrument_.make_safe();
    guardian_.disarm(role_);
  }

 private:
  Instrument& instrument_;
  Guardian& guardian_;
  const std::string role_;
};

}  // namespace

// In a systemd scope of its own where there is a systemd that makes one, else as a plain child,
// which moves to a control group of its own where it may (guardian/own_group.h).
Guardian::Guardian(const std::vector<guardian::Output>& outputs, std::function<bool()> healthy)
    : healthy_(std::move(healthy)) {
  if (!(makes_scopes() && begin(outputs, true))) begin(outputs, false);
  // Last: the thread uses the socket, and a constructor that throws runs no destructor to join it.
  // All signals are blocked in it (quiet_thread).
  thread_ = quiet_thread([this] { beat(); });
}

// SEQPACKET keeps messages apart and in order, and its end is seen by both sides. CLOEXEC on both
// ends: a program that the host starts later must not hold the socket open after the host's death.
/// False where it did not come up in a scope, which is no error.
bool Guardian::begin(const std::vector<guardian::Output>& outputs, bool in_scope) {
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0)
    fail(DeviceErrorKind::refused, std::string("no socket for it: ") + std::strerror(errno));
  socket_ = ends[0];
  try {
    if (!start(ends[1], in_scope)) return give_up(), false;
    const std::string said = hand_over(outputs);
    shares_group_ = said == std::string(1, guardian::kReadyShared);
    if (shares_group_ || said == std::string(1, guardian::kReady)) return true;
    if (!said.empty() || !in_scope)
      fail(DeviceErrorKind::refused, said.empty() ? "it did not get ready" : said);
  } catch (...) {
    give_up();
    throw;
  }
  give_up();
  return false;
}

/// It leaves by itself when the socket is closed; what would become it, and hangs, does not.
void Guardian::give_up() {
  ::close(std::exchange(socket_, -1));
  if (process_ <= 0) return;
  ::kill(process_, SIGTERM);  // which the guardian ignores
  ::waitpid(std::exchange(process_, -1), nullptr, 0);
}

/// In a session of its own, so that no terminal's signal reaches it, and with no descriptor of ours
/// but its socket. systemd-run makes the scope, puts itself into it and becomes the guardian, whose
/// parent is this process in either case. False where systemd-run is not to be had.
bool Guardian::start(int end, bool in_scope) {
  const std::string file = program();
  std::vector<std::string> words{file, std::to_string(::getpid())};
  if (in_scope) {
    std::vector<std::string> before{"systemd-run", "--scope", "--quiet", "--collect"};
    if (::geteuid() != 0) before.emplace_back("--user");
    words.insert(words.begin(), before.begin(), before.end());
  }
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  // A duplicate is not closed on exec, so the child has its end at the agreed number.
  posix_spawn_file_actions_adddup2(&actions, end, guardian::kSocket);
  posix_spawn_file_actions_addclosefrom_np(&actions, guardian::kSocket + 1);
  posix_spawnattr_t how;
  posix_spawnattr_init(&how);
  sigset_t none;
  sigemptyset(&none);
  // The creating thread may have signals blocked, and a mask is inherited.
  posix_spawnattr_setsigmask(&how, &none);
  posix_spawnattr_setflags(&how, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGMASK);
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const int error =
      ::posix_spawnp(&process_, arguments[0], &actions, &how, arguments.data(), environ);
  posix_spawnattr_destroy(&how);
  posix_spawn_file_actions_destroy(&actions);
  ::close(end);
  if (error == 0) return true;
  process_ = -1;
  if (in_scope) return false;
  fail(DeviceErrorKind::not_found, file + " cannot be started: " + std::strerror(error));
}

// The guardian answers when it has understood every output, or with what it cannot bring to zero.
// 'O' and the outputs in one packet (guardian/wire.h). The answer is kReady, or a text that says
// what cannot be guarded, or nothing within kPatience.
std::string Guardian::hand_over(const std::vector<guardian::Output>& outputs) {
  const std::string asked = "O" + guardian::encode(outputs);
  const timeval patience{kPatience, 0};
  ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  std::string said(guardian::kLongest, '\0');
  ssize_t size = ::send(socket_, asked.data(), asked.size(), MSG_NOSIGNAL);
  if (size >= 0) size = ::recv(socket_, said.data(), said.size(), 0);
  said.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
  return said;
}

// Armed means that the last zero was not taken by the amplifier: the guardian is told to bring it
// about itself, since this process gives up its devices now. It then has work to do, and outlives
// us; where it was stopped, it is asked to go on.
Guardian::~Guardian() {
  done_ = true;
  thread_.join();
  const bool unsure = !armed_.empty();
  const bool silent = lost();
  say(unsure ? guardian::kQuitUnsure : guardian::kQuit);
  if (unsure)
    ::kill(process_, SIGCONT);
  else
    await_end(!silent);
  ::close(socket_);
}

/// Everything is at zero, so that nothing is lost with one that does not leave.
void Guardian::await_end(bool patiently) const {
  const auto until = std::chrono::steady_clock::now() + (patiently ? kLeave : 0ms);
  do {
    if (::waitpid(process_, nullptr, WNOHANG) != 0) return;
    std::this_thread::sleep_for(1ms);
  } while (std::chrono::steady_clock::now() < until);
  ::kill(process_, SIGKILL);
  ::waitpid(process_, nullptr, 0);
}

/// Whether it was taken. The kernel keeps some hundred packets for one that does not take them.
bool Guardian::say(char message) {
  if (::send(socket_, &message, 1, MSG_NOSIGNAL | MSG_DONTWAIT) == 1) return ++owed_, true;
  if (errno == EAGAIN)
    unanswered_ = guardian::kUnanswered;
  else
    gone_ = true;
  return false;
}

/// Takes what has come. Where something was owed and nothing came, the turn is one without an
/// answer.
void Guardian::listen() {
  const bool owed = owed_ > 0;
  bool heard = false;
  for (char message = 0;;) {
    const ssize_t size = ::recv(socket_, &message, 1, MSG_DONTWAIT);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) break;
    if (size <= 0) gone_ = true;  // its end is closed
    if (size <= 0) break;
    heard = true;
    if (owed_ > 0) --owed_;
  }
  unanswered_ = owed && !heard ? std::min(unanswered_.load() + 1, guardian::kUnanswered) : 0;
}

/// Waits until nothing is owed any more; false when it is lost.
bool Guardian::answers() {
  while (owed_ > 0 && !lost()) {
    pollfd end{socket_, POLLIN, 0};
    if (::poll(&end, 1, static_cast<int>(kBeat.count())) >= 0) listen();  // a signal is no turn
  }
  return !lost();
}

std::string Guardian::trouble() const {
  if (gone_) return "the process that guards the outputs is gone";
  return lost() ? "the process that guards the outputs does not answer" : "";
}

// Idempotent, for it is called with each set-point: only the first one of a row sends. The guardian
// has taken kArm, ahead of the current, when this returns. What it has not answered is taken back,
// so that it waits for no heartbeat when it goes on.
void Guardian::arm(const std::string& role) {
  const std::lock_guard lock(mutex_);
  if (armed_.empty() && !lost() && say(guardian::kArm) && !answers()) say(guardian::kDisarm);
  if (lost())
    fail(DeviceErrorKind::lost, trouble() + (gone_ ? "; only a new session has another" : ""));
  armed_.insert(role);
}

void Guardian::disarm(const std::string& role) {
  const std::lock_guard lock(mutex_);
  if (armed_.erase(role) != 0 && armed_.empty()) say(guardian::kDisarm);
}

// While armed, a host whose `healthy` is false sends no heartbeat and is killed like one that
// hangs. The guardian's end is noticed whether or not something is energized. To one that does not
// answer nothing more is said: it would find it all when it goes on.
// The lock makes one order of heartbeats and of arm() and disarm(): no heartbeat follows the last
// disarm().
void Guardian::beat() {
  const sched_param urgent{kUrgent};
  ::sched_setscheduler(0, SCHED_RR, &urgent);  // this thread; where it may not, it goes on as it is
  while (!done_) {
    std::this_thread::sleep_for(kBeat);
    const std::lock_guard lock(mutex_);
    listen();
    if (!armed_.empty() && !lost() && healthy_()) say(guardian::kBeatMessage);
  }
}

std::unique_ptr<CoilAmplifier> guarded(CoilAmplifier& amplifier, Guardian& guardian) {
  return std::make_unique<GuardedCoils>(amplifier, guardian);
}
std::unique_ptr<Lamp> guarded(Lamp& lamp, Guardian& guardian) {
  return std::make_unique<GuardedLamp>(lamp, guardian);
}

std::unique_ptr<Instrument> guarded(Instrument& instrument, Guardian& guardian,
                                    const std::string& role) {
  return std::make_unique<GuardedInstrument>(instrument, guardian, role);
}

}  // namespace vitreo
