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

// A drawn frame.
struct CartoonResult {
  // CV_8UC3, the size of the frame; with Mode::kNone the frame's own. The next frame is drawn into
  // the same buffer, unless somebody holds this image still.
  cv::Mat image;
  Mode mode = Mode::kNone;
  std::vector<cv::Rect> faces;  // px, whose skin was looked for (kAlien, kSmooth with kAuto)
  double ms = 0;                // spent in process(), milliseconds
};

// {"mode", "ms", "faces": [[x, y, width, height]..]}: the line of `tarsier cartoon run --json`
// without the image's name.
[[nodiscard]] nlohmann::ordered_json to_json(const CartoonResult& result);

// What is known from earlier frames of a video, and buffers: one for each stream of frames.
struct CartoonizerState {
  CartoonState drawing;
  std::optional<double> time;  // of the latest frame
  std::int64_t index = 0;
};

// Draws images and videos as cartoons:
//
//   cartoon::CartoonOptions options;
//   options.mode = cartoon::Mode::kSketch;
//   const auto cartoonizer = cartoon::Cartoonizer::load(ModelStore::find(), options);
//   cartoon::CartoonizerState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     write_image("sketch.png", cartoonizer.process(*frame, state).image);
//
// process() is const: any number of threads may use it, each with a state of its own.
class Cartoonizer {
 public:
  // Throws std::invalid_argument (options); ModelError where the mode looks for the skin of faces
  // that are found (FaceMode::kAuto) and there is no cascade: kFaceCascade of the store, or, where
  // it has none, of OpenCV (Debian's opencv-data).
  [[nodiscard]] static Cartoonizer load(const ModelStore& models,
                                        const CartoonOptions& options = {});
  static constexpr const char* kFaceCascade = "haarcascade_frontalface_alt2.xml";

  [[nodiscard]] const CartoonOptions& options() const { return options_; }
  // From the next frame on; states may be kept. Throws as load().
  void set_options(const CartoonOptions& options);

  // `frame.image`: CV_8UC3 (BGR), 16x16 or larger. A still is drawn for itself, and so is the first
  // frame of another video: one whose time is not after that of the frame before. The same frame
  // may come again, with other options. `debug` takes each stage, `timers` what each took; both may
  // be null. Throws InputError that names a frame that is too small, std::invalid_argument;
  // Interrupted as cartoonize().
  [[nodiscard]] CartoonResult process(const Frame& frame, CartoonizerState& state,
                                      DebugSink* debug = nullptr, Timers* timers = nullptr,
                                      const std::stop_token& stop = {}) const;

 private:
  Cartoonizer(const CartoonOptions& options, const std::string& cascade);

  std::string cascade_;  // of the store; empty: OpenCV's
  CartoonOptions options_;
};

}  // namespace tarsier::cartoon
