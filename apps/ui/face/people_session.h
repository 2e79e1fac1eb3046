// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/face/people/collector.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/grouping.h"
#include "tarsier/face/people/model.h"
#include "tarsier/face/pipelines/identifier.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include "ui/controls.h"
#include "ui/face/people_panel.h"
#include "ui/face/recognize_session.h"
#include "ui/overlay.h"
#include "ui/session.h"
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

enum class PeopleMode { kStart, kDetect, kCollect, kTrain, kRecognize };
[[nodiscard]] std::string_view name_of(PeopleMode mode);  // "start", "detect", "collect" ..

struct PeopleSessionOptions {
  double false_accepts = 0.01;  // false accept rate for unknown people
  face::people::CollectOptions collect;
  int max_faces = 30;                 // per person, collected at a time
  std::vector<std::string> names;     // names of people to add, in turn; then "Person 1" ..
  std::string note;                   // note of consent, for added people
  int max_pooled = 10;                // frames of a tracked face that are pooled
  std::function<std::int64_t()> now;  // ms since 1970-01-01 UTC; empty: 0
  std::string actor;                  // who corrects; for the gallery's log

  [[nodiscard]] OptionFields fields() {
    return {{"false_accepts", false_accepts, inside(0, 1), "--far",
             "false accept rate that sets the threshold"},
            {"max_faces", max_faces, range(1, 100'000), "--faces",
             "maximum number of faces to collect of a person at a time"},
            {"max_pooled", max_pooled, range(1, 1000)}};
  }
  void check() const;  // throws std::invalid_argument, UsageError for names
};

// Enrols and recognises people live. Five modes: start; detect (nobody is enrolled); collect
// (collects faces of one person); train (until there is a first model); recognise. Once there is a
// model, it knows new faces at once; retraining is spread over the following frames. Mouse: the
// buttons at the left; a face of the strip at the right collects more faces of that person; a click
// elsewhere ends collecting and trains. Keys: a adds a person, d deletes all (y confirms), b debug
// view, t trains, x says that the name of the largest face is wrong, u undoes the last correction,
// space pauses, h help, q or Esc quits. g, p and l open the lists of a PeoplePanel: groups of
// unknown faces (pending sightings are grouped, some in each frame), people, corrections; w names
// the group of the largest face. An unknown face shows the group of its sighting, or the group that
// it is similar enough to join. State: {"mode", "people": [{"name", "faces"}], "collecting": name
// or null, "recognized": [{"label", "known", "confidence", "group": number or null}], "unknown":
// {"groups", "waiting"}, "panel": PeoplePanel::state(), "asking", "debug", "flash", "message",
// "prompt", "paused"}, and "forgotten": the names of all people whom this session deleted, if any.
class PeopleSession final : public Session {
 public:
  // `state` belongs to a gallery: the result of Identifier::open() with `enroll`. `debug` may be
  // null and must outlive the session. It receives the stages of each frame's largest face. Throws
  // std::invalid_argument for the state of a recogniser.
  PeopleSession(face::IdentifierState state, PeopleSessionOptions options,
                DebugSink* debug = nullptr);
  PeopleSession(const PeopleSession&) = delete;
  PeopleSession& operator=(const PeopleSession&) = delete;

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  [[nodiscard]] PeopleMode mode() const { return mode_; }
  [[nodiscard]] face::people::Gallery& gallery() const { return gallery_; }
  [[nodiscard]] const std::vector<face::IdentifiedFace>& faces() const { return faces_; }
  // The group of each of faces() while it is unknown; 0: none.
  [[nodiscard]] const std::vector<std::int64_t>& groups() const { return groups_; }
  [[nodiscard]] const PeoplePanel& panel() const { return panel_; }
  // The host has stored a tracked face of the latest frame as this sighting.
  void on_sighting_stored(int face, std::int64_t sighting);
  // Counts pending sightings and groups after sightings were stored.
  void count_unknown();
  [[nodiscard]] double milliseconds() const { return timer_.last_ms(); }
  // Positions of controls in the view, px: for tests and hosts.
  [[nodiscard]] cv::Rect button_box(std::string_view name) const;  // "add", "delete", "debug"
  [[nodiscard]] cv::Rect strip_box(std::size_t person) const;

 private:
  struct Enrolled {
    std::string name;
    std::int64_t faces = 0;
    cv::Mat latest;  // crop
  };

  // people_session.cpp
  void act(const std::string& name);
  void click(cv::Point at);
  void load_people();
  void add_person();
  void collect_for(int person);
  void end_collecting();
  void delete_all();
  void reject_name();
  void undo();
  void train();
  void train_step();
  void follow();
  [[nodiscard]] bool people_changed() const;
  void reload_people();
  void collect();
  // people_session_groups.cpp
  void start_grouping();
  void continue_grouping();
  void find_groups();
  void name_largest();
  void on_correction();
  [[nodiscard]] bool act_in_panel(const std::function<bool()>& work);
  [[nodiscard]] face::people::CorrectionStamp stamp() const;
  // people_draw.cpp
  View view(bool fresh);
  void draw_strip();
  void draw_buttons();
  void draw_preprocessed();
  void draw_confidence();
  void draw_debug();
  [[nodiscard]] std::string prompt() const;
  [[nodiscard]] std::string help_line() const;
  [[nodiscard]] std::string unknown_text() const;
  [[nodiscard]] double scale() const;
  [[nodiscard]] cv::Size image_size() const;  // of the frame in the view
  [[nodiscard]] cv::Rect panel_area() const;
  [[nodiscard]] nlohmann::json state() const;

  face::IdentifierState identity_;
  face::people::Gallery& gallery_;
  PeopleSessionOptions options_;
  DebugSink* debug_sink_;
  face::Enroller enroller_;
  face::Identifier identifier_;
  std::optional<face::people::GalleryTraining> training_;  // running training of a model
  face::people::Collector collector_;
  PeopleMode mode_ = PeopleMode::kStart;
  std::vector<Enrolled> people_;
  std::vector<face::IdentifiedFace> faces_;
  int collecting_ = -1;  // index into people_
  std::string pending_;  // name of a person without a face; then the last of people_
  std::string message_;
  std::vector<std::string> forgotten_;  // names of people whom this session deleted
  std::string source_;
  std::string source_name_;
  std::string collected_from_;  // source_of() of the latest frame
  FrameTimer timer_;
  int flash_ = 0;  // remaining frames
  bool is_confirming_ = false;
  std::vector<std::int64_t> corrections_;  // made in this window and still in effect
  PeoplePanel panel_;
  std::optional<face::people::SightingGrouping> grouping_;  // running
  std::optional<face::people::GroupFinder> finder_;         // created when first needed
  std::int64_t finder_generation_ = -1;  // generation of the gallery when the finder read it
  std::vector<std::int64_t> groups_;     // of faces_
  struct TrackedUnknown {
    std::int64_t sighting = 0;  // 0: not stored yet
    std::int64_t group = 0;
    int frames_since_search = 0;  // frames since the last search for the group
  };
  std::map<int, TrackedUnknown> tracked_unknowns_;  // unknown faces by id
  std::int64_t group_count_ = 0;
  std::int64_t ungrouped_count_ = 0;  // sightings in no group
  bool debug_ = false;
  SessionControls controls_{true};
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
};

}  // namespace tarsier
