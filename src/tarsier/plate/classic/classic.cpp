// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/classic.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/require.h"
#include "tarsier/media/gray_image.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::plate {
namespace {

constexpr std::size_t kMinCharacters = 4;
constexpr std::size_t kMaxCharacters = 8;
constexpr double kCharacterBonus = 1.2;  // nats for each further character
constexpr double kMaxOverlap = 0.3;
// Minimum probability of the SVM for reporting a plate without text.
constexpr double kMinPlateWithoutText = 0.5;

// The characters of a plate form a line and have the same height; other segments (the band, rivets)
// are removed.
void keep_aligned_segments(std::vector<Segment>& segments) {
  if (segments.size() < 3) return;
  std::vector<int> heights;
  std::vector<int> centers;
  for (const Segment& segment : segments) {
    heights.push_back(segment.box.height);
    centers.push_back(segment.box.y + segment.box.height / 2);
  }
  const auto median = [](std::vector<int> values) {
    std::nth_element(values.begin(),
                     values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
    return values[values.size() / 2];
  };
  const int height = median(heights);
  const int center = median(centers);
  std::erase_if(segments, [&](const Segment& segment) {
    return std::abs(segment.box.height - height) > 0.2 * height ||
           std::abs(segment.box.y + segment.box.height / 2 - center) > 0.25 * height;
  });
}

Quad in_image(const Quad& corners, const cv::Rect& box, cv::Size canvas) {
  const cv::Point2f across = (corners[1] - corners[0]) / static_cast<float>(canvas.width);
  const cv::Point2f down = (corners[3] - corners[0]) / static_cast<float>(canvas.height);
  const auto at = [&](int x, int y) {
    return corners[0] + across * static_cast<float>(x) + down * static_cast<float>(y);
  };
  return {at(box.x, box.y), at(box.x + box.width, box.y), at(box.x + box.width, box.y + box.height),
          at(box.x, box.y + box.height)};
}

// A row often holds more than the plate's characters: the band's letter, an edge, a rivet. If the
// reader knows only the symbols of Spanish plates, keeps the seven neighbours that are most likely
// four digits and three letters, if each of them is plausible.
void keep_spanish_characters(ClassicText& row, const std::string& symbols) {
  constexpr std::size_t kDigits = 4;
  constexpr std::size_t kCharacters = 7;
  constexpr double kMinProbability = 0.02;
  if (symbols != kSpanishSymbols || row.text.size() < kCharacters) return;
  const auto best_of = [&](const std::vector<double>& probabilities, bool digit) {
    std::size_t best = digit ? 0 : 10;
    for (std::size_t k = best; k < (digit ? 10 : symbols.size()); ++k)
      if (probabilities[k] > probabilities[best]) best = k;
    return best;
  };
  std::size_t start = 0;
  std::string text;
  double score = -1e9;
  for (std::size_t from = 0; from + kCharacters <= row.text.size(); ++from) {
    std::string attempt;
    double sum = 0;
    for (std::size_t i = 0; i < kCharacters; ++i) {
      const std::size_t symbol = best_of(row.probabilities[from + i], i < kDigits);
      const double probability = row.probabilities[from + i][symbol];
      if (probability < kMinProbability) sum = -1e9;
      sum += std::log(std::max(probability, 1e-6));
      attempt += symbols[symbol];
    }
    if (sum > score && sum > -1e8) {
      score = sum;
      start = from;
      text = attempt;
    }
  }
  if (text.empty()) return;
  const auto cut = [&](auto& values) {
    values.erase(values.begin() + static_cast<std::ptrdiff_t>(start + kCharacters), values.end());
    values.erase(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(start));
  };
  cut(row.segments);
  cut(row.probabilities);
  row.text = text;
}

}  // namespace

void ClassicOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!scales.empty() && scales.size() <= 8, "{} scales", scales.size());
  candidates.check();
  segments.check();
}

std::shared_ptr<const ClassicModel> read_classic_model(const std::string& svm_path,
                                                       const std::string& reader_path) {
  auto model = std::make_shared<ClassicModel>();
  model->svm = read_plate_svm(svm_path);
  model->reader = read_character_reader(reader_path);
  return model;
}

std::vector<ClassicCandidate> find_classic_candidates(const cv::Mat& image,
                                                      const ClassicOptions& options,
                                                      DebugSink* debug) {
  options.check();
  const cv::Mat gray = gray_of(image);
  std::vector<ClassicCandidate> all;
  std::uint64_t level = 0;
  for (const double scale : options.scales) {
    const cv::Size size(cvRound(gray.cols * scale), cvRound(gray.rows * scale));
    if (size.width < 20 || size.height < 20 || size.area() > 60'000'000) continue;
    cv::Mat scaled = gray;
    if (scale != 1)
      cv::resize(gray, scaled, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
    ++level;
    for (ClassicCandidate& candidate :
         find_candidates(scaled, options.candidates, Rng(options.seed).fork(level),
                         level == 1 ? debug : nullptr)) {
      for (cv::Point2f& p : candidate.corners) {
        p = {static_cast<float>((static_cast<double>(p.x) + 0.5) / scale - 0.5),
             static_cast<float>((static_cast<double>(p.y) + 0.5) / scale - 0.5)};
      }
      all.push_back(std::move(candidate));
    }
  }
  return all;
}

ClassicText read_candidate(const ClassicCandidate& candidate, const CharacterReader& reader,
                           const ClassicOptions& options) {
  cv::Mat unused;
  const double otsu = cv::threshold(candidate.plain, unused, 0, 255, cv::THRESH_OTSU);
  ClassicText best;
  best.score = -1e9;
  for (const double factor : {0.7, 0.85, 1.0, 1.12}) {
    ClassicText attempt;
    attempt.segments =
        find_segments(candidate.plain, static_cast<int>(otsu * factor), options.segments);
    keep_aligned_segments(attempt.segments);
    if (attempt.segments.size() > kMaxCharacters) continue;
    for (const Segment& segment : attempt.segments) {
      std::vector<double> probabilities = reader.probabilities(segment.character);
      const auto top = std::max_element(probabilities.begin(), probabilities.end());
      attempt.text += reader.symbols[static_cast<std::size_t>(top - probabilities.begin())];
      attempt.score += std::log(std::max(*top, 1e-6)) + kCharacterBonus;
      attempt.probabilities.push_back(std::move(probabilities));
    }
    if (attempt.score > best.score) best = std::move(attempt);
  }
  return best;
}

std::vector<Reading> read_classic(const cv::Mat& image, const ClassicModel& model,
                                  const ClassicOptions& options, DebugSink* debug) {
  struct Found {
    Reading reading;
    double score;
  };
  std::vector<Found> found;
  const std::vector<ClassicCandidate> candidates = find_classic_candidates(image, options, debug);
  int number = 0;
  for (const ClassicCandidate& candidate : candidates) {
    const double probability = model.svm.platt.probability(model.svm.margin(candidate.gray));
    if (probability < options.min_plate) continue;
    ClassicText text = read_candidate(candidate, model.reader, options);
    keep_spanish_characters(text, model.reader.symbols);
    if (debug != nullptr && number < 8) {
      ++number;
      cv::Mat canvas;
      cv::cvtColor(candidate.plain, canvas, cv::COLOR_GRAY2BGR);
      for (const Segment& segment : text.segments)
        cv::rectangle(canvas, segment.box, cv::Scalar(0, 200, 0), 1);
      debug->image("plate-" + std::to_string(number), canvas);
    }
    Found item;
    Reading& reading = item.reading;
    reading.corners = candidate.corners;
    reading.box = bounding_box(candidate.corners, image.size());
    reading.plate = probability;
    double min_probability = probability;
    if (text.text.size() >= kMinCharacters) {
      reading.text = text.text;
      for (std::size_t i = 0; i < text.segments.size(); ++i) {
        const double confidence = text.probabilities[i][model.reader.symbols.find(text.text[i])];
        reading.characters.push_back(
            {text.text[i], confidence,
             in_image(candidate.corners, text.segments[i].box, candidate.plain.size())});
        min_probability = std::min(min_probability, confidence);
      }
      reading.candidates.push_back({text.text, min_probability, ""});
    } else {
      if (probability < kMinPlateWithoutText) continue;
      min_probability *= 0.1;
    }
    reading.confidence = min_probability;
    item.score = text.score + std::log(std::max(probability, 1e-6));
    found.push_back(std::move(item));
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Found& a, const Found& b) { return a.score > b.score; });
  std::vector<Reading> readings;
  for (Found& item : found) {
    const bool is_duplicate =
        std::any_of(readings.begin(), readings.end(), [&](const Reading& other) {
          return overlap_of_smaller(other.box, item.reading.box) > kMaxOverlap;
        });
    if (!is_duplicate) readings.push_back(std::move(item.reading));
  }
  std::stable_sort(readings.begin(), readings.end(),
                   [](const Reading& a, const Reading& b) { return a.confidence > b.confidence; });
  return readings;
}

}  // namespace tarsier::plate
