// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/face_reader.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

// Images that explain how recognisers work.
namespace tarsier::cli {

struct NamedImages {
  std::vector<std::string> names;
  std::vector<cv::Mat> images;
  void add(const std::string& name, const cv::Mat& image) {
    names.push_back(name);
    images.push_back(image.clone());
  }
};

// The stages of one image, from detection to the input of each kind of recogniser. Empty if no face
// is found. CV_8UC1.
[[nodiscard]] NamedImages face_stages(face::people::FaceReader& reader, const cv::Mat& gray);

// Shows which parts of the face support person `person` (index into labels). Each part in turn is
// replaced by its blur, and the loss of score is drawn: red supports the person, blue contradicts.
// `input` is the recogniser's input. CV_8UC3.
[[nodiscard]] cv::Mat evidence_image(const face::recognition::Recognizer& model,
                                     const cv::Mat& input, int person);

// A sheet of numbered faces, eight in a row. With it, a user who corrects a gallery sees which face
// has which number.
class FaceSheet {
 public:
  explicit FaceSheet(std::string path) : path_(std::move(path)) {}  // empty path: nothing is drawn

  [[nodiscard]] bool is_drawn() const { return !path_.empty(); }
  // Adds a face: a crop of crop_face(), or empty if the crop was not kept. Writes "box" into `line`
  // of the JSON output: its place in the sheet, [x, y, width, height] in px. The sheet has at most
  // 800 faces; further ones are left out.
  void add(const cv::Mat& crop, std::int64_t number, nlohmann::ordered_json& line);
  // Writes the sheet. Warns if faces were left out. Throws IoError.
  void write() const;

 private:
  std::string path_;
  std::vector<cv::Mat> cells_;
  std::size_t left_out_ = 0;
};

}  // namespace tarsier::cli
