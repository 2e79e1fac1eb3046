// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/plate/classic/candidates.h"
#include "tarsier/plate/classic/character_reader.h"
#include "tarsier/plate/classic/plate_svm.h"
#include "tarsier/plate/classic/segments.h"
#include "tarsier/plate/text/reading.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <string>
#include <vector>

// The textbook pipeline: edges -> candidates -> SVM -> contours of characters -> reader.
namespace tarsier::plate {

struct ClassicOptions {
  std::uint64_t seed = 1;
  std::vector<double> scales{1.0, 0.5};  // of the image, at most 8
  double min_plate = 0.02;               // the SVM's chance below which a candidate is not read
  CandidateOptions candidates;
  SegmentOptions segments;

  [[nodiscard]] OptionFields fields() {
    return {{"scales", scales, range(0.05, 4)}, {"min_plate", min_plate, range(0, 1)}};
  }
  void check() const;
};

// The two trained classifiers.
struct ClassicModel {
  PlateSvm svm;
  CharacterReader reader;
};

// models/plate-svm.json and models/plate-hog.json or plate-mlp.json. Throws ModelError.
[[nodiscard]] std::shared_ptr<const ClassicModel> read_classic_model(
    const std::string& svm_path, const std::string& reader_path);

// The plates of one image (CV_8UC3 or CV_8UC1), most confident first. `debug` may be null.
[[nodiscard]] std::vector<Reading> read_classic(const cv::Mat& image, const ClassicModel& model,
                                                const ClassicOptions& options, DebugSink* debug);

// Candidates of all scales, in pixels of the image.
[[nodiscard]] std::vector<Candidate144> find_classic_candidates(const cv::Mat& image,
                                                                const ClassicOptions& options,
                                                                DebugSink* debug);

// The characters of a candidate as they are read best: of several thresholds the one that gives the
// most convincing row.
struct ClassicText {
  std::vector<Segment> segments;  // px of Candidate144::plain
  std::vector<std::vector<double>> chances;
  std::string text;
  double score = 0;  // sum of log chances, and a reward for each character
};
[[nodiscard]] ClassicText read_candidate(const Candidate144& candidate,
                                         const CharacterReader& reader,
                                         const ClassicOptions& options);

}  // namespace tarsier::plate
