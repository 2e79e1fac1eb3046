// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <initializer_list>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace tarsier::sfm {

// A correspondence of feature `first` of one image and `second` of another.
struct Match {
  int first = 0;
  int second = 0;
  friend bool operator==(const Match&, const Match&) = default;
};

// Read-only matches, in memory or in a memory-mapped file (mapped_store.h). Copies share the data.
class MatchList {
 public:
  MatchList() = default;
  MatchList(std::vector<Match> matches)  // NOLINT(google-explicit-constructor): the same matches
      : MatchList(std::make_shared<const std::vector<Match>>(std::move(matches))) {}
  MatchList(std::initializer_list<Match> matches) : MatchList(std::vector<Match>(matches)) {}
  // `owner` keeps the data alive.
  MatchList(std::shared_ptr<const void> owner, std::span<const Match> matches)
      : owner_(std::move(owner)), matches_(matches) {}

  [[nodiscard]] const Match* data() const { return matches_.data(); }
  [[nodiscard]] std::size_t size() const { return matches_.size(); }
  [[nodiscard]] bool empty() const { return matches_.empty(); }
  [[nodiscard]] auto begin() const { return matches_.begin(); }
  [[nodiscard]] auto end() const { return matches_.end(); }
  [[nodiscard]] const Match& operator[](std::size_t i) const { return matches_[i]; }
  [[nodiscard]] std::vector<Match> copy() const { return {begin(), end()}; }
  friend bool operator==(const MatchList& a, const MatchList& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end());
  }

 private:
  explicit MatchList(const std::shared_ptr<const std::vector<Match>>& matches)
      : owner_(matches), matches_(*matches) {}

  std::shared_ptr<const void> owner_;
  std::span<const Match> matches_;
};

}  // namespace tarsier::sfm
