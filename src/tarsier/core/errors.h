// SPDX-License-Identifier: MIT
#pragma once

#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

namespace tarsier {

// The system's text for a value of errno.
[[nodiscard]] inline std::string errno_text(int error) {
  return std::generic_category().message(error);
}

// The cause of an error. A program decides by it what to do; `tarsier` derives its exit status from
// it (apps/tarsier/framework/exit_status.h).
enum class ErrorKind {
  kUsage,  // the request fits no rule
  // A file, image or device cannot be used, or a source never opens.
  kInput,
  // A source ended unexpectedly after its first frame.
  kSourceLost,
  kModel,       // a model is missing or broken
  kOutput,      // an output cannot be written
  kInterrupted  // a stop was requested
};

// Base of all errors that are not a mistake of the caller (those are std::invalid_argument, see
// require.h). what() is one line: what failed, where and, if that helps, what to do. It names an
// option by its field, "option 'ca_file'", because the library knows no command-line flags.
class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  [[nodiscard]] ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

// An error of a file, device or address. what() is "<path>: <reason>".
class IoError : public Error {
 public:
  IoError(ErrorKind kind, std::string path, const std::string& reason)
      : Error(kind, path + ": " + reason), path_(std::move(path)) {}
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

struct InputError : IoError {
  InputError(std::string path, const std::string& reason)
      : IoError(ErrorKind::kInput, std::move(path), reason) {}
};
// A file or database does not have the requested entry.
class MissingEntryError : public InputError {
 public:
  // `entry` is the kind of entry: "face", "person" ... A program derives from it how the entries
  // are listed.
  MissingEntryError(std::string path, std::string entry, const std::string& reason)
      : InputError(std::move(path), reason), entry_(std::move(entry)) {}
  [[nodiscard]] const std::string& entry() const { return entry_; }

 private:
  std::string entry_;
};
struct SourceLostError : IoError {
  SourceLostError(std::string path, const std::string& reason)
      : IoError(ErrorKind::kSourceLost, std::move(path), reason) {}
};
struct ModelError : IoError {
  ModelError(std::string path, const std::string& reason)
      : IoError(ErrorKind::kModel, std::move(path), reason) {}
};
struct OutputError : IoError {
  OutputError(std::string path, const std::string& reason)
      : IoError(ErrorKind::kOutput, std::move(path), reason) {}
};
// Words of a command line or an option that fit no verb, value or rule.
struct UsageError : Error {
  explicit UsageError(const std::string& message) : Error(ErrorKind::kUsage, message) {}
};
// Thrown by long work after its stop token was triggered.
struct Interrupted : Error {
  Interrupted() : Error(ErrorKind::kInterrupted, "interrupted") {}
};

}  // namespace tarsier
