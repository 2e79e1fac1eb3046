// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/face/pipelines/annotator.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>

#include "framework/browse_session.h"
#include "framework/input_schemes.h"
#include "framework/size_flag.h"
#include "ui/face/annotate_session.h"
#include "verbs/landmarks/landmarks.h"
#include "window.h"
#include <algorithm>
#include <charconv>
#include <chrono>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

struct AnnotateFlags {
  std::string input;
  std::string output;
  std::string proposals = "on";
  std::string actions;
  std::string size = "1024x700";
  bool window = false;
  bool fullscreen = false;
};

// Reads the video frame by frame when the session requests frames.
class Video {
 public:
  Video(std::unique_ptr<FrameSource> source, AnnotateSession& session)
      : source_(std::move(source)), session_(session) {
    const double fps = source_ != nullptr && source_->fps() > 0 ? source_->fps() : 25;
    period_ = std::chrono::duration_cast<Clock::duration>(
        std::chrono::duration<double>(1 / std::clamp(fps, 1.0, 240.0)));
  }

  // Passes the next frame to the session; nullopt if it requests none or none arrived.
  std::optional<View> feed(milliseconds timeout, const std::stop_token& stop) {
    if (source_ == nullptr || !session_.wants_frame()) return std::nullopt;
    try {
      if (const std::optional<Frame> frame = source_->next(timeout, stop)) {
        due_ = std::max(Clock::now(), due_ + period_);
        return session_.on_frame(*frame, source_->status());
      }
      if (!source_->ended()) return std::nullopt;
    } catch (const Error& error) {  // it ends early: the picked frames are kept
      log_warning("{}", error.what());
    }
    source_.reset();
    session_.video_ended();
    return session_.current_view();
  }
  // Time until the next frame must be shown.
  [[nodiscard]] milliseconds wait() const {
    if (source_ == nullptr || !session_.wants_frame()) return milliseconds(50);
    if (session_.at_once()) return milliseconds(0);
    return std::clamp(std::chrono::duration_cast<milliseconds>(due_ - Clock::now()),
                      milliseconds(0), milliseconds(50));
  }
  [[nodiscard]] bool is_due() const { return session_.at_once() || Clock::now() >= due_; }

 private:
  std::unique_ptr<FrameSource> source_;
  AnnotateSession& session_;
  Clock::duration period_;
  Clock::time_point due_;
};

// Opens images, or a video.
std::unique_ptr<FrameSource> open_input(const std::string& input, AnnotateOptions& options) {
  if (input.empty()) return nullptr;
  std::error_code error;
  // A list may be named without its '@': no other input has this extension.
  if (fs::path(input).extension() == ".txt" && fs::is_regular_file(input, error)) {
    options.images = paths_of_list(input);
    return nullptr;
  }
  const std::vector<Scheme> schemes = input_schemes();
  switch (classify_source(input, schemes)) {
    case SourceKind::kImage:
      options.images = {input};
      return nullptr;
    case SourceKind::kFolder:
      options.images = images_in_folder(input);
      return nullptr;
    case SourceKind::kGlob:
      options.images = files_of_glob(input);
      return nullptr;
    case SourceKind::kList:
      options.images = paths_of_list(input.substr(1));
      return nullptr;
    default:
      options.video = true;
      return open_source(input, {}, schemes);
  }
}

// --- lines instead of a window ---

bool number_of(const std::string& word, double& value) {
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size() && std::abs(value) < 1e6;
}

Event mouse_at(Event::Mouse mouse, cv::Point2d at, bool shift) {
  Event event;
  event.kind = Event::Kind::kMouse;
  event.mouse = mouse;
  event.x = at.x;
  event.y = at.y;
  event.shift = shift;
  return event;
}

class Lines {
 public:
  Lines(AnnotateSession& session, Video& video, Context& context)
      : session_(session), video_(video), context_(context) {}

  ExitStatus run() {
    std::string line;
    while (!finished_ && !context_.stop.stop_requested() && std::getline(std::cin, line))
      take(line);
    return context_.stop.stop_requested() ? ExitStatus::kInterrupted : ExitStatus::kDone;
  }

 private:
  void take(const std::string& line) {
    std::istringstream stream(line);
    std::vector<std::string> words;
    for (std::string word; stream >> word;) words.push_back(word);
    if (words.empty() || words[0].starts_with("#")) return;
    std::vector<double> numbers;
    for (std::size_t i = 1; i < words.size(); ++i) {
      double value = 0;
      if (number_of(words[i], value)) numbers.push_back(value);
    }
    const bool has_numbers = numbers.size() + 1 == words.size();
    if (words[0] == "click" && has_numbers && numbers.size() == 2) {
      drag({numbers[0], numbers[1]}, {numbers[0], numbers[1]}, false);
    } else if (words[0].starts_with("drag") && has_numbers && numbers.size() == 4) {
      drag({numbers[0], numbers[1]}, {numbers[2], numbers[3]}, words[0] == "drag-all");
    } else if (words[0] == "frames" && has_numbers && numbers.size() == 1) {
      for (int i = 0; i < static_cast<int>(numbers[0]); ++i)
        (void)video_.feed(milliseconds(2000), context_.stop);
    } else if (words[0] == "key" && words.size() == 2 && words[1].size() == 1) {
      send(key_event(words[1][0]));
    } else if (words[0] == "look" && words.size() == 2) {
      write_image(words[1], session_.current_view().image);
    } else if (words.size() == 1 && is_action(words[0])) {
      send(action_event(words[0]));
    } else {
      log_warning("unknown line '{}'", line.substr(0, 100));
    }
  }
  [[nodiscard]] bool is_action(const std::string& name) const {
    const std::vector<Action> actions = session_.actions();
    return std::any_of(actions.begin(), actions.end(),
                       [&](const Action& action) { return action.name == name; });
  }
  void drag(cv::Point2d from, cv::Point2d to, bool shift) {
    if (session_.is_learning()) (void)session_.on_idle({});
    send(mouse_at(Event::Mouse::kLeftDown, session_.to_view(from), shift));
    send(mouse_at(Event::Mouse::kMove, session_.to_view(to), shift));
    send(mouse_at(Event::Mouse::kLeftUp, session_.to_view(to), shift));
  }
  void send(const Event& event) {
    View view = session_.on_event(event);
    if (session_.is_learning()) view = session_.on_idle({});
    finished_ = finished_ || view.finished;
    const bool is_step = event.kind != Event::Kind::kMouse || event.mouse == Event::Mouse::kLeftUp;
    if (context_.json && is_step) print_event_line(event, view);
  }

  AnnotateSession& session_;
  Video& video_;
  Context& context_;
  bool finished_ = false;
};

ExitStatus annotate(AnnotateFlags& flags, Context& context) {
  const bool is_headless = !flags.actions.empty();
  AnnotateOptions options;
  options.set_path = flags.output;
  options.canvas = parse_size(flags.size, 320, 4096);
  std::error_code ignored;
  if (flags.input.empty() && !fs::exists(flags.output, ignored))
    throw UsageError("give the images or the video: there is no set " + flags.output + " yet");
  std::unique_ptr<FrameSource> source = open_input(flags.input, options);
  if (!is_headless) window::prepare();  // before a journal is opened

  face::Annotator annotator({.seed = context.seed});
  PointProposer propose;
  if (flags.proposals == "on")
    propose = [&](const face::ProposalRequest& request) -> std::optional<Eigen::Matrix2Xd> {
      std::optional<face::Proposal> proposal = annotator.propose(request);
      if (!proposal) return std::nullopt;
      return std::move(proposal->points);
    };
  AnnotateSession session(options, propose);
  Video video(std::move(source), session);

  ExitStatus status = ExitStatus::kDone;
  try {
    if (is_headless) {
      status = Lines(session, video, context).run();
    } else {
      const auto between = [&](milliseconds& wait) -> std::optional<View> {
        if (session.is_learning()) {
          wait = milliseconds(0);
          return session.on_idle({});
        }
        std::optional<View> view;
        if (video.is_due()) view = video.feed(milliseconds(20), context.stop);
        wait = video.wait();
        return view;
      };
      status = browse_session(session, "Tarsier annotate", flags.fullscreen, context, between);
    }
  } catch (...) {  // the display was lost: finished work is kept
    session.finish();
    throw;
  }
  session.finish();

  const face::shape::LandmarkSet set = session.state().finished();
  if (context.json) {
    const nlohmann::ordered_json line{{"output", flags.output},
                                      {"samples", set.samples.size()},
                                      {"points", set.points()},
                                      {"images", session.state().images()}};
    print_json(line);
  } else {
    print_text(fmt::format("{}: {} of {} images done, {} points\n", flags.output,
                           set.samples.size(), session.state().images(), set.points()));
  }
  if (status != ExitStatus::kDone) return status;
  return set.samples.empty() ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

void add_flags(Command& verb, AnnotateFlags& flags) {
  verb.add_option("INPUT", flags.input,
                  "video, folder, glob, list (.txt) or image [the set's own images]")
      .type_name("");
  verb.add_option("-o,--output", flags.output,
                  "file of the annotated set; an existing file is continued")
      .required();
  verb.add_option("--proposals", flags.proposals,
                  "propose the landmarks of the next image from those annotated so far")
      .check(one_of({"on", "off"}))
      .show_default();
  verb.add_flag("--window", flags.window, "annotate in a window (default without --actions)");
  verb.add_flag("--fullscreen", flags.fullscreen, "show the window in full screen");
  verb.add_option("--size", flags.size, "size of the view, px").show_default();
  verb.add_option("--actions", flags.actions,
                  "-: no window; actions from stdin, one a line: NAME, 'key K', 'click X Y', 'drag "
                  "X Y X Y', 'drag-all X Y X Y' (image px), 'frames N', 'look FILE.png'")
      .check(one_of({"-"}));
}

}  // namespace

void add_landmarks_annotate(Command& area, Context& context) {
  add_verb<AnnotateFlags>(area, "annotate", "annotate landmarks in images or frames of a video",
                          context, add_flags, annotate);
}

}  // namespace tarsier::cli
