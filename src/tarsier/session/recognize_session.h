// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/pipelines/identifier.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/session.h"

#include <string>
#include <vector>

namespace tarsier {

// Shows the names that a face::Identifier finds.
// Keys: space pauses, h help, q or Esc ends. State: {"faces", "known", "paused"}.
class RecognizeSession final : public Session {
 public:
  // `debug`, which may be null and must outlive the session, takes the stages of a still's first
  // face.
  RecognizeSession(face::Identifier identifier, face::IdentifierState state,
                   DebugSink* debug = nullptr);

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const face::IdentifierResult& result() const { return result_; }
  [[nodiscard]] const std::vector<face::NamedFace>& faces() const { return result_.faces; }
  [[nodiscard]] face::people::Gallery* gallery() const { return state_.gallery(); }

 private:
  void draw();
  View view(bool fresh);

  face::Identifier identifier_;
  face::IdentifierState state_;
  DebugSink* debug_;
  face::IdentifierResult result_;
  FrameTimer timer_;
  std::string trouble_;
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

// A frame round a face and its name: green and "Ann 97 %" for who is known, grey and "unknown (Ann
// 12 %)" else.
void draw_named_face(cv::Mat& image, const face::NamedFace& face);

}  // namespace tarsier
