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
  std::vector<double> scales{1.0, 0.5};  // scales of the image, at most 8
  double min_plate = 0.02;               // minimum probability of the SVM for reading a candidate
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

// Reads the plates of one image (CV_8UC3 or CV_8UC1), highest confidence first. `debug` may be
// null.
[[nodiscard]] std::vector<Reading> read_classic(const cv::Mat& image, const ClassicModel& model,
                                                const ClassicOptions& options, DebugSink* debug);

// Candidates of all scales, in pixels of the original image.
[[nodiscard]] std::vector<ClassicCandidate> find_classic_candidates(const cv::Mat& image,
                                                                    const ClassicOptions& options,
                                                                    DebugSink* debug);

// The best reading of a candidate: several binarisation thresholds are tried, and the row of
// characters with the highest score is kept.
struct ClassicText {
  std::vector<Segment> segments;  // px of ClassicCandidate::plain
  std::vector<std::vector<double>> probabilities;
  std::string text;
  double score = 0;  // sum of log probabilities, plus a bonus per character
};
[[nodiscard]] ClassicText read_candidate(const ClassicCandidate& candidate,
                                         const CharacterReader& reader,
                                         const ClassicOptions& options);

}  // namespace tarsier::plate
