// SPDX-License-Identifier: MIT
#include "tarsier/face/people/face_reader.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/face/people/classical.h"
#include "tarsier/face/recognition/normalize.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::face::people {
namespace {

// Weight of the points' score in the logit of the probability.
constexpr double kLandmarkWeight = 8.4;
// Used where the detector's score is no probability: the points' score at even odds, and the min
// points' score of a face that only the less strict search found.
constexpr double kEvenOddsScore = 0.45;
constexpr double kMinLenientScore = 0.5;
// Faces with points below this score are rejected, whatever the detector's score.
constexpr double kMinLandmarkScore = 0.1;

// The box that a detector draws around a face with these eyes.
cv::Rect2d box_of_eyes(const Eyes& eyes) {
  const double width = 2.4 * eyes.distance();
  const cv::Point2d middle = 0.5 * (eyes.left + eyes.right);
  return {middle.x - width / 2, middle.y - 0.38 * width, width, width};
}

void show_stages(DebugSink& debug, const cv::Mat& gray, const Face& face,
                 const CropOptions& crop_options) {
  cv::Mat image;
  cv::cvtColor(gray, image, cv::COLOR_GRAY2BGR);
  cv::rectangle(image, face.box, cv::Scalar(60, 220, 60), 2);
  const int radius = std::max(2, cvRound(0.12 * face.eyes.distance()));
  for (const cv::Point2d& eye : {face.eyes.left, face.eyes.right})
    cv::circle(image, eye, radius, cv::Scalar(255, 200, 0), 1, cv::LINE_AA);
  debug.image("found", image);
  debug.image("aligned", face.crop);
  debug.image("illumination normalised",
              recognition::light_image(recognition::tan_triggs(face.crop)));
  (void)classical_face(face.crop, crop_options, {}, &debug);
}

}  // namespace

double face_probability(double detection, double points) {
  // The detector's probability is clamped to this range.
  constexpr double kMinProbability = 0.02;
  constexpr double kMaxProbability = 0.99;
  constexpr double kDetectorWeight = 0.65;
  // Even odds would be at -4.8. A false face or wrong points harm the person they are enrolled
  // with. So a face must be four times as likely as no face.
  constexpr double kBias = -6.2;
  const double p = std::clamp(detection, kMinProbability, kMaxProbability);
  return logistic(kDetectorWeight * std::log(p / (1 - p)) + kLandmarkWeight * points + kBias);
}

void FaceReaderOptions::check() const {
  check_fields(*this);
  crop.check();
  tracker.check();
}

struct FaceReader::Impl {
  std::shared_ptr<const landmarks::LandmarkModel> model;
  // The detector's scores are probabilities: see `anchors` of landmarks::FaceFinder.
  bool has_probability;
  landmarks::FaceFinder finder;
  std::optional<EyeDetector> eyes;
  landmarks::FitWorkspace workspace;
  landmarks::TrackerState state;
};

FaceReader::FaceReader(FaceReaderOptions options,
                       std::shared_ptr<const landmarks::LandmarkModel> model,
                       std::shared_ptr<const FaceNetworks> networks,
                       std::shared_ptr<const AnchorDetector> anchors)
    : options_(std::move(options)) {
  options_.check();
  if (options_.eyes == EyeMethod::kLandmarks) {
    TARSIER_REQUIRE(model != nullptr && model->points() == 68,
                    "a landmark model of 68 points is needed");
  }
  const bool has_probability = networks != nullptr && anchors != nullptr;
  impl_ = std::make_unique<Impl>(Impl{
      std::move(model),
      has_probability,
      networks ? landmarks::FaceFinder(std::move(networks), options_.finder, std::move(anchors))
               : landmarks::FaceFinder(options_.finder),
      {},
      {},
      {}});
  if (options_.eyes != EyeMethod::kLandmarks) impl_->eyes.emplace(options_.eyes);
}
FaceReader::~FaceReader() = default;
FaceReader::FaceReader(FaceReader&&) noexcept = default;
FaceReader& FaceReader::operator=(FaceReader&&) noexcept = default;

Face FaceReader::face_from_eyes(const cv::Mat& gray, const Eyes& eyes) const {
  Face face;
  face.eyes = eyes;
  face.box = box_of_eyes(eyes);
  face.crop = crop_face(gray, eyes, options_.crop);
  face.quality = measure_quality(face.crop, face.eyes, {});
  return face;
}

std::vector<Face> FaceReader::read_by_landmarks(const cv::Mat& gray) {
  const double min_lenient_score = impl_->has_probability ? options_.min_score : kMinLenientScore;
  const bool uncertain_too = options_.min_uncertain < options_.min_trust;
  std::vector<Face> faces;
  std::optional<Face> uncertain;
  double best_probability = options_.min_uncertain;
  for (auto& found : landmarks::find_faces(
           *impl_->model, {}, gray, impl_->finder, impl_->workspace,
           uncertain_too ? std::min(kMinLandmarkScore, min_lenient_score) : min_lenient_score)) {
    Face face;
    face.box = found.box;
    face.points = std::move(found.fit.points);
    face.score = found.fit.score;
    face.eyes = eyes_from_landmarks(face.points);
    if (face.eyes.distance() < 2) continue;
    const double probability = impl_->has_probability
                                   ? face_probability(found.detection, face.score)
                                   : logistic(kLandmarkWeight * (face.score - kEvenOddsScore));
    face.trusted =
        probability >= options_.min_trust && (found.confident || face.score >= min_lenient_score);
    if (face.trusted) {
      faces.push_back(std::move(face));
    } else if (uncertain_too && probability >= best_probability) {
      best_probability = probability;
      uncertain = std::move(face);
    }
  }
  if (faces.empty() && uncertain) faces.push_back(*std::move(uncertain));
  return faces;
}

std::vector<Face> FaceReader::read(const cv::Mat& gray, DebugSink* debug) {
  require_gray(gray);
  without_eyes_ = 0;
  std::vector<Face> faces;
  if (options_.eyes == EyeMethod::kLandmarks) {
    faces = read_by_landmarks(gray);
  } else {
    for (const auto& candidate : impl_->finder.find(gray)) {
      const auto eyes = impl_->eyes->find(gray, candidate.box);
      if (!eyes) {
        ++without_eyes_;
        continue;
      }
      Face face;
      face.box = candidate.box;
      face.eyes = *eyes;
      faces.push_back(std::move(face));
    }
  }
  for (Face& face : faces) {
    face.crop = crop_face(gray, face.eyes, options_.crop);
    face.quality = measure_quality(face.crop, face.eyes, face.points);
  }
  std::stable_sort(faces.begin(), faces.end(),
                   [](const Face& a, const Face& b) { return a.box.area() > b.box.area(); });
  if (debug != nullptr && !faces.empty()) show_stages(*debug, gray, faces.front(), options_.crop);
  return faces;
}

std::vector<Face> FaceReader::track(const cv::Mat& gray, double time, DebugSink* debug) {
  if (options_.eyes != EyeMethod::kLandmarks) return read(gray, debug);
  require_gray(gray);
  without_eyes_ = 0;
  std::vector<Face> faces;
  for (auto& tracked : landmarks::track_faces(*impl_->model, {}, options_.tracker, impl_->finder,
                                              impl_->state, gray, time, impl_->workspace)) {
    Face face;
    face.box = tracked.box;
    face.points = std::move(tracked.points);
    face.score = tracked.score;
    face.id = tracked.id;
    face.eyes = eyes_from_landmarks(face.points);
    if (face.eyes.distance() < 2) continue;
    face.crop = crop_face(gray, face.eyes, options_.crop);
    face.quality = measure_quality(face.crop, face.eyes, face.points);
    faces.push_back(std::move(face));
  }
  if (debug != nullptr && !faces.empty()) {
    const auto largest =
        std::max_element(faces.begin(), faces.end(),
                         [](const Face& a, const Face& b) { return a.box.area() < b.box.area(); });
    show_stages(*debug, gray, *largest, options_.crop);
  }
  return faces;
}

void FaceReader::reset() { impl_->state = {}; }

}  // namespace tarsier::face::people
