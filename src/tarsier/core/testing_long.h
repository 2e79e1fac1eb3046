// SPDX-License-Identifier: MIT
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>

// First in a test that takes long: it is left out unless `./test --all` runs.
#define TARSIER_LONG_TEST() \
  if (std::getenv("TARSIER_TEST_ALL") == nullptr) GTEST_SKIP() << "long: ./test --all runs it"
