// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/quality.h"
#include "tarsier/face/people/retention.h"
#include "tarsier/face/pipelines/identifier.h"
#include "tarsier/media/frame.h"

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace tarsier::cli {

// A face that is lost for this time does not get its number again.
inline constexpr double kMaxLostTime_s = 60;

// Stores in a gallery who was seen, with their faces, and deletes old sightings. In still images
// each face is a sighting. A tracked face is a sighting when it is first known, and when it becomes
// known as another person. It is also one when it stays unknown for two seconds or until it is
// lost. The best of its faces so far is kept. A face whose quality is too low for enrolment (small,
// blurred, turned away) is not kept.
class SightingWriter {
 public:
  // The gallery must outlive this object. `keep_ms` > 0.
  SightingWriter(face::people::Gallery& gallery, std::int64_t keep_ms);

  // `now`: ms since 1970-01-01 UTC. Throws OutputError.
  void frame(const Frame& frame, const std::vector<face::IdentifiedFace>& faces, std::int64_t now);
  // The sighting whose stored face may still be replaced by a better one of this tracked face; 0:
  // none.
  [[nodiscard]] std::int64_t sighting_of(int face) const;
  // Call after the last frame: writes the pending sightings.
  void finish();

 private:
  struct Track {
    std::string known_as;  // name at the last sighting of a known face
    bool written_unknown = false;
    double first_time = 0;  // times of the frames, s
    double last_time = 0;
    std::int64_t since = 0;  // ms since 1970-01-01 UTC
    std::string nearest;     // nearest person while the face is unknown
    double confidence = 0;
    std::string name;  // source name of the frames
    // Best face since the last sighting; without a crop: none was good enough.
    face::people::SightingFace best;
    std::int64_t sighting = 0;  // its stored face may still be replaced by a better one
    double stored = 0;          // quality of its stored face
  };
  // Whether the quality is high enough to keep the face.
  [[nodiscard]] bool is_good(const face::people::Face& face) const;
  void update(Track& track, const face::IdentifiedFace& face, const Frame& frame, std::int64_t now);
  void write(Track& track, std::int64_t time, const std::string& label, bool known);
  void end(Track& track);

  face::people::Gallery& gallery_;
  face::people::SightingRetention retention_;
  face::people::QualityGate gate_;
  std::map<int, Track> tracks_;
  std::string source_;
};

}  // namespace tarsier::cli
