// Pixel formats of GenICam cameras, packed here by hand as the PFNC and GigE Vision lay them out.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/pixels.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <stdexcept>

namespace vitreo::genicam {
namespace VITREO_TEST_FILE {

using Bytes = std::vector<std::uint8_t>;

Pixels of(const char* name, const Bytes& bytes, int width, int height) {
  return decode(*format_of(std::string(name)), bytes, width, height);
}

TEST(GenicamPixels, OfSixteenBitsAreLittleEndianAndRightAligned) {
  const Pixels twelve = of("Mono12", {0xFF, 0x0F, 0x00, 0x08}, 2, 1);
  EXPECT_EQ(twelve.deep.at<std::uint16_t>(0, 0), 0xFFF);
  EXPECT_EQ(twelve.deep.at<std::uint16_t>(0, 1), 0x800);
  EXPECT_EQ(twelve.image.at<std::uint8_t>(0, 0), 255);
  EXPECT_EQ(twelve.image.at<std::uint8_t>(0, 1), 128);
  EXPECT_EQ(of("Mono10", {0xFF, 0x03}, 1, 1).image.at<std::uint8_t>(0, 0), 255);
  EXPECT_EQ(of("Mono16", {0x34, 0x12}, 1, 1).deep.at<std::uint16_t>(0, 0), 0x1234);
}

// 0xABC and 0x123. GigE: AB, then the low nibbles (of the first low), then 12.
TEST(GenicamPixels, PackedByGigEVisionHaveTheirLowBitsBetween) {
  const Pixels pixels = of("Mono12Packed", {0xAB, 0x3C, 0x12}, 2, 1);
  EXPECT_EQ(pixels.deep.at<std::uint16_t>(0, 0), 0xABC);
  EXPECT_EQ(pixels.deep.at<std::uint16_t>(0, 1), 0x123);
  // 0x2AF = 10 1010 1111 and 0x155 = 01 0101 0101.
  const Pixels ten = of("Mono10Packed", {0xAB, 0x13, 0x55}, 2, 1);
  EXPECT_EQ(ten.deep.at<std::uint16_t>(0, 0), 0x2AF);
  EXPECT_EQ(ten.deep.at<std::uint16_t>(0, 1), 0x155);
}

// Dense: the first pixel's low byte, then its high nibble below the second's low one.
TEST(GenicamPixels, PackedDenselyBeginWithTheLowBits) {
  const Pixels pixels = of("Mono12p", {0xBC, 0x3A, 0x12}, 2, 1);
  EXPECT_EQ(pixels.deep.at<std::uint16_t>(0, 0), 0xABC);
  EXPECT_EQ(pixels.deep.at<std::uint16_t>(0, 1), 0x123);
  const Pixels ten = of("Mono10p", {0xFF, 0x03, 0xF0, 0x3F, 0x00}, 4, 1);
  EXPECT_EQ(ten.deep.at<std::uint16_t>(0, 0), 1023);
  EXPECT_EQ(ten.deep.at<std::uint16_t>(0, 1), 0);
  EXPECT_EQ(ten.deep.at<std::uint16_t>(0, 2), 1023);
  EXPECT_EQ(ten.deep.at<std::uint16_t>(0, 3), 0);
}

/// A red, a green and a blue scene under each phase of the mosaic, by the phase's own meaning.
TEST(GenicamPixels, OfAMosaicAreTheColorsOfTheScene) {
  const std::string phases[] = {"RG", "GR", "GB", "BG"};
  const std::string second_rows[] = {"GB", "BG", "RG", "GR"};
  for (std::size_t p = 0; p < 4; ++p) {
    for (const char color : {'R', 'G', 'B'}) {
      Bytes mosaic;
      for (int v = 0; v < 8; ++v)
        for (int u = 0; u < 8; ++u) {
          const char here = (v % 2 == 0 ? phases : second_rows)[p][static_cast<std::size_t>(u % 2)];
          mosaic.push_back(here == color ? 200 : 0);
        }
      const Pixels pixels = of(("Bayer" + phases[p] + "8").c_str(), mosaic, 8, 8);
      ASSERT_EQ(pixels.image.type(), CV_8UC3);
      const auto middle = pixels.image.at<cv::Vec3b>(4, 4);
      const int channel = color == 'B' ? 0 : color == 'G' ? 1 : 2;
      for (int c = 0; c < 3; ++c)
        EXPECT_EQ(middle[c], c == channel ? 200 : 0) << phases[p] << " " << color << " " << c;
    }
  }
}

TEST(GenicamPixels, OfColorAreBlueGreenRed) {
  EXPECT_EQ(of("RGB8", {1, 2, 3}, 1, 1).image.at<cv::Vec3b>(0, 0), cv::Vec3b(3, 2, 1));
  EXPECT_EQ(of("BGR8", {1, 2, 3}, 1, 1).image.at<cv::Vec3b>(0, 0), cv::Vec3b(1, 2, 3));
}

TEST(GenicamPixels, ThatAreTooFewOrUnknownAreRefused) {
  EXPECT_THROW(of("Mono12p", {1, 2}, 2, 1), std::invalid_argument);
  EXPECT_EQ(format_of(std::string("YUV422_8")), nullptr);
  EXPECT_EQ(format_of(0x01080001U)->name, "Mono8");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::genicam
