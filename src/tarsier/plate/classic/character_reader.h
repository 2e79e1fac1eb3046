// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/plate/classic/features.h"
#include "tarsier/plate/classic/linear.h"
#include "tarsier/plate/classic/mlp.h"

#include <opencv2/core/mat.hpp>

#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::plate {

// The characters of Spanish plates, in the order of the textbook's classes.
inline constexpr std::string_view kSpanishSymbols = "0123456789BCDFGHJKLMNPRSTVWXYZ";

// Characters with their labels.
struct CharacterSet {
  std::string symbols;              // class k is symbols[k]
  std::vector<cv::Mat> characters;  // CV_8UC1, 20x20, bright on dark
  std::vector<int> labels;          // class of each character
  // Group of each character, a plate. A group is never divided by a split. Empty: each character is
  // a group.
  std::vector<int> groups;
};

// Reads OCR.xml (`TrainingDataF20` and `classes`), a folder with a subfolder of images for each
// symbol, or a folder of plates with YOLO labels. Throws InputError.
[[nodiscard]] CharacterSet read_character_set(const std::string& path);

enum class ReaderKind { kMlp, kHog };

struct CharacterReaderOptions {
  ReaderKind kind = ReaderKind::kHog;
  int thumbnail_size = 10;  // px, side of the MLP's image
  MlpOptions mlp;           // 20 hidden
  double cost = 5;          // of the linear SVMs on gradients

  [[nodiscard]] OptionFields fields() {
    return {{"low", thumbnail_size, range(1, kCharacterSize), "--low",
             "px, side of the mlp's input image"},
            {"cost", cost, above(0)}};
  }
  void check() const;
};

// Classifies a character.
struct CharacterReader {
  ReaderKind kind = ReaderKind::kHog;
  std::string symbols;
  int thumbnail_size = 10;
  Mlp mlp;
  std::vector<LinearModel> svms;  // one per class, against the other classes
  double sharpness = 4;           // of the softmax over the margins

  // Probabilities of the symbols; they sum to 1. `character`: CV_8UC1, 20x20.
  [[nodiscard]] std::vector<double> probabilities(const cv::Mat& character) const;
};

// Trains on the characters of `set` with these `indices`.
[[nodiscard]] CharacterReader train_character_reader(const CharacterSet& set,
                                                     const std::vector<int>& indices,
                                                     const CharacterReaderOptions& options, Rng rng,
                                                     const std::stop_token& stop = {});

// Error rate on the characters with these `indices`.
[[nodiscard]] double character_error(const CharacterReader& reader, const CharacterSet& set,
                                     const std::vector<int>& indices);

// Indices of the characters in random order, the first `train` of them for training. Groups are not
// divided, so with groups the number is approximate.
struct CharacterSplit {
  std::vector<int> train;
  std::vector<int> test;
};
[[nodiscard]] CharacterSplit split_characters(const CharacterSet& set, int train, Rng rng);

[[nodiscard]] CharacterReader read_character_reader(const std::string& path);  // ModelError
void write_character_reader(const std::string& path, const CharacterReader& reader,
                            const nlohmann::json& provenance);

// Centres a cropped character, bright on dark, in 20x20 px and keeps its aspect ratio.
[[nodiscard]] cv::Mat normalized_character(const cv::Mat& crop);

}  // namespace tarsier::plate
