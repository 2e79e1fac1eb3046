// SPDX-License-Identifier: MIT
#include "verbs/program/serve_flags.h"

namespace tarsier::cli {
namespace {

void add_flags(Command& verb, ServeOptions& options) {
  verb.add_option("--workspace", options.workspace,
                  "folder of uploads, jobs and galleries; default: ~/.local/share/tarsier");
  verb.add_option("--port", options.port, "0: any that is free")
      .check(range(0, 65535))
      .show_default();
  verb.add_option("--quota", options.quota_gb, "GB that the workspace may hold")
      .check(range(0.001, 1e6))
      .show_default();
  verb.add_option("--jobs", options.jobs, "jobs at a time; the others wait")
      .check(range(1, 16))
      .show_default();
  verb.add_option("--allow-source", options.allowed_sources,
                  "NAME=SOURCE: a camera's URL or a file that pages may use by that name");
  verb.add_flag("--no-browser", options.no_browser, "do not open the link in a browser");
  verb.add_flag("--link", options.link, "print a new link for the server that runs, and end");
  const auto network = [](Flag& flag) { flag.group("Other machines"); };
  network(verb.add_flag("--listen-all", options.listen_all,
                        "other machines may connect, too; needs TLS or a proxy"));
  network(verb.add_option("--host", options.host_names,
                          "a further name by which browsers reach this machine"));
  network(verb.add_option("--tls-cert", options.tls_certificate, "certificate in PEM form")
              .type_name("FILE"));
  network(verb.add_option("--tls-key", options.tls_key, "its key").type_name("FILE"));
  network(verb.add_flag("--tls-self-signed", options.tls_self_signed,
                        "a certificate made here, which browsers warn of once"));
  network(verb.add_option("--behind-proxy", options.behind_proxy,
                          "a proxy does TLS: the origin that browsers see, https://studio.example")
              .type_name("ORIGIN"));
  verb.add_option("--assets", options.assets, "the pages come from this folder (development)")
      .type_name("DIR");
}

}  // namespace

void add_serve(Command& app, Context& context, const RunServe& run) {
  add_verb<ServeOptions>(app, "serve", "the studio: all of it in a browser, on this machine",
                         context, add_flags, run);
}

}  // namespace tarsier::cli
