// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/recognizer.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/media/gray_image.h"
#include "tarsier/plate/networks/competing_readings.h"
#include "tarsier/plate/networks/pooled_line.h"
#include "tarsier/plate/networks/self_similarity.h"
#include "tarsier/plate/text/ctc.h"

#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::plate {
namespace {

constexpr float kMinSamePlateOverlap =
    0.4F;  // share of the smaller box that two detections have in common
constexpr int kMaxCompeting = 3;
constexpr double kUnfitPenalty = 6;  // nats: penalty and required lead of a text without a layout
constexpr double kMaxEvidenceGain = 2;  // maximum evidence that more views may add to the first one
constexpr double kWordPenalty = 3;      // nats against a text without a digit: it is mostly a sign

// The network's output for a plate: one row, or the upper and the lower of two. Several views are
// pooled in the columns of the first.
struct Lines {
  struct Line {
    Quad quad;
    int width;
    int columns;
  };
  std::vector<Line> lines;
  cv::Mat probabilities;
  cv::Mat features;  // of the first view, for plates of one row
  bool two_rows = false;
};

// Wider if the aligner has cut the text off, lower or higher if it took too much or too little.
constexpr TextView kExtraViews[] = {{1.05F, 1.14F}, {1.0F, 0.92F}, {1.12F, 1.0F}, {0.98F, 0.78F}};

// The parts of a plate that are read as one line each.
std::vector<Lines::Line> parts_of(const Quad& text, bool two_rows) {
  if (!two_rows) return {{text, kLineWidth, kLineWidth / kColumnStride}};
  return {{part_of(text, 0, 1, 0, 0.47F), kHalfLineWidth, kHalfLineWidth / kColumnStride},
          {part_of(text, 0, 1, 0.53F, 1), kHalfLineWidth, kHalfLineWidth / kColumnStride}};
}

// The same lines, pooled over all views.
Lines pooled(const cv::Mat& gray, const Lines& first, const linalg::Network& network,
             linalg::Workspace& workspace) {
  Lines result = first;
  result.probabilities = first.probabilities.clone();
  int start = 0;
  for (const Lines::Line& line : first.lines) {
    const cv::Range columns(start, start + line.columns);
    PooledLine pool(line.width);
    pool.add(first.probabilities.rowRange(columns), {});
    for (const TextView& view : kExtraViews) {
      const Quad quad = view_quad(line.quad, view);
      if (is_convex(quad, 10))
        pool.add(read_line(gray, quad, line.width, network, workspace), view);
    }
    pool.mean().copyTo(result.probabilities.rowRange(columns));
    start += line.columns + 1;
  }
  return result;
}

Lines read_lines(const cv::Mat& gray, const Quad& text, bool two_rows,
                 const linalg::Network& network, linalg::Workspace& workspace) {
  Lines result;
  result.two_rows = two_rows;
  result.lines = parts_of(text, two_rows);
  cv::Mat gap(1, kClasses, CV_32F, cv::Scalar(0));
  gap.at<float>(0, kBlank) = 1;
  for (const Lines::Line& line : result.lines) {
    if (!result.probabilities.empty()) result.probabilities.push_back(gap);
    result.probabilities.push_back(read_line(gray, line.quad, line.width, network, workspace,
                                             two_rows ? nullptr : &result.features));
  }
  return result;
}

// The line of a plate of one row, revised by comparing its characters with each other.
Lines refined(const cv::Mat& gray, const Lines& lines, const DecodedText& best) {
  Lines result = lines;
  const Lines::Line& line = lines.lines.front();
  const cv::Mat canvas = sample(gray, line.quad, line_quad(line.width), {line.width, kLineHeight});
  result.probabilities = refine_by_self_similarity({canvas, lines.features, lines.probabilities},
                                                   {best.text, best.confidences, best.columns});
  return result;
}

// One view of a plate, or several pooled, with the resulting texts.
struct Attempt {
  Lines lines;
  std::vector<DecodedText> texts;
};

double score_of(const Attempt& attempt) {
  return attempt.texts.empty() ? -1e30 : attempt.texts.front().log_score;
}

double min_confidence(const DecodedText& text) {
  return *std::min_element(text.confidences.begin(), text.confidences.end());
}

bool is_confident(const DecodedText& text) {
  return text.posterior > 0.97 && min_confidence(text) > 0.95;
}

CalibrationFeatures features_of(const DecodedText& text, const Alignment& alignment) {
  return calibration_features(text.posterior, min_confidence(text), alignment.score,
                              mean_height(alignment.text));
}

double odds_of(const Calibration& calibration, const CalibrationFeatures& features) {
  return std::inner_product(features.begin(), features.end(), calibration.weights.begin(), 0.0);
}

RegionText region_text_of(const DecodedText& text) {
  return {text.text, text.confidences, text.country};
}

constexpr double kOddsMargin = 1e-5;  // of texts and characters

// The quad of the characters in the columns first..last of all lines.
Quad character_quad(const Lines& lines, std::pair<int, int> columns) {
  int start = 0;
  for (const Lines::Line& line : lines.lines) {
    if (columns.first < start + line.columns || &line == &lines.lines.back()) {
      const float left = along(std::max(0, columns.first - start), line.width) - 0.02F;
      const float right = along(std::max(0, columns.second - start), line.width) + 0.02F;
      return part_of(line.quad, left, right, 0, 1);
    }
    start += line.columns + 1;
  }
  return {};
}

// Thread-local and kept: the networks' maps are megabytes, and allocating them for each image costs
// more than some of the layers. There is one per network, because their maps differ in size.
linalg::Workspace& thread_workspace(std::size_t network) {
  static thread_local std::array<linalg::Workspace, 3> workspaces;
  return workspaces[network];
}

}  // namespace

void RecognizerOptions::check() const {
  check_fields(*this);
  detector.check();
}

CalibrationFeatures calibration_features(double posterior, double min_character, double plate_score,
                                         double height_px) {
  const auto safe_log = [](double p) { return std::log(std::clamp(p, 1e-6, 1.0)); };
  const double score = std::clamp(plate_score, 1e-4, 1 - 1e-4);
  return {safe_log(posterior),
          safe_log(min_character),
          std::log(score / (1 - score)),
          std::log(std::max(4.0, height_px) / 20),
          1.0,
          log_odds(posterior, kOddsMargin),
          log_odds(min_character, kOddsMargin)};
}

Recognizer::Recognizer(DetectorModel detector, ReaderModel reader, const CountryChoice& countries,
                       const RecognizerOptions& options, const DecodeOptions& decoding)
    : detector_(std::move(detector)),
      reader_(std::move(reader)),
      decoders_{Decoder(weighted_by_aspect(countries, AspectRange::kLong), decoding),
                Decoder(weighted_by_aspect(countries, AspectRange::kMedium), decoding),
                Decoder(weighted_by_aspect(countries, AspectRange::kMediumShort), decoding),
                Decoder(weighted_by_aspect(countries, AspectRange::kShort), decoding)},
      two_row_decoder_(countries, decoding),
      options_(options) {
  if (!countries.free_text) free_text_decoder_.emplace(CountryChoice{{}, true}, decoding);
  options_.check();
}

std::vector<Recognizer::AlignedDetection> Recognizer::detect_and_align(
    const cv::Mat& gray, DebugSink* debug, Timers* timers, const cv::Rect& region) const {
  linalg::Workspace& workspace = thread_workspace(0);
  DetectorOptions options = options_.detector;
  options.parallel = options_.parallel;
  std::vector<Detection> detections;
  {
    const Timers::Scope scope(timers, "find");
    detections = detect(gray, detector_.detector, options, workspace, region);
  }
  const Timers::Scope scope(timers, "align");
  std::vector<AlignedDetection> aligned(detections.size());
  const auto refine = [&](std::size_t i) {
    linalg::Workspace& own = thread_workspace(1);
    aligned[i].detection = detections[i];
    Quad corners = detections[i].corners;
    for (int pass = 0; pass < options_.refinements; ++pass) {
      aligned[i].alignment = align(gray, corners, detector_.aligner, own);
      aligned[i].score = aligned[i].alignment.score;
      if (!is_convex(aligned[i].alignment.plate, 30) || !is_convex(aligned[i].alignment.text, 10) ||
          aligned[i].score < 0.1F) {
        aligned[i].score = 0;
        return;
      }
      corners = aligned[i].alignment.plate;
    }
  };
  const auto refine_some = [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) refine(static_cast<std::size_t>(i));
  };
  const cv::Range all(0, static_cast<int>(detections.size()));
  if (options_.parallel && detections.size() > 1)
    cv::parallel_for_(all, refine_some);
  else
    refine_some(all);
  std::stable_sort(
      aligned.begin(), aligned.end(),
      [](const AlignedDetection& a, const AlignedDetection& b) { return a.score > b.score; });
  // Of nearly equal detections the best is kept. Different ones that overlap (a part of a plate, a
  // plate and its frame) are judged by their text.
  std::vector<AlignedDetection> accepted;
  for (const AlignedDetection& candidate : aligned) {
    if (candidate.score < options_.min_plate) continue;
    const Quad& plate = candidate.alignment.plate;
    const auto competing =
        std::count_if(accepted.begin(), accepted.end(), [&](const AlignedDetection& other) {
          return box_overlap_of_smaller(other.alignment.plate, plate) > kMinSamePlateOverlap;
        });
    const bool is_duplicate =
        std::any_of(accepted.begin(), accepted.end(), [&](const AlignedDetection& other) {
          return box_iou(other.alignment.plate, plate) > 0.7F;
        });
    if (!is_duplicate && competing < kMaxCompeting) accepted.push_back(candidate);
  }
  if (debug != nullptr) {
    cv::Mat image;
    cv::cvtColor(gray, image, cv::COLOR_GRAY2BGR);
    const auto outline = [&](const Quad& quad, const cv::Scalar& color) {
      std::array<cv::Point, 4> points;
      for (std::size_t i = 0; i < 4; ++i) points[i] = quad[i];
      cv::polylines(image, std::vector<cv::Point>(points.begin(), points.end()), true, color, 1,
                    cv::LINE_AA);
    };
    for (const Detection& detection : detections) outline(detection.corners, {0, 160, 255});
    debug->image("detected", image);
    for (const AlignedDetection& candidate : accepted) {
      outline(candidate.alignment.plate, {0, 0, 255});
      outline(candidate.alignment.text, {0, 255, 0});
    }
    debug->image("aligned", image);
    int number = 0;
    for (const AlignedDetection& candidate : accepted) {
      ++number;
      debug->image(
          fmt::format("line-{}", number),
          sample(gray, candidate.alignment.text, line_quad(kLineWidth), {kLineWidth, kLineHeight}));
    }
  }
  return accepted;
}

UncalibratedReading Recognizer::read_text(const cv::Mat& gray, const AlignedDetection& aligned,
                                          linalg::Workspace& workspace, bool once,
                                          CalibrationFeatures* features_out) const {
  const Alignment& alignment = aligned.alignment;
  UncalibratedReading result;
  result.features = plate_classifier_features(aligned.detection, alignment, {});
  Reading& reading = result.reading;
  reading.plate = static_cast<double>(alignment.score);
  reading.corners = alignment.plate;
  reading.box = bounding_box(alignment.plate, gray.size());
  const AspectRange range =
      aspect_range(mean_width(alignment.plate) / mean_height(alignment.plate));
  const auto attempt = [&](Lines lines) {
    const Decoder& decoder =
        lines.two_rows ? two_row_decoder_ : decoders_[static_cast<std::size_t>(range)];
    std::vector<DecodedText> texts = decoder.decode(lines.probabilities);
    return Attempt{std::move(lines), std::move(texts)};
  };
  const auto read_as = [&](bool two_rows) {
    return attempt(read_lines(gray, alignment.text, two_rows, reader_.line, workspace));
  };
  Attempt chosen = read_as(alignment.two_rows > 0.5F);
  if (alignment.two_rows > 0.1F && alignment.two_rows < 0.9F) {
    Attempt other = read_as(alignment.two_rows <= 0.5F);
    if (score_of(other) > score_of(chosen)) chosen = std::move(other);
  }
  // Does the text look like a plate of the requested countries? Only the first view is used,
  // because the mean of several is never as far from a text that does not fit.
  DecodedText any;
  if (free_text_decoder_) {
    any.acoustic = chosen.texts.empty() ? -1e30 : chosen.texts.front().acoustic + kUnfitPenalty;
    const std::vector<DecodedText> free = free_text_decoder_->decode(chosen.lines.probabilities);
    if (!free.empty() && free.front().acoustic > any.acoustic) any = free.front();
    reading.unfit = any.text;
  }
  // Takes more views if the text of a certain plate is uncertain, but not if it is so poor that it
  // will not be reported.
  const auto needs_more_views = [&](const DecodedText& text) {
    const PlateClassifierFeatures features =
        plate_classifier_features(aligned.detection, alignment, region_text_of(text));
    return !is_confident(text) &&
           reader_.plate_classifier.log_odds(features) > options_.min_evidence - kMaxEvidenceGain;
  };
  if (!once && reading.unfit.empty() && alignment.score > 0.8F &&
      (chosen.texts.empty() || needs_more_views(chosen.texts.front())))
    chosen = attempt(pooled(gray, chosen.lines, reader_.line, workspace));
  if (!chosen.lines.two_rows && reading.unfit.empty() && !chosen.texts.empty() &&
      !is_confident(chosen.texts.front()))
    chosen = attempt(refined(gray, chosen.lines, chosen.texts.front()));
  const Lines& lines = chosen.lines;
  const std::vector<DecodedText>& texts = chosen.texts;
  reading.rows = lines.two_rows ? 2 : 1;
  if (texts.empty()) return result;
  const DecodedText& best = texts.front();
  reading.text = best.text;
  reading.country = best.country;
  for (std::size_t i = 0; i < best.text.size(); ++i) {
    Character character;
    character.symbol = best.text[i];
    result.character_log_odds.push_back(log_odds(best.confidences[i], kOddsMargin));
    character.confidence = logistic(reader_.character_curve(result.character_log_odds.back()));
    character.corners = character_quad(lines, best.columns[i]);
    reading.characters.push_back(character);
  }
  // The quality of the reading is that of the visible text: it decides among competing readings.
  const DecodedText& visible_text = reading.unfit.empty() ? best : any;
  const CalibrationFeatures features = features_of(visible_text, alignment);
  if (features_out != nullptr) *features_out = features;
  result.features =
      plate_classifier_features(aligned.detection, alignment, region_text_of(visible_text));
  result.log_odds = odds_of(reader_.calibration, features);
  if (best.text.find_first_of("0123456789") == std::string::npos) result.penalty = kWordPenalty;
  double odds = reader_.confidence_curve(result.log_odds) - result.penalty;
  if (!reading.unfit.empty()) odds = std::min(odds, 0.0) - kUnfitPenalty;
  reading.confidence = logistic(odds);
  // The rest is distributed among the other texts by the decoder's weights.
  const double others = std::max(1e-9, 1 - best.posterior);
  for (std::size_t i = 0; i < texts.size(); ++i) {
    const double confidence =
        i == 0 ? reading.confidence
               : std::min(reading.confidence,
                          (1 - reading.confidence) * std::min(1.0, texts[i].posterior / others));
    reading.candidates.push_back({texts[i].text, confidence, texts[i].country});
  }
  return result;
}

std::vector<UncalibratedReading> Recognizer::read_all(const cv::Mat& gray, DebugSink* debug,
                                                      Timers* timers, bool once,
                                                      const cv::Rect& region) const {
  const std::vector<AlignedDetection> detections = detect_and_align(gray, debug, timers, region);
  std::vector<UncalibratedReading> results(detections.size());
  const auto read_some = [&](const cv::Range& range) {
    linalg::Workspace& workspace = thread_workspace(2);
    for (int i = range.start; i < range.end; ++i)
      results[static_cast<std::size_t>(i)] =
          read_text(gray, detections[static_cast<std::size_t>(i)], workspace, once);
  };
  const Timers::Scope scope(timers, "read");
  const cv::Range all(0, static_cast<int>(detections.size()));
  if (options_.parallel && detections.size() > 1)
    cv::parallel_for_(all, read_some);
  else
    read_some(all);
  return results;
}

std::vector<UncalibratedReading> Recognizer::read_uncalibrated(const cv::Mat& image) const {
  std::vector<UncalibratedReading> results = read_all(gray_of(image), nullptr, nullptr, false, {});
  std::vector<Reading> readings;
  std::vector<PlateClassifierFeatures> features;
  for (const UncalibratedReading& plate : results) {
    readings.push_back(plate.reading);
    features.push_back(plate.features);
  }
  set_relative_evidence(readings, features);
  for (std::size_t i = 0; i < results.size(); ++i) results[i].features = features[i];
  return results;
}

std::vector<Reading> Recognizer::read(const cv::Mat& image, DebugSink* debug, Timers* timers,
                                      bool once, const cv::Rect& region) const {
  std::vector<Reading> readings;
  std::vector<PlateClassifierFeatures> features;
  for (UncalibratedReading& plate : read_all(gray_of(image), debug, timers, once, region)) {
    readings.push_back(std::move(plate.reading));
    features.push_back(plate.features);
  }
  set_relative_evidence(readings, features);
  const std::vector<bool> slogans = are_slogans(readings);
  std::vector<Reading> plates;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    const double odds = reader_.plate_classifier.log_odds(features[i]);
    if (slogans[i] || readings[i].text.empty() || odds < options_.min_evidence) continue;
    readings[i].plate = logistic(odds);
    plates.push_back(std::move(readings[i]));
  }
  return suppress_competing(std::move(plates));
}

Alignment Recognizer::align_at(const cv::Mat& gray, const Quad& corners) const {
  linalg::Workspace& workspace = thread_workspace(1);
  Alignment alignment;
  Quad now = corners;
  for (int pass = 0; pass < options_.refinements; ++pass) {
    alignment = align(gray, now, detector_.aligner, workspace);
    if (!is_convex(alignment.plate, 30) || !is_convex(alignment.text, 10)) {
      alignment.plate = alignment.text = corners;
      break;
    }
    now = alignment.plate;
  }
  return alignment;
}

std::optional<TextCrop> Recognizer::crop_text(const cv::Mat& image, const Quad& corners,
                                              const std::string& text) const {
  // Share of a column's non-blank probability that is added to each character of the text.
  constexpr float kSmoothing = 0.2F;
  constexpr float kFill = 0.9F;  // share of the distance of two centres that the characters take
  std::vector<int> classes;
  for (const char symbol : text) classes.push_back(class_of(symbol));
  TARSIER_REQUIRE(!text.empty() && *std::min_element(classes.begin(), classes.end()) >= 0,
                  "the text '{}'", text);
  const Alignment alignment = align_at(gray_of(image), corners);
  if (alignment.two_rows > 0.5F) return std::nullopt;
  const cv::Mat probabilities =
      read_line(gray_of(image), alignment.text, kLineWidth, reader_.line, thread_workspace(2));
  cv::Mat smoothed = probabilities.clone();
  for (int column = 0; column < probabilities.rows; ++column) {
    const float character = 1 - probabilities.at<float>(column, kBlank);
    for (const int symbol : classes) smoothed.at<float>(column, symbol) += kSmoothing * character;
  }
  smoothed = cv::max(smoothed, 1e-6F);
  const auto spans = best_alignment(smoothed, classes);
  if (spans.size() != classes.size()) return std::nullopt;

  TextCrop crop;
  const auto height = std::clamp(mean_height(alignment.text), 12.0F, 160.0F);
  const auto width = std::clamp(mean_width(alignment.text), 2 * height, 8 * height);
  const float margin = height / 2;
  const Quad line = quad_of(cv::Rect2f(margin, margin, width, height));
  const cv::Size size(cvRound(width + 2 * margin), cvRound(height + 2 * margin));
  cv::warpPerspective(image, crop.image, map_between(alignment.text, line), size, cv::INTER_LINEAR,
                      cv::BORDER_REPLICATE);
  // The network responds around each character's centre.
  std::vector<float> centers;
  for (const auto& [first, last] : spans) {
    const float center = 0.5F * (along(first, kLineWidth) + along(last, kLineWidth));
    centers.push_back(margin + width * std::clamp(center, 0.0F, 1.0F));
  }
  for (std::size_t k = 0; k < centers.size(); ++k) {
    // The line's ends are those of the outer characters.
    const float before = k == 0 ? 2 * (centers[0] - margin) : kFill * (centers[k] - centers[k - 1]);
    const float after = k + 1 == centers.size() ? 2 * (margin + width - centers[k])
                                                : kFill * (centers[k + 1] - centers[k]);
    const float box_width = std::max(2.0F, std::min(before, after));
    crop.boxes.emplace_back(centers[k] - box_width / 2, margin, box_width, height);
  }
  return crop;
}

Reading Recognizer::read_at(const cv::Mat& image, const Quad& corners,
                            CalibrationFeatures* features) const {
  const cv::Mat gray = gray_of(image);
  AlignedDetection aligned;
  aligned.alignment = align_at(gray, corners);
  aligned.score = aligned.alignment.score;
  aligned.detection = {corners, 1};
  return read_text(gray, aligned, thread_workspace(2), false, features).reading;
}

}  // namespace tarsier::plate
