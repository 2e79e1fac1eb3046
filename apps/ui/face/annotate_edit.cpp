// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "ui/face/annotate_session.h"
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <system_error>

namespace tarsier {
namespace {

namespace fs = std::filesystem;
using Eigen::Matrix2Xd;

constexpr std::size_t kMaxUndo = 1000;

std::string absolute(const std::string& path) {
  std::error_code error;
  const fs::path result = fs::absolute(path, error);
  return error ? path : result.lexically_normal().string();
}

int count_known(const Matrix2Xd& points) {
  int count = 0;
  for (Eigen::Index i = 0; i < points.cols(); ++i) count += points.col(i).hasNaN() ? 0 : 1;
  return count;
}

}  // namespace

std::string AnnotateSession::frames_folder() const {
  const fs::path set(options_.set_path);
  return (set.parent_path() / (set.stem().string() + "-frames")).string();
}

void AnnotateSession::load() {
  options_.set_path = absolute(options_.set_path);
  const std::vector<nlohmann::json> records = journal_.open();
  std::error_code error;
  const bool is_new = !fs::exists(options_.set_path, error);
  for (const std::string& image : options_.images) state_.add_image(absolute(image));
  if (options_.video && fs::is_directory(frames_folder(), error)) {
    std::vector<std::string> picked;
    for (const auto& entry : fs::directory_iterator(frames_folder(), error))
      if (entry.path().extension() == ".png") picked.push_back(entry.path().string());
    std::sort(picked.begin(), picked.end());
    for (const std::string& image : picked) state_.add_image(image);
  }
  if (!is_new) {
    state_.load(face::shape::read_landmark_set(options_.set_path), options_.set_path);
  }
  const std::string journal_path = options_.set_path + ".journal";
  const bool has_symmetry =
      std::any_of(state_.mirror().begin(), state_.mirror().end(), [](int m) { return m >= 0; });
  if (options_.video && records.empty() && state_.images() == 0) {
    state_.set_stage(AnnotateStage::kPick);
  } else {
    state_.set_stage(state_.done() > 1 || has_symmetry || !state_.connections().empty()
                         ? AnnotateStage::kImages
                         : AnnotateStage::kPoints);
  }
  state_.replay(records, journal_path);
  if (!records.empty())
    message_ = fmt::format("Resumed where the last run stopped ({} {})", records.size(),
                           records.size() == 1 ? "step" : "steps");
  unsaved_ = static_cast<int>(records.size());
  int first = std::max(0, reference());
  if (state_.stage() == AnnotateStage::kImages) {
    for (int k = 0; k < state_.images(); ++k) {
      if (state_.image(k).done) continue;
      first = k;
      break;
    }
  }
  current_ = std::min(first, std::max(0, state_.images() - 1));
  open(current_);
}

// Returns false if the edit could not be stored and was not made.
bool AnnotateSession::journal(const AnnotateState& before, const std::string& why) {
  try {
    journal_.append(state_.difference(before, why));
  } catch (const OutputError& error) {
    message_ = fmt::format("Cannot save: {}", error.what());
    return false;
  }
  ++unsaved_;
  return true;
}

template <typename Change>
bool AnnotateSession::edit(const std::string& why, Change change, bool undoable) {
  AnnotateState before = state_;
  change(state_);
  if (!journal(before, why)) {
    state_ = std::move(before);
    estimate_positions();
    return false;
  }
  if (undoable) {
    before_.push_back(std::move(before));
    if (before_.size() > kMaxUndo) before_.erase(before_.begin());
    undone_.clear();
  }
  if (unsaved_ >= options_.save_every) {
    try {
      save();
    } catch (const OutputError& error) {  // the journal has all edits
      message_ = fmt::format("Cannot write the set: {}", error.what());
    }
  }
  estimate_positions();
  return true;
}

void AnnotateSession::undo(std::vector<AnnotateState>& from, std::vector<AnnotateState>& to,
                           const char* what) {
  if (from.empty()) {
    message_ = fmt::format("Nothing to {}", what);
    return;
  }
  AnnotateState before = state_;
  AnnotateState after = from.back();
  // Images added later stay, because their files exist.
  for (int k = after.images(); k < before.images(); ++k) after.add_image(before.image(k).path);
  int changed = -1;
  for (int k = 0; k < before.images(); ++k) {
    const AnnotatedImage& a = before.image(k);
    const AnnotatedImage& b = after.image(k);
    if (&a == &b) continue;
    // A proposal is not an edit: it stays if the edit was in another image.
    if (!a.done && !b.has_points() && a.points.cols() == after.points() && a.points.cols() > 0 &&
        !a.points.hasNaN()) {
      after.set_points(k, a.points);
      continue;
    }
    if (changed < 0 || k == current_) changed = k;
  }
  state_ = std::move(after);
  if (!journal(before, what)) {
    state_ = std::move(before);
    estimate_positions();
    return;
  }
  from.pop_back();
  to.push_back(std::move(before));
  selected_ = -1;
  if (state_.stage() == AnnotateStage::kPick) return;
  open(changed >= 0 ? changed : current_);
}

void AnnotateSession::save() {
  if (unsaved_ == 0) return;
  const face::shape::LandmarkSet set = state_.finished();
  if (!set.samples.empty()) face::shape::write_landmark_set(options_.set_path, set, "");
  journal_.restart(state_.unfinished());
  unsaved_ = 0;
}

void AnnotateSession::finish() {
  save();
  const nlohmann::json rest = state_.unfinished();
  const bool is_all_in_set = rest.at("images").empty() && !rest.contains("mirror") &&
                             (state_.stage() == AnnotateStage::kImages || state_.done() == 0);
  if (is_all_in_set) journal_.restart(std::nullopt);
}

int AnnotateSession::nearest_done(int image) const {
  int best = -1;
  for (int k = 0; k < state_.images(); ++k) {
    if (!state_.image(k).done || k == image) continue;
    if (best < 0 || std::abs(k - image) <= std::abs(best - image)) best = k;
  }
  return best;
}

int AnnotateSession::reference() const {
  for (int k = 0; k < state_.images(); ++k)
    if (state_.image(k).done) return k;
  return state_.images() > 0 ? 0 : -1;
}

void AnnotateSession::open(int image) {
  is_learning_ = false;
  drag_ = Drag::kNone;
  if (state_.images() == 0) {
    image_.release();
    positions_.resize(2, 0);
    return;
  }
  current_ = std::clamp(image, 0, state_.images() - 1);
  read_error_.clear();
  const AnnotatedImage& here = state_.image(current_);
  try {
    image_ = read_image(here.path);
  } catch (const InputError& error) {
    image_.release();
    read_error_ = error.what();
  }
  estimate_positions();
  // A proposal that nobody changed is replaced by a better one.
  const auto learned = done_at_proposal_.find(here.path);
  const bool is_stale = !here.done && !here.touched &&
                        (!here.has_points() || learned == done_at_proposal_.end() ||
                         learned->second != state_.done());
  is_learning_ = state_.stage() == AnnotateStage::kImages && is_stale && !image_.empty() &&
                 state_.points() > 0 && nearest_done(current_) >= 0;
}

std::optional<Matrix2Xd> AnnotateSession::proposal() {
  if (!propose_ || !is_proposing_) return std::nullopt;
  face::ProposalRequest request;
  cv::cvtColor(image_, request.gray, cv::COLOR_BGR2GRAY);
  const int near = nearest_done(current_);
  for (int k = 0; k < state_.images(); ++k) {
    if (!state_.image(k).done || k == current_) continue;
    if (k == near) request.nearest = static_cast<int>(request.annotated.samples.size());
    face::shape::LandmarkSample sample;
    sample.image = state_.image(k).path;
    sample.points = state_.image(k).points;
    for (int i = 0; i < state_.points(); ++i)
      if (!state_.image(k).is_shown(i)) sample.points.col(i).setConstant(std::nan(""));
    request.annotated.samples.push_back(std::move(sample));
  }
  std::optional<Matrix2Xd> points = propose_(request);
  if (points && (points->cols() != state_.points() || !points->allFinite())) points.reset();
  return points;
}

void AnnotateSession::propose_now() {
  is_learning_ = false;
  const int near = nearest_done(current_);
  if (image_.empty() || near < 0) return;
  done_at_proposal_[state_.image(current_).path] = state_.done();
  std::optional<Matrix2Xd> points;
  try {
    points = proposal();
  } catch (const Error& error) {
    log_debug("no proposal: {}", error.what());
  }
  const bool is_guess = points.has_value();
  if (!points) {
    // A start for dragging: the positions in the nearest finished image, clamped to this one.
    points = state_.image(near).points;
    for (Eigen::Index i = 0; i < points->cols(); ++i) {
      if (points->col(i).hasNaN()) points->col(i) << 0.5 * image_.cols, 0.5 * image_.rows;
    }
    const Eigen::Vector2d high = points->rowwise().maxCoeff();
    const double shrink = std::min({1.0, (image_.cols - 1) / std::max(1.0, high.x()),
                                    (image_.rows - 1) / std::max(1.0, high.y())});
    *points *= shrink;
    if (message_.empty())
      message_ = "Drag the points into place (shift: all; [ ] scale; < > rotate)";
  }
  // Points outside the image could not be reached.
  points->row(0) = points->row(0).cwiseMax(0).cwiseMin(image_.cols - 1);
  points->row(1) = points->row(1).cwiseMax(0).cwiseMin(image_.rows - 1);
  (void)edit(
      is_guess ? "proposal" : "start",
      [&](AnnotateState& state) { state.set_points(current_, *points); }, false);
}

void AnnotateSession::estimate_positions() {
  if (state_.images() == 0) {
    positions_.resize(2, 0);
    return;
  }
  current_ = std::min(current_, state_.images() - 1);
  const AnnotatedImage& here = state_.image(current_);
  positions_ = here.points;
  if (selected_ >= state_.points()) selected_ = -1;
  if (!here.has_points() || count_known(positions_) < 2 ||
      count_known(positions_) == static_cast<int>(positions_.cols()))
    return;
  const int near = nearest_done(current_);
  if (near < 0) return;
  const Matrix2Xd& other = state_.image(near).points;
  try {
    const Matrix2Xd guess = face::shape::fit_similarity(other, positions_)(other);
    for (Eigen::Index i = 0; i < positions_.cols(); ++i)
      if (positions_.col(i).hasNaN()) positions_.col(i) = guess.col(i);
  } catch (const std::invalid_argument&) {  // too few points in common
  }
}

// --- edits that a person makes ---

void AnnotateSession::pick() {
  if (frame_.image.empty()) {
    message_ = "No frame yet";
    return;
  }
  const std::string path =
      (fs::path(frames_folder()) / fmt::format("frame-{:06}.png", frame_.index)).string();
  if (state_.find(path) >= 0) {
    message_ = "This frame is already picked";
    return;
  }
  std::error_code error;
  fs::create_directories(frames_folder(), error);
  try {
    write_image(path, frame_.image);
  } catch (const OutputError& save_error) {
    message_ = fmt::format("Cannot save: {}", save_error.what());
    return;
  }
  if (edit(
          "pick", [&](AnnotateState& state) { state.add_image(path); }, false))
    message_ =
        fmt::format("Picked: {} {}", state_.images(), state_.images() == 1 ? "image" : "images");
}

void AnnotateSession::accept() {
  if (state_.images() == 0 || state_.points() == 0) return;
  const AnnotatedImage& here = state_.image(current_);
  if (!here.done && here.has_points()) {
    if (!edit("agree", [&](AnnotateState& state) { state.set_done(current_, true); })) return;
  }
  selected_ = -1;
  for (int k = 1; k <= state_.images(); ++k) {
    const int next = (current_ + k) % state_.images();
    if (state_.image(next).done) continue;
    open(next);
    return;
  }
  message_ = "All images are done. q: quit";
}

void AnnotateSession::change_image(int direction) {
  if (state_.images() == 0 || state_.stage() == AnnotateStage::kPick) return;
  const AnnotatedImage& here = state_.image(current_);
  if (state_.stage() == AnnotateStage::kImages && !here.done && here.touched) {
    // A person who corrected points has checked them.
    if (!edit("agree", [&](AnnotateState& state) { state.set_done(current_, true); })) return;
  }
  if (state_.stage() != AnnotateStage::kImages) {
    message_ = "First finish points, lines and symmetry (5: skip to the images)";
    return;
  }
  selected_ = -1;
  open((current_ + direction + state_.images()) % state_.images());
}

void AnnotateSession::on_left_up() {
  is_left_down_ = false;
  const Drag drag = std::exchange(drag_, Drag::kNone);
  if (drag != Drag::kPoint && drag != Drag::kAll) return;
  if (state_.images() == 0 || positions_.cols() != drag_start_.cols()) return;
  const Matrix2Xd now = positions_;
  if (drag == Drag::kPoint) {
    if (selected_ < 0 || now.col(selected_) == drag_start_.col(selected_)) return;
    (void)edit(fmt::format("move {}", selected_), [&](AnnotateState& state) {
      state.move_point(current_, selected_, now.col(selected_));
    });
    return;
  }
  Matrix2Xd points = state_.image(current_).points;
  for (Eigen::Index i = 0; i < points.cols(); ++i)
    if (!points.col(i).hasNaN()) points.col(i) = now.col(i);
  if (now == drag_start_ || points.hasNaN()) {
    estimate_positions();
    return;
  }
  (void)edit("move all", [&](AnnotateState& state) { state.set_points(current_, points, true); });
}

void AnnotateSession::transform_all(double factor, double angle) {
  if (state_.images() == 0 || state_.points() == 0) return;
  Matrix2Xd points = state_.image(current_).points;
  if (points.hasNaN() || state_.stage() != AnnotateStage::kImages) return;
  const Eigen::Vector2d center = points.rowwise().mean();
  const double sign = mirrored_ ? -1 : 1;
  const face::shape::Similarity2d turn{factor * std::cos(angle), sign * factor * std::sin(angle), 0,
                                       0};
  points = turn(Matrix2Xd(points.colwise() - center)).colwise() + center;
  (void)edit("size and turn",
             [&](AnnotateState& state) { state.set_points(current_, points, true); });
}

void AnnotateSession::nudge(double dx, double dy) {
  if (selected_ < 0 || selected_ >= positions_.cols() || positions_.col(selected_).hasNaN()) return;
  const Eigen::Vector2d position =
      positions_.col(selected_) + Eigen::Vector2d(mirrored_ ? -dx : dx, dy);
  (void)edit(fmt::format("nudge {}", selected_),
             [&](AnnotateState& state) { state.move_point(current_, selected_, position); });
}

void AnnotateSession::remove_selected() {
  if (selected_ < 0) {
    message_ = "Select a point first: click it";
    return;
  }
  if (state_.stage() == AnnotateStage::kImages && current_ != reference()) {
    hide_selected();
    return;
  }
  const int point = selected_;
  selected_ = -1;
  if (edit(fmt::format("delete {}", point),
           [&](AnnotateState& state) { state.remove_point(point); }))
    message_ = fmt::format("Point {} deleted from all images (u: undo)", point);
}

void AnnotateSession::hide_selected() {
  if (selected_ < 0) {
    message_ = "Select a point first: click it";
    return;
  }
  const bool hide = state_.image(current_).is_shown(selected_);
  const Eigen::Vector2d position = positions_.col(selected_);
  (void)edit(fmt::format("{} {}", hide ? "hide" : "show", selected_), [&](AnnotateState& state) {
    if (hide || position.hasNaN()) {
      state.hide_point(current_, selected_, hide);
    } else {
      state.move_point(current_, selected_, position);
    }
  });
}

void AnnotateSession::on_left_down(cv::Point2d in_view, bool shift) {
  if (is_left_down_ || state_.stage() == AnnotateStage::kPick || image_.empty()) return;
  is_left_down_ = true;
  const cv::Point2d position = to_image(in_view);
  const int near = point_near(in_view);
  if (state_.stage() == AnnotateStage::kConnections || state_.stage() == AnnotateStage::kSymmetry) {
    click_pair(near, shift);
    return;
  }
  drag_origin_ = position;
  drag_start_ = positions_;
  if (shift && state_.stage() == AnnotateStage::kImages && positions_.cols() > 0) {
    drag_ = Drag::kAll;
    return;
  }
  if (near >= 0) {
    selected_ = near;
    drag_ = Drag::kPoint;
    return;
  }
  selected_ = -1;
  const bool is_inside = position.x >= -0.5 && position.y >= -0.5 &&
                         position.x <= image_.cols - 0.5 && position.y <= image_.rows - 0.5;
  if (state_.stage() != AnnotateStage::kPoints || !is_inside) return;
  if (edit("add", [&](AnnotateState& state) {
        state.add_point(current_, {position.x, position.y});
      }))
    selected_ = -1;
}

void AnnotateSession::click_pair(int point, bool chain) {
  if (point < 0) {
    selected_ = -1;
    return;
  }
  if (selected_ < 0) {
    selected_ = point;
    return;
  }
  const int first = selected_;
  selected_ = chain ? point : -1;
  if (state_.stage() == AnnotateStage::kSymmetry) {
    (void)edit(fmt::format("mirror {} {}", first, point),
               [&](AnnotateState& state) { state.toggle_mirror(first, point); });
  } else if (first != point) {
    (void)edit(fmt::format("connect {} {}", first, point),
               [&](AnnotateState& state) { state.toggle_connection(first, point); });
  }
}

void AnnotateSession::set_stage(AnnotateStage stage) {
  if (stage == state_.stage()) return;
  if (stage == AnnotateStage::kPick && !options_.video) {
    message_ = "Only videos have frames to pick";
    return;
  }
  if (stage != AnnotateStage::kPick && state_.images() == 0) {
    message_ = "Pick a frame first (s)";
    return;
  }
  if (stage > AnnotateStage::kPoints && state_.points() == 0) {
    message_ = "Click the points first";
    return;
  }
  selected_ = -1;
  (void)edit(
      fmt::format("stage {}", name_of(stage)),
      [&](AnnotateState& state) { state.set_stage(stage); }, false);
  if (stage == AnnotateStage::kPick) return;
  open(stage == AnnotateStage::kImages ? current_ : std::max(0, reference()));
  if (stage == AnnotateStage::kImages && state_.done() < state_.images() &&
      state_.image(current_).done)
    accept();
}

void AnnotateSession::act(const std::string& name) {
  const AnnotateStage stage = state_.stage();
  if (name == "pick" && stage == AnnotateStage::kPick) pick();
  if (name == "go-on") {
    if (stage == AnnotateStage::kImages) {
      accept();
    } else {
      set_stage(static_cast<AnnotateStage>(static_cast<int>(stage) + 1));
    }
  }
  if (name == "next") change_image(1);
  if (name == "previous") change_image(-1);
  if (name == "undo") undo(before_, undone_, "undo");
  if (name == "redo") undo(undone_, before_, "redo");
  if (name == "delete") remove_selected();
  if (name == "hide") hide_selected();
  if (name == "larger") transform_all(1.02, 0);
  if (name == "smaller") transform_all(1 / 1.02, 0);
  if (name == "turn-left") transform_all(1, -0.02);
  if (name == "turn-right") transform_all(1, 0.02);
  if (name == "stage-pick") set_stage(AnnotateStage::kPick);
  if (name == "stage-points") set_stage(AnnotateStage::kPoints);
  if (name == "stage-connections") set_stage(AnnotateStage::kConnections);
  if (name == "stage-symmetry") set_stage(AnnotateStage::kSymmetry);
  if (name == "stage-images") set_stage(AnnotateStage::kImages);
  if (name == "propose" && stage == AnnotateStage::kImages && state_.images() > 0 &&
      state_.done() - (state_.image(current_).done ? 1 : 0) > 0) {
    if (edit("propose again", [&](AnnotateState& state) { state.clear_points(current_); })) {
      selected_ = -1;
      open(current_);
    }
  }
}

}  // namespace tarsier
