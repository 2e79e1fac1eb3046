// SPDX-License-Identifier: MIT
#pragma once

#include "jobs.h"
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tarsier::web {

class Router;
struct Request;
struct Response;

struct RunOptions {
  int parallel = 2;                          // children at the same time
  std::chrono::milliseconds wait{15'000};    // for a free place; then 429
  std::chrono::milliseconds limit{60'000};   // of a run; then it is killed, 504
  std::size_t output_bytes = 32U << 20U;     // of stdout; then it is killed, 413
  std::uint64_t memory_bytes = 8ULL << 30U;  // address space of a child
  std::uint64_t file_bytes = 16ULL << 20U;   // of all files in the response
};

// Runs verbs that answer quickly.
class Runs {
 public:
  Runs(const VerbHost& host, RunOptions options = {}) : host_(host), options_(options) {}

  // Ends the active runs, which then answer 503, and starts no more; returns at once.
  void stop();

  struct Result {
    int exit = 0;
    std::vector<std::string> lines;  // of stdout, as pages may see them
    std::string error;               // the last error of the verb; "" if none
    double ms = 0;
    std::string command;
    std::vector<std::pair<std::string, std::string>> files;  // name, bytes: of out:NAME
  };
  // Throws UsageError if the verb must not be started; HttpError 429, 504, 413 (see RunOptions).
  [[nodiscard]] Result run(const nlohmann::json& request, const std::string& address);
  // A verb on images of the request: their files and names.
  struct Image {
    std::string path;
    std::string name;
  };
  [[nodiscard]] Result run_on(const std::string& verb, const std::vector<Image>& images,
                              const std::vector<std::pair<std::string, std::string>>& query,
                              const std::string& drawing, const std::string& address);

  // The folder of a run; removed with the object.
  class Folder {
   public:
    explicit Folder(const Workspace& workspace);
    ~Folder();
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;
    [[nodiscard]] const std::string& path() const { return path_; }

   private:
    std::string path_;
  };

 private:
  [[nodiscard]] Result execute(const CommandLine& command, const Folder& folder);

  const VerbHost host_;
  const RunOptions options_;
  std::mutex mutex_;
  std::condition_variable freed_;
  int running_ = 0;
  bool is_stopping_ = false;
};

// The HTTP status for a verb's exit status: 0, 1 -> 200; 2 -> 400; 3, 4 -> 422; 5 -> 500; 6 -> 507;
// all else -> 500.
[[nodiscard]] int http_status_of(int exit);

// The verbs of /api/v1/AREA/VERB: verbs that take images and answer quickly.
[[nodiscard]] std::vector<std::string> image_verbs();

// Adds POST /api/run, POST /api/v1/{area}/{verb}.
void bind_runs(Router& router, Runs& runs, Workspace& workspace);

}  // namespace tarsier::web
