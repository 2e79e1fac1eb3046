// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/features.h"
#include "tarsier/sfm/mapper/flow.h"
#include "tarsier/sfm/mapper/two_view.h"

#include <map>
#include <optional>
#include <string>
#include <string_view>

// What takes long is kept on disk, so that a second run goes on where the first one ended. Each
// entry is a file of its own, written whole or not at all, named after everything that it depends
// on; one that is missing, damaged or of another program is worked out again.
namespace tarsier::sfm {

// Never fails over an entry: an unreadable one is none, and where the folder cannot be written
// store() throws OutputError. An empty folder name: nothing is kept.
class Cache {
 public:
  explicit Cache(std::string folder) : folder_(std::move(folder)) {}

  [[nodiscard]] std::optional<Features> features(const std::string& key) const;
  void store(const std::string& key, const Features& features) const;

  // The pairs of one image with others, by the other's own key.
  struct PairEntry {
    int matches = 0;
    TwoView view;
  };
  using Pairs = std::map<std::string, PairEntry>;
  [[nodiscard]] Pairs pairs(const std::string& key) const;
  void store(const std::string& key, const Pairs& pairs) const;

  // Points that were followed through a sequence.
  [[nodiscard]] std::optional<FlowResult> flow(const std::string& key) const;
  void store(const std::string& key, const FlowResult& flow) const;

  // Where the mapper was. A first one under a key removes those of other keys, but for one and the same with kAgain or
  // kJudged at its end, of images that were mapped, or whose models were judged, with other lenses.
  static constexpr std::string_view kAgain = "-2";
  static constexpr std::string_view kJudged = "-3";
  [[nodiscard]] std::optional<MapperState> checkpoint(const std::string& key) const;
  void store(const std::string& key, const MapperState& state) const;

 private:
  [[nodiscard]] std::string path_of(const std::string& key, const char* ending) const;
  std::string folder_;
};

// A key of 32 hexadecimal digits of any text.
[[nodiscard]] std::string cache_key(const std::string& text);

}  // namespace tarsier::sfm
