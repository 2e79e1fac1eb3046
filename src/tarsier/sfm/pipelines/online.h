// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/pipelines/pipeline.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <memory>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct OnlineOptions {
  PipelineOptions pipeline;  // pairs, overlap and flow are not used
  int overlap = 5;           // number of previous images that each one is compared with
  int neighbours = 3;        // number of compared images that share most points with the latest one

  [[nodiscard]] OptionFields fields() {
    return {{"overlap", overlap, range(1, 1000)}, {"neighbours", neighbours, range(0, 1000)}};
  }
  void check() const;
};

// A model that grows with its images, in the order of capture. Results are kept in the pipeline's
// cache, so that run_pipeline() on the same inputs computes only the pairs that were left out here.
//
// A new image is compared with the `overlap` previous ones, with those 8, 16, .. before, and with
// `neighbours` that share most points with the last registered image. So a camera that returns to a
// place matches its earlier images. Growing keeps poses, triangulates points again from all pairs,
// adds the images that see most (extend_model.h) and adjusts the whole whenever it has grown by a
// quarter. Where nearly half of the images cannot be registered, mapping is tried again from
// another initial pair.
class OnlineMapper {
 public:
  explicit OnlineMapper(const OnlineOptions& options);  // throws std::invalid_argument
  ~OnlineMapper();
  OnlineMapper(const OnlineMapper&) = delete;
  OnlineMapper& operator=(const OnlineMapper&) = delete;

  // Reads an image, finds its features and compares it. Throws InputError (the image is left out),
  // OutputError (cache), Interrupted (the image is kept, with fewer pairs).
  void add(const Input& input, const std::stop_token& stop);

  // Registers further images where possible. Throws Interrupted: the model is then unchanged.
  void grow(const std::stop_token& stop);

  // Adjusts the whole model and searches more of its points in its images. Throws as grow().
  void refine(const std::stop_token& stop);

  [[nodiscard]] int count() const;           // images added
  [[nodiscard]] int registered() const;      // of these, registered
  [[nodiscard]] const Model& model() const;  // without images until mapping has started
  // The features of an image, 0 .. count() - 1.
  [[nodiscard]] const Features& features(int image) const;
  // Compared pairs, in the order in which their second images were added.
  [[nodiscard]] const std::vector<Pair>& pairs() const;
  // Why there is no model yet; "" where there is one or no reason is known.
  [[nodiscard]] const std::string& no_model_reason() const;
  // s, of the latest growth, including the adding of its images
  [[nodiscard]] double seconds() const;

 private:
  struct State;
  void update(bool adjust_all, const std::stop_token& stop);
  std::unique_ptr<State> state_;
};

}  // namespace tarsier::sfm
