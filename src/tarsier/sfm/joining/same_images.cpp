// SPDX-License-Identifier: MIT
#include "tarsier/core/at.h"
#include "tarsier/sfm/global/view_graph.h"
#include "tarsier/sfm/joining/join_models.h"

#include <cstddef>
#include <map>
#include <string>
#include <utility>

namespace tarsier::sfm {
std::vector<Model> with_same_images(const std::vector<Model>& models) {
  // Joins cameras, numbered over all models, that are the same according to their images.
  std::vector<int> first_camera;
  std::vector<const geometry::Camera*> all;
  for (const Model& model : models) {
    first_camera.push_back(static_cast<int>(all.size()));
    for (const geometry::Camera& camera : model.cameras) all.push_back(&camera);
  }
  Components same(all.size());
  std::map<std::string, int> index;  // by name
  std::vector<std::string> names;
  std::vector<int> camera_of;  // for each image: index into `all`
  for (std::size_t m = 0; m < models.size(); ++m) {
    for (const Image& image : models[m].images) {
      const int camera = first_camera[m] + image.camera;
      const auto [entry, is_new] = index.try_emplace(image.name, static_cast<int>(names.size()));
      if (is_new) {
        names.push_back(image.name);
        camera_of.push_back(camera);
        continue;
      }
      const geometry::Camera& a = *all[at(camera)];
      const geometry::Camera& b = *all[at(camera_of[at(entry->second)])];
      if (a.width == b.width && a.height == b.height && a.lens == b.lens)
        (void)same.join(camera, camera_of[at(entry->second)]);
    }
  }
  std::map<int, int> number;  // by root
  std::vector<int> cameras;   // the first one of each set
  for (std::size_t c = 0; c < all.size(); ++c) {
    const int root = same.root(static_cast<int>(c));
    if (number.try_emplace(root, static_cast<int>(cameras.size())).second)
      cameras.push_back(static_cast<int>(c));
  }
  std::vector<Model> result;
  for (std::size_t m = 0; m < models.size(); ++m) {
    Model& merged = result.emplace_back();
    for (const int camera : cameras) merged.cameras.push_back(*all[at(camera)]);
    for (std::size_t c = 0; c < models[m].cameras.size(); ++c)
      merged.cameras[at(number.at(same.root(first_camera[m] + static_cast<int>(c))))] =
          models[m].cameras[c];
    merged.images.resize(names.size());
    for (std::size_t i = 0; i < names.size(); ++i) {
      merged.images[i].name = names[i];
      merged.images[i].camera = number.at(same.root(camera_of[i]));
    }
    std::vector<int> new_index(models[m].images.size(), -1);
    for (std::size_t i = 0; i < models[m].images.size(); ++i) {
      const Image& given = models[m].images[i];
      const int to = index.at(given.name);
      if (number.at(same.root(first_camera[m] + given.camera)) != merged.images[at(to)].camera)
        continue;
      new_index[i] = to;
      const int camera = merged.images[at(to)].camera;
      merged.images[at(to)] = given;
      merged.images[at(to)].camera = camera;
      merged.images[at(to)].points.assign(given.features.size(), -1);
    }
    for (const Point& point : models[m].points) {
      Point copy = point;
      copy.track.clear();
      for (const Observation& seen : point.track)
        if (new_index[at(seen.image)] >= 0)
          copy.track.push_back({new_index[at(seen.image)], seen.feature});
      if (copy.track.size() < 2) continue;
      for (const Observation& seen : copy.track)
        merged.images[at(seen.image)].points[at(seen.feature)] =
            static_cast<int>(merged.points.size());
      merged.points.push_back(std::move(copy));
    }
  }
  return result;
}

}  // namespace tarsier::sfm
