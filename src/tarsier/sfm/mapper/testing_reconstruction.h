// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/reconstruction.h"

#include <gtest/gtest.h>

#include <cstddef>

namespace tarsier::sfm::test_support {

// Bit for bit.
inline void expect_same(const Reconstruction& a, const Reconstruction& b) {
  EXPECT_EQ(a.log, b.log);
  EXPECT_EQ(a.trust, b.trust);
  ASSERT_EQ(a.models.size(), b.models.size());
  for (std::size_t m = 0; m < a.models.size(); ++m) {
    const Model& one = a.models[m];
    const Model& other = b.models[m];
    ASSERT_EQ(one.points.size(), other.points.size());
    for (std::size_t p = 0; p < one.points.size(); ++p) {
      ASSERT_EQ(one.points[p].position, other.points[p].position);
      ASSERT_EQ(one.points[p].track, other.points[p].track);
      ASSERT_EQ(one.points[p].color, other.points[p].color);
      ASSERT_EQ(one.points[p].error, other.points[p].error);
    }
    for (std::size_t i = 0; i < one.images.size(); ++i) {
      EXPECT_EQ(one.images[i].registered, other.images[i].registered);
      EXPECT_EQ(one.images[i].points, other.images[i].points);
      EXPECT_EQ(one.images[i].features, other.images[i].features);
      if (!one.images[i].registered) continue;
      EXPECT_EQ(one.images[i].pose.rotation, other.images[i].pose.rotation);
      EXPECT_EQ(one.images[i].pose.translation, other.images[i].pose.translation);
    }
  }
  for (std::size_t i = 0; i < a.outcomes.size(); ++i) {
    EXPECT_EQ(a.outcomes[i].model, b.outcomes[i].model);
    EXPECT_EQ(a.outcomes[i].reason, b.outcomes[i].reason);
  }
}

}  // namespace tarsier::sfm::test_support
