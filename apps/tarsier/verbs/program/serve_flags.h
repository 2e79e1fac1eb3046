// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include <functional>
#include <string>
#include <vector>

// The command line of `tarsier serve`. It is declared in two programs: tarsier documents it and
// starts tarsier-serve, which is the browser studio (apps/web/).
namespace tarsier::cli {

struct ServeOptions {
  std::string workspace;                     // folder; empty: ~/.local/share/tarsier
  int port = 8765;                           // 0: any free port
  double quota_gb = 20;                      // of the workspace, 10^9 bytes
  int jobs = 1;                              // running at the same time
  std::vector<std::string> allowed_sources;  // "NAME=SOURCE"
  bool listen_all = false;
  std::vector<std::string> host_names;  // names of this machine for other machines
  std::string tls_certificate;          // PEM files
  std::string tls_key;
  bool tls_self_signed = false;
  std::string behind_proxy;  // the origin that browsers see
  bool link = false;         // only prints a new link to the running server
  bool no_browser = false;
  std::string assets;  // folder of the pages; empty: the built-in pages
};

using RunServe = std::function<ExitStatus(const ServeOptions&, Context&)>;
void add_serve(Command& app, Context& context, const RunServe& run);

}  // namespace tarsier::cli
