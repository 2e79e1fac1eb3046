// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::web {

// The newest state of every job, for viewers. A viewer that reads slowly skips intermediate states.
// Thread-safe.
class JobFeed {
 public:
  // `json` is the Job as in the API; for a deleted job {"id","state":"deleted"}.
  void publish(const std::string& id, std::string json);
  // The states published after `last`, oldest first, at most `max_count`; advances `last`.
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> since(
      std::uint64_t& last, std::size_t max_count = 64) const;
  [[nodiscard]] std::uint64_t newest() const;
  // `wake` is called after each publish(), in its thread (live.cpp wakes its viewers).
  void on_publish(std::function<void()> wake);

 private:
  struct Entry {
    std::uint64_t number = 0;
    std::string json;
  };
  mutable std::mutex mutex_;
  std::map<std::string, Entry> entries_;
  std::uint64_t newest_ = 0;
  std::function<void()> wake_;
};

}  // namespace tarsier::web
