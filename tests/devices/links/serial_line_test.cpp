// A serial line's time: bytes one after another, at the distance of their characters.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/serial_line.h"

#include "devices/links/serial_link.h"
#include "devices/links/usb_frames.h"
#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

TEST(SerialLine, ACharacterIsItsStartDataParityAndStopBits) {
  EXPECT_EQ(character_time(1000), 10ms) << "8N1: ten bits";
  EXPECT_EQ(character_time(1000, {.data_bits = 7, .parity = true, .stop_bits = 1}), 10ms);
  EXPECT_EQ(character_time(1000, {.data_bits = 7}), 9ms);
  EXPECT_EQ(character_time(1000, {.parity = true, .stop_bits = 2}), 12ms);
  // 10 / 9600 s, to the nanosecond.
  EXPECT_EQ(character_time(9600), 1041667ns);
  EXPECT_EQ(character_time(SerialSettings{
                .baud_rate = 1000, .data_bits = 7, .parity = Parity::odd, .stop_bits = 2}),
            11ms);
  EXPECT_THROW(character_time(0), std::invalid_argument);
}

TEST(SerialLine, BytesArriveOneAfterAnotherEachWhenItsLastBitHas) {
  SerialLine line(1ms);
  line.put(bytes("abc"), 10ms);
  EXPECT_EQ(line.next(), 11ms);
  EXPECT_EQ(line.arrived(11ms - 1ns), ByteString{});
  EXPECT_EQ(line.arrived(12ms), bytes("ab"));
  EXPECT_EQ(line.arrived(1s), bytes("c"));
  EXPECT_EQ(line.next(), kForever);
}

TEST(SerialLine, IsBusyUntilTheLastBitEvenWhenTheBytesBeforeWereTaken) {
  SerialLine line(10ms);
  line.put(bytes("ab"), 0ms);
  EXPECT_EQ(line.arrived(20ms), bytes("ab"));
  line.put(bytes("c"), 15ms);  // handed over late by who asks, but sent while it was busy
  EXPECT_EQ(line.next(), 30ms);
  line.put(bytes("d"), 100ms);
  EXPECT_EQ(line.arrived(109ms), bytes("c"));
  EXPECT_EQ(line.next(), 110ms) << "a line that was idle begins at once";
}

TEST(SerialLine, LatencyDelaysAndLatenessNeverOvertakes) {
  SerialLine line(1ms, 5ms);
  line.put(bytes("a"), 0ms);
  EXPECT_EQ(line.next(), 6ms);
  line.put(bytes("b"), 0ms, 20ms);
  line.put(bytes("c"), 0ms);
  EXPECT_EQ(line.arrived(26ms), bytes("a"));
  EXPECT_EQ(line.arrived(27ms), bytes("bc")) << "the late one, and the one behind it";
}

TEST(UsbFrames, OneTransferAFrameFromTheNextFrameOn) {
  UsbFrames endpoint;
  EXPECT_EQ(endpoint.next(0ms), 1ms);
  EXPECT_EQ(endpoint.next(400us), 2ms) << "the first frame is taken";
  EXPECT_EQ(endpoint.next(10ms + 300us), 11ms);
  UsbFrames slow(8ms);
  EXPECT_EQ(slow.next(9ms), 16ms);
  UsbFrames none(0ms);
  EXPECT_EQ(none.next(9ms), 9ms);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
