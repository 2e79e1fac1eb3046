// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string_view>

namespace tarsier {

// Receives named intermediate images of an algorithm, in the order of its stages. Algorithms take a
// DebugSink* that is null by default; `--debug-dir` and the debug views of sessions implement it.
class DebugSink {
 public:
  virtual ~DebugSink() = default;
  // `image` is valid only during the call (its buffer may be reused): clone it to keep it.
  virtual void image(std::string_view name, const cv::Mat& image) = 0;
  // Whether anybody looks at the images now. Viewers of a session come and go.
  [[nodiscard]] virtual bool is_watched() const { return true; }
};

// Returns `sink` if it is watched, else null: stages that nobody looks at are not computed.
[[nodiscard]] inline DebugSink* watched(DebugSink* sink) {
  return sink != nullptr && sink->is_watched() ? sink : nullptr;
}

}  // namespace tarsier
