// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

// The interface of tarsier-onnx.so: OpenCV's dnn behind a few plain functions. It is loaded at run
// time, only if the user's own network is given. Program and module are built together: the program
// refuses a module of another version. No exception leaves the module.
namespace tarsier::face::onnx {

// A network that is ready to run. Not thread-safe.
class Runner {
 public:
  virtual ~Runner() = default;
  // `input`: CV_32F, N x C x H x W as given in the request. Sets `outputs` in the order of
  // Request::outputs, CV_32F each. Returns an error message of one line; empty: success.
  [[nodiscard]] virtual std::string run(const cv::Mat& input, std::vector<cv::Mat>& outputs) = 0;
};

struct Request {
  const char* bytes = nullptr;  // of the file
  std::size_t size = 0;
  std::array<int, 4> input{};        // N, C, H, W
  std::vector<std::string> outputs;  // names
};

// Loads the module if necessary and opens the network; runs it once with zeros as a test. `path` is
// for error messages. Throws ModelError if the module is missing or of another version, or OpenCV
// does not support the network.
[[nodiscard]] std::unique_ptr<Runner> open_runner(const Request& request, const std::string& path);

// Path of the module, or empty; does not load it.
[[nodiscard]] std::string module_path();

}  // namespace tarsier::face::onnx

extern "C" {
const char* tarsier_onnx_version();
// Owned by the caller. Null, with one line in `error`, if OpenCV does not support the network.
tarsier::face::onnx::Runner* tarsier_onnx_open(const tarsier::face::onnx::Request* request,
                                               std::string* error);
}
