// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include <functional>
#include <string>
#include <vector>

// The command line of `tarsier serve`. It is declared twice: by tarsier, which describes it and
// starts the program tarsier-serve, and by that program, the browser studio (apps/web/).
namespace tarsier::cli {

struct ServeOptions {
  std::string workspace;                     // folder; empty: ~/.local/share/tarsier
  int port = 8765;                           // 0: any that is free
  double quota_gb = 20;                      // of the workspace, 10^9 bytes
  int jobs = 1;                              // at a time
  std::vector<std::string> allowed_sources;  // "NAME=SOURCE"
  bool listen_all = false;
  std::vector<std::string> host_names;  // by which other machines know this one
  std::string tls_certificate;          // PEM files
  std::string tls_key;
  bool tls_self_signed = false;
  std::string behind_proxy;  // the origin that browsers see
  bool link = false;         // only prints a new link for the running server
  bool no_browser = false;
  std::string assets;  // folder of the pages, instead of those in the program
};

using RunServe = std::function<ExitStatus(const ServeOptions&, Context&)>;
void add_serve(Command& app, Context& context, const RunServe& run);

}  // namespace tarsier::cli
