// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/media/sha256.h"

#include "audit_log.h"
#include "jobs.h"
#include "router.h"
#include <nlohmann/json.hpp>

namespace tarsier::web {

namespace {

using Json = nlohmann::json;

}  // namespace

CommandLine VerbHost::command(const VerbRequest& request, Use use,
                              const std::string& output_folder) const {
  return command_line(verbs, request, use,
                      {[this](const std::string& reference, bool must_exist) {
                         return workspace.resolve(reference, must_exist);
                       },
                       source, output_folder});
}

void VerbHost::write_audit(const CommandLine& line, const VerbRequest& request,
                           const std::string& address) const {
  if (line.audit.empty()) return;
  Json details = {{"verb", request.verb}};
  const bool has_person = request.verb == "people enroll" || request.verb == "people forget";
  if (has_person && !request.inputs.empty()) {
    Sha256 sum;
    sum.add(request.inputs.front());
    details["person_sha256"] = sum.hex();
  }
  audit.write(line.audit, address, details);
}

ChildOptions VerbHost::child(const CommandLine& line, const std::string& folder) const {
  ChildOptions options;
  options.arguments.push_back(program);
  options.arguments.insert(options.arguments.end(), line.words.begin(), line.words.end());
  // No window on the desktop of the server.
  options.environment = {{"DISPLAY", ""},
                         {"WAYLAND_DISPLAY", ""},
                         {"TARSIER_STUDIO", "1"},
                         {"TARSIER_OWN_MODELS", workspace.models_folder()}};
  options.folder = folder;
  return options;
}

std::string VerbHost::public_line(std::string_view line, const CommandLine& command) const {
  return workspace.with_references(without_secrets(std::string(line), command.secrets));
}

}  // namespace tarsier::web
