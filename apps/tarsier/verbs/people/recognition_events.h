// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/pipelines/identifier.h"
#include "tarsier/media/frame.h"

#include "framework/on_event.h"
#include <map>
#include <string>
#include <vector>

namespace tarsier::cli {

// Columns of --csv: one row per face and frame; the box in px.
inline constexpr const char* kFaceColumns =
    "frame,time,image,face,label,confidence,known,x,y,width,height";
[[nodiscard]] std::vector<std::string> face_rows(const Frame& frame,
                                                 const std::vector<face::IdentifiedFace>& faces);

// Reports each recognition once as {"event":"person", ..}. In still images every known face is
// reported. In videos a face is reported when it is first known, and when it becomes known as
// another person.
class RecognitionEvents {
 public:
  // `on_event` must outlive this object.
  explicit RecognitionEvents(OnEvent& on_event) : on_event_(on_event) {}
  void frame(const Frame& frame, const std::vector<face::IdentifiedFace>& faces);

 private:
  struct Reported {
    std::string label;
    double time = 0;  // when the face was last seen, s
  };
  OnEvent& on_event_;
  std::map<int, Reported> reported_;
  std::string source_;
};

}  // namespace tarsier::cli
