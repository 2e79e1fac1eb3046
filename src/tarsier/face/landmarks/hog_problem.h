// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/hog_scanner.h"

#include <optional>
#include <stop_token>
#include <vector>

// The structural SVM of dlib that trains a HOG detector.
namespace tarsier::face::landmarks::inner {

// For each image, its objects and the boxes that are ignored.
using DlibObjects = std::vector<std::vector<dlib::full_object_detection>>;
using DlibIgnored = std::vector<std::vector<dlib::rectangle>>;

// Min overlap of a box with the best position of the window.
constexpr double kMinMatchOverlap = 0.5;

struct HogSolution {
  dlib::matrix<double, 0, 1> weights;
  double overlap = 0;  // HogDetector::overlap and HogDetector::covered
  double covered = 0;
  int rounds = 0;  // number of passes over all images
};

// Trains on `images` with 8-bit pixels. The result does not depend on the number of threads.
// Returns std::nullopt if boxes contradict each other. Throws Interrupted.
[[nodiscard]] std::optional<HogSolution> solve_detection_problem(
    const HogScanner& scanner, const std::vector<cv::Mat>& images, const DlibObjects& objects,
    const DlibIgnored& ignored, const HogOptions& options, Progress& progress,
    const std::stop_token& stop);

}  // namespace tarsier::face::landmarks::inner
