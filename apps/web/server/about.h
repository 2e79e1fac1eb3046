// SPDX-License-Identifier: MIT
#pragma once

#include "metrics.h"
#include <chrono>
#include <string>
#include <vector>

namespace tarsier::web {

class AuditLog;
class Router;
class VerbTable;
class Workspace;

struct AboutOptions {
  std::string version;
  bool tls = false;
  std::vector<MetricsSource> metrics;  // beside those of the process and the workspace
  std::chrono::steady_clock::time_point started = std::chrono::steady_clock::now();
};

// GET /healthz, /metrics, /api/info, /api/help, /api/openapi.json, /api/audit. To be called last:
// the description tells of the routes that the table has when it is asked.
void bind_about(Router& router, const VerbTable& verbs, const Workspace& workspace,
                const AuditLog& audit, AboutOptions options);

// The text of `program help --json`. Throws InputError where it does not answer within 20 s.
[[nodiscard]] std::string ask_for_help(const std::string& program);

}  // namespace tarsier::web
