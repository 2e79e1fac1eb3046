// SPDX-License-Identifier: MIT
#include "ui/face/people_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/face/people/name.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

namespace tarsier {
namespace {

constexpr NameTable<PeopleMode, 5> kModes{"mode",
                                          {{{PeopleMode::kStart, "start"},
                                            {PeopleMode::kDetect, "detect"},
                                            {PeopleMode::kCollect, "collect"},
                                            {PeopleMode::kTrain, "train"},
                                            {PeopleMode::kRecognize, "recognize"}}}};

constexpr int kFlashFrames = 3;
// Training work per frame, in the units of GalleryTraining::work(): before there is a first model,
// and during recognition.
constexpr double kInitialTrainingWork = 300;
constexpr double kTrainingWork = 60;

face::people::Gallery& gallery_of(const face::IdentifierState& state) {
  TARSIER_REQUIRE(state.gallery() != nullptr, "a session enrols people into a gallery");
  return *state.gallery();
}

}  // namespace

std::string_view name_of(PeopleMode mode) { return kModes.name(mode); }

void PeopleSessionOptions::check() const {
  check_fields(*this);
  collect.check();
  for (const std::string& name : names) face::people::check_name(name);
  face::people::check_note(note);
}

PeopleSession::PeopleSession(face::IdentifierState state, PeopleSessionOptions options,
                             DebugSink* debug)
    : identity_(std::move(state)),
      gallery_(gallery_of(identity_)),
      options_(std::move(options)),
      debug_sink_(debug),
      enroller_(gallery_, identity_.background()),
      identifier_({options_.false_accepts, options_.max_pooled}),
      collector_(options_.collect),
      panel_(gallery_, {[this] { return stamp(); }, options_.note, options_.names}) {
  options_.check();
  load_people();
  count_unknown();
}

void PeopleSession::load_people() {
  people_.clear();
  for (const face::people::Person& person : gallery_.people()) {
    Enrolled entry{person.name, person.faces, {}};
    if (const auto face = gallery_.latest_face(person.id)) entry.latest = face->crop;
    if (entry.name == pending_) pending_.clear();  // enrolled meanwhile
    people_.push_back(std::move(entry));
  }
  if (!pending_.empty()) people_.push_back({pending_, 0, {}});
}

View PeopleSession::on_frame(const Frame& frame, const SourceStatus& source) {
  if (source_of(frame) != collected_from_) collector_.reset();
  collected_from_ = source_of(frame);
  source_name_ = frame.name;
  source_ = source_warning(source);
  frame_ = frame.image;
  if (flash_ > 0) --flash_;
  if (mode_ == PeopleMode::kStart) {
    mode_ = identity_.recognizer() != nullptr ? PeopleMode::kRecognize : PeopleMode::kDetect;
    if (mode_ == PeopleMode::kDetect && gallery_.face_count_up_to(1) > 0) train();
  } else if (training_) {
    train_step();
  }
  follow();
  timer_.start();
  faces_ = identifier_.find(frame, identity_, watched(debug_sink_));
  std::stable_sort(faces_.begin(), faces_.end(),
                   [](const face::IdentifiedFace& a, const face::IdentifiedFace& b) {
                     return a.face.box.area() > b.face.box.area();
                   });
  if (mode_ == PeopleMode::kCollect && !faces_.empty() &&
      collector_.offer(faces_.front().face, frame.time, !frame.still).empty()) {
    collect();
  }
  if (mode_ == PeopleMode::kRecognize) identifier_.identify(faces_, identity_);
  find_groups();
  timer_.stop();
  continue_grouping();
  return view(true);
}

// The face is stored at once, so a crash loses no collected face.
void PeopleSession::collect() {
  Enrolled& person = people_[static_cast<std::size_t>(collecting_)];
  const face::people::Face& face = faces_.front().face;
  enroller_.enroll(person.name, options_.note, face, source_name_,
                   options_.now ? options_.now() : 0);
  if (person.name == pending_) pending_.clear();
  ++person.faces;
  person.latest = face.crop;
  flash_ = kFlashFrames;
  message_.clear();
  if (collector_.accepted() >= options_.max_faces) end_collecting();
}

// Starts training. An existing model is used meanwhile.
void PeopleSession::train() {
  training_.emplace(gallery_, identity_.background(), true, face::people::TrainingPolicy::kIfNeeded,
                    face::people::SearchMode::kIndexed);
  mode_ = identity_.recognizer() != nullptr ? PeopleMode::kRecognize : PeopleMode::kTrain;
}

// Does a part of the training: a frame never waits for all of it.
void PeopleSession::train_step() {
  NoProgress progress;
  const bool first = identity_.recognizer() == nullptr;
  try {
    for (double work = 0; work < (first ? kInitialTrainingWork : kTrainingWork);
         work += training_->work()) {
      if (training_->step(progress, {})) continue;
      identity_.replace(training_->take());
      training_.reset();
      break;
    }
  } catch (const std::invalid_argument& error) {
    // "Fisherfaces needs faces of at least two people, there is one": report it and continue.
    training_.reset();
    identity_.replace(std::nullopt);
    message_ = error.what();
  }
  if (training_ || mode_ == PeopleMode::kCollect) return;
  mode_ = identity_.recognizer() != nullptr ? PeopleMode::kRecognize : PeopleMode::kDetect;
}

// Follows changes of the gallery, here or by other programs.
void PeopleSession::follow() {
  if (identity_.recognizer() == nullptr || !identity_.update()) return;
  if (people_changed()) reload_people();
  if (mode_ == PeopleMode::kRecognize && identity_.recognizer() == nullptr)
    mode_ = PeopleMode::kDetect;
  if (mode_ == PeopleMode::kDetect && identity_.recognizer() != nullptr)
    mode_ = PeopleMode::kRecognize;
}

// Whether people were added or removed, by any program.
bool PeopleSession::people_changed() const {
  std::set<std::string> there;
  for (const face::people::Person& person : gallery_.people()) there.insert(person.name);
  std::set<std::string> shown;
  for (const Enrolled& person : people_)
    if (person.name != pending_) shown.insert(person.name);
  return there != shown;
}

// Other people may be removed: collecting stays with its person.
void PeopleSession::reload_people() {
  const std::string collecting =
      collecting_ >= 0 ? people_[static_cast<std::size_t>(collecting_)].name : "";
  load_people();
  collecting_ = -1;
  for (std::size_t i = 0; i < people_.size(); ++i)
    if (people_[i].name == collecting) collecting_ = static_cast<int>(i);
  if (mode_ == PeopleMode::kCollect && collecting_ < 0) mode_ = PeopleMode::kDetect;
}

View PeopleSession::on_idle(const SourceStatus& source) {
  source_ = source_warning(source);
  return view(false);
}

View PeopleSession::on_event(const Event& event) {
  if (event.kind == Event::Kind::kMouse) {
    if (event.mouse == Event::Mouse::kLeftDown) click({cvRound(event.x), cvRound(event.y)});
    return view(false);
  }
  if (!act_in_panel([&] { return panel_.press(event); })) act(action_of(event, actions()));
  return view(false);
}

std::vector<Action> PeopleSession::actions() const {
  std::vector<Action> all{{"add", "add a person", 'a'},
                          {"delete", "delete all people (asks)", 'd'},
                          {"confirm", "yes, delete", 'y'},
                          {"cancel", "no, keep them", 'n'},
                          {"debug", "show the debug view", 'b'},
                          {"train", "stop collecting and train", 't'},
                          {"not", "reject the name of the largest face", 'x'},
                          {"undo", "undo the last correction", 'u'}};
  for (Action& action : PeoplePanel::actions()) all.push_back(std::move(action));
  return controls_.append_to(std::move(all));
}

void PeopleSession::act(const std::string& name) {
  if (name.empty()) return;
  if (!is_confirming_ && act_in_panel([&] { return panel_.act(name); })) {
    if (name == "groups" && panel_.list() == PeoplePanel::List::kGroups) start_grouping();
    return;
  }
  const bool was_confirming = std::exchange(is_confirming_, false);
  if (name == "confirm" && was_confirming) delete_all();
  if (name == "cancel" && was_confirming) message_ = "no person was deleted";
  if (name == "add") add_person();
  if (name == "delete") {
    is_confirming_ = !people_.empty();
    message_ = people_.empty() ? "nobody is enrolled" : "";
  }
  if (name == "debug") debug_ = !debug_;
  if (name == "train") end_collecting();
  if (name == "not") reject_name();
  if (name == "undo") undo();
  if (name == "name") name_largest();
  controls_.act(name);
}

// The largest named face, or the one that would be named, is not that person.
void PeopleSession::reject_name() {
  if (mode_ != PeopleMode::kRecognize || faces_.empty() || faces_.front().identity.label.empty()) {
    message_ = "no face is identified: nothing to correct";
    return;
  }
  face::IdentifiedFace& face = faces_.front();
  const face::people::SightingFace seen{face.face.crop, face.face.quality.score(),
                                        face::people::quality_json(face.face.quality).dump()};
  try {
    corrections_.push_back(
        gallery_.not_this_person(face.identity.label, seen, source_name_, stamp()));
    message_ = fmt::format("Not {}: recorded (u: undo)", printable(face.identity.label));
  } catch (const Error& error) {  // forgotten meanwhile, or the gallery is locked
    message_ = error.what();
  }
  follow();
  identity_.clear_pooled_templates();
  face.identity = {};
}

void PeopleSession::undo() {
  if (corrections_.empty()) {
    message_ = "this window has no correction to undo";
    return;
  }
  const std::int64_t id = corrections_.back();
  corrections_.pop_back();
  try {
    (void)gallery_.undo(id, stamp());
    message_ = fmt::format("Correction {} undone", id);
  } catch (const Error& error) {  // undone by another program, or the gallery is locked
    message_ = error.what();
  }
  on_correction();
}

void PeopleSession::click(cv::Point at) {
  if (is_confirming_) {  // only its own buttons answer the question
    if (button_box("confirm").contains(at)) return act("confirm");
    return act("cancel");
  }
  if (act_in_panel([&] { return panel_.click(at); })) return;
  for (const char* button : {"add", "delete", "debug"})
    if (button_box(button).contains(at)) return act(button);
  for (std::size_t i = 0; i < people_.size(); ++i)
    if (strip_box(i).contains(at)) return collect_for(static_cast<int>(i));
  if (panel_.is_open()) return panel_.close();
  end_collecting();
}

void PeopleSession::add_person() {
  // At most one person without faces: use it again.
  if (pending_.empty()) {
    std::set<std::string> used_names;
    for (const Enrolled& person : people_) used_names.insert(person.name);
    for (const std::string& name : options_.names) {
      if (used_names.contains(name)) continue;
      pending_ = name;
      break;
    }
    for (int number = 1; pending_.empty(); ++number) {
      const std::string name = fmt::format("Person {}", number);
      if (!used_names.contains(name)) pending_ = name;
    }
    people_.push_back({pending_, 0, {}});
  }
  collect_for(static_cast<int>(people_.size()) - 1);
}

void PeopleSession::collect_for(int person) {
  panel_.close();
  collecting_ = person;
  collector_ = face::people::Collector(options_.collect);
  mode_ = PeopleMode::kCollect;
  message_.clear();
  faces_.clear();
  groups_.clear();
}

void PeopleSession::end_collecting() {
  if (mode_ != PeopleMode::kCollect) return;
  collecting_ = -1;
  mode_ = PeopleMode::kDetect;
  if (gallery_.face_count_up_to(1) == 0) {
    message_ = "no face was collected yet";
    return;
  }
  train();
}

void PeopleSession::delete_all() {
  training_.reset();
  grouping_.reset();
  panel_.close();
  const std::vector<face::people::Person> people = gallery_.people();
  const auto report = gallery_.forget_all({});
  if (report) {
    for (const face::people::Person& person : people) forgotten_.push_back(person.name);
  }
  pending_.clear();
  collecting_ = -1;
  identity_.replace(std::nullopt);
  load_people();
  count_unknown();
  mode_ = PeopleMode::kDetect;
  if (!report) {
    message_ = "nobody is enrolled";
  } else if (report->proven()) {
    message_ = fmt::format("all people deleted; {} files searched, no copy is left",
                           report->search.files.size());
  } else if (!report->search.files_with_pieces.empty()) {
    message_ = "all people deleted, but copies of faces are left: " +
               printable(report->search.files_with_pieces.front());
  } else {
    message_ = "all people deleted, but remaining copies cannot be ruled out";
  }
}

}  // namespace tarsier
