// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/image_features.h"

#include "tarsier/core/at.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/scaled_camera.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"
#include "tarsier/sfm/scene/exif.h"
#include "tarsier/sfm/scene/sensor_image.h"
#include "tarsier/sfm/two_view/focal_estimation.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr std::int64_t kMaxFileBytes = 512'000'000;
// Retrieval is faster from 24 images on, but similar places displace true neighbours. It loses one
// of 36 images of a symmetrical box, and splits 48 of a toy with an unknown lens into two models
// (docs/sfm.md, "Many images").
constexpr int kMaxExhaustiveImages = 60;
constexpr double kGuessedFocalRatio = 1.2;  // times the longer side
// min images of a model that determines the focal length of their camera
constexpr int kMinScaledImages = 3;

// The camera of an image after a clockwise quarter turn: (x, y) becomes (height - 1 - y, x).
geometry::Camera turned(const geometry::Camera& camera) {
  geometry::Camera result = camera;
  std::swap(result.width, result.height);
  std::swap(result.fx, result.fy);
  result.cx = camera.height - 1 - camera.cy;
  result.cy = camera.cx;
  result.distortion[2] = camera.distortion[3];  // p1, p2: the ray (x, y) becomes (-y, x)
  result.distortion[3] = -camera.distortion[2];
  return result;
}

// The given camera for an image of this size: unchanged, without rounding, where it has this size.
std::optional<geometry::Camera> camera_of_size(const geometry::Camera& camera, cv::Size size) {
  if (camera.width == size.width && camera.height == size.height) return camera;
  return geometry::scaled_camera(camera, size);
}

// The same, also for an image with swapped sides. `turns`: quarter turns that bring it upright.
std::optional<geometry::Camera> fitted_camera(const geometry::Camera& given, cv::Size size,
                                              int turns) {
  if (const auto camera = camera_of_size(given, size)) return camera;
  geometry::Camera camera = turned(given);
  if (turns == 1) {
    camera = turned(turned(camera));  // the camera is for upright images: turn back
  } else if (turns != 3) {
    camera.cx = (camera.width - 1) / 2.0;
    camera.cy = (camera.height - 1) / 2.0;
    camera.distortion[2] = camera.distortion[3] = 0;
  }
  return camera_of_size(camera, size);
}

Lens lens_of(cv::Size size, double exif_focal, int turns, const PipelineOptions& options) {
  if (options.camera) {
    if (const auto camera = fitted_camera(*options.camera, size, turns)) return {*camera, "given"};
  }
  Lens lens;
  lens.camera.width = size.width;
  lens.camera.height = size.height;
  lens.camera.cx = (size.width - 1) / 2.0;
  lens.camera.cy = (size.height - 1) / 2.0;
  const double larger = std::max(size.width, size.height);
  double focal = kGuessedFocalRatio * larger;
  if (!options.ignore_exif && exif_focal > 0.1 * larger && exif_focal < 20 * larger) {
    focal = exif_focal;
    lens.source = "EXIF";
  }
  lens.camera.fx = lens.camera.fy = focal;
  return lens;
}

std::string camera_text(const Lens& lens) {
  const geometry::Camera& c = lens.camera;
  return fmt::format("{} {} {} {} {} {} {} {} {} {} {} {}", c.width, c.height, c.fx, c.fy, c.cx,
                     c.cy, fmt::join(c.distortion, " "), lens.source, static_cast<int>(c.lens), 0,
                     0, 0);
}

bool is_guess(const Lens& lens) { return std::string_view(lens.source) == "guess"; }

}  // namespace

std::string features_key(const std::string& sha256, const FeatureOptions& f) {
  return cache_key(fmt::format("{} features-3 {} {} {} {}{}", sha256, static_cast<int>(f.kind),
                               f.max_count, f.max_pixels, f.contrast, f.wide ? " wide-1" : ""));
}

cv::Mat read_input_image(const Input& input, const PipelineOptions& options,
                         ImageFeatures& image_features) {
  const std::string bytes = read_file(input.path, kMaxFileBytes);
  Sha256 sum;
  sum.add(bytes);
  image_features.key = features_key(sum.hex(), options.features);
  const Exif exif = parse_exif(bytes);
  const std::span<const std::uint8_t> data(reinterpret_cast<const std::uint8_t*>(bytes.data()),
                                           bytes.size());
  cv::Mat image = decode_sensor_image(data, input.path, exif);
  image_features.size = image.size();
  image_features.turns = quarter_turns_of(exif.orientation);
  image_features.lens = lens_of(image_features.size, focal_px_of(exif, image_features.size),
                                image_features.turns, options);
  if (options.camera && std::string_view(image_features.lens.source) != "given") {
    log_warning(
        "{}: the image has {}x{} px, but the given camera has {}x{} px: the focal length is {}",
        input.path, image.cols, image.rows, options.camera->width, options.camera->height,
        is_guess(image_features.lens) ? "estimated from matches" : "taken from EXIF");
  }
  image_features.body = exif.camera;
  return image;
}

bool find_image_features(const cv::Mat& image, const PipelineOptions& options, const Cache& cache,
                         ImageFeatures& image_features) {
  if (auto known = cache.features(image_features.key)) {
    image_features.features = std::move(*known);
    return true;
  }
  image_features.features = find_features(image, options.features);
  cache.store(image_features.key, image_features.features);
  return false;
}

std::string pairs_key(const ImageFeatures& image_features, const PipelineOptions& options) {
  const TwoViewOptions& two_view = options.two_view;
  return cache_key(fmt::format("{} {} pairs-3 {} {} {}", image_features.key,
                               camera_text(image_features.lens), options.matching.ratio,
                               two_view.threshold_px, two_view.min_inliers) +
                   std::to_string(two_view.seed));
}

std::string partner_key(const ImageFeatures& image_features) {
  return image_features.key + camera_text(image_features.lens);
}

TwoView verify_image_pair(const ImageFeatures& first, const ImageFeatures& second,
                          const std::vector<Match>& matches, const PipelineOptions& options,
                          const std::vector<float>& ratios) {
  TwoViewOptions two_view = options.two_view;
  two_view.known_focal = !is_guess(first.lens) && !is_guess(second.lens);
  return verify_pair(first.features.points, second.features.points, matches, first.lens.camera,
                     second.lens.camera, two_view, ratios);
}

void compare_images(const ImageFeatures& first, const ImageFeatures& second,
                    const PipelineOptions& options, Pair& pair, std::vector<Match>* found) {
  std::vector<float> ratios;
  std::vector<Match> matches = match_features(first.features, second.features,
                                              options.features.kind, options.matching, &ratios);
  pair.matches = static_cast<int>(matches.size());
  pair.view = verify_image_pair(first, second, matches, options, ratios);
  if (found != nullptr) *found = std::move(matches);
}

PipelineOptions seeded(PipelineOptions options) {
  options.mapper.seed = options.two_view.seed = options.seed;
  return options;
}

PairChoice pair_choice(const PipelineOptions& options, int images) {
  if (options.pairs != PairChoice::kAuto) return options.pairs;
  return images <= kMaxExhaustiveImages ? PairChoice::kExhaustive : PairChoice::kRetrieval;
}

std::vector<ImagePair> choose_pairs(const std::vector<std::string>& names,
                                    const KnownPositions& positions,
                                    const DescriptorSource& descriptors,
                                    const PipelineOptions& options) {
  const auto count = static_cast<int>(names.size());
  switch (pair_choice(options, count)) {
    case PairChoice::kSequential:
      return sequential_pairs(count, options.overlap);
    case PairChoice::kList:
      return read_pairs_list(options.pairs_file, names);
    case PairChoice::kRetrieval: {
      RetrievalOptions retrieval;
      retrieval.nearest = options.nearest;
      retrieval.seed = options.seed;
      return Retrieval(count, descriptors, options.features.kind, retrieval).pairs(positions);
    }
    case PairChoice::kAuto:
    case PairChoice::kExhaustive:
      break;
  }
  return exhaustive_pairs(count);
}

void ImageSet::add(const ImageFeatures& image_features, const std::string& name) {
  const std::pair key(camera_text(image_features.lens), image_features.body);
  auto [entry, fresh] = known_.try_emplace(key, static_cast<int>(cameras_.size()));
  if (fresh || !options_.shared_camera) {
    entry->second = static_cast<int>(cameras_.size());
    cameras_.push_back(image_features.lens.camera);
    is_guess_.push_back(is_guess(image_features.lens) ? 1 : 0);
    is_estimated_.push_back(0);
  }
  any_guess_ = any_guess_ || std::string_view(image_features.lens.source) != "given";
  Image image;
  image.name = name;
  image.camera = entry->second;
  image.features = image_features.features.points;
  image.sizes = image_features.features.sizes;
  image.turns = image_features.turns;
  images_.push_back(std::move(image));
}

bool ImageSet::has_guess() const {
  return !options_.fixed_camera &&
         std::find(is_guess_.begin(), is_guess_.end(), 1) != is_guess_.end();
}

void ImageSet::set_focal(int camera, double focal_px) {
  cameras_[at(camera)].fx = cameras_[at(camera)].fy = focal_px;
  is_estimated_[at(camera)] = 1;
}

bool ImageSet::is_estimated(int image) const {
  return is_estimated_[at(images_[at(image)].camera)] != 0;
}

void ImageSet::estimate_motions_again(const std::vector<char>& is_new, std::vector<Pair>& pairs,
                                      const std::stop_token& stop) const {
  cv::parallel_for_(cv::Range(0, static_cast<int>(pairs.size())), [&](const cv::Range& range) {
    for (int k = range.start; k < range.end && !stop.stop_requested(); ++k) {
      Pair& pair = pairs[at(k)];
      const Image& first = images_[at(pair.first)];
      const Image& second = images_[at(pair.second)];
      if (is_new[at(first.camera)] == 0 && is_new[at(second.camera)] == 0) continue;
      estimate_motion_again(first.features, second.features, cameras_[at(first.camera)],
                            cameras_[at(second.camera)], options_.two_view, pair.view);
    }
  });
  throw_if_stopped(stop);
}

std::vector<std::string> ImageSet::estimate_focal_lengths(std::vector<Pair>& pairs,
                                                          const std::stop_token& stop) {
  std::vector<std::string> lines;
  if (!has_guess()) return lines;
  // pairs may be new even where lenses are not (online.h)
  std::vector<char> is_new = is_estimated_;
  for (const FocalEstimate& found : sfm::estimate_focal_lengths(
           cameras_, is_guess_, images_, pairs, options_.two_view.threshold_px, stop)) {
    lines.push_back(
        fmt::format("focal length of camera {}: {:.0f} px from the epipolar geometry of {} pairs, "
                    "the initial guess was {:.0f} px",
                    found.camera, found.focal_px, found.pairs, cameras_[at(found.camera)].fx));
    set_focal(found.camera, found.focal_px);
    is_new[at(found.camera)] = 1;
  }
  estimate_motions_again(is_new, pairs, stop);
  return lines;
}

std::vector<std::string> ImageSet::adopt_focal_lengths(const std::vector<Model>& models,
                                                       double min_change, std::vector<Pair>& pairs,
                                                       const std::stop_token& stop) {
  std::vector<std::string> lines;
  if (!has_guess()) return lines;
  std::vector<char> is_seen(cameras_.size(), 0);
  std::vector<char> is_new(cameras_.size(), 0);
  for (const Model& model : models) {
    std::vector<int> registered_images(cameras_.size(), 0);
    for (const Image& image : model.images)
      registered_images[at(image.camera)] += image.registered ? 1 : 0;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
      if (is_guess_[c] == 0 || is_seen[c] != 0 || registered_images[c] < kMinScaledImages) continue;
      is_seen[c] = 1;
      const double focal = model.cameras[c].fx;
      if (!(std::abs(std::log(focal / cameras_[c].fx)) > min_change)) continue;
      lines.push_back(
          fmt::format("focal length of camera {}: {:.0f} px in a model, {:.0f} px was assumed", c,
                      focal, cameras_[c].fx));
      set_focal(static_cast<int>(c), focal);
      is_new[c] = 1;
    }
  }
  if (!lines.empty()) estimate_motions_again(is_new, pairs, stop);
  return lines;
}

MapperOptions ImageSet::mapper_options() const {
  MapperOptions mapper = options_.mapper;
  if (any_guess_ && !options_.fixed_camera) {
    mapper.refine_focal = true;
    mapper.refine_distortion = true;
  }
  return mapper;
}

}  // namespace tarsier::sfm
