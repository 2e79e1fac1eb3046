// SPDX-License-Identifier: MIT
#pragma once

#include "router.h"
#include <chrono>
#include <cstddef>
#include <span>
#include <thread>

namespace tarsier::web {

// Bytes for ever, for tests.
class Endless final : public BodyStream {
 public:
  std::ptrdiff_t read(std::span<char> buffer, int) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    buffer[0] = 'x';
    return 1;
  }
};

}  // namespace tarsier::web
