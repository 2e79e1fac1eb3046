// SPDX-License-Identifier: MIT
#include "ui/face/people_panel.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/plate/tracking/time_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

using face::people::Sighting;

constexpr std::size_t kMaxTypedLength = 80;  // bytes of a typed name
constexpr std::size_t kBestFaces = 8;        // per row
constexpr std::int64_t kMaxCorrections = 100;
constexpr std::size_t kMaxStateRows = 100;

// "2024-05-01 12:30", UTC.
std::string date_text(std::int64_t time) {
  std::string text =
      plate::moment_text(plate::Moment(std::chrono::milliseconds(time))).substr(0, 16);
  if (text.size() > 10) text[10] = ' ';
  return text;
}

std::string with_count(std::int64_t count, std::string_view one) {
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
  return {{"groups", "show groups of unknown faces", 'g'},
          {"people", "show people and their faces", 'p'},
          {"log", "show corrections", 'l'},
          {"up", "lists: previous row", key::kUp},
          {"down", "lists: next row", key::kDown},
          {"open", "lists: show the faces of this row", key::kEnter},
          {"back", "lists: back", key::kBackspace},
          {"mark", "lists: mark this row", 'm'},
          {"name", "name the group, or move the marked faces to a person", 'w'},
          {"merge", "lists: merge the marked rows into this one", 'j'},
          {"split", "lists: split off the marked faces", 's'},
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

std::vector<std::string> PeoplePanel::take_forgotten() { return std::exchange(forgotten_, {}); }

bool PeoplePanel::shows_faces() const {
  return list_ == List::kFacesOfGroup || list_ == List::kFacesOfPerson;
}

void PeoplePanel::close() {
  list_ = List::kNone;
  typed_.reset();
  is_confirming_ = false;
  refresh();
}

// Resets the selection for another list.
void PeoplePanel::reset_selection() {
  rows_.clear();
  selected_ = first_ = 0;
  marked_.clear();
  refresh();
}

void PeoplePanel::open(List list) {
  list_ = list_ == list ? List::kNone : list;  // the same key again closes it
  parent_list_ = List::kNone;
  typed_.reset();
  is_confirming_ = false;
  reset_selection();
}

void PeoplePanel::open_faces() {
  const Row* row = selected_row();
  if (row == nullptr || (list_ != List::kGroups && list_ != List::kPeople)) return;
  if (list_ == List::kGroups) group_ = row->id;
  if (list_ == List::kPeople) person_ = row->name;
  parent_list_ = list_;
  list_ = list_ == List::kGroups ? List::kFacesOfGroup : List::kFacesOfPerson;
  reset_selection();
}

void PeoplePanel::back() {
  is_confirming_ = false;
  if (shows_faces()) {
    const std::int64_t group = group_;
    const std::string person = person_;
    const List shown = list_;
    list_ = parent_list_;
    reset_selection();
    for (std::size_t i = 0; i < rows_.size(); ++i)
      if (shown == List::kFacesOfGroup ? rows_[i].id == group : rows_[i].name == person)
        selected_ = i;
    return;
  }
  close();
}

void PeoplePanel::refresh() {
  const Row* old = selected_row();
  const std::int64_t selected_id = old != nullptr ? old->id : 0;
  rows_.clear();
  best_.clear();
  thumbnails_.clear();
  cells_.clear();
  switch (list_) {
    case List::kGroups:
      for (const auto& group : gallery_.groups())
        rows_.push_back({group.id, fmt::format("Group {}", group.id),
                         fmt::format("{}\n{}", with_count(group.sightings, "sighting"),
                                     date_text(group.last_time)),
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
            {person.id, printable(person.name), with_count(person.faces, "face"), person.name});
      break;
    }
    case List::kFacesOfGroup:
      for (const Sighting& sighting : gallery_.group_sightings(group_))
        rows_.push_back({sighting.id, std::to_string(sighting.id), date_text(sighting.time), ""});
      break;
    case List::kFacesOfPerson:
      if (const auto person = gallery_.find(person_)) {
        gallery_.each_face(person->id, false, [&](face::people::StoredFace&& face) {
          rows_.push_back({face.id, std::to_string(face.id), date_text(face.time), ""});
        });
      }
      break;
    case List::kCorrections:
      for (const auto& entry : gallery_.corrections(kMaxCorrections))
        rows_.push_back(
            {entry.id, text_of(entry),
             fmt::format("{}  {}  {}", entry.id, date_text(entry.time), printable(entry.actor)),
             ""});
      break;
    case List::kNone:
      break;
  }
  std::set<std::int64_t> present_ids;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    present_ids.insert(rows_[i].id);
    if (rows_[i].id == selected_id) selected_ = i;
  }
  std::erase_if(marked_, [&](std::int64_t id) { return !present_ids.contains(id); });
  if (selected_ >= rows_.size()) selected_ = rows_.empty() ? 0 : rows_.size() - 1;
}

const PeoplePanel::Row* PeoplePanel::selected_row() const {
  return selected_ < rows_.size() ? &rows_[selected_] : nullptr;
}

std::vector<const PeoplePanel::Row*> PeoplePanel::affected_rows() const {
  std::vector<const Row*> out;
  for (const Row& row : rows_)
    if (marked_.contains(row.id)) out.push_back(&row);
  if (out.empty() && selected_row() != nullptr) out.push_back(selected_row());
  return out;
}

std::vector<std::int64_t> PeoplePanel::affected_ids() const {
  std::vector<std::int64_t> out;
  for (const Row* row : affected_rows()) out.push_back(row->id);
  return out;
}

void PeoplePanel::move(int by) {
  if (rows_.empty()) return;
  const auto last = static_cast<std::ptrdiff_t>(rows_.size()) - 1;
  selected_ = static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(selected_) + by, 0, last));
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
  const bool was_confirming = std::exchange(is_confirming_, false);
  if (action == "confirm" || action == "cancel") {
    if (was_confirming && action == "confirm") forget();
    return was_confirming;
  }
  if (action == "up" || action == "down") {
    move(action == "up" ? -1 : 1);
  } else if (action == "open") {
    open_faces();
  } else if (action == "back") {
    back();
  } else if (action == "mark") {
    if (const Row* row = selected_row(); row != nullptr && list_ != List::kCorrections)
      if (!marked_.erase(row->id)) marked_.insert(row->id);
  } else if (action == "name") {
    begin_naming();
  } else if (action == "merge") {
    merge();
  } else if (action == "split") {
    split();
  } else if (action == "not" && list_ == List::kFacesOfPerson) {
    reject_faces();
  } else if (action == "undo" && list_ == List::kCorrections) {
    undo();
  } else if (action == "forget") {
    is_confirming_ =
        selected_row() != nullptr && (list_ == List::kGroups || list_ == List::kPeople);
    if (!is_confirming_) message_ = "forget works in the lists of groups and people";
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
    } else if (event.key >= ' ' && event.key < 127 && typed_->size() < kMaxTypedLength) {
      // The first typed letter replaces the proposal.
      if (proposal_ < proposals_.size() && *typed_ == proposals_[proposal_]) typed_->clear();
      typed_->push_back(static_cast<char>(event.key));
      proposal_ = proposals_.size();
    }
    return true;
  }
  if (list_ == List::kNone) return false;
  if (event.key == key::kEscape) return act(is_confirming_ ? "cancel" : "back");
  if (event.key == key::kLeft) return act("up");
  if (event.key == key::kRight) return act("down");
  return false;
}

bool PeoplePanel::click(cv::Point at) {
  if (typed_ || list_ == List::kNone) return typed_.has_value();
  is_confirming_ = false;
  for (const Cell& cell : cells_) {
    if (!cell.box.contains(at) || cell.row >= rows_.size()) continue;
    if (cell.row == selected_) return act("mark");
    selected_ = cell.row;
    return true;
  }
  return false;
}

std::vector<std::string> PeoplePanel::proposals() const {
  std::vector<std::string> out;
  std::set<std::string> enrolled_names;
  std::vector<std::string> enrolled;
  for (const auto& person : gallery_.people()) {
    enrolled_names.insert(person.name);
    if (list_ != List::kFacesOfPerson || person.name != person_) enrolled.push_back(person.name);
  }
  for (const std::string& name : options_.names)
    if (!enrolled_names.contains(name)) out.push_back(name);
  if (out.empty()) {
    for (int number = 1; out.empty(); ++number)
      if (std::string name = fmt::format("Person {}", number); !enrolled_names.contains(name))
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

void PeoplePanel::begin_naming() {
  if (selected_row() == nullptr) return;
  switch (list_) {
    case List::kGroups:
      group_ = selected_row()->id;
      begin_typing(proposals());
      break;
    case List::kFacesOfGroup:
    case List::kFacesOfPerson:
      begin_typing(proposals());
      break;
    default:
      message_ = "mark people, select another person, then merge";
  }
}

void PeoplePanel::correct(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {  // deleted or changed by another program, locked; an invalid name
    message_ = error.what();
  }
  refresh();
}

void PeoplePanel::record_correction(std::int64_t correction, std::string message) {
  corrections_.push_back(correction);
  message_ = std::move(message);
  changed_ = true;
}

// The typed text becomes the name of the group, or of the person of the faces.
void PeoplePanel::end_typing() {
  const std::string name = *std::exchange(typed_, std::nullopt);
  correct([&] {
    if (list_ != List::kFacesOfPerson) {
      record_correction(
          gallery_.name_group(group_, name, options_.note, options_.max_faces, stamp()),
          fmt::format("Group {} is {}", group_, printable(name)));
      if (list_ == List::kFacesOfGroup) back();
      return;
    }
    const std::vector<std::int64_t> faces = affected_ids();
    const std::int64_t id = gallery_.find(name)
                                ? gallery_.move_faces(faces, name, stamp())
                                : gallery_.split_person(person_, faces, name, stamp());
    record_correction(id, fmt::format("{} moved from {} to {}",
                                      with_count(static_cast<std::int64_t>(faces.size()), "face"),
                                      printable(person_), printable(name)));
    marked_.clear();
  });
}

void PeoplePanel::merge() {
  const Row* target_row = selected_row();
  if (target_row == nullptr || (list_ != List::kGroups && list_ != List::kPeople)) {
    message_ = "merge works in the lists of groups and people";
    return;
  }
  const Row target = *target_row;
  std::vector<Row> from;
  for (const Row& row : rows_)
    if (marked_.contains(row.id) && row.id != target.id) from.push_back(row);
  if (from.empty()) {
    message_ = "first mark the rows to merge into the selected one";
    return;
  }
  correct([&] {
    for (const Row& row : from) {
      record_correction(list_ == List::kGroups
                            ? gallery_.merge_groups(row.id, target.id, stamp())
                            : gallery_.merge_people(row.name, target.name, stamp()),
                        fmt::format("{} merged into {}", row.title, target.title));
    }
  });
  marked_.clear();
}

void PeoplePanel::split() {
  if (list_ == List::kFacesOfPerson) return begin_naming();
  if (list_ != List::kFacesOfGroup || rows_.empty()) {
    message_ = "split works in the lists of faces";
    return;
  }
  correct([&] {
    const std::vector<std::int64_t> ids = affected_ids();
    record_correction(
        gallery_.split_group(group_, ids, stamp()),
        fmt::format("{} of group {} split off as a new group",
                    with_count(static_cast<std::int64_t>(ids.size()), "face"), group_));
    marked_.clear();
  });
}

void PeoplePanel::reject_faces() {
  correct([&] {
    for (const std::int64_t id : affected_ids())
      record_correction(gallery_.not_this_face(id, stamp()),
                        fmt::format("Face {} is not {}", id, printable(person_)));
    marked_.clear();
  });
}

void PeoplePanel::undo() {
  if (selected_row() == nullptr) return;
  correct([&] {
    const std::int64_t id = selected_row()->id;
    (void)gallery_.undo(id, stamp());
    message_ = fmt::format("Correction {} undone", id);
    changed_ = true;
  });
}

void PeoplePanel::forget() {
  const Row* row = selected_row();
  if (row == nullptr) return;
  const Row gone = *row;
  correct([&] {
    const auto report = list_ == List::kGroups ? gallery_.forget_group(gone.id, {})
                                               : gallery_.forget(gone.name, {});
    changed_ = true;
    if (report && !gone.name.empty()) forgotten_.push_back(gone.name);
    message_ = !report ? gone.title + " was already deleted"
               : report->proven()
                   ? fmt::format(
                         "{} is forgotten; {} searched, no copy is left", gone.title,
                         with_count(static_cast<std::int64_t>(report->search.files.size()), "file"))
                   : gone.title + " is forgotten, but remaining copies cannot be ruled out";
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
          {"chosen", rows_.empty() ? nlohmann::json() : nlohmann::json(selected_)},
          {"typing", typed_ ? nlohmann::json(*typed_) : nlohmann::json()},
          {"asking", is_confirming_}};
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
