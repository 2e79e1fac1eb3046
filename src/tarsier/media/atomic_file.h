// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/file_descriptor.h"

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace tarsier {

// Writes a file completely or not at all: a temporary file in the same folder, fsync, rename, fsync
// of the folder. Throws OutputError; the old file, if any, is then unchanged and the temporary file
// is removed. A path that exists and is not a regular file (/dev/full, a pipe) is written to
// directly.
// If the program is killed, the temporary file stays. It is locked (flock) only while its writer
// lives. The next program that writes into the folder removes temporary files that are not locked
// and have up to 10 MB; it warns of larger ones, which stay.
void write_file_atomically(const std::string& path, std::string_view bytes);
void write_file_atomically(const std::string& path, std::span<const std::uint8_t> bytes);

// For writers that need a path (videos): give path() to the writer, then call commit(). Without
// commit() the temporary file is removed. The temporary name keeps the file extension.
class AtomicFile {
 public:
  // Throws OutputError if the folder is missing or not writable.
  explicit AtomicFile(std::string target);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  [[nodiscard]] const std::string& path() const { return temporary_; }
  void commit();  // fsync, rename; throws OutputError

 private:
  std::string target_;
  std::string temporary_;
  int lock_ = -1;  // the descriptor of the open and locked temporary file
  bool committed_ = false;
};

// The same for a folder of files that belong together: fill path(), then call commit(). Before
// commit() nothing is at `target`, and without commit() nothing appears there. If `target` is an
// existing empty folder (for example a mounted disk) it is filled in place; if the program is
// killed, its files stay there.
class AtomicFolder {
 public:
  // Creates missing parents. The new folder is readable by its owner only. Throws OutputError if
  // `target` exists and is not an empty folder.
  explicit AtomicFolder(std::string target);
  ~AtomicFolder();
  AtomicFolder(const AtomicFolder&) = delete;
  AtomicFolder& operator=(const AtomicFolder&) = delete;
  [[nodiscard]] const std::string& path() const { return temporary_; }
  void commit();  // throws OutputError

 private:
  std::string target_;
  std::string temporary_;
  int lock_ = -1;
  bool committed_ = false;
};

// Throws OutputError: "<path>: <reason>: <the system's text for `error`, a value of errno>".
[[noreturn]] void fail_to_write(const std::string& path, std::string_view reason, int error);
// Writes all of `bytes` to an open file; continues after signals. Throws OutputError(path, ..).
void write_all(int fd, std::string_view bytes, const std::string& path);
// Syncs the folder of a file. A new or renamed file survives a power cut only after this.
void sync_folder(const std::string& path_of_file);

// For a file that is read, changed and written again: waits until no other program holds the lock
// of its folder, and holds it until the descriptor is closed. A file system without locks, or a
// missing folder, is not locked.
[[nodiscard]] FileDescriptor lock_folder_of(const std::string& path_of_file);

// Creates `path` and its missing parents. Throws OutputError.
void make_folder(const std::string& path);

}  // namespace tarsier
