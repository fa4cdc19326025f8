// SPDX-License-Identifier: Apache-2.0
#include "devices/links/modem_lines.h"

#include "devices/links/node_lock.h"
#include "devices/links/serial_link.h"
#include "devices/time/error.h"

#include <cerrno>
#include <fcntl.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <utility>

namespace vitreo {
namespace {

int bit_of(ModemLine line) { return line == ModemLine::rts ? TIOCM_RTS : TIOCM_DTR; }

class PortLines final : public ModemLines {
 public:
  PortLines(const std::string& path, Clock& clock)
      : clock_(clock), address_("serial:" + path), file_(open(path)) {
    if (!take_for_us(file_->handle())) throw OwnedError(address_);
    keep_from_flow_control();
    const int both = TIOCM_RTS | TIOCM_DTR;
    // A pseudo-terminal answers EINVAL or ENOTTY.
    if (::ioctl(file_->handle(), TIOCMBIC, &both) != 0)
      throw DeviceError(DeviceErrorKind::refused, address_,
                        "has no lines RTS and DTR: " + system_error());
  }
  const std::string& address() const override { return address_; }

  // A transfer to the adapter, which the kernel waits for: other tasks go on meanwhile.
  void set(ModemLine line, bool asserted) override {
    const int bit = bit_of(line);
    int result = 0;
    std::string why;
    clock_.outside([&] {
      result = ::ioctl(file_->handle(), asserted ? TIOCMBIS : TIOCMBIC, &bit);
      if (result != 0) why = system_error();
    });
    if (result != 0) throw DeviceError(DeviceErrorKind::lost, address_, why);
  }

 private:
  static std::unique_ptr<OpenFile> open(const std::string& path) {
    const int handle = ::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (handle < 0) throw DeviceError(kind_of_refusal(errno), "serial:" + path, system_error());
    return own_descriptor(handle);
  }
  /// RTS is ours, not the flow control's; and HUPCL: the lines fall with the last close.
  void keep_from_flow_control() {
    termios line{};
    if (::tcgetattr(file_->handle(), &line) != 0)
      throw DeviceError(DeviceErrorKind::not_found, address_, "is no serial port");
    line.c_cflag = (line.c_cflag & ~static_cast<tcflag_t>(CRTSCTS)) | CLOCAL | HUPCL;
    if (::tcsetattr(file_->handle(), TCSANOW, &line) != 0)
      throw DeviceError(DeviceErrorKind::refused, address_,
                        "does not take the settings: " + system_error());
  }

  Clock& clock_;
  const std::string address_;
  const std::unique_ptr<OpenFile> file_;
};

}  // namespace

std::unique_ptr<ModemLines> open_modem_lines(const std::string& path, Clock& clock) {
  return std::make_unique<PortLines>(path, clock);
}

}  // namespace vitreo
