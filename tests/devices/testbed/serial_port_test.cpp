// Serial ports that libserialport opens, with the entry in sysfs that it wants: under
// umockdev-wrapper.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/serial_link.h"
#include "devices/testbed/usb_testbed.h"
#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/devices/links/real_end.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <functional>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;

/// A user without any rights, for as long as it lives.
class Nobody {
 public:
  Nobody() {
    if (was_ == 0 && seteuid(65534) != 0) ADD_FAILURE() << "root cannot become nobody";
  }
  ~Nobody() {
    if (was_ == 0 && seteuid(0) != 0) ADD_FAILURE() << "nobody cannot become root again";
  }
  Nobody(const Nobody&) = delete;
  Nobody& operator=(const Nobody&) = delete;

 private:
  const uid_t was_ = geteuid();
};

/// /dev/ttyS7 with a device behind it in sysfs; its bytes are to go to a pseudo-terminal.
struct PortWithADevice : ::testing::Test {
  PortWithADevice() {
    const fs::path device = root / "sys/devices/platform/serial8250/tty/ttyS7";
    fs::create_directories(device);
    fs::create_directories(device.parent_path().parent_path() / "driver");
    fs::create_directory_symlink("../..", device / "device");
    fs::create_directories(root / "sys/class/tty");
    fs::create_directory_symlink("../../devices/platform/serial8250/tty/ttyS7",
                                 root / "sys/class/tty/ttyS7");
    fs::create_directories(root / "dev");
    fs::create_symlink(target, root / "dev/ttyS7");
    fs::permissions(root, fs::perms(0755));
  }
  DeviceErrorKind kind_of(const std::function<void()>& work, const std::string& saying) {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_NE(std::string(error.what()).find(saying), std::string::npos) << error.what();
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::protocol;
  }

  std::unique_ptr<Clock> clock = virtual_clock(Pace::real_time);
  EchoPeer peer;
  RealEnd end{peer, open_pty_end()};
  const std::string target = end.address().substr(std::string("serial:").size());
  std::unique_ptr<UsbTestbed> testbed = make_usb_testbed();
  const fs::path root = std::getenv("UMOCKDEV_DIR");
};

TEST_F(PortWithADevice, ThatTheUserMayNotOpenIsRefusedAndNotMissing) {
  ASSERT_TRUE(has_sysfs_entry("/dev/ttyS7")) << "else it is not libserialport that opens it";
  ASSERT_EQ(chmod(target.c_str(), 0), 0);
  // Else the testbed's own sockets would refuse a user without rights before the node does.
  for (const auto& entry : fs::recursive_directory_iterator(root))
    if (!entry.is_symlink()) fs::permissions(entry.path(), fs::perms(0777));
  const Nobody nobody;
  EXPECT_EQ(kind_of([&] { open_serial("/dev/ttyS7", {}, *clock); }, "Permission denied"),
            DeviceErrorKind::refused);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
