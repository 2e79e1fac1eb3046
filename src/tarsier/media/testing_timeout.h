// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>

namespace tarsier::test_support {

// Long enough for any machine; only a failing test waits this long.
inline constexpr std::chrono::seconds kTimeout{300};

}  // namespace tarsier::test_support
