// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/text/evaluation.h"
#include "tarsier/plate/text/symbol_labels.h"
#include "tarsier/plate/train/training_views.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace tarsier::plate {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> image_paths_of(const fs::path& folder) {
  std::vector<fs::path> paths;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error))
    if (is_image_path(entry.path().string())) paths.push_back(entry.path());
  if (error) throw InputError(folder.string(), "cannot be read: " + error.message());
  std::sort(paths.begin(), paths.end());
  if (paths.empty()) throw InputError(folder.string(), "holds no images");
  return paths;
}

Scene scene_of(const fs::path& path, const std::vector<TruthPlate>& plates, double max_pixels) {
  Scene scene;
  scene.image = read_image(path.string());
  const double scale =
      std::min(1.0, std::sqrt(max_pixels / static_cast<double>(scene.image.total())));
  if (scale < 1) cv::resize(scene.image, scene.image, {}, scale, scale, cv::INTER_AREA);
  for (const TruthPlate& plate : plates) {
    if (!plate.box) continue;
    scene.plates.emplace_back(static_cast<float>(plate.box->x * scale),
                              static_cast<float>(plate.box->y * scale),
                              static_cast<float>(plate.box->width * scale),
                              static_cast<float>(plate.box->height * scale));
  }
  return scene;
}

LabelledCrop crop_of(const fs::path& path) {
  fs::path labels = path;
  labels.replace_extension(".txt");
  LabelledCrop crop;
  crop.image = read_image(path.string());
  std::string text = path.stem().string();
  text = text.substr(text.rfind('_') + 1);
  text = text.substr(text.find('-') + 1);
  crop.length = static_cast<int>(text.size());
  const auto cols = static_cast<float>(crop.image.cols);
  const auto rows = static_cast<float>(crop.image.rows);
  for (const SymbolLabel& label : read_symbol_labels(labels.string())) {
    crop.symbols.push_back(
        {kAlphabet[static_cast<std::size_t>(label.class_id)],
         {static_cast<float>(label.x - label.w / 2) * cols,
          static_cast<float>(label.y - label.h / 2) * rows, static_cast<float>(label.w) * cols,
          static_cast<float>(label.h) * rows},
         -1});
  }
  // Positions: assigns the visible symbols in the order of the text.
  std::size_t next = 0;
  for (std::size_t i = 0; i < text.size() && next < crop.symbols.size(); ++i) {
    if (text[i] == '-') continue;
    crop.symbols[next].position = static_cast<int>(i);
    if (crop.symbols[next].symbol != text[i]) break;
    ++next;
  }
  // Labels and name do not match.
  if (next != crop.symbols.size() || next == 0) crop.symbols.clear();
  return crop;
}

}  // namespace

std::vector<Scene> read_scenes(const std::string& folder, double max_pixels) {
  std::vector<Scene> scenes;
  const fs::path truth_path = fs::path(folder) / "truth.csv";
  const fs::path images = fs::path(folder) / "images";
  if (fs::exists(truth_path)) {
    const auto truth = read_plate_truth(truth_path.string());
    for (const fs::path& path : image_paths_of(fs::exists(images) ? images : fs::path(folder))) {
      const auto found = truth.find(path.filename().string());
      if (found != truth.end()) scenes.push_back(scene_of(path, found->second, max_pixels));
    }
    return scenes;
  }
  for (const fs::path& path : image_paths_of(folder))
    scenes.push_back(scene_of(path, {}, max_pixels));
  return scenes;
}

std::vector<LabelledCrop> read_labelled_crops(const std::string& folder) {
  std::vector<LabelledCrop> crops;
  for (const fs::path& path : image_paths_of(folder)) {
    LabelledCrop crop = crop_of(path);
    if (!crop.symbols.empty()) crops.push_back(std::move(crop));
  }
  if (crops.empty()) throw InputError(folder, "no image has usable labels beside it");
  return crops;
}

namespace {

bool may_be_one_plate(const LabelledCrop& a, const LabelledCrop& b) {
  int agreeing = 0;
  for (const auto& x : a.symbols) {
    for (const auto& y : b.symbols) {
      if (x.position != y.position) continue;
      if (x.symbol != y.symbol) return false;
      ++agreeing;
    }
  }
  return agreeing >= 3;
}

}  // namespace

CropSplit split_crops(std::vector<LabelledCrop> crops, double test_share, Rng rng) {
  TARSIER_REQUIRE(test_share >= 0 && test_share < 1, "a share of {}", test_share);
  for (std::size_t i = crops.size(); i > 1; --i)
    std::swap(crops[i - 1],
              crops[static_cast<std::size_t>(rng.integer(0, static_cast<int>(i) - 1))]);
  const auto count =
      static_cast<std::size_t>(std::lround(test_share * static_cast<double>(crops.size())));
  CropSplit split;
  for (std::size_t i = 0; i < crops.size(); ++i) {
    if (i < count) {
      split.test.push_back(std::move(crops[i]));
      continue;
    }
    const bool is_in_test_set =
        std::any_of(split.test.begin(), split.test.end(),
                    [&](const LabelledCrop& other) { return may_be_one_plate(other, crops[i]); });
    if (!is_in_test_set) split.train.push_back(std::move(crops[i]));
  }
  return split;
}

}  // namespace tarsier::plate
