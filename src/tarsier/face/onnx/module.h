// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

// What tarsier-onnx.so exports: OpenCV's dnn behind a few plain functions. It is loaded at run time,
// so that only those who name a network of their own load it. Program and module are built
// together: the program refuses a module of another version. No exception leaves the module.
namespace tarsier::face::onnx {

// A network that is ready to run. One thread at a time.
class Runner {
 public:
  virtual ~Runner() = default;
  // `input`: CV_32F, N x C x H x W as it was opened with. Fills `outputs` in the order of
  // Request::outputs, CV_32F each. Returns one line of trouble; empty: none.
  [[nodiscard]] virtual std::string run(const cv::Mat& input, std::vector<cv::Mat>& outputs) = 0;
};

struct Request {
  const char* bytes = nullptr;  // of the file
  std::size_t size = 0;
  std::array<int, 4> input{};        // N, C, H, W
  std::vector<std::string> outputs;  // names
};

// Loads the module where it was not loaded yet, and opens the network; one run of zeros is tried.
// `path` is for errors. Throws ModelError: the module is missing or of another version, or OpenCV
// does not take the network.
[[nodiscard]] std::unique_ptr<Runner> open_runner(const Request& request, const std::string& path);

// Where the module is, or empty; nothing is loaded.
[[nodiscard]] std::string module_path();

}  // namespace tarsier::face::onnx

extern "C" {
const char* tarsier_onnx_version();
// Owned by the caller. Null, and one line of `trouble`, where OpenCV does not take the network.
tarsier::face::onnx::Runner* tarsier_onnx_open(const tarsier::face::onnx::Request* request,
                                               std::string* trouble);
}
