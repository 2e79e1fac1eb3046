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
  double false_accepts = 0.01;  // rate at which strangers may be taken for somebody
  face::people::CollectOptions collect;
  int max_faces = 30;                 // of a person, collected at a time
  std::vector<std::string> names;     // of people who are added, in turn; then "Person 1" ..
  std::string note;                   // of consent, for those who are added
  int max_pooled = 10;                // frames of a followed face that count together
  std::function<std::int64_t()> now;  // ms since 1970-01-01 UTC; empty: 0
  std::string actor;                  // who corrects, for the gallery's log

  [[nodiscard]] OptionFields fields() {
    return {{"false_accepts", false_accepts, inside(0, 1), "--far",
             "false accept rate that sets the threshold"},
            {"max_faces", max_faces, range(1, 100'000), "--faces",
             "maximum number of faces to collect of a person at a time"},
            {"max_pooled", max_pooled, range(1, 1000)}};
  }
  void check() const;  // throws std::invalid_argument, UsageError for names
};

// Enrols and recognises people live. Five modes: start; detect (nobody is enrolled); collect (the
// faces of one person are taken); train (until there is a first model); recognise. Once there is a
// model new faces are known by it at once; what is to be learned of them is learned a little in
// each frame, meanwhile. Mouse: the buttons at the left; a face of the strip at the right collects
// more of that person; a click elsewhere ends collecting and trains. Keys: a adds a person, d
// deletes all (y confirms), b debug view, t trains, x says that the largest face is not whom it is
// named, u undoes the last correction, space pauses, h help, q or Esc ends. g, p and l open the
// lists of a PeoplePanel: groups of unknown faces (those that wait are placed, some in each frame),
// people, corrections; w says who the group of the largest face is. An unknown face shows the group
// that its sighting is in, or that it is like enough to join. State:
// {"mode", "people": [{"name", "faces"}], "collecting": name or null, "recognized":
// [{"label", "known", "confidence", "group": number or null}], "unknown": {"groups", "waiting"},
// "panel": PeoplePanel::state(), "asking", "debug", "flash", "message", "prompt", "paused"}.
class PeopleSession final : public Session {
 public:
  // Of a gallery: what Identifier::open() gives with `enroll`. `debug`, which may be null and must
  // outlive the session, takes the stages of each frame's largest face. Throws
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
  [[nodiscard]] const std::vector<face::NamedFace>& faces() const { return faces_; }
  // The group of each of these while it is unknown; 0: in none.
  [[nodiscard]] const std::vector<std::int64_t>& groups() const { return groups_; }
  [[nodiscard]] const PeoplePanel& panel() const { return panel_; }
  // The host has stored a followed face of the latest frame as this sighting.
  void stored(int face, std::int64_t sighting);
  // Sightings were stored: how many wait, and in how many groups the others are.
  void count_unknown();
  [[nodiscard]] double milliseconds() const { return timer_.last_ms(); }
  // Where controls are in the view, px: for tests and hosts.
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
  void not_this_person();
  void undo();
  void train();
  void learn();
  void follow();
  [[nodiscard]] bool people_changed() const;
  void reload_people();
  void collect();
  // people_session_groups.cpp
  void place_unknown();
  void place_more();
  void find_groups();
  void name_largest();
  void corrected();
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
  [[nodiscard]] std::string unknown_words() const;
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
  std::optional<face::people::GalleryTraining> training_;  // of a model, on its way
  face::people::Collector collector_;
  PeopleMode mode_ = PeopleMode::kStart;
  std::vector<Enrolled> people_;
  std::vector<face::NamedFace> faces_;
  int collecting_ = -1;  // index into people_
  std::string pending_;  // name of a person who has no face yet; the last of people_ then
  std::string message_;
  std::string source_;
  std::string source_name_;
  std::string collected_from_;  // source_of() the latest frame
  FrameTimer timer_;
  int flash_ = 0;  // frames it still lasts
  bool asking_ = false;
  std::vector<std::int64_t> corrections_;  // of this window, those that hold
  PeoplePanel panel_;
  std::optional<face::people::SightingGrouping> grouping_;  // on its way
  std::optional<face::people::GroupFinder> finder_;         // of groups; made when first needed
  std::int64_t finder_generation_ = -1;                     // of the gallery when it was read
  std::vector<std::int64_t> groups_;                        // of faces_
  struct Followed {
    std::int64_t sighting = 0;  // 0: not stored yet
    std::int64_t group = 0;
    int looked = 0;  // frames since the group was looked for
  };
  std::map<int, Followed> followed_;  // unknown faces, by their id
  std::int64_t group_count_ = 0;
  std::int64_t waiting_ = 0;  // sightings in no group
  bool debug_ = false;
  SessionControls controls_{true};
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
};

}  // namespace tarsier
