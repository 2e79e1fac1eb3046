// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"

namespace tarsier {

// Exit statuses of the program, the same for every verb.
enum class ExitStatus : int {
  kDone = 0,
  kNothingFound = 1,  // ran to the end, but found nothing
  kUsage = 2,
  kBadInput = 3,    // also a source that never opens, or no display
  kSourceLost = 4,  // a source was lost after its first frame
  kBadModel = 5,    // a model is broken or missing
  kBadOutput = 6,   // an output cannot be written
  kInterrupted = 130,
};

// The exit status for an error of the library.
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
