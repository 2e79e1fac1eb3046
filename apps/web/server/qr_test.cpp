// SPDX-License-Identifier: MIT
#include "qr.h"

#include "tarsier/media/sha256.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

namespace tarsier::web {
namespace {

using testing::ElementsAre;

// The example "01234567" of ISO/IEC 18004, annex I: version 1, level M.
TEST(QrCode, ErrorCorrectionMatchesTheStandardsExample) {
  EXPECT_THAT(qr_error_correction({0x10, 0x20, 0x0c, 0x56, 0x61, 0x80, 0xec, 0x11, 0xec, 0x11, 0xec,
                                   0x11, 0xec, 0x11, 0xec, 0x11},
                                  10),
              ElementsAre(0xa5, 0x24, 0xd4, 0xc1, 0xed, 0x36, 0xc7, 0x87, 0x2c, 0x55));
}

// Tables C.1 and D.1 of the standard.
TEST(QrCode, FormatAndVersionBits) {
  EXPECT_EQ(qr_format_bits(0), 0x77c4U);
  EXPECT_EQ(qr_format_bits(1), 0x72f3U);
  EXPECT_EQ(qr_format_bits(4), 0x662fU);
  EXPECT_EQ(qr_format_bits(7), 0x6976U);
  EXPECT_EQ(qr_version_bits(7), 0x07c94U);
  EXPECT_EQ(qr_version_bits(10), 0x0a4d3U);
}

TEST(QrCode, ChoosesTheSmallestVersion) {
  EXPECT_EQ(make_qr_code("").size, 21);
  EXPECT_EQ(make_qr_code(std::string(17, 'a')).size, 21);
  EXPECT_EQ(make_qr_code(std::string(18, 'a')).size, 25);
  EXPECT_EQ(make_qr_code(std::string(106, 'a')).size, 37);
  EXPECT_EQ(make_qr_code(std::string(230, 'a')).size, 53);
  EXPECT_EQ(make_qr_code(std::string(231, 'a')).size, 57);
  EXPECT_EQ(make_qr_code(std::string(271, 'a')).size, 57);
  EXPECT_THROW((void)make_qr_code(std::string(272, 'a')), std::invalid_argument);
}

// The modules of another encoder, qrencode 4.1.1, which takes the same mask for these texts:
// `qrencode -8 -l L -m 0 -t ASCII`, "1" for dark, row by row, and the SHA-256 of that. Version 9
// has two blocks, two groups of alignment patterns, and its version written out. (zbarimg decodes
// these and shorter codes; Debian's OpenCV is built without its decoder.)
TEST(QrCode, MatchesAnotherEncoder) {
  const auto sum_of = [](const QrCode& code) {
    Sha256 sum;
    for (int row = 0; row < code.size; ++row) {
      for (int column = 0; column < code.size; ++column) sum.add(code.at(row, column) ? "1" : "0");
    }
    return sum.hex();
  };
  EXPECT_EQ(sum_of(make_qr_code("https://192.168.100.100:8765/#t=" + std::string(64, 'e'))),
            "26fc3bdae748aef3ea2b80c1b4da64cd727adb89af3bd555ccc5f7207e353f0e");
  EXPECT_EQ(
      sum_of(make_qr_code("https://studio.example/#t=0123456789abcdef?" + std::string(160, 'x'))),
      "4137c31eea58055a9ffcfc454467462a177d3da0277af2eb1a650c498aceb135");
}

TEST(QrCode, DrawsLinesOfHalfBlocks) {
  const QrCode code = make_qr_code("a");
  const std::string text = draw_qr_code(code);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), (code.size + 4 + 1) / 2);
}

}  // namespace
}  // namespace tarsier::web
