// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/pipelines/annotator.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "ui/controls.h"
#include "ui/face/annotate_state.h"
#include "ui/session.h"
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

struct AnnotateOptions {
  std::string set_path;             // file of type landmark-set; may exist
  std::vector<std::string> images;  // to annotate, in this order, in addition to those of the set
  // Frames come through on_frame(). Picked frames become images: PNG files in the folder <set's
  // name without ending>-frames.
  bool video = false;
  cv::Size canvas{1024, 700};  // px, of the view
  int save_every = 50;         // edits between two writes of the set

  [[nodiscard]] OptionFields fields() {
    return {{"canvas.width", canvas.width, range(320, 4096)},
            {"canvas.height", canvas.height, range(320, 4096)},
            {"save_every", save_every, range(1, 10000)}};
  }
  void check() const;
};

// Proposes the points of an image (2 x n, px, all finite), or nullopt; see face::Annotator.
using PointProposer =
    std::function<std::optional<Eigen::Matrix2Xd>(const face::ProposalRequest& request)>;

// Annotates points on images. The steps: pick frames (video); click the points on the first image;
// lines between points; pairs of mirrored points; then place the points on all other images, where
// the model trained on the finished images proposes them.
//
// Each edit is on the disk (the journal, <set>.journal) before it is shown; a new session continues
// where a killed one stopped. The set itself is written every few edits and by finish(). State:
// {"stage", "image", "images", "done", "points", "shown", "places": [[x, y] px of the image, or
// null if a point is hidden or not placed], "selected", "agreed", "learning", "path", "zoom",
// "view": [x, y of the first visible pixel of the image, view pixels per image pixel], "frame",
// "paused", "help", "message"}.
class AnnotateSession final : public Session {
 public:
  // `propose` may be empty. Throws InputError if the set or the journal is corrupt or another
  // program has the set open, OutputError if the set's folder is not writable.
  AnnotateSession(const AnnotateOptions& options, PointProposer propose);

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // The current view.
  View current_view() { return view(); }

  // Whether the host should pass the video's next frame; `at_once`: ignoring the video's speed.
  [[nodiscard]] bool wants_frame() const;
  [[nodiscard]] bool at_once() const { return steps_ > 0 || skip_to_ >= 0; }
  // Tells the session that there are no more frames.
  void video_ended();
  // The next on_idle() or on_event() will compute a proposal, which may take seconds.
  [[nodiscard]] bool is_learning() const { return is_learning_; }

  // Writes the set; data that it cannot hold stays in the journal. Throws OutputError.
  void finish();

  [[nodiscard]] const AnnotateState& state() const { return state_; }
  [[nodiscard]] int current() const { return current_; }
  // Converts a pixel of the image to a pixel of the view.
  [[nodiscard]] cv::Point2d to_view(cv::Point2d in_image) const;

 private:
  enum class Drag { kNone, kPoint, kAll, kPan };

  // annotate_session.cpp
  void act(const std::string& name);
  void act_on_view(const std::string& name);
  void on_mouse(const Event& event);
  void on_left_down(cv::Point2d at, bool shift);
  void on_left_up();
  void on_move(cv::Point2d at);
  void click_pair(int point, bool chain);
  void nudge(double dx, double dy);
  void pick();
  void step_back();
  void accept();
  void remove_selected();
  void hide_selected();
  void transform_all(double scale, double angle);
  void change_image(int direction);
  void set_stage(AnnotateStage stage);
  // annotate_edit.cpp
  void load();
  template <typename Change>
  bool edit(const std::string& why, Change change, bool undoable = true);
  bool journal(const AnnotateState& before, const std::string& why);
  void undo(std::vector<AnnotateState>& from, std::vector<AnnotateState>& to, const char* what);
  void save();
  void open(int image);
  void propose_now();
  [[nodiscard]] std::optional<Eigen::Matrix2Xd> proposal();
  [[nodiscard]] int nearest_done(int image) const;  // -1: none
  [[nodiscard]] int reference() const;              // image in which points are defined; -1: none
  void estimate_positions();                        // for points without one, in the current image
  [[nodiscard]] std::string frames_folder() const;
  // annotate_view.cpp
  [[nodiscard]] const cv::Mat& shown_image() const;
  [[nodiscard]] double scale() const;  // view pixels per image pixel
  [[nodiscard]] cv::Point2d to_image(cv::Point2d in_view) const;
  [[nodiscard]] int point_near(cv::Point2d in_view) const;  // -1: none
  void zoom(double factor, cv::Point2d around);
  void zoom_to_points();
  void draw();
  void draw_points();
  void draw_magnifier();
  [[nodiscard]] std::string instruction() const;
  [[nodiscard]] std::string progress_text() const;
  View view();

  AnnotateOptions options_;
  PointProposer propose_;
  AnnotateState state_;
  AnnotateJournal journal_;
  std::vector<AnnotateState> undone_;
  std::vector<AnnotateState> before_;
  int unsaved_ = 0;

  int current_ = 0;
  cv::Mat image_;               // current, BGR; empty: cannot be read
  std::string read_error_;      // the reason
  Eigen::Matrix2Xd positions_;  // of the current image, with guesses for hidden points
  // by path: number of images done at the time of the proposal
  std::map<std::string, int> done_at_proposal_;
  bool is_learning_ = false;
  bool is_proposing_ = true;
  int selected_ = -1;

  Frame frame_;  // of the video
  std::deque<Frame> recent_;
  std::size_t steps_back_ = 0;  // steps back in `recent_`
  bool is_video_over_ = false;
  bool paused_ = false;
  int steps_ = 0;
  double skip_to_ = -1;  // s

  Drag drag_ = Drag::kNone;
  bool is_left_down_ = false;
  cv::Point2d drag_origin_;  // image px (kPan: view px)
  Eigen::Matrix2Xd drag_start_;
  cv::Point2d center_at_drag_;
  cv::Point2d mouse_{-1, -1};  // view px

  double zoom_ = 1;     // 1: the whole image is visible
  cv::Point2d center_;  // image px at the centre of the view
  cv::Size fitted_;     // image for which center_ was computed
  bool numbers_ = true;
  bool lines_ = true;
  bool mirrored_ = false;
  bool magnifier_ = true;
  SessionControls controls_;
  std::string message_;  // shown until the next event
  int bar_ = 0;          // px, height of the bar with the status
  cv::Mat reduced_from_;
  cv::Mat reduced_;  // the reduced image, if the view is smaller than the image
  int reduced_by_ = 0;
  cv::Mat shown_;
};

}  // namespace tarsier
