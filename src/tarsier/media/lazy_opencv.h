// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace cv {
class BaseCascadeClassifier;
}

// Loads OpenCV libraries that few commands need at their first use. The packaged libraries for
// image files and videos load about 200 further libraries (GDAL, GStreamer, ..), whose symbols take
// 0.1 s to resolve. That is longer than most commands run, and JPEG and PNG do not need them
// (image_codec.h). The libraries for optical flow and cascades load networks and protobuf, which
// take a quarter of the program's start time. If OpenCV is not a shared library it is linked as
// usual. Each function throws Error if its library cannot be loaded.
namespace tarsier::lazy_opencv {

// As cv::imdecode and cv::imencode.
[[nodiscard]] cv::Mat imdecode(const cv::Mat& bytes, int flags);
[[nodiscard]] bool imencode(const std::string& extension, const cv::Mat& image,
                            std::vector<std::uint8_t>& bytes, const std::vector<int>& parameters);

// Neither object is open. Their member functions are virtual, so nothing else needs to be linked.
[[nodiscard]] std::unique_ptr<cv::VideoCapture> make_video_capture();
[[nodiscard]] std::unique_ptr<cv::VideoWriter> make_video_writer();
// As cv::videoio_registry::hasBackend.
[[nodiscard]] bool has_backend(cv::VideoCaptureAPIs backend);

// As cv::calcOpticalFlowPyrLK and cv::buildOpticalFlowPyramid.
void optical_flow_pyr_lk(cv::InputArray from, cv::InputArray to, cv::InputArray points,
                         cv::InputOutputArray moved, cv::OutputArray status, cv::OutputArray error,
                         cv::Size window, int max_level, cv::TermCriteria criteria, int flags = 0,
                         double min_eigenvalue = 1e-4);
int optical_flow_pyramid(cv::InputArray image, cv::OutputArrayOfArrays pyramid, cv::Size window,
                         int max_level);

// The classifier of a cv::CascadeClassifier; null if the file contains none. Its functions are
// virtual.
[[nodiscard]] cv::Ptr<cv::BaseCascadeClassifier> load_cascade(const std::string& path);

}  // namespace tarsier::lazy_opencv
