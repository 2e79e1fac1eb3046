// SPDX-License-Identifier: MIT
// tarsier-serve: the program that `tarsier serve` starts.
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/core/stop_signal.h"
#include "tarsier/media/atomic_file.h"

#include <fmt/format.h>

#include "framework/output.h"
#include "studio.h"
#include "verbs/program/serve_flags.h"
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <unistd.h>

namespace tarsier::cli {
namespace {

std::string default_workspace() {
  const char* data = std::getenv("XDG_DATA_HOME");
  if (data != nullptr && *data == '/') return std::string(data) + "/tarsier";
  const char* home = std::getenv("HOME");
  if (home == nullptr || *home != '/')
    throw UsageError("there is no home folder; set --workspace DIR");
  return std::string(home) + "/.local/share/tarsier";
}

// Searches tarsier beside this program (build tree), or in ../../bin from libexec/tarsier
// (installed).
std::string find_tarsier() {
  const std::filesystem::path folder = program_folder();
  for (const auto& path :
       {folder / "tarsier", folder.parent_path().parent_path() / "bin/tarsier"}) {
    if (::access(path.c_str(), X_OK) == 0) return path.lexically_normal().string();
  }
  throw InputError((folder / "tarsier").string(),
                   "no such program; it must be installed beside tarsier-serve, or in "
                   "../../bin");
}

ExitStatus run_serve(const ServeOptions& options, Context& context) {
  web::StudioOptions studio;
  studio.workspace =
      std::filesystem::absolute(options.workspace.empty() ? default_workspace() : options.workspace)
          .lexically_normal()
          .string();
  while (studio.workspace.size() > 1 && studio.workspace.ends_with('/'))
    studio.workspace.pop_back();
  if (options.link) {
    const std::string link = web::new_link(studio.workspace);
    if (context.json) {
      print_json({{"link", link}});
    } else {
      print_text(link + "\n" + web::qr_text(link, ::isatty(STDOUT_FILENO) == 1));
    }
    return ExitStatus::kDone;
  }
  studio.port = options.port;
  studio.quota_bytes = static_cast<std::uint64_t>(options.quota_gb * 1e9);
  studio.jobs = options.jobs;
  studio.listen_all = options.listen_all;
  studio.host_names = options.host_names;
  studio.tls_certificate = options.tls_certificate;
  studio.tls_key = options.tls_key;
  studio.tls_self_signed = options.tls_self_signed;
  studio.behind_proxy = options.behind_proxy;
  studio.assets = options.assets;
  studio.allowed_sources = web::parse_allowed_sources(options.allowed_sources);
  studio.program = find_tarsier();
  studio.version = std::string(version());
  web::check_listening(studio);
  web::Studio server(studio, context.stop);
  const std::string link = server.new_link();
  if (context.json) {
    nlohmann::ordered_json line{{"url", server.url()}, {"link", link}};
    if (!server.fingerprint().empty()) line["sha256"] = server.fingerprint();
    print_json(line);
  } else {
    std::string text = fmt::format("The studio is at\n\n  {}\n\n", link);
    if (!server.fingerprint().empty())
      text += fmt::format("Its certificate has the SHA-256 fingerprint\n  {}\n\n",
                          server.fingerprint());
    text += web::qr_text(link, ::isatty(STDOUT_FILENO) == 1);
    text +=
        "The link signs one browser in, once. `tarsier serve --link` prints another; Ctrl-C ends "
        "the studio.\n";
    print_text(text);
  }
  const bool has_display =
      std::getenv("DISPLAY") != nullptr || std::getenv("WAYLAND_DISPLAY") != nullptr;
  if (!options.no_browser && !context.json && has_display && ::isatty(STDOUT_FILENO) == 1)
    web::open_browser(link);
  server.run();
  // SIGTERM is the normal end of a service, not an interruption.
  return stop_signal() == SIGINT ? ExitStatus::kInterrupted : ExitStatus::kDone;
}

void add(Command& app, Context& context) {
  app.add_version_flag("--version");
  add_serve(app, context, run_serve);
  add_examples(app);
}

}  // namespace
}  // namespace tarsier::cli

int main(int argc, char** argv) {
  namespace cli = tarsier::cli;
  if (const auto status = tarsier::web::run_helper(argc, argv)) return *status;
  return cli::run_main({cli::add, {}}, argc, argv, "serve");
}
