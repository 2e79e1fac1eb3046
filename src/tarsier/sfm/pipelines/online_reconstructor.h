// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/media/frame.h"
#include "tarsier/sfm/pipelines/online.h"
#include "tarsier/sfm/scene/keyframes.h"

#include <opencv2/core.hpp>

#include <deque>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct OnlineReconstructorOptions {
  OnlineOptions mapper;
  KeyframeOptions keyframes;
  int grow_every = 3;  // key frames between two growth steps of the model
  // Folder that key frames are written to, see key_frame_path().
  std::string frames_folder;
  // Every frame is a key frame, e.g. the images of a folder.
  bool every_frame = false;
  // Only with every_frame: the existing image files. A frame whose name is the path of such a file
  // is that image and is not written again.
  std::vector<Input> images;

  [[nodiscard]] OptionFields fields() { return {{"grow_every", grow_every, range(1, 1000)}}; }
  void check() const;  // throws std::invalid_argument, which names the value
};

// The state after a frame.
struct OnlineResult {
  int key_frames = 0;
  int registered = 0;    // key frames in the model
  int points = 0;        // points of the model
  std::string no_model;  // why there is no model yet; "" where there is one or no reason is known
  std::vector<cv::Point2f> tracked;  // image positions of model points in this frame, px
  bool model_changed = false;        // whether this call changed the model
  double growth_ms = 0;              // of the latest growth, including the adding of its key frames
};
// {"key_frames", "registered", "points", "followed": number of tracked points, "no_model" unless
// empty}
[[nodiscard]] nlohmann::ordered_json to_json(const OnlineResult& result);

// A model that grows with the frames of a video or camera:
//
//   sfm::OnlineReconstructorOptions options;
//   options.frames_folder = "model/frames";
//   sfm::OnlineReconstructor online(options);
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, stop))
//     fmt::print("{} points\n", online.process(*frame, stop).points);
//   (void)online.finish(stop);
//   // online.model() is a fast approximation. Reconstructor::run_images(online.inputs(), ..)
//   // makes the most accurate model of the same key frames.
//
// Key frames (KeyframePicker) are written as files and added to the mapper (OnlineMapper). The
// model grows every few key frames. Points of the model's latest image are tracked into each frame
// by pyramidal Lucas-Kanade, forward and backward.
//
// An object handles one video, in one thread. The result depends on the frames alone.
class OnlineReconstructor {
 public:
  explicit OnlineReconstructor(const OnlineReconstructorOptions& options);  // throws as check()

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1; all frames have the same size. Where `stop` fires,
  // growth ends early and the model is unchanged. Throws OutputError (key frames, cache). A key
  // frame that cannot be read is left out with a warning. `debug` may be null. It receives the
  // stages:
  // - "motion": the corners whose motion decides about key frames,
  // - "features": the features of the latest key frame,
  // - "matches": its matches with the earlier key frame that has most of them,
  // - "tracks": the model points that are tracked into the frame.
  [[nodiscard]] OnlineResult process(const Frame& frame, const std::stop_token& stop = {},
                                     DebugSink* debug = nullptr);
  // Adjusts the whole model and tracks its points into the latest frame.
  [[nodiscard]] OnlineResult refine(const std::stop_token& stop = {});
  // Ends the video: takes its last key frame and grows the model by all waiting key frames.
  [[nodiscard]] OnlineResult finish(const std::stop_token& stop = {});

  // The latest frame, in whose pixels the result is. An image from a file has the pixels of the
  // sensor, not turned upright.
  [[nodiscard]] const cv::Mat& image() const { return latest_.image; }
  [[nodiscard]] const Model& model() const { return mapper_.model(); }
  // All key frames up to now, in order.
  [[nodiscard]] const std::vector<Input>& inputs() const { return inputs_; }

 private:
  // Points that the latest image of the model shows, and their positions in the latest frame.
  struct Tracked {
    cv::Mat gray;  // reduced
    std::vector<cv::Point2f> from;
    std::vector<cv::Point2f> to;
    std::vector<char> is_lost;
  };

  // A key frame whose points can be tracked.
  struct RecentKeyFrame {
    int image = 0;     // index in the mapper
    cv::Mat gray;      // reduced
    double scale = 1;  // reduced px per px of the full image
  };

  void add(const Keyframe& key_frame, const Frame& latest, const std::stop_token& stop);
  [[nodiscard]] Input save_key_frame(const Keyframe& key_frame, const Frame& latest) const;
  void grow(bool adjust_all, const std::stop_token& stop);
  void choose_points();
  void track_points();
  void show_stages(DebugSink& debug) const;
  void show_features(DebugSink& debug) const;
  void show_matches(DebugSink& debug) const;
  [[nodiscard]] OnlineResult result();

  OnlineReconstructorOptions options_;
  OnlineMapper mapper_;
  KeyframePicker picker_;
  std::map<std::string, Input> images_;  // by path of the file
  std::vector<Input> inputs_;
  int pending_key_frames_ = 0;  // key frames since the last growth
  std::deque<RecentKeyFrame> recent_;
  Tracked tracked_;
  Frame latest_;
  cv::Mat gray_;  // of latest_, reduced
  bool model_changed_ = false;
};

}  // namespace tarsier::sfm
