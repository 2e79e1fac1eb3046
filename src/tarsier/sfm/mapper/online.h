// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/mapper/pipeline.h"
#include "tarsier/sfm/mapper/tracks.h"

#include <memory>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct OnlineOptions {
  PipelineOptions pipeline;  // pairs, overlap and flow are not used
  int overlap = 5;           // images before it that each one is compared with
  int neighbours = 3;        // of those that share most points with the latest one

  [[nodiscard]] OptionFields fields() {
    return {{"overlap", overlap, range(1, 1000)}, {"neighbours", neighbours, range(0, 1000)}};
  }
  void check() const;
};

// A model that grows with its images, in the order in which they were taken. What was found is
// kept in the cache of the pipeline, so that run_pipeline on the same inputs pays only for the
// pairs that were left out here.
//
// A new image is compared with the `overlap` before it, with the ones 8, 16, .. before, and
// with `neighbours` that share most points with the image that joined last: a camera that
// comes back to where it was meets what it saw then. Growing keeps poses, makes points again of all
// pairs, adds what sees most (mapper.h) and adjusts all of it whenever it has grown by a quarter.
// Where nearly half of the images do not join, the whole is tried again from another start.
class OnlineMapper {
 public:
  explicit OnlineMapper(const OnlineOptions& options);  // throws std::invalid_argument
  ~OnlineMapper();
  OnlineMapper(const OnlineMapper&) = delete;
  OnlineMapper& operator=(const OnlineMapper&) = delete;

  // Reads an image, finds its features and compares it. Throws InputError (it is then left
  // out), OutputError (cache), Interrupted (it is there, with fewer pairs).
  void add(const Input& input, const std::stop_token& stop);

  // Joins what can be joined. Throws Interrupted: the model is then as it was.
  void grow(const std::stop_token& stop);

  // Adjusts all of the model and looks for more of its points in its images. As grow().
  void refine(const std::stop_token& stop);

  [[nodiscard]] int count() const;           // images that were added
  [[nodiscard]] int registered() const;      // of these, in the model
  [[nodiscard]] const Model& model() const;  // no images until there is a start
  // What was found in an image, 0 .. count() - 1.
  [[nodiscard]] const Features& features(int image) const;
  // That were compared, in the order in which their second images were added.
  [[nodiscard]] const std::vector<Pair>& pairs() const;
  // Why there is no model yet; "" where there is one, or nothing to say.
  [[nodiscard]] const std::string& waiting_for() const;
  [[nodiscard]] double seconds() const;  // that the latest growth took, with the adding before it

 private:
  struct Parts;
  void update(bool again, const std::stop_token& stop);
  std::unique_ptr<Parts> parts_;
};

}  // namespace tarsier::sfm
