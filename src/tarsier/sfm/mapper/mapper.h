// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/center_uncertainty.h"
#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/doubt.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/mapper/model_join.h"
#include "tarsier/sfm/mapper/model_shape.h"
#include "tarsier/sfm/mapper/patch_evidence.h"
#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// Reconstruction of matched images: incremental, a first pair, then one image after the other (Schonberger and
// Frahm, CVPR 2016, describe the order of the steps well); or global, all of them at once (global_start.h).
namespace tarsier::sfm {

enum class MapperChoice {
  kIncremental,  // a first pair, then one image after the other
  kGlobal,       // all images at once (global_start.h), then what is left one after the other
  kAuto,  // global for sets of auto_global images and more, incremental for others and where that is refused
};

struct MapperOptions {
  MapperChoice choice = MapperChoice::kIncremental;
  int auto_global = 250;           // images that hang together
  double reprojection_px = 1.5;    // an observation farther off is dropped
  double min_angle_deg = 1.5;      // a point needs two rays that differ by this
  double first_angle_deg = 4;      // of the first pair, at the median
  int first_inliers = 60;          // of the first pair
  int pose_inliers = 16;           // of an image that is added
  double pose_inlier_share = 0.2;  // of the points it should see
  double pose_px = 4;              // of an inlier to a new pose
  // Images that must show a point of the result: one of two has nothing that it could be
  // checked against. Models of fewer than four images keep theirs.
  int min_views = 3;
  int min_images = 2;               // of a model that is kept
  double extend_px = 3;             // how near a known point's place a feature is looked for; 0: no
  double extend_similarity = 0.75;  // .. and how like the point's others it must be
  bool refine_focal = false;
  bool refine_center = false;
  bool refine_distortion = false;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"auto_global", auto_global, range(3, 1'000'000)},
            {"reprojection_px", reprojection_px, range(0.1, 50), "--reprojection-px",
             "px; an observation farther off is dropped"},
            {"min_angle_deg", min_angle_deg, range(0.01, 30), "--min-angle",
             "between a point's rays, degrees"},
            {"first_angle_deg", first_angle_deg, range(0.1, 60)},
            {"first_inliers", first_inliers, range(16, 100'000)},
            {"pose_inliers", pose_inliers, range(6, 100'000)},
            {"pose_inlier_share", pose_inlier_share, range(0, 1)},
            {"pose_px", pose_px, range(0.1, 50)},
            {"min_views", min_views, range(2, 100), "--min-views",
             "images that show a point of the result"},
            {"min_images", min_images, range(2, 1000)},
            {"extend_px", extend_px, at_least(0)},
            {"extend_similarity", extend_similarity, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

struct RefusedPair {
  int first = 0;  // images
  int second = 0;
  int inliers = 0;
  std::string reason;
  Doubt doubt = Doubt::kNone;  // kNone: it is weak, or its patches differ (strong_pairs.h)
};

// What became of an image.
struct Outcome {
  bool registered = false;
  int model = -1;      // which, 0 is the largest
  double trust = 0;    // trust.h
  std::string reason;  // why not: "12 of 40 points agree on a pose, 16 are needed"; or ""
};

struct Reconstruction {
  // Largest first. Each has all images, its own registered; the others without features.
  std::vector<Model> models;
  std::vector<Outcome> outcomes;  // of each image
  std::vector<std::string> log;   // what was done, and what went wrong, line by line
  std::vector<double>
      trust;  // of each model: the mean of its images; of scenes that repeat, what its shape leaves
  std::vector<ModelShape> shapes;  // of each model
  // Of each model; empty: not looked for.
  std::vector<std::optional<CenterUncertainty>> uncertainties;
  std::vector<RefusedPair> refused;
  // Near images of a model lack what they should show (model_conflicts.h).
  bool has_conflicts = false;
  std::string no_model;      // why there is none, where there is none
  int start_images = 0;      // whose start poses agree with their matches (MapperInput::start)
  bool interrupted = false;  // these are the models so far
  int resumed = 0;           // images that a checkpoint had in models
  // Where models of parts of the images were joined (joined_mapper.h): the names of the parts, and what was found out.
  std::vector<std::string> parts;
  std::vector<ModelJoin> joins;
};

// Sees a model while it grows: "grown-003-before" and "grown-003-after" around each adjustment (of
// all of it or of a new image and its neighbours), "model-0" when one is done.
using WatchModel = std::function<void(const std::string& label, const Model& model)>;

struct MapperHooks {
  WatchModel watch;  // sees the growing model; may be empty
  // Keeps a checkpoint (may be empty): at most every so many seconds, and so that this takes less
  // than a twentieth of the time; 0: at every step. At the end and at an interruption in any case.
  std::function<void(const MapperState&)> keep;
  double keep_every_s = 30;
  // Sees the model that grows, for people who wait; may be empty. Not more often than so, and so that
  // this takes less than a twentieth of the time. Changes nothing in the result.
  std::function<void(const Model&)> show;
  double show_every_s = 1;
  // Goes on from there, with the same arguments otherwise: the result is the same, to the last bit.
  // One that does not fit them is ignored, and so is any where there is a `watch`.
  std::optional<MapperState> from;
  // When stopped, returns the models so far where there is one. Else, Interrupted is thrown.
  bool partial = false;
};

// Poses that mapping begins with: of another program's model, or of an earlier run. Those that contradict the matches are left
// out (start_model.h). Points are triangulated, everything is adjusted in the frame of these poses, and further images are
// added one after the other; what does not join this one model is in none. MapperOptions::choice is not used.
struct StartPoses {
  std::vector<std::optional<geometry::Rigid3>>
      poses;           // camera_from_world of each image, of two or more
  bool fixed = false;  // they stay as they are; an image whose pose is left out is not added again
  std::vector<int> fixed_cameras;  // of MapperInput::cameras: they are not refined with the others
};

// What a reconstruction is made of. Refers to what is named here, which must outlive it.
struct MapperInput {
  const std::vector<geometry::Camera>& cameras;
  const std::vector<Image>& images;                   // their poses are not used
  const std::vector<std::vector<cv::Vec3b>>& colors;  // of each image's features
  // Of each image's features; none (flow): tracks are not extended.
  const std::vector<cv::Mat>& descriptors;
  // Is called where descriptors and matches will not be needed for a while (mapped_store.h); may be empty.
  std::function<void()> release_memory = {};
  FeatureKind kind = FeatureKind::kSift;  // of the descriptors
  const std::vector<Pair>& pairs;
  // Features were followed from image to image and not found in each: what an image lacks tells nothing then, and models
  // are not searched for places that lie over each other (model_conflicts.h).
  bool followed = false;
  // Places are known to look alike: few images that contradict each other tell that a model is wrong.
  bool repeats = false;
  // Where the pixels can be had (patch_evidence.h): they are looked at where finished models have conflicts.
  GrayImages gray = {};
  std::optional<StartPoses> start = {};
};

// Throws Interrupted, and what hooks.keep throws.
[[nodiscard]] Reconstruction reconstruct(const MapperInput& input, const MapperOptions& options,
                                         Progress& progress, const std::stop_token& stop,
                                         const MapperHooks& hooks = {});

// A model to be extended.
struct ExtendOptions {
  // How many images the model had when all of it was last adjusted.
  int adjusted_at = 0;
  // Adjusts all of it in any case, and extends its tracks.
  bool adjust_all = false;
};
struct ExtendedModel {
  Model model;
  int adjusted_at = 0;  // as in ExtendOptions, for the next time
};
// Goes on from `before`, a model of the first ones of the images (of its cameras the first ones of
// input.cameras): its poses stay until they are adjusted again, points are made again of all pairs,
// and what now can join, joins. Throws Interrupted.
[[nodiscard]] ExtendedModel extend_model(const Model& before, const MapperInput& input,
                                         const MapperOptions& options, const ExtendOptions& extend,
                                         const std::stop_token& stop);

}  // namespace tarsier::sfm
