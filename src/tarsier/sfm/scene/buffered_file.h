// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"

#include <fstream>
#include <initializer_list>
#include <string>

// Writes a large file in blocks of a megabyte. The file appears when it is complete. Only for the
// .cpp files of this module.
namespace tarsier::sfm {

class BufferedFile {
 public:
  // All functions throw OutputError where the file cannot be written.
  explicit BufferedFile(const std::string& path)
      : path_(path), file_(path), stream_(file_.path(), std::ios::binary) {
    check();
  }
  void commit() {
    finish();
    file_.commit();
  }
  // Commits files that belong together: none of them appears before all are written.
  static void commit_all(std::initializer_list<BufferedFile*> files) {
    for (BufferedFile* file : files) file->finish();
    for (BufferedFile* file : files) file->file_.commit();
  }

 protected:
  [[nodiscard]] std::string& buffer() { return buffer_; }
  void flush_if_full() {
    if (buffer_.size() > 1'000'000) flush();
  }

 private:
  void finish() {
    flush();
    stream_.close();
    check();
  }
  void flush() {
    stream_.write(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
    check();
    buffer_.clear();
  }
  void check() const {
    if (!stream_) throw OutputError(path_, "cannot write (is the disk full?)");
  }

  std::string path_;
  AtomicFile file_;
  std::ofstream stream_;
  std::string buffer_;
};

}  // namespace tarsier::sfm
