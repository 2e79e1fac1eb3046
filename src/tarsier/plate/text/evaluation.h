// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/plate/text/reading.h"

#include <iosfwd>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::plate {

// A plate of a truth file (csv: image,x,y,w,h,text). Text is upper case letters and digits; '-'
// stands for a character that is hidden in the image.
struct TruthPlate {
  std::optional<cv::Rect2d> box;
  std::string text;  // empty: only the box is known
};

// The plates of each image, by its base name.
using PlateTruth = std::map<std::string, std::vector<TruthPlate>>;

// Columns in any order, others are passed over; x, y, w and h are all empty where only the text is
// known. Throws InputError with the line number.
[[nodiscard]] PlateTruth read_plate_truth(const std::string& path);

// What was read in one image.
struct ImageReadings {
  std::string image;
  double milliseconds = 0;  // negative: not measured
  std::vector<Reading> plates;
  // Where other programs give boxes of fractions of a pixel: one for each plate, in place of its
  // `box`. Else empty.
  std::vector<cv::Rect2d> boxes;
};

// The lines that `plate read --json` writes, or another program: {"image", "ms", "plates":
// [{"text", "confidence", "box": [x,y,w,h], "candidates": ["text" or {"text"}..]}]}, of which
// "image" and each "text" must be there. `name` is for errors. Throws InputError with the line
// number.
[[nodiscard]] std::vector<ImageReadings> parse_readings(std::istream& lines,
                                                        const std::string& name);

// One plate of the truth that has a text, and what became of it, for lists of errors.
struct PlateOutcome {
  std::string image;
  TruthPlate truth;
  bool found = false;
  std::optional<Reading> reading;
  int edits = 0;
  bool exact = false;
};

struct PlateScores {
  int images = 0;        // of the truth
  int truth = 0;         // plates in them,
  int boxes = 0;         // of these with a box,
  int found = 0;         // and found by it
  int texts = 0;         // plates with a text,
  int exact = 0;         // found, and read without a mistake,
  int exact_o_as_0 = 0;  // the same where the letter O and the digit 0 count as one: truth files
                         // write one for the other
  int exact_any = 0;     // read without a mistake in whatever place of the image,
  int top10 = 0;         // found, and right among the first ten candidates
  int returned = 0;      // plates that the reader saw in the images
  // 0..1; negative where there is nothing to judge.
  double recall = -1;                // found / boxes
  double recall_at_03 = -1;          // the same for an intersection over union of 0.3
  double precision = -1;             // matched / returned
  double exact_rate = -1;            // exact / texts
  double exact_any_rate = -1;        // exact_any / texts
  double top10_rate = -1;            // top10 / texts
  double character_rate = -1;        // 1 - edits / characters, of a plate 0 at least, missed: 0
  double found_character_rate = -1;  // the same of the plates that were found
  double confidence_auc = -1;
  // Reliability of the confidence over the plates that were found and have a text. Expected
  // calibration error (Naeini, Cooper and Hauskrecht, AAAI 2015): the mean of |share of right texts
  // - mean confidence| over ten equal intervals of the confidence, weighted by their counts.
  // Not judged where a confidence is outside [0, 1], as another program's percentages are.
  int judged = 0;                 // found plates with a text
  double calibration_error = -1;  // [0, 1]
  int sure = 0, sure_wrong = 0;   // confidence above 0.9; of these, read with a mistake
  // Of the images with readings, ms.
  double median_ms = -1, p90_ms = -1;
  std::vector<PlateOutcome> outcomes;
};

struct EvaluationOptions {
  double iou = 0.5;   // of the boxes, at least
  bool fold = false;  // 0, O, Q and D are one character, and 1 and I

  [[nodiscard]] OptionFields fields() {
    return {{"iou", iou, range(0.01, 1), "--iou",
             "least overlap of a found plate, intersection over union"},
            {"fold", fold, "--fold", "take 0, O, Q and D for one, and 1 and I"}};
  }
  void check() const { check_fields(*this); }
};

// Images are matched by their base names; readings of an image that the truth does not know are passed
// over, and of two readings of one image the later counts. Plates are matched one to one by falling
// intersection over union of the boxes; a plate is found at `iou`. Levenshtein distance (1966),
// hidden characters free. AUC: chance that a right reading has more confidence than a wrong one
// (Mann and Whitney, 1947).
[[nodiscard]] PlateScores evaluate_plates(const std::vector<ImageReadings>& readings,
                                          const PlateTruth& truth,
                                          const EvaluationOptions& options);

// The figures as one JSON object, rounded to four places (ms to one): "images", "truth", "recall",
// "recall03", "prec", "exact", "exact_o_as_0", "exact_any", "top10", "char", "char_found",
// "conf_auc", "calibration_error", "sure", "sure_wrong", "median_ms", "p90_ms", "counts", and the
// 95 % intervals of Wilson "recall_interval", "exact_interval" and "sure_wrong_interval" as [low,
// high]; null where there is nothing to judge.
[[nodiscard]] nlohmann::ordered_json scores_json(const PlateScores& scores);

}  // namespace tarsier::plate
