// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/face_reader.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <string>
#include <vector>

// Images that show how recognisers work.
namespace tarsier::cli {

struct NamedImages {
  std::vector<std::string> names;
  std::vector<cv::Mat> images;
  void add(const std::string& name, const cv::Mat& image) {
    names.push_back(name);
    images.push_back(image.clone());
  }
};

// The stages of one image, from detection to what each kind of recogniser gets. Empty where no
// face is found. CV_8UC1.
[[nodiscard]] NamedImages face_stages(face::people::FaceReader& reader, const cv::Mat& gray);

// Which parts of the face speak for person `person` (index into labels): each is covered in turn by
// its own blur, and what the score loses is shown, red for, blue against. `input` as the recogniser
// gets it. CV_8UC3.
[[nodiscard]] cv::Mat evidence_image(const face::recognition::Recognizer& model,
                                     const cv::Mat& input, int person);

}  // namespace tarsier::cli
