// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/tracker.h"

#include "tarsier/core/require.h"
#include "tarsier/plate/tracking/track.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <tuple>
#include <utility>

namespace tarsier::plate {
namespace {

constexpr std::size_t kMaxTracks = 1000;

// s between two updates of a vehicle that is read continuously. Writing costs time, and a power
// failure falsifies the end of a long stay only slightly.
constexpr double kMinUpdate = 2;
constexpr double kMaxUpdate = 60;

// A plate may be found twice in a frame.
bool is_double(const cv::Rect& a, const cv::Rect& b) {
  const double common = (a & b).area();
  const double smaller = std::max(1, std::min(a.area(), b.area()));
  return common / smaller > 0.6;
}

// The readings inside the region, without duplicates, in the order of falling confidence.
std::vector<const Reading*> counted_readings(const TrackerOptions& options,
                                             const TrackedFrame& frame) {
  std::vector<const Reading*> readings;
  for (const Reading& reading : frame.readings) {
    if (reading.text.empty() || reading.box.empty()) continue;
    const cv::Point2d center{reading.box.x + 0.5 * (reading.box.width - 1),
                             reading.box.y + 0.5 * (reading.box.height - 1)};
    const bool inside =
        options.region.corners.empty() || !options.region.relative || !frame.image.empty();
    TARSIER_REQUIRE(inside, "a region in shares of an image that is not there");
    if (options.region.contains(center, frame.image.size())) readings.push_back(&reading);
  }
  std::stable_sort(readings.begin(), readings.end(), [](const Reading* a, const Reading* b) {
    return a->confidence > b->confidence;
  });
  std::vector<const Reading*> single;
  for (const Reading* reading : readings) {
    const bool seen = std::any_of(single.begin(), single.end(), [&](const Reading* other) {
      return is_double(other->box, reading->box);
    });
    if (!seen) single.push_back(reading);
  }
  return single;
}

// The vehicle of each reading, or null: one to one by falling score.
std::vector<Track*> assign(const std::vector<const Reading*>& readings, TrackerState& state,
                           const TrackerOptions& options) {
  std::vector<std::tuple<double, std::size_t, std::size_t>> pairs;
  for (std::size_t t = 0; t < state.tracks.size(); ++t) {
    for (std::size_t r = 0; r < readings.size(); ++r) {
      const double value = fit(*state.tracks[t], *readings[r], state.time, options);
      if (value >= 0) pairs.emplace_back(-value, t, r);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  std::vector<Track*> owners(readings.size(), nullptr);
  std::vector<bool> taken(state.tracks.size(), false);
  for (const auto& [cost, t, r] : pairs) {
    if (owners[r] != nullptr || taken[t]) continue;
    owners[r] = state.tracks[t].get();
    taken[t] = true;
  }
  return owners;
}

// Merges a returned vehicle into its earlier track.
void merge_returned(TrackerState& state, const TrackerOptions& options) {
  for (std::size_t later = 0; later < state.tracks.size(); ++later) {
    if (!state.tracks[later]->read_now || state.tracks[later]->frames < options.min_readings) {
      continue;
    }
    for (std::size_t earlier = 0; earlier < state.tracks.size(); ++earlier) {
      if (earlier == later || !is_same(*state.tracks[earlier], *state.tracks[later], options)) {
        continue;
      }
      if (state.tracks[later]->announced) {
        state.withdrawn.push_back(event_of(*state.tracks[later], PlateState::kWithdrawn));
        state.withdrawn.back().merged_into = state.tracks[earlier]->id;
      }
      absorb(*state.tracks[later], std::move(*state.tracks[earlier]), options);
      state.tracks[earlier] = std::move(state.tracks[later]);
      state.tracks.erase(state.tracks.begin() + static_cast<std::ptrdiff_t>(later));
      --later;
      break;
    }
  }
}

void sort_by_time(std::vector<PlateEvent>& events) {
  std::sort(events.begin(), events.end(), [](const PlateEvent& a, const PlateEvent& b) {
    return a.first_time != b.first_time ? a.first_time < b.first_time : a.id < b.id;
  });
}

// Removes the tracks for which is_over is true, and returns the events of those that were vehicles.
template <typename Condition>
std::vector<PlateEvent> take_out(TrackerState& state, const TrackerOptions& options,
                                 const Condition& is_over) {
  std::vector<PlateEvent> events;
  for (std::unique_ptr<Track>& track : state.tracks) {
    if (!is_over(*track)) continue;
    vote_now(*track, options);
    if (is_confirmed(*track, options)) {
      events.push_back(event_of(*track, PlateState::kClosed));
    } else if (track->announced) {
      state.withdrawn.push_back(event_of(*track, PlateState::kWithdrawn));
    }
    track.reset();
  }
  std::erase(state.tracks, nullptr);
  sort_by_time(events);
  return events;
}

}  // namespace

TrackerState::TrackerState() = default;
TrackerState::~TrackerState() = default;
TrackerState::TrackerState(TrackerState&&) noexcept = default;
TrackerState& TrackerState::operator=(TrackerState&&) noexcept = default;

void TrackerOptions::check() const {
  check_fields(*this);
  voting.check();
}

std::vector<PlateEvent> step_tracker(const TrackerOptions& options, TrackerState& state,
                                     const TrackedFrame& frame) {
  options.check();
  TARSIER_REQUIRE(std::isfinite(frame.time), "frame {} at {} s", frame.index, frame.time);
  state.time = state.tracks.empty() ? frame.time : std::max(state.time, frame.time);
  for (const auto& track : state.tracks) track->read_now = false;
  const std::vector<const Reading*> readings = counted_readings(options, frame);
  const std::vector<Track*> owners = assign(readings, state, options);
  for (std::size_t r = 0; r < readings.size(); ++r) {
    Track* track = owners[r];
    if (track == nullptr) {
      if (state.tracks.size() >= kMaxTracks) continue;
      state.tracks.push_back(std::make_unique<Track>());
      track = state.tracks.back().get();
      track->id = state.next_id++;
    }
    add_reading(*track, *readings[r], frame, state.time, options);
    vote_if_due(*track, options);
  }
  merge_returned(state, options);
  return take_out(state, options, [&](const Track& track) {
    return state.time - track.last_time > patience_for(track, options);
  });
}

std::vector<PlateEvent> flush_tracker(const TrackerOptions& options, TrackerState& state) {
  options.check();
  return take_out(state, options, [](const Track&) { return true; });
}

std::vector<PlateEvent> take_news(const TrackerOptions& options, TrackerState& state) {
  std::vector<PlateEvent> news;
  for (const auto& track : state.tracks) {
    if (!is_confirmed(*track, options)) continue;
    const bool read_since = track->last_time > track->announced_last;
    const bool out_of_sight = state.time - track->last_time > options.lost_after;
    const bool due = !track->announced || text_of(*track) != track->announced_text ||
                     (read_since && (out_of_sight || state.time >= track->next_update));
    if (!due) continue;
    news.push_back(event_of(*track, track->announced ? PlateState::kUpdated : PlateState::kOpened));
    track->announced = true;
    track->announced_text = text_of(*track);
    track->announced_last = track->last_time;
    track->next_update = state.time + std::clamp(0.5 * (track->last_time - track->first_time),
                                                 kMinUpdate, kMaxUpdate);
  }
  sort_by_time(news);
  std::move(state.withdrawn.begin(), state.withdrawn.end(), std::back_inserter(news));
  state.withdrawn.clear();
  return news;
}

void shift_unsynchronized(TrackerState& state, std::chrono::milliseconds by) {
  for (const auto& track : state.tracks) {
    if (!track->last_seen.synchronized) track->last_seen.wall += by;
  }
}

std::vector<LiveTrack> live_tracks(const TrackerOptions& options, const TrackerState& state) {
  std::vector<LiveTrack> live;
  for (const auto& track : state.tracks) {
    if (state.time - track->last_time > options.lost_after) continue;
    LiveTrack shown;
    shown.id = track->id;
    shown.box = predicted_box(*track, state.time);
    shown.read = track->read_now;
    shown.text = text_of(*track);
    shown.confidence = confidence_of(*track);
    shown.country = track->voted.empty() ? "" : track->voted.front().country;
    shown.first_time = track->first_time;
    shown.frames = track->frames;
    shown.confirmed = is_confirmed(*track, options);
    live.push_back(std::move(shown));
  }
  return live;
}

}  // namespace tarsier::plate
