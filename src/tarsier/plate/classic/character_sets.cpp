// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/classic/character_reader.h"
#include "tarsier/plate/classic/xml_matrix.h"
#include "tarsier/plate/text/reading.h"
#include "tarsier/plate/text/symbol_labels.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace tarsier::plate {
namespace {

namespace fs = std::filesystem;

CharacterSet from_xml(const std::string& path) {
  const auto matrices = read_xml_matrices(path);
  const cv::Mat& pixels = matrix_named(matrices, "TrainingDataF20", path);
  const cv::Mat& classes = matrix_named(matrices, "classes", path);
  constexpr int kHistograms = 2 * kCharacterSize;
  if (pixels.cols != kHistograms + kCharacterSize * kCharacterSize ||
      pixels.rows != static_cast<int>(classes.total())) {
    throw InputError(path, fmt::format("TrainingDataF20 is {}x{}, classes has {}: 440 columns and "
                                       "as many rows are expected",
                                       pixels.rows, pixels.cols, classes.total()));
  }
  CharacterSet set;
  set.symbols = kSpanishSymbols;
  for (int i = 0; i < pixels.rows; ++i) {
    const auto label = static_cast<int>(classes.ptr<float>()[i]);
    if (label < 0 || label >= static_cast<int>(set.symbols.size()))
      throw InputError(path, fmt::format("classes: {} is not 0..29", label));
    cv::Mat character;
    pixels.row(i)
        .colRange(kHistograms, pixels.cols)
        .reshape(1, kCharacterSize)
        .convertTo(character, CV_8U);
    set.characters.push_back(character);
    set.labels.push_back(label);
  }
  return set;
}

std::vector<fs::path> sorted(const fs::path& folder) {
  std::vector<fs::path> paths;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error))
    paths.push_back(entry.path());
  if (error) throw InputError(folder.string(), "cannot be read: " + error.message());
  std::sort(paths.begin(), paths.end());
  return paths;
}

// Converts dark ink on a bright plate to bright on dark, and stretches the contrast.
cv::Mat bright_ink(const cv::Mat& gray) {
  cv::Mat result;
  cv::normalize(255 - gray, result, 0, 255, cv::NORM_MINMAX);
  return result;
}

CharacterSet from_class_folders(const std::string& folder) {
  CharacterSet set;
  set.symbols = kAlphabet;
  for (const fs::path& path : sorted(folder)) {
    const std::string name = path.filename().string();
    if (!fs::is_directory(path) || name.size() != 1 || class_of(name[0]) < 0) continue;
    for (const fs::path& image : sorted(path)) {
      if (!is_image_path(image.string())) continue;
      cv::Mat gray = read_gray_image(image.string());
      // Either polarity: the border is background.
      const double border = (cv::mean(gray.row(0))[0] + cv::mean(gray.row(gray.rows - 1))[0]) / 2;
      if (border > cv::mean(gray)[0]) gray = bright_ink(gray);
      set.characters.push_back(normalized_character(gray));
      set.labels.push_back(class_of(name[0]));
    }
  }
  return set;
}

CharacterSet from_labelled_plates(const std::string& folder) {
  CharacterSet set;
  set.symbols = kAlphabet;
  int group = 0;
  for (const fs::path& path : sorted(folder)) {
    if (!is_image_path(path.string())) continue;
    fs::path labels = path;
    labels.replace_extension(".txt");
    std::error_code error;
    if (!fs::exists(labels, error)) continue;
    const cv::Mat gray = read_gray_image(path.string());
    for (const auto& [class_id, x, y, w, h] : read_symbol_labels(labels.string())) {
      const cv::Rect box =
          cv::Rect(cvRound((x - w / 2) * gray.cols), cvRound((y - h / 2) * gray.rows),
                   std::max(2, cvRound(w * gray.cols)), std::max(2, cvRound(h * gray.rows))) &
          cv::Rect(0, 0, gray.cols, gray.rows);
      if (box.width < 2 || box.height < 2) continue;
      set.characters.push_back(normalized_character(bright_ink(gray(box))));
      set.labels.push_back(class_id);
      set.groups.push_back(group);
    }
    ++group;
  }
  return set;
}

}  // namespace

CharacterSet read_character_set(const std::string& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return from_xml(path);
  CharacterSet set = from_class_folders(path);
  if (set.characters.empty()) set = from_labelled_plates(path);
  if (set.characters.empty()) {
    throw InputError(path,
                     "holds neither a folder of images for each symbol nor images with .txt "
                     "labels beside them");
  }
  return set;
}

}  // namespace tarsier::plate
