// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/recognition/background_space.h"

#include <fmt/format.h>

#include "ui/face/people_session.h"
#include <algorithm>
#include <utility>

// Unknown faces of `people live`: their groups, and corrections in the lists.
namespace tarsier {
namespace {

// Sightings grouped per frame: a deep template takes about 10 ms.
constexpr int kSightingsPerFrame = 4;
// Frames until the group of a tracked face without a group is searched again.
constexpr int kSearchInterval = 25;

}  // namespace

face::people::CorrectionStamp PeopleSession::stamp() const {
  return {options_.now ? options_.now() : 0, options_.actor};
}

void PeopleSession::count_unknown() {
  group_count_ = static_cast<std::int64_t>(gallery_.groups().size());
  ungrouped_count_ = gallery_.ungrouped_count();
}

void PeopleSession::on_sighting_stored(int face, std::int64_t sighting) {
  TrackedUnknown& one = tracked_unknowns_[face];
  if (one.sighting == sighting) return;
  one.sighting = sighting;
  count_unknown();
}

// Starts grouping pending sightings; the following frames continue it.
void PeopleSession::start_grouping() {
  if (grouping_ || gallery_.ungrouped_count() == 0) return;
  const face::recognition::Background* background = identity_.background();
  if (background == nullptr || background->basis.rows() == 0) {
    message_ = "grouping needs people-background.json, a shipped model";
    return;
  }
  grouping_.emplace(gallery_, *background, face::people::GroupingOptions{});
}

void PeopleSession::continue_grouping() {
  if (!grouping_) return;
  if (grouping_->step({}, kSightingsPerFrame)) {
    ungrouped_count_ = grouping_->pending();
    return;
  }
  const face::people::GroupingReport report = grouping_->report();
  grouping_.reset();
  message_ = fmt::format("{} unknown face{} grouped, {} new group{}", report.assigned,
                         report.assigned == 1 ? "" : "s", report.new_groups,
                         report.new_groups == 1 ? "" : "s");
  for (auto& [id, face] : tracked_unknowns_) face.frames_since_search = 0;
  finder_generation_ = -1;
  count_unknown();
  panel_.refresh();
}

// The group of each unknown face: that of its sighting, else the one that it resembles.
void PeopleSession::find_groups() {
  groups_.assign(faces_.size(), 0);
  std::map<int, TrackedUnknown> still_there;
  const face::recognition::Background* background = identity_.background();
  const bool has_groups =
      group_count_ > 0 && background != nullptr && background->basis.rows() > 0 && !grouping_;
  if (has_groups) {
    if (!finder_) finder_.emplace(gallery_, *background);
    if (const std::int64_t now = gallery_.group_generation(); now != finder_generation_) {
      finder_->invalidate();
      finder_generation_ = now;
      for (auto& [id, face] : tracked_unknowns_) face.frames_since_search = 0;
    }
  }
  const bool names = mode_ == PeopleMode::kRecognize || mode_ == PeopleMode::kDetect;
  for (std::size_t i = 0; i < faces_.size(); ++i) {
    const face::IdentifiedFace& face = faces_[i];
    TrackedUnknown one;
    if (const auto old = tracked_unknowns_.find(face.face.id);
        face.face.id > 0 && old != tracked_unknowns_.end())
      one = old->second;
    if (names && !face.identity.known && has_groups) {
      if (one.frames_since_search == 0) {
        one.group = 0;
        if (one.sighting > 0)
          if (const auto sighting = gallery_.sighting(one.sighting)) one.group = sighting->group;
        if (one.group == 0)
          one.group = finder_->find(face.face.crop, face.face.quality.score(), {});
      }
      one.frames_since_search = (one.frames_since_search + 1) % kSearchInterval;
      groups_[i] = one.group;
    }
    if (face.face.id > 0) still_there[face.face.id] = one;
  }
  tracked_unknowns_ = std::move(still_there);
}

void PeopleSession::name_largest() {
  const auto unknown =
      std::find_if(groups_.begin(), groups_.end(), [](std::int64_t group) { return group > 0; });
  if (unknown == groups_.end()) {
    message_ = "no grouped unknown face in the image (g: group unknown faces)";
    return;
  }
  panel_.name_group(*unknown);
}

bool PeopleSession::act_in_panel(const std::function<bool()>& work) {
  const bool done = work();
  if (std::string panel_message = panel_.take_message(); !panel_message.empty())
    message_ = printable(panel_message);
  for (const std::int64_t id : panel_.take_corrections()) corrections_.push_back(id);
  for (std::string& name : panel_.take_forgotten()) forgotten_.push_back(std::move(name));
  if (panel_.take_changed()) on_correction();
  return done;
}

// A correction was made here: it takes effect now.
void PeopleSession::on_correction() {
  grouping_.reset();  // it may group a sighting that now belongs to a person
  follow();
  reload_people();
  count_unknown();
  panel_.refresh();
  identity_.clear_pooled_templates();
  if (mode_ == PeopleMode::kCollect || training_) return;
  const bool somebody = gallery_.face_count_up_to(1) > 0;
  if (!somebody) {
    identity_.replace(std::nullopt);
    mode_ = PeopleMode::kDetect;
  } else if (gallery_.model_generation() != gallery_.generation()) {
    train();
  }
}

}  // namespace tarsier
