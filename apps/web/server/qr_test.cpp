// SPDX-License-Identifier: MIT
#include "qr.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tarsier::web {
namespace {

using testing::ElementsAre;

// The example "01234567" of ISO/IEC 18004, annex I: version 1, level M.
TEST(QrCode, ErrorCorrectionOfTheStandardsExample) {
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

TEST(QrCode, TakesTheSmallestVersion) {
  EXPECT_EQ(make_qr_code("").size, 21);
  EXPECT_EQ(make_qr_code(std::string(17, 'a')).size, 21);
  EXPECT_EQ(make_qr_code(std::string(18, 'a')).size, 25);
  EXPECT_EQ(make_qr_code(std::string(106, 'a')).size, 37);
  EXPECT_EQ(make_qr_code(std::string(230, 'a')).size, 53);
  EXPECT_EQ(make_qr_code(std::string(231, 'a')).size, 57);
  EXPECT_EQ(make_qr_code(std::string(271, 'a')).size, 57);
  EXPECT_THROW((void)make_qr_code(std::string(272, 'a')), std::invalid_argument);
}

// Reads a code back: format, mask, the way of the bits, blocks. Nothing is repaired.
std::string read_back(const QrCode& code) {
  unsigned format = 0;
  for (int i = 0; i < 8; ++i)
    format |= static_cast<unsigned>(code.at(8, code.size - 1 - i)) << static_cast<unsigned>(i);
  for (int i = 8; i < 15; ++i)
    format |= static_cast<unsigned>(code.at(code.size - 15 + i, 8)) << static_cast<unsigned>(i);
  int mask = -1;
  for (int i = 0; i < 8; ++i) mask = qr_format_bits(i) == format ? i : mask;
  if (mask < 0) return "no format";
  const int version = (code.size - 17) / 4;
  const int last = code.size - 1;
  const auto is_function = [&](int row, int column) {
    if (row == 6 || column == 6) return true;
    if ((row <= 8 && column <= 8) || (row <= 8 && column >= last - 7) ||
        (row >= last - 7 && column <= 8))
      return true;
    if (version >= 7 && ((row < 6 && column >= last - 10) || (column < 6 && row >= last - 10)))
      return true;
    if (version == 1) return false;
    std::vector<int> centres{6, last - 6};
    if (version >= 7) centres.push_back((6 + last - 6) / 2);
    for (const int y : centres) {
      for (const int x : centres) {
        const bool corner =
            (y == 6 && x == 6) || (y == 6 && x == last - 6) || (y == last - 6 && x == 6);
        if (!corner && std::abs(row - y) <= 2 && std::abs(column - x) <= 2) return true;
      }
    }
    return false;
  };
  const auto masks = [&](int row, int column) {
    switch (mask) {
      case 0:
        return (row + column) % 2 == 0;
      case 1:
        return row % 2 == 0;
      case 2:
        return column % 3 == 0;
      case 3:
        return (row + column) % 3 == 0;
      case 4:
        return (row / 2 + column / 3) % 2 == 0;
      case 5:
        return row * column % 6 == 0;
      case 6:
        return (row * column % 2 + row * column % 3) % 2 == 0;
      default:
        return ((row + column) % 2 + row * column % 3) % 2 == 0;
    }
  };
  std::vector<unsigned> bytes;
  unsigned byte = 0;
  int bits = 0;
  for (int right = last, pair = 0; right > 0; right -= 2, ++pair) {
    if (right == 6) right = 5;
    for (int i = 0; i <= last; ++i) {
      const int row = pair % 2 == 0 ? last - i : i;
      for (const int column : {right, right - 1}) {
        if (is_function(row, column)) continue;
        byte = byte << 1U | static_cast<unsigned>(code.at(row, column) != masks(row, column));
        if (++bits % 8 == 0) {
          bytes.push_back(byte);
          byte = 0;
        }
      }
    }
  }
  // One block up to version 5: the data stand in their order.
  std::string text;
  const unsigned length = (bytes[0] & 15U) << 4U | bytes[1] >> 4U;
  for (unsigned i = 0; i < length; ++i)
    text += static_cast<char>((bytes[i + 1] & 15U) << 4U | bytes[i + 2] >> 4U);
  return text;
}

TEST(QrCode, CanBeReadBack) {
  for (const std::string& text : {std::string("a"), std::string("http://127.0.0.1:8765/"),
                                  "https://192.168.100.100:8765/#t=" + std::string(64, 'e')})
    EXPECT_EQ(read_back(make_qr_code(text)), text);
}

TEST(QrCode, DrawsLinesOfHalfBlocks) {
  const QrCode code = make_qr_code("a");
  const std::string text = draw_qr_code(code);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), (code.size + 4 + 1) / 2);
}

}  // namespace
}  // namespace tarsier::web
