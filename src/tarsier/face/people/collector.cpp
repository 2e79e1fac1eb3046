// SPDX-License-Identifier: MIT
#include "tarsier/face/people/collector.h"

#include "tarsier/face/people/classical.h"

#include <vector>

namespace tarsier::face::people {

void CollectOptions::check() const {
  check_fields(*this);
  gate.check();
}

Collector::Collector(const CollectOptions& options) : options_(options) { options_.check(); }

std::string Collector::offer(const Face& face, double time, bool video) {
  const auto rejected = [&](const std::string& reason) {
    ++rejected_[reason];
    return reason;
  };
  if (options_.check_quality) {
    if (!face.trusted) return rejected("uncertain face");
    const std::vector<std::string> flaws = quality_problems(face.quality, options_.gate);
    if (!flaws.empty()) return rejected(flaws.front());
  }
  const cv::Mat prepared = classical_face(face.crop);
  if (video && !last_.empty()) {
    if (time - last_time_ < options_.min_seconds) return rejected("too soon");
    if (face_difference(prepared, last_) <= options_.min_difference)
      return rejected("too similar to the last");
  }
  last_ = prepared;
  last_time_ = time;
  ++accepted_;
  return "";
}

void Collector::reset() { last_.release(); }

}  // namespace tarsier::face::people
