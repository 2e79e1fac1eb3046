// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string_view>

namespace tarsier {

// Takes named intermediate images of an algorithm, in the order of its stages. Algorithms get a
// DebugSink* that is null by default; `--debug-dir` and the debug views of sessions implement it.
class DebugSink {
 public:
  virtual ~DebugSink() = default;
  // `image` is only valid during the call (its buffer may be reused): clone it to keep it.
  virtual void image(std::string_view name, const cv::Mat& image) = 0;
  // Whether somebody looks now. Viewers of a session come and go.
  [[nodiscard]] virtual bool is_watched() const { return true; }
};

// `sink` where somebody looks, else null: stages that nobody sees are not made.
[[nodiscard]] inline DebugSink* watched(DebugSink* sink) {
  return sink != nullptr && sink->is_watched() ? sink : nullptr;
}

}  // namespace tarsier
