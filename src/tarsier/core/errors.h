// SPDX-License-Identifier: MIT
#pragma once

#include <stdexcept>
#include <string>

namespace tarsier {

// What an error is about. A program decides by it what to do: `tarsier` what it exits with
// (apps/tarsier/framework/exit_status.h).
enum class ErrorKind {
  kUsage,       // what was asked for fits no rule
  kInput,       // a file, image or device that cannot be used; also a source that never opens
  kSourceLost,  // a source that ended after its first frame, when it should not have
  kModel,       // a model that is missing or broken
  kOutput,      // what cannot be written
  kInterrupted  // a stop was requested
};

// Base of all errors that are not a caller's mistake (those are std::invalid_argument, see
// require.h). what() is one line that names what, where, and where it helps what to do. It names an
// option as "option 'ca_file'", by the field that sets it, and knows no flags of a command line.
class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  [[nodiscard]] ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

// Trouble with a file, device or address. what() is "<path>: <reason>".
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
// A file or database has no such entry.
class MissingEntryError : public InputError {
 public:
  // `entry`: "face", "person" ..: what kind of entries the file has. A program says by it how they
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
// Words, of a command line or of an option, that fit no verb, value or rule.
struct UsageError : Error {
  explicit UsageError(const std::string& message) : Error(ErrorKind::kUsage, message) {}
};
// Thrown by long work when its stop token fires.
struct Interrupted : Error {
  Interrupted() : Error(ErrorKind::kInterrupted, "interrupted") {}
};

}  // namespace tarsier
