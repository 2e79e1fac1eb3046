// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/plate/text/reading.h"

#include <iosfwd>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::plate {

// A plate of a truth file (CSV: image,x,y,w,h,text). The text has upper case letters and digits;
// '-' stands for a character that is hidden in the image.
struct TruthPlate {
  std::optional<cv::Rect2d> box;
  std::string text;  // empty if only the box is known
};

// The plates of each image, by its base name.
using PlateTruth = std::map<std::string, std::vector<TruthPlate>>;

// Columns may be in any order; unknown columns are ignored. x, y, w and h are all empty if only the
// text is known. Throws InputError with the line number.
[[nodiscard]] PlateTruth read_plate_truth(const std::string& path);

// What was read in one image.
struct ImageReadings {
  std::string image;
  double milliseconds = 0;  // negative if not measured
  std::vector<Reading> plates;
  // Boxes of other programs with sub-pixel coordinates: one per plate, used instead of its `box`.
  // Otherwise empty.
  std::vector<cv::Rect2d> boxes;
};

// Parses the lines of `plate read --json`, or of another program: {"image", "ms", "plates":
// [{"text", "confidence", "box": [x,y,w,h], "candidates": ["text" or {"text"}..]}]}. Only "image"
// and each "text" are required. `name` is used in errors. Throws InputError with the line number.
[[nodiscard]] std::vector<ImageReadings> parse_readings(std::istream& lines,
                                                        const std::string& name);

// The result for one plate of the truth that has a text, for lists of errors.
struct PlateOutcome {
  std::string image;
  TruthPlate truth;
  bool found = false;
  std::optional<Reading> reading;
  int edits = 0;
  bool exact = false;
};

struct PlateScores {
  int images = 0;  // of the truth
  int truth = 0;   // plates in them
  int boxes = 0;   // of these, plates with a box
  int found = 0;   // of these, plates found by their box
  int texts = 0;   // plates with a text
  int exact = 0;   // found, and read without an error
  // The same, with the letter O and the digit 0 counted as equal. Truth files confuse them.
  int exact_o_as_0 = 0;
  int exact_any = 0;  // read without an error anywhere in the image
  int top10 = 0;      // found, and the correct text is among the first ten candidates
  int returned = 0;   // plates that the reader reported in these images
  // 0..1; negative if there is nothing to evaluate.
  double recall = -1;          // found / boxes
  double recall_at_03 = -1;    // the same at an intersection over union of 0.3
  double precision = -1;       // matched / returned
  double exact_rate = -1;      // exact / texts
  double exact_any_rate = -1;  // exact_any / texts
  double top10_rate = -1;      // top10 / texts
  // 1 - edits / characters; at least 0 for each plate, 0 for a missed plate.
  double character_rate = -1;
  double found_character_rate = -1;  // the same over the found plates
  double confidence_auc = -1;
  // Reliability of the confidence, over the found plates with a text. Expected calibration error
  // (Naeini, Cooper and Hauskrecht, AAAI 2015): the mean of |accuracy - mean confidence| over ten
  // equal intervals of the confidence, weighted by their counts. It is not computed if a confidence
  // is outside [0, 1], for example the percentages of another program.
  int evaluated = 0;              // found plates with a text
  double calibration_error = -1;  // [0, 1]
  int high_confidence = 0;        // confidence above 0.9
  int high_confidence_wrong = 0;  // of these, with an error
  // Over the images with readings, ms.
  double median_ms = -1, p90_ms = -1;
  std::vector<PlateOutcome> outcomes;
};

struct EvaluationOptions {
  double iou = 0.5;   // minimum intersection over union of the boxes
  bool fold = false;  // treats 0, O, Q and D as one character, and 1 and I

  [[nodiscard]] OptionFields fields() {
    return {{"iou", iou, range(0.01, 1), "--iou",
             "minimum intersection over union of a correct detection"},
            {"fold", fold, "--fold", "treat 0, O, Q and D as equal, and 1 and I"}};
  }
  void check() const { check_fields(*this); }
};

// Images are matched by their base names. Readings of an image outside the truth are ignored. If an
// image has two readings, the later one counts. Plates are matched one to one in the order of
// falling intersection over union of the boxes; a plate is found if this is at least `iou`. Texts
// are compared by the Levenshtein distance (1966), in which hidden characters cost nothing. The AUC
// is the probability that a correct reading has a higher confidence than a wrong one (Mann and
// Whitney, 1947).
[[nodiscard]] PlateScores evaluate_plates(const std::vector<ImageReadings>& readings,
                                          const PlateTruth& truth,
                                          const EvaluationOptions& options);

// The scores as a JSON object, rounded to four decimals (ms to one): "images", "truth", "recall",
// "recall03", "prec", "exact", "exact_o_as_0", "exact_any", "top10", "char", "char_found",
// "conf_auc", "calibration_error", "sure", "sure_wrong", "median_ms", "p90_ms", "counts". The
// Wilson 95 % intervals are "recall_interval", "exact_interval" and "sure_wrong_interval", as [low,
// high]. A value is null if there is nothing to evaluate.
[[nodiscard]] nlohmann::ordered_json scores_json(const PlateScores& scores);

}  // namespace tarsier::plate
