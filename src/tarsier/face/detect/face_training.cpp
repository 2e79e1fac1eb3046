// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/face_training.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/detect/detector.h"
#include "tarsier/face/detect/disguise.h"
#include "tarsier/face/detect/training_views.h"
#include "tarsier/linalg/losses.h"
#include "tarsier/linalg/trainer.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace tarsier::face {
namespace {

using training::degrade;
using training::disguise;
using training::draw_without_faces;
using training::Image;
using training::log_uniform;
using training::occlude_part;
using training::random_orientation;
using training::random_view;
using training::render_view;
using training::view_transform;
using training::ViewOrientation;
using training::ViewTransform;

constexpr double kMaxFaceWidth = 72;   // px; images with larger faces are reduced
constexpr double kMaxImageSide = 900;  // px of images without faces
constexpr int kScanPatch = 64;         // px, training crop of the first network
constexpr double kFaceWidths[2] = {14.0,
                                   23.5};  // px, widths of faces that the first network must detect
constexpr double kIgnoredWidths[2] = {9.5, 34.0};  // px, widths for which either answer is accepted

// A region that was wrongly detected as a face.
struct FalsePositive {
  int image = 0;
  cv::Rect2d box;
};

constexpr double kMaxConfidentScore = 0.98;

constexpr std::size_t kFacePoints = 68;

// Every kHoldOut-th image without faces is held out.
constexpr int kHoldOut = 3;

struct TrainingData {
  std::vector<Image> faces;          // images with faces
  std::vector<Image> without_faces;  // images without faces
  // Held-out images without faces: they determine the score of a confident face.
  std::vector<Image> held_out;
  std::vector<std::pair<int, int>> face_indices;  // image and face indices
  double disguised = 0;                           // FaceTrainingOptions
  [[nodiscard]] bool has_wide_roll() const { return disguised > 0; }
  [[nodiscard]] const Image& image(int number) const {
    const auto count = static_cast<int>(without_faces.size());
    return number < count ? without_faces[static_cast<std::size_t>(number)]
                          : faces[static_cast<std::size_t>(number - count)];
  }
};

double intersection_over_union(const cv::Rect2d& a, const cv::Rect2d& b) {
  const double common = (a & b).area();
  return common / std::max(1e-9, a.area() + b.area() - common);
}

// --- training examples of the first network ---

// Planes: label, is the box known, dx, dy, log of the scale.
constexpr std::size_t kScanPlanes = 5;

void label_scan(const Image& image, const ViewTransform& transform, std::vector<float>& target) {
  constexpr int kSide = kScanPatch / kScanCell;
  constexpr std::size_t kPlane = kSide * kSide;
  target.assign(kScanPlanes * kPlane, 0.0F);
  const auto each_cell = [&](const auto& what) {
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        what(static_cast<std::size_t>(y * kSide + x),
             cv::Point2d((x + 0.5) * kScanCell, (y + 0.5) * kScanCell));
      }
    }
  };
  const auto inside = [](const cv::Point2d& p, const cv::Point2d& center, double reach) {
    return std::abs(p.x - center.x) < reach && std::abs(p.y - center.y) < reach;
  };
  for (const cv::Rect2d& box : image.ignored) {
    const cv::Point2d center = transform((box.tl() + box.br()) / 2);
    each_cell([&](std::size_t i, const cv::Point2d& p) {
      if (inside(p, center, 0.7 * transform.scale * box.width)) target[i] = linalg::kIgnoredCell;
    });
  }
  for (const cv::Rect2d& box : image.faces) {
    const cv::Point2d center = transform((box.tl() + box.br()) / 2);
    const double width = transform.scale * box.width;
    if (width < kIgnoredWidths[0] || width > kIgnoredWidths[1]) continue;
    const bool fits = width >= kFaceWidths[0] && width <= kFaceWidths[1];
    each_cell([&](std::size_t i, const cv::Point2d& p) {
      if (fits && inside(p, center, std::max(0.17 * width, 2.05))) {
        target[i] = 1;
        target[kPlane + i] = 1;
        target[2 * kPlane + i] = static_cast<float>((center.x - p.x) / kScanFace);
        target[3 * kPlane + i] = static_cast<float>((center.y - p.y) / kScanFace);
        target[4 * kPlane + i] = static_cast<float>(std::log(width / kScanFace));
      } else if (target[i] == 0 && inside(p, center, 0.45 * width)) {
        target[i] = linalg::kIgnoredCell;
      }
    });
  }
}

// A false positive is shown with small changes only.
ViewOrientation small_orientation(Rng& rng) {
  const double angle = rng.normal(0, 0.08);
  return {angle, rng.uniform() < 0.5, 1};
}

const Image& random_background(const TrainingData& data, Rng& rng) {
  return data.without_faces[static_cast<std::size_t>(
      rng.integer(0, static_cast<int>(data.without_faces.size()) - 1))];
}

// Outside the image, the border is replicated or another image is shown. The face may be disguised.
cv::Mat view_of_face(const TrainingData& data, const Image& image, std::size_t face,
                     const ViewTransform& transform, int side, Rng& rng) {
  const bool replicates_border = rng.uniform() < 0.5;
  const bool in_disguise =
      data.disguised > 0 && !image.points[face].empty() && rng.uniform() < data.disguised;
  if (replicates_border && !in_disguise) return render_view(image, transform, side);
  const Image& other = random_background(data, rng);
  const cv::Mat background =
      render_view(other, random_view(other, side, 0.08, data.has_wide_roll(), rng), side);
  cv::Mat view = render_view(image, transform, side, replicates_border ? nullptr : &background);
  if (in_disguise) {
    std::vector<cv::Point2d> points;
    for (const cv::Point2d& p : image.points[face]) points.push_back(transform(p));
    disguise(view, points, background, rng);
  }
  return view;
}

void make_scan_example(const TrainingData& data, const std::vector<FalsePositive>& false_positives,
                       Rng& rng, FaceSearchWorkspace& workspace, linalg::Example& example) {
  cv::Mat view;
  const double kind = rng.uniform();
  if (kind < 0.55) {
    const auto& [number, face] = data.face_indices[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(data.face_indices.size()) - 1))];
    const Image& image = data.faces[static_cast<std::size_t>(number)];
    const cv::Rect2d& box = image.faces[static_cast<std::size_t>(face)];
    const double size = rng.uniform();
    const double width = size < 0.85   ? log_uniform(rng, kFaceWidths[0], kFaceWidths[1])
                         : size < 0.92 ? log_uniform(rng, 6, kIgnoredWidths[0])
                                       : log_uniform(rng, kIgnoredWidths[1], 64);
    const double x = rng.uniform(8, kScanPatch - 8);
    const double y = rng.uniform(8, kScanPatch - 8);
    const ViewTransform transform =
        view_transform((box.tl() + box.br()) / 2, {x, y}, width / box.width,
                       random_orientation(data.has_wide_roll(), rng));
    view = view_of_face(data, image, static_cast<std::size_t>(face), transform, kScanPatch, rng);
    if (rng.uniform() < 0.2) occlude_part(view, {x - width / 2, y - width / 2, width, width}, rng);
    label_scan(image, transform, example.target);
  } else {
    ViewTransform transform;
    const Image* image = nullptr;
    if (kind < 0.8 && !false_positives.empty()) {
      const FalsePositive& false_positive = false_positives[static_cast<std::size_t>(
          rng.integer(0, static_cast<int>(false_positives.size()) - 1))];
      image = &data.image(false_positive.image);
      const double width = log_uniform(rng, 14, 23);
      const double x = rng.uniform(16, kScanPatch - 16);
      const double y = rng.uniform(16, kScanPatch - 16);
      transform = view_transform((false_positive.box.tl() + false_positive.box.br()) / 2, {x, y},
                                 width / false_positive.box.width, small_orientation(rng));
    } else {
      image = &random_background(data, rng);
      transform = random_view(*image, kScanPatch, 0.08, data.has_wide_roll(), rng);
    }
    view = render_view(*image, transform, kScanPatch);
    label_scan(*image, transform, example.target);
  }
  degrade(view, rng);
  example.shape = {4, kScanPatch / 2, kScanPatch / 2};
  scan_input(view, workspace, example.input);
}

double scan_loss(const linalg::Example& example, const std::vector<float>& output,
                 linalg::Shape shape, std::vector<float>& derivative) {
  return linalg::map_loss({.values = 3, .weight = 1, .focal = 1.2F, .huber_delta = 0.1F},
                          example.target, output, shape, derivative);
}

// --- training examples of the other networks ---

void make_window_example(const TrainingData& data,
                         const std::vector<FalsePositive>& false_positives, FaceWindow form,
                         Rng& rng, linalg::Example& example) {
  // Target: label, is the box known, dx, dy, log of the scale.
  example.target.assign(kScanPlanes, 0.0F);
  const double center = form.side / 2.0;
  cv::Mat view;
  const double kind = rng.uniform();
  if (kind < 0.55) {
    const auto& [number, face] = data.face_indices[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(data.face_indices.size()) - 1))];
    const Image& image = data.faces[static_cast<std::size_t>(number)];
    const cv::Rect2d& box = image.faces[static_cast<std::size_t>(face)];
    // The box is shifted by (dx, dy) face widths and enlarged by `growth`.
    double dx = rng.uniform(-0.17, 0.17);
    double dy = rng.uniform(-0.17, 0.17);
    double growth = log_uniform(rng, 0.78, 1.28);
    const bool is_near = kind >= 0.45;
    ViewOrientation orientation = random_orientation(data.has_wide_roll(), rng);
    if (is_near) {  // too far shifted for a face, or not upright
      const double how = rng.uniform();
      if (how < 0.2) {
        const double quarters = rng.integer(1, 3);
        // With a larger roll, a face could look like one that lies on its side.
        orientation.angle =
            (data.has_wide_roll() ? 0.5 : 1) * orientation.angle + quarters * CV_PI / 2;
      } else if (how < 0.7) {
        const double angle = rng.uniform(0, 2 * CV_PI);
        const double far = rng.uniform(0.42, 0.95);
        dx = far * std::cos(angle);
        dy = far * std::sin(angle);
      } else {
        growth = rng.uniform() < 0.5 ? log_uniform(rng, 0.38, 0.6) : log_uniform(rng, 1.65, 2.7);
      }
    }
    const double width = form.box / growth;
    const cv::Point2d to(center - dx * width, center - dy * width);
    const ViewTransform transform =
        view_transform((box.tl() + box.br()) / 2, to, width / box.width, orientation);
    view = view_of_face(data, image, static_cast<std::size_t>(face), transform, form.side, rng);
    if (!is_near) {
      if (rng.uniform() < 0.25) {
        occlude_part(view, {to.x - width / 2, to.y - width / 2, width, width}, rng);
      }
      example.target = {1, 1, static_cast<float>((to.x - center) / form.box),
                        static_cast<float>((to.y - center) / form.box),
                        static_cast<float>(std::log(width / form.box))};
    }
  } else if (kind < 0.93 && !false_positives.empty()) {
    const FalsePositive& false_positive = false_positives[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(false_positives.size()) - 1))];
    const double dx = rng.normal(0, 0.06);
    const double dy = rng.normal(0, 0.06);
    const double growth = std::exp(rng.normal(0, 0.08));
    const ViewTransform transform =
        view_transform((false_positive.box.tl() + false_positive.box.br()) / 2,
                       {center + dx * form.box, center + dy * form.box},
                       form.box / false_positive.box.width * growth, small_orientation(rng));
    view = render_view(data.image(false_positive.image), transform, form.side);
  } else {
    const Image& image = random_background(data, rng);
    view = render_view(image, random_view(image, form.side, 0.05, data.has_wide_roll(), rng),
                       form.side);
  }
  degrade(view, rng);
  example.shape = {4, form.side / 2, form.side / 2};
  window_input(view, example.input);
}

double window_loss(const linalg::Example& example, const std::vector<float>& output, linalg::Shape,
                   std::vector<float>& derivative) {
  double loss = linalg::logistic_loss(output[0], example.target[0], derivative[0]);
  if (example.target[1] < 0.5F) return loss;
  for (std::size_t k = 1; k < 4; ++k) {
    float d = 0;
    loss += linalg::huber(output[k] - example.target[1 + k], 0.06F, d);
    derivative[k] = d;
  }
  return loss;
}

// --- shared ---

TrainingData load(const std::vector<FaceImage>& images, Progress& progress,
                  const std::stop_token& stop, std::vector<std::string>& skipped) {
  TrainingData data;
  int without_faces = 0;
  progress.begin("reading", static_cast<std::int64_t>(images.size()), "images");
  for (const FaceImage& from : images) {
    throw_if_stopped(stop);
    progress.advance();
    cv::Mat gray = from.gray;
    try {
      if (gray.empty()) gray = read_gray_image(from.image);
    } catch (const InputError& error) {
      skipped.emplace_back(error.what());
      continue;
    }
    TARSIER_REQUIRE(gray.type() == CV_8UC1, "{}: an image of type {}", from.image, gray.type());
    double scale = std::min(1.0, kMaxImageSide / std::max(gray.cols, gray.rows));
    if (!from.faces.empty()) {
      double smallest = 1e9;
      for (const cv::Rect2d& face : from.faces) smallest = std::min(smallest, face.width);
      scale = std::min(1.0, kMaxFaceWidth / smallest);
    }
    const cv::Size size(std::max(8, cvRound(gray.cols * scale)),
                        std::max(8, cvRound(gray.rows * scale)));
    if (scale < 1) {
      cv::Mat reduced;
      cv::resize(gray, reduced, size, 0, 0, cv::INTER_AREA);
      gray = reduced;
    }
    Image image;
    const auto scaled = [&](const cv::Rect2d& box) {
      return cv::Rect2d(box.x * scale, box.y * scale, box.width * scale, box.height * scale);
    };
    for (std::size_t f = 0; f < from.faces.size(); ++f) {
      const cv::Rect2d& box = from.faces[f];
      if (box.width * scale >= kScanFace && box.width > 0) {
        image.faces.push_back(scaled(box));
        std::vector<cv::Point2d>& points = image.points.emplace_back();
        if (f >= from.points.size() || from.points[f].size() != kFacePoints) continue;
        for (const cv::Point2d& p : from.points[f])
          points.push_back((p + cv::Point2d(0.5, 0.5)) * scale);
      } else {
        image.ignored.push_back(scaled(box));
      }
    }
    for (const cv::Rect2d& box : from.ignored) image.ignored.push_back(scaled(box));
    make_halves(gray, 0.05, image.halves);
    if (from.faces.empty() && from.ignored.empty()) {
      const bool held_out = ++without_faces % kHoldOut == 0;
      (held_out ? data.held_out : data.without_faces).push_back(std::move(image));
    } else if (!image.faces.empty()) {
      for (int f = 0; f < static_cast<int>(image.faces.size()); ++f) {
        data.face_indices.emplace_back(static_cast<int>(data.faces.size()), f);
      }
      data.faces.push_back(std::move(image));
    }
  }
  progress.end();
  return data;
}

void add_drawings(int count, Rng rng, TrainingData& data) {
  for (int i = 0; i < count; ++i) {
    Image image;
    make_halves(draw_without_faces(rng), 0.05, image.halves);
    data.without_faces.push_back(std::move(image));
  }
}

enum class Stage { kScan, kRefine, kVerify };

// Finds regions that the networks, up to the given one, wrongly detect as faces.
std::vector<FalsePositive> find_false_positives(const TrainingData& data,
                                                const FaceNetworks& networks, Stage stage,
                                                double threshold, Progress& progress,
                                                const std::stop_token& stop) {
  const std::size_t count = data.without_faces.size() + data.faces.size();
  std::vector<std::vector<FalsePositive>> found(count);
  progress.begin("looking for mistakes", static_cast<std::int64_t>(count), "images");
  cv::parallel_for_(cv::Range(0, static_cast<int>(count)), [&](const cv::Range& range) {
    FaceSearchWorkspace workspace;
    for (int i = range.start; i < range.end; ++i) {
      progress.advance();
      if (stop.stop_requested()) return;
      const Image& image = data.image(i);
      FaceSearchOptions options;
      options.min_face = kScanFace;
      options.max_candidates = stage == Stage::kScan ? 150 : 400;
      options.threshold = threshold;
      options.with_verification = stage == Stage::kVerify;
      const std::vector<ScoredFace> candidates =
          stage == Stage::kScan ? scan_faces(image.halves[0], networks, options, workspace)
                                : search_faces(image.halves[0], networks, options, workspace);
      for (const ScoredFace& candidate : candidates) {
        if (candidate.score < threshold) continue;
        const auto is_near = [&](const cv::Rect2d& box) {
          return intersection_over_union(box, candidate.box) > 0.25;
        };
        if (std::any_of(image.faces.begin(), image.faces.end(), is_near)) continue;
        if (std::any_of(image.ignored.begin(), image.ignored.end(), is_near)) continue;
        found[static_cast<std::size_t>(i)].push_back({i, candidate.box});
      }
    }
  });
  progress.end();
  throw_if_stopped(stop);
  std::vector<FalsePositive> all;
  for (const auto& part : found) all.insert(all.end(), part.begin(), part.end());
  return all;
}

// Finds faces without an annotated box: confident detections of the second network in images that
// show faces. They are added to the ignored regions.
void ignore_missing_boxes(TrainingData& data, const FaceNetworks& networks, Progress& progress,
                          const std::stop_token& stop) {
  const auto first = static_cast<int>(data.without_faces.size());
  for (const FalsePositive& false_positive :
       find_false_positives(data, networks, Stage::kRefine, 0.9, progress, stop)) {
    if (false_positive.image < first) continue;
    data.faces[static_cast<std::size_t>(false_positive.image - first)].ignored.push_back(
        false_positive.box);
  }
}

// Removes the false positives in ignored regions.
void erase_ignored(const TrainingData& data, std::vector<FalsePositive>& false_positives) {
  std::erase_if(false_positives, [&](const FalsePositive& false_positive) {
    const std::vector<cv::Rect2d>& ignored = data.image(false_positive.image).ignored;
    return std::any_of(ignored.begin(), ignored.end(), [&](const cv::Rect2d& box) {
      return intersection_over_union(box, false_positive.box) > 0.25;
    });
  });
}

// Repeats the hard false positives, so that they are as frequent as all others together.
void add_repeated(const std::vector<FalsePositive>& hard,
                  std::vector<FalsePositive>& false_positives) {
  if (hard.empty()) return;
  const std::size_t times = std::clamp<std::size_t>(false_positives.size() / hard.size(), 1, 20);
  for (std::size_t k = 0; k < times; ++k) {
    false_positives.insert(false_positives.end(), hard.begin(), hard.end());
  }
}

// Scores of likely faces in the held-out images, all of them false. Images are searched as in use.
// Each image is searched at several sizes between two pyramid levels, which gives different pixels
// to the networks.
constexpr double kHeldOutScales[] = {1, 0.9, 0.81};
struct HeldOutScores {
  std::vector<double> all;            // of all sizes
  std::vector<double> original_size;  // at the original size
};
HeldOutScores score_held_out(const TrainingData& data, const FaceNetworks& networks,
                             Progress& progress, const std::stop_token& stop) {
  const auto count = static_cast<int>(data.held_out.size());
  std::vector<HeldOutScores> found(data.held_out.size());
  progress.begin("what is sure", count, "images");
  cv::parallel_for_(cv::Range(0, count), [&](const cv::Range& range) {
    FaceSearchWorkspace workspace;
    for (int i = range.start; i < range.end; ++i) {
      progress.advance();
      if (stop.stop_requested()) return;
      const cv::Mat& gray = data.held_out[static_cast<std::size_t>(i)].halves[0];
      HeldOutScores& scores = found[static_cast<std::size_t>(i)];
      for (const double scale : kHeldOutScales) {
        cv::Mat scaled = gray;
        if (scale < 1) {
          const cv::Size size(std::max(8, cvRound(gray.cols * scale)),
                              std::max(8, cvRound(gray.rows * scale)));
          cv::resize(gray, scaled, size, 0, 0, cv::INTER_AREA);
        }
        FaceSearchOptions options;
        options.min_face = default_min_face(gray.size()) * scale;
        options.threshold = networks.likely_score;
        for (const ScoredFace& face : search_faces(scaled, networks, options, workspace)) {
          scores.all.push_back(face.score);
          if (scale == 1) scores.original_size.push_back(face.score);
        }
      }
    }
  });
  progress.end();
  throw_if_stopped(stop);
  HeldOutScores result;
  for (const HeldOutScores& one : found) {
    result.all.insert(result.all.end(), one.all.begin(), one.all.end());
    result.original_size.insert(result.original_size.end(), one.original_size.begin(),
                                one.original_size.end());
  }
  return result;
}

}  // namespace

double choose_confident_score(const std::vector<double>& scores, double lowest, double allowed) {
  TARSIER_REQUIRE(lowest > 0 && lowest < kMaxConfidentScore, "the lowest score is {}", lowest);
  TARSIER_REQUIRE(allowed >= 0, "{} alarms", allowed);
  const auto logit = [](double score) { return std::log(score / (1 - score)); };
  double sum = 0;
  double highest = lowest;
  double count = 0;
  double below = 0;  // sum for scores below kMaxConfidentScore; higher ones are censored there
  for (const double score : scores) {
    if (score < lowest) continue;
    const double inside = std::min(score, kMaxConfidentScore);
    sum += logit(inside) - logit(lowest);
    highest = std::max(highest, inside);
    ++count;
    if (score < kMaxConfidentScore) ++below;
  }
  if (count <= allowed) return lowest;
  // Allow no false alarm: halfway between the highest score and 1.
  if (allowed == 0) return std::min(kMaxConfidentScore, 1 - 0.5 * (1 - highest));
  if (below == 0) return kMaxConfidentScore;
  const double beyond = sum / below * std::log(count / allowed);
  return std::clamp(logistic(logit(lowest) + beyond), lowest, kMaxConfidentScore);
}

FaceTraining train_face_networks(const std::vector<FaceImage>& images, const std::string& name,
                                 const FaceTrainingOptions& options, Progress& progress,
                                 std::stop_token stop) {
  options.check();
  FaceTraining result;
  TrainingData data = load(images, progress, stop, result.skipped);
  data.disguised = options.disguised;
  if (data.face_indices.empty()) throw InputError(name, "no face is left to learn from");
  if (data.without_faces.empty()) {
    throw InputError(name, "no image without faces: without them everything is a face");
  }
  result.images = static_cast<int>(data.faces.size());
  result.faces = static_cast<int>(data.face_indices.size());
  result.without_faces = static_cast<int>(data.without_faces.size());
  result.held_out = static_cast<int>(data.held_out.size());

  FaceNetworks& networks = result.networks;
  const Rng root(options.seed);
  add_drawings(options.drawings, root.fork(2), data);
  Rng first = root.fork(1);
  linalg::initialize(networks.scan, first);
  linalg::initialize(networks.refine, first);
  linalg::initialize(networks.verify, first);
  std::vector<FalsePositive> false_positives;
  const auto make_scan = [&](std::int64_t, Rng& rng, linalg::Example& example) {
    thread_local FaceSearchWorkspace workspace;
    make_scan_example(data, false_positives, rng, workspace, example);
  };
  const auto train = [&](linalg::Network& network, const char* stage, int steps, double rate,
                         std::uint64_t number, const linalg::MakeExample& make,
                         const linalg::Loss& loss) {
    linalg::TrainOptions how;
    how.steps = steps;
    how.rate = rate;
    how.seed = options.seed * 8 + number;
    linalg::train(network, how, stage, make, loss, progress, stop);
  };
  const auto train_scan = [&](int steps, double rate, std::uint64_t number) {
    train(networks.scan, "first network", steps, rate, number, make_scan, scan_loss);
  };
  const auto train_window = [&](linalg::Network& network, FaceWindow form, const char* stage,
                                int steps, double rate, std::uint64_t number) {
    const auto make = [&](std::int64_t, Rng& rng, linalg::Example& example) {
      make_window_example(data, false_positives, form, rng, example);
    };
    train(network, stage, steps, rate, number, make, window_loss);
  };
  const auto false_positives_of = [&](Stage stage, double threshold) {
    return find_false_positives(data, networks, stage, threshold, progress, stop);
  };

  train_scan(options.scan_steps / 2, 3e-3, 0);
  false_positives = false_positives_of(Stage::kScan, 0.3);
  result.scan_false_positives = static_cast<int>(false_positives.size());
  train_scan(options.scan_steps - options.scan_steps / 2, 2e-3, 1);

  false_positives = false_positives_of(Stage::kScan, 0.1);
  train_window(networks.refine, kRefineWindow, "second network", options.refine_steps / 2, 2e-3, 2);
  ignore_missing_boxes(data, networks, progress, stop);
  erase_ignored(data, false_positives);
  std::vector<FalsePositive> hard = false_positives_of(Stage::kRefine, 0.2);
  result.refine_false_positives = static_cast<int>(hard.size());
  add_repeated(hard, false_positives);
  train_window(networks.refine, kRefineWindow, "second network",
               options.refine_steps - options.refine_steps / 2, 1.5e-3, 3);

  // The third network is trained on what passed the second one before and after its second half,
  // and then twice on what passes itself.
  false_positives = false_positives_of(Stage::kRefine, 0.1);
  false_positives.insert(false_positives.end(), hard.begin(), hard.end());
  const std::vector<FalsePositive> passed = false_positives;
  const int part = options.verify_steps / 3;
  train_window(networks.verify, kVerifyWindow, "third network", part, 2e-3, 4);
  hard = false_positives_of(Stage::kVerify, 0.1);
  add_repeated(hard, false_positives);
  train_window(networks.verify, kVerifyWindow, "third network", part, 1.5e-3, 5);
  const std::vector<FalsePositive> remaining = false_positives_of(Stage::kVerify, 0.1);
  result.verify_false_positives = static_cast<int>(hard.size() + remaining.size());
  hard.insert(hard.end(), remaining.begin(), remaining.end());
  false_positives = passed;
  add_repeated(hard, false_positives);
  train_window(networks.verify, kVerifyWindow, "third network", options.verify_steps - 2 * part,
               1.2e-3, 6);

  if (data.held_out.empty()) return result;
  const HeldOutScores scores = score_held_out(data, networks, progress, stop);
  networks.confident_score =
      choose_confident_score(scores.all, networks.likely_score,
                             options.false_alarms / 1000 * result.held_out *
                                 static_cast<double>(std::size(kHeldOutScales)));
  result.held_out_likely = static_cast<int>(scores.original_size.size());
  result.held_out_alarms = static_cast<int>(
      std::count_if(scores.original_size.begin(), scores.original_size.end(),
                    [&](double score) { return score >= networks.confident_score; }));
  return result;
}

}  // namespace tarsier::face
