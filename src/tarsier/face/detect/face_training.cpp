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

using training::anywhere;
using training::disguise;
using training::disturb;
using training::draw_without_faces;
using training::face_turn;
using training::hide_part;
using training::Image;
using training::log_uniform;
using training::Place;
using training::place;
using training::Turn;
using training::view_of;

constexpr double kLargestFace = 72;        // px; images with larger faces are reduced
constexpr double kLargestSide = 900;       // px of images without faces
constexpr int kPatch = 64;                 // px, training crop of the first network
constexpr double kFits[2] = {14.0, 23.5};  // px, widths of faces that the first network must detect
constexpr double kNearly[2] = {9.5, 34.0};  // px, widths for which either answer is accepted

// A place that was wrongly detected as a face.
struct Mistake {
  int image = 0;
  cv::Rect2d box;
};

constexpr double kHighestSure = 0.98;

constexpr std::size_t kFacePoints = 68;

// Every kHoldOut-th image without faces is held out.
constexpr int kHoldOut = 3;

struct Material {
  std::vector<Image> faces;    // images with faces
  std::vector<Image> without;  // images without faces
  // Held-out images without faces: they determine the score of a sure face.
  std::vector<Image> held_out;
  std::vector<std::pair<int, int>> all;  // image and face indices
  double disguised = 0;                  // FaceTrainingOptions
  [[nodiscard]] bool wide() const { return disguised > 0; }
  [[nodiscard]] const Image& image(int number) const {
    const auto count = static_cast<int>(without.size());
    return number < count ? without[static_cast<std::size_t>(number)]
                          : faces[static_cast<std::size_t>(number - count)];
  }
};

double shared(const cv::Rect2d& a, const cv::Rect2d& b) {
  const double common = (a & b).area();
  return common / std::max(1e-9, a.area() + b.area() - common);
}

// --- training examples of the first network ---

// Planes: label, is the box known, dx, dy, log of the scale.
constexpr std::size_t kScanPlanes = 5;

void label_scan(const Image& image, const Place& where, std::vector<float>& target) {
  constexpr int kSide = kPatch / kScanCell;
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
  const auto inside = [](const cv::Point2d& p, const cv::Point2d& middle, double reach) {
    return std::abs(p.x - middle.x) < reach && std::abs(p.y - middle.y) < reach;
  };
  for (const cv::Rect2d& box : image.ignored) {
    const cv::Point2d middle = where((box.tl() + box.br()) / 2);
    each_cell([&](std::size_t i, const cv::Point2d& p) {
      if (inside(p, middle, 0.7 * where.scale * box.width)) target[i] = linalg::kIgnoredCell;
    });
  }
  for (const cv::Rect2d& box : image.faces) {
    const cv::Point2d middle = where((box.tl() + box.br()) / 2);
    const double width = where.scale * box.width;
    if (width < kNearly[0] || width > kNearly[1]) continue;
    const bool fits = width >= kFits[0] && width <= kFits[1];
    each_cell([&](std::size_t i, const cv::Point2d& p) {
      if (fits && inside(p, middle, std::max(0.17 * width, 2.05))) {
        target[i] = 1;
        target[kPlane + i] = 1;
        target[2 * kPlane + i] = static_cast<float>((middle.x - p.x) / kScanFace);
        target[3 * kPlane + i] = static_cast<float>((middle.y - p.y) / kScanFace);
        target[4 * kPlane + i] = static_cast<float>(std::log(width / kScanFace));
      } else if (target[i] == 0 && inside(p, middle, 0.45 * width)) {
        target[i] = linalg::kIgnoredCell;
      }
    });
  }
}

// A mistake is shown with small changes only.
Turn slight_turn(Rng& rng) {
  const double angle = rng.normal(0, 0.08);
  return {angle, rng.uniform() < 0.5, 1};
}

const Image& any_without(const Material& material, Rng& rng) {
  return material.without[static_cast<std::size_t>(
      rng.integer(0, static_cast<int>(material.without.size()) - 1))];
}

// Outside the image, the border is replicated or another image is shown. The face may be disguised.
cv::Mat view_of_face(const Material& material, const Image& image, std::size_t face,
                     const Place& where, int side, Rng& rng) {
  const bool repeats_edge = rng.uniform() < 0.5;
  const bool in_disguise =
      material.disguised > 0 && !image.points[face].empty() && rng.uniform() < material.disguised;
  if (repeats_edge && !in_disguise) return view_of(image, where, side);
  const Image& other = any_without(material, rng);
  const cv::Mat behind = view_of(other, anywhere(other, side, 0.08, material.wide(), rng), side);
  cv::Mat view = view_of(image, where, side, repeats_edge ? nullptr : &behind);
  if (in_disguise) {
    std::vector<cv::Point2d> points;
    for (const cv::Point2d& p : image.points[face]) points.push_back(where(p));
    disguise(view, points, behind, rng);
  }
  return view;
}

void make_scan_example(const Material& material, const std::vector<Mistake>& mistakes, Rng& rng,
                       FaceSearchWorkspace& workspace, linalg::Example& example) {
  cv::Mat view;
  const double kind = rng.uniform();
  if (kind < 0.55) {
    const auto& [number, face] = material.all[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(material.all.size()) - 1))];
    const Image& image = material.faces[static_cast<std::size_t>(number)];
    const cv::Rect2d& box = image.faces[static_cast<std::size_t>(face)];
    const double size = rng.uniform();
    const double width = size < 0.85   ? log_uniform(rng, kFits[0], kFits[1])
                         : size < 0.92 ? log_uniform(rng, 6, kNearly[0])
                                       : log_uniform(rng, kNearly[1], 64);
    const double x = rng.uniform(8, kPatch - 8);
    const double y = rng.uniform(8, kPatch - 8);
    const Place where = place((box.tl() + box.br()) / 2, {x, y}, width / box.width,
                              face_turn(material.wide(), rng));
    view = view_of_face(material, image, static_cast<std::size_t>(face), where, kPatch, rng);
    if (rng.uniform() < 0.2) hide_part(view, {x - width / 2, y - width / 2, width, width}, rng);
    label_scan(image, where, example.target);
  } else {
    Place where;
    const Image* image = nullptr;
    if (kind < 0.8 && !mistakes.empty()) {
      const Mistake& mistake =
          mistakes[static_cast<std::size_t>(rng.integer(0, static_cast<int>(mistakes.size()) - 1))];
      image = &material.image(mistake.image);
      const double width = log_uniform(rng, 14, 23);
      const double x = rng.uniform(16, kPatch - 16);
      const double y = rng.uniform(16, kPatch - 16);
      where = place((mistake.box.tl() + mistake.box.br()) / 2, {x, y}, width / mistake.box.width,
                    slight_turn(rng));
    } else {
      image = &any_without(material, rng);
      where = anywhere(*image, kPatch, 0.08, material.wide(), rng);
    }
    view = view_of(*image, where, kPatch);
    label_scan(*image, where, example.target);
  }
  disturb(view, rng);
  example.shape = {4, kPatch / 2, kPatch / 2};
  scan_input(view, workspace, example.input);
}

double scan_loss(const linalg::Example& example, const std::vector<float>& output,
                 linalg::Shape shape, std::vector<float>& derivative) {
  return linalg::map_loss({.values = 3, .weight = 1, .focal = 1.2F, .huber_delta = 0.1F},
                          example.target, output, shape, derivative);
}

// --- training examples of the other networks ---

void make_window_example(const Material& material, const std::vector<Mistake>& mistakes,
                         FaceWindow form, Rng& rng, linalg::Example& example) {
  // Target: label, is the box known, dx, dy, log of the scale.
  example.target.assign(kScanPlanes, 0.0F);
  const double middle = form.side / 2.0;
  cv::Mat view;
  const double kind = rng.uniform();
  if (kind < 0.55) {
    const auto& [number, face] = material.all[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(material.all.size()) - 1))];
    const Image& image = material.faces[static_cast<std::size_t>(number)];
    const cv::Rect2d& box = image.faces[static_cast<std::size_t>(face)];
    // The box is shifted by (dx, dy) face widths and enlarged by `growth`.
    double dx = rng.uniform(-0.17, 0.17);
    double dy = rng.uniform(-0.17, 0.17);
    double growth = log_uniform(rng, 0.78, 1.28);
    const bool is_near = kind >= 0.45;
    Turn turn = face_turn(material.wide(), rng);
    if (is_near) {  // too far shifted for a face, or not upright
      const double how = rng.uniform();
      if (how < 0.2) {
        const double quarters = rng.integer(1, 3);
        // With a larger roll, a face could look like one that lies on its side.
        turn.angle = (material.wide() ? 0.5 : 1) * turn.angle + quarters * CV_PI / 2;
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
    const cv::Point2d to(middle - dx * width, middle - dy * width);
    const Place where = place((box.tl() + box.br()) / 2, to, width / box.width, turn);
    view = view_of_face(material, image, static_cast<std::size_t>(face), where, form.side, rng);
    if (!is_near) {
      if (rng.uniform() < 0.25) {
        hide_part(view, {to.x - width / 2, to.y - width / 2, width, width}, rng);
      }
      example.target = {1, 1, static_cast<float>((to.x - middle) / form.box),
                        static_cast<float>((to.y - middle) / form.box),
                        static_cast<float>(std::log(width / form.box))};
    }
  } else if (kind < 0.93 && !mistakes.empty()) {
    const Mistake& mistake =
        mistakes[static_cast<std::size_t>(rng.integer(0, static_cast<int>(mistakes.size()) - 1))];
    const double dx = rng.normal(0, 0.06);
    const double dy = rng.normal(0, 0.06);
    const double growth = std::exp(rng.normal(0, 0.08));
    const Place where = place((mistake.box.tl() + mistake.box.br()) / 2,
                              {middle + dx * form.box, middle + dy * form.box},
                              form.box / mistake.box.width * growth, slight_turn(rng));
    view = view_of(material.image(mistake.image), where, form.side);
  } else {
    const Image& image = any_without(material, rng);
    view = view_of(image, anywhere(image, form.side, 0.05, material.wide(), rng), form.side);
  }
  disturb(view, rng);
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

Material load(const std::vector<FaceImage>& images, Progress& progress, const std::stop_token& stop,
              std::vector<std::string>& skipped) {
  Material material;
  int without = 0;
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
    double scale = std::min(1.0, kLargestSide / std::max(gray.cols, gray.rows));
    if (!from.faces.empty()) {
      double smallest = 1e9;
      for (const cv::Rect2d& face : from.faces) smallest = std::min(smallest, face.width);
      scale = std::min(1.0, kLargestFace / smallest);
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
      const bool held_out = ++without % kHoldOut == 0;
      (held_out ? material.held_out : material.without).push_back(std::move(image));
    } else if (!image.faces.empty()) {
      for (int f = 0; f < static_cast<int>(image.faces.size()); ++f) {
        material.all.emplace_back(static_cast<int>(material.faces.size()), f);
      }
      material.faces.push_back(std::move(image));
    }
  }
  progress.end();
  return material;
}

void add_drawings(int count, Rng rng, Material& material) {
  for (int i = 0; i < count; ++i) {
    Image image;
    make_halves(draw_without_faces(rng), 0.05, image.halves);
    material.without.push_back(std::move(image));
  }
}

enum class Stage { kScan, kJudge, kCheck };

// Finds places that the networks, up to the given one, wrongly detect as faces.
std::vector<Mistake> find_mistakes(const Material& material, const FaceNetworks& networks,
                                   Stage stage, double threshold, Progress& progress,
                                   const std::stop_token& stop) {
  const std::size_t count = material.without.size() + material.faces.size();
  std::vector<std::vector<Mistake>> found(count);
  progress.begin("looking for mistakes", static_cast<std::int64_t>(count), "images");
  cv::parallel_for_(cv::Range(0, static_cast<int>(count)), [&](const cv::Range& range) {
    FaceSearchWorkspace workspace;
    for (int i = range.start; i < range.end; ++i) {
      progress.advance();
      if (stop.stop_requested()) return;
      const Image& image = material.image(i);
      FaceSearchOptions options;
      options.min_face = kScanFace;
      options.max_places = stage == Stage::kScan ? 150 : 400;
      options.threshold = threshold;
      options.checked = stage == Stage::kCheck;
      const std::vector<ScoredFace> places =
          stage == Stage::kScan ? scan_faces(image.halves[0], networks, options, workspace)
                                : search_faces(image.halves[0], networks, options, workspace);
      for (const ScoredFace& place : places) {
        if (place.score < threshold) continue;
        const auto is_near = [&](const cv::Rect2d& box) { return shared(box, place.box) > 0.25; };
        if (std::any_of(image.faces.begin(), image.faces.end(), is_near)) continue;
        if (std::any_of(image.ignored.begin(), image.ignored.end(), is_near)) continue;
        found[static_cast<std::size_t>(i)].push_back({i, place.box});
      }
    }
  });
  progress.end();
  throw_if_stopped(stop);
  std::vector<Mistake> all;
  for (const auto& part : found) all.insert(all.end(), part.begin(), part.end());
  return all;
}

// Finds faces without an annotated box: confident detections of the second network in images that
// show faces. They are added to the ignored regions.
void ignore_missing_boxes(Material& material, const FaceNetworks& networks, Progress& progress,
                          const std::stop_token& stop) {
  const auto first = static_cast<int>(material.without.size());
  for (const Mistake& mistake :
       find_mistakes(material, networks, Stage::kJudge, 0.9, progress, stop)) {
    if (mistake.image < first) continue;
    material.faces[static_cast<std::size_t>(mistake.image - first)].ignored.push_back(mistake.box);
  }
}

// Removes the mistakes in ignored regions.
void forget_ignored(const Material& material, std::vector<Mistake>& mistakes) {
  std::erase_if(mistakes, [&](const Mistake& mistake) {
    const std::vector<cv::Rect2d>& ignored = material.image(mistake.image).ignored;
    return std::any_of(ignored.begin(), ignored.end(),
                       [&](const cv::Rect2d& box) { return shared(box, mistake.box) > 0.25; });
  });
}

// Repeats the hard mistakes, so that they are as frequent as all others together.
void add_hard(const std::vector<Mistake>& hard, std::vector<Mistake>& mistakes) {
  if (hard.empty()) return;
  const std::size_t times = std::clamp<std::size_t>(mistakes.size() / hard.size(), 1, 20);
  for (std::size_t k = 0; k < times; ++k) {
    mistakes.insert(mistakes.end(), hard.begin(), hard.end());
  }
}

// Scores of likely faces in the held-out images, all of them false. Images are searched as in use.
// Each image is searched at several sizes between two pyramid levels, which gives different pixels
// to the networks.
constexpr double kViews[] = {1, 0.9, 0.81};
struct HeldOutScores {
  std::vector<double> all;       // of all sizes
  std::vector<double> as_it_is;  // at the original size
};
HeldOutScores score_held_out(const Material& material, const FaceNetworks& networks,
                             Progress& progress, const std::stop_token& stop) {
  const auto count = static_cast<int>(material.held_out.size());
  std::vector<HeldOutScores> found(material.held_out.size());
  progress.begin("what is sure", count, "images");
  cv::parallel_for_(cv::Range(0, count), [&](const cv::Range& range) {
    FaceSearchWorkspace workspace;
    for (int i = range.start; i < range.end; ++i) {
      progress.advance();
      if (stop.stop_requested()) return;
      const cv::Mat& gray = material.held_out[static_cast<std::size_t>(i)].halves[0];
      HeldOutScores& scores = found[static_cast<std::size_t>(i)];
      for (const double view : kViews) {
        cv::Mat seen = gray;
        if (view < 1) {
          const cv::Size size(std::max(8, cvRound(gray.cols * view)),
                              std::max(8, cvRound(gray.rows * view)));
          cv::resize(gray, seen, size, 0, 0, cv::INTER_AREA);
        }
        FaceSearchOptions options;
        options.min_face = usual_min_face(gray.size()) * view;
        options.threshold = networks.likely;
        for (const ScoredFace& face : search_faces(seen, networks, options, workspace)) {
          scores.all.push_back(face.score);
          if (view == 1) scores.as_it_is.push_back(face.score);
        }
      }
    }
  });
  progress.end();
  throw_if_stopped(stop);
  HeldOutScores result;
  for (const HeldOutScores& one : found) {
    result.all.insert(result.all.end(), one.all.begin(), one.all.end());
    result.as_it_is.insert(result.as_it_is.end(), one.as_it_is.begin(), one.as_it_is.end());
  }
  return result;
}

}  // namespace

double sure_score(const std::vector<double>& scores, double lowest, double allowed) {
  TARSIER_REQUIRE(lowest > 0 && lowest < kHighestSure, "the lowest score is {}", lowest);
  TARSIER_REQUIRE(allowed >= 0, "{} alarms", allowed);
  const auto logit = [](double score) { return std::log(score / (1 - score)); };
  double sum = 0;
  double highest = lowest;
  double count = 0;
  double below = 0;  // sum for scores below kHighestSure; higher ones are censored there
  for (const double score : scores) {
    if (score < lowest) continue;
    const double inside = std::min(score, kHighestSure);
    sum += logit(inside) - logit(lowest);
    highest = std::max(highest, inside);
    ++count;
    if (score < kHighestSure) ++below;
  }
  if (count <= allowed) return lowest;
  // Allow no false alarm: halfway between the highest score and 1.
  if (allowed == 0) return std::min(kHighestSure, 1 - 0.5 * (1 - highest));
  if (below == 0) return kHighestSure;
  const double beyond = sum / below * std::log(count / allowed);
  return std::clamp(logistic(logit(lowest) + beyond), lowest, kHighestSure);
}

FaceTraining train_face_networks(const std::vector<FaceImage>& images, const std::string& name,
                                 const FaceTrainingOptions& options, Progress& progress,
                                 std::stop_token stop) {
  options.check();
  FaceTraining result;
  Material material = load(images, progress, stop, result.skipped);
  material.disguised = options.disguised;
  if (material.all.empty()) throw InputError(name, "no face is left to learn from");
  if (material.without.empty()) {
    throw InputError(name, "no image without faces: without them everything is a face");
  }
  result.images = static_cast<int>(material.faces.size());
  result.faces = static_cast<int>(material.all.size());
  result.without = static_cast<int>(material.without.size());
  result.held_out = static_cast<int>(material.held_out.size());

  FaceNetworks& networks = result.networks;
  const Rng root(options.seed);
  add_drawings(options.drawings, root.fork(2), material);
  Rng first = root.fork(1);
  linalg::initialize(networks.scan, first);
  linalg::initialize(networks.judge, first);
  linalg::initialize(networks.check, first);
  std::vector<Mistake> mistakes;
  const auto make_scan = [&](std::int64_t, Rng& rng, linalg::Example& example) {
    thread_local FaceSearchWorkspace workspace;
    make_scan_example(material, mistakes, rng, workspace, example);
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
      make_window_example(material, mistakes, form, rng, example);
    };
    train(network, stage, steps, rate, number, make, window_loss);
  };
  const auto mistakes_of = [&](Stage stage, double threshold) {
    return find_mistakes(material, networks, stage, threshold, progress, stop);
  };

  train_scan(options.scan_steps / 2, 3e-3, 0);
  mistakes = mistakes_of(Stage::kScan, 0.3);
  result.scan_mistakes = static_cast<int>(mistakes.size());
  train_scan(options.scan_steps - options.scan_steps / 2, 2e-3, 1);

  mistakes = mistakes_of(Stage::kScan, 0.1);
  train_window(networks.judge, kJudgeWindow, "second network", options.judge_steps / 2, 2e-3, 2);
  ignore_missing_boxes(material, networks, progress, stop);
  forget_ignored(material, mistakes);
  std::vector<Mistake> hard = mistakes_of(Stage::kJudge, 0.2);
  result.judge_mistakes = static_cast<int>(hard.size());
  add_hard(hard, mistakes);
  train_window(networks.judge, kJudgeWindow, "second network",
               options.judge_steps - options.judge_steps / 2, 1.5e-3, 3);

  // The third network is trained on what passed the second one before and after its second half,
  // and then twice on what passes itself.
  mistakes = mistakes_of(Stage::kJudge, 0.1);
  mistakes.insert(mistakes.end(), hard.begin(), hard.end());
  const std::vector<Mistake> passed = mistakes;
  const int part = options.check_steps / 3;
  train_window(networks.check, kCheckWindow, "third network", part, 2e-3, 4);
  hard = mistakes_of(Stage::kCheck, 0.1);
  add_hard(hard, mistakes);
  train_window(networks.check, kCheckWindow, "third network", part, 1.5e-3, 5);
  const std::vector<Mistake> left = mistakes_of(Stage::kCheck, 0.1);
  result.check_mistakes = static_cast<int>(hard.size() + left.size());
  hard.insert(hard.end(), left.begin(), left.end());
  mistakes = passed;
  add_hard(hard, mistakes);
  train_window(networks.check, kCheckWindow, "third network", options.check_steps - 2 * part,
               1.2e-3, 6);

  if (material.held_out.empty()) return result;
  const HeldOutScores scores = score_held_out(material, networks, progress, stop);
  networks.sure = sure_score(
      scores.all, networks.likely,
      options.false_alarms / 1000 * result.held_out * static_cast<double>(std::size(kViews)));
  result.held_out_likely = static_cast<int>(scores.as_it_is.size());
  result.held_out_alarms =
      static_cast<int>(std::count_if(scores.as_it_is.begin(), scores.as_it_is.end(),
                                     [&](double score) { return score >= networks.sure; }));
  return result;
}

}  // namespace tarsier::face
