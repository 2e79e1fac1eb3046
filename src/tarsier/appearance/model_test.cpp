// SPDX-License-Identifier: MIT
#include "tarsier/appearance/model.h"

#include <gtest/gtest.h>
