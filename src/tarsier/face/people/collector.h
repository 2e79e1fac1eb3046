// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/people/face_reader.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <map>
#include <string>

namespace tarsier::face::people {

struct CollectOptions {
  QualityGate gate;
  double min_difference = 0.3;  // videos: min face_difference() to the last accepted face
  double min_seconds = 1;       // videos: min time since the last accepted face
  bool check_quality = true;

  [[nodiscard]] OptionFields fields() {
    return {{"min_difference", min_difference, range(0, 4), "--min-difference",
             "videos: minimum difference from the last face taken"},
            {"min_seconds", min_seconds, range(0, 3600), "--min-seconds",
             "videos: minimum time since the last face taken, s"}};
  }
  void check() const;
};

// Selects the faces of one person that are worth enrolling.
class Collector {
 public:
  explicit Collector(const CollectOptions& options = {});
  // Returns an empty text if the face is accepted, otherwise the reason ("blurred", "too soon",
  // "too similar to the last"). `video`: frames are consecutive; `time` in s.
  std::string offer(const Face& face, double time, bool video);
  // Counts an image that gave no face to offer, with the reason.
  void reject(const std::string& reason) { ++rejected_[reason]; }
  // Forgets the last face. Call for another video or person.
  void reset();

  [[nodiscard]] std::int64_t accepted() const { return accepted_; }
  [[nodiscard]] const std::map<std::string, std::int64_t>& rejected() const { return rejected_; }

 private:
  CollectOptions options_;
  cv::Mat last_;  // classical_face()
  double last_time_ = 0;
  std::int64_t accepted_ = 0;
  std::map<std::string, std::int64_t> rejected_;
};

}  // namespace tarsier::face::people
