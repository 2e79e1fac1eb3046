// SPDX-License-Identifier: MIT
#include "secrets.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/sha256.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <sys/random.h>

namespace tarsier::web {

std::string new_secret() {
  std::array<unsigned char, 32> bytes{};
  std::size_t have = 0;
  while (have < bytes.size()) {
    const ssize_t count = ::getrandom(bytes.data() + have, bytes.size() - have, 0);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) throw OutputError("getrandom", "no random numbers: " + errno_text(errno));
    have += static_cast<std::size_t>(count);
  }
  std::string text;
  for (const unsigned char byte : bytes) {
    constexpr std::string_view kDigits = "0123456789abcdef";
    text += kDigits[byte >> 4U];
    text += kDigits[byte & 15U];
  }
  return text;
}

std::string hash_of(std::string_view secret) {
  Sha256 sum;
  sum.add(secret);
  return sum.hex();
}

bool looks_like_secret(std::string_view text) {
  return text.size() == 64 && std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

}  // namespace tarsier::web
