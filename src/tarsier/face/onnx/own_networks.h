// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detect/box_detector.h"
#include "tarsier/face/onnx/network_file.h"
#include "tarsier/face/recognition/deep.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <string>

// The user's own networks as ONNX files, run by OpenCV's dnn (module.h): one for embeddings, one
// for detection. The program includes none.
namespace tarsier::face::onnx {

// The usual alignment of five points in 112 x 112 px (Deng and others, "ArcFace", 2019): centre and
// distance of the eyes, px. Networks must use this alignment.
inline constexpr double kAlignedSide = 112;
inline constexpr double kAlignedEyesX = 55.913;
inline constexpr double kAlignedEyesY = 51.599;
inline constexpr double kAlignedEyeDistance = 35.237;

// The network's input chip, CV_8UC1 of `size` px, from a face that is cropped as in people/eyes.h
// (CV_8UC1 of any size). A similarity moves the eyes to their aligned positions. Missing parts are
// filled by replicating the border. (The crop itself comes from a least-squares similarity of eyes,
// nose and upper lip.) Throws std::invalid_argument.
[[nodiscard]] cv::Mat aligned_chip(const cv::Mat& crop, cv::Size size);

// Loads an embedding network: one input of 1 x 1 or 3 x H x W (chips are grey, with equal channels,
// so the colour order does not matter), one output of 8 to 4096 numbers, which is normalised to
// unit length. Throws ModelError for other networks, and if ONNX files cannot be run here.
[[nodiscard]] std::shared_ptr<const recognition::DeepNetwork> load_embedding(
    const std::string& path);

// Loads a face detection network of the YuNet family (box_decoder.h). Images are reduced to fit the
// network's input, or enlarged at most twofold. Throws ModelError as load_embedding().
[[nodiscard]] std::shared_ptr<const BoxDetector> load_box_detector(const std::string& path);

// Description of a network for reports: "face.onnx: SHA-256 .., licence ..".
[[nodiscard]] std::string description_of(const NetworkFile& file, const InputFormat& format);

}  // namespace tarsier::face::onnx
