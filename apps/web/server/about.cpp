// SPDX-License-Identifier: MIT
#include "about.h"

#include "tarsier/core/cpu.h"
#include "tarsier/core/elapsed.h"
#include "tarsier/core/errors.h"

#include "audit_log.h"
#include "child_process.h"
#include "openapi.h"
#include "router.h"
#include "verb_policy.h"
#include "workspace.h"
#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <sys/utsname.h>
#include <thread>
#include <unistd.h>

namespace tarsier::web {
namespace {

using Json = nlohmann::json;

Json machine_json() {
  struct utsname name {};
  ::uname(&name);
  const auto pages = static_cast<double>(::sysconf(_SC_PHYS_PAGES));
  const auto free_pages = static_cast<double>(::sysconf(_SC_AVPHYS_PAGES));
  const auto page = static_cast<double>(::sysconf(_SC_PAGESIZE));
  return {{"cores", std::max(1U, std::thread::hardware_concurrency())},
          {"memory_bytes", pages * page},
          {"memory_free_bytes", free_pages * page},
          {"simd", name_of(simd_level())},
          {"architecture", name.machine},
          {"system", std::string(name.sysname) + ' ' + name.release}};
}

Json info_json(const Workspace& workspace, const AboutOptions& options) {
  const Workspace::Space space = workspace.space();
  return {{"version", options.version},
          {"uptime_s", seconds_since(options.started)},
          {"tls", options.tls},
          {"machine", machine_json()},
          {"workspace",
           {{"path", workspace.folder()},
            {"used_bytes", space.used},
            {"quota_bytes", space.quota},
            {"free_bytes", space.free},
            {"disk_bytes", space.total}}},
          {"limits",
           {{"file_bytes", workspace.limits().file_bytes},
            {"pixels", workspace.limits().pixels},
            {"disk_reserve_bytes", workspace.limits().disk_reserve_bytes}}}};
}

}  // namespace

std::string read_help_json(const std::string& program) {
  std::string text;
  ChildOptions options;
  options.arguments = {program, "help", "--json"};
  options.max_line = 16U << 20U;
  options.on_output = [&](std::string_view line) { text += line; };
  ChildProcess child(std::move(options), [](const ChildEnd&) {});
  const auto end = child.wait(std::chrono::seconds(20));
  if (!end || end->exit != 0) throw InputError(program, "`help --json` failed");
  return text;
}

void bind_about(Router& router, const VerbTable& verbs, const Workspace& workspace,
                const AuditLog& audit, AboutOptions options) {
  router.add(
      "GET", "/healthz",
      [](const Request&) {
        return json_response({{"state", "ok"}});
      },
      Access::kPublic);
  router.add("GET", "/metrics", [&workspace, options](const Request&) {
    MetricsText metrics;
    add_process_metrics(metrics, seconds_since(options.started), options.version);
    add_workspace_metrics(metrics, workspace);
    for (const MetricsSource& source : options.metrics) source(metrics);
    Response response;
    response.type = "text/plain; version=0.0.4; charset=utf-8";
    response.body = metrics.text();
    return response;
  });
  router.add("GET", "/api/info", [&workspace, options](const Request&) {
    return json_response(info_json(workspace, options));
  });
  router.add("GET", "/api/help", [&verbs](const Request&) {
    Response response;
    response.body = verbs.text();
    return response;
  });
  router.add("GET", "/api/openapi.json", [&router, &verbs, options](const Request&) {
    return json_response(openapi_json(verbs, router, options.version));
  });
  router.add("GET", "/api/audit", [&audit](const Request& request) {
    const std::string text = request.query_value("count").value_or("100");
    int count = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
    if (error != std::errc() || end != text.data() + text.size() || count < 1 || count > 1000) {
      throw HttpError(400, "count: expected 1..1000");
    }
    return json_response({{"lines", audit.last(static_cast<std::size_t>(count))}});
  });
}

}  // namespace tarsier::web
