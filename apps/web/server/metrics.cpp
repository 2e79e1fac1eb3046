// SPDX-License-Identifier: MIT
#include "metrics.h"

#include <fmt/format.h>

#include "jobs.h"
#include "workspace.h"
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <unistd.h>

namespace tarsier::web {
namespace {

std::string escaped(std::string_view text) {
  std::string result;
  for (const char c : text) {
    if (c == '\\' || c == '"') result += '\\';
    if (c == '\n') {
      result += "\\n";
    } else {
      result += c;
    }
  }
  return result;
}

}  // namespace

void MetricsText::family(std::string_view name, std::string_view type, std::string_view help) {
  name_ = name;
  text_ += fmt::format("# HELP {} {}\n# TYPE {} {}\n", name, help, name, type);
}

void MetricsText::value(double number, const Labels& labels) {
  text_ += name_;
  for (std::size_t n = 0; n < labels.size(); ++n) {
    text_ +=
        fmt::format("{}{}=\"{}\"", n == 0 ? '{' : ',', labels[n].first, escaped(labels[n].second));
  }
  text_ += fmt::format("{} {}\n", labels.empty() ? "" : "}", number);
}

void add_process_metrics(MetricsText& metrics, double uptime_s, std::string_view version) {
  metrics.family("tarsier_info", "gauge", "The version.");
  metrics.value(1, {{"version", std::string(version)}});
  metrics.family("tarsier_uptime_seconds", "gauge", "Time since the start of the server.");
  metrics.value(uptime_s);
  std::uint64_t size = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> size >> resident;
  metrics.family("tarsier_resident_memory_bytes", "gauge", "Memory of the server itself.");
  metrics.value(static_cast<double>(resident) * static_cast<double>(::sysconf(_SC_PAGESIZE)));
  std::error_code error;
  const auto files = std::distance(std::filesystem::directory_iterator("/proc/self/fd", error),
                                   std::filesystem::directory_iterator());
  metrics.family("tarsier_open_files", "gauge", "Open file descriptors of the server itself.");
  metrics.value(static_cast<double>(files));
}

void add_job_metrics(MetricsText& metrics, const Jobs& jobs) {
  metrics.family("tarsier_jobs", "gauge", "Jobs by their state.");
  for (const auto& [state, count] : jobs.count_by_state()) metrics.value(count, {{"state", state}});
}

void add_workspace_metrics(MetricsText& metrics, const Workspace& workspace) {
  const Workspace::Space space = workspace.space();
  metrics.family("tarsier_workspace_bytes", "gauge", "Size of the workspace.");
  metrics.value(static_cast<double>(space.used));
  metrics.family("tarsier_workspace_quota_bytes", "gauge", "Maximum size of the workspace.");
  metrics.value(static_cast<double>(space.quota));
  metrics.family("tarsier_disk_free_bytes", "gauge", "Free space on the disk of the workspace.");
  metrics.value(static_cast<double>(space.free));
}

void add_session_metrics(MetricsText& metrics, const nlohmann::json& sessions) {
  const auto add = [&](std::string_view name, std::string_view type, std::string_view help,
                       const char* member, double scale) {
    metrics.family(name, type, help);
    for (const auto& session : sessions) {
      if (!session.contains(member)) continue;
      const auto& value = session.at(member);
      if (!value.is_number() && !value.is_boolean()) continue;
      const double number = value.is_boolean() ? (value.get<bool>() ? 1 : 0) : value.get<double>();
      metrics.value(number * scale,
                    {{"session", session.value("id", "")}, {"verb", session.value("verb", "")}});
    }
  };
  metrics.family("tarsier_sessions", "gauge", "Live sessions.");
  metrics.value(static_cast<double>(sessions.size()));
  add("tarsier_session_running", "gauge", "1 if the session is running.", "running", 1);
  add("tarsier_session_frames_total", "counter", "Frames processed.", "frames", 1);
  add("tarsier_session_frames_per_second", "gauge", "Frames a second.", "fps", 1);
  add("tarsier_session_frame_age_seconds", "gauge", "Age of the newest frame.", "age_ms", 0.001);
  add("tarsier_session_viewers", "gauge", "Viewers of the session.", "viewers", 1);
}

void add_http_metrics(MetricsText& metrics, const HttpFigures& figures) {
  metrics.family("tarsier_http_requests_total", "counter",
                 "Requests, with the counts of refused (4xx) and failed (5xx) ones.");
  metrics.value(figures.requests - figures.refused - figures.failed, {{"status", "ok"}});
  metrics.value(figures.refused, {{"status", "4xx"}});
  metrics.value(figures.failed, {{"status", "5xx"}});
  metrics.family("tarsier_http_connections", "gauge", "Open connections.");
  metrics.value(figures.connections);
  metrics.family("tarsier_http_sent_bytes_total", "counter", "Bytes of responses.");
  metrics.value(figures.sent_bytes);
}

}  // namespace tarsier::web
