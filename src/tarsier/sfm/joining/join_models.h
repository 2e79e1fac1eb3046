// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/model_join.h"
#include "tarsier/sfm/scene/model.h"

#include <cstdint>
#include <map>
#include <stop_token>
#include <string>
#include <vector>

// Joins models that share images, where that is safe.
//
// All models of a list have the same images and cameras, and each registers its own images
// (with_same_images()). An image has the same features in all models that register it.
namespace tarsier::sfm {

struct JoinOptions {
  int min_images = 3;                // min images registered in both whose poses agree
  int min_points = 30;               // min common points: at least one feature shows them in both
  double min_inlier_share = 0.5;     // min share of these points
  double min_image_share = 2.0 / 3;  // min share of the common images whose poses agree
  double inlier_px = 4;              // max reprojection error of an inlier in the other model
  double inlier_share = 0.005;       // or this share of the image's longer side, if that is more
  double max_rotation_deg = 3;       // between agreeing poses
  // between their centres, as a share of the depth of the image's points
  double max_center_share = 0.05;
  double max_scale_error = 0.02;  // max standard error of the scale
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"min_images", min_images, at_least(1)},
            {"min_points", min_points, at_least(3)},
            {"min_inlier_share", min_inlier_share, range(0, 1)},
            {"min_image_share", min_image_share, range(0, 1)},
            {"inlier_px", inlier_px, at_least(0)},
            {"inlier_share", inlier_share, range(0, 1)},
            {"max_rotation_deg", max_rotation_deg, range(0, 180)},
            {"max_center_share", max_center_share, at_least(0)},
            {"max_scale_error", max_scale_error, at_least(0)}};
  }
  void check() const { check_fields(*this); }
};

// Whether two images have the same features at the same positions, within 0.01 px.
[[nodiscard]] bool has_same_features(const Image& a, const Image& b);

// Estimates the similarity S, first_from_second, on which two models agree.
//
// Common points p, q are those that are each other's most frequent partner among the features
// (image, feature) that show a point in both. There are two candidates for S:
// - The robust least-squares fit of common points and centres (robust_similarity(), seeded).
// - One that also works for collinear points and centres. Its rotation is the mean of R_i' Q_i over
//   the common images (R_i, Q_i: camera from world in the first and second model). Its scale is the
//   median ratio of the depths of common points in common images. Its translation is the median of
//   p - s R q.
//
// The candidate with more agreeing images, then more agreeing points, is taken. A pair of points is
// an inlier if S q projects within inlier_px of the common features in the first model, and S^-1 p
// in the second. The standard error of the scale is 1.4826 MAD(log(depth / depth)) / sqrt(n), for n
// inliers.
//
// Refused, with the reason and the numbers, where a limit of the options is violated, where
// features of an image differ, or a number is not finite.
[[nodiscard]] ModelJoin find_join(const Model& first, const Model& second,
                                  const JoinOptions& options = {});

struct JoinedModels {
  std::vector<Model> models;   // most images first
  std::vector<int> joined_in;  // for each given model: index into `models`
  // for all two models that share images, sorted by first, then second
  std::vector<ModelJoin> joins;
  // images of joined models that are in none of `models`, with the reason
  std::map<int, std::string> left_out;
  std::vector<std::string> log;
};

// Joins models along a maximum spanning tree of their joins, weighted by the number of inliers. A
// join that closes a cycle is refused unless it agrees with the others (10 degrees, a quarter of
// the scale, a tenth of the extent). Where there are such joins, rotations (average_rotations()),
// scales and translations of all are averaged, which distributes the drift over the cycle:
//
//   min sum w_ab (log s_b - log s_a - log s_ab)^2,   min sum w_ab |t_b - t_a - s_a R_a t_ab|^2
//
// with world_from_a = (s_a, R_a, t_a) and a_from_b = (s_ab, R_ab, t_ab).
//
// - Tracks of points with a feature in common are merged, unless two features of an image would
//   then be in one track.
// - An image has the pose of the model in which it shows most points. It is left out where another
//   model places it elsewhere, by more than such a join may deviate.
// - A camera has the mean parameters of the models, weighted by their images.
// - Then the whole is adjusted with decreasing losses, inaccurate observations are dropped
//   (filter_points()), and images that are not connected to the rest are left out
//   (keep_largest_part()). The lens is refined as the mapper's options say, and where the models
//   disagree on a camera.
// - Models that nothing was joined to are not changed.
//
// `names` are those of the models, for the log. Deterministic for any number of threads. Throws
// std::invalid_argument for models with different images or cameras, Interrupted.
[[nodiscard]] JoinedModels join_models(const std::vector<Model>& models,
                                       const std::vector<std::string>& names,
                                       const JoinOptions& options, const MapperOptions& mapper,
                                       const std::stop_token& stop = {});

// Converts models whose images have the same names (e.g. from read_colmap()) to models with the
// same images and cameras, in the order of their first appearance. Cameras are identified by common
// images. An image whose size or lens type differs from that in an earlier model is not registered,
// as it is another image.
[[nodiscard]] std::vector<Model> with_same_images(const std::vector<Model>& models);

}  // namespace tarsier::sfm
