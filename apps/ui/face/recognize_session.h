// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/pipelines/identifier.h"

#include "ui/frame_session.h"
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace tarsier {

// Shows the names that a face::Identifier finds.
// Keys: space pauses, h help, q or Esc quits. State: {"faces", "known", "paused"}.
class RecognizeSession final : public FrameSession {
 public:
  // `debug` may be null and must outlive the session. It receives the stages of each frame's
  // largest face.
  RecognizeSession(face::Identifier identifier, face::IdentifierState state,
                   DebugSink* debug = nullptr);

  // The result of the latest frame.
  [[nodiscard]] const face::IdentifierResult& result() const { return result_; }
  [[nodiscard]] const std::vector<face::IdentifiedFace>& faces() const { return result_.faces; }
  [[nodiscard]] face::people::Gallery* gallery() const { return state_.gallery(); }

 private:
  void process(const Frame& frame) override;
  void draw(cv::Mat& image) override;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  bool idle() override;
  [[nodiscard]] std::ptrdiff_t known() const;  // number of known faces

  face::Identifier identifier_;
  face::IdentifierState state_;
  DebugSink* debug_;
  face::IdentifierResult result_;
};

// Draws a box around a face and its name: green and "Ann 97 %" for a known person; else grey and
// "unknown (Ann 12 %)", or "group 3 (Ann 12 %)" if the face is in a group of unknown faces (0:
// none).
void draw_named_face(cv::Mat& image, const face::IdentifiedFace& face, std::int64_t group = 0);

}  // namespace tarsier
