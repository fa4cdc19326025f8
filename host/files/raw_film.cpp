// SPDX-License-Identifier: Apache-2.0
#include "host/files/raw_film.h"

#include <stdexcept>

namespace vitreo {
namespace {

// Identifiers of elements (RFC 8794; RFC 9559, section 5.1).
constexpr std::uint32_t kEbml = 0x1A45DFA3;
constexpr std::uint32_t kEbmlVersion = 0x4286;
constexpr std::uint32_t kEbmlReadVersion = 0x42F7;
constexpr std::uint32_t kDocType = 0x4282;
constexpr std::uint32_t kDocTypeVersion = 0x4287;
constexpr std::uint32_t kDocTypeReadVersion = 0x4285;
constexpr std::uint32_t kSegment = 0x18538067;
constexpr std::uint32_t kInfo = 0x1549A966;
constexpr std::uint32_t kTimestampScale = 0x2AD7B1;
constexpr std::uint32_t kMuxingApp = 0x4D80;
constexpr std::uint32_t kWritingApp = 0x5741;
constexpr std::uint32_t kTracks = 0x1654AE6B;
constexpr std::uint32_t kTrackEntry = 0xAE;
constexpr std::uint32_t kTrackNumber = 0xD7;
constexpr std::uint32_t kTrackUid = 0x73C5;
constexpr std::uint32_t kTrackType = 0x83;
constexpr std::uint32_t kCodecId = 0x86;
constexpr std::uint32_t kVideo = 0xE0;
constexpr std::uint32_t kPixelWidth = 0xB0;
constexpr std::uint32_t kPixelHeight = 0xBA;
constexpr std::uint32_t kUncompressedFourCc = 0x2EB524;
constexpr std::uint32_t kCluster = 0x1F43B675;
constexpr std::uint32_t kTimestamp = 0xE7;
constexpr std::uint32_t kSimpleBlock = 0xA3;
// TimestampScale: what one unit of all times in the film is.
constexpr std::uint64_t kMicrosecond = 1000;  // ns

// Big-endian, as everything in EBML.
std::string number(std::uint64_t value, int bytes) {
  std::string text;
  for (int i = bytes - 1; i >= 0; --i) text += static_cast<char>(value >> 8 * i & 0xFF);
  return text;
}

/// An identifier has its length in its first bits, so it is written as it stands above.
std::string id_text(std::uint32_t id) {
  return number(id, id > 0xFFFFFF ? 4 : id > 0xFFFF ? 3 : id > 0xFF ? 2 : 1);
}

/// Identifier and size, in the longest form: a leading 1 and seven bytes.
std::string element_head(std::uint32_t id, std::uint64_t size) {
  return id_text(id) + number(size | std::uint64_t{1} << 56, 8);
}
std::string element(std::uint32_t id, const std::string& content) {
  return element_head(id, content.size()) + content;
}
std::string element(std::uint32_t id, std::uint64_t value) { return element(id, number(value, 8)); }

/// The codes by which FFmpeg knows raw pixels: gray, gray16le and bgr24.
std::string four_cc(RawPixels pixels) {
  switch (pixels) {
    case RawPixels::gray8:
      return "Y800";
    case RawPixels::gray16:
      return {'Y', '1', 0, 16};
    case RawPixels::bgr8:
      return {'B', 'G', 'R', 24};
  }
  throw std::invalid_argument("pixels: are of no kind that is known");
}

}  // namespace

// The segment's size is not known: all ones, which the format has for streams.
std::string raw_film_head(int width_px, int height_px, RawPixels pixels) {
  const std::string video = element(kPixelWidth, static_cast<std::uint64_t>(width_px)) +
                            element(kPixelHeight, static_cast<std::uint64_t>(height_px)) +
                            element(kUncompressedFourCc, four_cc(pixels));
  constexpr std::uint64_t kIsVideo = 1;
  const std::string track =
      element(kTrackNumber, 1) + element(kTrackUid, 1) + element(kTrackType, kIsVideo) +
      element(kCodecId, std::string("V_UNCOMPRESSED")) + element(kVideo, video);
  return element(kEbml, element(kEbmlVersion, 1) + element(kEbmlReadVersion, 1) +
                            element(kDocType, std::string("matroska")) +
                            element(kDocTypeVersion, 4) + element(kDocTypeReadVersion, 2)) +
         id_text(kSegment) + number(0x01FFFFFFFFFFFFFF, 8) +
         element(kInfo, element(kTimestampScale, kMicrosecond) +
                            element(kMuxingApp, std::string("vitreo")) +
                            element(kWritingApp, std::string("vitreo"))) +
         element(kTracks, element(kTrackEntry, track));
}

// A cluster for each frame: its time is absolute, and the block's own, which has 16 bits, is 0.
std::string raw_film_frame_head(std::uint64_t time_us, std::uint64_t bytes) {
  const std::string time = element(kTimestamp, time_us);
  // Track 1, time 0, a key frame.
  const std::string block{'\x81', 0, 0, '\x80'};
  const std::string block_head = element_head(kSimpleBlock, block.size() + bytes) + block;
  return element_head(kCluster, time.size() + block_head.size() + bytes) + time + block_head;
}

}  // namespace vitreo
