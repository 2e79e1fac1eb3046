// SPDX-License-Identifier: MIT
#include "tarsier/core/base64.h"

#include <gtest/gtest.h>

namespace tarsier {
namespace {

std::string decoded(std::string_view text) {
  const auto bytes = from_base64(text);
  return bytes ? std::string(bytes->begin(), bytes->end()) : "refused";
}

// The test vectors of RFC 4648, section 10.
TEST(Base64, MatchesTheExamplesOfRfc4648) {
  for (const auto& [bytes, text] : {std::pair{"", ""},
                                    {"f", "Zg=="},
                                    {"fo", "Zm8="},
                                    {"foo", "Zm9v"},
                                    {"foob", "Zm9vYg=="},
                                    {"fooba", "Zm9vYmE="},
                                    {"foobar", "Zm9vYmFy"}}) {
    EXPECT_EQ(to_base64(std::string_view(bytes)), text);
    EXPECT_EQ(decoded(text), bytes);
  }
}

TEST(Base64, RoundTripsAllBytes) {
  std::vector<std::uint8_t> bytes;
  for (int i = 0; i < 1000; ++i) {
    EXPECT_EQ(base64_size(to_base64(bytes)), bytes.size());
    EXPECT_EQ(from_base64(to_base64(bytes)), bytes);
    bytes.push_back(static_cast<std::uint8_t>(i * 37 + i / 256));
  }
  EXPECT_EQ(to_base64(std::vector<std::uint8_t>{0xFB, 0xEF, 0xFF}), "++//");
}

TEST(Base64, RefusesInvalidText) {
  for (const char* text : {"A", "AA", "AAA", "AAAAA", "=", "====", "A===", "=AAA", "A=AA", "AA=A",
                           "AA*A", "AA-_", "AAA ", "AA\n=", "AA==AAAA", "AAA=AAAA",
                           "\xC3\xA4"
                           "AA"}) {
    EXPECT_EQ(decoded(text), "refused") << text;
  }
}

TEST(Base64, RefusesOutputOfAnotherSize) {
  std::vector<std::uint8_t> bytes(2);
  EXPECT_TRUE(from_base64("Zm8=", bytes));
  EXPECT_FALSE(from_base64("Zm9v", bytes));
  EXPECT_FALSE(from_base64("Zg==", bytes));
  EXPECT_FALSE(from_base64("", bytes));
}

}  // namespace
}  // namespace tarsier
