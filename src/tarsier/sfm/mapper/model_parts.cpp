// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/model_parts.h"

#include "tarsier/core/at.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMinTrackLength = 3;  // for points that lose observations

// The parts of a model, grown image by image.
class PartFinder {
 public:
  PartFinder(const Model& model, int min_common)
      : model_(model), min_common_(min_common), points_of_(model.images.size()) {
    for (std::size_t p = 0; p < model.points.size(); ++p)
      for (const Observation& seen : model.points[p].track) points_of_[at(seen.image)].push_back(p);
  }

  // The part that starts with `first` and the image that has most points in common with it.
  [[nodiscard]] std::vector<int> part_of(int first) const {
    std::vector<int> part;
    std::vector<char> is_in(points_of_.size(), 0);
    // per point: number of images of the part that show it, at most 2
    std::vector<char> views(model_.points.size(), 0);
    // per image: number of its points that two images of the part show
    std::vector<int> known(points_of_.size(), 0);
    std::vector<int> next{first};
    if (const int second = nearest(first); second >= 0) next.push_back(second);
    for (std::size_t k = 0; k < next.size(); ++k) {
      const int image = next[k];
      if (is_in[at(image)] != 0) continue;
      is_in[at(image)] = 1;
      part.push_back(image);
      for (const std::size_t p : points_of_[at(image)]) {
        if (views[p] == 2 || ++views[p] < 2) continue;
        for (const Observation& seen : model_.points[p].track)
          if (++known[at(seen.image)] == min_common_) next.push_back(seen.image);
      }
    }
    return part;
  }

 private:
  // The image with most common points; -1 where no image has enough.
  [[nodiscard]] int nearest(int image) const {
    std::vector<int> common(points_of_.size(), 0);
    int best = -1;
    for (const std::size_t p : points_of_[at(image)])
      for (const Observation& seen : model_.points[p].track)
        if (seen.image != image) ++common[at(seen.image)];
    for (std::size_t i = 0; i < common.size(); ++i)
      if (common[i] >= min_common_ && (best < 0 || common[i] > common[at(best)]))
        best = static_cast<int>(i);
    return best;
  }

  const Model& model_;
  int min_common_;
  std::vector<std::vector<std::size_t>> points_of_;  // for each image
};

}  // namespace

Model model_with_features(const std::vector<geometry::Camera>& cameras,
                          const std::vector<Image>& images, const std::vector<char>& has_features) {
  Model model;
  model.cameras = cameras;
  model.images.resize(images.size());
  for (std::size_t i = 0; i < images.size(); ++i) {
    Image& image = model.images[i];
    if (has_features[i] != 0) {
      image = images[i];
    } else {
      image.name = images[i].name;
      image.camera = images[i].camera;
    }
  }
  return model;
}

std::vector<int> feature_counts(const Model& model) {
  std::vector<int> counts;
  counts.reserve(model.images.size());
  for (const Image& image : model.images) counts.push_back(static_cast<int>(image.features.size()));
  return counts;
}

int keep_largest_part(Model& model, int min_common) {
  const PartFinder finder(model, min_common);
  std::vector<char> is_covered(model.images.size(), 0);
  std::vector<int> best;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    if (!model.images[i].registered || is_covered[i] != 0) continue;
    std::vector<int> part = finder.part_of(static_cast<int>(i));
    for (const int image : part) is_covered[at(image)] = 1;
    if (part.size() > best.size()) best = std::move(part);
  }
  std::vector<char> is_kept(model.images.size(), 0);
  for (const int image : best) is_kept[at(image)] = 1;
  int left_out = 0;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    Image& image = model.images[i];
    if (!image.registered || is_kept[i] != 0) continue;
    ++left_out;
    Image empty;
    empty.name = image.name;
    empty.camera = image.camera;
    image = std::move(empty);
  }
  if (left_out == 0) return 0;
  std::size_t remaining = 0;
  for (Point& point : model.points) {
    const std::size_t before = point.track.size();
    std::erase_if(point.track, [&](const Observation& seen) {
      return !model.images[at(seen.image)].registered;
    });
    const bool stays = point.track.size() == before || point.track.size() >= kMinTrackLength;
    for (const Observation& seen : point.track)
      model.images[at(seen.image)].points[at(seen.feature)] =
          stays ? static_cast<int>(remaining) : -1;
    if (!stays) continue;
    if (&point != &model.points[remaining]) model.points[remaining] = std::move(point);
    ++remaining;
  }
  model.points.resize(remaining);
  return left_out;
}

}  // namespace tarsier::sfm
