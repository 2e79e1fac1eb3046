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
bool is_duplicate(const cv::Rect& a, const cv::Rect& b) {
  const double overlap = (a & b).area();
  const double smaller = std::max(1, std::min(a.area(), b.area()));
  return overlap / smaller > 0.6;
}

// The readings inside the region, without duplicates, in the order of falling confidence.
std::vector<const Reading*> unique_readings(const TrackerOptions& options,
                                            const TrackedFrame& frame) {
  std::vector<const Reading*> readings;
  for (const Reading& reading : frame.readings) {
    if (reading.text.empty() || reading.box.empty()) continue;
    const bool inside =
        options.region.corners.empty() || !options.region.relative || !frame.image.empty();
    TARSIER_REQUIRE(inside, "a region in shares of an image that is not there");
    if (options.region.contains_center(reading.box, frame.image.size()))
      readings.push_back(&reading);
  }
  std::stable_sort(readings.begin(), readings.end(), [](const Reading* a, const Reading* b) {
    return a->confidence > b->confidence;
  });
  std::vector<const Reading*> unique;
  for (const Reading* reading : readings) {
    const bool is_known = std::any_of(unique.begin(), unique.end(), [&](const Reading* other) {
      return is_duplicate(other->box, reading->box);
    });
    if (!is_known) unique.push_back(reading);
  }
  return unique;
}

// The vehicle of each reading, or null: one to one by falling score.
std::vector<Track*> assign(const std::vector<const Reading*>& readings, TrackerState& state,
                           const TrackerOptions& options) {
  std::vector<std::tuple<double, std::size_t, std::size_t>> pairs;
  for (std::size_t t = 0; t < state.tracks.size(); ++t) {
    for (std::size_t r = 0; r < readings.size(); ++r) {
      const double value = match_score(*state.tracks[t], *readings[r], state.time, options);
      if (value >= 0) pairs.emplace_back(-value, t, r);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  std::vector<Track*> assigned_tracks(readings.size(), nullptr);
  std::vector<bool> is_assigned(state.tracks.size(), false);
  for (const auto& [cost, t, r] : pairs) {
    if (assigned_tracks[r] != nullptr || is_assigned[t]) continue;
    assigned_tracks[r] = state.tracks[t].get();
    is_assigned[t] = true;
  }
  return assigned_tracks;
}

// Merges a returned vehicle into its earlier track.
void merge_returned(TrackerState& state, const TrackerOptions& options) {
  for (std::size_t later = 0; later < state.tracks.size(); ++later) {
    if (!state.tracks[later]->is_in_latest_frame ||
        state.tracks[later]->frames < options.min_readings) {
      continue;
    }
    for (std::size_t earlier = 0; earlier < state.tracks.size(); ++earlier) {
      if (earlier == later ||
          !is_same_vehicle(*state.tracks[earlier], *state.tracks[later], options)) {
        continue;
      }
      if (state.tracks[later]->reported) {
        state.withdrawn.push_back(event_of(*state.tracks[later], PlateState::kWithdrawn));
        state.withdrawn.back().merged_into = state.tracks[earlier]->id;
      }
      merge_earlier(*state.tracks[later], std::move(*state.tracks[earlier]), options);
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
std::vector<PlateEvent> remove_tracks(TrackerState& state, const TrackerOptions& options,
                                      const Condition& is_over) {
  std::vector<PlateEvent> events;
  for (std::unique_ptr<Track>& track : state.tracks) {
    if (!is_over(*track)) continue;
    vote_now(*track, options);
    if (is_confirmed(*track, options)) {
      events.push_back(event_of(*track, PlateState::kClosed));
    } else if (track->reported) {
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
  for (const auto& track : state.tracks) track->is_in_latest_frame = false;
  const std::vector<const Reading*> readings = unique_readings(options, frame);
  const std::vector<Track*> assigned_tracks = assign(readings, state, options);
  for (std::size_t r = 0; r < readings.size(); ++r) {
    Track* track = assigned_tracks[r];
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
  return remove_tracks(state, options, [&](const Track& track) {
    return state.time - track.last_time > close_timeout(track, options);
  });
}

std::vector<PlateEvent> flush_tracker(const TrackerOptions& options, TrackerState& state) {
  options.check();
  return remove_tracks(state, options, [](const Track&) { return true; });
}

std::vector<PlateEvent> take_updates(const TrackerOptions& options, TrackerState& state) {
  std::vector<PlateEvent> updates;
  for (const auto& track : state.tracks) {
    if (!is_confirmed(*track, options)) continue;
    const bool read_since = track->last_time > track->reported_last_time;
    const bool out_of_sight = state.time - track->last_time > options.lost_after;
    const bool due = !track->reported || text_of(*track) != track->reported_text ||
                     (read_since && (out_of_sight || state.time >= track->next_update));
    if (!due) continue;
    updates.push_back(
        event_of(*track, track->reported ? PlateState::kUpdated : PlateState::kOpened));
    track->reported = true;
    track->reported_text = text_of(*track);
    track->reported_last_time = track->last_time;
    track->next_update = state.time + std::clamp(0.5 * (track->last_time - track->first_time),
                                                 kMinUpdate, kMaxUpdate);
  }
  sort_by_time(updates);
  std::move(state.withdrawn.begin(), state.withdrawn.end(), std::back_inserter(updates));
  state.withdrawn.clear();
  return updates;
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
    LiveTrack live_track;
    live_track.id = track->id;
    live_track.box = predicted_box(*track, state.time);
    live_track.read = track->is_in_latest_frame;
    live_track.text = text_of(*track);
    live_track.confidence = confidence_of(*track);
    live_track.country = track->voted.empty() ? "" : track->voted.front().country;
    live_track.first_time = track->first_time;
    live_track.frames = track->frames;
    live_track.confirmed = is_confirmed(*track, options);
    live.push_back(std::move(live_track));
  }
  return live;
}

}  // namespace tarsier::plate
