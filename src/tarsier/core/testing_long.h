// SPDX-License-Identifier: MIT
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>

// The first line of a long test: the test is skipped unless `./test --all` runs.
#define TARSIER_LONG_TEST() \
  if (std::getenv("TARSIER_TEST_ALL") == nullptr) GTEST_SKIP() << "long: ./test --all runs it"
