// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/plate/classic/features.h"
#include "tarsier/plate/classic/linear.h"
#include "tarsier/plate/classic/mlp.h"

#include <opencv2/core/mat.hpp>

#include <nlohmann/json.hpp>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::plate {

// The characters of Spanish plates, in the order of the textbook's classes.
inline constexpr std::string_view kSpanishSymbols = "0123456789BCDFGHJKLMNPRSTVWXYZ";

// Characters with known symbols.
struct CharacterSet {
  std::string symbols;              // class k is symbols[k]
  std::vector<cv::Mat> characters;  // CV_8UC1, 20x20, bright on dark
  std::vector<int> labels;          // class of each
  std::vector<int> groups;          // of each; characters of a group (a plate) stay together in a
                                    // split. Empty: each is its own
};

// OCR.xml (`TrainingDataF20` and `classes`); or a folder with a folder of images for each symbol;
// or a folder of plates with YOLO labels beside them. Throws InputError.
[[nodiscard]] CharacterSet read_character_set(const std::string& path);

enum class ReaderKind { kMlp, kHog };

struct CharacterReaderOptions {
  ReaderKind kind = ReaderKind::kHog;
  int low = 10;     // of the MLP's pixels: low x low
  MlpOptions mlp;   // 20 hidden
  double cost = 5;  // of the linear machines on gradients

  [[nodiscard]] OptionFields fields() {
    return {{"low", low, range(1, kCharacterSize), "--low", "px of the mlp's small image"},
            {"cost", cost, above(0)}};
  }
  void check() const;
};

// Says which character it is.
struct CharacterReader {
  ReaderKind kind = ReaderKind::kHog;
  std::string symbols;
  int low = 10;
  Mlp mlp;
  std::vector<LinearModel> machines;  // one a class against the rest
  double sharpness = 4;               // of the soft maximum over margins

  // Chances of the symbols, they sum to 1. CV_8UC1, 20x20.
  [[nodiscard]] std::vector<double> chances(const cv::Mat& character) const;
};

// From the characters of `set` that `chosen` numbers.
[[nodiscard]] CharacterReader train_character_reader(const CharacterSet& set,
                                                     const std::vector<int>& chosen,
                                                     const CharacterReaderOptions& options, Rng rng,
                                                     const std::stop_token& stop = {});

// Share of `chosen` that is read wrong.
[[nodiscard]] double character_error(const CharacterReader& reader, const CharacterSet& set,
                                     const std::vector<int>& chosen);

// Numbers of the characters in random order, `train` of them first (by whole groups where there are
// groups; then about as many).
struct CharacterSplit {
  std::vector<int> train;
  std::vector<int> test;
};
[[nodiscard]] CharacterSplit split_characters(const CharacterSet& set, int train, Rng rng);

[[nodiscard]] CharacterReader read_character_reader(const std::string& path);  // ModelError
void write_character_reader(const std::string& path, const CharacterReader& reader,
                            const nlohmann::json& provenance);

// A character cut from a plate, bright on dark, put into the middle of 20x20 with its aspect kept.
[[nodiscard]] cv::Mat normalized_character(const cv::Mat& cut);

}  // namespace tarsier::plate
