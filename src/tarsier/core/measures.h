// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"

#include <string_view>

namespace tarsier {

// Progress that also shows values that a stage measures, for example its loss. make_progress()
// returns this kind.
class MeasuredProgress : public Progress {
 public:
  // The value is shown with the next advance(), however soon. In JSON lines it is one more number,
  // "loss":0.31. `name` is a plain word. A value that is not finite is dropped.
  virtual void measure(std::string_view name, double value) = 0;
};

// Passes the value to `progress` if that is a MeasuredProgress; else does nothing.
inline void report_measure(Progress& progress, std::string_view name, double value) {
  if (auto* measured = dynamic_cast<MeasuredProgress*>(&progress)) measured->measure(name, value);
}

}  // namespace tarsier
