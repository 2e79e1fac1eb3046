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
};

struct TrainViewOptions {
  int components = 48;        // of the gradients' PCA, at most the views
  double angle_weight = 1.5;  // of the rough angles beside the gradients, both of variance 1
  double gamma = 0.5;         // of the kernel: f has a mean squared distance of
                              // 1 + angle_weight^2 between two views
  double ridge = 0.3;         // the larger, the smoother
  bool mirror = true;         // learn the mirrored views too

  [[nodiscard]] OptionFields fields() {
    return {{"components", components, range(1, 500), "--components",
             "numbers that PCA leaves of the gradients"},
            {"angle_weight", angle_weight, above(0, 1000), "--angle-weight",
             "weight of the landmarks' angles beside the gradients"},
            {"gamma", gamma, above(0, 1000), "--gamma",
             "of the Gaussian kernel: the larger, the sooner likeness ends"},
            {"ridge", ridge, above(0, 1e6), "--ridge", "weight of smoothness against the samples"}};
  }
  void check() const { check_fields(*this); }
};

// PCA of the gradients, then (K + ridge I) weights = corrections. Needs 8 views or more that are
// not all alike, and at most 20 000 (mirrored ones included): throws std::invalid_argument.
[[nodiscard]] ViewModel train_view_model(const std::vector<ViewSample>& samples,
                                         const TrainViewOptions& options);

// Where each head looks by a model that was learnt without its group.
[[nodiscard]] std::vector<Direction> leave_groups_out(const std::vector<ViewSample>& samples,
                                                      const TrainViewOptions& options);

}  // namespace tarsier::face::head_view
