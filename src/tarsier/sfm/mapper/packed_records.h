// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/mapper/packed_file.h"
#include "tarsier/sfm/two_view/two_view.h"

// Records shared by several kinds of packed files (packed_file.h). The readers throw Damaged for
// content that no writer produces: numbers that are not finite, lists of wrong length, values out
// of range.
namespace tarsier::sfm {

void put(PackedWriter& writer, const Features& features);
[[nodiscard]] Features get_features(PackedReader& reader);

void put(PackedWriter& writer, const TwoView& view);
[[nodiscard]] TwoView get_two_view(PackedReader& reader);

void put(PackedWriter& writer, const geometry::Camera& camera);
[[nodiscard]] geometry::Camera get_camera(PackedReader& reader);

}  // namespace tarsier::sfm
