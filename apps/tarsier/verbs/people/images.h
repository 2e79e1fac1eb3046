// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/face_reader.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
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

// Faces in one image, eight a row, each with its number below it, so that whoever puts a gallery
// right sees which is which.
class FaceSheet {
 public:
  explicit FaceSheet(std::string path) : path_(std::move(path)) {}  // empty: nothing is drawn

  [[nodiscard]] bool is_drawn() const { return !path_.empty(); }
  // The next face, as cut_face() makes it (empty: it was not kept), and `line` of the JSON output
  // gets "box": where it lies in the image, [x, y, width, height] in px. Of more than 800 faces the
  // rest are left out.
  void add(const cv::Mat& crop, std::int64_t number, nlohmann::ordered_json& line);
  // Writes the image. A warning says how many were left out. Throws IoError.
  void write() const;

 private:
  std::string path_;
  std::vector<cv::Mat> cells_;
  std::size_t left_out_ = 0;
};

}  // namespace tarsier::cli
