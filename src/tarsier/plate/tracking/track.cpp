// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/track.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/statistics.h"
#include "tarsier/plate/text/text.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <utility>

namespace tarsier::plate {
namespace {

constexpr double kMaxCoasting = 1.0;  // s for which the motion is predicted without a reading
constexpr double kParkedAfter = 3.0;  // s
constexpr double kUnconfirmedTimeout = 3.0;  // s for which a hardly read vehicle is remembered
// Characters; shorter texts are too common to identify a vehicle.
constexpr std::size_t kMinDistinctiveText = 5;
constexpr std::int64_t kMinLongTrackReadings = 10;
constexpr double kMinLongTrackAgreement = 0.6;

// The lengths below are in plate widths, so they do not depend on the distance.
constexpr double kMaxDistance = 0.6;                // from the predicted position
constexpr double kMaxDistancePerSecond = 3;         // for a vehicle with known motion
constexpr double kMaxDistancePerSecondOfNew = 10;   // the same for one read only once
constexpr double kMaxJumpPerSecond = 15;            // for nearly the same text
constexpr double kMaxJumpPerSecondOfSameText = 40;  // for the same text

cv::Point2d center_of(const cv::Rect& box) {
  return {box.x + 0.5 * (box.width - 1), box.y + 0.5 * (box.height - 1)};
}

double quality_of(const TrackReading& reading) {
  return weight_of(reading.ballot, 0) * std::max(reading.ballot.height_px, 1.0);
}

void move_to(Track& track, const cv::Rect& box, double time) {
  const cv::Point2d center = center_of(box);
  const double step = time - track.last_time;
  if (track.frames > 0 && step > 1e-3) {
    const cv::Point2d velocity = (center - track.center) / step;
    track.velocity = track.velocity_count == 0 ? velocity : 0.5 * (track.velocity + velocity);
    ++track.velocity_count;
  }
  track.center = center;
  track.size = {std::max(1.0, static_cast<double>(box.width)),
                std::max(1.0, static_cast<double>(box.height))};
  if (track.frames == 0 || cv::norm(center - track.anchor) > 0.5 * track.size.width) {
    track.anchor = center;
    track.anchor_time = time;
  }
}

// Removes the least informative readings between the first and the last.
void drop_weakest(std::vector<TrackReading>& readings, std::size_t max_size) {
  while (readings.size() > max_size) {
    const auto worst = std::min_element(
        readings.begin() + 1, readings.end() - 1,
        [](const TrackReading& a, const TrackReading& b) { return quality_of(a) < quality_of(b); });
    readings.erase(worst);
  }
}

bool same_text(const std::string& a, const std::string& b) {
  return a.size() >= kMinDistinctiveText && fold_symbols(a) == fold_symbols(b);
}

bool has_digit(const std::string& text) {
  return text.find_first_of("0123456789") != std::string::npos;
}

bool is_candidate(const std::string& text, const std::vector<Candidate>& candidates) {
  return std::any_of(candidates.begin(), candidates.end(),
                     [&](const Candidate& candidate) { return candidate.text == text; });
}

}  // namespace

const std::string& text_of(const Track& track) {
  static const std::string kNone;
  return track.voted.empty() ? kNone : track.voted.front().text;
}

double confidence_of(const Track& track) {
  return track.voted.empty() ? 0 : track.voted.front().confidence;
}

void add_reading(Track& track, const Reading& reading, const TrackedFrame& frame, double time,
                 const TrackerOptions& options) {
  move_to(track, reading.box, time);
  if (track.frames == 0) {
    track.first_time = time;
    track.first_uptime = frame.moment.uptime;
    track.source = frame.source;
  }
  track.last_time = time;
  track.last_seen = frame.moment;
  track.is_in_latest_frame = true;
  ++track.frames;
  if (!has_digit(reading.text)) ++track.readings_without_digit;
  track.plate_odds += log_odds(reading.plate);
  track.readings.push_back(
      {{frame.index, time, reading.text, reading.confidence, reading.box}, ballot_of(reading)});
  track.max_confidence = std::max(track.max_confidence, reading.confidence);
  const double quality = quality_of(track.readings.back());
  if (quality > track.best_quality) {
    track.best_quality = quality;
    track.best_frame = frame.index;
    track.best_time = time;
    track.best_box = reading.box;
    if (!frame.image.empty()) track.best_crop = plate_crop(frame.image, reading.box);
  }
  drop_weakest(track.readings, static_cast<std::size_t>(options.max_readings));
}

cv::Rect2d predicted_box(const Track& track, double time) {
  const double step = std::clamp(time - track.last_time, 0.0, kMaxCoasting);
  const cv::Point2d center = track.center + track.velocity * step;
  return {center.x - 0.5 * track.size.width, center.y - 0.5 * track.size.height, track.size.width,
          track.size.height};
}

bool is_parked(const Track& track) { return track.last_time - track.anchor_time >= kParkedAfter; }

void vote_now(Track& track, const TrackerOptions& options) {
  std::vector<Ballot> ballots;
  ballots.reserve(track.readings.size());
  for (const TrackReading& item : track.readings) ballots.push_back(item.ballot);
  track.voted = vote(ballots, options.voting);
  double sum = 0;
  for (const TrackReading& item : track.readings) {
    sum += text_similarity(item.reading.text, text_of(track));
  }
  track.agreement = track.readings.empty() ? 0 : sum / static_cast<double>(track.readings.size());
}

void vote_if_due(Track& track, const TrackerOptions& options) {
  if (track.frames <= 10 || track.frames % 5 == 0) vote_now(track, options);
}

bool is_confirmed(const Track& track, const TrackerOptions& options) {
  if (track.frames < options.min_readings || track.voted.empty()) return false;
  // A sign remains a sign even if the vote, in which texts without a digit have a low weight,
  // selects a similar layout with a digit (a D as 0).
  const bool is_word =
      !has_digit(text_of(track)) || 2 * track.readings_without_digit > track.frames;
  if (track.max_confidence < options.min_single || (is_word && !options.words)) return false;
  const bool never_moved = is_parked(track) && track.anchor_time - track.first_time < kParkedAfter;
  const bool has_moved = track.anchor_time > track.first_time;
  const double odds = track.plate_odds / static_cast<double>(track.frames);
  if ((never_moved || !has_moved) && odds < options.min_standing_odds) return false;
  if (never_moved) return confidence_of(track) >= options.min_standing;
  // A moving track with consistent readings over a long time is a plate, even if its text is
  // uncertain.
  const bool is_long_track =
      track.frames >= kMinLongTrackReadings && track.agreement >= kMinLongTrackAgreement;
  return is_long_track || confidence_of(track) >= options.min_confidence;
}

void merge_earlier(Track& track, Track&& earlier, const TrackerOptions& options) {
  track.id = earlier.id;
  track.first_time = earlier.first_time;
  track.first_uptime = earlier.first_uptime;
  track.source = earlier.source;
  track.reported = earlier.reported;
  track.reported_text = earlier.reported_text;
  track.reported_last_time = earlier.reported_last_time;
  track.next_update = track.last_time;  // report the merged data soon
  track.frames += earlier.frames;
  track.readings_without_digit += earlier.readings_without_digit;
  track.plate_odds += earlier.plate_odds;
  track.max_confidence = std::max(track.max_confidence, earlier.max_confidence);
  if (cv::norm(track.anchor - earlier.anchor) <= 0.5 * track.size.width) {
    track.anchor_time = earlier.anchor_time;
  }
  std::move(track.readings.begin(), track.readings.end(), std::back_inserter(earlier.readings));
  track.readings = std::move(earlier.readings);
  if (earlier.best_quality > track.best_quality) {
    track.best_quality = earlier.best_quality;
    track.best_frame = earlier.best_frame;
    track.best_time = earlier.best_time;
    track.best_box = earlier.best_box;
    track.best_crop = earlier.best_crop;
  }
  drop_weakest(track.readings, static_cast<std::size_t>(options.max_readings));
  vote_now(track, options);
}

PlateEvent event_of(const Track& track, PlateState state) {
  PlateEvent event;
  event.id = track.id;
  event.state = state;
  event.source = track.source;
  event.text = text_of(track);
  event.confidence = confidence_of(track);
  event.country = track.voted.empty() ? "" : track.voted.front().country;
  event.candidates = track.voted;
  event.first_time = track.first_time;
  event.last_time = track.last_time;
  // Computed from the end backwards: after a clock correction only the present wall clock is right,
  // and the duration of the stay comes from the monotonic clock.
  event.last_seen = track.last_seen.wall;
  event.first_seen = event.last_seen - std::max(track.last_seen.uptime - track.first_uptime,
                                                std::chrono::milliseconds(0));
  event.synchronized = track.last_seen.synchronized;
  event.frames = track.frames;
  for (const TrackReading& item : track.readings) event.readings.push_back(item.reading);
  event.best_frame = track.best_frame;
  event.best_time = track.best_time;
  event.best_box = track.best_box;
  event.best_crop = track.best_crop;
  return event;
}

double text_similarity(const std::string& a, const std::string& b) {
  const std::size_t longest = std::max(a.size(), b.size());
  if (longest == 0) return 0;
  const int edits = edit_distance(fold_symbols(a), fold_symbols(b));
  return 1 - static_cast<double>(edits) / static_cast<double>(longest);
}

double close_timeout(const Track& track, const TrackerOptions& options) {
  if (!is_confirmed(track, options)) {
    return options.lost_after + std::min(options.return_within, kUnconfirmedTimeout);
  }
  return options.lost_after +
         (is_parked(track) ? options.parked_return_within : options.return_within);
}

double match_score(const Track& track, const Reading& reading, double time,
                   const TrackerOptions& options) {
  constexpr double kNoMatch = -1;
  const double elapsed = std::max(time - track.last_time, 0.0);
  if (elapsed > close_timeout(track, options)) return kNoMatch;
  const cv::Rect2d expected = predicted_box(track, time);
  const double width = 0.5 * (track.size.width + reading.box.width);
  const cv::Point2d center{expected.x + 0.5 * expected.width, expected.y + 0.5 * expected.height};
  const double distance = cv::norm(center_of(reading.box) - center) / std::max(width, 1.0);
  const double size_ratio = std::max(track.size.width / std::max(reading.box.width, 1),
                                     reading.box.width / track.size.width);
  double similar = text_similarity(text_of(track), reading.text);
  if (!track.readings.empty()) {
    similar = std::max(similar, text_similarity(track.readings.back().reading.text, reading.text));
  }
  const double overlap = iou(expected, cv::Rect2d(reading.box));

  if (elapsed > options.lost_after) {
    // Was out of view: identified by its text, or by the place where it stood.
    const bool in_place = is_parked(track) &&
                          cv::norm(center_of(reading.box) - track.anchor) < 0.5 * width &&
                          size_ratio < 1.3 && similar >= 0.6;
    const bool returned = elapsed <= options.lost_after + options.return_within &&
                          same_text(text_of(track), reading.text);
    return in_place || returned ? 0.5 * similar : kNoMatch;
  }
  const bool contradicts =
      reading.confidence >= 0.6 && confidence_of(track) >= 0.6 && similar < 0.5;
  if (contradicts || size_ratio > 1.6 + 2 * elapsed) return kNoMatch;
  const double max_distance =
      kMaxDistance +
      elapsed * (track.velocity_count > 0 ? kMaxDistancePerSecond : kMaxDistancePerSecondOfNew);
  const bool near = distance <= max_distance && (distance < 0.8 || similar >= 0.45);
  const bool jumped = (same_text(text_of(track), reading.text) &&
                       distance <= 1 + kMaxJumpPerSecondOfSameText * elapsed) ||
                      (similar >= 0.8 && distance <= 1 + kMaxJumpPerSecond * elapsed);
  if (!near && !jumped) return kNoMatch;
  return std::max(0.0, 1 - distance / max_distance) + similar + 0.5 * overlap;
}

bool is_same_vehicle(const Track& earlier, const Track& later, const TrackerOptions& options) {
  if (earlier.last_time >= later.first_time) return false;  // in view at the same time
  const double gap = later.first_time - earlier.last_time;
  if (gap > close_timeout(earlier, options)) return false;
  const std::string& a = text_of(earlier);
  const std::string& b = text_of(later);
  const double width = 0.5 * (earlier.size.width + later.size.width);
  const bool in_place = is_parked(earlier) && cv::norm(later.center - earlier.anchor) < 0.5 * width;
  if (in_place && text_similarity(a, b) >= 0.6) return true;
  if (gap > options.lost_after + options.return_within) return false;
  if (same_text(a, b)) return true;
  // One character apart: the same only if the worse reading was uncertain about it.
  const bool earlier_is_worse = confidence_of(earlier) < confidence_of(later);
  const Track& worse = earlier_is_worse ? earlier : later;
  return edit_distance(a, b) == 1 && std::min(a.size(), b.size()) >= kMinDistinctiveText &&
         confidence_of(worse) < 0.6 && is_candidate(earlier_is_worse ? b : a, worse.voted);
}

}  // namespace tarsier::plate
