// SPDX-License-Identifier: MIT
#include "studio.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/cameras.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/http_listen.h"
#include "tarsier/media/model_store.h"

#include <fmt/format.h>

#include "about.h"
#include "assets.h"
#include "audit_log.h"
#include "child_process.h"
#include "files.h"
#include "http_server.h"
#include "job_feed.h"
#include "jobs.h"
#include "live.h"
#include "metrics.h"
#include "qr.h"
#include "router.h"
#include "runs.h"
#include "sign_in.h"
#include "sign_ins_api.h"
#include "stages_api.h"
#include "tls_certificate.h"
#include "verb_policy.h"
#include "workspace.h"
#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <condition_variable>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <ifaddrs.h>
#include <mutex>
#include <net/if.h>
#include <netinet/in.h>
#include <nlohmann/json.hpp>
#include <set>
#include <sys/file.h>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

namespace tarsier::web {
namespace {

using std::chrono::milliseconds;

std::string own_host_name() {
  std::array<char, 256> name{};
  if (::gethostname(name.data(), name.size() - 1) != 0) return {};
  const std::string text = lower_case(name.data());
  return parse_host(text) ? text : std::string();
}

// The IP addresses of this machine, without scopes.
std::vector<std::string> own_addresses() {
  std::vector<std::string> result;
  ifaddrs* list = nullptr;
  if (::getifaddrs(&list) != 0) return result;
  for (const ifaddrs* item = list; item != nullptr; item = item->ifa_next) {
    if (item->ifa_addr == nullptr || (item->ifa_flags & IFF_UP) == 0) continue;
    std::array<char, INET6_ADDRSTRLEN> text{};
    if (item->ifa_addr->sa_family == AF_INET) {
      const auto* four = reinterpret_cast<const sockaddr_in*>(item->ifa_addr);
      ::inet_ntop(AF_INET, &four->sin_addr, text.data(), text.size());
    } else if (item->ifa_addr->sa_family == AF_INET6) {
      const auto* six = reinterpret_cast<const sockaddr_in6*>(item->ifa_addr);
      ::inet_ntop(AF_INET6, &six->sin6_addr, text.data(), text.size());
    } else {
      continue;
    }
    result.emplace_back(text.data());
  }
  ::freeifaddrs(list);
  std::sort(result.begin(), result.end());
  result.erase(std::unique(result.begin(), result.end()), result.end());
  return result;
}

bool is_ipv6(const std::string& address) { return address.find(':') != std::string::npos; }

WorkspaceLimits limits_of(const StudioOptions& options) {
  WorkspaceLimits limits;
  limits.quota_bytes = options.quota_bytes;
  return limits;
}

JobOptions jobs_of(const StudioOptions& options) {
  JobOptions jobs;
  jobs.parallel = options.jobs;
  return jobs;
}

// The children have working directories of their own, so the path of a file must be absolute.
std::string absolute_source(const std::string& source) {
  namespace fs = std::filesystem;
  if (source.starts_with('@')) return '@' + absolute_source(source.substr(1));
  const bool is_camera = to_integer(source, 0, 255).has_value();
  const bool is_glob =
      source.find_first_of("*?[") != std::string::npos && source.find(':') == std::string::npos;
  std::error_code error;
  return !is_camera && (is_glob || fs::exists(source, error)) ? fs::absolute(source).string()
                                                              : source;
}

std::string server_file(const std::string& workspace) { return workspace + "/.studio/server.json"; }

}  // namespace

std::vector<std::pair<std::string, std::string>> parse_allowed_sources(
    const std::vector<std::string>& words) {
  std::vector<std::pair<std::string, std::string>> result;
  for (const std::string& word : words) {
    const std::size_t equals = word.find('=');
    const std::string name = word.substr(0, equals);
    const bool is_good = equals != std::string::npos && !name.empty() && name.size() <= 64 &&
                         std::all_of(name.begin(), name.end(), [](char c) {
                           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                                  (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
                         });
    if (!is_good || equals + 1 == word.size())
      throw UsageError(
          "--allow-source: expected NAME=SOURCE, e.g. door=rtsp://192.168.1.20/stream; a name has "
          "letters, digits, '-', '_' and '.'");
    if (std::any_of(result.begin(), result.end(),
                    [&](const auto& other) { return other.first == name; }))
      throw UsageError(fmt::format("--allow-source: {} is given twice", name));
    const std::string source = word.substr(equals + 1);
    if (source.starts_with('-'))
      throw UsageError(fmt::format("--allow-source {}: a source does not begin with '-'", name));
    result.emplace_back(name, absolute_source(source));
  }
  return result;
}

void check_listening(const StudioOptions& options) {
  const bool has_files = !options.tls_certificate.empty() || !options.tls_key.empty();
  if (options.tls_certificate.empty() != options.tls_key.empty())
    throw UsageError("--tls-cert and --tls-key belong together");
  if (has_files && options.tls_self_signed)
    throw UsageError("--tls-self-signed makes a certificate of its own: leave out --tls-cert");
  const bool tls = has_files || options.tls_self_signed;
  const bool proxy = !options.behind_proxy.empty();
  if (proxy) (void)normal_origin(options.behind_proxy);
  if (options.listen_all && !tls && !proxy)
    throw UsageError(
        "--listen-all without TLS would let others read the traffic: add --tls-self-signed, or "
        "--tls-cert FILE --tls-key FILE, or --behind-proxy ORIGIN where a proxy does TLS");
  if (!options.assets.empty() && options.listen_all)
    throw UsageError("--assets is for development on this machine: leave out --listen-all");
  for (const std::string& name : options.host_names) {
    const auto host = parse_host(name);
    if (!host || host->port != 0)
      throw UsageError(fmt::format("--host {}: expected a name without a port", name));
  }
}

struct Studio::Impl {
  Impl(const StudioOptions& given, std::stop_token token)
      : options(given),
        stop(std::move(token)),
        workspace(options.workspace, limits_of(options)),
        audit(workspace.studio_folder() + "/audit.log"),
        sign_ins(workspace.studio_folder()),
        verbs(read_help_json(options.program)) {
    listen();
    add_parts();
    start_server();
    nlohmann::json about{{"url", url}, {"pid", ::getpid()}};
    write_file_atomically(server_file(options.workspace), to_text(about) + "\n");
  }

  ~Impl() {
    (void)::unlink(server_file(options.workspace).c_str());
    // Children first, so that handlers that wait for them return.
    runs->stop();
    // Both need time to end; they do so in parallel.
    std::thread sessions([this] { live->stop(); });
    jobs->stop();
    sessions.join();
    server->stop();
    server.reset();
    jobs.reset();
    live.reset();
  }

  void listen() {
    const bool tls = options.tls_self_signed || !options.tls_certificate.empty();
    http.rules.tls = tls;
    http.rules.hosts = {"localhost", "127.0.0.1", "[::1]"};
    if (!options.behind_proxy.empty()) {
      http.rules.proxy_origin = normal_origin(options.behind_proxy);
      http.max_per_address = http.max_connections;
    }
    std::vector<std::string> names{"localhost", "127.0.0.1", "::1"};
    std::string shown = "127.0.0.1";
    for (const std::string& name : options.host_names) {
      http.rules.hosts.insert(lower_case(name));
      names.push_back(lower_case(name));
      shown = lower_case(name);
    }
    if (options.listen_all) {
      const std::string host = own_host_name();
      if (!host.empty()) {
        for (const std::string& name : {host, host + ".local"}) {
          http.rules.hosts.insert(name);
          names.push_back(name);
        }
      }
      for (const std::string& address : own_addresses()) {
        http.rules.hosts.insert(is_ipv6(address) ? "[" + address + "]" : address);
        names.push_back(address);
        // An address that phones in the same network can open.
        if (options.host_names.empty() && !is_ipv6(address) && !address.starts_with("127."))
          shown = address;
      }
    }
    if (tls) {
      const TlsFiles files = options.tls_self_signed
                                 ? self_signed_certificate(workspace.studio_folder(), names)
                                 : read_tls_files(options.tls_certificate, options.tls_key);
      http.tls_certificate = files.certificate;
      http.tls_key = files.key;
      fingerprint = fingerprint_of(files.certificate);
    }
    open_sockets();
    // A burst of clients must not have to retry.
    for (const int socket : http.sockets) (void)::listen(socket, 128);
    const std::string scheme = tls ? "https" : "http";
    url = http.rules.proxy_origin.empty()
              ? fmt::format("{}://{}:{}/", scheme, shown, http.rules.port)
              : http.rules.proxy_origin + "/";
  }

  void open_sockets() {
    const auto text = [&](std::string_view host, int port) {
      return fmt::format("http://{}:{}/", host, port);
    };
    if (options.listen_all) {
      try {
        ListenAddress both = parse_listen_address(text("[::]", options.port));
        http.sockets.push_back(listen_on(text("[::]", options.port), both));
        http.rules.port = both.port;
      } catch (const OutputError&) {
        // A system without IPv6; if the port is in use this fails again.
        ListenAddress four = parse_listen_address(text("0.0.0.0", options.port));
        http.sockets.push_back(listen_on(text("0.0.0.0", options.port), four));
        http.rules.port = four.port;
      }
      return;
    }
    ListenAddress four = parse_listen_address(text("127.0.0.1", options.port));
    http.sockets.push_back(listen_on(text("127.0.0.1", options.port), four));
    http.rules.port = four.port;
    try {
      // Otherwise another program on that address would get requests to "localhost".
      ListenAddress six = parse_listen_address(text("[::1]", four.port));
      http.sockets.push_back(listen_on(text("[::1]", four.port), six));
    } catch (const OutputError& error) {
      log_debug("{}", error.what());
    }
  }

  void add_parts() {
    const bool secure = http.rules.tls || http.rules.proxy_origin.starts_with("https://");
    LiveOptions live_options;
    live_options.program = options.program;
    live_options.verbs = &verbs;
    live_options.allowed = options.allowed_sources;
    live_options.references.file = [this](const std::string& reference, bool must_exist) {
      return workspace.resolve(reference, must_exist);
    };
    live_options.environment = {{"TARSIER_STUDIO", "1"},
                                {"TARSIER_OWN_MODELS", workspace.models_folder()}};
    live_options.sessions_folder = workspace.studio_folder() + "/sessions";
    live_options.more_sources = [this] { return set_sources(); };
    live_options.forgotten = [this](const std::string& name) { jobs->forget_name(name); };
    live = std::make_unique<Live>(std::move(live_options), feed, audit);
    const auto source = [this](const std::string& reference) {
      if (reference.starts_with("viewer:"))
        throw UsageError("only live sessions can use a browser camera");
      return live->resolve_source(reference);
    };
    VerbHost host{workspace, verbs, audit, options.program, source};
    jobs = std::make_unique<Jobs>(host, feed, jobs_of(options));
    host.forgotten = [this](const std::string& name) { jobs->forget_name(name); };
    runs = std::make_unique<Runs>(host);
    const std::string own = program_folder() + "/tarsier-serve";

    add_session_routes(router, sign_ins, audit, secure, options.version);
    bind_sign_ins(router, sign_ins, audit);
    live->add_routes(router);
    bind_stages(router, *live);
    bind_files(router, workspace, audit, own);
    bind_jobs(router, *jobs, workspace, audit, own);
    bind_runs(router, *runs, workspace);
    add_asset_routes(router, options.assets);
    AboutOptions about;
    about.version = options.version;
    about.tls = secure;
    about.metrics = {
        [this](MetricsText& metrics) { add_job_metrics(metrics, *jobs); },
        [this](MetricsText& metrics) { add_session_metrics(metrics, live->sessions()); },
        [this](MetricsText& metrics) { add_http_metrics(metrics, http_figures()); }};
    bind_about(router, verbs, workspace, audit, std::move(about));
  }

  [[nodiscard]] HttpFigures http_figures() const {
    const HttpCounters& counters = server->counters();
    const auto number = [](const auto& value) { return static_cast<double>(value.load()); };
    return {.requests = number(counters.requests),
            .refused = number(counters.refused),
            .failed = number(counters.failed),
            .connections = number(counters.open),
            .sent_bytes = number(counters.bytes)};
  }

  nlohmann::json set_sources() const {
    nlohmann::json list = nlohmann::json::array();
    for (const SetInfo& set : workspace.sets()) {
      if (set.files == 0) continue;
      list.push_back({{"id", "set:" + set.name},
                      {"name", set.name},
                      {"kind", "file"},
                      {"live", false},
                      {"files", set.files}});
    }
    return list;
  }

  void start_server() {
    http.spool_folder = workspace.uploads_folder();
    server = std::make_unique<HttpServer>(std::move(http), router, sign_ins, audit);
  }

  const StudioOptions options;
  const std::stop_token stop;
  Workspace workspace;
  AuditLog audit;
  SignIns sign_ins;
  VerbTable verbs;
  JobFeed feed;
  HttpServerOptions http;
  std::string url;
  std::string fingerprint;
  std::unique_ptr<Live> live;
  std::unique_ptr<Jobs> jobs;
  std::unique_ptr<Runs> runs;
  Router router;
  std::unique_ptr<HttpServer> server;
};

Studio::Studio(const StudioOptions& options, std::stop_token stop)
    : impl_(std::make_unique<Impl>(options, std::move(stop))) {}

Studio::~Studio() = default;

const std::string& Studio::url() const { return impl_->url; }
const std::string& Studio::fingerprint() const { return impl_->fingerprint; }

std::string Studio::new_link() const {
  return impl_->url + "#t=" + make_link_token(impl_->workspace.studio_folder());
}

void Studio::run() {
  std::mutex mutex;
  std::condition_variable_any wake;
  std::unique_lock lock(mutex);
  wake.wait(lock, impl_->stop, [] { return false; });
}

std::string new_link(const std::string& workspace) {
  const std::string lock_path = workspace + "/.studio/lock";
  const int lock = ::open(lock_path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW);
  const bool is_free = lock < 0 || ::flock(lock, LOCK_EX | LOCK_NB) == 0;
  if (lock >= 0) ::close(lock);
  std::ifstream file(server_file(workspace));
  const nlohmann::json about =
      file ? nlohmann::json::parse(file, nullptr, false) : nlohmann::json();
  if (is_free || !about.is_object() || !about.contains("url"))
    throw InputError(workspace, "no studio is running here; start it with `tarsier serve`");
  return about.value("url", std::string()) + "#t=" + make_link_token(workspace + "/.studio");
}

std::string qr_text(const std::string& link, bool is_terminal) {
  if (!is_terminal || link.size() > 250) return {};
  // Another device could not open such a link.
  for (const std::string_view own : {"127.", "localhost", "[::1]"}) {
    if (link.find(fmt::format("://{}", own)) != std::string::npos) return {};
  }
  return draw_qr_code(make_qr_code(link)) + "\n";
}

void open_browser(const std::string& link) {
  const std::string program = find_program_on_path("xdg-open");
  if (program.empty()) return;
  try {
    ChildOptions options;
    options.arguments = {program, link};
    static std::unique_ptr<ChildProcess> child;
    child = std::make_unique<ChildProcess>(std::move(options), [](const ChildEnd&) {});
  } catch (const std::exception& error) {
    log_debug("{}", error.what());
  }
}

std::optional<int> run_helper(int argc, const char* const* argv) {
  if (argc != 5 || std::string_view(argv[1]) != "--thumbnail") return std::nullopt;
  const auto width = to_integer(argv[4], 1, 4096);
  if (!width) return 2;
  try {
    return make_thumbnail(argv[2], argv[3], static_cast<int>(*width));
  } catch (const std::exception& error) {
    log_error("{}", error.what());
    return 1;
  }
}

}  // namespace tarsier::web
