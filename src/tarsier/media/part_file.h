// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <thread>

namespace tarsier {

// A file that grows for hours and cannot be made a second time. Unlike AtomicFile it has a name
// that its owner sees: "video.part.mp4" (or "video.part-2.mp4" ..) beside the target "video.mp4",
// which it replaces at commit(). Without commit() it stays. What is written to it is on the disk 5
// s later at most; its writer sees to it that every beginning of the file can be used.
//
// What an earlier program left stays, too, with a warning that names it; while a program writes,
// the file is locked (flock).
class PartFile {
 public:
  explicit PartFile(std::string target);  // throws OutputError
  ~PartFile();                            // an empty file is removed
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;
  [[nodiscard]] const std::string& path() const { return part_; }
  void commit();  // fsync, rename; throws OutputError

 private:
  std::string target_;
  std::string part_;
  int fd_ = -1;
  bool committed_ = false;
  std::jthread syncing_;  // last: ends before the descriptor is closed
};

}  // namespace tarsier
