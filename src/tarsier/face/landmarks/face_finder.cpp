// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/face_finder.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/face/detect/cascade.h"
#include "tarsier/face/landmarks/hog_detector.h"
#include "tarsier/face/landmarks/merged_candidates.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/linalg/model_fields.h"

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <tuple>
#include <utility>

namespace tarsier::face::landmarks {

void BoxModel::check() const {
  TARSIER_REQUIRE(std::isfinite(dx) && std::abs(dx) <= 2, "dx {}", dx);
  TARSIER_REQUIRE(std::isfinite(dy) && std::abs(dy) <= 2, "dy {}", dy);
  TARSIER_REQUIRE(size >= 0.02 && size <= 5, "size {}", size);
}

BoxModel train_box_model(const std::vector<Eigen::Matrix2Xd>& shapes,
                         const std::vector<cv::Rect2d>& boxes, double fraction) {
  TARSIER_REQUIRE(shapes.size() == boxes.size(), "{} shapes, {} boxes", shapes.size(),
                  boxes.size());
  TARSIER_REQUIRE(fraction >= 0 && fraction <= 1, "fraction {}", fraction);
  std::vector<double> dx;
  std::vector<double> dy;
  std::vector<double> size;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    const cv::Rect2d& box = boxes[i];
    if (box.width <= 0 || box.height <= 0) continue;
    Eigen::Index inside = 0;
    for (Eigen::Index p = 0; p < shapes[i].cols(); ++p) {
      if (box.contains(cv::Point2d(shapes[i](0, p), shapes[i](1, p)))) ++inside;
    }
    if (static_cast<double>(inside) < fraction * static_cast<double>(shapes[i].cols())) continue;
    const Eigen::Vector2d center = shapes[i].rowwise().mean();
    dx.push_back((center.x() - (box.x + 0.5 * box.width - 0.5)) / box.width);
    dy.push_back((center.y() - (box.y + 0.5 * box.height - 0.5)) / box.width);
    size.push_back(regression::shape_size(shapes[i]) / box.width);
  }
  TARSIER_REQUIRE(!dx.empty(), "of {} boxes none holds {} of its face's points", boxes.size(),
                  fraction);
  BoxModel model;
  model.dx = upper_median(dx);
  model.dy = upper_median(dy);
  model.size = upper_median(size);
  model.trained_on = static_cast<int>(dx.size());
  return model;
}

Eigen::Matrix2Xd start_in_box(const BoxModel& model, const Eigen::Matrix2Xd& mean,
                              const cv::Rect2d& box, double roll) {
  const Eigen::Vector2d offset(model.dx * box.width, model.dy * box.width);
  const Eigen::Vector2d box_center(box.x + 0.5 * box.width - 0.5, box.y + 0.5 * box.height - 0.5);
  const double size = model.size * box.width;
  if (roll == 0) return (mean * size).colwise() + (box_center + offset);
  const Eigen::Rotation2Dd rotation(roll);
  return (rotation.toRotationMatrix() * (mean * size)).colwise() + (box_center + rotation * offset);
}

BoxModel cascade_box() {
  BoxModel model;
  model.dx = 0.0089;
  model.dy = 0.1209;
  model.size = 0.3262;
  model.trained_on = 899;
  return model;
}

cv::Rect2d box_around(const BoxModel& model, const Eigen::Matrix2Xd& points) {
  const double width = regression::shape_size(points) / model.size;
  const Eigen::Vector2d center = points.rowwise().mean();
  return {center.x() - model.dx * width - 0.5 * width + 0.5,
          center.y() - model.dy * width - 0.5 * width + 0.5, width, width};
}

namespace {

constexpr NameTable<RolledSearch, 3> kRolledSearches{"search of rolled faces",
                                                     {{{RolledSearch::kNever, "never"},
                                                       {RolledSearch::kAuto, "auto"},
                                                       {RolledSearch::kAlways, "always"}}}};

// Longer side of an image before rotation, px; rotation up to doubles its area.
constexpr double kMaxRotatedSide = 2048;
// Size of the smallest face in a rotated part, px.
constexpr double kMinRotatedFace = 40;

// How far below its threshold a trained detector is evaluated, in margins of the training.
constexpr double kLooseMargin = 0.5;
// Longest side of a tile of a video, and of a still image, in windows of the detector.
constexpr double kTileWindows = 12;
constexpr double kHogTileWindows = 8;
constexpr double kHogStillWindows = 16;
// Besides the networks, the cascade detects large faces: at this image width, px, from this share
// of the image's smaller side on. Landmark models are trained to start from its boxes.
constexpr int kLargeSearchWidth = 320;
// Tiles of a video are searched repeatedly, so the networks evaluate few candidates per search.
constexpr int kMaxTileCandidates = 48;
// Scores of the cascades' detections on the scale of the networks: strict search, other searches.
constexpr double kCascadeScore = 0.9;
constexpr double kLooseScore = 0.5;
constexpr double kMinLargeShare = 0.1;
FaceDetectorOptions less_strict(FaceDetectorOptions options) {
  options.neighbors = std::max(1, options.neighbors - 1);
  options.step = 1.05;
  return options;
}

std::optional<FaceDetector> detector_if_installed(const FaceDetectorOptions& options) {
  if (find_cascade(options.cascade).empty()) return std::nullopt;
  return FaceDetector(options);
}

}  // namespace

std::string_view name_of(RolledSearch search) { return kRolledSearches.name(search); }

RolledSearch parse_rolled_search(std::string_view name) { return kRolledSearches.parse(name); }

struct FaceFinder::Impl {
  FaceFinderOptions options;
  std::optional<FaceDetector> strict;  // or
  std::optional<HogFinder> trained;    // or
  std::shared_ptr<const FaceNetworks> networks;
  std::shared_ptr<const AnchorDetector> anchors;  // in addition to the networks, or null
  AnchorWorkspace anchor_workspace;
  std::optional<FaceDetector> large;  // in addition to the networks, if the cascade's file exists
  FaceSearchWorkspace workspace;
  // The other cascades, loaded when first needed; empty if the file is missing.
  std::vector<std::optional<FaceDetector>> others;
  bool is_loaded = false;
  std::size_t next_loose_search = 0;  // of the less strict searches of tiles
  cv::Mat flipped;
  std::optional<BoxModel> box;
  std::int64_t hog_pixels = 0;
  std::int64_t anchor_pixels = 0;

  void load();
  // Detects faces in a part of the image with the user's own network.
  void search_external(const cv::Mat& gray, const SearchTile& tile,
                       std::vector<ScoredCandidate>& found) const;
  [[nodiscard]] double window() const;
  [[nodiscard]] double min_face(cv::Size image) const;
  // The networks evaluate `max_candidates` candidates.
  void search_tile(const cv::Mat& gray, const SearchTile& tile, bool thorough,
                   std::vector<ScoredCandidate>& found,
                   int max_candidates = FaceSearchOptions().max_candidates);
  void search_strict(const cv::Mat& gray, const SearchTile& tile,
                     std::vector<ScoredCandidate>& found);
  // In addition to the networks, in the whole image: the cascade. If it is confident of no face,
  // also its less strict searches, all of them or the next one.
  void search_large(const cv::Mat& gray, bool thorough, bool all,
                    std::vector<ScoredCandidate>& found);
  // In addition to the networks, in the whole image: all views, or the next one. Returns the
  // candidates of all detectors.
  [[nodiscard]] std::vector<MergedCandidate> merge_with_anchors(const cv::Mat& gray, bool all,
                                                                std::vector<ScoredCandidate> found);
  std::size_t next_anchor_view = 0;  // of the views, for videos
  // Less strict search number 0 .. kSearches - 1.
  static constexpr std::size_t kSearches = 4;
  void search_loosely(const cv::Mat& gray, const SearchTile& tile, std::size_t which,
                      std::vector<ScoredCandidate>& found);
  [[nodiscard]] std::vector<Candidate> find(const cv::Mat& gray, bool thorough);
  cv::Mat reduced, rotated;
  double rotated_min_face = 0;  // px, while a rotated image is searched; otherwise 0
};

void FaceFinder::Impl::load() {
  if (is_loaded) return;
  is_loaded = true;
  FaceDetectorOptions loose = less_strict(options.detector);
  if (networks) loose.max_width = kLargeSearchWidth;
  others.push_back(detector_if_installed(loose));
  loose.cascade = "haarcascade_frontalface_default.xml";
  loose.neighbors = options.detector.neighbors;
  others.push_back(detector_if_installed(loose));
  loose.cascade = "haarcascade_profileface.xml";
  others.push_back(detector_if_installed(loose));
}

void FaceFinder::Impl::search_external(const cv::Mat& gray, const SearchTile& tile,
                                       std::vector<ScoredCandidate>& found) const {
  constexpr double kMinConfidentScore = 0.6;
  const cv::Point2d corner(tile.area.tl());
  for (const ScoredFace& face : options.external_detector->find(gray(tile.area))) {
    if (face.box.width >= tile.min_face)
      found.push_back(
          {{face.box + corner, face.score >= kMinConfidentScore, face.score}, face.score});
  }
}

double FaceFinder::Impl::window() const {
  if (networks) return kScanFace;
  if (!trained) return kCascadeWindow;
  const HogDetector& model = trained->detector();
  return std::sqrt(static_cast<double>(model.width) * model.height);
}

double FaceFinder::Impl::min_face(cv::Size image) const {
  if (rotated_min_face > 0) return rotated_min_face;
  if (options.detector.min_face > 0) return options.detector.min_face;
  return trained ? 40 : default_min_face(image);
}

void FaceFinder::Impl::search_strict(const cv::Mat& gray, const SearchTile& tile,
                                     std::vector<ScoredCandidate>& found) {
  for (const cv::Rect& detected : strict->detect(gray(tile.area), tile.min_face, tile.max_face)) {
    found.push_back({{cv::Rect2d(detected + tile.area.tl()), true, kCascadeScore}, 0});
  }
}

void FaceFinder::Impl::search_loosely(const cv::Mat& gray, const SearchTile& tile,
                                      std::size_t which, std::vector<ScoredCandidate>& found) {
  load();
  const std::size_t number = std::min<std::size_t>(which, others.size() - 1);
  if (!others[number]) return;
  cv::Mat part = gray(tile.area);
  const bool mirrored = which == kSearches - 1;
  if (mirrored) {
    cv::flip(part, flipped, 1);
    part = flipped;
  }
  for (cv::Rect detected : others[number]->detect(part, tile.min_face, tile.max_face)) {
    if (mirrored) detected.x = part.cols - detected.x - detected.width;
    found.push_back({{cv::Rect2d(detected + tile.area.tl()), false, kLooseScore}, 0});
  }
}

void FaceFinder::Impl::search_tile(const cv::Mat& gray, const SearchTile& tile, bool thorough,
                                   std::vector<ScoredCandidate>& found, int max_candidates) {
  const cv::Point2d corner(tile.area.tl());
  if (networks) {
    FaceSearchOptions search;
    search.min_face = std::max<double>(kScanFace, tile.min_face);
    search.max_face = tile.max_face > 0 ? std::max(search.min_face, tile.max_face) : 0;
    search.threshold = thorough ? networks->likely_score : networks->confident_score;
    search.max_candidates = max_candidates;
    for (const ScoredFace& face : search_faces(gray(tile.area), *networks, search, workspace)) {
      found.push_back(
          {{face.box + corner, face.score >= networks->confident_score, face.score}, face.score});
    }
    return;
  }
  if (trained) {
    const double shrunk = std::min(1.0, window() / tile.min_face);
    hog_pixels += static_cast<std::int64_t>(tile.area.area() * shrunk * shrunk);
    for (const ScoredBox& scored :
         trained->find(gray(tile.area), tile.min_face, thorough ? kLooseMargin : 0)) {
      if (tile.max_face > 0 && scored.box.width > 1.3 * tile.max_face) continue;
      const double score = logistic(4 * scored.score);  // 0.5 at the threshold
      found.push_back({{scored.box + corner, scored.score >= 0, score}, scored.score});
    }
    return;
  }
  search_strict(gray, tile, found);
  if (!thorough) return;
  for (std::size_t which = 0; which < kSearches; ++which) {
    search_loosely(gray, tile, which, found);
  }
}

void FaceFinder::Impl::search_large(const cv::Mat& gray, bool thorough, bool all,
                                    std::vector<ScoredCandidate>& found) {
  if (!large) return;
  const double smallest =
      std::max(min_face(gray.size()), kMinLargeShare * std::min(gray.cols, gray.rows));
  constexpr double kBetterThanNetworks = 2;
  for (const cv::Rect& detected : large->detect(gray, smallest, 0)) {
    found.push_back({{cv::Rect2d(detected), true, kCascadeScore}, kBetterThanNetworks});
  }
  const bool has_confident =
      std::any_of(found.begin(), found.end(),
                  [](const ScoredCandidate& one) { return one.candidate.confident; });
  if (has_confident || !thorough) return;
  const SearchTile whole{cv::Rect(0, 0, gray.cols, gray.rows), smallest, 0};
  if (!all) {
    search_loosely(gray, whole, next_loose_search++ % kSearches, found);
    return;
  }
  for (std::size_t which = 0; which < kSearches; ++which) {
    search_loosely(gray, whole, which, found);
  }
}

std::vector<MergedCandidate> FaceFinder::Impl::merge_with_anchors(
    const cv::Mat& gray, bool all, std::vector<ScoredCandidate> found) {
  if (!anchors) return merge_candidates(std::move(found));
  const double smallest = min_face(gray.size());
  const std::size_t first = all ? 0 : next_anchor_view++ % kAnchorViews.size();
  const std::size_t count = all ? kAnchorViews.size() : 1;
  for (std::size_t view = first; view < first + count; ++view) {
    const auto [side, mirrored] = kAnchorViews[view];
    cv::Mat view_image = gray;
    if (mirrored) {
      cv::flip(gray, flipped, 1);
      view_image = flipped;
    }
    AnchorSearchOptions search;
    search.side = side;
    search.threshold = kMissedViewScore;
    for (const ScoredFace& face : search_anchors(view_image, *anchors, search, anchor_workspace)) {
      cv::Rect2d square = cascade_square(face.box);
      if (mirrored) square.x = gray.cols - square.x - square.width;
      // Boxes of other detectors are better starts for landmarks, so they come first.
      constexpr double kBehindOthers = -1;
      if (square.width >= smallest)
        found.push_back(
            {{square, false, face.score}, face.score + kBehindOthers, static_cast<int>(view)});
    }
    anchor_pixels += static_cast<std::int64_t>(side) * side;
  }
  std::vector<MergedCandidate> merged = merge_candidates(std::move(found));
  rescore_by_anchors(merged, all, std::max(gray.cols, gray.rows));
  return merged;
}

std::vector<Candidate> FaceFinder::Impl::find(const cv::Mat& gray, bool thorough) {
  require_gray(gray);
  const double smallest = min_face(gray.size());
  std::vector<ScoredCandidate> found;
  if (options.external_detector) {
    search_external(gray, {cv::Rect(0, 0, gray.cols, gray.rows), smallest, 0}, found);
  } else if (trained) {
    const SearchPlan plan =
        plan_search(gray.size(), smallest, window(), kHogStillWindows * window());
    search_tile(gray, plan.whole, thorough, found);
    for (const SearchTile& tile : plan.tiles) search_tile(gray, tile, thorough, found);
  } else {
    search_tile(gray, {cv::Rect(0, 0, gray.cols, gray.rows), smallest, 0}, thorough, found);
    search_large(gray, thorough, true, found);
  }
  std::vector<Candidate> candidates = candidates_of(
      trained || options.external_detector ? merge_candidates(std::move(found))
                                           : merge_with_anchors(gray, true, std::move(found)));
  if (!thorough) std::erase_if(candidates, [](const Candidate& one) { return !one.confident; });
  return candidates;
}

FaceFinder::FaceFinder(const FaceFinderOptions& options) : impl_(std::make_unique<Impl>()) {
  impl_->options = options;
  if (!options.external_detector) impl_->strict.emplace(options.detector);
}
FaceFinder::FaceFinder(const HogDetector& detector, const FaceFinderOptions& options)
    : impl_(std::make_unique<Impl>()) {
  options.detector.check();
  impl_->options = options;
  impl_->trained.emplace(detector);
  impl_->box = detector.box;
}
FaceFinder::FaceFinder(std::shared_ptr<const FaceNetworks> networks,
                       const FaceFinderOptions& options,
                       std::shared_ptr<const AnchorDetector> anchors)
    : impl_(std::make_unique<Impl>()) {
  TARSIER_REQUIRE(networks != nullptr, "no networks");
  options.detector.check();
  networks->require();
  impl_->options = options;
  impl_->networks = std::move(networks);
  impl_->anchors = std::move(anchors);
  impl_->large = detector_if_installed({.max_width = kLargeSearchWidth});
}
FaceFinder::~FaceFinder() = default;
FaceFinder::FaceFinder(FaceFinder&&) noexcept = default;
FaceFinder& FaceFinder::operator=(FaceFinder&&) noexcept = default;

const std::optional<BoxModel>& FaceFinder::box_model() const { return impl_->box; }

double FaceFinder::min_face(cv::Size image) const { return impl_->min_face(image); }

std::int64_t FaceFinder::pixels() const {
  std::int64_t sum = impl_->workspace.pixels + impl_->hog_pixels + impl_->anchor_pixels;
  if (impl_->strict) sum += impl_->strict->pixels();
  if (impl_->large) sum += impl_->large->pixels();
  for (const auto& other : impl_->others) {
    if (other) sum += other->pixels();
  }
  return sum;
}

SearchPlan FaceFinder::plan(cv::Size image) const {
  if (impl_->options.external_detector)  // the network sees the whole image at once
    return {{cv::Rect({0, 0}, image), impl_->min_face(image), 0}, {}};
  const double window = impl_->window();
  return plan_search(image, impl_->min_face(image), window,
                     (impl_->trained ? kHogTileWindows : kTileWindows) * window);
}

std::vector<Candidate> FaceFinder::find_confident(const cv::Mat& gray) {
  return impl_->find(gray, false);
}

std::vector<Candidate> FaceFinder::find(const cv::Mat& gray) {
  return impl_->find(gray, impl_->options.thorough);
}

RolledSearch FaceFinder::rolled_search() const { return impl_->options.rolled; }

std::vector<Candidate> FaceFinder::find_rolled_in(const cv::Mat& gray, const SearchTile& tile,
                                                  double roll) {
  require_gray(gray);
  TARSIER_REQUIRE(std::abs(roll) <= CV_PI / 2, "a roll of {} radians", roll);
  Impl& my = *impl_;
  const cv::Rect area = tile.area & cv::Rect(0, 0, gray.cols, gray.rows);
  if (area.empty()) return {};
  cv::Mat part = gray(area);
  const double scale = std::min({1.0, kMinRotatedFace / std::max(1.0, tile.min_face),
                                 kMaxRotatedSide / std::max(area.width, area.height)});
  if (scale < 1) {
    cv::resize(part, my.reduced, {}, scale, scale, cv::INTER_AREA);
    part = my.reduced;
  }
  // Rotate about the centre, so that faces with this roll become upright.
  const double cosine = std::cos(roll);
  const double sine = std::sin(roll);
  const cv::Size size(cvCeil(part.cols * std::abs(cosine) + part.rows * std::abs(sine)),
                      cvCeil(part.cols * std::abs(sine) + part.rows * std::abs(cosine)));
  const cv::Point2d from(0.5 * (part.cols - 1), 0.5 * (part.rows - 1));
  const cv::Point2d to(0.5 * (size.width - 1), 0.5 * (size.height - 1));
  const cv::Matx23d map(cosine, sine, to.x - cosine * from.x - sine * from.y,  //
                        -sine, cosine, to.y + sine * from.x - cosine * from.y);
  cv::warpAffine(part, my.rotated, map, size, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  const double ratio_x = static_cast<double>(area.width) / part.cols;
  const double ratio_y = static_cast<double>(area.height) / part.rows;
  struct Reset {
    double& value;
    ~Reset() { value = 0; }
  };
  const Reset reset{my.rotated_min_face};
  my.rotated_min_face = std::max(1.0, tile.min_face * scale);
  std::vector<Candidate> out;
  for (Candidate candidate : my.find(my.rotated, false)) {
    const double width = candidate.box.width * ratio_x;
    if (width < tile.min_face || (tile.max_face > 0 && width > tile.max_face)) continue;
    const cv::Point2d center(candidate.box.x + 0.5 * candidate.box.width - 0.5 - to.x,
                             candidate.box.y + 0.5 * candidate.box.height - 0.5 - to.y);
    const cv::Point2d image_center(
        area.x + (cosine * center.x - sine * center.y + from.x + 0.5) * ratio_x - 0.5,
        area.y + (sine * center.x + cosine * center.y + from.y + 0.5) * ratio_y - 0.5);
    if (image_center.x < area.x || image_center.y < area.y ||
        image_center.x > area.x + area.width - 1 || image_center.y > area.y + area.height - 1)
      continue;
    candidate.box = {image_center.x + 0.5 - width / 2, image_center.y + 0.5 - width / 2, width,
                     width};
    candidate.roll = roll;
    out.push_back(candidate);
  }
  return out;
}

std::vector<Candidate> FaceFinder::find_rolled(const cv::Mat& gray) {
  require_gray(gray);
  const SearchTile whole{cv::Rect(0, 0, gray.cols, gray.rows), min_face(gray.size()), 0};
  std::vector<Candidate> all;
  for (const double roll : {-kSearchRoll, kSearchRoll}) {
    const std::vector<Candidate> found = find_rolled_in(gray, whole, roll);
    all.insert(all.end(), found.begin(), found.end());
  }
  std::stable_sort(all.begin(), all.end(), [](const Candidate& a, const Candidate& b) {
    return std::tuple(!a.confident, -a.score) < std::tuple(!b.confident, -b.score);
  });
  std::vector<Candidate> distinct;
  for (const Candidate& one : all) {
    constexpr double kMinIou = 0.35;  // intersection over union
    const bool known = std::any_of(distinct.begin(), distinct.end(), [&](const Candidate& better) {
      return iou(better.box, one.box) > kMinIou;
    });
    if (!known) distinct.push_back(one);
  }
  std::stable_sort(distinct.begin(), distinct.end(), [](const Candidate& a, const Candidate& b) {
    return a.box.area() > b.box.area();
  });
  return distinct;
}

std::vector<Candidate> FaceFinder::find_in(const cv::Mat& gray, const SearchTile& tile,
                                           bool cascades) {
  require_gray(gray);
  Impl& my = *impl_;
  SearchTile inside = tile;
  inside.area &= cv::Rect(0, 0, gray.cols, gray.rows);
  if (inside.area.empty()) return {};
  std::vector<ScoredCandidate> found;
  if (my.options.external_detector) {
    my.search_external(gray, inside, found);
  } else if (my.strict && my.options.thorough) {
    my.search_strict(gray, inside, found);
    my.search_loosely(gray, inside, my.next_loose_search++ % Impl::kSearches, found);
  } else {
    my.search_tile(gray, inside, my.options.thorough, found, kMaxTileCandidates);
    if (inside.area.size() == gray.size()) {
      if (cascades) my.search_large(gray, my.options.thorough, false, found);
      return candidates_of(my.merge_with_anchors(gray, false, std::move(found)));
    }
  }
  return candidates_of(merge_candidates(std::move(found)));
}

namespace {

void list_box_model(linalg::ModelFields& file, BoxModel& model) {
  file.number("dx", model.dx, -2, 2);
  file.number("dy", model.dy, -2, 2);
  file.number("size", model.size, 0.02, 5);
  file.whole("trained_on", model.trained_on, 0, 1 << 30);
}

}  // namespace

nlohmann::json to_json(const BoxModel& model) { return linalg::written(model, list_box_model); }

BoxModel box_model_from_json(const nlohmann::json& value, const std::string& path) {
  return linalg::read_fields<BoxModel>(value, path, list_box_model);
}

}  // namespace tarsier::face::landmarks
