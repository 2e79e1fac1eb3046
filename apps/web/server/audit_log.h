// SPDX-License-Identifier: MIT
#pragma once

#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::web {

// Records who did what: one JSON line per event ({"time","event","address",..}) in
// .studio/audit.log (mode 0600). It has no images, no face templates and no secrets. At 4 MB the
// file is renamed to audit.log.1. Thread-safe. Disk errors are logged as warnings, never thrown.
class AuditLog {
 public:
  explicit AuditLog(std::string path);
  // `details` is an object; its strings are truncated to 300 bytes.
  void write(std::string_view event, std::string_view address,
             const nlohmann::json& details = nlohmann::json::object());
  [[nodiscard]] std::vector<nlohmann::json> last(std::size_t count) const;

 private:
  const std::string path_;
  mutable std::mutex mutex_;
};

}  // namespace tarsier::web
