// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/media/frame.h"
#include "tarsier/sfm/mapper/online.h"
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
  int grow_every = 3;  // key frames from one growth of the model to the next
  // That key frames are written to, see key_frame_path().
  std::string frames_folder;
  // Each frame is a key frame: those of a folder of images.
  bool every_frame = false;
  // With every_frame: files that are there already. A frame whose name is such a path is that image,
  // and is not written.
  std::vector<Input> images;

  [[nodiscard]] OptionFields fields() { return {{"grow_every", grow_every, range(1, 1000)}}; }
  void check() const;  // throws std::invalid_argument that names the value
};

// What is known after a frame.
struct OnlineResult {
  int key_frames = 0;
  int registered = 0;                // key frames in the model
  int points = 0;                    // of the model
  std::vector<cv::Point2f> tracked;  // points of the model where they are seen in this frame, px
  bool model_changed = false;        // by this call
  double growth_ms = 0;              // that the latest growth took, with the adding before it
};
// {"key_frames", "registered", "points", "followed": how many are tracked}
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
//   // online.model() is a quick one; of its key frames Reconstructor::run_images(online.inputs(),
//   // ..) makes the best one.
//
// Key frames (KeyframePicker) are written as files and added to the mapper (OnlineMapper); after
// every few the model grows. Points of the latest image of the model are tracked into each frame, by
// pyramidal Lucas-Kanade there and back.
//
// One video per object; one thread. A function of the frames alone.
class OnlineReconstructor {
 public:
  explicit OnlineReconstructor(const OnlineReconstructorOptions& options);  // throws as check()

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1, all of one size. Where `stop` fires, growth ends early
  // and the model is as it was. Throws OutputError (key frames, cache); a key frame that cannot be
  // read is left out with a warning. `debug`, which may be null, takes the stages: the corners by
  // whose motion key frames are chosen ("motion"), the features of the latest key frame
  // ("features"), its matches with the earlier one that has most ("matches"), and the points of the
  // model that are tracked into the frame ("tracks").
  [[nodiscard]] OnlineResult process(const Frame& frame, const std::stop_token& stop = {},
                                     DebugSink* debug = nullptr);
  // Adjusts all of the model, and looks for its points in the latest frame.
  [[nodiscard]] OnlineResult refine(const std::stop_token& stop = {});
  // No more frames: the video's last key frame; the model grows by what is waiting.
  [[nodiscard]] OnlineResult finish(const std::stop_token& stop = {});

  // The latest frame as the model has it, which result() is of: an image from a file has the pixels of the sensor, unturned.
  [[nodiscard]] const cv::Mat& image() const { return latest_.image; }
  [[nodiscard]] const Model& model() const { return mapper_.model(); }
  // The key frames so far, in order.
  [[nodiscard]] const std::vector<Input>& inputs() const { return inputs_; }

 private:
  // What was seen of the model in one of its images, and where it is now.
  struct Tracked {
    cv::Mat gray;  // reduced
    std::vector<cv::Point2f> from;
    std::vector<cv::Point2f> to;
    std::vector<char> is_lost;
  };

  // A key frame from which points can be tracked.
  struct Recent {
    int image = 0;     // of the mapper
    cv::Mat gray;      // reduced
    double scale = 1;  // from px of the whole image
  };

  void add(const Keyframe& key_frame, const Frame& latest, const std::stop_token& stop);
  [[nodiscard]] Input keep(const Keyframe& key_frame, const Frame& latest) const;
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
  std::map<std::string, Input> images_;  // by path
  std::vector<Input> inputs_;
  int waiting_ = 0;  // key frames since the last growth
  std::deque<Recent> recent_;
  Tracked tracked_;
  Frame latest_;
  cv::Mat gray_;  // of latest_, reduced
  bool model_changed_ = false;
};

}  // namespace tarsier::sfm
