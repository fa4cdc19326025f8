// Guest of `make test-kernel`: what its cases share. Instruments at the far end of real nodes, the
// program under test, and the port on which results leave the machine.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

namespace vitreo::kernel_guest {

using Steady = std::chrono::steady_clock;
using Milliseconds = std::chrono::duration<double, std::milli>;
using namespace std::chrono_literals;

constexpr const char* kProgram = "/opt/vitreo/vitreo";
constexpr uid_t kOperator =
    1000;  // of the groups dialout, video and plugdev, as guest_start has it

/// An operator's rights and home, for this process from now on; root's are kept.
void become(uid_t user);

/// One line to outside: a kind (run.py), a tab, a text. Without a port, on standard output alone.
void send_line(const std::string& kind, const std::string& text);
/// A measured line of the present case; printf's format.
[[gnu::format(printf, 1, 2)]] void row(const char* format, ...);

/// Nothing when `so` has not become true within `patience`; else the time that it took.
std::optional<Milliseconds> time_until(Steady::duration patience, const std::function<bool()>& so);
/// The whole file; empty without one.
std::string text_of(const std::filesystem::path& file);
void write_text(const std::filesystem::path& file, const std::string& text);
/// Loads modules with what they need; "dummy_hcd num=2" has a parameter. Throws std::runtime_error.
void load(const std::vector<std::string>& modules);
/// Two controllers for gadgets, and the folder in which these are made.
void load_gadgets();
/// Debian's udev, with the project's rules; what is there already is put through them.
void start_udevd();
/// Runs a program to its end: its exit code, and what it printed on both outputs.
struct Ended {
  int code = -1;
  std::string said;
};
Ended run(const std::vector<std::string>& words, uid_t user = 0);
/// In a process of its own, as that user: what `act` returns, or "EXCEPTION: ...".
std::string elsewhere(uid_t user, const std::function<std::string()>& act);
/// Lines of the kernel's log since the start that contain `what`.
int kernel_log_lines(const std::string& what);

/// An instrument's end, by another hand (tests/doubles/).
class Instrument {
 public:
  virtual ~Instrument() = default;
  /// One order of tests/doubles/README.md; throws std::runtime_error for one that is refused.
  nlohmann::json order(const nlohmann::json& what);
  nlohmann::json state(const std::string& name) { return order({{"get", name}}).at(name); }
  void unplug() { order({{"unplug", true}}); }
  void plug() { order({{"plug", true}}); }

 protected:
  virtual std::string exchange(const std::string& line) = 0;
};

/// By gadget.py, behind this machine's own gadget controllers or uhid; gone with its object.
class Gadget : public Instrument {
 public:
  explicit Gadget(const std::vector<std::string>& words);
  ~Gadget() override;
  Gadget(const Gadget&) = delete;
  Gadget& operator=(const Gadget&) = delete;
  pid_t process() const { return process_; }

 private:
  std::string exchange(const std::string& line) override;
  std::string line();
  pid_t process_ = -1;
  int orders_ = -1;
  int answers_ = -1;
  std::string read_;
};

/// Outside of this machine, behind QEMU's usb-redir (redirected.py).
class Outside : public Instrument {
 public:
  explicit Outside(std::string name) : name_(std::move(name)) {}

 private:
  std::string exchange(const std::string& line) override;
  const std::string name_;
};

/// An amplifier's outputs as its double has them, and its place in a rig file.
struct Amplifier {
  virtual ~Amplifier() = default;
  virtual std::string rig() const = 0;
  /// V or A, the largest magnitude of a channel: what it is set to.
  virtual double level() = 0;
  virtual Instrument& instrument() = 0;
  /// What has the one-shot of a heartbeat line, and the name of the line's level in its history.
  virtual Instrument& line() { return instrument(); }
  virtual std::string edges() const { return "port_latch"; }
  virtual std::string node() const { return "/dev/hidraw0"; }
  /// Of the level what flows: nothing where a heartbeat's relay is open.
  double output();
  bool energized() { return output() > 0.4; }
  bool at_zero() { return output() < 2e-3; }
};

/// A heartbeat line, and what is behind it.
struct Beat {
  double rate = 50;        ///< Hz
  double one_shot = 0.07;  ///< s
  double release = 0.015;  ///< s, in which the relay opens after the pulse
  double operate = 0.1;    ///< s, in which it closes: longer than the pulse
};

/// A USB-3103, whose outputs are asked for from `device`; one ampere is half a volt. With a
/// heartbeat line it outputs nothing while the relay of the device's one-shot is open.
class Voltages : public Amplifier {
 public:
  explicit Voltages(std::unique_ptr<Instrument> device, std::string role = "coils",
                    const std::optional<Beat>& beat = std::nullopt);
  std::string rig() const override;
  double level() override;
  Instrument& instrument() override { return *device_; }

 private:
  std::unique_ptr<Instrument> device_;
  std::string role_;
  std::optional<Beat> beat_;
};

/// A BOP on a serial port; with a heartbeat line behind RTS of an adapter of its own.
class Bop : public Amplifier {
 public:
  Bop(std::unique_ptr<Instrument> supply, std::string node);
  Bop(std::unique_ptr<Instrument> supply, std::string node, std::unique_ptr<Instrument> adapter,
      std::string adapter_node, const Beat& beat);
  std::string rig() const override;
  double level() override;
  Instrument& instrument() override { return *supply_; }
  Instrument& line() override { return adapter_ ? *adapter_ : *supply_; }
  std::string edges() const override { return "rts"; }
  std::string node() const override { return node_; }

 private:
  std::unique_ptr<Instrument> supply_, adapter_;
  std::string node_, adapter_node_;
  Beat beat_;
};
/// Waits for it, and opens it to every user; throws std::runtime_error.
void wait_for_node(const std::filesystem::path& node);
/// The lasting name, by udev, of the port of the serial adapter with this serial number, once it is
/// there: that of the kernel changes with each reset. Throws std::runtime_error.
std::string adapter_node(const std::string& serial);
/// Plugged into this machine's own controller.
std::unique_ptr<Amplifier> usb3103_gadget(const std::string& role = "coils",
                                          const std::optional<Beat>& beat = std::nullopt);
/// A BOP behind a port of the communication class; its heartbeat's adapter is an FTDI's.
std::unique_ptr<Amplifier> bop_gadget(const std::optional<Beat>& beat = std::nullopt);

/// The program, holding 1 A (a lamp: level 0.5) for a minute.
class Host {
 public:
  /// `prepare`: in the new process, before the program. `by`: words of a program that becomes it.
  explicit Host(Amplifier& amplifier, const std::function<void()>& prepare = {},
                const std::vector<std::string>& by = {});
  ~Host();
  Host(const Host&) = delete;
  Host& operator=(const Host&) = delete;

  pid_t process() const { return process_; }
  /// -1 where there is none.
  pid_t guardian() const;
  /// Waits until something flows; throws std::runtime_error with the program's words when nothing
  /// does.
  void energize();
  bool lives();
  /// Its exit code, or 128 + the signal that ended it; nothing while it lives.
  std::optional<int> code();
  std::string said() const { return text_of(folder_ / "said"); }
  const std::filesystem::path& folder() const { return folder_; }

 private:
  Amplifier& amplifier_;
  std::filesystem::path folder_;
  pid_t process_ = -1;
  std::optional<int> code_;
};

}  // namespace vitreo::kernel_guest
