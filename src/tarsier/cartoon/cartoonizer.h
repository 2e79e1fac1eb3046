// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/cartoonize.h"
#include "tarsier/cartoon/options.h"
#include "tarsier/core/debug_sink.h"
#include "tarsier/core/timer.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/model_store.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <vector>

namespace tarsier::cartoon {

// The cartoon of one frame.
struct CartoonResult {
  // CV_8UC3, of the frame's size. With Mode::kNone it is the frame's own image. The next frame
  // reuses the buffer unless the caller still holds this image.
  cv::Mat image;
  Mode mode = Mode::kNone;
  std::vector<cv::Rect> faces;  // px, faces whose skin was segmented (kAlien, kSmooth with kAuto)
  double ms = 0;                // time spent in process(), milliseconds
};

// {"mode", "ms", "faces": [[x, y, width, height]..]}: a line of `tarsier cartoon run --json`,
// without the image name.
[[nodiscard]] nlohmann::ordered_json to_json(const CartoonResult& result);

// State carried from frame to frame of a video, and buffers. Use one state for each stream of
// frames.
struct CartoonizerState {
  CartoonState drawing;
  std::optional<double> time;  // of the latest frame
  std::int64_t index = 0;
};

// Converts images and videos into cartoons:
//
//   cartoon::CartoonOptions options;
//   options.mode = cartoon::Mode::kSketch;
//   const auto cartoonizer = cartoon::Cartoonizer::load(ModelStore::find(), options);
//   cartoon::CartoonizerState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     write_image("sketch.png", cartoonizer.process(*frame, state).image);
//
// process() is const. Any number of threads may use it, each with its own state.
class Cartoonizer {
 public:
  // Throws std::invalid_argument (bad options). Throws ModelError if the mode needs to find faces
  // (FaceMode::kAuto) and there is no cascade: neither kFaceCascade in the store nor OpenCV's own
  // (Debian's opencv-data).
  [[nodiscard]] static Cartoonizer load(const ModelStore& models,
                                        const CartoonOptions& options = {});
  static constexpr const char* kFaceCascade = "haarcascade_frontalface_alt2.xml";

  [[nodiscard]] const CartoonOptions& options() const { return options_; }
  // Takes effect with the next frame; states stay valid. Throws the same exceptions as load().
  void set_options(const CartoonOptions& options);

  // `frame.image` is CV_8UC3 (BGR), at least 16x16. A still is drawn on its own. A frame whose time
  // is not later than that of the previous frame starts a new video. The same frame may be
  // processed again with other options. `debug` receives the image of each stage, and `timers` the
  // duration of each stage. Both may be null. Throws InputError, which names the frame, if it is
  // too small; std::invalid_argument; and Interrupted as cartoonize() does.
  [[nodiscard]] CartoonResult process(const Frame& frame, CartoonizerState& state,
                                      DebugSink* debug = nullptr, Timers* timers = nullptr,
                                      const std::stop_token& stop = {}) const;

 private:
  Cartoonizer(const CartoonOptions& options, std::string cascade);

  std::string cascade_;  // path in the store; empty means OpenCV's
  CartoonOptions options_;
};

}  // namespace tarsier::cartoon
