// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/pipelines/identifier.h"
#include "tarsier/media/frame.h"

#include "framework/on_event.h"
#include <map>
#include <string>
#include <vector>

namespace tarsier::cli {

// Of --csv: one row a face and frame; the box in px.
inline constexpr const char* kFaceColumns =
    "frame,time,image,face,label,confidence,known,x,y,width,height";
[[nodiscard]] std::vector<std::string> face_rows(const Frame& frame,
                                                 const std::vector<face::NamedFace>& faces);

// Tells each new recognition once: of stills every known face, of videos a face when it is first
// known, or known as somebody else. {"event":"person", ..}.
class RecognitionEvents {
 public:
  // `on_event` must outlive it.
  explicit RecognitionEvents(OnEvent& on_event) : on_event_(on_event) {}
  void frame(const Frame& frame, const std::vector<face::NamedFace>& faces);

 private:
  struct Reported {
    std::string what;
    double time = 0;  // when it was last seen, s
  };
  OnEvent& on_event_;
  std::map<int, Reported> reported_;
  std::string source_;
};

}  // namespace tarsier::cli
