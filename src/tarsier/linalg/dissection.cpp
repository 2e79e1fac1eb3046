// SPDX-License-Identifier: MIT
#include "tarsier/linalg/dissection.h"

#include "tarsier/core/at.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace tarsier::linalg {
namespace {

constexpr std::size_t kMaxUnsplitSize = 16;  // parts of at most this many variables are not cut
constexpr double kMinHalfShare = 0.2;        // minimum share of a half
// Cost of unequal halves, in separators, when they differ by the whole part.
constexpr double kImbalanceCost = 2;
constexpr int kOrdered = -1;

class Dissection {
 public:
  explicit Dissection(const std::vector<std::vector<int>>& neighbours)
      : neighbours_(neighbours), part_of_(neighbours.size(), kOrdered), level_(neighbours.size()) {}

  std::vector<int> run(const std::vector<int>& variables) {
    cut(variables);
    return std::move(order_);
  }

 private:
  void cut(const std::vector<int>& variables) {
    const int part = next_part_++;
    for (const int variable : variables) part_of_[at(variable)] = part;
    for (const int variable : variables)
      if (part_of_[at(variable)] == part) cut_component(part, variable);
  }

  // Cuts the component of `part` that contains `start`.
  void cut_component(int part, int start) {
    for (int k = 0; k < 2; ++k) {
      find_levels(part, start);
      start = sequence_.back();  // a peripheral variable
    }
    find_levels(part, start);
    const int level = separating_level();
    if (level < 0) {
      append(sequence_);
      return;
    }
    std::vector<int> first;
    std::vector<int> separator;
    std::vector<int> second;
    for (const int variable : sequence_) {
      if (level_[at(variable)] > level) {
        second.push_back(variable);
      } else if (level_[at(variable)] == level && touches(part, variable, level + 1)) {
        separator.push_back(variable);
      } else {
        first.push_back(variable);
      }
    }
    cut(first);
    cut(second);
    append(separator);
  }

  void append(const std::vector<int>& variables) {
    for (const int variable : variables) part_of_[at(variable)] = kOrdered;
    order_.insert(order_.end(), variables.begin(), variables.end());
  }

  // Fills sequence_ with the component of `start`, sorted by distance from it. level_ receives the
  // distances, and begins_ the start of each distance in sequence_, and the end.
  void find_levels(int part, int start) {
    begins_.assign(1, 0);
    sequence_.assign(1, start);
    level_[at(start)] = 0;
    part_of_[at(start)] = kOrdered;
    for (std::size_t k = 0; k < sequence_.size();) {
      const std::size_t end = sequence_.size();
      for (; k < end; ++k) {
        for (const int other : neighbours_[at(sequence_[k])]) {
          if (part_of_[at(other)] != part) continue;
          part_of_[at(other)] = kOrdered;
          level_[at(other)] = static_cast<int>(begins_.size());
          sequence_.push_back(other);
        }
      }
      begins_.push_back(end);
    }
    for (const int variable : sequence_) part_of_[at(variable)] = part;
  }

  // The level of sequence_ that is the best separator; -1 if the part should not be cut.
  [[nodiscard]] int separating_level() const {
    const auto all = static_cast<double>(sequence_.size());
    int best = -1;
    double min_cost = std::numeric_limits<double>::infinity();
    for (std::size_t level = 1; sequence_.size() > kMaxUnsplitSize && level + 1 < begins_.size();
         ++level) {
      const auto before = static_cast<double>(begins_[level]);
      const auto after = all - static_cast<double>(begins_[level + 1]);
      if (std::min(before, after) < kMinHalfShare * all) continue;
      const double cost =
          (all - before - after) * (1 + kImbalanceCost * std::abs(before - after) / all);
      if (cost >= min_cost) continue;
      min_cost = cost;
      best = static_cast<int>(level);
    }
    return best;
  }

  [[nodiscard]] bool touches(int part, int variable, int level) const {
    const std::vector<int>& around = neighbours_[at(variable)];
    return std::any_of(around.begin(), around.end(), [&](int other) {
      return part_of_[at(other)] == part && level_[at(other)] == level;
    });
  }

  const std::vector<std::vector<int>>& neighbours_;
  std::vector<int> part_of_;  // for each variable
  int next_part_ = 0;
  std::vector<int> sequence_;
  std::vector<int> level_;
  std::vector<std::size_t> begins_;
  std::vector<int> order_;
};

}  // namespace

std::vector<int> dissection_order(const std::vector<std::vector<int>>& neighbours,
                                  const std::vector<int>& variables) {
  return Dissection(neighbours).run(variables);
}

}  // namespace tarsier::linalg
