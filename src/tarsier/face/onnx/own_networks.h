// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detect/box_detector.h"
#include "tarsier/face/onnx/network_file.h"
#include "tarsier/face/recognition/deep.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <string>

// Networks of a user's own, as ONNX files, run by OpenCV's dnn (module.h): one that compares faces,
// one that finds them. None comes with the program.
namespace tarsier::face::onnx {

// Where the five points of the usual alignment lie in 112 x 112 px (Deng and others, "ArcFace", 2019):
// the eyes' middle and distance, px. Networks of this alignment are the ones that can be used.
inline constexpr double kAlignedSide = 112;
inline constexpr double kAlignedEyesX = 55.913;
inline constexpr double kAlignedEyesY = 51.599;
inline constexpr double kAlignedEyesApart = 35.237;

// The chip that such a network sees, CV_8UC1 of `size` px, from a face that is cut as people/eyes.h
// cuts it (CV_8UC1 of any size): a similarity puts its eyes where the alignment has them; what the cut
// lacks is its edge repeated. (The cut itself comes from a least-squares similarity of eyes, nose and
// upper lip.) Throws std::invalid_argument.
[[nodiscard]] cv::Mat aligned_chip(const cv::Mat& crop, cv::Size size);

// A network that compares faces: one input of 1 x 1 or 3 x H x W (chips are grey, the same in each
// channel: the order of colours plays no part), one output of 8 to 4096 numbers, which are taken at
// unit length. Throws ModelError for anything else, and where nothing here runs ONNX files.
[[nodiscard]] std::shared_ptr<const recognition::DeepNetwork> load_embedding(
    const std::string& path);

// A network that finds faces, of the YuNet family (box_decoder.h). Images are reduced to fit the
// network's, and enlarged at most twofold. Throws ModelError as load_embedding().
[[nodiscard]] std::shared_ptr<const BoxDetector> load_box_detector(const std::string& path);

// What is reported of a network: "face.onnx: SHA-256 .., licence ..".
[[nodiscard]] std::string described(const NetworkFile& file, const InputForm& form);

}  // namespace tarsier::face::onnx
