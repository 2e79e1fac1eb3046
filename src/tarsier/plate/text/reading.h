// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <array>
#include <string>
#include <string_view>
#include <vector>

// What is read from a number plate. Images are CV_8UC3 (BGR) or CV_8UC1; coordinates are pixels of
// the whole image, (0, 0) the centre of its first pixel.
namespace tarsier::plate {

// The symbols that plates are read with, in the order of class numbers; class kBlank is "no
// character here".
inline constexpr std::string_view kAlphabet = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ";
inline constexpr int kBlank = 36;
inline constexpr int kClasses = 37;

// Class number of a symbol of kAlphabet, -1 for any other.
[[nodiscard]] int class_of(char symbol);

// Corners of a plate as its reader sees them: top left, top right, bottom right, bottom left.
using Quad = std::array<cv::Point2f, 4>;

// The smallest upright box around the quad, cut to `size`.
[[nodiscard]] cv::Rect bounding_box(const Quad& quad, cv::Size size);

struct Character {
  char symbol = '?';
  double confidence = 0;  // 0..1
  Quad corners{};         // in the image
};

struct Candidate {
  std::string text;
  double confidence = 0;  // 0..1; the candidates of one plate add up to 1 at most
  std::string country;    // the layout's code ("es", "sk"..), empty where none fits
};

// One plate of one image.
struct Reading {
  std::string text;       // candidates[0].text; symbols of kAlphabet only
  double confidence = 0;  // 0..1: chance that the whole text is right
  double plate = 0;       // 0..1: chance that this is a plate at all, whatever it reads
  std::string country;    // as of the best candidate
  cv::Rect box;           // upright, within the image
  Quad corners{};
  int rows = 1;  // of characters
  std::vector<Character> characters;
  std::vector<Candidate> candidates;  // best first, texts differ
  // What is lettered there, where no text of the countries that were asked for comes near it; empty
  // where one does, and where all countries are allowed.
  std::string unfit;
};

}  // namespace tarsier::plate
