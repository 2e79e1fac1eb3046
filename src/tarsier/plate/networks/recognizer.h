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

// Turns what is known of a reading into the chance that its whole text is right: logistic
// regression on log posterior, log of the least sure character, logit of the aligner, log of the
// plate's height in px, a constant, and the logits of posterior and least sure character (which
// tell a posterior of 0.99 from one of 0.9999; models of before have no weight for them).
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
  OddsCurve confidence;  // corrects what the calibration gives
  OddsCurve character;   // corrects the decoder's confidence of a character
  PlateJudge judge;
};

// models/plate-detector.json and models/plate-reader.json. Throw ModelError, OutputError.
[[nodiscard]] DetectorModel read_detector_model(const std::string& path);
[[nodiscard]] ReaderModel read_reader_model(const std::string& path);
void write_detector_model(const std::string& path, const DetectorModel& model,
                          const nlohmann::json& provenance);
void write_reader_model(const std::string& path, const ReaderModel& model,
                        const nlohmann::json& provenance);

struct RecognizerOptions {
  DetectorOptions detector;
  float min_plate = 0.9F;  // the aligner's score of what is taken for a plate
  // Least logit of the chance that it is a plate (PlateJudge) of what is reported.
  double min_evidence = -2;
  int refinements = 2;    // passes of the aligner
  bool parallel = false;  // plates and large maps on OpenCV's threads; changes no result

  [[nodiscard]] OptionFields fields() {
    return {
        {"min_plate", min_plate, inside(0, 1), "--plate-threshold", "of the aligner's plate score"},
        {"min_evidence", min_evidence, range(-100, 100), "--evidence",
         "ln(p / (1 - p)) of the chance p that it is a plate; lower: more, of which more are none"},
        {"refinements", refinements, range(1, 5)}};
  }
  void check() const;
};

// A plate's line of text cut out straight, with a box around each character: what train-reader
// takes.
struct TextCrop {
  cv::Mat image;                  // as the image it is of, the line's height as it was
  std::vector<cv::Rect2f> boxes;  // px of `image`, in the order of the text
};

// What calibration is fitted to.
[[nodiscard]] CalibrationFeatures calibration_features(double posterior, double min_character,
                                                       double plate_score, double height_px);

// A find and what was read there, before it is judged: what PlateJudge and the curves are fitted to.
struct SeenPlate {
  Reading reading;        // its `plate` is the aligner's score
  FindFeatures features;  // all of them
  double odds = 0;        // that the text is right, before ReaderModel::confidence corrects them
  double penalty = 0;  // that is taken from the corrected odds: nats against a text without a digit
  std::vector<double> character_odds;  // before ReaderModel::character does
};

// Plates of an image by the three networks. Const: any number of threads may use it.
class Recognizer {
 public:
  Recognizer(DetectorModel detector, ReaderModel reader, CountryChoice countries,
             const RecognizerOptions& options = {}, const DecodeOptions& decoding = {});

  // Image: CV_8UC3 or CV_8UC1. Surest first. `debug` and `timers` (find, align, read) may be null.
  // `once`: does not look again where it is unsure, as the next frame of a video is a look, too.
  // `where`: plates are looked for in this part of the image; empty: in all of it.
  [[nodiscard]] std::vector<Reading> read(const cv::Mat& image, DebugSink* debug = nullptr,
                                          Timers* timers = nullptr, bool once = false,
                                          const cv::Rect& where = {}) const;

  // Every find of an image, plate or not, in no order.
  [[nodiscard]] std::vector<SeenPlate> see(const cv::Mat& image) const;

  // Reads the plate at known corners (a crop, a labelled plate). `features`, if given, becomes what
  // its confidence was worked out from.
  [[nodiscard]] Reading read_at(const cv::Mat& image, const Quad& corners,
                                CalibrationFeatures* features = nullptr) const;

  // Where the characters of `text` (symbols of kAlphabet) lie in the plate at these corners, by the
  // best alignment of that text with what the network sees, however badly it reads it: the boxes
  // share the line as the characters' middles say. Nothing for a plate of two rows, or where the
  // text does not fit.
  [[nodiscard]] std::optional<TextCrop> cut_text(const cv::Mat& image, const Quad& corners,
                                                 const std::string& text) const;

  [[nodiscard]] const ReaderModel& reader_model() const { return reader_; }

 private:
  struct Find {
    Alignment alignment;
    float score;
    Detection detection;
  };
  [[nodiscard]] std::vector<Find> find(const cv::Mat& gray, DebugSink* debug, Timers* timers,
                                       const cv::Rect& where) const;
  [[nodiscard]] std::vector<SeenPlate> see_all(const cv::Mat& gray, DebugSink* debug,
                                               Timers* timers, bool once,
                                               const cv::Rect& where) const;
  [[nodiscard]] SeenPlate read_text(const cv::Mat& gray, const Find& find,
                                    linalg::Workspace& workspace, bool once,
                                    CalibrationFeatures* features = nullptr) const;

  [[nodiscard]] Alignment align_at(const cv::Mat& gray, const Quad& corners) const;

  DetectorModel detector_;
  ReaderModel reader_;
  std::array<Decoder, 4> decoders_;  // by PlateForm, for plates of one row
  Decoder decoder_;                  // for those of two
  std::optional<Decoder> any_text_;  // where the countries' layouts alone are allowed
  RecognizerOptions options_;
};

}  // namespace tarsier::plate
