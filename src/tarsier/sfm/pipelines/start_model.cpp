// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/start_model.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <set>
#include <string_view>
#include <tuple>
#include <utility>

namespace tarsier::sfm {

StartModel::StartModel(const std::string& folder, const std::vector<Input>& inputs)
    : folder_(folder), model_(read_colmap_poses(folder)) {
  std::map<std::string_view, int> known;
  for (std::size_t i = 0; i < model_.images.size(); ++i)
    known[model_.images[i].name] = static_cast<int>(i);
  for (const Input& input : inputs) {
    const auto found = known.find(input.name);
    if (found != known.end()) index_[input.name] = found->second;
  }
  summary_.folder = folder;
  summary_.images = static_cast<int>(model_.images.size());
  summary_.in_inputs = static_cast<int>(index_.size());
  if (summary_.in_inputs < 2) {
    const std::string names =
        model_.images.empty() || inputs.empty()
            ? ""
            : fmt::format(" (a name in the model: '{}'; in the inputs: '{}')",
                          printable(model_.images[0].name), printable(inputs[0].name));
    throw InputError(folder, fmt::format("{} of the {} images of this model {} among the inputs by "
                                         "name, two or more are needed{}",
                                         summary_.in_inputs, summary_.images,
                                         summary_.in_inputs == 1 ? "is" : "are", names));
  }
  for (const auto& [name, i] : index_) {
    const geometry::Camera& camera = model_.cameras[at(model_.images[at(i)].camera)];
    if (camera.lens != geometry::Lens::kPinhole) {
      throw InputError(folder, fmt::format("'{}' has a {} lens, but reconstruction needs a pinhole "
                                           "camera: undistort the images first",
                                           printable(name), geometry::name_of(camera.lens)));
    }
  }
  if (summary_.in_inputs < summary_.images) {
    const auto missing =
        std::find_if(model_.images.begin(), model_.images.end(),
                     [&](const Image& image) { return !index_.contains(image.name); });
    log_warning(
        "{}: {} of {} images of this model are not among the inputs, for example '{}' (left out)",
        folder, summary_.images - summary_.in_inputs, summary_.images, printable(missing->name));
  }
}

const Image* StartModel::find(const std::string& name) const {
  const auto found = index_.find(name);
  return found == index_.end() ? nullptr : &model_.images[at(found->second)];
}

std::optional<cv::Size> StartModel::size_of(const std::string& name) const {
  const Image* image = find(name);
  if (image == nullptr) return std::nullopt;
  const geometry::Camera& camera = model_.cameras[at(image->camera)];
  return cv::Size(camera.width, camera.height);
}

void StartModel::check_size(const Input& input, cv::Size size) const {
  const std::optional<cv::Size> expected = size_of(input.name);
  if (!expected || *expected == size) return;
  throw InputError(
      input.path.empty() ? input.name : input.path,
      fmt::format("the image has {}x{} px, but its camera in {} has {}x{} px", size.width,
                  size.height, folder_, expected->width, expected->height));
}

std::vector<char> StartModel::set_lenses(const std::vector<Input>& inputs,
                                         std::vector<ImageFeatures>& images) const {
  // For images of one size, make and first guess: their camera in the model; -1: several.
  using Kind = std::tuple<int, int, double, double, double, std::string, std::string>;
  const auto kind_of = [](const ImageFeatures& image) {
    const geometry::Camera& camera = image.lens.camera;
    return Kind(image.size.width, image.size.height, camera.fx, camera.fy, camera.distortion[0],
                image.lens.source, image.body);
  };
  std::map<Kind, int> cameras;
  std::vector<int> camera_of(images.size(), -1);
  for (std::size_t k = 0; k < images.size(); ++k) {
    const Image* image = find(inputs[at(images[k].input)].name);
    if (image == nullptr) continue;
    camera_of[k] = image->camera;
    const auto [entry, is_new] = cameras.try_emplace(kind_of(images[k]), image->camera);
    if (!is_new && entry->second != image->camera) entry->second = -1;
  }
  for (std::size_t k = 0; k < images.size(); ++k) {
    if (camera_of[k] < 0 && std::string_view(images[k].lens.source) != "given") {
      const auto found = cameras.find(kind_of(images[k]));
      if (found != cameras.end()) camera_of[k] = found->second;
    }
  }
  std::vector<char> is_set(images.size(), 0);
  for (std::size_t k = 0; k < images.size(); ++k) {
    if (camera_of[k] < 0) continue;
    is_set[k] = 1;
    images[k].lens = {model_.cameras[at(camera_of[k])], "given"};
    // Images share a camera where they do in the model.
    images[k].body = fmt::format("camera {} of {}", camera_of[k], folder_);
  }
  return is_set;
}

StartPoses StartModel::poses(const std::vector<Input>& inputs,
                             const std::vector<ImageFeatures>& images,
                             const std::vector<int>& cameras, bool fixed,
                             bool refines_lenses) const {
  StartPoses start;
  start.fixed = fixed;
  std::set<int> of_model;
  for (std::size_t k = 0; k < images.size(); ++k) {
    const Image* image = find(inputs[at(images[k].input)].name);
    start.poses.emplace_back();
    if (image == nullptr) continue;
    start.poses.back() = image->pose;
    of_model.insert(cameras[k]);
  }
  if (!refines_lenses) start.fixed_cameras.assign(of_model.begin(), of_model.end());
  return start;
}

}  // namespace tarsier::sfm
