// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/head_view/view_model.h"

#include <vector>

namespace tarsier::face::head_view {

// A view and the true direction of its head, with the view's roll removed (direction_of).
struct ViewSample {
  HeadView view;
  Direction truth;
  int group = 0;  // a person, or another part of the data that is held out together
  // The ground truth is where a person was asked to look. It has more noise than an exact one, and
  // the views of a group share an unknown error.
  bool nominal = false;
};

struct TrainViewOptions {
  int components = 200;  // of the PCA, at most the number of views
  // Of the landmarks' offsets relative to the gradients, both scaled to variance 1.
  double offset_weight = 0.5;
  double angle_weight = 0.6;  // of the approximate angles, likewise
  // Of the kernel. f has a mean squared distance of 1 + offset_weight^2 + angle_weight^2 between
  // two views.
  double gamma = 2.5;
  // Noise variance of nominal ground truths, relative to the kernel's variance of 1; larger values
  // give a smoother result.
  double ridge = 0.5;
  double exact_ridge = 0.1;  // of exact ground truths
  // Variance of the error that the nominal ground truths of a group share, relative to the kernel's
  // variance of 1. 0 disables it.
  double group_error = 0.1;
  bool mirror = true;  // train on mirrored views too

  [[nodiscard]] OptionFields fields() {
    return {
        {"components", components, range(1, 500), "--components",
         "number of PCA components of gradients and offsets"},
        {"offset_weight", offset_weight, range(0, 1000), "--offset-weight",
         "weight of the landmark offsets from the mean head, relative to the gradients"},
        {"angle_weight", angle_weight, above(0, 1000), "--angle-weight",
         "weight of the landmark angles, relative to the gradients"},
        {"gamma", gamma, above(0, 1000), "--gamma",
         "gamma of the Gaussian kernel; higher: narrower"},
        {"ridge", ridge, above(0, 1e6), "--ridge", "regularisation for the images of Pointing'04"},
        {"exact_ridge", exact_ridge, above(0, 1e6), "--exact-ridge",
         "regularisation for the images of --truth and --annotated"},
        {"group_error", group_error, range(0, 1000), "--person-error",
         "variance of a person's constant angle error in Pointing'04, relative to the corrections; "
         "0: none"}};
  }
  void check() const { check_fields(*this); }
};

// PCA of gradients and offsets, then (K + N + group_error S) weights = corrections. N is diagonal:
// ridge for nominal views, exact_ridge for others. S_ij is 1 for two nominal views of one group,
// otherwise 0; for yaw it is -1 if one of the two is mirrored. This is a Gaussian process with
// known noise variances and a constant random effect for each group and axis (Rasmussen and
// Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2 and 2.7): an error that is
// constant over a group is not attributed to the appearance. All views need the same number of
// offsets. Needs at least 8 views that are not all equal, and at most 20 000 (including mirrored
// ones); otherwise throws std::invalid_argument.
[[nodiscard]] ViewModel train_view_model(const std::vector<ViewSample>& samples,
                                         const TrainViewOptions& options);

// The direction of each view's head by a model that was trained without its group.
[[nodiscard]] std::vector<CorrectedDirection> leave_groups_out(
    const std::vector<ViewSample>& samples, const TrainViewOptions& options);

}  // namespace tarsier::face::head_view
