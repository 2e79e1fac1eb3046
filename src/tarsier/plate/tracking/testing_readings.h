// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/plate/text/reading.h"

#include <algorithm>
#include <map>
#include <string>
#include <vector>

// Simulated readings: often wrong for small plates, and then mostly with a low confidence.
namespace tarsier::plate {

inline char confused_with(char symbol, Rng& rng) {
  static const std::map<char, std::string> kLikely{
      {'0', "ODQ8"}, {'O', "0DQ"}, {'1', "I7L"}, {'2', "Z7"}, {'3', "8B"},  {'4', "A1"},
      {'5', "S6"},   {'6', "G8"},  {'7', "1T"},  {'8', "B3"}, {'9', "8G0"}, {'B', "8R"},
      {'D', "O0"},   {'G', "6C"},  {'S', "58"},  {'Z', "27"}};
  const auto likely = kLikely.find(symbol);
  if (likely != kLikely.end() && rng.uniform() < 0.7) {
    const std::string& others = likely->second;
    return others[static_cast<std::size_t>(rng.integer(0, static_cast<int>(others.size()) - 1))];
  }
  return kAlphabet[static_cast<std::size_t>(rng.integer(0, 35))];
}

// `error`: probability that a character is misread, 0..1.
inline Reading noisy_reading(const std::string& text, cv::Rect box, double error, Rng& rng) {
  Reading reading;
  reading.box = box;
  reading.plate = 0.95;
  reading.confidence = 1;
  std::string runner_up;
  double min_confidence = 2;
  for (const char symbol : text) {
    if (rng.uniform() < 0.1 * error) continue;  // character is missed
    const bool right = rng.uniform() >= error;
    const char other = confused_with(symbol, rng);
    Character character;
    character.symbol = right ? symbol : other;
    // A wrong character mostly has a low confidence, but not always.
    character.confidence = right ? 1 - error * rng.uniform() : rng.uniform(0.2, 0.95);
    reading.text += character.symbol;
    reading.confidence *= character.confidence;
    runner_up += character.symbol;
    if (character.confidence < min_confidence) {
      min_confidence = character.confidence;
      runner_up.back() = right ? other : symbol;
      if (reading.text.size() > 1) {
        runner_up = reading.text.substr(0, reading.text.size() - 1) + runner_up.back();
      }
    }
    reading.characters.push_back(character);
  }
  reading.confidence = std::clamp(reading.confidence, 0.01, 0.999);
  reading.candidates = {{reading.text, reading.confidence, ""}};
  if (runner_up != reading.text && !runner_up.empty()) {
    reading.candidates.push_back({runner_up, 0.6 * (1 - reading.confidence), ""});
  }
  return reading;
}

}  // namespace tarsier::plate
