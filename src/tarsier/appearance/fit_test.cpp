// SPDX-License-Identifier: MIT
#include "tarsier/appearance/fit.h"

#include <gtest/gtest.h>
