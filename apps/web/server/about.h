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
  std::vector<MetricsSource> metrics;  // in addition to those of the process and the workspace
  std::chrono::steady_clock::time_point started = std::chrono::steady_clock::now();
};

// Adds GET /healthz, /metrics, /api/info, /api/help, /api/openapi.json, /api/audit. The OpenAPI
// description lists the routes that the router has when it is requested.
void bind_about(Router& router, const VerbTable& verbs, const Workspace& workspace,
                const AuditLog& audit, AboutOptions options);

// Runs `program help --json` and returns its output. Throws InputError if it takes more than 20 s.
[[nodiscard]] std::string read_help_json(const std::string& program);

}  // namespace tarsier::web
