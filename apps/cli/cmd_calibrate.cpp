// SPDX-License-Identifier: MIT
#include "cmd_calibrate.h"

#include "tarsier/core/length.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/planar/calibration/detect.h"
#include "tarsier/session/calibrate_session.h"
#include "tarsier/synth/sources.h"

#include <fmt/format.h>

#include "framework/stopwatch.h"
#include <algorithm>
#include <chrono>
#include <map>
#include <memory>
#include <optional>

namespace tarsier::cli {
namespace {

using planar::calibration::BoardSpec;
using planar::calibration::BoardView;
using std::chrono::milliseconds;

constexpr std::size_t kHinted = 3;    // pictures in which boards of other sizes are looked for
constexpr double kLookEvery_s = 0.2;  // of a video

struct Looked {
  BoardView view;
  double ms = 0;
};

Looked look(const cv::Mat& picture, const BoardSpec& spec) {
  const Stopwatch watch;
  Looked result{planar::calibration::find_board(picture, spec)};
  result.ms = watch.ms();
  return result;
}

// Goes through the inputs: every still, and some frames of videos.
class Search {
 public:
  Search(const CalibrateFlags& flags, const BoardSpec& spec, Context& context)
      : flags_(flags), context_(context) {
    job_.spec = spec;
  }

  CalibrationJob run() {
    for (const std::string& input : flags_.run.inputs) {
      const auto source = open_source(input, flags_.run.source, {synth::synth_scheme()});
      if (source->is_live()) {
        throw UsageError(fmt::format("{}: is live, and others are not: give it alone", input));
      }
      go_through(*source);
    }
    if (job_.pictures.empty())
      throw InputError(flags_.run.inputs.front(), "no picture came from it");
    settle_sizes();
    return std::move(job_);
  }
  [[nodiscard]] std::size_t stills() const { return stills_; }
  [[nodiscard]] const std::vector<cv::Mat>& boardless() const { return boardless_; }

 private:
  void go_through(FrameSource& source) {
    const double fps = source.fps() > 0 ? source.fps() : 25;
    const int step = std::max(1, static_cast<int>(std::lround(kLookEvery_s * fps)));
    context_.progress->begin("calibrate", source.count(), "pictures");
    std::optional<planar::calibration::ViewCollector> collector;
    std::vector<std::size_t> taken;  // job_.pictures of the collector's views
    while (!source.ended()) {
      throw_if_stopped(context_.stop);
      const auto frame = source.next(milliseconds(200), context_.stop);
      throw_if_stopped(context_.stop);
      if (!frame) continue;
      context_.progress->advance();
      if (frame->still) {
        take_still(*frame);
      } else if (frame->index % (step * flags_.run.every) == 0) {
        take_moment(*frame, collector, taken);
      }
    }
    context_.progress->end();
    if (collector) {
      for (std::size_t i = 0; i < taken.size(); ++i) {
        CalibrationPicture& picture = job_.pictures[taken[i]];
        picture.view = job_.views.size();
        job_.views.push_back(collector->views()[i]);
        sizes_.push_back(video_size_);
      }
    }
  }

  void take_still(const Frame& frame) {
    ++stills_;
    const Looked looked = look(frame.image, job_.spec);
    CalibrationPicture picture{frame.name, frame.index, 0,         true, !looked.view.empty(),
                               "",         0,           looked.ms, {}};
    if (picture.found) {
      picture.view = job_.views.size();
      job_.views.push_back(looked.view);
      sizes_.push_back(frame.image.size());
    } else {
      picture.reason = "no board";
      if (boardless_.size() < kHinted) boardless_.push_back(frame.image.clone());
    }
    job_.pictures.push_back(std::move(picture));
  }

  void take_moment(const Frame& frame, std::optional<planar::calibration::ViewCollector>& collector,
                   std::vector<std::size_t>& taken) {
    const Looked looked = look(frame.image, job_.spec);
    if (!collector) {
      video_size_ = frame.image.size();
      planar::calibration::CollectorOptions options;
      options.most = flags_.views;
      collector.emplace(job_.spec, video_size_, options);
    }
    const double sharpness = planar::calibration::sharpness_of(frame.image, looked.view, job_.spec);
    const auto answer = collector->offer(looked.view, sharpness);
    CalibrationPicture picture{frame.name, frame.index, frame.time,
                               false,      false,       std::string(name_of(answer.verdict)),
                               0,          looked.ms,   {}};
    using planar::calibration::Verdict;
    if (answer.verdict == Verdict::kTaken || answer.verdict == Verdict::kReplaced) {
      picture.found = true;
      picture.reason.clear();
      if (!flags_.draw.empty() || !flags_.undistorted.empty()) picture.image = frame.image.clone();
      if (answer.verdict == Verdict::kReplaced) {
        CalibrationPicture& old = job_.pictures[taken[answer.index]];
        old.found = false;
        old.reason = "alike";
        old.image.release();
        taken[answer.index] = job_.pictures.size();
      } else {
        taken.push_back(job_.pictures.size());
      }
    } else if (answer.verdict == Verdict::kNoBoard && boardless_.size() < kHinted) {
      boardless_.push_back(frame.image.clone());
    }
    job_.pictures.push_back(std::move(picture));
  }

  // A camera has one size of pictures: that of most views. Others are left out, and named.
  void settle_sizes() {
    std::map<std::pair<int, int>, int> counts;
    for (const cv::Size& size : sizes_) ++counts[{size.width, size.height}];
    int most = 0;
    for (const auto& [size, count] : counts) {
      if (count <= most) continue;
      most = count;
      job_.size = {size.first, size.second};
    }
    for (CalibrationPicture& picture : job_.pictures) {
      if (!picture.found || sizes_[picture.view] == job_.size) continue;
      picture.reason = fmt::format("{}x{} px, most others have {}x{}", sizes_[picture.view].width,
                                   sizes_[picture.view].height, job_.size.width, job_.size.height);
      job_.views[picture.view] = {};
    }
  }

  const CalibrateFlags& flags_;
  Context& context_;
  CalibrationJob job_;
  std::vector<cv::Size> sizes_;  // of the views' pictures
  cv::Size video_size_;
  std::vector<cv::Mat> boardless_;
  std::size_t stills_ = 0;
};

// Where no picture shows the board: what to look at.
std::string hint_of(const BoardSpec& spec, const std::vector<cv::Mat>& pictures) {
  std::map<std::string, int> sizes;
  for (const cv::Mat& picture : pictures)
    for (const std::string& size : planar::calibration::other_chess_sizes(picture, spec))
      ++sizes[size];
  // A part of a board may look like a smaller one: many points speak for a size.
  std::string best;
  int best_score = 0;
  for (const auto& [size, count] : sizes) {
    const int score =
        count * planar::calibration::parse_board("chess:" + size, spec.pitch).points();
    if (score <= best_score) continue;
    best_score = score;
    best = size;
  }
  if (!best.empty())
    return fmt::format("; a board of {} inner corners is there: --board chess:{}", best, best);
  return spec.kind == planar::calibration::BoardKind::kChess
             ? "; chess:9x6 means 9 x 6 inner corners, one less than squares each way, and the "
               "whole board with its white rim must be in the picture"
             : "; all of the board must be in the picture (of charuco boards a part)";
}

// --- the session ---

// Whether it is a window's or a camera's: then a person moves the board.
bool is_session(const CalibrateFlags& flags) {
  if (flags.run.window || flags.run.fullscreen || !flags.run.actions.empty()) return true;
  for (const std::string& input : flags.run.inputs) {
    const SourceKind kind = classify_source(input, {synth::synth_scheme()});
    const bool is_live_synth =
        kind == SourceKind::kScheme && input.find("live=1") != std::string::npos;
    if (kind == SourceKind::kCamera || kind == SourceKind::kPiCamera || kind == SourceKind::kHttp ||
        kind == SourceKind::kFfmpegUrl || is_live_synth) {
      return true;
    }
  }
  return false;
}

ExitStatus run_live(CalibrateFlags& flags, const BoardSpec& spec, Context& context) {
  CalibrateSessionOptions options;
  options.board = spec;
  options.calibrate = flags.options;
  options.collect.most = flags.views;
  options.keep_pictures = !flags.draw.empty() || !flags.undistorted.empty();
  CalibrateSession session(options);
  RunHooks hooks;
  hooks.title = "calibrate";
  hooks.describe = [&](const View& view, nlohmann::ordered_json& line) {
    for (const char* key : {"views", "coverage", "verdict", "calibrated", "rms", "fx"})
      line[key] = view.state[key];
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  if (status != ExitStatus::kDone) return status;
  CalibrationJob job;
  job.spec = spec;
  job.size = session.size();
  job.views = session.views();
  for (std::size_t i = 0; i < job.views.size(); ++i) {
    const TakenView& taken = session.taken()[i];
    job.pictures.push_back({"", taken.index, taken.time, false, true, "", i, 0, taken.image});
  }
  if (job.views.empty()) {
    log_warning("no view of the board {} was taken: no camera is written", spec.text());
    return ExitStatus::kNothingFound;
  }
  return finish_calibration(flags, job, context);
}

// --- the verb ---

ExitStatus run_calibrate(CalibrateFlags& flags, Context& context) {
  const BoardSpec spec =
      planar::calibration::parse_board(flags.board, parse_length(flags.square, "--square"));
  flags.options.lens = geometry::lens_named(flags.lens).value();
  flags.options.tangential = !flags.no_tangential;
  flags.options.check();
  if (is_session(flags)) return run_live(flags, spec, context);
  Search search(flags, spec, context);
  const CalibrationJob job = search.run();
  const auto boards = static_cast<std::size_t>(std::count_if(
      job.views.begin(), job.views.end(), [](const BoardView& view) { return !view.empty(); }));
  if (boards > 0 && 4 * boards <= search.stills()) {
    log_warning("the board {} is in {} of {} pictures only{}", spec.text(), boards, search.stills(),
                hint_of(spec, search.boardless()));
  }
  if (boards == 0) {
    log_warning("no board {} in {} {}{}", spec.text(), job.pictures.size(),
                job.pictures.size() == 1 ? "picture" : "pictures",
                hint_of(spec, search.boardless()));
    if (context.json) static_cast<void>(finish_calibration(flags, job, context));
    return ExitStatus::kNothingFound;
  }
  return finish_calibration(flags, job, context);
}

void add_lens_flags(Command& verb, CalibrateFlags& flags) {
  const auto lens = [](Flag& flag) { flag.group("Lens"); };
  lens(verb.add_option("--lens", flags.lens,
                       "pinhole (k1 k2 p1 p2 k3), rational (k1..k6 p1 p2), fisheye (k1..k4)")
           .check(one_of({"pinhole", "rational", "fisheye"}))
           .show_default());
  lens(verb.add_option("--radial", flags.options.radial,
                       "radial numbers of a pinhole: 0..3; fewer for few views")
           .check(range(0, 3))
           .show_default());
  lens(verb.add_flag("--no-tangential", flags.no_tangential, "p1 and p2 are 0"));
  lens(verb.add_flag("--square-pixels", flags.options.square_pixels, "fy is fx"));
  lens(verb.add_option("--outlier", flags.options.outlier,
                       "a view that fits so many times worse than most is left out")
           .check(range(2.0, 1e6))
           .show_default());
}

void add_flags(Command& verb, CalibrateFlags& flags) {
  flags.run.output = "none";
  verb.add_option("INPUT", flags.run.inputs,
                  "pictures, folders, globs, @list.txt, videos; a camera or URL: a session")
      .required()
      .type_name("");
  verb.add_option("--board", flags.board,
                  "chess:9x6 (inner corners), charuco:5x7:6x6_250, circles:4x11, circles-grid:7x6")
      .required();
  verb.add_option("--square", flags.square,
                  "side of a square, distance of dots: 25mm, 2.5cm, 0.025")
      .required();
  verb.add_option("-o,--output", flags.output, "camera file to write (camera.yaml)");
  verb.add_option("--format", flags.format, "of the camera file: tarsier, opencv, colmap")
      .check(one_of({"tarsier", "opencv", "colmap"}))
      .show_default();
  verb.add_option("--csv", flags.csv, "table to write: one row a picture");
  verb.add_option("--draw", flags.draw, "folder for pictures with their corners, and coverage.png");
  verb.add_option("--undistorted", flags.undistorted, "folder for the pictures, straightened");
  verb.add_option("--views", flags.views, "so many pictures of a video, at most")
      .check(range(3, 500))
      .show_default();
  verb.add_option("--every", flags.run.every, "of videos: look at fewer frames, N times")
      .check(range(1, 100000))
      .show_default();
  const auto live = [](Flag& flag) { flag.group("Session"); };
  live(verb.add_flag("--window", flags.run.window,
                     "a session in a window, which takes views by itself (h: keys)"));
  live(verb.add_flag("--fullscreen", flags.run.fullscreen, "the window fills the screen"));
  live(verb.add_option("--actions", flags.run.actions, "-: actions by name on stdin, one a line")
           .check(one_of({"-"})));
  live(verb.add_option("--frames", flags.run.frames, "stop after so many frames; 0: all")
           .check(not_negative())
           .show_default());
  live(verb.add_option("--width", flags.run.source.width, "asked of a camera, px; 0: its choice")
           .show_default());
  live(verb.add_option("--height", flags.run.source.height, "px").show_default());
  live(verb.add_option("--fps", flags.run.source.fps, "asked of a camera; 0: its own")
           .show_default());
  add_lens_flags(verb, flags);
}

}  // namespace

void add_calibrate(Command& app, Context& context) {
  add_verb<CalibrateFlags>(
      app, "calibrate", "a camera's focal length, centre and distortion from pictures of a board",
      context, add_flags, run_calibrate);
}

}  // namespace tarsier::cli
