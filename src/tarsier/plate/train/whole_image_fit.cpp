// SPDX-License-Identifier: MIT
#include "tarsier/plate/train/whole_image_fit.h"

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

constexpr float kMinPlateIou = 0.5F;
constexpr float kMinTouchOverlap = 0.3F;  // of the smaller box
constexpr int kMinTexts = 100;

struct Image {
  std::string path;
  std::vector<TruthPlate> truth;
  std::vector<UncalibratedReading> detections;
};

std::vector<Image> images_of(const std::string& folder_path) {
  const fs::path folder = folder_path;
  PlateTruth truth;
  const bool has_truth = fs::exists(folder / "truth.csv");
  if (has_truth) truth = read_plate_truth((folder / "truth.csv").string());
  const fs::path image_folder = has_truth ? folder / "images" : folder;
  std::vector<Image> images;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(image_folder, error)) {
    const std::string path = entry.path().string();
    if (!is_image_path(path)) continue;
    const auto known = truth.find(entry.path().filename().string());
    if (known == truth.end())
      images.push_back({path, {}, {}});
    else
      images.push_back({path, known->second, {}});
  }
  if (error) throw InputError(image_folder.string(), "cannot be read: " + error.message());
  if (images.empty()) throw InputError(image_folder.string(), "holds no images");
  std::sort(images.begin(), images.end(),
            [](const Image& a, const Image& b) { return a.path < b.path; });
  return images;
}

// Upright boxes, as in the evaluation of plates.
Quad box_of(const Reading& reading) { return quad_of(cv::Rect2f(reading.box)); }
Quad box_of(const TruthPlate& plate) {
  return quad_of(cv::Rect2f(plate.box.value_or(cv::Rect2d())));
}

bool is_plate(const Image& image, const UncalibratedReading& detection) {
  return std::any_of(image.truth.begin(), image.truth.end(), [&](const TruthPlate& plate) {
    return box_iou(box_of(plate), box_of(detection.reading)) >= kMinPlateIou;
  });
}

bool touches(const Image& image, const UncalibratedReading& detection) {
  return std::any_of(image.truth.begin(), image.truth.end(), [&](const TruthPlate& plate) {
    return box_overlap_of_smaller(box_of(plate), box_of(detection.reading)) > kMinTouchOverlap;
  });
}

// The reported detection of a plate of the truth, or null.
const UncalibratedReading* reported_detection_of(const Image& image, const TruthPlate& plate,
                                                 float min_plate) {
  const UncalibratedReading* best = nullptr;
  const auto rank = [](const UncalibratedReading& detection) {
    return log_confidence(detection.reading) + 0.5 * log_odds(detection.reading.plate);
  };
  for (const UncalibratedReading& detection : image.detections) {
    if (detection.reading.text.empty() || detection.reading.plate < static_cast<double>(min_plate))
      continue;
    if (box_iou(box_of(plate), box_of(detection.reading)) < kMinPlateIou) continue;
    if (best == nullptr || rank(detection) > rank(*best)) best = &detection;
  }
  return best;
}

template <std::size_t N>
std::vector<double> row_of(const std::array<double, N>& values) {
  return {values.begin(), values.end()};
}

CalibrationCurve fit_curve(const LogisticRows& rows) {
  const std::vector<double> w = fit_logistic(rows, {1, 1, 1, 1});
  CalibrationCurve curve;
  std::copy(w.begin(), w.end(), curve.weights.begin());
  return curve;
}

void fit_curves(const std::vector<Image>& images, float min_plate, ReaderModel& model,
                WholeImageCounts& counts) {
  LogisticRows texts;
  LogisticRows characters;
  for (const Image& image : images) {
    for (const TruthPlate& plate : image.truth) {
      if (!plate.box || plate.text.empty() || plate.text.find('-') != std::string::npos) continue;
      const UncalibratedReading* detection = reported_detection_of(image, plate, min_plate);
      if (detection == nullptr) continue;
      const std::string& text = detection->reading.text;
      const bool is_correct = text == plate.text;
      ++counts.texts;
      counts.correct += is_correct ? 1 : 0;
      texts.add(row_of(CalibrationCurve::features(detection->log_odds)), is_correct);
      if (text.size() != plate.text.size()) continue;
      for (std::size_t i = 0; i < text.size(); ++i) {
        characters.add(row_of(CalibrationCurve::features(detection->character_log_odds[i])),
                       text[i] == plate.text[i]);
      }
    }
  }
  if (counts.texts < kMinTexts) return;
  model.confidence_curve = fit_curve(texts);
  model.character_curve = fit_curve(characters);
}

void fit_plate_classifier(std::vector<Image>& images, ReaderModel& model,
                          WholeImageCounts& counts) {
  LogisticRows rows;
  for (Image& image : images) {
    std::vector<Reading> readings;
    std::vector<PlateClassifierFeatures> features;
    for (UncalibratedReading& detection : image.detections) {
      detection.reading.confidence =
          logistic(model.confidence_curve(detection.log_odds) - detection.penalty);
      readings.push_back(detection.reading);
      features.push_back(detection.features);
    }
    set_relative_evidence(readings, features);
    for (std::size_t i = 0; i < image.detections.size(); ++i) {
      const UncalibratedReading& detection = image.detections[i];
      if (detection.reading.text.empty()) continue;
      const bool plate = is_plate(image, detection);
      if (!plate && touches(image, detection)) continue;
      ++counts.detections;
      counts.plates += plate ? 1 : 0;
      rows.add(row_of(features[i]), plate);
    }
  }
  // A text without a digit, or without a known layout, must not by itself make a detection a sign:
  // there are plates of other countries and vanity plates, of which the images have few.
  constexpr double kStrongRidge = 10;
  PlateClassifierFeatures ridges;
  ridges.fill(1e-2);
  ridges[6] = ridges[7] = kStrongRidge;
  const std::vector<double> w = fit_logistic(rows, row_of(ridges));
  std::copy(w.begin(), w.end(), model.plate_classifier.weights.begin());
}

}  // namespace

WholeImageCounts fit_to_whole_images(const DetectorModel& detector, const CountryChoice& countries,
                                     const std::vector<std::string>& folders, ReaderModel& model,
                                     Progress& progress, const std::stop_token& stop) {
  std::vector<Image> images;
  for (const std::string& folder : folders) {
    std::vector<Image> more = images_of(folder);
    std::move(more.begin(), more.end(), std::back_inserter(images));
  }
  RecognizerOptions options;
  const float min_plate = options.min_plate;
  // Detections just below the aligner's limit are the most informative examples.
  options.min_plate = 0.5F;
  options.min_evidence = -100;  // all detections get as many views as they need
  ReaderModel plain = model;
  plain.confidence_curve = plain.character_curve = {};
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
                          image.detections = recognizer.read_uncalibrated(read_image(image.path));
                        }
                      });
    progress.advance(static_cast<int>(last - first));
  }
  progress.end();
  WholeImageCounts counts;
  counts.images = static_cast<int>(images.size());
  fit_curves(images, min_plate, model, counts);
  fit_plate_classifier(images, model, counts);
  return counts;
}

}  // namespace tarsier::plate
