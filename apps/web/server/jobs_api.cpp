// SPDX-License-Identifier: MIT
#include "audit_log.h"
#include "files.h"
#include "jobs.h"
#include "router.h"
#include <unistd.h>

namespace tarsier::web {

void bind_jobs(Router& router, Jobs& jobs, Workspace& workspace, AuditLog& audit,
               const std::string& own_program) {
  router.add("GET", "/api/jobs", [&](const Request&) { return json_response(jobs.list()); });
  router.add("POST", "/api/jobs", [&](const Request& request) {
    return json_response(jobs.start(request.json(), request.address), 201);
  });
  router.add("GET", "/api/jobs/{id}",
             [&](const Request& request) { return json_response(jobs.get(request.param("id"))); });
  router.add("DELETE", "/api/jobs/{id}", [&](const Request& request) {
    jobs.remove(request.param("id"));
    audit.write("delete", request.address, {{"what", "job"}});
    return no_content();
  });
  router.add("POST", "/api/jobs/{id}/cancel", [&](const Request& request) {
    jobs.cancel(request.param("id"));
    return json_response(jobs.get(request.param("id")), 202);
  });
  router.add("POST", "/api/jobs/{id}/again", [&](const Request& request) {
    return json_response(jobs.restart(request.param("id"), request.address), 201);
  });
  // Text: the verb's log, and its JSON lines.
  const auto add_text = [&](const std::string& pattern, const std::string& file) {
    router.add("GET", pattern, [&jobs, &workspace, file](const Request& request) {
      (void)jobs.get(request.param("id"));
      const std::string path = workspace.job_folder(request.param("id")) + '/' + file;
      Response response;
      response.type = "text/plain; charset=utf-8";
      if (::access(path.c_str(), R_OK) == 0) response.file = path;  // else it has not started
      return response;
    });
  };
  add_text("/api/jobs/{id}/log", "log.txt");
  add_text("/api/jobs/{id}/lines", "lines.jsonl");
  router.add("GET", "/api/jobs/{id}/files/{path...}",
             [&workspace, own_program](const Request& request) {
               const std::string& name = request.param("path");
               const std::string path = workspace.job_file(request.param("id"), name);
               return image_response(workspace, path, name,
                                     request.query_value("width").value_or(""), own_program);
             });
}

}  // namespace tarsier::web
