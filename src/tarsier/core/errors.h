// SPDX-License-Identifier: MIT
#pragma once

#include <stdexcept>
#include <string>

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

// Base of all errors that are not a caller's mistake (those are std::invalid_argument, see
// require.h). what() is one line that names what, where, and where it helps what to do.
class Error : public std::runtime_error {
 public:
  Error(ExitStatus status, const std::string& message)
      : std::runtime_error(message), status_(status) {}
  [[nodiscard]] ExitStatus status() const { return status_; }

 private:
  ExitStatus status_;
};

// Trouble with a file, device or address. what() is "<path>: <reason>".
class IoError : public Error {
 public:
  IoError(ExitStatus status, std::string path, const std::string& reason)
      : Error(status, path + ": " + reason), path_(std::move(path)) {}
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

struct InputError : IoError {
  InputError(std::string path, const std::string& reason)
      : IoError(ExitStatus::kBadInput, std::move(path), reason) {}
};
struct SourceLostError : IoError {
  SourceLostError(std::string path, const std::string& reason)
      : IoError(ExitStatus::kSourceLost, std::move(path), reason) {}
};
struct ModelError : IoError {
  ModelError(std::string path, const std::string& reason)
      : IoError(ExitStatus::kBadModel, std::move(path), reason) {}
};
struct OutputError : IoError {
  OutputError(std::string path, const std::string& reason)
      : IoError(ExitStatus::kBadOutput, std::move(path), reason) {}
};
// Words on the command line that fit no verb, value or rule.
struct UsageError : Error {
  explicit UsageError(const std::string& message) : Error(ExitStatus::kUsage, message) {}
};
// Thrown by long work when its stop token fires.
struct Interrupted : Error {
  Interrupted() : Error(ExitStatus::kInterrupted, "interrupted") {}
};

}  // namespace tarsier
