// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::web {

struct StudioOptions {
  std::string workspace;                       // absolute path
  int port = 8765;                             // 0: any free port
  std::uint64_t quota_bytes = 20'000'000'000;  // of the workspace
  int jobs = 1;                                // at the same time, 1..16
  bool listen_all = false;
  std::vector<std::string> host_names;
  std::string tls_certificate;
  std::string tls_key;
  bool tls_self_signed = false;
  std::string behind_proxy;
  std::string assets;
  std::vector<std::pair<std::string, std::string>> allowed_sources;  // name, source
  std::string program;                                               // the path of tarsier
  std::string version;
};

// Parses "NAME=SOURCE" words: names of letters, digits, '-', '_', '.', 1..64, unique. Throws
// UsageError.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> parse_allowed_sources(
    const std::vector<std::string>& words);

// Throws UsageError if other machines could connect without TLS or a proxy, or if flags exclude
// each other.
void check_listening(const StudioOptions& options);

// The server of `tarsier serve`.
class Studio {
 public:
  // It listens when this returns. Throws OutputError (another server uses the workspace, it is not
  // writable, the port is in use) and InputError (certificates, the program).
  Studio(const StudioOptions& options, std::stop_token stop);
  ~Studio();  // ends all children
  Studio(const Studio&) = delete;
  Studio& operator=(const Studio&) = delete;

  [[nodiscard]] const std::string& url() const;  // "http://127.0.0.1:8765/"
  [[nodiscard]] std::string new_link() const;
  [[nodiscard]] const std::string& fingerprint() const;  // of the certificate; "" without TLS
  // Returns when the stop token is triggered and all children have ended.
  void run();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// A link to the server that runs in this workspace. Throws InputError if none runs.
[[nodiscard]] std::string new_link(const std::string& workspace);
// The link as a QR code of block characters, for phones; "" if `is_terminal` is false or if only
// this machine can open the link.
[[nodiscard]] std::string qr_text(const std::string& link, bool is_terminal);
// Starts xdg-open, if it exists, without waiting for it.
void open_browser(const std::string& link);
// Handles command lines by which tarsier-serve starts itself (thumbnails); nullopt for all others.
[[nodiscard]] std::optional<int> run_helper(int argc, const char* const* argv);

}  // namespace tarsier::web
