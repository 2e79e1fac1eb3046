// SPDX-License-Identifier: MIT
#include "tarsier/face/people/grouping.h"

#include "tarsier/core/stop.h"
#include "tarsier/face/people/group_merging.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/pair_scores.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

namespace tarsier::face::people {
namespace {

using IdTemplate = std::pair<std::int64_t, std::vector<float>>;

constexpr std::size_t kBatch = 64;  // sightings per transaction

}  // namespace

// Templates of sightings, from stored coordinates or computed from their crops. Sightings that were
// removed meanwhile are skipped.
class SightingTemplates {
 public:
  SightingTemplates(Gallery& gallery, const recognition::Background& background,
                    const recognition::Recognizer& model)
      : gallery_(gallery),
        background_(background),
        model_(model),
        space_(-recognition::fingerprint(background)),
        count_(static_cast<std::size_t>(recognition::coordinate_count(background))) {}

  [[nodiscard]] std::vector<float> of_crop(const cv::Mat& crop) const {
    return in_model(recognition::coordinates_of(background_, crop));
  }

  std::vector<IdTemplate> operator()(std::span<const std::int64_t> sightings) {
    std::vector<IdTemplate> out;
    std::vector<IdTemplate> computed;
    std::vector<cv::Mat> crops;
    for (const std::int64_t id : sightings) {
      std::vector<float> numbers = gallery_.sighting_coordinates(id, space_);
      if (numbers.size() == count_) {
        out.emplace_back(id, std::move(numbers));
        continue;
      }
      auto face = gallery_.sighting_face(id);
      if (!face) continue;
      computed.emplace_back(id, std::vector<float>());
      crops.push_back(face->crop);
    }
    cv::parallel_for_({0, static_cast<int>(computed.size())}, [&](const cv::Range& range) {
      for (int i = range.start; i < range.end; ++i)
        computed[static_cast<std::size_t>(i)].second =
            recognition::coordinates_of(background_, crops[static_cast<std::size_t>(i)]);
    });
    if (!computed.empty()) gallery_.store_sighting_coordinates(space_, computed);
    std::move(computed.begin(), computed.end(), std::back_inserter(out));
    std::sort(out.begin(), out.end(),
              [](const IdTemplate& a, const IdTemplate& b) { return a.first < b.first; });
    for (IdTemplate& one : out) one.second = in_model(one.second);
    return out;
  }

 private:
  [[nodiscard]] std::vector<float> in_model(const std::vector<float>& numbers) const {
    const recognition::Rows row = recognition::templates_of_coordinates(
        model_, background_,
        Eigen::Map<const recognition::Rows>(numbers.data(), 1,
                                            static_cast<Eigen::Index>(numbers.size())));
    return {row.data(), row.data() + row.size()};
  }

  Gallery& gallery_;
  const recognition::Background& background_;
  const recognition::Recognizer& model_;
  std::int64_t space_;
  std::size_t count_;
};

namespace {

// Restores the groups from the gallery.
SightingGroups stored_groups(Gallery& gallery, const recognition::PairScores& pairs,
                             const GroupingOptions& options, SightingTemplates& templates,
                             const std::stop_token& stop) {
  SightingGroups groups(pairs, options);
  struct Member {
    std::int64_t sighting;
    std::int64_t group;
    double quality;
  };
  std::vector<Member> members;
  gallery.each_grouped([&](std::int64_t sighting, std::int64_t group, double quality) {
    members.push_back({sighting, group, quality});
  });
  for (std::size_t at = 0; at < members.size(); at += kBatch) {
    throw_if_stopped(stop);
    std::vector<std::int64_t> ids;
    const std::size_t last = std::min(members.size(), at + kBatch);
    for (std::size_t i = at; i < last; ++i) ids.push_back(members[i].sighting);
    std::size_t i = at;
    for (const IdTemplate& one : templates(ids)) {
      while (members[i].sighting != one.first) ++i;
      groups.restore(members[i].group, one.second, members[i].quality);
    }
  }
  for (const auto& [a, b] : gallery.cannot_link_pairs()) groups.add_cannot_link(a, b);
  groups.set_next(gallery.next_group());
  return groups;
}

// Min number of sightings for learning the variation within groups.
constexpr std::size_t kMinTwoPassSightings = 60;

// The first sightings of each group.
GroupTemplates templates_of_groups(Gallery& gallery, SightingTemplates& templates,
                                   const std::stop_token& stop) {
  std::map<std::int64_t, std::vector<std::int64_t>> members;
  gallery.each_grouped([&](std::int64_t sighting, std::int64_t group, double) {
    std::vector<std::int64_t>& of = members[group];
    if (of.size() < static_cast<std::size_t>(kMaxSightingsPerGroup)) of.push_back(sighting);
  });
  GroupTemplates out;
  for (const auto& [group, sightings] : members) {
    throw_if_stopped(stop);
    const std::vector<IdTemplate> faces = templates(sightings);
    if (faces.empty()) continue;
    recognition::Rows rows(static_cast<Eigen::Index>(faces.size()),
                           static_cast<Eigen::Index>(faces.front().second.size()));
    for (std::size_t i = 0; i < faces.size(); ++i)
      rows.row(static_cast<Eigen::Index>(i)) = Eigen::Map<const Eigen::RowVectorXf>(
          faces[i].second.data(), static_cast<Eigen::Index>(faces[i].second.size()));
    out.emplace(group, std::move(rows));
  }
  return out;
}

// Makes one round of merges. False: nothing was merged.
bool merge_round(Gallery& gallery, SightingTemplates& templates, GroupingReport& report,
                 std::set<std::int64_t>& new_groups, const std::stop_token& stop) {
  throw_if_stopped(stop);
  const std::int64_t generation = gallery.group_generation();
  std::set<std::pair<std::int64_t, std::int64_t>> cannot_link;
  for (const auto& [a, b] : gallery.cannot_link_pairs())
    cannot_link.emplace(std::min(a, b), std::max(a, b));
  const std::optional<GroupPairs> merged =
      find_group_merges(templates_of_groups(gallery, templates, stop), cannot_link);
  if (!merged || merged->empty()) return false;
  if (!gallery.store_merges(*merged, generation)) return true;  // a correction was made meanwhile
  report.merged += static_cast<std::int64_t>(merged->size());
  for (const auto& [from, into] : *merged) new_groups.erase(from);
  return true;
}

const GroupingOptions& checked(const GroupingOptions& options) {
  options.check();
  return options;
}

}  // namespace

struct SightingGrouping::Work {
  Work(Gallery& of, const recognition::Background& background, const GroupingOptions& options)
      : gallery(of),
        pairs(recognition::pair_scores(background)),
        templates(of, background, pairs.model),
        first_pass(options),
        generation(of.group_generation()),
        pending(of.ungrouped()) {
    std::size_t sightings = pending.size();
    of.each_grouped([&](std::int64_t, std::int64_t, double) { ++sightings; });
    two_passes = options.false_merges == 0 && sightings >= kMinTwoPassSightings &&
                 pairs.model.options.algorithm != recognition::Algorithm::kDeep;
    if (two_passes) first_pass.false_merges = kFirstPassFalseMergeRate;
  }

  // Places some sightings; false: none is left.
  bool assign(const std::stop_token& stop, std::size_t max_sightings) {
    if (!groups) groups = stored_groups(gallery, pairs, first_pass, templates, stop);
    if (at >= pending.size()) return false;
    throw_if_stopped(stop);
    const std::size_t last = std::min(pending.size(), at + max_sightings);
    const std::vector<IdTemplate> faces = templates(std::span(pending).subspan(at, last - at));
    std::vector<Gallery::SightingAssignment> assigned;
    std::set<std::int64_t> now = new_groups;
    for (const IdTemplate& face : faces) {
      const auto seen = gallery.sighting_face(face.first);
      if (!seen) continue;
      GroupAssignment assignment = groups->add(face.second, seen->quality);
      if (assignment.is_new) now.insert(assignment.group);
      for (const auto& [from, into] : assignment.merged) now.erase(from);
      assigned.push_back({face.first, assignment.group, std::move(assignment.merged)});
    }
    if (!gallery.store_assignments(assigned, groups->next(), generation)) {
      // The gallery was changed meanwhile: read the current state.
      generation = gallery.group_generation();
      pending = gallery.ungrouped();
      groups.reset();
      at = 0;
      return true;
    }
    ++generation;
    new_groups = std::move(now);
    for (const Gallery::SightingAssignment& one : assigned)
      report.merged += static_cast<std::int64_t>(one.merged.size());
    report.assigned += static_cast<std::int64_t>(assigned.size());
    at = last;
    return true;
  }

  bool step(const std::stop_token& stop, std::size_t max_sightings) {
    if (done) return false;
    if (assign(stop, max_sightings)) return true;
    report.threshold = groups->threshold();
    if (two_passes && merge_round(gallery, templates, report, new_groups, stop)) return true;
    report.new_groups = static_cast<std::int64_t>(new_groups.size());
    report.groups = static_cast<std::int64_t>(gallery.groups().size());
    done = true;
    return false;
  }

  Gallery& gallery;
  recognition::PairScores pairs;
  SightingTemplates templates;
  GroupingOptions first_pass;
  std::int64_t generation;
  std::vector<std::int64_t> pending;
  std::size_t at = 0;  // index into `pending`
  std::optional<SightingGroups> groups;
  std::set<std::int64_t> new_groups;
  bool two_passes = false;
  bool done = false;
  GroupingReport report;
};

SightingGrouping::SightingGrouping(Gallery& gallery, const recognition::Background& background,
                                   const GroupingOptions& options)
    : work_(std::make_unique<Work>(gallery, background, checked(options))) {}
SightingGrouping::~SightingGrouping() = default;
SightingGrouping::SightingGrouping(SightingGrouping&&) noexcept = default;
SightingGrouping& SightingGrouping::operator=(SightingGrouping&&) noexcept = default;

bool SightingGrouping::step(const std::stop_token& stop, int max_sightings) {
  return work_->step(stop, static_cast<std::size_t>(std::max(1, max_sightings)));
}

std::int64_t SightingGrouping::pending() const {
  return static_cast<std::int64_t>(work_->pending.size() - work_->at);
}

const GroupingReport& SightingGrouping::report() const { return work_->report; }

GroupingReport group_sightings(Gallery& gallery, const recognition::Background& background,
                               const GroupingOptions& options, Progress& progress,
                               const std::stop_token& stop) {
  SightingGrouping grouping(gallery, background, options);
  progress.begin("grouping", grouping.pending(), "faces");
  for (bool more = true; more;) {
    const std::int64_t before = grouping.pending();
    more = grouping.step(stop, static_cast<int>(kBatch));
    progress.advance(std::max<std::int64_t>(0, before - grouping.pending()));
  }
  progress.end();
  return grouping.report();
}

struct GroupFinder::Work {
  Work(Gallery& of, const recognition::Background& background)
      : gallery(of),
        pairs(recognition::pair_scores(background)),
        templates(of, background, pairs.model) {}
  Gallery& gallery;
  recognition::PairScores pairs;
  SightingTemplates templates;
  std::optional<SightingGroups> groups;
};

GroupFinder::GroupFinder(Gallery& gallery, const recognition::Background& background)
    : work_(std::make_unique<Work>(gallery, background)) {}
GroupFinder::~GroupFinder() = default;
GroupFinder::GroupFinder(GroupFinder&&) noexcept = default;
GroupFinder& GroupFinder::operator=(GroupFinder&&) noexcept = default;

void GroupFinder::invalidate() { work_->groups.reset(); }

std::int64_t GroupFinder::find(const cv::Mat& crop, double quality, const std::stop_token& stop) {
  if (!work_->groups)
    work_->groups = stored_groups(work_->gallery, work_->pairs, {}, work_->templates, stop);
  if (work_->groups->size() == 0) return 0;
  return work_->groups->nearest_group(work_->templates.of_crop(crop), quality);
}

}  // namespace tarsier::face::people
