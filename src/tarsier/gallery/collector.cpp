// SPDX-License-Identifier: MIT
#include "tarsier/gallery/collector.h"

#include "tarsier/core/require.h"
#include "tarsier/people_face/classical.h"

#include <vector>

namespace tarsier::people {

void CollectOptions::check() const {
  gate.check();
  TARSIER_REQUIRE(least_difference >= 0 && least_difference <= 4, "difference {}",
                  least_difference);
  TARSIER_REQUIRE(least_seconds >= 0 && least_seconds <= 3600, "{} s", least_seconds);
}

Collector::Collector(const CollectOptions& options) : options_(options) { options_.check(); }

std::string Collector::offer(const Face& face, double time, bool film) {
  const auto refused = [&](const std::string& reason) {
    ++refused_[reason];
    return reason;
  };
  if (options_.check_quality) {
    const std::vector<std::string> flaws = problems(face.quality, options_.gate);
    if (!flaws.empty()) return refused(flaws.front());
  }
  const cv::Mat prepared = classical_face(face.crop);
  if (film && !last_.empty()) {
    if (time - last_time_ < options_.least_seconds) return refused("too soon");
    if (face_difference(prepared, last_) <= options_.least_difference)
      return refused("too much like the last");
  }
  last_ = prepared;
  last_time_ = time;
  ++taken_;
  return "";
}

void Collector::restart() { last_.release(); }

}  // namespace tarsier::people
