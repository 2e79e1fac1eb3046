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

// OpenCV's libraries that few commands need, loaded when they are first needed. Those of image files and videos bring
// some 200 further libraries as packaged (GDAL, GStreamer, ..), whose symbols take 0.1 s to resolve: more than most
// commands need for all they do, and without use for JPEG and PNG (image_codec.h). Those of optical flow and of cascades
// bring networks and protobuf: a quarter of the time that the program takes to start.
// Where OpenCV is no shared library it is linked as usual. Each throws Error if it cannot be loaded.
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

// As cv::calcOpticalFlowPyrLK and cv::buildOpticalFlowPyramid.
void optical_flow_pyr_lk(cv::InputArray from, cv::InputArray to, cv::InputArray points,
                         cv::InputOutputArray moved, cv::OutputArray status, cv::OutputArray error,
                         cv::Size window, int max_level, cv::TermCriteria criteria, int flags = 0,
                         double min_eigenvalue = 1e-4);
int optical_flow_pyramid(cv::InputArray image, cv::OutputArrayOfArrays pyramid, cv::Size window,
                         int max_level);

// The classifier of a cv::CascadeClassifier; null where the file holds none. Its functions are virtual.
[[nodiscard]] cv::Ptr<cv::BaseCascadeClassifier> load_cascade(const std::string& path);

}  // namespace tarsier::lazy_opencv
