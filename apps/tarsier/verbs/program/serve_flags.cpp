// SPDX-License-Identifier: MIT
#include "verbs/program/serve_flags.h"

namespace tarsier::cli {
namespace {

void add_flags(Command& verb, ServeOptions& options) {
  verb.add_option("--workspace", options.workspace,
                  "folder of uploads, jobs and galleries [~/.local/share/tarsier]");
  verb.add_option("--port", options.port, "port; 0: any free port")
      .check(range(0, 65535))
      .show_default();
  verb.add_option("--quota", options.quota_gb, "GB of disk space allowed for the workspace")
      .check(range(0.001, 1e6))
      .show_default();
  verb.add_option("--jobs", options.jobs, "number of jobs run at a time; the others wait")
      .check(range(1, 16))
      .show_default();
  verb.add_option("--allow-source", options.allowed_sources,
                  "NAME=SOURCE: camera URL or file that pages may use by this name");
  verb.add_flag("--no-browser", options.no_browser, "do not open a browser");
  verb.add_flag("--link", options.link, "print a new link for the running server and exit");
  const auto network = [](Flag& flag) { flag.group("Other machines"); };
  network(verb.add_flag("--listen-all", options.listen_all,
                        "accept connections from other machines; needs TLS or a proxy"));
  network(verb.add_option("--host", options.host_names,
                          "additional host name by which browsers reach this machine"));
  network(verb.add_option("--tls-cert", options.tls_certificate, "TLS certificate (PEM)")
              .type_name("FILE"));
  network(verb.add_option("--tls-key", options.tls_key, "key of the TLS certificate")
              .type_name("FILE"));
  network(verb.add_flag("--tls-self-signed", options.tls_self_signed,
                        "create a self-signed certificate; browsers warn once"));
  network(verb.add_option("--behind-proxy", options.behind_proxy,
                          "a proxy does TLS: origin seen by browsers, https://studio.example")
              .type_name("ORIGIN"));
  verb.add_option("--assets", options.assets, "folder of the pages (development)").type_name("DIR");
}

}  // namespace

void add_serve(Command& app, Context& context, const RunServe& run) {
  add_verb<ServeOptions>(app, "serve", "run the studio: everything in a browser, on this machine",
                         context, add_flags, run);
}

}  // namespace tarsier::cli
