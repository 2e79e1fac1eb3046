// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/online_reconstructor.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/lazy_opencv.h"
#include "tarsier/sfm/pipelines/inputs.h"
#include "tarsier/sfm/scene/sensor_image.h"

#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace tarsier::sfm {
namespace {

constexpr int kMaxTrackingSide_px = 960;         // px, of the images in which points are tracked
constexpr std::size_t kMaxRecentKeyFrames = 12;  // key frames from which points can be tracked
constexpr std::size_t kMaxTracked = 400;
// after tracking forward and backward
constexpr double kMaxForwardBackwardError_px = 1.0;

double reduction(cv::Size size) {
  return std::min(1.0,
                  static_cast<double>(kMaxTrackingSide_px) / std::max(size.width, size.height));
}

cv::Mat reduced_gray(const cv::Mat& image) {
  cv::Mat gray;
  if (image.channels() == 1) {
    gray = image.clone();
  } else {
    cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  }
  const double scale = reduction(image.size());
  if (scale < 1) cv::resize(gray, gray, {}, scale, scale, cv::INTER_AREA);
  return gray;
}

// The model uses the pixels of the sensor.
cv::Mat in_sensor_orientation(const Frame& image) {
  try {
    if (orientation_of_file(image.name) != 1) return read_sensor_image(image.name);
  } catch (const InputError&) {  // the file is gone; the image is left out when it is added
  }
  return image.image;
}

// --- debug images ---

const cv::Scalar kInModelColor{80, 220, 80};
const cv::Scalar kOtherColor{0, 170, 255};
const cv::Scalar kLostColor{60, 60, 235};
constexpr std::size_t kMaxShownMatches = 150;

cv::Mat colored(const cv::Mat& gray) {
  cv::Mat image;
  cv::cvtColor(gray, image, cv::COLOR_GRAY2BGR);
  return image;
}

// Draws each point with its motion.
void draw_tracks(cv::Mat& image, const std::vector<cv::Point2f>& from,
                 const std::vector<cv::Point2f>& to, const std::vector<char>& is_lost) {
  for (std::size_t k = 0; k < from.size(); ++k) {
    const bool lost = !is_lost.empty() && is_lost[k] != 0;
    if (lost) {
      cv::circle(image, from[k], 3, kLostColor, 1, cv::LINE_AA);
      continue;
    }
    cv::line(image, from[k], to[k], kOtherColor, 1, cv::LINE_AA);
    cv::circle(image, to[k], 2, kInModelColor, cv::FILLED, cv::LINE_AA);
  }
}

}  // namespace

void OnlineReconstructorOptions::check() const {
  check_fields(*this);
  mapper.check();
  keyframes.check();
  TARSIER_REQUIRE(images.empty() || every_frame,
                  "option 'images' needs 'every_frame': each image must become a key frame");
  TARSIER_REQUIRE(!frames_folder.empty() || !images.empty(),
                  "key frames need a folder (option 'frames_folder')");
}

nlohmann::ordered_json to_json(const OnlineResult& result) {
  nlohmann::ordered_json json = {{"key_frames", result.key_frames},
                                 {"registered", result.registered},
                                 {"points", result.points},
                                 {"followed", result.tracked.size()}};
  if (!result.no_model.empty()) json["no_model"] = result.no_model;
  return json;
}

OnlineReconstructor::OnlineReconstructor(const OnlineReconstructorOptions& options)
    : options_(options), mapper_(options.mapper), picker_(options.keyframes) {
  options_.check();
  for (const Input& image : options_.images) images_[image.path] = image;
}

OnlineResult OnlineReconstructor::process(const Frame& frame, const std::stop_token& stop,
                                          DebugSink* debug) {
  model_changed_ = false;
  latest_ = frame;
  if (images_.contains(frame.name)) latest_.image = in_sensor_orientation(frame);
  gray_ = reduced_gray(latest_.image);
  if (options_.every_frame) {
    add({latest_.image, frame.index, frame.time, 0, 0}, latest_, stop);
  } else if (const auto key_frame = picker_.offer(latest_.image, frame.index, frame.time)) {
    add(*key_frame, latest_, stop);
  }
  track_points();
  if (debug != nullptr) show_stages(*debug);
  return result();
}

OnlineResult OnlineReconstructor::refine(const std::stop_token& stop) {
  model_changed_ = false;
  if (!latest_.image.empty()) {
    grow(true, stop);
    track_points();
  }
  return result();
}

OnlineResult OnlineReconstructor::finish(const std::stop_token& stop) {
  model_changed_ = false;
  if (!options_.every_frame && !latest_.image.empty()) {
    if (const auto key_frame = picker_.finish()) add(*key_frame, latest_, stop);
  }
  if (pending_key_frames_ > 0) grow(false, stop);
  if (!latest_.image.empty()) track_points();
  return result();
}

Input OnlineReconstructor::save_key_frame(const Keyframe& key_frame, const Frame& latest) const {
  if (const auto image = images_.find(latest.name); image != images_.end()) return image->second;
  make_folder(options_.frames_folder);
  const std::string path = key_frame_path(options_.frames_folder, key_frame);
  write_image(path, key_frame.image);
  return {std::filesystem::path(path).filename().string(), path};
}

void OnlineReconstructor::add(const Keyframe& key_frame, const Frame& latest,
                              const std::stop_token& stop) {
  inputs_.push_back(save_key_frame(key_frame, latest));
  try {
    mapper_.add(inputs_.back(), stop);
  } catch (const Interrupted&) {
    return;
  } catch (const InputError& error) {  // one image of many
    log_warning("{} (left out)", error.what());
    return;
  }
  recent_.push_back(
      {mapper_.count() - 1, reduced_gray(key_frame.image), reduction(key_frame.image.size())});
  if (recent_.size() > kMaxRecentKeyFrames) recent_.pop_front();
  if (++pending_key_frames_ >= options_.grow_every) grow(false, stop);
}

void OnlineReconstructor::grow(bool adjust_all, const std::stop_token& stop) {
  try {
    if (adjust_all) {
      mapper_.refine(stop);
    } else {
      mapper_.grow(stop);
    }
  } catch (const Interrupted&) {
    return;  // the caller is ending
  }
  pending_key_frames_ = 0;
  model_changed_ = true;
  choose_points();
}

// Chooses the points to track: those of the model's latest image, evenly thinned.
void OnlineReconstructor::choose_points() {
  tracked_ = {};
  const Model& model = mapper_.model();
  for (auto entry = recent_.rbegin(); entry != recent_.rend(); ++entry) {
    if (at(entry->image) >= model.images.size()) continue;
    const Image& image = model.images[at(entry->image)];
    if (!image.registered) continue;
    const double scale =
        reduction({model.cameras[at(image.camera)].width, model.cameras[at(image.camera)].height});
    std::vector<cv::Point2f> model_points;
    for (std::size_t f = 0; f < image.points.size(); ++f)
      if (image.points[f] >= 0) model_points.push_back(image.features[f] * scale);
    const std::size_t step = std::max<std::size_t>(1, model_points.size() / kMaxTracked);
    for (std::size_t k = 0; k < model_points.size(); k += step)
      tracked_.from.push_back(model_points[k]);
    tracked_.gray = entry->gray;
    tracked_.to = tracked_.from;
    tracked_.is_lost.assign(tracked_.from.size(), 0);
    return;
  }
}

void OnlineReconstructor::track_points() {
  if (tracked_.from.empty() || tracked_.gray.size() != gray_.size()) {
    tracked_.from.clear();
    return;
  }
  const cv::Size window(21, 21);
  const cv::TermCriteria termination(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 20, 0.03);
  std::vector<cv::Point2f> back = tracked_.from;
  std::vector<std::uint8_t> forward_status;
  std::vector<std::uint8_t> backward_status;
  std::vector<float> error;
  lazy_opencv::optical_flow_pyr_lk(tracked_.gray, gray_, tracked_.from, tracked_.to, forward_status,
                                   error, window, 4, termination, cv::OPTFLOW_USE_INITIAL_FLOW);
  lazy_opencv::optical_flow_pyr_lk(gray_, tracked_.gray, tracked_.to, back, backward_status, error,
                                   window, 4, termination, cv::OPTFLOW_USE_INITIAL_FLOW);
  for (std::size_t k = 0; k < tracked_.from.size(); ++k) {
    const bool is_found = forward_status[k] != 0 && backward_status[k] != 0 &&
                          cv::norm(back[k] - tracked_.from[k]) <= kMaxForwardBackwardError_px;
    tracked_.is_lost[k] = is_found ? 0 : 1;
    if (!is_found) tracked_.to[k] = tracked_.from[k];  // start of its next search
  }
}

void OnlineReconstructor::show_stages(DebugSink& debug) const {
  if (!picker_.corners().empty()) {
    cv::Mat drawing = colored(gray_);
    draw_tracks(drawing, picker_.corners(), picker_.tracked_corners(), {});
    debug.image("motion", drawing);
  }
  if (!recent_.empty()) {
    show_features(debug);
    show_matches(debug);
  }
  if (!tracked_.from.empty()) {
    cv::Mat drawing = colored(gray_);
    draw_tracks(drawing, tracked_.from, tracked_.to, tracked_.is_lost);
    debug.image("tracks", drawing);
  }
}

// Draws points of the model in green.
void OnlineReconstructor::show_features(DebugSink& debug) const {
  const auto& [latest, gray, scale] = recent_.back();
  const Features& features = mapper_.features(latest);
  const std::vector<Image>& images = mapper_.model().images;
  const Image* image = at(latest) < images.size() ? &images[at(latest)] : nullptr;
  cv::Mat drawing = colored(gray);
  for (std::size_t f = 0; f < features.points.size(); ++f) {
    const bool is_point = image != nullptr && f < image->points.size() && image->points[f] >= 0;
    const int radius = std::clamp(cvRound(features.sizes[f] * scale / 2), 2, 30);
    cv::circle(drawing, features.points[f] * scale, radius, is_point ? kInModelColor : kOtherColor,
               1, cv::LINE_AA);
  }
  debug.image("features", drawing);
}

// Draws the earlier key frame on the left, the latest on the right.
void OnlineReconstructor::show_matches(DebugSink& debug) const {
  const RecentKeyFrame& latest = recent_.back();
  const Pair* best = nullptr;
  const RecentKeyFrame* earlier = nullptr;
  for (const Pair& pair : mapper_.pairs()) {
    if (pair.second != latest.image) continue;
    const auto entry =
        std::find_if(recent_.begin(), recent_.end(),
                     [&](const RecentKeyFrame& recent) { return recent.image == pair.first; });
    if (entry == recent_.end() || entry->gray.rows != latest.gray.rows) continue;
    if (best != nullptr && pair.view.inliers.size() <= best->view.inliers.size()) continue;
    best = &pair;
    earlier = &*entry;
  }
  if (best == nullptr) return;
  cv::Mat drawing;
  cv::hconcat(colored(earlier->gray), colored(latest.gray), drawing);
  const Features& first = mapper_.features(best->first);
  const Features& second = mapper_.features(best->second);
  const cv::Point2f right(static_cast<float>(earlier->gray.cols), 0);
  const MatchList& inliers = best->view.inliers;
  const std::size_t step = std::max<std::size_t>(1, inliers.size() / kMaxShownMatches);
  for (std::size_t k = 0; k < inliers.size(); k += step) {
    const cv::Point2f from = first.points[at(inliers[k].first)] * earlier->scale;
    const cv::Point2f to = second.points[at(inliers[k].second)] * latest.scale + right;
    cv::line(drawing, from, to, kOtherColor, 1, cv::LINE_AA);
    cv::circle(drawing, from, 2, kInModelColor, cv::FILLED, cv::LINE_AA);
    cv::circle(drawing, to, 2, kInModelColor, cv::FILLED, cv::LINE_AA);
  }
  debug.image("matches", drawing);
}

OnlineResult OnlineReconstructor::result() {
  OnlineResult result;
  result.key_frames = static_cast<int>(inputs_.size());
  result.registered = mapper_.registered();
  result.points = static_cast<int>(mapper_.model().points.size());
  result.no_model = mapper_.no_model_reason();
  const double from_reduced = latest_.image.empty() ? 1 : 1 / reduction(latest_.image.size());
  for (std::size_t k = 0; k < tracked_.from.size(); ++k)
    if (tracked_.is_lost[k] == 0) result.tracked.push_back(tracked_.to[k] * from_reduced);
  result.model_changed = model_changed_;
  result.growth_ms = 1000 * mapper_.seconds();
  return result;
}

}  // namespace tarsier::sfm
