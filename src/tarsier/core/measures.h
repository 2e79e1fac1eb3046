// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"

#include <string_view>

namespace tarsier {

// Progress that shows what a stage measures as it goes, e.g. its loss. That of make_progress() is of
// this kind.
class MeasuredProgress : public Progress {
 public:
  // Shown with the next advance(), however soon that comes: in JSON lines as one more number,
  // "loss":0.31. `name` is a plain word; a value that is not finite is left out.
  virtual void measure(std::string_view name, double value) = 0;
};

// The same for progress of any kind: of others nothing comes of it.
inline void tell_measure(Progress& progress, std::string_view name, double value) {
  if (auto* measured = dynamic_cast<MeasuredProgress*>(&progress)) measured->measure(name, value);
}

}  // namespace tarsier
