// SPDX-License-Identifier: MIT
#include "tarsier/face/onnx/module.h"

#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn/dnn.hpp>

#include <cstdint>
#include <exception>
#include <new>
#include <string_view>

// The only file that uses OpenCV's dnn.
namespace {

using tarsier::face::onnx::Request;
using tarsier::face::onnx::Runner;

// Max total number of elements in the layers of a network: 1 GB.
constexpr std::int64_t kMaxElements = 256LL << 20;

// Suppresses OpenCV's own messages, which span several lines: errors are reported in one line.
class SilencedLog {
 public:
  SilencedLog() : before_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {}
  ~SilencedLog() { cv::utils::logging::setLogLevel(before_); }
  SilencedLog(const SilencedLog&) = delete;
  SilencedLog& operator=(const SilencedLog&) = delete;

 private:
  cv::utils::logging::LogLevel before_;
};

std::string one_line(std::string_view text) {
  constexpr std::size_t kMaxLetters = 200;
  std::string out;
  while (text.starts_with("> ")) text.remove_prefix(2);  // OpenCV's quotation mark
  for (const char letter : text.substr(0, kMaxLetters)) {
    const bool space = static_cast<unsigned char>(letter) <= ' ';
    if (space && (out.empty() || out.back() == ' ')) continue;
    out += space ? ' ' : letter;
  }
  while (!out.empty() && out.back() == ' ') out.pop_back();
  return out.empty() ? "no reason is given" : out;
}

// The exception thrown by `work`, as one line; empty: none.
template <typename Work>
std::string error_of(const Work& work) {
  try {
    const SilencedLog silenced;
    work();
    return {};
  } catch (const cv::Exception& error) {
    return one_line(error.err);
  } catch (const std::bad_alloc&) {
    return "too little memory";
  } catch (const std::exception& error) {
    return one_line(error.what());
  } catch (...) {
    return one_line({});
  }
}

class DnnRunner final : public Runner {
 public:
  explicit DnnRunner(const Request& request) : outputs_(request.outputs) {
    net_ = cv::dnn::readNetFromONNX(request.bytes, request.size);
    if (net_.empty()) CV_Error(cv::Error::StsError, "there is no network in it");
    net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    net_.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
    const cv::dnn::MatShape shape(request.input.begin(), request.input.end());
    check_size(shape);
    const cv::Mat zeros(shape, CV_32F, cv::Scalar(0));
    std::vector<cv::Mat> outputs;
    forward(zeros, outputs);
  }

  std::string run(const cv::Mat& input, std::vector<cv::Mat>& outputs) override {
    return error_of([&] { forward(input, outputs); });
  }

 private:
  // Checks the size before any allocation.
  void check_size(const cv::dnn::MatShape& shape) {
    std::vector<int> ids;
    std::vector<std::vector<cv::dnn::MatShape>> in;
    std::vector<std::vector<cv::dnn::MatShape>> out;
    net_.getLayersShapes(shape, ids, in, out);
    std::int64_t sum = 0;
    for (const auto& layer : out) {
      for (const cv::dnn::MatShape& one : layer) {
        std::int64_t numbers = 1;
        for (const int size : one) {
          if (size < 0 || numbers > kMaxElements)
            CV_Error(cv::Error::StsOutOfRange, "its layers are larger than 1 GB");
          numbers *= size;
        }
        sum += numbers;
        if (sum > kMaxElements)
          CV_Error(cv::Error::StsOutOfRange, "its layers are larger than 1 GB");
      }
    }
  }

  void forward(const cv::Mat& input, std::vector<cv::Mat>& outputs) {
    net_.setInput(input);
    std::vector<cv::Mat> results;
    net_.forward(results, outputs_);
    outputs.clear();
    for (const cv::Mat& one : results) {
      if (one.depth() != CV_32F) CV_Error(cv::Error::StsBadArg, "an output of other numbers");
      outputs.push_back(one.clone());
    }
  }

  cv::dnn::Net net_;
  std::vector<cv::String> outputs_;
};

}  // namespace

extern "C" {

__attribute__((visibility("default"))) const char* tarsier_onnx_version() {
  return TARSIER_VERSION;
}

__attribute__((visibility("default"))) Runner* tarsier_onnx_open(const Request* request,
                                                                 std::string* error) {
  Runner* runner = nullptr;
  *error = error_of([&] { runner = new DnnRunner(*request); });
  return runner;
}
}
