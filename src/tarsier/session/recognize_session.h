// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/gallery/model.h"
#include "tarsier/people_face/face_reader.h"
#include "tarsier/recognition/recognizer.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/session.h"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

struct RecognizeOptions {
  double false_accepts = 0.01;  // rate at which strangers may be taken for somebody, (0, 1)
  bool raw = false;             // pictures are cut faces already
  int most_pooled = 10;         // of a followed face so many last frames count together, >= 1
  DebugSink* debug = nullptr;   // takes the stages of a still's first face; outlives the session
  void check() const;
};

// A face of a frame with its name.
struct NamedFace {
  people::Face face;
  people::Recognition name;
};

// Names the faces it is shown. A still's faces stand for themselves; those of films are followed,
// and what their last frames look like counts together.
// Keys: space pauses, h help, q or Esc ends. State: {"faces", "known", "paused"}.
class RecognizeSession final : public Session {
 public:
  // `model`: nothing where nobody is enrolled.
  RecognizeSession(std::optional<recognition::Recognizer> model, people::FaceReader reader,
                   const RecognizeOptions& options);
  // Of a gallery: what other programs enrol and forget is known from the next frame on. `follower`
  // must outlive the session.
  RecognizeSession(people::GalleryFollower& follower, people::FaceReader reader,
                   const RecognizeOptions& options);

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const std::vector<NamedFace>& faces() const { return faces_; }
  [[nodiscard]] double milliseconds() const { return timer_.last_ms(); }

 private:
  [[nodiscard]] const recognition::Recognizer* recognizer() const;
  bool follow();
  void name(NamedFace& face);
  void draw();
  View view(bool fresh);

  std::optional<recognition::Recognizer> model_;
  people::GalleryFollower* follower_ = nullptr;
  people::FaceReader reader_;
  RecognizeOptions options_;
  std::map<int, std::vector<std::vector<float>>> tracks_;  // latest templates of followed faces
  std::vector<NamedFace> faces_;
  FrameTimer timer_;
  std::string source_name_;
  std::string trouble_;
  cv::Mat gray_;
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
  bool still_ = true;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

// A face that is followed has many chances to be taken for somebody: in each frame it gets this
// share of the stated rate of false accepts.
inline constexpr double kFollowedShare = 0.1;

// A frame round a face and its name: green and "Ann 97 %" for who is known, grey and "unknown (Ann
// 12 %)" else.
void draw_named_face(cv::Mat& image, const NamedFace& face);

}  // namespace tarsier
