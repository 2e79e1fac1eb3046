// SPDX-License-Identifier: MIT
#include "tarsier/media/lazy_opencv.h"

#include "tarsier/core/errors.h"

#include <fmt/format.h>
#include <opencv2/videoio/registry.hpp>

#include <dlfcn.h>
#include <new>

namespace tarsier::lazy_opencv {

#ifdef TARSIER_IMGCODECS_SONAME
namespace {

// Never unloaded: these libraries leave exit handlers and thread-local state behind.
void* load(const char* library) {
  void* handle = dlopen(library, RTLD_LAZY | RTLD_LOCAL);
  if (handle == nullptr) {
    const char* reason = dlerror();
    throw Error(ExitStatus::kBadInput, fmt::format("cannot load OpenCV's {}; install it",
                                                   reason == nullptr ? library : reason));
  }
  return handle;
}

// `name` as C++ mangles it (Itanium C++ ABI).
template <typename Function>
Function* find(void* library, const char* name) {
  void* address = dlsym(library, name);
  if (address == nullptr)
    throw Error(ExitStatus::kBadInput, fmt::format("OpenCV's libraries lack {}", name));
  return reinterpret_cast<Function*>(address);
}

void* imgcodecs() {
  static void* const kHandle = load(TARSIER_IMGCODECS_SONAME);
  return kHandle;
}

void* videoio() {
  static void* const kHandle = load(TARSIER_VIDEOIO_SONAME);
  return kHandle;
}

// A constructor takes the place to fill as its first argument; the virtual destructor frees it.
template <typename T>
std::unique_ptr<T> make(void (*constructor)(void*)) {
  void* place = ::operator new(sizeof(T));
  try {
    constructor(place);
  } catch (...) {
    ::operator delete(place);
    throw;
  }
  return std::unique_ptr<T>(static_cast<T*>(place));
}

}  // namespace

cv::Mat imdecode(const cv::Mat& bytes, int flags) {
  static const auto kDecode =
      find<cv::Mat(cv::InputArray, int)>(imgcodecs(), "_ZN2cv8imdecodeERKNS_11_InputArrayEi");
  return kDecode(bytes, flags);
}

bool imencode(const std::string& ending, const cv::Mat& image, std::vector<std::uint8_t>& bytes,
              const std::vector<int>& parameters) {
  static const auto kEncode =
      find<bool(const cv::String&, cv::InputArray, std::vector<uchar>&, const std::vector<int>&)>(
          imgcodecs(),
          "_ZN2cv8imencodeERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKNS_11_"
          "InputArrayERSt6vectorIhSaIhEERKSB_IiSaIiEE");
  return kEncode(ending, image, bytes, parameters);
}

std::unique_ptr<cv::VideoCapture> make_video_capture() {
  static const auto kConstructor = find<void(void*)>(videoio(), "_ZN2cv12VideoCaptureC1Ev");
  return make<cv::VideoCapture>(kConstructor);
}

std::unique_ptr<cv::VideoWriter> make_video_writer() {
  static const auto kConstructor = find<void(void*)>(videoio(), "_ZN2cv11VideoWriterC1Ev");
  return make<cv::VideoWriter>(kConstructor);
}

bool has_backend(cv::VideoCaptureAPIs backend) {
  static const auto kHas = find<bool(cv::VideoCaptureAPIs)>(
      videoio(), "_ZN2cv16videoio_registry10hasBackendENS_16VideoCaptureAPIsE");
  return kHas(backend);
}

#else

cv::Mat imdecode(const cv::Mat& bytes, int flags) { return cv::imdecode(bytes, flags); }

bool imencode(const std::string& ending, const cv::Mat& image, std::vector<std::uint8_t>& bytes,
              const std::vector<int>& parameters) {
  return cv::imencode(ending, image, bytes, parameters);
}

std::unique_ptr<cv::VideoCapture> make_video_capture() {
  return std::make_unique<cv::VideoCapture>();
}

std::unique_ptr<cv::VideoWriter> make_video_writer() { return std::make_unique<cv::VideoWriter>(); }

bool has_backend(cv::VideoCaptureAPIs backend) { return cv::videoio_registry::hasBackend(backend); }

#endif

}  // namespace tarsier::lazy_opencv
