// SPDX-License-Identifier: MIT
#include "verbs/people/sightings.h"

#include "tarsier/media/still_source.h"

#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

constexpr double kMinUnknownTime_s = 2;  // a face that is unknown for this time is a sighting
// A better face replaces the stored one if its quality is higher by this factor.
constexpr double kMinQualityRatio = 1.15;

face::people::SightingFace seen(const face::people::Face& face) {
  return {face.crop.clone(), face.quality.score(), face::people::quality_json(face.quality).dump()};
}

}  // namespace

SightingWriter::SightingWriter(face::people::Gallery& gallery, std::int64_t keep_ms)
    : gallery_(gallery), retention_(gallery, keep_ms) {}

bool SightingWriter::is_good(const face::people::Face& face) const {
  return face.trusted && face::people::quality_problems(face.quality, gate_).empty();
}

void SightingWriter::write(Track& track, std::int64_t time, const std::string& label, bool known) {
  const bool has_face = !track.best.crop.empty();
  track.sighting = gallery_.add_sighting(time, track.name, label, known, track.confidence,
                                         has_face ? &track.best : nullptr);
  track.stored = has_face ? track.best.quality : 0;
  if (!has_face) track.sighting = 0;
}

void SightingWriter::end(Track& track) {
  if (track.known_as.empty() && !track.written_unknown)
    write(track, track.since, track.nearest, false);
}

void SightingWriter::update(Track& track, const face::IdentifiedFace& face, const Frame& frame,
                            std::int64_t now) {
  track.last_time = frame.time;
  track.name = frame.name;
  track.confidence = face.identity.confidence;
  const bool has_face = is_good(face.face);
  const bool changed = face.identity.known && face.identity.label != track.known_as;
  if (changed && !track.known_as.empty()) track.best = {};  // these faces may be of either person
  if (has_face && (track.best.crop.empty() || face.face.quality.score() > track.best.quality))
    track.best = seen(face.face);
  if (changed) {
    write(track, now, face.identity.label, true);
    track.known_as = face.identity.label;
    return;
  }
  if (!face.identity.known) track.nearest = face.identity.label;
  if (track.known_as.empty() && !track.written_unknown &&
      frame.time - track.first_time >= kMinUnknownTime_s) {
    write(track, track.since, track.nearest, false);
    track.written_unknown = true;
    return;
  }
  if (track.sighting > 0 && track.best.quality >= kMinQualityRatio * track.stored) {
    if (!gallery_.improve_sighting(track.sighting, track.best)) track.sighting = 0;
    track.stored = track.best.quality;
  }
}

void SightingWriter::frame(const Frame& frame, const std::vector<face::IdentifiedFace>& faces,
                           std::int64_t now) {
  const std::string source = source_of(frame);
  if (frame.still || source != source_) finish();
  source_ = source;
  for (const face::IdentifiedFace& face : faces) {
    if (!frame.still && face.face.id > 0) {
      const auto [track, fresh] = tracks_.try_emplace(face.face.id);
      if (fresh) {
        track->second.first_time = frame.time;
        track->second.since = now;
      }
      update(track->second, face, frame, now);
      continue;
    }
    if (!face.face.trusted && !face.identity.known) continue;  // it may be no face
    Track track;
    track.name = frame.name;
    track.confidence = face.identity.confidence;
    if (is_good(face.face)) track.best = seen(face.face);
    write(track, now, face.identity.label, face.identity.known);
  }
  for (auto track = tracks_.begin(); track != tracks_.end();) {
    if (frame.time - track->second.last_time <= kMaxLostTime_s) {
      ++track;
      continue;
    }
    end(track->second);
    track = tracks_.erase(track);
  }
  (void)retention_.step(now);
}

std::int64_t SightingWriter::sighting_of(int face) const {
  const auto track = tracks_.find(face);
  return track == tracks_.end() ? 0 : track->second.sighting;
}

void SightingWriter::finish() {
  for (auto& [id, track] : tracks_) end(track);
  tracks_.clear();
}

}  // namespace tarsier::cli
