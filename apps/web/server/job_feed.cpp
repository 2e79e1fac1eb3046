// SPDX-License-Identifier: MIT
#include "job_feed.h"

#include <algorithm>

namespace tarsier::web {

void JobFeed::publish(const std::string& id, std::string json) {
  std::function<void()> wake;
  {
    const std::lock_guard lock(mutex_);
    entries_[id] = Entry{++newest_, std::move(json)};
    wake = wake_;
    // Jobs that were deleted long ago are dropped, so that ids do not accumulate.
    if (entries_.size() > 4096) {
      const auto oldest = std::min_element(
          entries_.begin(), entries_.end(),
          [](const auto& a, const auto& b) { return a.second.number < b.second.number; });
      entries_.erase(oldest);
    }
  }
  if (wake) wake();
}

std::vector<std::pair<std::string, std::string>> JobFeed::since(std::uint64_t& last,
                                                                std::size_t max_count) const {
  const std::lock_guard lock(mutex_);
  std::vector<std::pair<std::uint64_t, const std::string*>> found;
  if (newest_ > last) {
    for (const auto& [id, entry] : entries_) {
      if (entry.number > last) found.emplace_back(entry.number, &id);
    }
  }
  std::sort(found.begin(), found.end());
  if (found.size() > max_count) found.resize(max_count);
  std::vector<std::pair<std::string, std::string>> result;
  for (const auto& [number, id] : found) {
    result.emplace_back(*id, entries_.at(*id).json);
    last = number;
  }
  if (found.empty()) last = std::max(last, newest_);
  return result;
}

std::uint64_t JobFeed::newest() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

void JobFeed::on_publish(std::function<void()> wake) {
  const std::lock_guard lock(mutex_);
  wake_ = std::move(wake);
}

}  // namespace tarsier::web
