// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <vector>

namespace tarsier::sfm {

// What an image does in an adjustment. kNear: it moves, and is tied only to anchors and to images near it in the model's
// order.
enum class ImageRole : char { kStays, kMoves, kAnchor, kNear };

// Of each image of the model, where `images` move and a point counts by `limit` observations (0: all). Where these are many,
// every k-th of them is an anchor, so that there are kMaxAnchors at most, and the others are kNear: the equations of
// thousands of cameras around one thing stay sparse. Not so where images that follow each other do not show the same: where
// that would take more than a third of the observations.
constexpr int kMaxAnchors = 300;
[[nodiscard]] std::vector<ImageRole> roles_of(const Model& model, const std::vector<int>& images,
                                              int limit);

// Which observations of a point an adjustment uses, of at most `limit` (0: all). `chosen` is overwritten, in the order of
// the track. Which ones are taken differs from point to point, so that no image loses more than others.
// - Of images that move, and of those that stay, each spread evenly over the track. A few images that move are all taken,
//   and a quarter of the limit is left for images that stay, where there are some.
// - Where there are anchors, half of the limit is theirs, spread evenly, and the rest are images of kNear that are at most
//   kMaxSpan apart. None where that leaves two observations of more.
constexpr int kMaxSpan = 80;
void choose_observations(const Point& point, int index, const std::vector<ImageRole>& roles,
                         int limit, std::vector<Observation>& chosen);

// Of `points` (indices in the model, ascending) a share that is spread over `images`: each of them shows `per_image` of the
// chosen ones at least, or all of `points` that it shows. Points are taken in an order that mixes them, the same in each
// run; what is chosen is ascending. `limit`: observations of a point that count, as in choose_observations().
[[nodiscard]] std::vector<int> select_points(const Model& model, const std::vector<int>& points,
                                             const std::vector<int>& images, int per_image,
                                             int limit = 0);

}  // namespace tarsier::sfm
