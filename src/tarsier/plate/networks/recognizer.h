// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/timer.h"
#include "tarsier/plate/networks/evidence.h"
#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/text/decode.h"
#include "tarsier/plate/text/reading.h"

#include <opencv2/core.hpp>

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::plate {

// Estimates the probability that a reading's whole text is correct, by logistic regression.
// Features: log posterior, log of the lowest character confidence, logit of the aligner's score,
// log of the plate's height in px, a constant, and the logits of the posterior and of the lowest
// character confidence. Only the logits separate a posterior of 0.99 from one of 0.9999. Older
// models have no weights for the logits.
using CalibrationFeatures = std::array<double, 7>;
struct Calibration {
  CalibrationFeatures weights{1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0};
};

struct DetectorModel {
  linalg::Network detector;
  linalg::Network aligner;
};

struct ReaderModel {
  linalg::Network line;
  Calibration calibration;
  CalibrationCurve confidence_curve;  // corrects the result of `calibration`
  CalibrationCurve character_curve;   // corrects the decoder's confidence of a character
  PlateClassifier plate_classifier;
};

// Read and write models/plate-detector.json and models/plate-reader.json. Throw ModelError,
// OutputError.
[[nodiscard]] DetectorModel read_detector_model(const std::string& path);
[[nodiscard]] ReaderModel read_reader_model(const std::string& path);
void write_detector_model(const std::string& path, const DetectorModel& model,
                          const nlohmann::json& provenance);
void write_reader_model(const std::string& path, const ReaderModel& model,
                        const nlohmann::json& provenance);

struct RecognizerOptions {
  DetectorOptions detector;
  float min_plate = 0.9F;  // minimum score of the aligner for a plate
  // Minimum logit of the probability that a detection is a plate (PlateClassifier); weaker ones are
  // not reported.
  double min_evidence = -2;
  int refinements = 2;  // passes of the aligner
  // Uses OpenCV's threads for plates and large maps; does not change the result.
  bool parallel = false;

  [[nodiscard]] OptionFields fields() {
    return {
        {"min_plate", min_plate, inside(0, 1), "--plate-threshold",
         "minimum plate score of the aligner"},
        {"min_evidence", min_evidence, range(-100, 100), "--evidence",
         "minimum log odds ln(p / (1 - p)) of being a plate; lower: more plates and false alarms"},
        {"refinements", refinements, range(1, 5)}};
  }
  void check() const;
};

// A line of text, rectified and cropped, with a box around each character: training data for
// train-reader.
struct TextCrop {
  cv::Mat image;                  // same type as the source image; the line's height is unchanged
  std::vector<cv::Rect2f> boxes;  // px of `image`, in the order of the text
};

// The features to which the calibration is fitted.
[[nodiscard]] CalibrationFeatures calibration_features(double posterior, double min_character,
                                                       double plate_score, double height_px);

// A detection and its text before they are classified and calibrated. PlateClassifier and the
// curves are fitted to it.
struct UncalibratedReading {
  Reading reading;                   // its `plate` is the aligner's score
  PlateClassifierFeatures features;  // all of them
  // Log odds that the text is correct, before the correction by ReaderModel::confidence_curve.
  double log_odds = 0;
  // Nats against a text without a digit: subtracted from the corrected log odds.
  double penalty = 0;
  std::vector<double> character_log_odds;  // before the correction by ReaderModel::character_curve
};

// Reads the plates of an image with the three networks. Const: any number of threads may use it.
class Recognizer {
 public:
  Recognizer(DetectorModel detector, ReaderModel reader, const CountryChoice& countries,
             const RecognizerOptions& options = {}, const DecodeOptions& decoding = {});

  // `image` is CV_8UC3 or CV_8UC1. Highest confidence first. `debug` and `timers` (find, align,
  // read) may be null. With `once`, uncertain plates are not read a second time; use it for videos,
  // where the next frame shows them again. `region` is the part to search; an empty rectangle
  // means the whole image.
  [[nodiscard]] std::vector<Reading> read(const cv::Mat& image, DebugSink* debug = nullptr,
                                          Timers* timers = nullptr, bool once = false,
                                          const cv::Rect& region = {}) const;

  // All detections of an image in no particular order, plates or not.
  [[nodiscard]] std::vector<UncalibratedReading> read_uncalibrated(const cv::Mat& image) const;

  // Reads the plate at known corners (a crop or a labelled plate). `features` may be null; it
  // receives the features of the confidence.
  [[nodiscard]] Reading read_at(const cv::Mat& image, const Quad& corners,
                                CalibrationFeatures* features = nullptr) const;

  // Locates the characters of `text` (symbols of kAlphabet) in the plate at these corners, even if
  // the network reads another text. The best alignment of `text` with the network's output gives
  // the centres of the characters, and the boxes divide the line accordingly. Returns nothing for a
  // plate of two rows or if the text does not fit.
  [[nodiscard]] std::optional<TextCrop> crop_text(const cv::Mat& image, const Quad& corners,
                                                  const std::string& text) const;

  [[nodiscard]] const ReaderModel& reader_model() const { return reader_; }

 private:
  struct AlignedDetection {
    Alignment alignment;
    float score;
    Detection detection;
  };
  [[nodiscard]] std::vector<AlignedDetection> detect_and_align(const cv::Mat& gray,
                                                               DebugSink* debug, Timers* timers,
                                                               const cv::Rect& region) const;
  [[nodiscard]] std::vector<UncalibratedReading> read_all(const cv::Mat& gray, DebugSink* debug,
                                                          Timers* timers, bool once,
                                                          const cv::Rect& region) const;
  [[nodiscard]] UncalibratedReading read_text(const cv::Mat& gray,
                                              const AlignedDetection& detection,
                                              linalg::Workspace& workspace, bool once,
                                              CalibrationFeatures* features = nullptr) const;

  [[nodiscard]] Alignment align_at(const cv::Mat& gray, const Quad& corners) const;

  DetectorModel detector_;
  ReaderModel reader_;
  std::array<Decoder, 4> decoders_;           // by AspectRange, for plates of one row
  Decoder two_row_decoder_;                   // for plates of two rows
  std::optional<Decoder> free_text_decoder_;  // set if only the countries' layouts are allowed
  RecognizerOptions options_;
};

}  // namespace tarsier::plate
