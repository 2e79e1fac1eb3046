// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tarsier::web {

class Jobs;
class Workspace;

// Prometheus' text format, version 0.0.4.
class MetricsText {
 public:
  using Labels = std::vector<std::pair<std::string_view, std::string>>;
  // Call once per name, before its values. `type`: "gauge" or "counter".
  void family(std::string_view name, std::string_view type, std::string_view help);
  void value(double number, const Labels& labels = {});
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  std::string name_;
  std::string text_;
};

// Adds the metrics of a part of the server.
using MetricsSource = std::function<void(MetricsText&)>;

// Memory, uptime, open files of this process.
void add_process_metrics(MetricsText& metrics, double uptime_s, std::string_view version);
void add_job_metrics(MetricsText& metrics, const Jobs& jobs);
void add_workspace_metrics(MetricsText& metrics, const Workspace& workspace);
// Adds metrics of Session objects as in the API: frames, fps, age, viewers, running.
void add_session_metrics(MetricsText& metrics, const nlohmann::json& sessions);
struct HttpFigures {
  double requests = 0, refused = 0, failed = 0, connections = 0, sent_bytes = 0;
};
void add_http_metrics(MetricsText& metrics, const HttpFigures& figures);

}  // namespace tarsier::web
