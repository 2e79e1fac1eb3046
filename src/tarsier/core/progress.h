// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>

namespace tarsier {

// Reports the progress of long work. Begin a stage, advance it, end it; stages follow each other.
// Calls may come from any thread. The display is updated at most ten times a second.
class Progress {
 public:
  virtual ~Progress() = default;
  // `total` 0 means unknown. `unit` is what is counted, in the plural ("images").
  virtual void begin(std::string_view stage, std::int64_t total, std::string_view unit) = 0;
  virtual void advance(std::int64_t count = 1) = 0;
  virtual void end() = 0;
};

// Reports nothing.
class NoProgress final : public Progress {
 public:
  void begin(std::string_view, std::int64_t, std::string_view) override {}
  void advance(std::int64_t) override {}
  void end() override {}
};

enum class ProgressStyle {
  kAuto,  // a bar when `out` is a terminal, else silent
  kBar,   // "stage  [#####.....]  50 %  12/24 images  3.2 s"
  kJson,  // {"progress":"stage","done":12,"total":24,"unit":"images","seconds":3.2} lines
  kNone,
};

// "auto", "bar", "json", "none"; throws std::invalid_argument for anything else.
[[nodiscard]] ProgressStyle parse_progress_style(std::string_view name);

// `out` must outlive the result (stderr in the program).
[[nodiscard]] std::unique_ptr<Progress> make_progress(ProgressStyle style, std::FILE* out);

}  // namespace tarsier
