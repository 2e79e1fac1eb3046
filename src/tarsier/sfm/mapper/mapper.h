// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/sfm/consistency/pair_rejection.h"
#include "tarsier/sfm/consistency/patch_evidence.h"
#include "tarsier/sfm/mapper/center_uncertainty.h"
#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/join_models.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/mapper/model_shape.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// Reconstruction from matched images. The incremental mapper starts from a pair and adds one image
// after the other (Schonberger and Frahm, CVPR 2016). The global mapper computes all poses together
// (global_start.h).
namespace tarsier::sfm {

enum class MapperChoice {
  kIncremental,  // an initial pair, then one image after the other
  kGlobal,  // all images together (global_start.h), then the remaining ones one after the other
  // global for sets of at least auto_global images, else incremental; also where global is refused
  kAuto,
};

struct MapperOptions {
  MapperChoice choice = MapperChoice::kIncremental;
  int auto_global = 250;           // connected images
  double reprojection_px = 1.5;    // max reprojection error of an observation
  double min_angle_deg = 1.5;      // min angle between two rays of a point
  double first_angle_deg = 4;      // min median angle of the initial pair
  int first_inliers = 60;          // min inliers of the initial pair
  int pose_inliers = 16;           // min inliers of an added image
  double pose_inlier_share = 0.2;  // min share of the points that the image should see
  double pose_px = 4;              // max reprojection error of an inlier of a new pose
  // Min images that show a point of the result. A point of two images cannot be checked by a third
  // one. Models of fewer than four images keep such points.
  int min_views = 3;
  int min_images = 2;  // min images of a model
  // search radius around the projection of a known point; 0 disables the search
  double extend_px = 3;
  double extend_similarity = 0.75;  // min similarity to the point's other descriptors
  bool refine_focal = false;
  bool refine_center = false;
  bool refine_distortion = false;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"auto_global", auto_global, range(3, 1'000'000)},
            {"reprojection_px", reprojection_px, range(0.1, 50), "--reprojection-px",
             "px, maximum reprojection error of an observation"},
            {"min_angle_deg", min_angle_deg, range(0.01, 30), "--min-angle",
             "minimum angle between the rays of a point, degrees"},
            {"first_angle_deg", first_angle_deg, range(0.1, 60)},
            {"first_inliers", first_inliers, range(16, 100'000)},
            {"pose_inliers", pose_inliers, range(6, 100'000)},
            {"pose_inlier_share", pose_inlier_share, range(0, 1)},
            {"pose_px", pose_px, range(0.1, 50)},
            {"min_views", min_views, range(2, 100), "--min-views",
             "minimum number of images that observe a point"},
            {"min_images", min_images, range(2, 1000)},
            {"extend_px", extend_px, at_least(0)},
            {"extend_similarity", extend_similarity, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

struct RefusedPair {
  int first = 0;  // indices of the images
  int second = 0;
  int inliers = 0;
  std::string reason;
  // kNone: rejected by its few inliers or by its patches (strong_pairs.h)
  PairRejection rejection = PairRejection::kNone;
  bool patches_differ = false;  // see PatchRejection
};

// The result for an image.
struct Outcome {
  bool registered = false;
  int model = -1;    // index of its model; 0 is the largest
  double trust = 0;  // trust.h
  // why it is not registered: "12 of 40 points agree on a pose, 16 are needed"; or ""
  std::string reason;
};

struct Reconstruction {
  // Largest first. Each contains all images; those that are not registered have no features.
  std::vector<Model> models;
  std::vector<Outcome> outcomes;  // for each image
  std::vector<std::string> log;   // log lines: steps and warnings
  // for each model: mean over its images; for scenes that repeat, times shape_trust() and with the
  // removed images (contradicted_images.h)
  std::vector<double> trust;
  std::vector<ModelShape> shapes;  // for each model
  // For each model; empty: not computed.
  std::vector<std::optional<CenterUncertainty>> uncertainties;
  std::vector<RefusedPair> refused;
  // Nearby images of a model lack points that they should show (model_conflicts.h).
  bool has_conflicts = false;
  std::string no_model;  // why there is no model; else ""
  int start_images = 0;  // images whose start poses agree with their matches (MapperInput::start)
  bool interrupted = false;  // the models are those made before the interruption
  int resumed = 0;           // images that a checkpoint had in models
  // Where models of parts were joined (joined_mapper.h): names of the parts, and the results of
  // joining.
  std::vector<std::string> parts;
  std::vector<ModelJoin> joins;
};

// Receives a growing model: "grown-003-before" and "grown-003-after" around each adjustment (of the
// whole model, or of a new image and its neighbours), "model-0" when a model is finished.
using WatchModel = std::function<void(const std::string& label, const Model& model)>;

struct MapperHooks {
  WatchModel watch;  // receives the growing model; may be empty
  // Writes a checkpoint; may be empty. Called at most every save_interval_s, and so that it takes
  // less than a twentieth of the time; 0: at every step. Always called at the end and at an
  // interruption.
  std::function<void(const MapperState&)> save_checkpoint;
  double save_interval_s = 30;
  // Receives the growing model for display; may be empty. Called at most every show_interval_s,
  // and so that it takes less than a twentieth of the time. Does not change the result.
  std::function<void(const Model&)> show;
  double show_interval_s = 1;
  // Resumes from this state. With otherwise equal arguments the result is bit-identical. Ignored
  // where it does not fit the arguments or where there is a `watch`.
  std::optional<MapperState> resume_from;
  // Where stopped, return the models up to then, if any. Otherwise Interrupted is thrown.
  bool partial = false;
};

// Poses to begin with, from another program or an earlier run. Poses that contradict the matches
// are left out (start_model.h). Points are triangulated, everything is adjusted in the frame of
// these poses, and further images are added one after the other. There is only this one model.
// MapperOptions::choice is not used.
struct StartPoses {
  // camera_from_world of each image; at least two
  std::vector<std::optional<geometry::Rigid3>> poses;
  // the poses do not change; an image whose pose is left out is not added later
  bool fixed = false;
  std::vector<int> fixed_cameras;  // indices into MapperInput::cameras: not refined
};

// The input of a reconstruction. Refers to the named objects, which must outlive it.
struct MapperInput {
  const std::vector<geometry::Camera>& cameras;
  const std::vector<Image>& images;                   // their poses are not used
  const std::vector<std::vector<cv::Vec3b>>& colors;  // for the features of each image
  // For the features of each image. Without descriptors (flow), tracks are not extended.
  const std::vector<cv::Mat>& descriptors;
  // Called when descriptors and matches will not be needed for a while (mapped_store.h); may be
  // empty.
  std::function<void()> release_memory = {};
  FeatureKind kind = FeatureKind::kSift;  // of the descriptors
  const std::vector<Pair>& pairs;
  // Features were tracked from image to image, not detected in each. A missing feature then proves
  // nothing, and models are not searched for superimposed places (model_conflicts.h).
  bool tracked = false;
  // Places are known to look alike, so few contradicting images suffice to reject a model.
  bool is_repetitive = false;
  // Supplies the pixels for patch_evidence.h. Used where finished models have conflicts.
  GrayImages gray = {};
  std::optional<StartPoses> start = {};
};

// Throws Interrupted, and what hooks.save_checkpoint throws.
[[nodiscard]] Reconstruction reconstruct(const MapperInput& input, const MapperOptions& options,
                                         Progress& progress, const std::stop_token& stop,
                                         const MapperHooks& hooks = {});

// How to extend a model.
struct ExtendOptions {
  // Number of images in the model at the last adjustment of the whole.
  int adjusted_at = 0;
  // Adjusts the whole model in any case, and extends its tracks.
  bool adjust_all = false;
};
struct ExtendedModel {
  Model model;
  int adjusted_at = 0;  // as in ExtendOptions, for the next call
};
// Extends `before`, a model of the first images (its cameras are the first of input.cameras). Its
// poses are kept until the next adjustment. Points are triangulated again from all pairs, and
// further images are registered where possible. Throws Interrupted.
[[nodiscard]] ExtendedModel extend_model(const Model& before, const MapperInput& input,
                                         const MapperOptions& options, const ExtendOptions& extend,
                                         const std::stop_token& stop);

}  // namespace tarsier::sfm
