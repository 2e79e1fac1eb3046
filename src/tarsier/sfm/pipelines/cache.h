// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/features/flow.h"
#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/two_view/two_view.h"

#include <map>
#include <optional>
#include <string>
#include <string_view>

// Keeps expensive results on disk, so that a later run can resume. Each entry is a file of its own,
// written completely or not at all, and named after everything it depends on. A missing, damaged or
// foreign entry is computed again.
namespace tarsier::sfm {

// Reading never fails: an unreadable entry counts as missing. store() throws OutputError where the
// folder is not writable. With an empty folder name nothing is kept.
class Cache {
 public:
  explicit Cache(std::string folder) : folder_(std::move(folder)) {}

  [[nodiscard]] std::optional<Features> features(const std::string& key) const;
  void store(const std::string& key, const Features& features) const;

  // The pairs of one image with others, by the other's key.
  struct PairEntry {
    int matches = 0;
    TwoView view;
  };
  using Pairs = std::map<std::string, PairEntry>;
  [[nodiscard]] Pairs pairs(const std::string& key) const;
  void store(const std::string& key, const Pairs& pairs) const;

  // Points tracked through a sequence.
  [[nodiscard]] std::optional<FlowResult> flow(const std::string& key) const;
  void store(const std::string& key, const FlowResult& flow) const;

  // The state of the mapper. The first checkpoint of a key removes those of other keys. Keys that
  // differ only by kRemappedSuffix (images mapped again with other lenses) or kReevaluatedSuffix
  // (models evaluated with other lenses) count as one.
  static constexpr std::string_view kRemappedSuffix = "-2";
  static constexpr std::string_view kReevaluatedSuffix = "-3";
  [[nodiscard]] std::optional<MapperState> checkpoint(const std::string& key) const;
  void store(const std::string& key, const MapperState& state) const;

 private:
  [[nodiscard]] std::string path_of(const std::string& key, const char* ending) const;
  std::string folder_;
};

// A key of 32 hexadecimal digits for any text.
[[nodiscard]] std::string cache_key(const std::string& text);

}  // namespace tarsier::sfm
