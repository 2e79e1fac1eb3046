// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace tarsier {

// Writes a file whole or not at all: a temporary file in the same folder, fsync, rename, fsync of
// the folder. Throws OutputError; the old file, if any, is then untouched and the temporary one
// gone. A path that exists and is no regular file (/dev/full, a pipe) is written to directly.
// Of a program that was killed the temporary file stays; it is locked (flock) only while its writer
// lives, and the next program that writes into the folder removes what is not locked: up to 10 MB
// of it; what is larger stays, with a warning that names it.
void write_file_atomically(const std::string& path, std::string_view bytes);
void write_file_atomically(const std::string& path, std::span<const std::uint8_t> bytes);

// For writers that want a path of their own (videos): give path() to the writer, then commit().
// Without commit() the temporary file is removed. The temporary name keeps the file ending.
class AtomicFile {
 public:
  explicit AtomicFile(
      std::string target);  // throws OutputError if the folder is missing or not writable
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  [[nodiscard]] const std::string& path() const { return temporary_; }
  void commit();  // fsync, rename; throws OutputError

 private:
  std::string target_;
  std::string temporary_;
  int lock_ = -1;  // the temporary file, open and locked
  bool committed_ = false;
};

// The same for a folder of files that belong together: fill path(), then commit(). Until then
// nothing is at `target`, and without commit() nothing will be. A `target` that is an empty folder
// already (a disk that is mounted there, say) is filled in place; what a kill leaves there stays.
class AtomicFolder {
 public:
  // Makes missing parents. Only the owner may look into the new folder. Throws OutputError if
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

// All of `bytes` to an open file, with signals in between. Throws OutputError(path, ..).
void write_all(int fd, std::string_view bytes, const std::string& path);
// A new or renamed file is only safe once its folder is on the disk, too.
void sync_folder(const std::string& path_of_file);

// Creates `path` and its missing parents. Throws OutputError.
void make_folder(const std::string& path);

}  // namespace tarsier
