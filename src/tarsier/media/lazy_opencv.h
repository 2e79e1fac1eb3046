// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

// OpenCV's libraries of image files and videos, loaded when they are first needed. As packaged they
// bring some 200 further libraries (GDAL, GStreamer, ..), whose symbols take 0.1 s to resolve: more
// than most commands need for all they do, and without use for JPEG and PNG (image_codec.h).
// Where OpenCV is no shared library it is linked as usual. Each throws Error if it cannot be
// loaded.
namespace tarsier::lazy_opencv {

// As cv::imdecode and cv::imencode.
[[nodiscard]] cv::Mat imdecode(const cv::Mat& bytes, int flags);
[[nodiscard]] bool imencode(const std::string& ending, const cv::Mat& image,
                            std::vector<std::uint8_t>& bytes, const std::vector<int>& parameters);

// Neither is open; their member functions are virtual, so that nothing else need be linked.
[[nodiscard]] std::unique_ptr<cv::VideoCapture> make_video_capture();
[[nodiscard]] std::unique_ptr<cv::VideoWriter> make_video_writer();
// As cv::videoio_registry::hasBackend.
[[nodiscard]] bool has_backend(cv::VideoCaptureAPIs backend);

}  // namespace tarsier::lazy_opencv
