// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/known_features.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace tarsier::sfm {
namespace {

void add_colors(const cv::Mat& image, Features& features) {
  features.colors.clear();
  for (const cv::Point2f& p : features.points) {
    const int x = std::clamp(cvRound(p.x), 0, image.cols - 1);
    const int y = std::clamp(cvRound(p.y), 0, image.rows - 1);
    features.colors.push_back(image.channels() == 3 ? image.at<cv::Vec3b>(y, x)
                                                    : cv::Vec3b::all(image.at<std::uint8_t>(y, x)));
  }
}

}  // namespace

KnownFeatures::KnownFeatures(const std::string& path)
    : database_(read_colmap_database(path)), sum_(sha256_of_file(path)), path_(path) {
  images_of_camera_.resize(database_.cameras.size());
  for (std::size_t i = 0; i < database_.images.size(); ++i) {
    index_[database_.images[i].name] = static_cast<int>(i);
    ++images_of_camera_[at(database_.images[i].camera)];
  }
}

void KnownFeatures::fill(const Input& input, const cv::Mat& image, ImageFeatures& features,
                         const PipelineOptions& options) {
  const auto found = index_.find(input.name);
  if (found == index_.end())
    throw InputError(input.path.empty() ? input.name : input.path,
                     fmt::format("{} contains no image with this name", path_));
  auto& known = database_.images[at(found->second)];
  const auto& camera = database_.cameras[at(known.camera)];
  if (image.empty()) {
    features.size = {camera.camera.width, camera.camera.height};
    if (options.camera) features.lens = {*options.camera, "given"};
  } else if (camera.camera.width != image.cols || camera.camera.height != image.rows)
    throw InputError(
        input.path,
        fmt::format("the image has {}x{} px, but its camera in {} has {}x{} px", image.cols,
                    image.rows, path_, camera.camera.width, camera.camera.height));
  if (camera.camera.lens != geometry::Lens::kPinhole)
    throw InputError(path_, fmt::format("a camera has a {} lens, but reconstruction needs a "
                                        "pinhole camera: undistort the images first",
                                        geometry::name_of(camera.camera.lens)));
  if (!options.camera) {
    features.lens = {camera.camera, camera.is_focal_known ? "database" : "guess"};
    // COLMAP makes a camera for each image unless its user says which images share one.
    if (images_of_camera_[at(known.camera)] > 1)
      features.body = fmt::format("camera {} of the database", known.camera);
  }
  features.features = std::move(known.features);
  if (image.empty())
    features.features.colors.assign(features.features.points.size(), cv::Vec3b::all(128));
  else
    add_colors(image, features.features);
  // Without files, only the names distinguish images.
  features.key = cache_key(fmt::format("{} database {} {}", features.key, sum_, input.name));
}

std::vector<Pair> KnownFeatures::pairs(const std::vector<ImageFeatures>& images,
                                       const std::vector<Input>& inputs) {
  std::map<int, int> index_of_image;  // maps an image of the database to its index here
  for (std::size_t k = 0; k < images.size(); ++k)
    index_of_image[index_.at(inputs[at(images[k].input)].name)] = static_cast<int>(k);
  std::vector<Pair> result;
  for (auto& known : database_.pairs) {
    const auto first = index_of_image.find(known.first);
    const auto second = index_of_image.find(known.second);
    if (first == index_of_image.end() || second == index_of_image.end()) continue;
    Pair pair;
    pair.first = first->second;
    pair.second = second->second;
    pair.matches = static_cast<int>(known.matches.size());
    if (pair.first > pair.second) {
      std::swap(pair.first, pair.second);
      for (Match& match : known.matches) std::swap(match.first, match.second);
    }
    pair.view.inliers = std::move(known.matches);  // until verification
    result.push_back(std::move(pair));
  }
  std::sort(result.begin(), result.end(), [](const Pair& a, const Pair& b) {
    return std::pair(a.first, a.second) < std::pair(b.first, b.second);
  });
  return result;
}

}  // namespace tarsier::sfm
