// SPDX-License-Identifier: MIT
#include "tarsier/media/sha256.h"

#include "tarsier/core/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

namespace tarsier {
namespace {

std::string sum_of(std::string_view text) {
  Sha256 sum;
  sum.add(text);
  return sum.hex();
}

// The examples of NIST's "Secure Hash Standard" (FIPS 180-4, CSRC examples).
TEST(Sha256, AgreesWithPublishedTestVectors) {
  EXPECT_EQ(sum_of(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sum_of("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sum_of("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sum_of(std::string(1'000'000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(Sha256, DoesNotDependOnTheChunks) {
  std::string text;
  for (int i = 0; i < 1000; ++i) text += static_cast<char>('a' + i % 26);
  const std::string whole = sum_of(text);
  for (const size_t piece : {1, 7, 55, 56, 63, 64, 65, 128, 999}) {
    Sha256 sum;
    for (size_t at = 0; at < text.size(); at += piece)
      sum.add(std::string_view(text).substr(at, piece));
    EXPECT_EQ(sum.hex(), whole) << "pieces of " << piece;
  }
}

TEST(Sha256, ReadsFilesAndNamesUnreadableOne) {
  const std::string path = testing::TempDir() + "tarsier_sha256_test.bin";
  std::ofstream(path, std::ios::binary) << "abc";
  EXPECT_EQ(sha256_of_file(path), sum_of("abc"));
  std::filesystem::remove(path);
  for (const std::string& bad : {path, testing::TempDir()}) {
    try {
      (void)sha256_of_file(bad);
      FAIL() << bad;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), testing::StartsWith(bad));
    }
  }
}

}  // namespace
}  // namespace tarsier
