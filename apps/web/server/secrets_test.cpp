// SPDX-License-Identifier: MIT
#include "secrets.h"

#include "tarsier/media/http_service.h"

#include <gtest/gtest.h>

#include <cstring>
#include <string>
#include <sys/mman.h>
#include <unistd.h>

namespace tarsier::web {
namespace {

TEST(Secrets, AreDifferentAndLookLikeSecrets) {
  const std::string one = new_secret();
  EXPECT_TRUE(looks_like_secret(one));
  EXPECT_NE(one, new_secret());
  EXPECT_NE(hash_of(one), one);
  EXPECT_TRUE(looks_like_secret(hash_of(one)));
}

TEST(Secrets, EqualOnlyTheirCopies) {
  const std::string secret = new_secret();
  EXPECT_TRUE(equals_in_constant_time(std::string(secret), secret));
  for (std::size_t i = 0; i < secret.size(); ++i) {
    std::string wrong = secret;
    wrong[i] = 'x';
    EXPECT_FALSE(equals_in_constant_time(wrong, secret)) << i;
  }
  EXPECT_FALSE(equals_in_constant_time(secret + "0", secret));
  EXPECT_FALSE(equals_in_constant_time(secret.substr(0, 63), secret));
  EXPECT_FALSE(equals_in_constant_time("", secret));
  EXPECT_TRUE(equals_in_constant_time("", ""));
}

// The second half of this secret cannot be read: who compares to its end must fail there, also
// where the first character is wrong already.
TEST(SecretsDeathTest, AreComparedToTheEnd) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  void* memory =
      ::mmap(nullptr, 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(memory, MAP_FAILED);
  std::memset(memory, 'a', 2 * page);
  ASSERT_EQ(::mprotect(static_cast<char*>(memory) + page, page, PROT_NONE), 0);
  const std::string_view secret(static_cast<const char*>(memory), 2 * page);
  EXPECT_DEATH((void)equals_in_constant_time(std::string(2 * page, 'x'), secret), "");
  EXPECT_DEATH((void)equals_in_constant_time("x", secret), "");
  ::munmap(memory, 2 * page);
}

}  // namespace
}  // namespace tarsier::web
