// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"

namespace tarsier {

// What the program exits with; the same for every verb.
enum class ExitStatus : int {
  kDone = 0,
  kNothingFound = 1,  // ran to the end, and found nothing
  kUsage = 2,
  kBadInput = 3,    // also a source that never opens, no display
  kSourceLost = 4,  // after its first frame
  kBadModel = 5,    // broken or missing
  kBadOutput = 6,   // cannot be written
  kInterrupted = 130,
};

// That of an error of the library.
constexpr ExitStatus exit_status(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kUsage:
      return ExitStatus::kUsage;
    case ErrorKind::kInput:
      return ExitStatus::kBadInput;
    case ErrorKind::kSourceLost:
      return ExitStatus::kSourceLost;
    case ErrorKind::kModel:
      return ExitStatus::kBadModel;
    case ErrorKind::kOutput:
      return ExitStatus::kBadOutput;
    case ErrorKind::kInterrupted:
      return ExitStatus::kInterrupted;
  }
  return ExitStatus::kBadInput;
}

}  // namespace tarsier
