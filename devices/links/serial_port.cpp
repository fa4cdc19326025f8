// Serial ports through libserialport, which knows the oddities of their drivers. Bytes are read and
// written by our own code: its reads cannot tell a port that is gone from one that is silent, and
// spin on it.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/node_lock.h"
#include "devices/links/serial_link.h"
#include "devices/time/error.h"

#include <cerrno>
#include <libserialport.h>
#include <sys/file.h>
#include <termios.h>
#include <utility>

namespace vitreo {
namespace {

class Port final : public OpenFile {
 public:
  explicit Port(std::string path) : path_(std::move(path)) {
    check(sp_get_port_by_name(node_behind(path_).c_str(), &port_), DeviceErrorKind::not_found,
          "no such port");
    if (sp_open(port_, SP_MODE_READ_WRITE) != SP_OK) {
      const int code = sp_last_error_code();
      const DeviceErrorKind kind = kind_of_refusal(code);
      // The destructor does not run for a constructor that throws.
      const std::string what = why("does not open");
      sp_free_port(std::exchange(port_, nullptr));
      if (code == EBUSY) throw OwnedError("serial:" + path_);  // TIOCEXCL, for all but root
      throw DeviceError(kind, "serial:" + path_, what);
    }
  }
  ~Port() override {
    sp_close(port_);
    sp_free_port(port_);
  }
  Port(const Port&) = delete;
  Port& operator=(const Port&) = delete;

  /// RTS and DTR are asserted, as drivers of the Sutter MP-285 do without flow control.
  /// Flushed last: what came in at another rate or parity is no answer to anything.
  void configure(const SerialSettings& settings) {
    // A port has one owner: the kernel itself lets any number of programs open it. Before anything
    // is set or flushed: what the owner's instrument is saying is not ours.
    if (!take_for_us(handle())) throw OwnedError("serial:" + path_);
    const auto set = [this](sp_return result, const char* what) {
      check(result, DeviceErrorKind::refused, what);
    };
    set(sp_set_baudrate(port_, settings.baud_rate), "does not take the baud rate");
    set(sp_set_bits(port_, settings.data_bits), "does not take the data bits");
    set(sp_set_parity(port_, parity_of(settings)), "does not take the parity");
    set(sp_set_stopbits(port_, settings.stop_bits), "does not take the stop bits");
    const sp_flowcontrol flow = settings.rts_cts    ? SP_FLOWCONTROL_RTSCTS
                                : settings.xon_xoff ? SP_FLOWCONTROL_XONXOFF
                                                    : SP_FLOWCONTROL_NONE;
    set(sp_set_flowcontrol(port_, flow), "does not take the flow control");
    check_taken(settings);
    // With hardware flow control RTS is the driver's.
    if (!settings.rts_cts) set(sp_set_rts(port_, SP_RTS_ON), "does not assert RTS");
    set(sp_set_dtr(port_, SP_DTR_ON), "does not assert DTR");
    set(sp_flush(port_, SP_BUF_BOTH), "does not flush");
  }

  int handle() const override {
    int descriptor = -1;
    sp_get_port_handle(port_, &descriptor);
    return descriptor;
  }

 private:
  static sp_parity parity_of(const SerialSettings& settings) {
    switch (settings.parity) {
      case Parity::none:
        return SP_PARITY_NONE;
      case Parity::odd:
        return SP_PARITY_ODD;
      case Parity::even:
        return SP_PARITY_EVEN;
      case Parity::mark:
        return SP_PARITY_MARK;
      case Parity::space:
        return SP_PARITY_SPACE;
    }
    return SP_PARITY_INVALID;
  }
  /// The C library looks after the data bits and whether there is a parity; an adapter that lacks
  /// the second stop bit, or mark and space, clears their flags (tcsetattr(3)).
  void check_taken(const SerialSettings& settings) const {
    termios taken{};
    if (::tcgetattr(handle(), &taken) != 0) return;  // says the first read or write
    const auto has = [&taken](tcflag_t flag) { return (taken.c_cflag & flag) != 0; };
    const bool sticky = settings.parity == Parity::mark || settings.parity == Parity::space;
    if (has(CSTOPB) != (settings.stop_bits == 2))
      throw DeviceError(DeviceErrorKind::refused, "serial:" + path_, "does not take the stop bits");
    if (has(CMSPAR) != sticky)
      throw DeviceError(DeviceErrorKind::refused, "serial:" + path_, "does not take the parity");
  }
  void check(sp_return result, DeviceErrorKind kind, const char* what) const {
    if (result != SP_OK) throw DeviceError(kind, "serial:" + path_, why(what));
  }
  static std::string why(const char* what) {
    char* const message = sp_last_error_message();
    std::string text = what;
    if (message != nullptr && *message != '\0') text += std::string(": ") + message;
    sp_free_error_message(message);
    return text;
  }

  const std::string path_;
  sp_port* port_ = nullptr;
};

}  // namespace

std::unique_ptr<OpenFile> open_with_libserialport(const std::string& path,
                                                  const SerialSettings& settings) {
  auto port = std::make_unique<Port>(path);
  port->configure(settings);
  return port;
}

}  // namespace vitreo
