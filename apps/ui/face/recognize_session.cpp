// SPDX-License-Identifier: MIT
#include "ui/face/recognize_session.h"

#include "tarsier/core/log.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

const cv::Scalar kKnown{80, 220, 80};
const cv::Scalar kUnknown{190, 190, 190};

}  // namespace

void draw_named_face(cv::Mat& image, const face::IdentifiedFace& face, std::int64_t group) {
  const cv::Scalar color = face.identity.known ? kKnown : kUnknown;
  const int width = std::max(1, cvRound(std::min(image.cols, image.rows) / 300.0));
  const cv::Rect box(cvRound(face.face.box.x), cvRound(face.face.box.y),
                     cvRound(face.face.box.width), cvRound(face.face.box.height));
  cv::rectangle(image, box, color, width + 1, cv::LINE_AA);
  const int radius = std::max(2, cvRound(0.12 * face.face.eyes.distance()));
  for (const cv::Point2d& eye : {face.face.eyes.left, face.face.eyes.right})
    cv::circle(image, {cvRound(eye.x), cvRound(eye.y)}, radius, cv::Scalar(255, 200, 0), width,
               cv::LINE_AA);
  const std::string nobody = group > 0 ? fmt::format("group {}", group) : "unknown";
  std::string text = nobody;
  if (!face.identity.label.empty()) {
    const std::string shown = printable(face.identity.label).substr(0, 40);
    text = face.identity.known
               ? fmt::format("{} {:.0f} %", shown, 100 * face.identity.confidence)
               : fmt::format("{} ({} {:.0f} %)", nobody, shown, 100 * face.identity.confidence);
  }
  if (!face.face.trusted) text = "uncertain face: " + text;
  image::draw::TextStyle style;
  style.height_px = std::clamp(box.width * 0.09, 8.0, 30.0);
  style.color = color;
  style.backing = image::draw::Backing::kBox;
  const bool room = box.y > 2.4 * style.height_px;
  const int text_width =
      image::draw::text_size(text, style.height_px).width + cvRound(style.height_px);
  const int x = std::clamp(box.x, 0, std::max(0, image.cols - text_width));
  image::draw::put_text(image, text, {x, room ? box.y - 2 : box.br().y + 2}, style,
                        room ? image::draw::Anchor::kBottomLeft : image::draw::Anchor::kTopLeft);
}

RecognizeSession::RecognizeSession(face::Identifier identifier, face::IdentifierState state,
                                   DebugSink* debug)
    : FrameSession("People"),
      identifier_(std::move(identifier)),
      state_(std::move(state)),
      debug_(debug) {}

void RecognizeSession::process(const Frame& frame) {
  result_ = identifier_.process(frame, state_, watched(debug_));
}

bool RecognizeSession::idle() {
  // The last frame of a stalled source must not show the name of a forgotten person either.
  if (!state_.update()) return false;
  for (face::IdentifiedFace& face : result_.faces)
    if (!state_.is_enrolled(face.identity.label)) face.identity = {};
  return true;
}

void RecognizeSession::draw(cv::Mat& image) {
  for (const face::IdentifiedFace& face : faces()) draw_named_face(image, face);
}

nlohmann::json RecognizeSession::state() const {
  return {{"faces", faces().size()}, {"known", known()}};
}

std::string RecognizeSession::status() const {
  return fmt::format("{}, {} known", count_text(faces().size(), "face"), known());
}

std::ptrdiff_t RecognizeSession::known() const {
  return std::count_if(faces().begin(), faces().end(),
                       [](const face::IdentifiedFace& face) { return face.identity.known; });
}

}  // namespace tarsier
