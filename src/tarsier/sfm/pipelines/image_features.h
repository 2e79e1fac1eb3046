// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/features/pairs.h"
#include "tarsier/sfm/pipelines/cache.h"
#include "tarsier/sfm/pipelines/pipeline.h"

#include <map>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

// The steps for one image and for one pair. The pipeline of all images (pipeline.h) and the online
// mapper (online.h) share them, so that the same inputs give the same cache entries in both.
namespace tarsier::sfm {

struct Lens {
  geometry::Camera camera;
  const char* source = "guess";  // "given", "EXIF", "guess"
};

// An image, as needed by pairs and mapper.
struct ImageFeatures {
  int input = 0;  // index of its Input
  cv::Size size;
  Lens lens;
  // Make and model of the camera, from EXIF; or the camera of a database or of a start model.
  std::string body;
  int turns = 0;    // clockwise quarter turns that bring the image upright, 0..3
  std::string key;  // from its bytes and the feature options
  Features features;
};

// ImageFeatures::key of a file with this SHA-256.
[[nodiscard]] std::string features_key(const std::string& sha256, const FeatureOptions& options);

// Reads the file, with the pixels of the sensor (scene/sensor_image.h), and fills all of
// `image_features` but its index and features. A given camera is scaled to the image where the
// aspect ratios are equal. Where they are equal with swapped sides, it is turned by a quarter turn,
// as EXIF says. Without EXIF both directions are possible, so the principal point is set to the
// centre and tangential distortion to zero. With another aspect ratio the camera is not used, with
// a warning. Throws InputError.
[[nodiscard]] cv::Mat read_input_image(const Input& input, const PipelineOptions& options,
                                       ImageFeatures& image_features);

// Computes the features; returns true if they come from the cache. Throws OutputError (cache).
bool find_image_features(const cv::Mat& image, const PipelineOptions& options, const Cache& cache,
                         ImageFeatures& image_features);

// Cache key for the pairs of an image, and the key of the other image within them.
[[nodiscard]] std::string pairs_key(const ImageFeatures& image_features,
                                    const PipelineOptions& options);
[[nodiscard]] std::string partner_key(const ImageFeatures& image_features);

[[nodiscard]] TwoView verify_image_pair(const ImageFeatures& first, const ImageFeatures& second,
                                        const std::vector<Match>& matches,
                                        const PipelineOptions& options,
                                        const std::vector<float>& ratios = {});

// Matches the descriptors of the two images of `pair` and verifies the matches. Sets the pair's
// number of matches and its view. `found` may be null; it receives all matches.
void compare_images(const ImageFeatures& first, const ImageFeatures& second,
                    const PipelineOptions& options, Pair& pair,
                    std::vector<Match>* found = nullptr);

// The options with the seed copied to all parts.
[[nodiscard]] PipelineOptions seeded(PipelineOptions options);

// The choice that PairChoice::kAuto makes for this number of images; other choices unchanged.
[[nodiscard]] PairChoice pair_choice(const PipelineOptions& options, int images);

// The pairs of images to compare, by index: the smaller one first, sorted, each pair once. `names`
// are those of the readable images. `descriptors` is called where images are found by retrieval.
// `positions` are camera positions (empty: unknown). Throws InputError (pairs_file).
[[nodiscard]] std::vector<ImagePair> choose_pairs(const std::vector<std::string>& names,
                                                  const KnownPositions& positions,
                                                  const DescriptorSource& descriptors,
                                                  const PipelineOptions& options);

// All that the mapper needs to know about its images.
struct MatchedImages {
  std::vector<ImageFeatures> images;  // readable images, in the order of the inputs
  // inputs that could not be read, with the reason
  std::vector<std::pair<int, std::string>> left_out;
  std::vector<Pair> pairs;  // verified, sorted; of indices into `images`
};

// The images of a future model and their cameras: one camera per size and lens, or one per image.
class ImageSet {
 public:
  explicit ImageSet(PipelineOptions options) : options_(std::move(options)) {}
  void add(const ImageFeatures& image_features, const std::string& name);
  [[nodiscard]] const std::vector<geometry::Camera>& cameras() const { return cameras_; }
  // Estimates guessed focal lengths from the epipolar geometry of the pairs (focal_estimation.h),
  // where these determine them, and estimates the motions of the pairs again. Returns a log line
  // for each camera. Does nothing where lenses are not refined. Throws Interrupted.
  std::vector<std::string> estimate_focal_lengths(std::vector<Pair>& pairs,
                                                  const std::stop_token& stop);
  // The same, from models made with other focal lengths. A camera takes the focal length of the
  // first model with three of its images, where its logarithm differs by more than `min_change`.
  std::vector<std::string> adopt_focal_lengths(const std::vector<Model>& models, double min_change,
                                               std::vector<Pair>& pairs,
                                               const std::stop_token& stop);
  // Whether a focal length is a guess that is to be refined.
  [[nodiscard]] bool has_guess() const;
  // Whether one of the two functions above set the focal length of an image's camera.
  [[nodiscard]] bool is_estimated(int image) const;
  [[nodiscard]] const std::vector<Image>& images() const { return images_; }
  // The given options, with lenses refined where they were guessed.
  [[nodiscard]] MapperOptions mapper_options() const;

 private:
  void set_focal(int camera, double focal_px);
  void estimate_motions_again(const std::vector<char>& is_new, std::vector<Pair>& pairs,
                              const std::stop_token& stop) const;

  PipelineOptions options_;
  std::vector<geometry::Camera> cameras_;
  std::vector<char> is_guess_;      // for each camera
  std::vector<char> is_estimated_;  // for each camera
  std::vector<Image> images_;
  std::map<std::pair<std::string, std::string>, int> known_;  // by lens and body
  bool any_guess_ = false;
};

}  // namespace tarsier::sfm
