// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/global_start.h"

#include "tarsier/core/at.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/bundle/bundle.h"
#include "tarsier/sfm/global/positioning.h"
#include "tarsier/sfm/global/rotation_averaging.h"
#include "tarsier/sfm/global/view_graph.h"
#include "tarsier/sfm/mapper/model_filter.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <optional>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr double kMaxCycleDeg = 5;            // max angle of a closed cycle
constexpr int kMinCycles = 2;                 // min cycles by which an edge can be rejected
constexpr double kMaxRotationErrorDeg = 10;   // edges with larger errors are wrong
constexpr std::size_t kPointsPerImage = 150;  // per image, for positioning
constexpr std::size_t kMaxRays = 60;          // of such a point: the equations grow with the square
constexpr double kMaxSine = 0.1;  // sine of the angle between a ray and the direction to its point
// Max steps of an adjustment. A long loop that has to bend takes many. A loop that is still open
// when inaccurate observations are dropped stays open.
constexpr int kMaxSteps = 1000;
// An adjustment stops when a step reduces the cost by less than this share. A loop of n images
// bends by 1/n at each image, which is 1/n^2 of the cost. So where the radius of the view graph
// exceeds kMaxShortRadius, the share decreases with its square. This applies to the first round,
// which closes the loop, and the last.
constexpr double kTolerance = 1e-4;
constexpr double kMaxShortRadius = 60;
constexpr double kMinShare = 0.5;  // min share of images, and of observations that agree at the end
// Threshold in units of reprojection_px, and scale of Cauchy's loss for the next adjustment, px.
struct AdjustmentRound {
  double threshold;
  double loss_px;
};
constexpr AdjustmentRound kAdjustmentRounds[] = {{25, 8}, {8, 3}, {3, 1}, {1.5, 0.5}};

class GlobalMapping {
 public:
  GlobalMapping(const std::vector<geometry::Camera>& cameras, const std::vector<Image>& images,
                const std::vector<const Pair*>& pairs, const MapperOptions& options,
                const std::stop_token& stop, const GlobalStartHooks& hooks)
      : images_(images), pairs_(pairs), options_(options), stop_(stop), hooks_(hooks) {
    start_.model.cameras = cameras;
    start_.rejections.assign(pairs.size(), PairRejection::kNone);
    pair_indices_.resize(pairs.size());
    std::iota(pair_indices_.begin(), pair_indices_.end(), 0);
    std::vector<char> is_in(images_.size(), 0);
    for (const Pair* pair : pairs_) {
      is_in[at(pair->first)] = is_in[at(pair->second)] = 1;
      edges_.push_back({pair->first, pair->second, pair->view.second_from_first.rotation,
                        static_cast<double>(pair->view.inliers.size())});
    }
    total_ = static_cast<int>(std::count(is_in.begin(), is_in.end(), 1));
    if (!pairs_.empty()) image_ = pairs_.front()->first;
  }

  // Resumes from the state of another process; false: it belongs to other images or pairs, and this
  // object must not be used.
  bool restore(const GlobalStartState& from) {
    if (from.step == GlobalStartState::kRefused ||
        !fits(from, pairs_.size(), start_.model.cameras.size(), images_))
      return false;
    std::vector<char> is_remaining(pairs_.size(), 0);
    for (const int e : from.edges) is_remaining[at(e)] = 1;
    keep_edges(PairRejection::kNone, [&](std::size_t e) { return is_remaining[e] != 0; });
    start_.rejections = from.rejections;
    start_.log = from.log;
    step_ = from.step;
    round_ = from.round;
    if (step_ == GlobalStartState::kRotations) return true;
    number_nodes(from.nodes);
    for (const RelativeRotation& edge : edges_)
      if (node_of_[at(edge.first)] < 0 || node_of_[at(edge.second)] < 0) return false;
    rotations_ = from.rotations;
    if (step_ == GlobalStartState::kPositions) return true;
    choose_tracks();
    if (tracks_.size() != from.points.size() || from.model.points != 0) return false;
    Model& model = start_.model;
    model.images = images_;
    for (Image& image : model.images) image.registered = false;
    unpack(from.model, model);
    model.points.resize(tracks_.size());
    for (std::size_t p = 0; p < tracks_.size(); ++p) model.points[p].position = from.points[p];
    return true;
  }

  GlobalStart run() {
    if (step_ == kBegin) {
      make_graph();
      save_checkpoint(GlobalStartState::kRotations, 0);
    }
    bool is_good = true;
    if (step_ == GlobalStartState::kRotations) {
      is_good = average_all_rotations();
      if (is_good) save_checkpoint(GlobalStartState::kPositions, 0);
    }
    if (is_good && step_ == GlobalStartState::kPositions) {
      is_good = find_positions();
      if (is_good) save_checkpoint(GlobalStartState::kAdjustment, 0);
    }
    if (is_good) refine();
    if (!start_.refusal.empty()) start_.model = {};
    return std::move(start_);
  }

  // The rough model of a restored state.
  std::optional<PartialGlobalModel> partial_model() {
    if (step_ != GlobalStartState::kAdjustment) return std::nullopt;
    const std::size_t round = std::min(at(round_), std::size(kAdjustmentRounds) - 1);
    filter(kAdjustmentRounds[round].threshold * options_.reprojection_px);
    keep_connected();
    if (statistics_of(start_.model).registered < 2) return std::nullopt;
    return PartialGlobalModel{std::move(start_.model), std::move(tracks_)};
  }

 private:
  static constexpr int kBegin = -1;  // before the first of GlobalStartState's steps

  // Call before this round of this step.
  void save_checkpoint(GlobalStartState::Step step, int round) {
    step_ = step;
    round_ = round;
    if (hooks_.save_checkpoint) hooks_.save_checkpoint(state());
    throw_if_stopped(stop_);
  }

  [[nodiscard]] GlobalStartState state() const {
    GlobalStartState state;
    state.image = image_;
    state.step = step_;
    state.round = round_;
    state.edges = pair_indices_;
    state.rejections = start_.rejections;
    state.log = start_.log;
    if (step_ == GlobalStartState::kRotations) return state;
    state.nodes = nodes_;
    state.rotations = rotations_;
    if (step_ == GlobalStartState::kPositions) return state;
    const Model& model = start_.model;
    state.model.cameras = model.cameras;
    for (std::size_t i = 0; i < model.images.size(); ++i) {
      if (!model.images[i].registered) continue;
      state.model.registered.push_back(static_cast<int>(i));
      state.model.poses.push_back(model.images[i].pose);
    }
    for (const Point& point : model.points) state.points.push_back(point.position);
    return state;
  }

  template <typename... Parts>
  bool refuse(fmt::format_string<Parts...> text, Parts&&... parts) {
    start_.refusal = fmt::format(text, std::forward<Parts>(parts)...);
    return false;
  }

  // --- the view graph ---

  void make_graph() {
    const std::vector<CycleSupport> support =
        check_cycles(static_cast<int>(images_.size()), edges_, kMaxCycleDeg);
    std::size_t closed = 0;
    std::size_t cycles = 0;
    for (const CycleSupport& of_edge : support) {
      closed += at(of_edge.closed);
      cycles += at(of_edge.cycles);
    }
    const std::size_t before = edges_.size();
    keep_edges(PairRejection::kOpenCycles, [&](std::size_t e) {
      return support[e].cycles < kMinCycles || support[e].closed > 0;
    });
    start_.log.push_back(
        fmt::format("global: view graph of {} images and {} pairs, {} of {} triplets are "
                    "consistent; {} pairs without a consistent triplet are rejected",
                    total_, before, closed / 3, cycles / 3, before - edges_.size()));
  }

  template <typename Keep>
  void keep_edges(PairRejection why_not, const Keep& keep) {
    std::size_t remaining = 0;
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (!keep(e)) {
        start_.rejections[at(pair_indices_[e])] = why_not;
        continue;
      }
      edges_[remaining] = edges_[e];
      pair_indices_[remaining] = pair_indices_[e];
      pairs_[remaining++] = pairs_[e];
    }
    edges_.resize(remaining);
    pairs_.resize(remaining);
    pair_indices_.resize(remaining);
  }

  // Numbers the images of the largest component, and removes the edges of others.
  void keep_largest_component() {
    number_nodes(largest_component(static_cast<int>(images_.size()), edges_));
    keep_edges(PairRejection::kNone,
               [&](std::size_t e) { return node_of_[at(edges_[e].first)] >= 0; });
  }

  void number_nodes(std::vector<int> images) {
    nodes_ = std::move(images);
    node_of_.assign(images_.size(), -1);
    for (std::size_t n = 0; n < nodes_.size(); ++n) node_of_[at(nodes_[n])] = static_cast<int>(n);
  }

  // The edges with indices of nodes.
  [[nodiscard]] std::vector<RelativeRotation> edges_of_nodes() const {
    std::vector<RelativeRotation> edges = edges_;
    for (RelativeRotation& edge : edges) {
      edge.first = node_of_[at(edge.first)];
      edge.second = node_of_[at(edge.second)];
    }
    return edges;
  }

  // --- rotations ---

  bool average_all_rotations() {
    for (int round = round_;; ++round) {
      keep_largest_component();
      if (nodes_.size() < 3 || static_cast<double>(nodes_.size()) < kMinShare * total_)
        return refuse("only {} of {} images are connected by consistent pairs", nodes_.size(),
                      total_);
      AveragedRotations averaged =
          average_rotations(static_cast<int>(nodes_.size()), edges_of_nodes(), {}, stop_);
      rotations_ = std::move(averaged.rotations);
      const std::vector<double>& errors = averaged.errors_deg;
      std::vector<double> sorted = errors;
      std::sort(sorted.begin(), sorted.end());
      const std::size_t before = edges_.size();
      keep_edges(PairRejection::kRotationError,
                 [&](std::size_t e) { return errors[e] <= kMaxRotationErrorDeg; });
      start_.log.push_back(
          fmt::format("global: rotations of {} images, median error of {} pairs {:.3f} degrees; {} "
                      "pairs with an error above {} degrees are rejected",
                      nodes_.size(), before, sorted[sorted.size() / 2], before - edges_.size(),
                      kMaxRotationErrorDeg));
      if (edges_.size() == before || round == 3) return true;
      save_checkpoint(GlobalStartState::kRotations, round + 1);
    }
  }

  // --- positions ---

  // Shortens a too long track to observations of evenly spaced images.
  static void subsample(std::vector<Observation>& track) {
    if (track.size() <= kMaxRays) return;
    std::sort(track.begin(), track.end(),
              [](const Observation& a, const Observation& b) { return a.image < b.image; });
    for (std::size_t k = 0; k < kMaxRays; ++k)
      track[k] = track[k * (track.size() - 1) / (kMaxRays - 1)];
    track.resize(kMaxRays);
  }

  // Selects the longest tracks, until each image has enough of them.
  void choose_tracks() {
    std::vector<int> features;
    features.reserve(images_.size());
    for (const Image& image : images_) features.push_back(static_cast<int>(image.features.size()));
    std::vector<std::size_t> points(images_.size(), 0);
    for (std::vector<Observation>& track : make_tracks(pairs_, features)) {
      std::erase_if(track, [&](const Observation& seen) { return node_of_[at(seen.image)] < 0; });
      if (track.size() < 2) continue;
      if (std::none_of(track.begin(), track.end(), [&](const Observation& seen) {
            return points[at(seen.image)] < kPointsPerImage;
          }))
        continue;
      subsample(track);
      for (const Observation& seen : track) ++points[at(seen.image)];
      tracks_.push_back(std::move(track));
    }
  }

  bool find_positions() {
    choose_tracks();
    std::vector<std::vector<cv::Point2d>> pixels(images_.size());  // undistorted
    for (const int i : nodes_)
      pixels[at(i)] =
          undistorted(images_[at(i)].features, start_.model.cameras[at(images_[at(i)].camera)]);
    PositioningProblem problem;
    problem.cameras = static_cast<int>(nodes_.size());
    for (const auto& track : tracks_) {
      problem.first.push_back(problem.rays.size());
      for (const Observation& seen : track) {
        const geometry::Camera& camera = start_.model.cameras[at(images_[at(seen.image)].camera)];
        const cv::Point2d& p = pixels[at(seen.image)][at(seen.feature)];
        const Eigen::Vector3d in_camera((p.x - camera.cx) / camera.fx,
                                        (p.y - camera.cy) / camera.fy, 1);
        const int node = node_of_[at(seen.image)];
        problem.rays.push_back({node, rotations_[at(node)].transpose() * in_camera.normalized()});
      }
    }
    problem.first.push_back(problem.rays.size());
    const std::optional<PositionedCameras> positioned = position_cameras(problem, {}, stop_);
    if (!positioned) return refuse("the matches do not determine the camera positions");
    Model& model = start_.model;
    model.images = images_;
    for (Image& image : model.images) image.registered = false;
    for (std::size_t n = 0; n < nodes_.size(); ++n) {
      Image& image = model.images[at(nodes_[n])];
      image.registered = true;
      image.pose = {rotations_[n], -(rotations_[n] * positioned->cameras[n])};
    }
    for (std::size_t p = 0; p < tracks_.size(); ++p) {
      Point point;
      point.position = positioned->points[p];
      model.points.push_back(std::move(point));
    }
    std::vector<double> errors = positioned->errors;
    std::sort(errors.begin(), errors.end());
    const auto good = std::lower_bound(errors.begin(), errors.end(), kMaxSine) - errors.begin();
    start_.log.push_back(
        fmt::format("global: positions of {} images and {} points after {} iterations, median "
                    "error of {} rays {:.3f} degrees",
                    nodes_.size(), tracks_.size(), positioned->iterations, errors.size(),
                    std::asin(std::min(1.0, errors[errors.size() / 2])) * 180 / CV_PI));
    if (static_cast<double>(good) < kMinShare * static_cast<double>(errors.size()))
      return refuse("only {} of {} viewing rays agree with the computed positions", good,
                    errors.size());
    return true;
  }

  // --- adjustment ---

  // Keeps all observations of the tracks that fit the current model.
  void filter(double threshold_px) {
    Model& model = start_.model;
    std::vector<int> all(tracks_.size());
    std::iota(all.begin(), all.end(), 0);
    for (std::size_t p = 0; p < tracks_.size(); ++p) {
      Point& point = model.points[p];
      point.track.clear();
      for (const Observation& seen : tracks_[p])
        if (model.images[at(seen.image)].registered) point.track.push_back(seen);
    }
    MapperOptions rough = options_;
    rough.reprojection_px = threshold_px;
    // Points removed here are considered again in the next round.
    std::vector<Eigen::Vector3d> positions;
    positions.reserve(model.points.size());
    for (const Point& point : model.points) positions.push_back(point.position);
    (void)filter_selected_points(model, rough, all);
    for (std::size_t p = 0; p < positions.size(); ++p) model.points[p].position = positions[p];
  }

  void refine() {
    Model& model = start_.model;
    std::size_t observations = 0;
    std::size_t all = 0;
    const int steps = radius(static_cast<int>(nodes_.size()), edges_of_nodes());
    const double share = std::min(1.0, kMaxShortRadius / std::max(1, steps));
    const double tolerance = kTolerance * share * share;
    for (std::size_t k = at(round_); k < std::size(kAdjustmentRounds); ++k) {
      const AdjustmentRound& round = kAdjustmentRounds[k];
      filter(round.threshold * options_.reprojection_px);
      keep_connected();
      BundleOptions bundle;
      bundle.loss_px = round.loss_px;
      bundle.max_iterations = kMaxSteps;
      const bool is_intermediate = k > 0 && k + 1 < std::size(kAdjustmentRounds);
      bundle.tolerance = is_intermediate ? kTolerance : tolerance;
      bundle.focal = options_.refine_focal && round.threshold < 10;
      bundle.distortion = options_.refine_distortion && round.threshold < 5;
      const BundleReport report = adjust(model, bundle, stop_);
      if (!report.warning.empty())
        start_.log.push_back(fmt::format("global: bundle adjustment: {}", report.warning));
      save_checkpoint(GlobalStartState::kAdjustment, static_cast<int>(k) + 1);
    }
    filter(options_.reprojection_px);
    keep_connected();
    const ModelStatistics statistics = statistics_of(model);
    observations = static_cast<std::size_t>(statistics.observations);
    for (const auto& track : tracks_) all += track.size();
    start_.log.push_back(
        fmt::format("global: {} of {} images registered, {} of {} observations within {} px, "
                    "reprojection error {:.3f} px",
                    statistics.registered, total_, observations, all, options_.reprojection_px,
                    statistics.reprojection_px));
    if (statistics.registered < 3 || statistics.registered < kMinShare * total_) {
      refuse("only {} of {} images remain registered after bundle adjustment",
             statistics.registered, total_);
    } else if (static_cast<double>(observations) < kMinShare * static_cast<double>(all)) {
      refuse("only {} of {} observations agree with the model after bundle adjustment",
             observations, all);
    }
    model.points.clear();
  }

  // Unregisters images with too few points, and those that no point connects with the others.
  void keep_connected() {
    Model& model = start_.model;
    for (;;) {
      std::vector<int> points(model.images.size(), 0);
      Components components(model.images.size());
      for (const Point& point : model.points) {
        for (const Observation& seen : point.track) {
          ++points[at(seen.image)];
          components.join(point.track.front().image, seen.image);
        }
      }
      std::vector<int> sizes(model.images.size(), 0);
      for (std::size_t i = 0; i < model.images.size(); ++i)
        if (model.images[i].registered) ++sizes[at(components.root(static_cast<int>(i)))];
      const auto largest =
          static_cast<int>(std::max_element(sizes.begin(), sizes.end()) - sizes.begin());
      bool changed = false;
      for (std::size_t i = 0; i < model.images.size(); ++i) {
        if (!model.images[i].registered) continue;
        if (components.root(static_cast<int>(i)) == largest && points[i] >= options_.pose_inliers)
          continue;
        model.images[i].registered = false;
        changed = true;
      }
      if (!changed) return;
      for (Point& point : model.points) {
        std::erase_if(point.track, [&](const Observation& seen) {
          return !model.images[at(seen.image)].registered;
        });
        if (point.track.size() < 2) point.track.clear();
      }
    }
  }

  const std::vector<Image>& images_;
  std::vector<const Pair*> pairs_;  // for edges_
  std::vector<int> pair_indices_;   // for edges_: index into the given pairs
  const MapperOptions& options_;
  const std::stop_token& stop_;
  const GlobalStartHooks& hooks_;
  int step_ = kBegin;  // GlobalStartState::step of the next step
  int round_ = 0;      // of the next step
  int image_ = -1;     // an image of the pairs
  GlobalStart start_;
  int total_ = 0;                        // images in pairs
  std::vector<RelativeRotation> edges_;  // between images
  std::vector<int> nodes_;               // indices of images
  std::vector<int> node_of_;
  std::vector<Eigen::Matrix3d> rotations_;  // for each node
  std::vector<std::vector<Observation>> tracks_;
};

}  // namespace

GlobalStart start_globally(const std::vector<geometry::Camera>& cameras,
                           const std::vector<Image>& images, const std::vector<const Pair*>& pairs,
                           const MapperOptions& options, const std::stop_token& stop,
                           const GlobalStartHooks& hooks) {
  if (hooks.resume_from != nullptr) {
    GlobalMapping mapping(cameras, images, pairs, options, stop, hooks);
    if (mapping.restore(*hooks.resume_from)) return mapping.run();
  }
  return GlobalMapping(cameras, images, pairs, options, stop, hooks).run();
}

std::optional<PartialGlobalModel> partial_model(const GlobalStartState& state,
                                                const std::vector<geometry::Camera>& cameras,
                                                const std::vector<Image>& images,
                                                const std::vector<const Pair*>& pairs,
                                                const MapperOptions& options) {
  const std::stop_token never;
  const GlobalStartHooks none;
  GlobalMapping mapping(cameras, images, pairs, options, never, none);
  if (!mapping.restore(state)) return std::nullopt;
  return mapping.partial_model();
}

}  // namespace tarsier::sfm
