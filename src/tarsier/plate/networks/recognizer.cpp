// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/recognizer.h"

#include "tarsier/core/require.h"
#include "tarsier/plate/text/ctc.h"

#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace tarsier::plate {
namespace {

constexpr float kSamePlate = 0.4F;  // share of the smaller box that two finds have in common
constexpr float kRival = 0.6F;      // .. and from which only one of them is reported
constexpr int kMaxRivals = 3;
constexpr double kWordPenalty = 3;  // nats against a text without a digit: mostly it is a sign

cv::Mat gray_of(const cv::Mat& image) {
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
                  "an image of type {}", image.type());
  if (image.channels() == 1) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

// Where in the canvas of width `width` the output column lies, 0..1 of the text's quad.
float along(int column, int width) {
  const float x = (static_cast<float>(column) + 0.5F) * kColumn - 0.5F;
  return (x - kLineMargin) / static_cast<float>(width - 2 * kLineMargin);
}

// The lines of a plate: one row, or the upper and the lower of two.
struct Lines {
  struct Line {
    Quad quad;
    int width;
    int columns;
  };
  std::vector<Line> lines;
  cv::Mat probabilities;
};

Lines read_lines(const cv::Mat& gray, const Quad& text, bool two_rows,
                 const linalg::Network& network, linalg::Workspace& workspace) {
  Lines result;
  if (!two_rows) {
    result.probabilities = read_line(gray, text, kLineWidth, network, workspace);
    result.lines.push_back({text, kLineWidth, result.probabilities.rows});
    return result;
  }
  const Quad rows[2] = {part_of(text, 0, 1, 0, 0.47F), part_of(text, 0, 1, 0.53F, 1)};
  cv::Mat gap(1, kClasses, CV_32F, cv::Scalar(0));
  gap.at<float>(0, kBlank) = 1;
  for (const Quad& row : rows) {
    const cv::Mat part = read_line(gray, row, kHalfWidth, network, workspace);
    if (!result.probabilities.empty()) result.probabilities.push_back(gap);
    result.probabilities.push_back(part);
    result.lines.push_back({row, kHalfWidth, part.rows});
  }
  return result;
}

// One look at a plate, and the texts that it gave.
struct Attempt {
  Lines lines;
  std::vector<Decoded> texts;
  bool two_rows = false;
};

double score_of(const Attempt& attempt) {
  return attempt.texts.empty() ? -1e30 : attempt.texts.front().log_score;
}

bool is_sure(const Attempt& attempt) {
  if (attempt.texts.empty()) return false;
  const Decoded& best = attempt.texts.front();
  return best.posterior > 0.97 &&
         *std::min_element(best.confidences.begin(), best.confidences.end()) > 0.95;
}

// Makes the texts' probabilities the mean of all looks', and returns the look whose best text is
// the best of all (its texts in the new order).
std::size_t merge(std::vector<Attempt>& attempts) {
  if (attempts.size() == 1) return 0;
  std::map<std::string, double> sum;
  for (const Attempt& attempt : attempts)
    for (const Decoded& text : attempt.texts)
      sum[text.text] += text.posterior / static_cast<double>(attempts.size());
  std::size_t chosen = 0;
  double best = -1;
  for (std::size_t i = 0; i < attempts.size(); ++i) {
    std::vector<Decoded>& texts = attempts[i].texts;
    double own = 0;
    for (Decoded& text : texts) {
      // Among looks that agree, the one that is surest of the text shows its characters.
      own = std::max(own, sum[text.text] + 1e-3 * text.posterior);
      text.posterior = sum[text.text];
    }
    std::stable_sort(texts.begin(), texts.end(),
                     [](const Decoded& a, const Decoded& b) { return a.posterior > b.posterior; });
    if (own > best) {
      best = own;
      chosen = i;
    }
  }
  return chosen;
}

// The quad of the characters' columns first..last of all lines' columns.
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

// A thread's own, kept: the networks' maps are megabytes, and making them again for each image
// costs more than some of the layers. One for each network, as their maps differ in size.
linalg::Workspace& kept_workspace(std::size_t network) {
  static thread_local std::array<linalg::Workspace, 3> workspaces;
  return workspaces[network];
}

double logit(double p) {
  p = std::clamp(p, 1e-4, 1 - 1e-4);
  return std::log(p / (1 - p));
}

double log_confidence(const Reading& reading) {
  return std::log(std::max(reading.confidence, 1e-5));
}

// Of rivals for one place one stays: what is most certainly a whole plate and reads well. Half a
// plate may read as well as the whole one, but the aligner knows it is not.
std::vector<Reading> without_rivals(std::vector<Reading> readings) {
  const auto key = [&](std::size_t i) {
    return log_confidence(readings[i]) + 0.5 * logit(std::min(readings[i].plate, 0.998));
  };
  std::vector<std::size_t> order(readings.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return key(a) > key(b); });
  std::vector<std::size_t> chosen;
  for (const std::size_t i : order) {
    const auto rival = std::find_if(chosen.begin(), chosen.end(), [&](std::size_t other) {
      return box_cover(readings[other].corners, readings[i].corners) > kRival;
    });
    if (rival == chosen.end()) {
      chosen.push_back(i);
    } else if (readings[i].text == readings[*rival].text &&
               readings[i].box.area() < readings[*rival].box.area()) {
      *rival = i;  // what reads the same in a tighter box is the plate itself
    }
  }
  std::vector<Reading> kept;
  for (const std::size_t i : chosen) kept.push_back(std::move(readings[i]));
  std::stable_sort(kept.begin(), kept.end(),
                   [](const Reading& a, const Reading& b) { return a.confidence > b.confidence; });
  return kept;
}

}  // namespace

void RecognizerOptions::check() const {
  check_fields(*this);
  detector.check();
}

std::array<double, 5> calibration_features(double posterior, double min_character,
                                           double plate_score, double height_px) {
  const auto safe_log = [](double p) { return std::log(std::clamp(p, 1e-6, 1.0)); };
  const double score = std::clamp(plate_score, 1e-4, 1 - 1e-4);
  return {safe_log(posterior), safe_log(min_character), std::log(score / (1 - score)),
          std::log(std::max(4.0, height_px) / 20), 1.0};
}

Recognizer::Recognizer(DetectorModel detector, ReaderModel reader, CountryChoice countries,
                       const RecognizerOptions& options, const DecodeOptions& decoding)
    : detector_(std::move(detector)),
      reader_(std::move(reader)),
      decoders_{Decoder(weighed_by_form(countries, PlateForm::kLong), decoding),
                Decoder(weighed_by_form(countries, PlateForm::kBetween), decoding),
                Decoder(weighed_by_form(countries, PlateForm::kShort), decoding)},
      decoder_(std::move(countries), decoding),
      options_(options) {
  options_.check();
}

std::vector<Recognizer::Find> Recognizer::find(const cv::Mat& gray, DebugSink* debug,
                                               Timers* timers) const {
  linalg::Workspace& workspace = kept_workspace(0);
  DetectorOptions options = options_.detector;
  options.parallel = options_.parallel;
  std::vector<Detection> detections;
  {
    const Timers::Scope scope(timers, "find");
    detections = detect(gray, detector_.detector, options, workspace);
  }
  const Timers::Scope scope(timers, "align");
  std::vector<Find> finds(detections.size());
  const auto refine = [&](std::size_t i) {
    linalg::Workspace& own = kept_workspace(1);
    Quad corners = detections[i].corners;
    for (int pass = 0; pass < options_.refinements; ++pass) {
      finds[i].alignment = align(gray, corners, detector_.aligner, own);
      finds[i].score = finds[i].alignment.score;
      if (!is_convex(finds[i].alignment.plate, 30) || !is_convex(finds[i].alignment.text, 10) ||
          finds[i].score < 0.1F) {
        finds[i].score = 0;
        return;
      }
      corners = finds[i].alignment.plate;
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
  std::stable_sort(finds.begin(), finds.end(),
                   [](const Find& a, const Find& b) { return a.score > b.score; });
  // Of finds that are nearly the same the surest stays; different ones that overlap (a part of a
  // plate, a plate and its frame) are judged by what can be read in them.
  std::vector<Find> kept;
  for (const Find& find : finds) {
    if (find.score < options_.min_plate) continue;
    const Quad& plate = find.alignment.plate;
    const auto rivals = std::count_if(kept.begin(), kept.end(), [&](const Find& other) {
      return box_cover(other.alignment.plate, plate) > kSamePlate;
    });
    const bool again = std::any_of(kept.begin(), kept.end(), [&](const Find& other) {
      return box_overlap(other.alignment.plate, plate) > 0.7F;
    });
    if (!again && rivals < kMaxRivals) kept.push_back(find);
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
    for (const Find& find : kept) {
      outline(find.alignment.plate, {0, 0, 255});
      outline(find.alignment.text, {0, 255, 0});
    }
    debug->image("aligned", image);
    int number = 0;
    for (const Find& find : kept) {
      ++number;
      debug->image(
          "line-" + std::to_string(number),
          sample(gray, find.alignment.text, line_quad(kLineWidth), {kLineWidth, kLineHeight}));
    }
  }
  return kept;
}

Reading Recognizer::read_text(const cv::Mat& gray, const Alignment& alignment,
                              linalg::Workspace& workspace, bool once,
                              std::array<double, 5>* given) const {
  Reading reading;
  reading.plate = static_cast<double>(alignment.score);
  reading.corners = alignment.plate;
  reading.box = bounding_box(alignment.plate, gray.size());
  std::vector<Attempt> attempts;
  const PlateForm form = plate_form(mean_width(alignment.plate) / mean_height(alignment.plate));
  const auto attempt = [&](const Quad& text, bool two_rows) {
    Attempt one;
    one.two_rows = two_rows;
    one.lines = read_lines(gray, text, two_rows, reader_.line, workspace);
    const Decoder& decoder = two_rows ? decoder_ : decoders_[static_cast<std::size_t>(form)];
    one.texts = decoder.decode(one.lines.probabilities);
    attempts.push_back(std::move(one));
  };
  attempt(alignment.text, alignment.two_rows > 0.5F);
  if (alignment.two_rows > 0.1F && alignment.two_rows < 0.9F) {
    attempt(alignment.text, alignment.two_rows <= 0.5F);
    if (score_of(attempts[1]) > score_of(attempts[0])) std::swap(attempts[0], attempts[1]);
    attempts.pop_back();
  }
  // Where it is not sure of what is certainly a plate, it looks again, a little wider and a little
  // narrower.
  if (!once && alignment.score > 0.8F && !is_sure(attempts[0])) {
    const bool rows = attempts[0].two_rows;
    for (const auto& [along_text, across] : {std::pair{1.05F, 1.14F}, std::pair{1.0F, 0.92F}}) {
      const Quad other = grow(alignment.text, along_text, across);
      if (is_convex(other, 10)) attempt(other, rows);
    }
  }
  const Attempt& chosen = attempts[merge(attempts)];
  const Lines& lines = chosen.lines;
  const std::vector<Decoded>& texts = chosen.texts;
  reading.rows = chosen.two_rows ? 2 : 1;
  if (texts.empty()) return reading;
  const Decoded& best = texts.front();
  reading.text = best.text;
  reading.country = best.country;
  double least = 1;
  for (std::size_t i = 0; i < best.text.size(); ++i) {
    Character character;
    character.symbol = best.text[i];
    character.confidence = best.confidences[i];
    character.corners = character_quad(lines, best.columns[i]);
    least = std::min(least, character.confidence);
    reading.characters.push_back(character);
  }
  const auto features =
      calibration_features(best.posterior, least, alignment.score, mean_height(alignment.text));
  if (given != nullptr) *given = features;
  double logit = 0;
  for (std::size_t i = 0; i < features.size(); ++i)
    logit += features[i] * reader_.calibration.weights[i];
  if (best.text.find_first_of("0123456789") == std::string::npos) logit -= kWordPenalty;
  reading.confidence = 1 / (1 + std::exp(-logit));
  // The rest is shared out among the others as the decoder weighs them.
  const double others = std::max(1e-9, 1 - best.posterior);
  for (std::size_t i = 0; i < texts.size(); ++i) {
    const double confidence =
        i == 0 ? reading.confidence
               : std::min(reading.confidence,
                          (1 - reading.confidence) * std::min(1.0, texts[i].posterior / others));
    reading.candidates.push_back({texts[i].text, confidence, texts[i].country});
  }
  return reading;
}

std::vector<Reading> Recognizer::read(const cv::Mat& image, DebugSink* debug, Timers* timers,
                                      bool once) const {
  const cv::Mat gray = gray_of(image);
  const std::vector<Find> finds = find(gray, debug, timers);
  std::vector<Reading> readings(finds.size());
  const auto read_some = [&](const cv::Range& range) {
    linalg::Workspace& workspace = kept_workspace(2);
    for (int i = range.start; i < range.end; ++i)
      readings[static_cast<std::size_t>(i)] =
          read_text(gray, finds[static_cast<std::size_t>(i)].alignment, workspace, once);
  };
  const Timers::Scope scope(timers, "read");
  const cv::Range all(0, static_cast<int>(finds.size()));
  if (options_.parallel && finds.size() > 1)
    cv::parallel_for_(all, read_some);
  else
    read_some(all);
  std::erase_if(readings, [&](const Reading& reading) {
    return log_confidence(reading) + logit(reading.plate) < options_.min_evidence;
  });
  return without_rivals(std::move(readings));
}

Alignment Recognizer::align_at(const cv::Mat& gray, const Quad& corners) const {
  linalg::Workspace& workspace = kept_workspace(1);
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

std::optional<TextCrop> Recognizer::cut_text(const cv::Mat& image, const Quad& corners,
                                             const std::string& text) const {
  constexpr float kDoubt = 0.2F;  // of a column that shows some character, for each of the text's
  constexpr float kFill = 0.9F;   // of the room between two middles that the characters take
  std::vector<int> classes;
  for (const char symbol : text) classes.push_back(class_of(symbol));
  TARSIER_REQUIRE(!text.empty() && *std::min_element(classes.begin(), classes.end()) >= 0,
                  "the text '{}'", text);
  const Alignment alignment = align_at(gray_of(image), corners);
  if (alignment.two_rows > 0.5F) return std::nullopt;
  const cv::Mat seen =
      read_line(gray_of(image), alignment.text, kLineWidth, reader_.line, kept_workspace(2));
  cv::Mat doubted = seen.clone();
  for (int column = 0; column < seen.rows; ++column) {
    const float character = 1 - seen.at<float>(column, kBlank);
    for (const int symbol : classes) doubted.at<float>(column, symbol) += kDoubt * character;
  }
  doubted = cv::max(doubted, 1e-6F);
  const auto spans = best_alignment(doubted, classes);
  if (spans.size() != classes.size()) return std::nullopt;

  TextCrop crop;
  const auto height = std::clamp(mean_height(alignment.text), 12.0F, 160.0F);
  const auto width = std::clamp(mean_width(alignment.text), 2 * height, 8 * height);
  const float margin = height / 2;
  const Quad line = quad_of(cv::Rect2f(margin, margin, width, height));
  const cv::Size size(cvRound(width + 2 * margin), cvRound(height + 2 * margin));
  cv::warpPerspective(image, crop.image, map_between(alignment.text, line), size, cv::INTER_LINEAR,
                      cv::BORDER_REPLICATE);
  // The network answers around each character's middle.
  std::vector<float> middles;
  for (const auto& [first, last] : spans) {
    const float middle = 0.5F * (along(first, kLineWidth) + along(last, kLineWidth));
    middles.push_back(margin + width * std::clamp(middle, 0.0F, 1.0F));
  }
  for (std::size_t k = 0; k < middles.size(); ++k) {
    // The line's ends are those of the outer characters.
    const float before = k == 0 ? 2 * (middles[0] - margin) : kFill * (middles[k] - middles[k - 1]);
    const float after = k + 1 == middles.size() ? 2 * (margin + width - middles[k])
                                                : kFill * (middles[k + 1] - middles[k]);
    const float wide = std::max(2.0F, std::min(before, after));
    crop.boxes.emplace_back(middles[k] - wide / 2, margin, wide, height);
  }
  return crop;
}

Reading Recognizer::read_at(const cv::Mat& image, const Quad& corners,
                            std::array<double, 5>* features) const {
  const cv::Mat gray = gray_of(image);
  const Alignment alignment = align_at(gray, corners);
  return read_text(gray, alignment, kept_workspace(2), false, features);
}

}  // namespace tarsier::plate
