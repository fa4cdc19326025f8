// Byte links over the operating system's own paths: pseudo-terminals and TCP on this machine, in
// real time.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/address.h"
#include "devices/links/serial_ports.h"
#include "devices/links/tcp_link.h"
#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/devices/links/real_end.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <numeric>
#include <pty.h>
#include <stdexcept>
#include <termios.h>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

struct RealLink : ::testing::Test {
  DeviceErrorKind kind_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::protocol;
  }
  std::unique_ptr<ByteLink> open(const std::string& address) {
    return open_byte_link(address, {}, *clock);
  }
  ByteString take(ByteLink& link, std::size_t count) {
    ByteString got;
    while (got.size() < count) {
      const ByteString part = link.read(count - got.size(), 2s);
      if (part.empty()) break;
      got.insert(got.end(), part.begin(), part.end());
    }
    return got;
  }
  void expect_every_byte_comes_back(const std::string& address) {
    const auto link = open(address);
    EXPECT_EQ(link->address(), address);
    ByteString every(256);
    std::iota(every.begin(), every.end(), std::uint8_t{0});
    link->write(every, 1s);
    EXPECT_EQ(take(*link, 256), every);
    EXPECT_EQ(link->read(1, 5ms), ByteString{});
  }
  void expect_hanging_up_is_noticed(RealEnd& end) {
    const auto link = open(end.address());
    link->write(bytes("x"), 1s);
    EXPECT_EQ(take(*link, 1), bytes("x"));
    std::thread hand([&] {
      std::this_thread::sleep_for(30ms);
      end.hang_up();
    });
    const Time before = clock->now();
    EXPECT_EQ(kind_of([&] { link->read(1, 5s); }), DeviceErrorKind::lost);
    EXPECT_LT(clock->now() - before, 530ms);
    hand.join();
    EXPECT_EQ(kind_of([&] { link->write(bytes("y"), 1s); }), DeviceErrorKind::lost);
    EXPECT_EQ(kind_of([&] { link->reopen(); }), DeviceErrorKind::not_found);
  }

  std::unique_ptr<Clock> clock = virtual_clock(Pace::real_time);
  EchoPeer peer;
};

TEST_F(RealLink, CarriesEveryByteOverAPseudoTerminal) {
  RealEnd end(peer, open_pty_end());
  EXPECT_FALSE(has_sysfs_entry(parse_address(end.address()).place));
  expect_every_byte_comes_back(end.address());
}

TEST_F(RealLink, CarriesEveryByteOverTcp) {
  RealEnd end(peer, open_tcp_end());
  expect_every_byte_comes_back(end.address());
}

TEST_F(RealLink, IsLostWithinHalfASecondOfATerminalsHangingUp) {
  RealEnd end(peer, open_pty_end());
  expect_hanging_up_is_noticed(end);
}

TEST_F(RealLink, IsLostWithinHalfASecondOfAConnectionsEnd) {
  RealEnd end(peer, open_tcp_end());
  expect_hanging_up_is_noticed(end);
}

// Nothing is sent and nothing is waited for: how a current that is held is listened to.
TEST_F(RealLink, ShowsWithoutAByteThatTheOtherEndWent) {
  for (auto open_end : {+[] { return open_pty_end(); }, +[] { return open_tcp_end(); }}) {
    RealEnd end(peer, open_end());
    const auto link = open(end.address());
    EXPECT_FALSE(link->hung_up()) << end.address();
    link->write(bytes("xy"), 1s);
    EXPECT_EQ(take(*link, 1), bytes("x"));
    clock->sleep_for(10ms);
    EXPECT_FALSE(link->hung_up()) << "something is there to be read: " << end.address();
    end.hang_up();
    const Time before = clock->now();
    while (!link->hung_up() && clock->now() - before < 1s) clock->sleep_for(1ms);
    EXPECT_LT(clock->now() - before, 10ms) << end.address();
    EXPECT_EQ(kind_of([&] {
                while (!link->read(1, 1s).empty()) {
                }
              }),
              DeviceErrorKind::lost);
    EXPECT_TRUE(link->hung_up()) << "it is closed: " << end.address();
  }
}

TEST_F(RealLink, NoticesWhenItWritesThatTheOtherEndWentMeanwhile) {
  for (auto open_end : {+[] { return open_pty_end(); }, +[] { return open_tcp_end(); }}) {
    RealEnd end(peer, open_end());
    const auto link = open(end.address());
    link->write(bytes("x"), 1s);
    EXPECT_EQ(take(*link, 1), bytes("x"));
    end.hang_up();
    clock->sleep_for(10ms);
    EXPECT_EQ(kind_of([&] { link->write(bytes("y"), 1s); }), DeviceErrorKind::lost);
  }
}

TEST_F(RealLink, ConnectsAgainToTheSameTcpPort) {
  auto end = std::make_unique<RealEnd>(peer, open_tcp_end());
  const std::string address = end->address();
  const auto link = open(address);
  end->hang_up();
  EXPECT_EQ(kind_of([&] { link->read(1, 1s); }), DeviceErrorKind::lost);
  end = std::make_unique<RealEnd>(peer,
                                  open_tcp_end(std::stoi(address.substr(address.rfind(':') + 1))));
  link->reopen();
  link->write(bytes("z"), 1s);
  EXPECT_EQ(take(*link, 1), bytes("z"));
}

TEST_F(RealLink, HasOneOwner) {
  RealEnd end(peer, open_pty_end());
  const auto link = open(end.address());
  EXPECT_EQ(kind_of([&] { open(end.address()); }), DeviceErrorKind::refused);
}

TEST_F(RealLink, SetsABaudRateThatHasNoName) {
  RealEnd end(peer, open_pty_end());
  const auto link = open_byte_link(end.address(), {.baud_rate = 128000}, *clock);
  link->write(bytes("x"), 1s);
  EXPECT_EQ(take(*link, 1), bytes("x"));
}

TEST_F(RealLink, DescribesItselfByItsAddressAndItsSettings) {
  RealEnd port(peer, open_pty_end()), socket(peer, open_tcp_end());
  const auto serial =
      open_byte_link(port.address(), {.baud_rate = 19200, .xon_xoff = true}, *clock);
  EXPECT_EQ(serial->description(), port.address() + " at 19200 baud, 8N1, XON/XOFF");
  EXPECT_EQ(open(socket.address())->description(), socket.address());
  EXPECT_EQ(to_string(SerialSettings{.rts_cts = true}), "9600 baud, 8N1, RTS/CTS");
  EXPECT_EQ(to_string(SerialSettings{.data_bits = 5, .parity = Parity::mark, .stop_bits = 2}),
            "9600 baud, 5M2");
}

/// The line's flags as a terminal's master shows them.
struct Master {
  Master() {
    char name[64] = {};
    EXPECT_EQ(::openpty(&far, &near, name, nullptr, nullptr), 0);
    path = name;
  }
  ~Master() {
    ::close(far);
    ::close(near);
  }
  Master(const Master&) = delete;
  Master& operator=(const Master&) = delete;
  termios line() const {
    termios now{};
    EXPECT_EQ(::tcgetattr(far, &now), 0);
    return now;
  }
  int far = -1;
  int near = -1;
  std::string path;
};

// A pseudo-terminal forgets the size and that there is a parity; which parity and the stop bits it
// keeps.
TEST_F(RealLink, SetsStopBitsFlowAndWhichParity) {
  const auto flags = [this](const SerialSettings& settings) {
    const Master master;
    const auto link = open_serial(master.path, settings, *clock);
    return master.line().c_cflag & (CSTOPB | PARODD | CMSPAR | CRTSCTS);
  };
  EXPECT_EQ(flags({}), 0U);
  EXPECT_EQ(flags({.stop_bits = 2}), static_cast<tcflag_t>(CSTOPB));
  EXPECT_EQ(flags({.parity = Parity::odd}), static_cast<tcflag_t>(PARODD));
  EXPECT_EQ(flags({.parity = Parity::even}), 0U);
  EXPECT_EQ(flags({.parity = Parity::mark}), static_cast<tcflag_t>(CMSPAR | PARODD));
  EXPECT_EQ(flags({.parity = Parity::space}), static_cast<tcflag_t>(CMSPAR));
  EXPECT_EQ(flags({.rts_cts = true}), static_cast<tcflag_t>(CRTSCTS));
}

TEST_F(RealLink, RefusesALineThatCannotBe) {
  const Master master;
  EXPECT_THROW(open_serial(master.path, {.data_bits = 4}, *clock), std::invalid_argument);
  EXPECT_THROW(open_serial(master.path, {.data_bits = 9}, *clock), std::invalid_argument);
  EXPECT_THROW(open_serial(master.path, {.stop_bits = 3}, *clock), std::invalid_argument);
}

// What an instrument says while its lines are toggled is no answer to anything.
TEST_F(RealLink, APulseOfTheModemLinesTakesItsTimeAndFlushes) {
  const Master master;
  EXPECT_EQ(::write(master.far, "junk", 4), 4);
  const Time before = clock->now();
  const auto link = open_serial(master.path, {.opening_lines = OpeningLines::rts_pulse}, *clock);
  EXPECT_GE(clock->now() - before, 100ms);
  EXPECT_LT(clock->now() - before, 400ms);
  EXPECT_EQ(::write(master.far, "!", 1), 1);
  EXPECT_EQ(link->read(9, 1s), bytes("!"));
}

TEST_F(RealLink, FindsNothingWhereNothingIs) {
  EXPECT_EQ(kind_of([&] { open("serial:/dev/no_such_port"); }), DeviceErrorKind::not_found);
  EXPECT_EQ(kind_of([&] { open("serial:/dev/null"); }), DeviceErrorKind::not_found);
  EXPECT_EQ(kind_of([&] { open("tcp:127.0.0.1:1"); }), DeviceErrorKind::not_found);
}

TEST_F(RealLink, ThrowsForWhatIsNoAddress) {
  for (const char* bad :
       {"", "serial", "serial:", ":5025", "usb:1234:5678", "tcp:host", "tcp:host:", "tcp::80",
        "tcp:host:port", "tcp:host:70000", "tcp:host:0", "tcp:::1:80", "emulated"})
    EXPECT_THROW(open(bad), std::invalid_argument) << bad;
}

TEST_F(RealLink, TakesAnAddressOfTheSixthVersionInBrackets) {
  EXPECT_EQ(kind_of([&] { open("tcp:[::1]:1"); }), DeviceErrorKind::not_found);
}

/// The kernel's listing as it is in /sys, in a folder: the numbers stand above the port, at the USB
/// device.
struct KernelListing : ::testing::Test {
  KernelListing() {
    std::string name = (fs::temp_directory_path() / "vitreo_ports_XXXXXX").string();
    root = mkdtemp(name.data());
    fs::create_directories(root / "class/tty");
  }
  ~KernelListing() override { fs::remove_all(root); }
  /// `device`: where the kernel has it, below the folder; null: a terminal without a device.
  void add(const std::string& port, const char* device) {
    fs::create_directories(root / "class/tty" / port);
    if (device == nullptr) return;
    fs::create_directories(root / device / "driver");
    fs::create_directory_symlink(root / device, root / "class/tty" / port / "device");
  }
  void write(const char* file, const std::string& text) {
    std::ofstream(root / file) << text << "\n";
  }
  std::vector<SerialPort> ports() const { return list_serial_ports(root / "class/tty"); }
  fs::path root;
};

TEST_F(KernelListing, TellsWhatTheAdapterOfASerialPortSaysOfItself) {
  add("ttyUSB0", "devices/usb1/1-2/1-2:1.0/ttyUSB0");
  write("devices/usb1/1-2/idVendor", "0403");
  write("devices/usb1/1-2/idProduct", "6001");
  write("devices/usb1/1-2/bcdDevice", "0600");
  write("devices/usb1/1-2/manufacturer", "FTDI");
  write("devices/usb1/1-2/product", "FT232R USB UART");
  write("devices/usb1/1-2/serial", "A50285BI");
  add("ttyACM1", "devices/usb1/1-3/1-3:1.0");
  write("devices/usb1/1-3/idVendor", "1342");
  write("devices/usb1/1-3/idProduct", "0001");
  add("ttyS0", "devices/pnp0/00:01");
  add("tty7", nullptr);
  const auto found = ports();
  ASSERT_EQ(found.size(), 3U) << "a console is no serial port";
  EXPECT_EQ(found[0].node, "/dev/ttyACM1");
  ASSERT_TRUE(found[0].usb);
  EXPECT_EQ(found[0].usb->vendor, 0x1342);
  EXPECT_EQ(found[0].usb->serial, "");
  EXPECT_EQ(found[1].node, "/dev/ttyS0");
  EXPECT_FALSE(found[1].usb);
  ASSERT_TRUE(found[2].usb);
  EXPECT_EQ(found[2].usb->vendor, 0x0403);
  EXPECT_EQ(found[2].usb->product, 0x6001);
  EXPECT_EQ(found[2].usb->release, 0x0600);
  EXPECT_EQ(found[2].usb->manufacturer + "/" + found[2].usb->name, "FTDI/FT232R USB UART");
  EXPECT_EQ(found[2].usb->serial, "A50285BI");
  EXPECT_EQ(found[2].usb->place, "1-2");
}

TEST_F(KernelListing, IsEmptyWhereThereIsNone) {
  EXPECT_TRUE(ports().empty());
  EXPECT_TRUE(list_serial_ports(root / "nowhere").empty());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
