// SPDX-License-Identifier: MIT
#include "ui/face/people_panel.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/plate/tracking/time_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <utility>

namespace tarsier {
namespace {

using face::people::Sighting;

constexpr std::size_t kMaxTyped = 80;  // bytes of a typed name
constexpr std::size_t kBestFaces = 8;  // per row
constexpr std::int64_t kMaxCorrections = 100;
constexpr std::size_t kMaxStateRows = 100;

// "2024-05-01 12:30", UTC.
std::string minute(std::int64_t time) {
  std::string text =
      plate::moment_text(plate::Moment(std::chrono::milliseconds(time))).substr(0, 16);
  if (text.size() > 10) text[10] = ' ';
  return text;
}

std::string times(std::int64_t count, std::string_view one) {
  return fmt::format("{} {}{}", count, one, count == 1 ? "" : "s");
}

}  // namespace

std::string_view name_of(PeoplePanel::List list) {
  switch (list) {
    case PeoplePanel::List::kGroups:
      return "groups";
    case PeoplePanel::List::kPeople:
      return "people";
    case PeoplePanel::List::kFacesOfGroup:
      return "faces of group";
    case PeoplePanel::List::kFacesOfPerson:
      return "faces of person";
    case PeoplePanel::List::kCorrections:
      return "corrections";
    case PeoplePanel::List::kNone:
      break;
  }
  return "none";
}

PeoplePanel::PeoplePanel(face::people::Gallery& gallery, Options options)
    : gallery_(gallery), options_(std::move(options)) {}

std::vector<Action> PeoplePanel::actions() {
  return {{"groups", "unknown faces in groups", 'g'},
          {"people", "the people and their faces", 'p'},
          {"log", "what was corrected", 'l'},
          {"up", "lists: the row before", key::kUp},
          {"down", "lists: the row after", key::kDown},
          {"open", "lists: the faces of this row", key::kEnter},
          {"back", "lists: back", key::kBackspace},
          {"mark", "lists: mark this row", 'm'},
          {"name", "who the group is; whose the marked faces are", 'w'},
          {"merge", "lists: the marked rows are this one", 'j'},
          {"split", "lists: the marked faces are somebody else", 's'},
          {"forget", "lists: forget this row (asks)", 'f'}};
}

face::people::CorrectionStamp PeoplePanel::stamp() const {
  return options_.stamp ? options_.stamp() : face::people::CorrectionStamp{};
}

std::string PeoplePanel::take_message() { return std::exchange(message_, {}); }

std::vector<std::int64_t> PeoplePanel::take_corrections() {
  return std::exchange(corrections_, {});
}

bool PeoplePanel::take_changed() { return std::exchange(changed_, false); }

bool PeoplePanel::shows_faces() const {
  return list_ == List::kFacesOfGroup || list_ == List::kFacesOfPerson;
}

void PeoplePanel::shut() {
  list_ = List::kNone;
  typed_.reset();
  asking_ = false;
  refresh();
}

// Resets the selection for another list.
void PeoplePanel::show_from_start() {
  rows_.clear();
  chosen_ = first_ = 0;
  marked_.clear();
  refresh();
}

void PeoplePanel::open(List list) {
  list_ = list_ == list ? List::kNone : list;  // the same key again closes it
  from_ = List::kNone;
  typed_.reset();
  asking_ = false;
  show_from_start();
}

void PeoplePanel::open_faces() {
  const Row* row = chosen();
  if (row == nullptr || (list_ != List::kGroups && list_ != List::kPeople)) return;
  if (list_ == List::kGroups) group_ = row->id;
  if (list_ == List::kPeople) person_ = row->name;
  from_ = list_;
  list_ = list_ == List::kGroups ? List::kFacesOfGroup : List::kFacesOfPerson;
  show_from_start();
}

void PeoplePanel::back() {
  asking_ = false;
  if (shows_faces()) {
    const std::int64_t group = group_;
    const std::string person = person_;
    const List shown = list_;
    list_ = from_;
    show_from_start();
    for (std::size_t i = 0; i < rows_.size(); ++i)
      if (shown == List::kFacesOfGroup ? rows_[i].id == group : rows_[i].name == person)
        chosen_ = i;
    return;
  }
  shut();
}

void PeoplePanel::refresh() {
  const Row* old = chosen();
  const std::int64_t kept = old != nullptr ? old->id : 0;
  rows_.clear();
  best_.clear();
  thumbnails_.clear();
  cells_.clear();
  switch (list_) {
    case List::kGroups:
      for (const auto& group : gallery_.groups())
        rows_.push_back(
            {group.id, fmt::format("Group {}", group.id),
             fmt::format("{}\n{}", times(group.sightings, "sighting"), minute(group.last_time)),
             ""});
      break;
    case List::kPeople: {
      for (const auto& ref : gallery_.face_refs()) {
        std::vector<std::int64_t>& best = best_[ref.person];
        if (best.size() == kBestFaces) best.erase(best.begin());
        best.push_back(ref.id);  // the newest
      }
      for (const auto& person : gallery_.people())
        rows_.push_back(
            {person.id, printable(person.name), times(person.faces, "face"), person.name});
      break;
    }
    case List::kFacesOfGroup:
      for (const Sighting& sighting : gallery_.group_sightings(group_))
        rows_.push_back({sighting.id, std::to_string(sighting.id), minute(sighting.time), ""});
      break;
    case List::kFacesOfPerson:
      if (const auto person = gallery_.find(person_)) {
        gallery_.each_face(person->id, false, [&](face::people::StoredFace&& face) {
          rows_.push_back({face.id, std::to_string(face.id), minute(face.time), ""});
        });
      }
      break;
    case List::kCorrections:
      for (const auto& entry : gallery_.corrections(kMaxCorrections))
        rows_.push_back(
            {entry.id, text_of(entry),
             fmt::format("{}  {}  {}", entry.id, minute(entry.time), printable(entry.actor)), ""});
      break;
    case List::kNone:
      break;
  }
  std::set<std::int64_t> there;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    there.insert(rows_[i].id);
    if (rows_[i].id == kept) chosen_ = i;
  }
  std::erase_if(marked_, [&](std::int64_t id) { return !there.contains(id); });
  if (chosen_ >= rows_.size()) chosen_ = rows_.empty() ? 0 : rows_.size() - 1;
}

const PeoplePanel::Row* PeoplePanel::chosen() const {
  return chosen_ < rows_.size() ? &rows_[chosen_] : nullptr;
}

std::vector<const PeoplePanel::Row*> PeoplePanel::touched() const {
  std::vector<const Row*> out;
  for (const Row& row : rows_)
    if (marked_.contains(row.id)) out.push_back(&row);
  if (out.empty() && chosen() != nullptr) out.push_back(chosen());
  return out;
}

std::vector<std::int64_t> PeoplePanel::touched_ids() const {
  std::vector<std::int64_t> out;
  for (const Row* row : touched()) out.push_back(row->id);
  return out;
}

void PeoplePanel::move(int by) {
  if (rows_.empty()) return;
  const auto last = static_cast<std::ptrdiff_t>(rows_.size()) - 1;
  chosen_ = static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(chosen_) + by, 0, last));
}

bool PeoplePanel::act(std::string_view action) {
  if (typed_) {
    if (action == "up" || action == "down") {
      if (!proposals_.empty()) {
        const std::size_t count = proposals_.size();
        proposal_ = (proposal_ + (action == "down" ? 1 : count - 1)) % count;
        typed_ = proposals_[proposal_];
      }
    } else if (action == "open" || action == "confirm" || action == "name") {
      end_typing();
    } else if (action == "cancel" || action == "back") {
      typed_.reset();
    } else {
      return false;
    }
    return true;
  }
  if (action == "groups" || action == "people" || action == "log") {
    open(action == "groups"   ? List::kGroups
         : action == "people" ? List::kPeople
                              : List::kCorrections);
    return true;
  }
  if (list_ == List::kNone) return false;
  const bool was_asking = std::exchange(asking_, false);
  if (action == "confirm" || action == "cancel") {
    if (was_asking && action == "confirm") forget();
    return was_asking;
  }
  if (action == "up" || action == "down") {
    move(action == "up" ? -1 : 1);
  } else if (action == "open") {
    open_faces();
  } else if (action == "back") {
    back();
  } else if (action == "mark") {
    if (const Row* row = chosen(); row != nullptr && list_ != List::kCorrections)
      if (!marked_.erase(row->id)) marked_.insert(row->id);
  } else if (action == "name") {
    ask_who();
  } else if (action == "merge") {
    merge();
  } else if (action == "split") {
    split();
  } else if (action == "not" && list_ == List::kFacesOfPerson) {
    not_these();
  } else if (action == "undo" && list_ == List::kCorrections) {
    undo();
  } else if (action == "forget") {
    asking_ = chosen() != nullptr && (list_ == List::kGroups || list_ == List::kPeople);
    if (!asking_) message_ = "a group or a person is forgotten in the list of them";
  } else {
    return false;
  }
  return true;
}

bool PeoplePanel::press(const Event& event) {
  if (event.kind != Event::Kind::kKey || event.control) return false;
  if (typed_) {
    if (event.key == key::kEnter) return act("open");
    if (event.key == key::kEscape) return act("cancel");
    if (event.key == key::kUp) return act("up");
    if (event.key == key::kDown) return act("down");
    if (event.key == key::kBackspace) {
      if (!typed_->empty()) typed_->pop_back();
    } else if (event.key >= ' ' && event.key < 127 && typed_->size() < kMaxTyped) {
      // The first typed letter replaces the proposal.
      if (proposal_ < proposals_.size() && *typed_ == proposals_[proposal_]) typed_->clear();
      typed_->push_back(static_cast<char>(event.key));
      proposal_ = proposals_.size();
    }
    return true;
  }
  if (list_ == List::kNone) return false;
  if (event.key == key::kEscape) return act(asking_ ? "cancel" : "back");
  if (event.key == key::kLeft) return act("up");
  if (event.key == key::kRight) return act("down");
  return false;
}

bool PeoplePanel::click(cv::Point at) {
  if (typed_ || list_ == List::kNone) return typed_.has_value();
  asking_ = false;
  for (const Cell& cell : cells_) {
    if (!cell.box.contains(at) || cell.row >= rows_.size()) continue;
    if (cell.row == chosen_) return act("mark");
    chosen_ = cell.row;
    return true;
  }
  return false;
}

std::vector<std::string> PeoplePanel::proposals() const {
  std::vector<std::string> out;
  std::set<std::string> taken;
  std::vector<std::string> enrolled;
  for (const auto& person : gallery_.people()) {
    taken.insert(person.name);
    if (list_ != List::kFacesOfPerson || person.name != person_) enrolled.push_back(person.name);
  }
  for (const std::string& name : options_.names)
    if (!taken.contains(name)) out.push_back(name);
  if (out.empty()) {
    for (int number = 1; out.empty(); ++number)
      if (std::string name = fmt::format("Person {}", number); !taken.contains(name))
        out.push_back(std::move(name));
  }
  out.insert(out.end(), enrolled.begin(), enrolled.end());
  return out;
}

void PeoplePanel::begin_typing(std::vector<std::string> proposals) {
  proposals_ = std::move(proposals);
  proposal_ = 0;
  typed_ = proposals_.empty() ? "" : proposals_.front();
}

void PeoplePanel::name_group(std::int64_t group) {
  group_ = group;
  begin_typing(proposals());
}

void PeoplePanel::ask_who() {
  if (chosen() == nullptr) return;
  switch (list_) {
    case List::kGroups:
      group_ = chosen()->id;
      begin_typing(proposals());
      break;
    case List::kFacesOfGroup:
    case List::kFacesOfPerson:
      begin_typing(proposals());
      break;
    default:
      message_ = "mark people and choose another: merge makes them one";
  }
}

void PeoplePanel::correct(const std::function<void()>& work) {
  try {
    work();
  } catch (const InputError& error) {  // deleted meanwhile, or changed by another program
    message_ = error.what();
  } catch (const UsageError& error) {  // an invalid name
    message_ = error.what();
  }
  refresh();
}

void PeoplePanel::done(std::int64_t correction, std::string message) {
  corrections_.push_back(correction);
  message_ = std::move(message);
  changed_ = true;
}

// The typed text becomes the name of the group, or of the person of the faces.
void PeoplePanel::end_typing() {
  const std::string name = *std::exchange(typed_, std::nullopt);
  correct([&] {
    if (list_ != List::kFacesOfPerson) {
      done(gallery_.name_group(group_, name, options_.note, options_.max_faces, stamp()),
           fmt::format("Group {} is {}", group_, printable(name)));
      if (list_ == List::kFacesOfGroup) back();
      return;
    }
    const std::vector<std::int64_t> faces = touched_ids();
    const std::int64_t id = gallery_.find(name)
                                ? gallery_.move_faces(faces, name, stamp())
                                : gallery_.split_person(person_, faces, name, stamp());
    done(id, fmt::format("{} of {}: {}", times(static_cast<std::int64_t>(faces.size()), "face"),
                         printable(person_), printable(name)));
    marked_.clear();
  });
}

void PeoplePanel::merge() {
  const Row* into = chosen();
  if (into == nullptr || (list_ != List::kGroups && list_ != List::kPeople)) {
    message_ = "groups and people are merged in the lists of them";
    return;
  }
  const Row target = *into;
  std::vector<Row> from;
  for (const Row& row : rows_)
    if (marked_.contains(row.id) && row.id != target.id) from.push_back(row);
  if (from.empty()) {
    message_ = "mark those that are the same as the chosen one first";
    return;
  }
  correct([&] {
    for (const Row& row : from) {
      done(list_ == List::kGroups ? gallery_.merge_groups(row.id, target.id, stamp())
                                  : gallery_.merge_people(row.name, target.name, stamp()),
           fmt::format("{} is {} now", row.title, target.title));
    }
  });
  marked_.clear();
}

void PeoplePanel::split() {
  if (list_ == List::kFacesOfPerson) return ask_who();
  if (list_ != List::kFacesOfGroup || rows_.empty()) {
    message_ = "faces are split off in the list of them";
    return;
  }
  correct([&] {
    const std::vector<std::int64_t> ids = touched_ids();
    done(gallery_.split_group(group_, ids, stamp()),
         fmt::format("{} of group {}: a group of their own",
                     times(static_cast<std::int64_t>(ids.size()), "face"), group_));
    marked_.clear();
  });
}

void PeoplePanel::not_these() {
  correct([&] {
    for (const std::int64_t id : touched_ids())
      done(gallery_.not_this_face(id, stamp()),
           fmt::format("Face {} is not {}", id, printable(person_)));
    marked_.clear();
  });
}

void PeoplePanel::undo() {
  if (chosen() == nullptr) return;
  correct([&] {
    const std::int64_t id = chosen()->id;
    (void)gallery_.undo(id, stamp());
    message_ = fmt::format("Correction {} is undone", id);
    changed_ = true;
  });
}

void PeoplePanel::forget() {
  const Row* row = chosen();
  if (row == nullptr) return;
  const Row gone = *row;
  correct([&] {
    const auto report = list_ == List::kGroups ? gallery_.forget_group(gone.id, {})
                                               : gallery_.forget(gone.name, {});
    changed_ = true;
    message_ =
        !report ? gone.title + " was gone already"
        : report->proven()
            ? fmt::format("{} is forgotten; {} searched, nothing is left", gone.title,
                          times(static_cast<std::int64_t>(report->search.files.size()), "file"))
            : gone.title +
                  " is forgotten; that no copy is left could not be "
                  "proven";
  });
}

nlohmann::json PeoplePanel::state() const {
  if (!is_open()) return nullptr;
  nlohmann::json rows = nlohmann::json::array();
  for (std::size_t i = 0; i < std::min(rows_.size(), kMaxStateRows); ++i)
    rows.push_back({{"id", rows_[i].id},
                    {"title", rows_[i].title},
                    {"marked", marked_.contains(rows_[i].id)}});
  nlohmann::json of;
  if (list_ == List::kFacesOfGroup) of = group_;
  if (list_ == List::kFacesOfPerson) of = person_;
  return {{"list", name_of(list_)},
          {"of", std::move(of)},
          {"rows", std::move(rows)},
          {"chosen", rows_.empty() ? nlohmann::json() : nlohmann::json(chosen_)},
          {"typing", typed_ ? nlohmann::json(*typed_) : nlohmann::json()},
          {"asking", asking_}};
}

const std::vector<std::int64_t>& PeoplePanel::best_faces(const Row& row) {
  const auto [entry, fresh] = best_.try_emplace(row.id);
  if (fresh && list_ == List::kGroups) {
    std::vector<Sighting> seen = gallery_.group_sightings(row.id);
    std::stable_sort(seen.begin(), seen.end(),
                     [](const Sighting& a, const Sighting& b) { return a.quality > b.quality; });
    for (std::size_t i = 0; i < std::min(seen.size(), kBestFaces); ++i)
      entry->second.push_back(seen[i].id);
  }
  if (fresh && shows_faces()) entry->second.push_back(row.id);
  return entry->second;
}

}  // namespace tarsier
