// SPDX-License-Identifier: MIT
#include "tarsier/media/lazy_opencv.h"

#include "tarsier/core/errors.h"

#include <fmt/format.h>
#include <opencv2/objdetect.hpp>
#include <opencv2/video/tracking.hpp>
#include <opencv2/videoio/registry.hpp>

#include <cstddef>
#include <dlfcn.h>
#include <new>

namespace tarsier::lazy_opencv {
namespace {

cv::Ptr<cv::BaseCascadeClassifier> classifier_of(const cv::CascadeClassifier& cascade) {
  return cascade.cc != nullptr && !cascade.cc->empty() ? cascade.cc : nullptr;
}

}  // namespace

#ifdef TARSIER_IMGCODECS_SONAME
namespace {

// Never unloaded: these libraries leave exit handlers and thread-local state behind.
void* load(const char* library) {
  void* handle = dlopen(library, RTLD_LAZY | RTLD_LOCAL);
  if (handle == nullptr) {
    const char* reason = dlerror();
    throw Error(ErrorKind::kInput, fmt::format("cannot load OpenCV's {}; install it",
                                               reason == nullptr ? library : reason));
  }
  return handle;
}

// `name` as C++ mangles it (Itanium C++ ABI).
template <typename Function>
Function* find(void* library, const char* name) {
  void* address = dlsym(library, name);
  if (address == nullptr)
    throw Error(ErrorKind::kInput, fmt::format("OpenCV's libraries lack {}", name));
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

void* video() {
  static void* const kHandle = load(TARSIER_VIDEO_SONAME);
  return kHandle;
}

void* objdetect() {
  static void* const kHandle = load(TARSIER_OBJDETECT_SONAME);
  return kHandle;
}

// A constructor gets the memory to fill as its first argument; the virtual destructor frees it.
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

bool imencode(const std::string& extension, const cv::Mat& image, std::vector<std::uint8_t>& bytes,
              const std::vector<int>& parameters) {
  static const auto kEncode =
      find<bool(const cv::String&, cv::InputArray, std::vector<uchar>&, const std::vector<int>&)>(
          imgcodecs(),
          "_ZN2cv8imencodeERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKNS_11_"
          "InputArrayERSt6vectorIhSaIhEERKSB_IiSaIiEE");
  return kEncode(extension, image, bytes, parameters);
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

void optical_flow_pyr_lk(cv::InputArray from, cv::InputArray to, cv::InputArray points,
                         cv::InputOutputArray moved, cv::OutputArray status, cv::OutputArray error,
                         cv::Size window, int max_level, cv::TermCriteria criteria, int flags,
                         double min_eigenvalue) {
  static const auto kFlow = find<decltype(cv::calcOpticalFlowPyrLK)>(
      video(),
      "_ZN2cv20calcOpticalFlowPyrLKERKNS_11_InputArrayES2_S2_RKNS_17_InputOutputArrayERKNS_12_"
      "OutputArrayES8_NS_5Size_IiEEiNS_12TermCriteriaEid");
  kFlow(from, to, points, moved, status, error, window, max_level, criteria, flags, min_eigenvalue);
}

int optical_flow_pyramid(cv::InputArray image, cv::OutputArrayOfArrays pyramid, cv::Size window,
                         int max_level) {
  static const auto kBuild = find<decltype(cv::buildOpticalFlowPyramid)>(
      video(),
      "_ZN2cv23buildOpticalFlowPyramidERKNS_11_InputArrayERKNS_12_OutputArrayENS_5Size_IiEEibiib");
  return kBuild(image, pyramid, window, max_level, true, cv::BORDER_REFLECT_101,
                cv::BORDER_CONSTANT, true);
}

cv::Ptr<cv::BaseCascadeClassifier> load_cascade(const std::string& path) {
  static const auto kConstructor = find<void(void*, const cv::String&)>(
      objdetect(),
      "_ZN2cv17CascadeClassifierC1ERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEE");
  static const auto kDestructor = find<void(void*)>(objdetect(), "_ZN2cv17CascadeClassifierD1Ev");
  alignas(cv::CascadeClassifier) std::byte place[sizeof(cv::CascadeClassifier)];
  kConstructor(place, path);
  auto classifier = classifier_of(*std::launder(reinterpret_cast<cv::CascadeClassifier*>(place)));
  kDestructor(place);
  return classifier;
}

#else

cv::Mat imdecode(const cv::Mat& bytes, int flags) { return cv::imdecode(bytes, flags); }

bool imencode(const std::string& extension, const cv::Mat& image, std::vector<std::uint8_t>& bytes,
              const std::vector<int>& parameters) {
  return cv::imencode(extension, image, bytes, parameters);
}

std::unique_ptr<cv::VideoCapture> make_video_capture() {
  return std::make_unique<cv::VideoCapture>();
}

std::unique_ptr<cv::VideoWriter> make_video_writer() { return std::make_unique<cv::VideoWriter>(); }

bool has_backend(cv::VideoCaptureAPIs backend) { return cv::videoio_registry::hasBackend(backend); }

void optical_flow_pyr_lk(cv::InputArray from, cv::InputArray to, cv::InputArray points,
                         cv::InputOutputArray moved, cv::OutputArray status, cv::OutputArray error,
                         cv::Size window, int max_level, cv::TermCriteria criteria, int flags,
                         double min_eigenvalue) {
  cv::calcOpticalFlowPyrLK(from, to, points, moved, status, error, window, max_level, criteria,
                           flags, min_eigenvalue);
}

int optical_flow_pyramid(cv::InputArray image, cv::OutputArrayOfArrays pyramid, cv::Size window,
                         int max_level) {
  return cv::buildOpticalFlowPyramid(image, pyramid, window, max_level);
}

cv::Ptr<cv::BaseCascadeClassifier> load_cascade(const std::string& path) {
  return classifier_of(cv::CascadeClassifier(path));
}

#endif

}  // namespace tarsier::lazy_opencv
