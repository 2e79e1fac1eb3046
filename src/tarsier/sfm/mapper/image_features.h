// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/cache.h"
#include "tarsier/sfm/mapper/pairs.h"
#include "tarsier/sfm/mapper/pipeline.h"

#include <map>
#include <stop_token>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

// The steps of one image and of one pair, for the pipeline of all images (pipeline.h) and
// for the one that grows with its images (online.h): the same inputs give the same entries of
// the cache in both.
namespace tarsier::sfm {

struct Lens {
  geometry::Camera camera;
  const char* from = "guess";  // "given", "EXIF", "guess"
};

// One image, as the pairs and the mapper need it.
struct ImageFeatures {
  int input = 0;  // index of its Input
  cv::Size size;
  Lens lens;
  std::string body;  // make and model of the camera, from EXIF
  int turns = 0;     // quarter turns clockwise that bring the image upright, 0..3
  std::string key;   // of its bytes and of how features are found
  Features features;
};

// ImageFeatures::key of a file with this SHA-256.
[[nodiscard]] std::string features_key(const std::string& sha256, const FeatureOptions& options);

// Reads the file, with the pixels of the sensor (scene/sensor_image.h); fills all of `image_features` but its index and its features.
// A given camera is scaled to the image where its sides are in the same proportion, and turned by a quarter where they are when
// swapped: as EXIF says; where it says nothing, either way would do, so that the principal point is taken for the middle and
// the lens for one without tangential distortion. Of another form it is not used, with a warning. Throws InputError.
[[nodiscard]] cv::Mat read_input_image(const Input& input, const PipelineOptions& options,
                                       ImageFeatures& image_features);

// Fills the features; true if they come from the cache. Throws OutputError (cache).
bool find_image_features(const cv::Mat& image, const PipelineOptions& options, const Cache& cache,
                         ImageFeatures& image_features);

// Under which the pairs of an image are kept, and under which another one is found among them.
[[nodiscard]] std::string pairs_key(const ImageFeatures& image_features,
                                    const PipelineOptions& options);
[[nodiscard]] std::string partner_key(const ImageFeatures& image_features);

[[nodiscard]] TwoView verify_image_pair(const ImageFeatures& first, const ImageFeatures& second,
                                        const std::vector<Match>& matches,
                                        const PipelineOptions& options,
                                        const std::vector<float>& ratios = {});

// Matches the descriptors of the two images that `pair` names and verifies what was found: fills its number of
// matches and its view. `found`, where not null, becomes all matches.
void compare_images(const ImageFeatures& first, const ImageFeatures& second,
                    const PipelineOptions& options, Pair& pair,
                    std::vector<Match>* found = nullptr);

// The options with their seed in all of their parts.
[[nodiscard]] PipelineOptions seeded(PipelineOptions options);

// What PairChoice::kAuto stands for with so many images; other choices as they are.
[[nodiscard]] PairChoice pair_choice(const PipelineOptions& options, int images);

// The images to compare, by their indices: the smaller one first, sorted, each pair once. `names` are those of the
// images that could be read; `descriptors` is asked for them where images are found by what they show
// (Retrieval), and `places` says where they were taken (empty: nothing is known). Throws InputError
// (pairs_file).
[[nodiscard]] std::vector<ImagePair> choose_pairs(const std::vector<std::string>& names,
                                                  const KnownPlaces& places,
                                                  const DescriptorSource& descriptors,
                                                  const PipelineOptions& options);

// All that the mapper needs to know of its images.
struct MatchedImages {
  std::vector<ImageFeatures> images;                  // that could be read, as the inputs
  std::vector<std::pair<int, std::string>> left_out;  // inputs that could not, and why
  std::vector<Pair> pairs;                            // verified, sorted; of indices into `images`
};

// The images of a model to be, and their cameras: one for those of a size and lens, or one
// each.
class ImageSet {
 public:
  explicit ImageSet(const PipelineOptions& options) : options_(options) {}
  void add(const ImageFeatures& image_features, const std::string& name);
  [[nodiscard]] const std::vector<geometry::Camera>& cameras() const { return cameras_; }
  // Takes focal lengths that are guesses from the epipolar geometry of the pairs (focal_estimation.h), where these tell them,
  // and estimates the motions of the pairs again. Returns what was found, a line for each camera. Nothing where lenses are not
  // to be refined. Throws Interrupted.
  std::vector<std::string> estimate_focal_lengths(std::vector<Pair>& pairs,
                                                  const std::stop_token& stop);
  // The same, from models that were made with other focal lengths: of each camera that of the first model that has three of its
  // images, where its logarithm differs by more than `min_change`.
  std::vector<std::string> take_focal_lengths(const std::vector<Model>& models, double min_change,
                                              std::vector<Pair>& pairs,
                                              const std::stop_token& stop);
  // Whether there is a focal length that is a guess, and is to be refined.
  [[nodiscard]] bool has_guess() const;
  // Whether one of the two gave the focal length of an image's camera.
  [[nodiscard]] bool is_estimated(int image) const;
  [[nodiscard]] const std::vector<Image>& images() const { return images_; }
  // The given ones, with lenses refined where they were guessed.
  [[nodiscard]] MapperOptions mapper_options() const;

 private:
  void set_focal(int camera, double focal_px);
  void estimate_motions_again(const std::vector<char>& is_new, std::vector<Pair>& pairs,
                              const std::stop_token& stop) const;

  PipelineOptions options_;
  std::vector<geometry::Camera> cameras_;
  std::vector<char> is_guess_;      // of each camera
  std::vector<char> is_estimated_;  // of each camera
  std::vector<Image> images_;
  std::map<std::tuple<int, int, double, std::string>, int> known_;
  bool any_guess_ = false;
};

}  // namespace tarsier::sfm
