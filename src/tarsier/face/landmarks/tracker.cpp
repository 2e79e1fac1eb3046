// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/tracker.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/image.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace tarsier::face::landmarks {

namespace {

constexpr int kCascadeInterval = 4;  // searches
// Share of the longer side: width of the smallest rolled face.
constexpr double kMinRolledShare = 0.05;

// Distance between two faces' centres, in sizes of the second.
double distance(const cv::Rect2d& a, const cv::Rect2d& b) {
  return std::hypot(a.x + a.width / 2 - b.x - b.width / 2,
                    a.y + a.height / 2 - b.y - b.height / 2) /
         std::max(1.0, b.width);
}

bool is_in_image(const cv::Rect2d& box, const cv::Mat& gray) {
  const cv::Rect2d image(0, 0, gray.cols, gray.rows);
  return (box & image).area() > 0.4 * box.area();
}

class Step {
 public:
  Step(const LandmarkModel& model, const FitOptions& fit, const TrackerOptions& options,
       FaceFinder& finder, TrackerState& state, const cv::Mat& gray, double dt,
       FitWorkspace& workspace, DebugSink* debug)
      : model_(model),
        fit_(fit),
        options_(options),
        finder_(finder),
        state_(state),
        gray_(gray),
        dt_(dt),
        workspace_(workspace),
        debug_(debug) {}

  void track_known_faces() {
    for (TrackerState::Track& track : state_.tracks) {
      if (track.lost) continue;
      const Eigen::Matrix2Xd start = start_from_points(model_, track.raw, true);
      Fit fit = fit_points(model_, fit_, gray_, start, workspace_, debug_);
      if (fit.score < options_.min_score) {
        // The face may have rotated too far: try upright at the same position.
        Fit again = fit_points(model_, fit_, gray_, start_from_points(model_, track.raw, false),
                               workspace_, debug_);
        if (again.score > fit.score) fit = std::move(again);
      }
      const bool jumped =
          regression::shape_size(fit.points) < 0.5 * regression::shape_size(track.raw) ||
          regression::shape_size(fit.points) > 2 * regression::shape_size(track.raw);
      if (fit.score < options_.min_score || jumped || !update_track(track, fit)) track.lost = true;
    }
    drop_duplicates();
  }

  // Searches for faces that are not tracked.
  void search() {
    if (!state_.searched || state_.planned != gray_.size()) {
      state_.plan = finder_.plan(gray_.size());
      state_.planned = gray_.size();
      state_.next_tile = 0;
    }
    const bool due = --state_.until_search <= 0;
    if (due) state_.until_search = options_.search_every;
    if (!state_.searched) {
      state_.searched = true;
      start_new_tracks(finder_.find(gray_));
      if (searches_rolled()) start_rolled_tracks(finder_.find_rolled(gray_));
      return;
    }
    // Search for lost faces before new faces get their ids.
    const std::vector<LostFace> faces = lost_faces();
    for (const LostFace& face : faces)
      start_new_tracks(finder_.find_in(gray_, tile_around(face.box)));
    for (const LostFace& face : faces) {
      if (std::abs(face.roll) < kMinRoll || std::abs(face.roll) > CV_PI / 2) continue;
      if (searches_rolled())
        start_rolled_tracks(finder_.find_rolled_in(gray_, tile_around(face.box), face.roll));
    }
    if (due || !faces.empty()) {
      const bool calm = faces.empty() && count_tracked() > 0;
      const bool cascades = !calm || state_.calm_searches++ % kCascadeInterval == 0;
      start_new_tracks(finder_.find_in(gray_, state_.plan.whole, cascades));
    }
    if (due && searches_rolled()) {
      state_.to_left = !state_.to_left;
      // Min face size for which the cost does not depend on the image size.
      const double smallest = std::max(finder_.min_face(gray_.size()),
                                       kMinRolledShare * std::max(gray_.cols, gray_.rows));
      const SearchTile whole{cv::Rect(0, 0, gray_.cols, gray_.rows), smallest, 0};
      start_rolled_tracks(
          finder_.find_rolled_in(gray_, whole, state_.to_left ? -kSearchRoll : kSearchRoll));
    }
    if (state_.plan.tiles.empty()) return;
    start_new_tracks(finder_.find_in(gray_, state_.plan.tiles[state_.next_tile]));
    state_.next_tile = (state_.next_tile + 1) % state_.plan.tiles.size();
  }

  void erase_old_tracks() {
    std::erase_if(state_.tracks, [&](const TrackerState::Track& track) {
      return track.lost && state_.time - track.last_fit_s > options_.remember_s;
    });
  }

 private:
  void start_new_tracks(const std::vector<Candidate>& candidates) {
    for (const Candidate& candidate : candidates) {
      if (is_tracked(candidate.box)) continue;
      if (count_tracked() >= options_.max_faces) break;
      const Fit fit =
          fit_points(model_, fit_, gray_, start_at(model_, finder_, candidate), workspace_, debug_);
      if (fit.score < options_.min_new) continue;
      const cv::Rect2d box = box_around(model_.box, fit.points);
      if (is_tracked(box)) continue;
      begin(fit, box);
    }
  }

  void start_rolled_tracks(const std::vector<Candidate>& candidates) {
    for (const Candidate& candidate : candidates) {
      if (is_tracked(candidate.box)) continue;
      if (count_tracked() >= options_.max_faces) break;
      const std::optional<Fit> fit =
          fit_rolled(model_, fit_, gray_, finder_, candidate, workspace_, options_.min_new, debug_);
      if (!fit || fit->score < options_.min_new) continue;
      const cv::Rect2d box = box_around(model_.box, fit->points);
      if (!is_tracked(box)) begin(*fit, box);
    }
  }

  [[nodiscard]] bool searches_rolled() const {
    if (!model_.quality || finder_.rolled_search() == RolledSearch::kNever) return false;
    return finder_.rolled_search() == RolledSearch::kAlways || count_tracked() == 0;
  }

  struct LostFace {
    cv::Rect2d box;
    double roll = 0;  // radians
  };
  [[nodiscard]] std::vector<LostFace> lost_faces() const {
    std::vector<LostFace> faces;
    for (const TrackerState::Track& track : state_.tracks) {
      if (track.lost && track.face.box.width > 0)
        faces.push_back({track.face.box, roll_of(model_, track.raw)});
    }
    return faces;
  }

  // Five times as wide as the face; includes slightly smaller and larger faces.
  [[nodiscard]] static SearchTile tile_around(const cv::Rect2d& box) {
    constexpr double kMinFace = 16;
    const double smallest = std::max(kMinFace, 0.6 * box.width);
    const double reach = 2 * std::max(box.width, kMinFace);
    return {cv::Rect(cv::Rect2d(box.x - reach, box.y - reach, box.width + 2 * reach,
                                box.height + 2 * reach)),
            smallest, std::max(2 * smallest, 1.8 * box.width)};
  }

  bool update_track(TrackerState::Track& track, const Fit& fit) {
    const cv::Rect2d box = box_around(model_.box, fit.points);
    if (!is_in_image(box, gray_)) return false;
    track.raw = fit.points;
    track.face.points =
        options_.smoothing
            ? track.filter.next(options_.filter, fit.points, dt_,
                                std::max(1.0, 1.6 * regression::shape_size(fit.points)))
            : fit.points;
    track.face.score = fit.score;
    track.face.visibility = fit.visibility;
    track.face.box = box;
    track.last_fit_s = state_.time;
    track.lost = false;
    return true;
  }

  // Resumes the nearest lost face, or starts a new one.
  void begin(const Fit& fit, const cv::Rect2d& box) {
    TrackerState::Track* best = nullptr;
    double nearest = 1.5;
    for (TrackerState::Track& track : state_.tracks) {
      if (!track.lost) continue;
      // A face that was lost for longer may have moved farther.
      const double scaled_distance =
          distance(track.face.box, box) / (1 + (state_.time - track.last_fit_s));
      if (scaled_distance < nearest) {
        nearest = scaled_distance;
        best = &track;
      }
    }
    if (best == nullptr) {
      TrackerState::Track track;
      track.face.id = state_.next_id++;
      state_.tracks.push_back(std::move(track));
      best = &state_.tracks.back();
    }
    best->filter.reset();
    if (!update_track(*best, fit)) best->lost = true;
  }

  [[nodiscard]] bool is_tracked(const cv::Rect2d& box) const {
    return std::any_of(state_.tracks.begin(), state_.tracks.end(),
                       [&](const TrackerState::Track& track) {
                         return !track.lost && overlap_of_smaller(track.face.box, box) > 0.4;
                       });
  }

  [[nodiscard]] int count_tracked() const {
    return static_cast<int>(
        std::count_if(state_.tracks.begin(), state_.tracks.end(),
                      [](const TrackerState::Track& track) { return !track.lost; }));
  }

  // Two tracks on one face: keep the better one; of equals the older.
  void drop_duplicates() {
    for (std::size_t a = 0; a < state_.tracks.size(); ++a) {
      for (std::size_t b = a + 1; b < state_.tracks.size(); ++b) {
        TrackerState::Track& first = state_.tracks[a];
        TrackerState::Track& second = state_.tracks[b];
        if (first.lost || second.lost || overlap_of_smaller(first.face.box, second.face.box) < 0.6)
          continue;
        (second.face.score > first.face.score + 0.2 ? first : second).lost = true;
      }
    }
  }

  const LandmarkModel& model_;
  const FitOptions& fit_;
  const TrackerOptions& options_;
  FaceFinder& finder_;
  TrackerState& state_;
  const cv::Mat& gray_;
  double dt_;
  FitWorkspace& workspace_;
  DebugSink* debug_;
};

}  // namespace

void TrackerOptions::check() const {
  check_fields(*this);
  filter.check();
}

std::vector<TrackedFace> track_faces(const LandmarkModel& model, const FitOptions& fit,
                                     const TrackerOptions& options, FaceFinder& finder,
                                     TrackerState& state, const cv::Mat& gray, double time,
                                     FitWorkspace& workspace, DebugSink* debug) {
  require_gray(gray);
  constexpr double kDefaultStep = 1.0 / 25;
  const double passed = time - state.time;
  const double dt = state.started && passed > 0 && passed < 1 ? passed : kDefaultStep;
  state.time = state.started && passed <= 0 ? state.time + kDefaultStep : time;
  state.started = true;

  Step step(model, fit, options, finder, state, gray, dt, workspace, debug);
  step.track_known_faces();
  step.search();
  step.erase_old_tracks();
  std::vector<TrackedFace> faces;
  for (const TrackerState::Track& track : state.tracks) {
    if (!track.lost) faces.push_back(track.face);
  }
  std::sort(faces.begin(), faces.end(),
            [](const TrackedFace& a, const TrackedFace& b) { return a.id < b.id; });
  return faces;
}

void redetect(TrackerState& state) {
  for (TrackerState::Track& track : state.tracks) track.lost = true;
  state.until_search = 0;
  state.searched = false;
}

}  // namespace tarsier::face::landmarks
