// SPDX-License-Identifier: Apache-2.0
#include "tests/kernel/guest.h"

#include "devices/links/serial_ports.h"
#include "tests/host/safety/held_protocol.h"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <fstream>
#include <grp.h>
#include <poll.h>
#include <sstream>
#include <stdexcept>
#include <sys/klog.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>

namespace vitreo::kernel_guest {
namespace {

namespace fs = std::filesystem;

/// The virtio port that run.py listens to; -1 elsewhere.
int port() {
  static const int opened = [] {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator("/sys/class/virtio-ports", error))
      return ::open(("/dev" / entry.path().filename()).c_str(), O_RDWR | O_CLOEXEC);
    return -1;
  }();
  return opened;
}

/// Up to the end of a line, which is cut off. Throws when nothing comes for 10 s.
std::string read_line(int from, std::string& read) {
  for (;;) {
    if (const std::size_t end = read.find('\n'); end != std::string::npos) {
      std::string one = read.substr(0, end);
      read.erase(0, end + 1);
      return one;
    }
    pollfd ready{from, POLLIN, 0};
    char bytes[4096];
    const ssize_t size = ::poll(&ready, 1, 10000) > 0 ? ::read(from, bytes, sizeof bytes) : 0;
    if (size <= 0) throw std::runtime_error("no answer of an instrument's double");
    read.append(bytes, static_cast<std::size_t>(size));
  }
}

void write_all(int to, const std::string& text) {
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t size = ::write(to, text.data() + done, text.size() - done);
    if (size <= 0) return;
    done += static_cast<std::size_t>(size);
  }
}

[[noreturn]] void execute(const std::vector<std::string>& words) {
  std::vector<char*> pointers;
  for (const std::string& word : words) pointers.push_back(const_cast<char*>(word.c_str()));
  pointers.push_back(nullptr);
  ::signal(SIGPIPE, SIG_DFL);
  ::execvp(pointers[0], pointers.data());
  ::_exit(127);
}

/// A child whose outputs come here; `act` does not return.
std::pair<pid_t, int> child(const std::function<void()>& act) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
  std::fflush(stdout);
  const pid_t process = ::fork();
  if (process == 0) {
    ::dup2(ends[1], 1);
    ::dup2(ends[1], 2);
    act();
    ::_exit(125);
  }
  ::close(ends[1]);
  return {process, ends[0]};
}

Ended wait_for(std::pair<pid_t, int> started) {
  Ended ended;
  char bytes[4096];
  for (ssize_t size; (size = ::read(started.second, bytes, sizeof bytes)) > 0;)
    ended.said.append(bytes, static_cast<std::size_t>(size));
  ::close(started.second);
  int status = 0;
  ::waitpid(started.first, &status, 0);
  ended.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return ended;
}

/// One that has no one-shot closes nothing, and opens nothing.
void set_one_shot(Instrument& device, const Beat& beat) {
  device.order({{"set",
                 {{"one_shot", beat.one_shot},
                  {"relay_release", beat.release},
                  {"relay_operate", beat.operate}}}});
  device.order({{"power_cycle", true}});  // it takes its one-shot with its power
}

std::string beat_settings(const Beat& beat) {
  return ", heartbeat = " + std::to_string(beat.rate) +
         ", one_shot = " + std::to_string(beat.one_shot) +
         ", pick_up = " + std::to_string(beat.operate + 0.05);
}

}  // namespace

// Groups before the user: afterwards they could not be changed.
void become(uid_t user) {
  if (user == 0) return;
  const gid_t groups[] = {20, 44, 46};
  if (::setgroups(3, groups) != 0 || ::setgid(user) != 0 || ::setuid(user) != 0) ::_exit(126);
  ::setenv("HOME", "/home/operator", 1);
}

void send_line(const std::string& kind, const std::string& text) {
  if (port() >= 0) write_all(port(), kind + "\t" + text + "\n");
}

void row(const char* format, ...) {
  char text[1024];
  va_list values;
  va_start(values, format);
  std::vsnprintf(text, sizeof text, format, values);
  va_end(values);
  std::printf("%s\n", text);
  send_line("ROW", text);
}

std::optional<Milliseconds> time_until(Steady::duration patience, const std::function<bool()>& so) {
  const auto began = Steady::now();
  do {
    if (so()) return Steady::now() - began;
    std::this_thread::sleep_for(4ms);
  } while (Steady::now() - began < patience);
  return std::nullopt;
}

std::string text_of(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

void write_text(const fs::path& file, const std::string& text) {
  const int open = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  const bool written =
      open >= 0 && ::write(open, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  if (open >= 0) ::close(open);
  if (!written) throw std::runtime_error(file.string() + " does not take: " + text);
}

void load(const std::vector<std::string>& modules) {
  for (const std::string& module : modules) {
    std::vector<std::string> words{"busybox", "modprobe"};
    std::istringstream parts(module);
    for (std::string part; parts >> part;) words.push_back(part);
    if (const Ended ended = run(words); ended.code != 0)
      throw std::runtime_error("module " + module + ": " + ended.said);
  }
}

void load_gadgets() {
  load({"dummy_hcd num=2", "libcomposite"});
  if (!fs::exists("/sys/kernel/config/usb_gadget"))
    run({"busybox", "mount", "-t", "configfs", "none", "/sys/kernel/config"});
}

void start_udevd() {
  static bool there = false;
  if (std::exchange(there, true)) return;
  fs::create_symlink("/bin/udevadm", "/tmp/bin/systemd-udevd");
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"/tmp/bin/systemd-udevd", "--daemon"},
        {"udevadm", "trigger", "--action=add"},
        {"udevadm", "settle", "--timeout=30"}})
    if (const Ended ended = run(words); ended.code != 0)
      throw std::runtime_error(words[0] + ": " + ended.said);
}

Ended run(const std::vector<std::string>& words, uid_t user) {
  return wait_for(child([&] {
    become(user);
    execute(words);
  }));
}

std::string elsewhere(uid_t user, const std::function<std::string()>& act) {
  const Ended ended = wait_for(child([&] {
    become(user);
    std::string said;
    try {
      said = act();
    } catch (const std::exception& error) {
      said = std::string("EXCEPTION: ") + error.what();
    }
    write_all(1, said);
    ::_exit(0);
  }));
  return ended.said;
}

int kernel_log_lines(const std::string& what) {
  std::string log(1 << 20, '\0');
  const int size =
      ::klogctl(3, log.data(), static_cast<int>(log.size()));  // SYSLOG_ACTION_READ_ALL
  log.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
  std::istringstream lines(log);
  int count = 0;
  for (std::string line; std::getline(lines, line);)
    count += line.find(what) != std::string::npos ? 1 : 0;
  return count;
}

nlohmann::json Instrument::order(const nlohmann::json& what) {
  nlohmann::json answer = nlohmann::json::parse(exchange(what.dump()));
  if (answer.contains("error"))
    throw std::runtime_error(what.dump() + ": " + answer["error"].get<std::string>());
  return answer;
}

Gadget::Gadget(const std::vector<std::string>& words) {
  std::vector<std::string> all{"python3", "-B", "/opt/vitreo/kernel/gadget.py"};
  all.insert(all.end(), words.begin(), words.end());
  int orders[2];
  int answers[2];
  if (::pipe2(orders, O_CLOEXEC) != 0 || ::pipe2(answers, O_CLOEXEC) != 0)
    throw std::runtime_error("no pipe");
  process_ = ::fork();
  if (process_ == 0) {
    ::dup2(orders[0], 0);
    ::dup2(answers[1], 1);
    execute(all);
  }
  ::close(orders[0]);
  ::close(answers[1]);
  orders_ = orders[1];
  answers_ = answers[0];
  if (line() != "ready") throw std::runtime_error("the double did not get ready");
}

// Unbound before its end: the functions of a gadget go only when nothing has them open.
Gadget::~Gadget() {
  ::close(orders_);
  ::close(answers_);
  ::waitpid(process_, nullptr, 0);
  run({"sh", "-c",
       "cd /sys/kernel/config/usb_gadget 2>/dev/null || exit 0; for g in *; do [ -d $g ] || "
       "continue;"
       "[ -n \"$(cat $g/UDC)\" ] && continue; rm -f $g/configs/c.1/*.[0-9]; rmdir $g/functions/* "
       "$g/configs/c.1/strings/* $g/configs/c.1 $g/strings/* $g; done"});
}

std::string Gadget::line() { return read_line(answers_, read_); }

std::string Gadget::exchange(const std::string& order) {
  write_all(orders_, order + "\n");
  return line();
}

std::string Outside::exchange(const std::string& order) {
  static std::string read;  // one port for all of them, whose answers come in order
  send_line("ORDER", name_ + "\t" + order);
  return read_line(port(), read);
}

double Amplifier::output() {
  const nlohmann::json state = line().order({{"get", "state"}});
  return state.value("amplifiers", true) ? level() : 0;
}

Voltages::Voltages(std::unique_ptr<Instrument> device, std::string role,
                   const std::optional<Beat>& beat)
    : device_(std::move(device)), role_(std::move(role)), beat_(beat) {
  if (beat_) set_one_shot(*device_, *beat_);
}

std::string Voltages::rig() const {
  const std::string driver = role_ == "lamp" ? "led" : "usb3103";
  return role_ + " = { driver = \"" + driver + "\", address = \"hid:09db:009c\", enable_line = 0" +
         (beat_ ? beat_settings(*beat_) : "") + " }";
}

double Voltages::level() {
  double most = 0;
  for (const nlohmann::json& one : device_->state("volts"))
    most = std::max(most, std::abs(one.get<double>()));
  return most;
}

Bop::Bop(std::unique_ptr<Instrument> supply, std::string node)
    : supply_(std::move(supply)), node_(std::move(node)) {}

Bop::Bop(std::unique_ptr<Instrument> supply, std::string node, std::unique_ptr<Instrument> adapter,
         std::string adapter_node, const Beat& beat)
    : supply_(std::move(supply)),
      adapter_(std::move(adapter)),
      node_(std::move(node)),
      adapter_node_(std::move(adapter_node)),
      beat_(beat) {
  set_one_shot(*adapter_, beat_);
}

std::string Bop::rig() const {
  std::string table =
      "coils = { driver = \"kepco_bop\", address = \"serial:" + node_ + "\", max_slope = 1000 }";
  if (adapter_)
    table += ", enable_line = { driver = \"serial_line\", address = \"serial:" + adapter_node_ +
             "\", line = \"rts\"" + beat_settings(beat_) + " }";
  return table;
}

double Bop::level() { return std::abs(supply_->state("current").get<double>()); }

void wait_for_node(const fs::path& node) {
  if (!time_until(20s, [&] { return fs::exists(node); }))
    throw std::runtime_error(node.string() + " has not come within 20 s");
  run({"chmod", "0666", node});
}

std::string adapter_node(const std::string& serial) {
  start_udevd();
  fs::path found;
  time_until(20s, [&] {
    std::error_code error;
    for (const auto& port : fs::directory_iterator("/dev/serial/by-id", error))
      if (const std::string name = port.path().filename();
          name.find("_" + serial + "-") != std::string::npos && is_lasting_link(name))
        found = port.path();
    return !found.empty() && fs::exists(found);
  });
  if (found.empty()) throw std::runtime_error("no adapter " + serial + " within 20 s");
  run({"udevadm", "settle", "--timeout=20"});
  return found;
}

std::unique_ptr<Amplifier> usb3103_gadget(const std::string& role,
                                          const std::optional<Beat>& beat) {
  auto device = std::make_unique<Gadget>(std::vector<std::string>{"hid", "usb3103", "--numbered"});
  wait_for_node("/dev/hidraw0");
  return std::make_unique<Voltages>(std::move(device), role, beat);
}

std::unique_ptr<Amplifier> bop_gadget(const std::optional<Beat>& beat) {
  auto supply = std::make_unique<Gadget>(std::vector<std::string>{"acm", "kepco_bop"});
  const std::string node = adapter_node("A1B2C3");
  if (!beat) return std::make_unique<Bop>(std::move(supply), node);
  auto adapter = std::make_unique<Gadget>(
      std::vector<std::string>{"usbip", "ftdi_adapter", "--option", "serial=LINE"});
  return std::make_unique<Bop>(std::move(supply), node, std::move(adapter), adapter_node("LINE"),
                               *beat);
}

Host::Host(Amplifier& amplifier, const std::function<void()>& prepare,
           const std::vector<std::string>& by)
    : amplifier_(amplifier) {
  std::string name = "/tmp/host_XXXXXX";
  folder_ = ::mkdtemp(name.data());
  ::chmod(folder_.c_str(), 0777);  // the program may run as the operator
  std::ofstream(folder_ / "held.lua") << kHeld;
  std::ofstream(folder_ / "rig.lua") << "return { title = 'amplifier', " << amplifier.rig() << " }";
  std::fflush(stdout);
  process_ = ::fork();
  if (process_ != 0) return;
  const int log = ::open((folder_ / "said").c_str(), O_WRONLY | O_CREAT | O_APPEND, 0666);
  ::dup2(log, 1);
  ::dup2(log, 2);
  if (prepare) prepare();
  std::vector<std::string> words = by;
  for (const std::string& word :
       {std::string(kProgram), std::string("run"), (folder_ / "held.lua").string(),
        std::string("--rig"), (folder_ / "rig.lua").string(), std::string("--out"),
        (folder_ / "runs").string()})
    words.push_back(word);
  execute(words);
}

/// The guardian first: without the amplifier, which goes next, it would go on for ten minutes.
Host::~Host() {
  if (const pid_t its = guardian(); its > 0) ::kill(its, SIGKILL);
  if (lives()) {
    ::kill(process_, SIGKILL);
    ::waitpid(process_, nullptr, 0);
  }
  std::error_code error;
  fs::remove_all(folder_, error);
}

pid_t Host::guardian() const {
  for (const auto& entry : fs::directory_iterator("/proc")) {
    std::istringstream stat(text_of(entry.path() / "stat"));
    std::string id, called, state;
    pid_t parent = -1;
    if (stat >> id >> called >> state >> parent && parent == process_ &&
        called == "(vitreo_guardian)")
      return static_cast<pid_t>(std::stol(id));
  }
  return -1;
}

void Host::energize() {
  time_until(100s, [&] { return amplifier_.energized() || !lives(); });
  if (!amplifier_.energized()) throw std::runtime_error("nothing flows: " + said());
}

bool Host::lives() { return !code(); }

std::optional<int> Host::code() {
  int status = 0;
  if (!code_ && ::waitpid(process_, &status, WNOHANG) == process_)
    code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return code_;
}

}  // namespace vitreo::kernel_guest
