// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/annotator.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/statistics.h"
#include "tarsier/face/detect/detector.h"
#include "tarsier/face/pipelines/annotator_match.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/media/image_file.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

namespace tarsier::face {
namespace {

using Eigen::Matrix2Xd;
using Eigen::Vector2d;

// Min share of the finished images in which the face detector must find the annotated object.
constexpr double kMinBoxShare = 0.6;
// Max share of a sample's points that may be filled in.
constexpr double kMaxMissingShare = 0.25;
constexpr int kFitStarts = 6;  // the result is their median

bool box_contains_shape(const cv::Rect& box, const Matrix2Xd& points) {
  const Vector2d center = points.rowwise().mean();
  const double size = regression::shape_size(points);
  return box.contains({cvRound(center.x()), cvRound(center.y())}) && box.width < 8 * size &&
         box.width > size;
}

bool same_samples(const shape::LandmarkSet& a, const shape::LandmarkSet& b) {
  if (a.samples.size() != b.samples.size()) return false;
  for (std::size_t k = 0; k < a.samples.size(); ++k) {
    const Matrix2Xd& p = a.samples[k].points;
    const Matrix2Xd& q = b.samples[k].points;
    if (a.samples[k].image != b.samples[k].image || p.cols() != q.cols()) return false;
    for (Eigen::Index i = 0; i < p.size(); ++i) {
      const double x = p.data()[i];
      const double y = q.data()[i];
      if (x != y && !(std::isnan(x) && std::isnan(y))) return false;
    }
  }
  return true;
}

}  // namespace

struct Annotator::Impl {
  // Centre and size of a shape relative to a detector's box, in widths of the box.
  struct BoxOffset {
    double dx = 0;
    double dy = 0;
    double size = 0;

    static BoxOffset of(const Matrix2Xd& points, const cv::Rect& box) {
      const Vector2d center = points.rowwise().mean();
      const double width = box.width;
      return {(center.x() - box.x - 0.5 * (box.width - 1)) / width,
              (center.y() - box.y - 0.5 * (box.height - 1)) / width,
              regression::shape_size(points) / width};
    }
  };

  // Errors of the starts in training; as large as those in use.
  struct StartNoise {
    double shift = 0.12;  // sizes
    double scale = 0.08;  // log
    double angle = 0.08;  // radians
  };

  AnnotatorOptions options;
  std::optional<FaceDetector> detector;
  std::map<std::string, std::vector<cv::Rect>> boxes;  // by path; each image is searched once
  shape::LandmarkSet trained_for;
  bool is_trained = false;
  std::vector<regression::TrainingFace> faces;
  regression::Descent descent;
  std::optional<BoxOffset> box_offset_model;
  StartNoise start_noise;

  explicit Impl(const AnnotatorOptions& given) : options(given) {
    options.check();
    if (!options.find_faces) return;
    try {
      detector.emplace();
    } catch (const ModelError& error) {
      log_debug("{} (proposals work without it)", error.what());
    }
  }

  // The newest samples of the set that can be trained on. If few points of a sample are missing,
  // they are filled in.
  [[nodiscard]] shape::LandmarkSet training_samples(const shape::LandmarkSet& annotated) const {
    shape::LandmarkSet result;
    const Matrix2Xd* complete = nullptr;
    for (const shape::LandmarkSample& sample : annotated.samples)
      if (sample.is_complete() && regression::shape_size(sample.points) > 2)
        complete = &sample.points;
    if (complete == nullptr) return result;
    for (auto sample = annotated.samples.rbegin(); sample != annotated.samples.rend(); ++sample) {
      if (static_cast<int>(result.samples.size()) >= options.max_faces) break;
      shape::LandmarkSample filled = *sample;
      int missing = 0;
      for (int i = 0; i < static_cast<int>(filled.points.cols()); ++i)
        missing += filled.is_missing(i) ? 1 : 0;
      const auto count = static_cast<int>(filled.points.cols());
      if (missing > kMaxMissingShare * count || count - missing < 2) continue;
      if (missing > 0) {
        const Matrix2Xd guess = shape::fit_similarity(*complete, filled.points)(*complete);
        for (int i = 0; i < count; ++i)
          if (filled.is_missing(i)) filled.points.col(i) = guess.col(i);
      }
      if (regression::shape_size(filled.points) < 2) continue;
      result.samples.push_back(std::move(filled));
    }
    std::reverse(result.samples.begin(), result.samples.end());
    return result;
  }

  void train(const shape::LandmarkSet& set) {
    is_trained = false;
    NoProgress quiet;
    std::vector<std::string> skipped;
    regression::LoadOptions load;
    load.largest = 300;
    faces = regression::load_training_faces(set, "", load, quiet, {}, skipped);
    if (static_cast<int>(faces.size()) < options.min_faces) return;
    learn_box_offset(set);

    std::vector<regression::Start> starts;
    const Rng rng(options.seed);
    std::vector<Matrix2Xd> shapes;
    for (const regression::TrainingFace& face : faces) shapes.push_back(face.points);
    const Matrix2Xd mean = shape::train_shape_model(shapes).mean;
    for (std::size_t f = 0; f < faces.size(); ++f) {
      Rng own = rng.fork(f);
      const Vector2d center = shapes[f].rowwise().mean();
      const double size = regression::shape_size(shapes[f]);
      for (int k = 0; k < options.starts; ++k) {
        const Vector2d at =
            center + start_noise.shift * size * Vector2d(own.normal(), own.normal());
        starts.push_back(
            {static_cast<int>(f), regression::place_mean_shape(
                                      mean, at, size * std::exp(start_noise.scale * own.normal()),
                                      start_noise.angle * own.normal())});
      }
    }
    regression::DescentOptions how;
    how.stages = {{20, 0.35}, {30, 0.25}, {45, 0.18}, {60, 0.12}};
    // Few faces allow few components. The time of training grows with the third power of their
    // number.
    how.components = std::clamp(600 / descent_points(set), 4, 24);
    how.ridge = 1;
    how.seed = options.seed;
    descent = regression::train_descent(faces, starts, how, quiet, {});
    is_trained = true;
  }

  static int descent_points(const shape::LandmarkSet& set) { return std::max(1, set.points()); }

  [[nodiscard]] const std::vector<cv::Rect>& boxes_of(const std::string& path) {
    const auto found = boxes.find(path);
    if (found != boxes.end()) return found->second;
    return boxes[path] = detector->detect(read_gray_image(path));
  }

  void learn_box_offset(const shape::LandmarkSet& set) {
    box_offset_model.reset();
    start_noise = {};
    if (!detector) return;
    std::vector<double> dx;
    std::vector<double> dy;
    std::vector<double> size;
    for (const shape::LandmarkSample& sample : set.samples) {
      try {
        for (const cv::Rect& box : boxes_of(sample.image)) {
          if (!box_contains_shape(box, sample.points)) continue;
          const BoxOffset offset = BoxOffset::of(sample.points, box);
          dx.push_back(offset.dx);
          dy.push_back(offset.dy);
          size.push_back(offset.size);
          break;
        }
      } catch (const InputError&) {  // load_training_faces() skips it, too
      }
    }
    if (static_cast<double>(dx.size()) < kMinBoxShare * static_cast<double>(set.samples.size()))
      return;
    box_offset_model = BoxOffset{upper_median(dx), upper_median(dy), upper_median(size)};
    double shift = 0;
    double scale = 0;
    for (std::size_t k = 0; k < dx.size(); ++k) {
      shift +=
          (std::pow(dx[k] - box_offset_model->dx, 2) + std::pow(dy[k] - box_offset_model->dy, 2)) /
          2;
      scale += std::pow(std::log(size[k] / box_offset_model->size), 2);
    }
    const double count = std::max(1.0, static_cast<double>(dx.size()) - 1);
    start_noise.shift =
        std::clamp(1.3 * std::sqrt(shift / count) / box_offset_model->size, 0.05, 0.2);
    start_noise.scale = std::clamp(1.3 * std::sqrt(scale / count), 0.05, 0.15);
  }

  // Initial shape: the mean shape at the object's position.
  [[nodiscard]] std::optional<Matrix2Xd> start(const ProposalRequest& request) {
    if (box_offset_model && detector) {
      const std::vector<cv::Rect> found = detector->detect(request.gray);
      if (!found.empty()) {
        const cv::Rect& box = found.front();
        const Vector2d middle(box.x + 0.5 * (box.width - 1), box.y + 0.5 * (box.height - 1));
        return regression::place_mean_shape(
            descent.mean, middle + Vector2d(box_offset_model->dx, box_offset_model->dy) * box.width,
            box_offset_model->size * box.width, 0);
      }
    }
    return proposals::match_mean_image(
        faces, descent.mean, request.gray,
        request.annotated.samples[static_cast<std::size_t>(request.nearest)].points);
  }

  // Transfers the points of one face to another by the detector's boxes and by comparing the
  // images.
  [[nodiscard]] std::optional<Matrix2Xd> transfer_by_boxes(const shape::LandmarkSample& near,
                                                           const cv::Mat& gray) {
    if (!detector || regression::shape_size(near.points) < 2) return std::nullopt;
    const std::vector<cv::Rect> target_boxes = detector->detect(gray);
    for (const cv::Rect& from : boxes_of(near.image)) {
      if (target_boxes.empty() || !box_contains_shape(from, near.points)) continue;
      const cv::Rect& to = target_boxes.front();
      const double scale = static_cast<double>(to.width) / from.width;
      Matrix2Xd points = near.points * scale;
      points.row(0).array() += to.x - scale * from.x;
      points.row(1).array() += to.y - scale * from.y;
      shape::LandmarkSet one;
      one.samples.push_back(near);
      NoProgress quiet;
      std::vector<std::string> skipped;
      const auto face = regression::load_training_faces(one, "", {}, quiet, {}, skipped);
      return proposals::refine(face, gray, points);
    }
    return std::nullopt;
  }

  [[nodiscard]] std::optional<Matrix2Xd> fit(const ProposalRequest& request) {
    const std::optional<Matrix2Xd> first = start(request);
    if (!first) return std::nullopt;
    regression::DescentWorkspace workspace;
    Matrix2Xd result = *first;
    // Two rounds: the first fit gives position, size and angle more precisely than the search.
    for (int round = 0; round < 2; ++round) {
      const shape::Similarity2d place = shape::fit_similarity(descent.mean, result);
      Rng rng(options.seed);
      std::vector<Matrix2Xd> fits;
      for (int k = 0; k < kFitStarts; ++k) {
        const double noise_scale = k == 0 ? 0 : 0.5;
        const double size =
            place.scale() * std::exp(noise_scale * start_noise.scale * rng.normal());
        const double angle = place.angle() + noise_scale * start_noise.angle * rng.normal();
        const double down = rng.normal();
        const double across = rng.normal();
        const Vector2d at = Vector2d(place.tx, place.ty) + noise_scale * start_noise.shift *
                                                               place.scale() *
                                                               Vector2d(across, down);
        fits.push_back(regression::fit_descent(
            descent, request.gray, regression::place_mean_shape(descent.mean, at, size, angle),
            workspace));
      }
      for (Eigen::Index i = 0; i < result.size(); ++i) {
        std::vector<double> values;
        for (const Matrix2Xd& one : fits) values.push_back(one.data()[i]);
        result.data()[i] = upper_median(std::move(values));
      }
      if (regression::shape_size(result) < 2) return std::nullopt;
    }
    return proposals::refine(faces, request.gray, result);
  }
};

Annotator::Annotator(const AnnotatorOptions& options) : impl_(std::make_unique<Impl>(options)) {}
Annotator::~Annotator() = default;
Annotator::Annotator(Annotator&&) noexcept = default;
Annotator& Annotator::operator=(Annotator&&) noexcept = default;

std::optional<Proposal> Annotator::propose(const ProposalRequest& request) {
  TARSIER_REQUIRE(request.gray.type() == CV_8UC1 && !request.gray.empty(), "a grey image");
  request.annotated.check();
  if (request.annotated.samples.empty() || request.annotated.points() == 0) return std::nullopt;
  TARSIER_REQUIRE(
      request.nearest >= 0 && request.nearest < static_cast<int>(request.annotated.samples.size()),
      "nearest {}", request.nearest);
  const shape::LandmarkSet set = impl_->training_samples(request.annotated);
  std::optional<Matrix2Xd> result;
  if (static_cast<int>(set.samples.size()) >= impl_->options.min_faces && set.points() >= 3) {
    if (!same_samples(set, impl_->trained_for)) {
      impl_->trained_for = set;
      try {
        impl_->train(set);
      } catch (const InputError& error) {
        log_debug("{} (no model for proposals)", error.what());
      }
    }
    if (impl_->is_trained) result = impl_->fit(request);
  }
  const bool from_model = result.has_value();
  if (!result) {
    const shape::LandmarkSample& near =
        request.annotated.samples[static_cast<std::size_t>(request.nearest)];
    try {
      result = proposals::transfer_by_flow(read_gray_image(near.image), near.points, request.gray);
      if (!result && near.is_complete()) result = impl_->transfer_by_boxes(near, request.gray);
    } catch (const InputError&) {  // the image no longer exists
    }
  }
  if (!result || !result->allFinite()) return std::nullopt;
  return Proposal{*std::move(result), from_model};
}

nlohmann::ordered_json to_json(const Proposal& proposal) {
  const auto hundredth = [](double value) { return std::round(value * 100) / 100; };
  nlohmann::ordered_json points = nlohmann::ordered_json::array();
  for (Eigen::Index i = 0; i < proposal.points.cols(); ++i)
    points.push_back({hundredth(proposal.points(0, i)), hundredth(proposal.points(1, i))});
  return {{"points", std::move(points)}, {"learned", proposal.from_model}};
}

}  // namespace tarsier::face
