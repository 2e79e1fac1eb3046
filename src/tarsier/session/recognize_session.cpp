// SPDX-License-Identifier: MIT
#include "tarsier/session/recognize_session.h"

#include "tarsier/core/log.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <utility>

namespace tarsier {
namespace {

const cv::Scalar kKnown{80, 220, 80};
const cv::Scalar kUnknown{190, 190, 190};

}  // namespace

void draw_named_face(cv::Mat& image, const face::NamedFace& face) {
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
  image::draw::TextStyle style;
  style.height_px = std::clamp(box.width * 0.09, 8.0, 30.0);
  style.color = color;
  style.backing = image::draw::Backing::kBox;
  const bool room = box.y > 2.4 * style.height_px;
  image::draw::put_text(image, text, {box.x, room ? box.y - 2 : box.br().y + 2}, style,
                        room ? image::draw::Anchor::kBottomLeft : image::draw::Anchor::kTopLeft);
}

RecognizeSession::RecognizeSession(face::Identifier identifier, face::IdentifierState state,
                                   DebugSink* debug)
    : identifier_(std::move(identifier)), state_(std::move(state)), debug_(debug) {}

View RecognizeSession::on_frame(const Frame& frame, const SourceStatus& source) {
  frame_ = frame.image;
  trouble_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  timer_.start();
  result_ = identifier_.process(frame, state_, debug_);
  timer_.stop();
  draw();
  return view(true);
}

View RecognizeSession::on_idle(const SourceStatus& source) {
  // Nor does the last frame of a source that stalls go on naming who was forgotten.
  if (state_.follow() && !frame_.empty()) {
    const face::recognition::Recognizer* model = state_.recognizer();
    for (face::NamedFace& face : result_.faces)
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
  for (const face::NamedFace& face : faces()) draw_named_face(output_, face);
}

View RecognizeSession::view(bool fresh) {
  View result;
  const auto known = std::count_if(faces().begin(), faces().end(),
                                   [](const face::NamedFace& face) { return face.name.known; });
  result.state = {{"faces", faces().size()}, {"known", known}, {"paused", paused_}};
  result.status =
      fmt::format("{} {}, {} known{}", faces().size(), faces().size() == 1 ? "face" : "faces",
                  known, paused_ ? ", paused" : "");
  result.finished = finished_;
  if (output_.empty()) return result;
  output_.copyTo(shown_);
  image::draw::status_bar(shown_, result.status,
                          trouble_.empty() ? timer_.words(true) + "   h: help" : trouble_);
  if (help_) draw_help(shown_, "People", actions());
  result.image = shown_;
  if (fresh) result.output = output_;
  return result;
}

}  // namespace tarsier
