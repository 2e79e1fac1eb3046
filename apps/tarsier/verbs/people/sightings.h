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

// Remembers in a gallery who was seen, with their faces, and forgets what is older. Of stills each
// face is a sighting. A followed face is one when it is first known, or known as somebody else;
// and one that stays unknown for two seconds, or until it is lost. The best of its faces so far is
// kept; one that would not be enrolled (small, blurred, turned away) is not.
class SightingWriter {
 public:
  // The gallery must outlive it. `keep_ms` > 0.
  SightingWriter(face::people::Gallery& gallery, std::int64_t keep_ms);

  // `now`: ms since 1970-01-01 UTC. Throws OutputError.
  void frame(const Frame& frame, const std::vector<face::NamedFace>& faces, std::int64_t now);
  // The sighting whose face a followed face may still make better; 0: none.
  [[nodiscard]] std::int64_t sighting_of(int face) const;
  // No more frames: faces that are still waited for are written.
  void finish();

 private:
  struct Track {
    std::string known_as;  // of the last sighting of a known face
    bool written_unknown = false;
    double first_time = 0;  // of the frames, s
    double last_time = 0;
    std::int64_t since = 0;  // ms since 1970-01-01 UTC
    std::string nearest;     // while it is unknown
    double confidence = 0;
    std::string name;             // of the frames
    face::people::SeenFace best;  // since the last sighting; no crop: none was good enough
    std::int64_t sighting = 0;    // whose face may still become better
    double stored = 0;            // its quality
  };
  // Worth to be kept.
  [[nodiscard]] bool is_good(const face::people::Face& face) const;
  void look(Track& track, const face::NamedFace& face, const Frame& frame, std::int64_t now);
  void write(Track& track, std::int64_t time, const std::string& label, bool known);
  void end(Track& track);

  face::people::Gallery& gallery_;
  face::people::SightingRetention retention_;
  face::people::QualityGate gate_;
  std::map<int, Track> tracks_;
  std::string source_;
};

}  // namespace tarsier::cli
