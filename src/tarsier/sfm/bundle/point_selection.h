// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <vector>

namespace tarsier::sfm {

// The role of an image in an adjustment. kLocal: it moves, and shares points only with anchors and
// with images near it in the model's order.
enum class ImageRole : char { kFixed, kMoving, kAnchor, kLocal };

// The role of each image, where `images` move and at most `limit` observations of a point are used
// (0: all). With many images, every k-th is an anchor, with at most kMaxAnchors, and the others are
// kLocal. The equations of thousands of cameras around one object then stay sparse. This is not
// done where it would keep less than half of the observations, because consecutive images show
// different things.
constexpr int kMaxAnchors = 300;
[[nodiscard]] std::vector<ImageRole> image_roles(const Model& model, const std::vector<int>& images,
                                                 int limit);

// Selects the observations of a point that an adjustment uses, at most `limit` (0: all). `chosen`
// is overwritten, in the order of the track. The selection differs from point to point, so that no
// image loses more than others.
// - Images that move and fixed images are each spread evenly over the track. All of a few moving
//   images are used, and a quarter of the limit is reserved for fixed images, where there are some.
// - With anchors, half of the limit is for anchors, spread evenly, and the rest for kLocal images
//   at most kMaxLocalSpan apart. Nothing is selected where only two of a larger number of
//   observations would remain.
constexpr int kMaxLocalSpan = 80;
void choose_observations(const Point& point, int index, const std::vector<ImageRole>& roles,
                         int limit, std::vector<Observation>& chosen);

// Selects a subset of `points` (indices in the model, ascending) that is spread over `images`. Each
// image shows at least `per_image` selected points, or all that it shows of `points`. Points are
// taken in a pseudo-random order, the same in each run. The result is ascending. `limit`: as in
// choose_observations().
[[nodiscard]] std::vector<int> select_points(const Model& model, const std::vector<int>& points,
                                             const std::vector<int>& images, int per_image,
                                             int limit = 0);

}  // namespace tarsier::sfm
