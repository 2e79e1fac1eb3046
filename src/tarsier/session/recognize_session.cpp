// SPDX-License-Identifier: MIT
#include "tarsier/session/recognize_session.h"

#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <set>
#include <utility>

namespace tarsier {
namespace {

const cv::Scalar kKnown{80, 220, 80};
const cv::Scalar kUnknown{190, 190, 190};

}  // namespace

void RecognizeOptions::check() const {
  TARSIER_REQUIRE(false_accepts > 0 && false_accepts < 1, "a rate of {}", false_accepts);
  TARSIER_REQUIRE(most_pooled >= 1 && most_pooled <= 1000, "{} frames", most_pooled);
}

void draw_named_face(cv::Mat& image, const NamedFace& face) {
  const cv::Scalar color = face.name.known ? kKnown : kUnknown;
  const int width = std::max(1, cvRound(std::min(image.cols, image.rows) / 300.0));
  const cv::Rect box(cvRound(face.face.box.x), cvRound(face.face.box.y),
                     cvRound(face.face.box.width), cvRound(face.face.box.height));
  cv::rectangle(image, box, color, width + 1, cv::LINE_AA);
  const int radius = std::max(2, cvRound(0.12 * face.face.eyes.distance()));
  for (const cv::Point2d& eye : {face.face.eyes.left, face.face.eyes.right})
    cv::circle(image, {cvRound(eye.x), cvRound(eye.y)}, radius, cv::Scalar(255, 200, 0), width,
               cv::LINE_AA);
  std::string text = "unknown";
  if (!face.name.label.empty()) {
    const std::string shown = printable(face.name.label).substr(0, 40);
    text = face.name.known
               ? fmt::format("{} {:.0f} %", shown, 100 * face.name.confidence)
               : fmt::format("unknown ({} {:.0f} %)", shown, 100 * face.name.confidence);
  }
  draw::TextStyle style;
  style.height_px = std::clamp(box.width * 0.09, 8.0, 30.0);
  style.color = color;
  style.backing = draw::Backing::kBox;
  const bool room = box.y > 2.4 * style.height_px;
  draw::put_text(image, text, {box.x, room ? box.y - 2 : box.br().y + 2}, style,
                 room ? draw::Anchor::kBottomLeft : draw::Anchor::kTopLeft);
}

RecognizeSession::RecognizeSession(std::optional<recognition::Recognizer> model,
                                   people::FaceReader reader, const RecognizeOptions& options)
    : model_(std::move(model)), reader_(std::move(reader)), options_(options) {
  options_.check();
}

RecognizeSession::RecognizeSession(people::GalleryFollower& follower, people::FaceReader reader,
                                   const RecognizeOptions& options)
    : follower_(&follower), reader_(std::move(reader)), options_(options) {
  options_.check();
}

const recognition::Recognizer* RecognizeSession::recognizer() const {
  if (follower_ != nullptr) return follower_->recognizer();
  return model_ ? &*model_ : nullptr;
}

// Whether the gallery changed.
bool RecognizeSession::follow() {
  if (follower_ == nullptr) return false;
  const people::GalleryFollower::Change change = follower_->update();
  if (change == people::GalleryFollower::Change::kModel) tracks_.clear();
  return change != people::GalleryFollower::Change::kNone;
}

void RecognizeSession::name(NamedFace& face) {
  const recognition::Recognizer* model = recognizer();
  if (model == nullptr) return;
  std::vector<float> features = recognition::template_of(
      *model, options_.raw ? face.face.crop
                           : people::recognizer_input(model->options.algorithm, face.face.crop));
  if (face.face.id > 0 && !still_) {
    auto& latest = tracks_[face.face.id];
    latest.push_back(features);
    if (latest.size() > static_cast<std::size_t>(options_.most_pooled))
      latest.erase(latest.begin());
    features = recognition::pooled(*model, latest);
  }
  const double share = face.face.id > 0 && !still_ ? kFollowedShare : 1;
  face.name = people::recognize(*model, features, share * options_.false_accepts);
}

View RecognizeSession::on_frame(const Frame& frame, const SourceStatus& source) {
  if (frame.still || frame.name != source_name_) {
    tracks_.clear();
    reader_.restart();
  }
  (void)follow();
  frame_ = frame.image;
  still_ = frame.still;
  source_name_ = frame.name;
  trouble_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  timer_.start();
  cv::cvtColor(frame.image, gray_, cv::COLOR_BGR2GRAY);
  faces_.clear();
  if (options_.raw) {
    NamedFace whole;
    whole.face.crop = gray_;
    whole.face.box = {0, 0, static_cast<double>(gray_.cols), static_cast<double>(gray_.rows)};
    faces_.push_back(std::move(whole));
  } else {
    for (people::Face& face :
         still_ ? reader_.read(gray_, options_.debug) : reader_.follow(gray_, frame.time))
      faces_.push_back({std::move(face), {}});
  }
  std::set<int> seen;
  for (NamedFace& face : faces_) {
    name(face);
    seen.insert(face.face.id);
  }
  std::erase_if(tracks_, [&](const auto& track) { return !seen.contains(track.first); });
  timer_.stop();
  draw();
  return view(true);
}

View RecognizeSession::on_idle(const SourceStatus& source) {
  // Nor does the last frame of a source that stalls go on naming who was forgotten.
  if (follow() && !frame_.empty()) {
    const recognition::Recognizer* model = recognizer();
    for (NamedFace& face : faces_)
      if (model == nullptr || std::find(model->labels.begin(), model->labels.end(),
                                        face.name.label) == model->labels.end())
        face.name = {};
    draw();
  }
  trouble_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  return view(false);
}

View RecognizeSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  if (name == "quit") finished_ = true;
  if (name == "pause") paused_ = !paused_;
  if (name == "help") help_ = !help_;
  return view(false);
}

std::vector<Action> RecognizeSession::actions() const {
  return {
      {"pause", "pause and go on", key::kSpace}, {"help", "this list", 'h'}, {"quit", "end", 'q'}};
}

void RecognizeSession::draw() {
  frame_.copyTo(output_);
  for (const NamedFace& face : faces_) draw_named_face(output_, face);
}

View RecognizeSession::view(bool fresh) {
  View result;
  const auto known = std::count_if(faces_.begin(), faces_.end(),
                                   [](const NamedFace& face) { return face.name.known; });
  result.state = {{"faces", faces_.size()}, {"known", known}, {"paused", paused_}};
  result.status =
      fmt::format("{} {}, {} known{}", faces_.size(), faces_.size() == 1 ? "face" : "faces", known,
                  paused_ ? ", paused" : "");
  result.finished = finished_;
  if (output_.empty()) return result;
  output_.copyTo(shown_);
  draw::status_bar(shown_, result.status,
                   trouble_.empty() ? timer_.words(true) + "   h: help" : trouble_);
  if (help_) draw_help(shown_, "People", actions());
  result.image = shown_;
  if (fresh) result.output = output_;
  return result;
}

}  // namespace tarsier
