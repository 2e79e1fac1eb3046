// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/head_view/view_model.h"

#include <vector>

namespace tarsier::face::head_view {

// A view and where its head truly looks, the view's roll taken out (direction_of).
struct ViewSample {
  HeadView view;
  Direction truth;
  int group = 0;  // a person, or another part of the data that is left out as a whole
  // The truth is where a person was asked to look: it has more noise than an exact one, and those of
  // a group share an unknown error.
  bool asked = false;
};

struct TrainViewOptions {
  int components = 200;        // of the PCA, at most the views
  double offset_weight = 0.5;  // of the landmarks' offsets beside the gradients, both of variance 1
  double angle_weight = 0.6;   // of the rough angles, likewise
  double gamma = 2.5;          // of the kernel: f has a mean squared distance of
                               // 1 + offset_weight^2 + angle_weight^2 between two views
  double ridge = 0.5;          // variance of the noise of asked truths, that of the kernel being 1:
                               // the larger, the smoother
  double exact_ridge = 0.1;    // of the others
  double group_error = 0.1;    // variance of the error that a group's truths share, where they are
                               // asked; that of the kernel is 1. 0: none
  bool mirror = true;          // learn the mirrored views too

  [[nodiscard]] OptionFields fields() {
    return {{"components", components, range(1, 500), "--components",
             "numbers that PCA leaves of gradients and offsets"},
            {"offset_weight", offset_weight, range(0, 1000), "--offset-weight",
             "weight of the landmarks' offsets from the mean head beside the gradients"},
            {"angle_weight", angle_weight, above(0, 1000), "--angle-weight",
             "weight of the landmarks' angles beside the gradients"},
            {"gamma", gamma, above(0, 1000), "--gamma",
             "of the Gaussian kernel: the larger, the sooner likeness ends"},
            {"ridge", ridge, above(0, 1e6), "--ridge",
             "weight of smoothness against the images of Pointing'04"},
            {"exact_ridge", exact_ridge, above(0, 1e6), "--exact-ridge",
             "weight of smoothness against images of --truth and --annotated"},
            {"group_error", group_error, range(0, 1000), "--person-error",
             "variance of the constant error that a person's angles in Pointing'04 may have, in "
             "that of the corrections; 0: none"}};
  }
  void check() const { check_fields(*this); }
};

// PCA of gradients and offsets, then (K + N + group_error S) weights = corrections. N is diagonal:
// ridge for asked views, exact_ridge for others. S_ij is 1 for two asked views of one group, else 0;
// for yaw it is -1 where one of the two is mirrored. This is a Gaussian process with noise of known
// variances and a constant random effect for each group and axis (Rasmussen and Williams, Gaussian
// Processes for Machine Learning, 2006, sections 2.2 and 2.7): what is constant over a group is not
// learnt as an effect of how its heads look. All views have as many offsets.
// Needs 8 views or more that are not all alike, and at most 20 000 (mirrored ones included): throws
// std::invalid_argument.
[[nodiscard]] ViewModel train_view_model(const std::vector<ViewSample>& samples,
                                         const TrainViewOptions& options);

// Where each head looks by a model that was learnt without its group.
[[nodiscard]] std::vector<ViewAnswer> leave_groups_out(const std::vector<ViewSample>& samples,
                                                       const TrainViewOptions& options);

}  // namespace tarsier::face::head_view
