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
  int port = 8765;                             // 0: any that is free
  std::uint64_t quota_bytes = 20'000'000'000;  // of the workspace
  int jobs = 1;                                // at a time, 1..16
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

// "NAME=SOURCE" each: names of letters, digits, '-', '_', '.', 1..64, once. Throws UsageError.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> parse_allowed_sources(
    const std::vector<std::string>& words);

// Throws UsageError where other machines could come in without TLS or a proxy, or where flags
// exclude each other.
void check_listening(const StudioOptions& options);

// The server of `tarsier serve` with all of its parts.
class Studio {
 public:
  // Listens when this returns. Throws OutputError (the workspace is another server's, or cannot be
  // written; the port is taken), InputError (certificates, the program).
  Studio(const StudioOptions& options, std::stop_token stop);
  ~Studio();  // ends all children
  Studio(const Studio&) = delete;
  Studio& operator=(const Studio&) = delete;

  [[nodiscard]] const std::string& url() const;  // "http://127.0.0.1:8765/"
  [[nodiscard]] std::string new_link() const;
  [[nodiscard]] const std::string& fingerprint() const;  // of the certificate; "" without TLS
  // Returns when the token fires, all children ended.
  void run();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// A link for the server that runs in this workspace. Throws InputError where none does.
[[nodiscard]] std::string new_link(const std::string& workspace);
// The link as a QR code of block characters, for phones; "" where `is_terminal` is not set, and for
// a link that this machine alone can open.
[[nodiscard]] std::string qr_text(const std::string& link, bool is_terminal);
// Starts xdg-open, if it is there, without waiting for it.
void open_browser(const std::string& link);
// What tarsier-serve is started for by itself (thumbnails); nothing for all other command lines.
[[nodiscard]] std::optional<int> run_helper(int argc, const char* const* argv);

}  // namespace tarsier::web
