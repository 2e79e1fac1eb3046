// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <thread>

namespace tarsier {

// A file that grows for hours and cannot be produced again. Unlike with AtomicFile its name is
// visible to the user: "video.part.mp4" (or "video.part-2.mp4" ..) beside the target "video.mp4",
// whose name it gets at commit(). A target that exists and is not empty stays: the new file is then
// "video-2.mp4" (or "video-3.mp4" ..), with a warning. Without commit() the part file stays.
// Written data is on the disk at most 5 s later. The writer must make sure that every prefix of the
// file can be used.
//
// Part files of earlier programs stay, with a warning that names them. The file is locked (flock)
// while a program writes it.
class PartFile {
 public:
  explicit PartFile(std::string target);  // throws OutputError
  ~PartFile();                            // an empty file is removed
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;
  [[nodiscard]] const std::string& path() const { return part_; }
  void commit();  // fsync, rename; throws OutputError

 private:
  bool rename_to(const std::string& name);

  std::string target_;
  std::string name_;  // that commit() gives, unless another recording takes it meanwhile
  std::string part_;
  int fd_ = -1;
  bool committed_ = false;
  std::jthread syncing_;  // last: ends before the descriptor is closed
};

}  // namespace tarsier
