// SPDX-License-Identifier: MIT
#include "tarsier/plate/train/found.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/networks/quad.h"
#include "tarsier/plate/text/evaluation.h"
#include "tarsier/plate/train/logistic.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <filesystem>
#include <utility>

namespace tarsier::plate {
namespace {

namespace fs = std::filesystem;

constexpr float kFound = 0.5F;    // intersection over union
constexpr float kTouches = 0.3F;  // of the smaller box
constexpr int kMinTexts = 100;

struct Image {
  std::string path;
  std::vector<TruthPlate> truth;
  std::vector<SeenPlate> seen;
};

std::vector<Image> images_of(const std::string& given) {
  const fs::path folder = given;
  PlateTruth truth;
  const bool has_truth = fs::exists(folder / "truth.csv");
  if (has_truth) truth = read_plate_truth((folder / "truth.csv").string());
  const fs::path place = has_truth ? folder / "images" : folder;
  std::vector<Image> images;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(place, error)) {
    const std::string path = entry.path().string();
    if (!is_image_path(path)) continue;
    const auto known = truth.find(entry.path().filename().string());
    if (known == truth.end())
      images.push_back({path, {}, {}});
    else
      images.push_back({path, known->second, {}});
  }
  if (error) throw InputError(place.string(), "cannot be read: " + error.message());
  if (images.empty()) throw InputError(place.string(), "holds no images");
  std::sort(images.begin(), images.end(),
            [](const Image& a, const Image& b) { return a.path < b.path; });
  return images;
}

// Upright boxes, as in the evaluation of plates.
Quad box_of(const Reading& reading) { return quad_of(cv::Rect2f(reading.box)); }
Quad box_of(const TruthPlate& plate) {
  return quad_of(cv::Rect2f(plate.box.value_or(cv::Rect2d())));
}

bool is_plate(const Image& image, const SeenPlate& find) {
  return std::any_of(image.truth.begin(), image.truth.end(), [&](const TruthPlate& plate) {
    return box_iou(box_of(plate), box_of(find.reading)) >= kFound;
  });
}

bool touches(const Image& image, const SeenPlate& find) {
  return std::any_of(image.truth.begin(), image.truth.end(), [&](const TruthPlate& plate) {
    return box_overlap_of_smaller(box_of(plate), box_of(find.reading)) > kTouches;
  });
}

// The reported find of a plate of the truth, or null.
const SeenPlate* find_of(const Image& image, const TruthPlate& plate, float min_plate) {
  const SeenPlate* best = nullptr;
  const auto rank = [](const SeenPlate& find) {
    return log_confidence(find.reading) + 0.5 * log_odds(find.reading.plate);
  };
  for (const SeenPlate& find : image.seen) {
    if (find.reading.text.empty() || find.reading.plate < static_cast<double>(min_plate)) continue;
    if (box_iou(box_of(plate), box_of(find.reading)) < kFound) continue;
    if (best == nullptr || rank(find) > rank(*best)) best = &find;
  }
  return best;
}

template <std::size_t N>
std::vector<double> row_of(const std::array<double, N>& values) {
  return {values.begin(), values.end()};
}

OddsCurve curve_of(const LogisticRows& rows) {
  const std::vector<double> w = fit_logistic(rows, {1, 1, 1, 1});
  OddsCurve curve;
  std::copy(w.begin(), w.end(), curve.weights.begin());
  return curve;
}

void fit_curves(const std::vector<Image>& images, float min_plate, ReaderModel& model,
                FoundCounts& counts) {
  LogisticRows texts;
  LogisticRows characters;
  for (const Image& image : images) {
    for (const TruthPlate& plate : image.truth) {
      if (!plate.box || plate.text.empty() || plate.text.find('-') != std::string::npos) continue;
      const SeenPlate* find = find_of(image, plate, min_plate);
      if (find == nullptr) continue;
      const std::string& text = find->reading.text;
      const bool right = text == plate.text;
      ++counts.texts;
      counts.right += right ? 1 : 0;
      texts.add(row_of(OddsCurve::features(find->odds)), right);
      if (text.size() != plate.text.size()) continue;
      for (std::size_t i = 0; i < text.size(); ++i) {
        characters.add(row_of(OddsCurve::features(find->character_odds[i])),
                       text[i] == plate.text[i]);
      }
    }
  }
  if (counts.texts < kMinTexts) return;
  model.confidence = curve_of(texts);
  model.character = curve_of(characters);
}

void fit_judge(std::vector<Image>& images, ReaderModel& model, FoundCounts& counts) {
  LogisticRows rows;
  for (Image& image : images) {
    std::vector<Reading> readings;
    std::vector<FindFeatures> features;
    for (SeenPlate& find : image.seen) {
      find.reading.confidence = logistic(model.confidence(find.odds) - find.penalty);
      readings.push_back(find.reading);
      features.push_back(find.features);
    }
    compare(readings, features);
    for (std::size_t i = 0; i < image.seen.size(); ++i) {
      const SeenPlate& find = image.seen[i];
      if (find.reading.text.empty()) continue;
      const bool plate = is_plate(image, find);
      if (!plate && touches(image, find)) continue;
      ++counts.finds;
      counts.plates += plate ? 1 : 0;
      rows.add(row_of(features[i]), plate);
    }
  }
  // A text without a digit, or without a known layout, must not by itself make a find a sign: there
  // are plates of other countries and vanity plates, of which the images have few.
  constexpr double kLittle = 10;
  FindFeatures ridges;
  ridges.fill(1e-2);
  ridges[6] = ridges[7] = kLittle;
  const std::vector<double> w = fit_logistic(rows, row_of(ridges));
  std::copy(w.begin(), w.end(), model.judge.weights.begin());
}

}  // namespace

FoundCounts fit_to_found(const DetectorModel& detector, const CountryChoice& countries,
                         const std::vector<std::string>& folders, ReaderModel& model,
                         Progress& progress, const std::stop_token& stop) {
  std::vector<Image> images;
  for (const std::string& folder : folders) {
    std::vector<Image> more = images_of(folder);
    std::move(more.begin(), more.end(), std::back_inserter(images));
  }
  RecognizerOptions options;
  const float min_plate = options.min_plate;
  // Finds just below the aligner's limit are the most informative examples.
  options.min_plate = 0.5F;
  options.min_evidence = -100;  // all finds get as many looks as they need
  ReaderModel plain = model;
  plain.confidence = plain.character = {};
  const Recognizer recognizer(detector, plain, countries, options);
  progress.begin("found", static_cast<int>(images.size()), "images");
  constexpr std::size_t kBlock = 50;
  for (std::size_t first = 0; first < images.size(); first += kBlock) {
    throw_if_stopped(stop);
    const std::size_t last = std::min(images.size(), first + kBlock);
    cv::parallel_for_(cv::Range(static_cast<int>(first), static_cast<int>(last)),
                      [&](const cv::Range& range) {
                        for (int i = range.start; i < range.end; ++i) {
                          Image& image = images[static_cast<std::size_t>(i)];
                          image.seen = recognizer.see(read_image(image.path));
                        }
                      });
    progress.advance(static_cast<int>(last - first));
  }
  progress.end();
  FoundCounts counts;
  counts.images = static_cast<int>(images.size());
  fit_curves(images, min_plate, model, counts);
  fit_judge(images, model, counts);
  return counts;
}

}  // namespace tarsier::plate
