// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

#include <set>
#include <string>
#include <sys/types.h>
#include <utility>
#include <vector>

namespace tarsier {

// The regular files that inputs name: files, and those in folders, globs and @lists. Outputs are
// compared with them, so that no input is replaced before or after it is read.
class InputFiles {
 public:
  InputFiles() = default;
  // Missing files and other inputs, for example cameras and addresses, are left out.
  explicit InputFiles(const std::vector<std::string>& inputs,
                      const std::vector<Scheme>& schemes = {});
  // Whether `path` is one of these files, perhaps by another name (a link).
  [[nodiscard]] bool contains(const std::string& path) const;
  // Throws UsageError if `output` is one of these files.
  void refuse_output(const std::string& output) const;
  // Paths of images, in the order of the inputs.
  [[nodiscard]] const std::vector<std::string>& paths() const { return paths_; }

 private:
  using Identity = std::pair<dev_t, ino_t>;
  void add(const std::string& path);

  std::vector<std::string> paths_;
  std::set<Identity> identities_;
};

}  // namespace tarsier
