// SPDX-License-Identifier: MIT
#include "tarsier/core/boxes.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/landmarks/hog_problem.h"
#include "tarsier/face/landmarks/hog_scanner.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::face::landmarks {

namespace {

using inner::HogScanner;

constexpr double kMaxStartSize = 1.5;      // windows; max size of the smallest object
constexpr double kMinSize = 0.85;          // of the window; smaller objects cannot be detected
constexpr double kMinInsideShare = 0.6;    // min share of a box inside its image
constexpr double kDuplicateOverlap = 0.5;  // overlap of two boxes that are the same object
constexpr std::size_t kMaxBoxModelImages =
    400;  // max number of images for the relation of boxes to shapes

// A training image.
struct Image {
  cv::Mat gray;
  std::vector<cv::Rect2d> boxes;
  std::vector<cv::Rect2d> ignored;
  std::vector<Eigen::Matrix2Xd> shapes;  // one per box, or empty
};

double median_aspect(const std::vector<shape::BoxedImage>& images) {
  std::vector<double> aspects;
  for (const shape::BoxedImage& image : images) {
    for (const cv::Rect2d& box : image.boxes) {
      if (box.width > 0 && box.height > 0) aspects.push_back(box.width / box.height);
    }
  }
  if (aspects.empty()) return 1;
  const auto median = aspects.begin() + static_cast<std::ptrdiff_t>(aspects.size() / 2);
  std::nth_element(aspects.begin(), median, aspects.end());
  return std::clamp(*median, 0.25, 4.0);
}

cv::Rect2d scaled(const cv::Rect2d& box, double sx, double sy) {
  return {box.x * sx, box.y * sy, box.width * sx, box.height * sy};
}

// The scale at which an image is used for training.
double scale_of(const shape::BoxedImage& image, const cv::Mat& gray, const HogOptions& options,
                Rng& rng) {
  const double longest = std::max(gray.cols, gray.rows);
  const double max_scale = std::min(std::pow(2.0, options.upsample), options.largest / longest);
  double smallest = 0;
  for (const cv::Rect2d& box : image.boxes) {
    const double side = std::sqrt(std::max(0.0, box.area()));
    if (side > 0 && (smallest == 0 || side < smallest)) smallest = side;
  }
  // One random number per image in any case.
  const double window_ratio = rng.uniform(1.02, kMaxStartSize);
  if (smallest == 0) return std::min(1.0, max_scale);
  return std::min(max_scale, options.window * window_ratio / smallest);
}

Image prepared(const shape::BoxedImage& image, const cv::Mat& gray, double scale,
               const HogScanner& scanner, const HogOptions& options, HogTraining& result) {
  const cv::Size size(std::max(8, cvRound(gray.cols * scale)),
                      std::max(8, cvRound(gray.rows * scale)));
  const double sx = static_cast<double>(size.width) / gray.cols;
  const double sy = static_cast<double>(size.height) / gray.rows;
  Image to;
  cv::resize(gray, to.gray, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  const cv::Rect2d whole(0, 0, size.width, size.height);
  for (const cv::Rect2d& box : image.ignored) to.ignored.push_back(scaled(box, sx, sy));
  for (std::size_t k = 0; k < image.boxes.size(); ++k) {
    const cv::Rect2d box = scaled(image.boxes[k], sx, sy);
    const cv::Rect2d best = inner::from_dlib(scanner.get_best_matching_rect(inner::to_dlib(box)));
    const bool is_double =
        std::any_of(to.boxes.begin(), to.boxes.end(),
                    [&](const cv::Rect2d& other) { return iou(box, other) > kDuplicateOverlap; });
    if (std::sqrt(box.area()) < kMinSize * options.window || is_double ||
        (box & whole).area() < kMinInsideShare * box.area() ||
        iou(box, best) <= inner::kMinMatchOverlap + 0.02) {
      to.ignored.push_back(box);
      ++result.ignored;
      continue;
    }
    to.boxes.push_back(box);
    ++result.boxes;
    Eigen::Matrix2Xd shape(2, 0);
    if (k < image.shapes.size() && image.shapes[k].cols() > 1 && image.shapes[k].allFinite()) {
      shape = image.shapes[k];
      shape.row(0) = ((shape.row(0).array() + 0.5) * sx - 0.5).matrix();
      shape.row(1) = ((shape.row(1).array() + 0.5) * sy - 0.5).matrix();
    }
    to.shapes.push_back(std::move(shape));
  }
  return to;
}

Image mirrored(const Image& image) {
  Image to;
  cv::flip(image.gray, to.gray, 1);
  const auto turned = [&](const cv::Rect2d& box) {
    return cv::Rect2d(image.gray.cols - box.x - box.width, box.y, box.width, box.height);
  };
  for (const cv::Rect2d& box : image.boxes) to.boxes.push_back(turned(box));
  for (const cv::Rect2d& box : image.ignored) to.ignored.push_back(turned(box));
  return to;
}

void set_weights(const dlib::matrix<double, 0, 1>& weights, HogDetector& detector) {
  const cv::Size cells = detector.cells();
  detector.weights.resize(kHogPlanes, cells.area());
  long at = 0;
  for (Eigen::Index plane = 0; plane < kHogPlanes; ++plane) {
    for (Eigen::Index k = 0; k < cells.area(); ++k) {
      detector.weights(plane, k) = static_cast<float>(weights(at++));
    }
  }
  detector.threshold = weights(at);
}

// Applies the detector to its training images, and measures the positions of shapes in its boxes.
void evaluate_on_training_images(const std::vector<Image>& images, HogTraining& result,
                                 Progress& progress, const std::stop_token& stop) {
  HogFinder finder(result.detector);
  std::vector<Eigen::Matrix2Xd> shapes;
  std::vector<cv::Rect2d> boxes;
  const std::size_t step = std::max<std::size_t>(1, images.size() / kMaxBoxModelImages);
  const double window =
      std::sqrt(static_cast<double>(result.detector.width) * result.detector.height);
  int tried = 0;
  progress.begin("looking back", static_cast<std::int64_t>(images.size() / step), "images");
  for (std::size_t i = 0; i < images.size(); i += step) {
    throw_if_stopped(stop);
    progress.advance();
    const std::vector<ScoredBox> found = finder.find(images[i].gray, window);
    for (std::size_t k = 0; k < images[i].boxes.size(); ++k) {
      ++tried;
      for (const ScoredBox& candidate : found) {
        if (iou(candidate.box, images[i].boxes[k]) < 0.4) continue;
        ++result.found;
        if (k < images[i].shapes.size() && images[i].shapes[k].cols() > 1) {
          shapes.push_back(images[i].shapes[k]);
          boxes.push_back(candidate.box);
        }
        break;
      }
    }
  }
  progress.end();
  // Extrapolated from the tried boxes to all.
  if (tried > 0) {
    result.found =
        static_cast<int>(std::lround(static_cast<double>(result.found) * result.boxes / tried));
  }
  if (!shapes.empty()) result.detector.box = train_box_model(shapes, boxes, 0);
}

}  // namespace

HogTraining train_hog_detector(const std::vector<shape::BoxedImage>& images,
                               const std::string& set_path, const HogOptions& options,
                               Progress& progress, const std::stop_token& stop) {
  options.check();
  HogTraining result;
  HogDetector& detector = result.detector;
  const double form = median_aspect(images);
  detector.width = static_cast<int>(std::lround(options.window * std::sqrt(form)));
  detector.height = static_cast<int>(std::lround(options.window / std::sqrt(form)));
  HogScanner scanner;
  scanner.configure(detector);
  scanner.stop_by(stop);

  std::vector<Image> prepared_images;
  const Rng root(options.seed);
  progress.begin("reading images", static_cast<std::int64_t>(images.size()), "images");
  for (std::size_t i = 0; i < images.size(); ++i) {
    throw_if_stopped(stop);
    progress.advance();
    try {
      const cv::Mat gray = read_gray_image(images[i].image);
      Rng rng = root.fork(i);
      prepared_images.push_back(prepared(images[i], gray, scale_of(images[i], gray, options, rng),
                                         scanner, options, result));
    } catch (const InputError& error) {
      result.skipped.emplace_back(error.what());
    }
  }
  progress.end();
  result.images = static_cast<int>(prepared_images.size());
  if (result.boxes == 0) {
    throw InputError(
        set_path,
        result.ignored > 0
            ? fmt::format(
                  "none of {} boxes can be learned from: smaller than option 'window', {} px "
                  "(see option 'upsample'), or each of another form",
                  result.ignored, options.window)
        : result.skipped.empty() ? std::string("holds no boxes")
                                 : "no image can be used; the first: " + result.skipped.front());
  }

  std::vector<cv::Mat> grays;
  inner::DlibObjects objects;
  inner::DlibIgnored ignored;
  const auto add = [&](const Image& image) {
    grays.push_back(image.gray);
    objects.emplace_back();
    ignored.emplace_back();
    for (const cv::Rect2d& box : image.boxes) objects.back().emplace_back(inner::to_dlib(box));
    for (const cv::Rect2d& box : image.ignored) ignored.back().push_back(inner::to_dlib(box));
  };
  for (const Image& image : prepared_images) {
    add(image);
    if (options.mirror) add(mirrored(image));
  }
  progress.begin("training", 0, "rounds");
  const auto solution =
      inner::solve_detection_problem(scanner, grays, objects, ignored, options, progress, stop);
  if (!solution)
    throw InputError(set_path, "its boxes contradict each other: some lie on each other");
  set_weights(solution->weights, detector);
  detector.overlap = solution->overlap;
  detector.covered = solution->covered;
  result.rounds = solution->rounds;
  progress.end();
  detector.check();
  evaluate_on_training_images(prepared_images, result, progress, stop);
  return result;
}

}  // namespace tarsier::face::landmarks
